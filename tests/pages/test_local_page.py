"""The server of local pages: access, and bodies of requests."""

import socket
from http.client import HTTPConnection

import pytest

from tactileforge.errors import ConfigError
from tactileforge.pages.local_page import LocalPage, PageAnswer


def ask(page, method, path, body=None, **headers):
    host, port = page.url.split("/")[2].split(":")
    connection = HTTPConnection(host, int(port), timeout=20)
    connection.request(method, f"/{page.token}/{path}", body, headers)
    answer = connection.getresponse()
    found = answer.status, answer.read(), answer.headers
    connection.close()
    return found


@pytest.fixture
def page():
    said = []

    def take(path, body):
        said.append((path, body))
        return PageAnswer(b"taken")

    with LocalPage(lambda path, query: PageAnswer(f"{path} {dict(query)}".encode()), take) as page:
        page.said = said
        yield page


def test_paths_are_decoded_and_bodies_are_passed(page):
    assert ask(page, "GET", "a%20b/c?x=1")[:2] == (200, b"a b/c {'x': '1'}")
    assert ask(page, "POST", "a", b"body")[:2] == (200, b"taken")
    assert page.said == [("a", b"body")]


def test_pages_of_other_origins_are_refused(page):
    own = page.url.rsplit("/", 2)[0]
    assert ask(page, "POST", "a", b"body", Origin=own)[0] == 200
    for origin in ("http://evil.example", "null", own.replace("http:", "https:")):
        assert ask(page, "POST", "a", b"body", Origin=origin)[0] == 403
    assert len(page.said) == 1


def test_a_body_has_a_length_and_a_limit(page):
    assert ask(page, "POST", "a", b"", **{"Content-Length": str(1 << 23)})[0] == 413
    assert ask(page, "POST", "a", b"", **{"Content-Length": "-1"})[0] == 413
    host, port = page.url.split("/")[2].split(":")
    with socket.create_connection((host, int(port)), 20) as line:
        line.sendall(f"POST /{page.token}/a HTTP/1.1\r\nHost: {host}:{port}\r\n\r\n".encode())
        assert b" 413 " in line.recv(100)
    assert page.said == []


def test_a_page_that_takes_nothing_says_so():
    with LocalPage(lambda path, query: PageAnswer(b"<p NONCE>", "text/html")) as page:
        assert ask(page, "POST", "a", b"body")[0] == 405
        _, body, headers = ask(page, "GET", "")
        nonce = body.decode().split()[1].rstrip(">")
        assert len(nonce) >= 16
        assert f"script-src 'nonce-{nonce}'" in headers["Content-Security-Policy"]


def test_a_port_that_is_none():
    with pytest.raises(ConfigError, match="port=70000: give 1 to 65535"):
        LocalPage(lambda path, query: PageAnswer(b""), port=70000)
