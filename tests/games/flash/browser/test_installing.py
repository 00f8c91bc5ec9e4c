"""Ruffle comes from npm, whole and unchanged, or not at all."""

import base64
import hashlib
import io
import tarfile
import threading
from http.server import BaseHTTPRequestHandler, HTTPServer
from pathlib import Path

import pytest

from marl_cair.games.flash.browser import installing
from marl_cair.games.flash.browser.installing import (
    InstallError,
    diagnose,
    find_ruffle,
    install_ruffle,
)
from marl_cair.npm import find_registry

TARBALL = "/@ruffle-rs/ruffle/-/ruffle-0.6.0.tgz"


@pytest.fixture
def cache(tmp_path, monkeypatch):
    monkeypatch.delenv("MARL_CAIR_RUFFLE", raising=False)
    monkeypatch.delenv("MARL_CAIR_CACHE", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    return tmp_path / "marl_cair" / "ruffle-0.6.0"


@pytest.fixture
def registry(monkeypatch):
    """A registry on this machine: `files` holds what it serves."""

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self):
            data = server.files.get(self.path)
            self.send_response(404 if data is None else 200)
            self.end_headers()
            self.wfile.write(data or b"")

        def log_message(self, *_):
            pass

    server = HTTPServer(("127.0.0.1", 0), Handler)
    server.files = {TARBALL: pack_package()}
    thread = threading.Thread(target=server.serve_forever, args=(0.01,))
    thread.start()
    monkeypatch.setenv("NPM_CONFIG_REGISTRY", f"http://127.0.0.1:{server.server_port}/")
    yield server
    server.shutdown()
    server.server_close()
    thread.join()


def pack_package():
    packed = io.BytesIO()
    with tarfile.open(fileobj=packed, mode="w:gz") as archive:
        for name in (*installing._RUFFLE.files, "../../evil.js", "ruffle.js.map"):
            info = tarfile.TarInfo(f"package/{name}")
            info.size = len(name)
            archive.addfile(info, io.BytesIO(name.encode()))
    return packed.getvalue()


def accept(monkeypatch, data):
    digest = base64.b64encode(hashlib.sha512(data).digest()).decode()
    monkeypatch.setattr(installing, "_RUFFLE", installing._RUFFLE._replace(sha512=digest))


def test_only_what_the_page_needs_is_kept(cache, registry, monkeypatch):
    accept(monkeypatch, registry.files[TARBALL])
    with pytest.raises(InstallError, match="marl-cair flash install"):
        find_ruffle()
    assert install_ruffle() == cache == find_ruffle()
    assert {path.name for path in cache.iterdir()} == set(installing._RUFFLE.files)
    assert (cache / "ruffle.js").read_text("utf-8") == "ruffle.js"
    registry.files.clear()
    assert install_ruffle() == cache  # it is not fetched twice


def test_another_content_is_refused(cache, registry):
    with pytest.raises(InstallError, match=r"it must be P2X1zDEN.*Nothing was installed"):
        install_ruffle()
    assert not cache.exists()


def test_a_registry_without_it_is_named(cache, registry):
    registry.files.clear()
    with pytest.raises(InstallError, match=rf"could not fetch http://127.*{TARBALL}: .*404"):
        install_ruffle()


@pytest.mark.parametrize("address", ["http://127.0.0.1:1", "https://127.0.0.1:1"])
def test_a_registry_that_does_not_answer_is_named(cache, monkeypatch, address):
    monkeypatch.setenv("NPM_CONFIG_REGISTRY", address)
    with pytest.raises(InstallError, match="could not fetch"):
        install_ruffle()


def test_a_registry_is_reached_over_http(cache, monkeypatch):
    monkeypatch.setenv("NPM_CONFIG_REGISTRY", "file:///etc")
    with pytest.raises(InstallError, match="must begin with https://"):
        install_ruffle()


def test_the_registry_is_that_of_npm(tmp_path, monkeypatch):
    for name in ("NPM_CONFIG_REGISTRY", "npm_config_registry"):
        monkeypatch.delenv(name, raising=False)
    npm = tmp_path / "npm"
    npm.write_text('#!/bin/sh\n[ "$*" = "config get registry" ] && echo https://npm.example/\n')
    npm.chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path), prepend=":")
    assert find_registry() == "https://npm.example"
    npm.unlink()
    monkeypatch.setenv("PATH", str(tmp_path))
    assert find_registry() == "https://registry.npmjs.org"
    monkeypatch.setenv("NPM_CONFIG_REGISTRY", "https://other.example/npm/")
    assert find_registry() == "https://other.example/npm"


def test_a_folder_of_the_user_comes_first(cache, tmp_path, monkeypatch):
    monkeypatch.setenv("MARL_CAIR_RUFFLE", str(tmp_path))
    with pytest.raises(InstallError, match=r"\$MARL_CAIR_RUFFLE, .* holds no ruffle.js"):
        find_ruffle()
    for name in ("ruffle.js", "a.wasm"):
        (tmp_path / name).touch()
    assert find_ruffle() == tmp_path


def test_what_is_missing_is_listed_with_the_command_that_installs_it(cache, monkeypatch):
    monkeypatch.setenv("PATH", "/nowhere")
    missing = {part.name: part.command for part in diagnose()}
    assert missing == {
        "chromium": "apt-get install chromium",
        "Xtigervnc": "apt-get install tigervnc-standalone-server",
        "Ruffle": "marl-cair flash install",
    }
    assert "Xtigervnc" not in {part.name for part in diagnose(needs_display=False)}


def test_nothing_is_missing_where_all_is_installed(tmp_path, monkeypatch):
    for name in ("chromium", "Xtigervnc"):
        (tmp_path / name).touch(0o755)
    for name in ("ruffle.js", "a.wasm"):
        (tmp_path / name).touch()
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setenv("MARL_CAIR_RUFFLE", str(tmp_path))
    assert diagnose() == []
    assert Path(installing.find_browser()) == tmp_path / "chromium"
