"""Fetches packages of npm's registry, checked against the checksums of their known versions."""

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

_REGISTRY = "https://registry.npmjs.org"
_TIMEOUT_S = 60.0


class InstallError(OSError):
    """A package could not be fetched, is missing, or is not what was expected."""


class Package(NamedTuple):
    """One version of a package.

    Attributes:
        name, version: as npm has them.
        sha512: what the registry gives as `dist.integrity`, without "sha512-".
        files: that are kept, by their paths in the package; the last is written last: where it is,
            all are.
    """

    name: str
    version: str
    sha512: str
    files: tuple[str, ...]


def install_package(package: Package, folder: Path) -> Path:
    """Fetch the package from the user's npm registry unless `folder` holds its files, which are all
    written into `folder` itself; return it.

    Raises InstallError (no connection, another content than expected) and OSError (a full disk).
    """
    if (folder / Path(package.files[-1]).name).is_file():
        return folder
    registry, short = find_registry(), package.name.rpartition("/")[2]
    data = _download(f"{registry}/{package.name}/-/{short}-{package.version}.tgz")
    digest = base64.b64encode(hashlib.sha512(data).digest()).decode()
    if digest != package.sha512:
        raise InstallError(
            f"the download of {package.name} {package.version} has the SHA-512 {digest}, it must "
            f"be {package.sha512}. Nothing was installed; check the npm registry {registry}"
        )
    with tarfile.open(fileobj=io.BytesIO(data), mode="r:gz") as archive:
        for name in package.files:
            part = archive.extractfile(f"package/{name}")
            if part is not None:
                write_atomically(folder / Path(name).name, part.read())
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
