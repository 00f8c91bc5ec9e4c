"""Finds what Flash games need, and fetches Ruffle, the Flash player, from npm."""

from __future__ import annotations

import os
import shutil
from pathlib import Path
from typing import NamedTuple

from marl_cair.npm import InstallError, Package, install_package

RUFFLE_VERSION = "0.6.0"
FOLDER_VARIABLE = "MARL_CAIR_RUFFLE"  # a folder with an unpacked npm package
_RUFFLE = Package(
    name="@ruffle-rs/ruffle",
    version=RUFFLE_VERSION,
    sha512="P2X1zDENBoiLt2ZjPcsUzaDxoR7fVF2e1U/bi7hbIAQEjkykxljSoG8AgbywHvlVVzL9Y5tIZMRqDwIm31jgPA==",
    # The player, its part for browsers with WebAssembly extensions, and that part's machine code.
    files=(
        "LICENSE_MIT",
        "LICENSE_APACHE",
        "826bb0938097485a2c9d.wasm",
        "core.ruffle.c80159b526e567babaf5.js",
        "ruffle.js",
    ),
)
BROWSERS = ("chromium", "chromium-browser", "google-chrome")


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
    return install_package(_RUFFLE, default_folder())


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
