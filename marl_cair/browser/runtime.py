"""Fetches onnxruntime-web, which runs networks in browsers, from npm."""

from __future__ import annotations

from pathlib import Path

from marl_cair.games.compiled import cache_root
from marl_cair.npm import InstallError, Package, install_package

RUNTIME = Package(
    name="onnxruntime-web",
    version="1.30.0",
    sha512="q0y+JrrtukXSzsBWEMccVfqX25LRmosXHF+CaRJmg8pZClzcV7svNc4rKY3jL02Vb7QmRMDs1SigqR4CXAfKYQ==",
    files=("dist/ort-wasm-simd-threaded.wasm", "dist/ort.wasm.bundle.min.mjs"),
)
INSTALL_COMMAND = "marl-cair play install"


def runtime_folder() -> Path:
    """Where `install_runtime` puts the files, in the user's cache folder."""
    return cache_root() / f"{RUNTIME.name}-{RUNTIME.version}"


def install_runtime() -> Path:
    """Fetch the files (14 MB) unless they are there; return their folder. Raises InstallError."""
    return install_package(RUNTIME, runtime_folder())


def find_runtime() -> list[Path]:
    """The files. Raises InstallError if they are missing."""
    files = [runtime_folder() / Path(name).name for name in RUNTIME.files]
    if missing := [file.name for file in files if not file.is_file()]:
        raise InstallError(
            f"{runtime_folder()} holds no {', '.join(missing)}, which run networks in a browser. "
            f"Run '{INSTALL_COMMAND}', or choose a bot as --opponent"
        )
    return files
