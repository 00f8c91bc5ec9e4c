"""The server gives the folder's files on loopback, and nothing else."""

import http.client

import pytest

from marl_cair.browser.folder import PAGE_FILE
from marl_cair.browser.serving import make_server
from tests.chromium import serving, watched_page


def ask(address, path):
    host = address.removeprefix("http://").rstrip("/")
    connection = http.client.HTTPConnection(host, timeout=10)
    connection.request("GET", path)
    answer = connection.getresponse()
    answer.content = answer.read()
    connection.close()
    return answer


def test_the_page_is_served_at_the_address(tmp_path):
    (tmp_path / PAGE_FILE).write_bytes(b"content")
    with serving(make_server(tmp_path)) as address:
        answer = ask(address, "/")
    assert (answer.status, answer.content) == (200, b"content")
    assert answer.headers["Content-Type"] == "text/html"


@pytest.mark.parametrize("path", ["/../secret", "/..%2fsecret", "//../secret", "/a/../../secret"])
def test_nothing_outside_of_the_folder_is_served(tmp_path, path):
    (tmp_path / "secret").write_text("secret")
    (tmp_path / "page").mkdir()
    with serving(make_server(tmp_path / "page")) as address:
        answer = ask(address, path)
    assert answer.status == 404
    assert b"secret" not in answer.content.replace(path.encode(), b"")


def test_only_this_machine_is_served(tmp_path):
    with make_server(tmp_path) as server:
        assert server.server_address[0] == "127.0.0.1"


def test_a_port_that_is_taken_is_an_error(tmp_path):
    with make_server(tmp_path) as server, pytest.raises(OSError, match="in use"):
        make_server(tmp_path, server.server_port)


def test_the_served_page_plays(browser, folders):
    folder = folders("flappy_bird")
    with serving(make_server(folder)) as address, watched_page(browser) as page:
        page.goto(address)
        page.locator("#start:enabled").wait_for(timeout=60_000)
        page.evaluate("play.stepOnce()")
        assert page.evaluate("play.played.length") == 1
