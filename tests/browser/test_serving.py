"""The server gives the folder's files with their types, on loopback, and nothing else."""

import http.client

import pytest

from marl_cair.browser.serving import make_server
from tests.browser.conftest import serve


def ask(address, path):
    host = address.removeprefix("http://").rstrip("/")
    connection = http.client.HTTPConnection(host, timeout=10)
    connection.request("GET", path)
    answer = connection.getresponse()
    answer.content = answer.read()
    connection.close()
    return answer


@pytest.mark.parametrize(
    ("name", "kind"),
    [
        ("rules.wasm", "application/wasm"),
        ("play.js", "text/javascript; charset=utf-8"),
        ("ort.mjs", "text/javascript; charset=utf-8"),
        ("agent.onnx", "application/octet-stream"),
    ],
)
def test_files_have_the_types_that_browsers_ask_for(tmp_path, name, kind):
    (tmp_path / name).write_bytes(b"content")
    with serve(tmp_path) as address:
        answer = ask(address, f"/{name}")
    assert (answer.status, answer.content) == (200, b"content")
    assert answer.headers["Content-Type"] == kind


@pytest.mark.parametrize("path", ["/../secret", "/..%2fsecret", "//../secret", "/a/../../secret"])
def test_nothing_outside_of_the_folder_is_served(tmp_path, path):
    (tmp_path / "secret").write_text("secret")
    (tmp_path / "page").mkdir()
    with serve(tmp_path / "page") as address:
        answer = ask(address, path)
    assert answer.status == 404
    assert b"secret" not in answer.content.replace(path.encode(), b"")


def test_only_this_machine_is_served(tmp_path):
    with make_server(tmp_path) as server:
        assert server.server_address[0] == "127.0.0.1"


def test_a_port_that_is_taken_is_an_error(tmp_path):
    with make_server(tmp_path) as server, pytest.raises(OSError, match="in use"):
        make_server(tmp_path, server.server_port)
