"""Finds what Flash games need, and fetches Ruffle, the Flash player, from npm."""

from __future__ import annotations

import base64
import hashlib
import io
import os
import shutil
import subprocess
import tarfile
import urllib.error
import urllib.request
from pathlib import Path
from typing import NamedTuple

from marl_cair.files import write_atomically

RUFFLE_VERSION = "0.6.0"
FOLDER_VARIABLE = "MARL_CAIR_RUFFLE"  # a folder with an unpacked npm package
_PACKAGE = "@ruffle-rs/ruffle"
# What the registry gives as `dist.integrity` of this version.
_SHA512 = "P2X1zDENBoiLt2ZjPcsUzaDxoR7fVF2e1U/bi7hbIAQEjkykxljSoG8AgbywHvlVVzL9Y5tIZMRqDwIm31jgPA=="
_REGISTRY = "https://registry.npmjs.org"
_TIMEOUT_S = 60.0
# The player, its part for browsers with WebAssembly extensions, and that part's machine code.
_KEPT = (
    "LICENSE_MIT",
    "LICENSE_APACHE",
    "826bb0938097485a2c9d.wasm",
    "core.ruffle.c80159b526e567babaf5.js",
    "ruffle.js",  # last: where it is, all are
)
BROWSERS = ("chromium", "chromium-browser", "google-chrome")


class InstallError(OSError):
    """Ruffle could not be fetched, or is not what was expected."""


class Missing(NamedTuple):
    """Something that Flash games need and that was not found."""

    name: str
    purpose: str
    command: str  # that installs it


def default_folder() -> Path:
    """Where `install_ruffle` puts Ruffle, in the user's cache folder."""
    from marl_cair.games.compiled import cache_root

    return cache_root() / f"ruffle-{RUFFLE_VERSION}"


def find_ruffle() -> Path:
    """The folder with ruffle.js: $MARL_CAIR_RUFFLE, else where `install_ruffle` puts it.

    Raises InstallError if it is missing.
    """
    chosen = os.environ.get(FOLDER_VARIABLE)
    folder = Path(chosen) if chosen else default_folder()
    if (folder / "ruffle.js").is_file() and any(folder.glob("*.wasm")):
        return folder
    source = f"${FOLDER_VARIABLE}, {folder}," if chosen else str(folder)
    raise InstallError(f"{source} holds no ruffle.js and *.wasm. Run 'marl-cair flash install'")


def install_ruffle() -> Path:
    """Fetch Ruffle from the user's npm registry (10 MB) unless it is there; return its folder.

    Raises InstallError (no connection, another content than expected) and OSError (a full disk).
    """
    folder = default_folder()
    if (folder / _KEPT[-1]).is_file():
        return folder
    data = _download(f"{find_registry()}/{_PACKAGE}/-/ruffle-{RUFFLE_VERSION}.tgz")
    digest = base64.b64encode(hashlib.sha512(data).digest()).decode()
    if digest != _SHA512:
        raise InstallError(
            f"the download of {_PACKAGE} {RUFFLE_VERSION} has the SHA-512 {digest}, it must be "
            f"{_SHA512}. Nothing was installed; check the npm registry {find_registry()}"
        )
    with tarfile.open(fileobj=io.BytesIO(data), mode="r:gz") as archive:
        for name in _KEPT:
            part = archive.extractfile(f"package/{name}")
            if part is not None:
                write_atomically(folder / name, part.read())
    return folder


def find_registry() -> str:
    """Address of the user's npm registry, as npm finds it, without a slash at the end."""
    for name in ("npm_config_registry", "NPM_CONFIG_REGISTRY"):
        if chosen := os.environ.get(name):
            return chosen.rstrip("/")
    if npm := shutil.which("npm"):
        asked = subprocess.run(
            [npm, "config", "get", "registry"],
            capture_output=True,
            text=True,
            check=False,
            timeout=_TIMEOUT_S,
        )
        if asked.returncode == 0 and asked.stdout.startswith("http"):
            return asked.stdout.strip().rstrip("/")
    return _REGISTRY


def _download(address: str) -> bytes:
    if not address.startswith(("https://", "http://")):
        raise InstallError(f"the npm registry's address {address!r} must begin with https://")
    try:
        with urllib.request.urlopen(address, timeout=_TIMEOUT_S) as reply:  # noqa: S310
            data: bytes = reply.read()
            return data
    except (OSError, urllib.error.URLError) as error:
        raise InstallError(f"could not fetch {address}: {error}") from error


def find_browser() -> str | None:
    """Path of Chromium, or None."""
    return next((path for name in BROWSERS if (path := shutil.which(name))), None)


def diagnose(needs_display: bool = True) -> list[Missing]:
    """What is missing, and the command that installs it. Without a display, only lockstep over the
    page's socket works.
    """
    missing = []
    if find_browser() is None:
        missing.append(Missing("chromium", "runs the games", "apt-get install chromium"))
    if needs_display and shutil.which("Xtigervnc") is None:
        missing.append(
            Missing(
                "Xtigervnc",
                "shows the games over VNC",
                "apt-get install tigervnc-standalone-server",
            )
        )
    try:
        find_ruffle()
    except InstallError:
        missing.append(Missing("Ruffle", "plays Flash files", "marl-cair flash install"))
    return missing
