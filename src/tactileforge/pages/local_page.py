"""Server of a page on this machine only, protected by a token."""

from __future__ import annotations

import hmac
import secrets
import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any, Self
from urllib.parse import parse_qsl, unquote, urlsplit

from tactileforge.errors import ConfigError

#: Time after which a silent connection is closed, s.
_SILENCE = 10.0
#: No other machine reaches this address.
_HOST = "127.0.0.1"
#: Largest number of a port.
_LAST_PORT = 65535
#: Largest body of a request, bytes.
_LARGEST = 1 << 22


@dataclass(frozen=True)
class PageAnswer:
    """Answer to a request of a page.

    Attributes:
        body: Bytes of the answer. In HTML each ``NONCE`` is replaced by that of the content
            security policy, for the page's own style and script.
        kind: Type of the content.
        status: HTTP status.

    Example:
        >>> PageAnswer(b"no such thing", status=404).kind
        'text/plain'
    """

    body: bytes
    kind: str = "text/plain"
    status: int = 200


#: Answer where nothing is found.
NOT_FOUND = PageAnswer(b"no such thing\n", status=404)


class LocalPage:
    """Serves a page at 127.0.0.1 while it is open.

    The address contains a random token. A request without it is refused, and so is one for a
    different host (DNS rebinding by a web site), or of a page of another origin. Each request is
    answered in a thread of its own.

    Args:
        get: Function from the path below the token, decoded, and the query to the answer.
        post: Function from the path and the body to the answer; None refuses all bodies.
        port: Port at 127.0.0.1; 0 for any free one.

    Attributes:
        token: Token in the address.

    Raises:
        ConfigError: The port is taken or invalid.

    Example:
        >>> from urllib.request import urlopen
        >>> with LocalPage(lambda path, query: PageAnswer(f"this is {path!r}".encode())) as page:
        ...     print(urlopen(page.url + "hall").read().decode())
        this is 'hall'
    """

    def __init__(
        self,
        get: Callable[[str, Mapping[str, str]], PageAnswer],
        post: Callable[[str, bytes], PageAnswer] | None = None,
        port: int = 0,
    ) -> None:
        check_port(port)
        self.token = secrets.token_urlsafe(18)
        # http.server makes a handler for each request by itself: what it needs is in its class
        own: dict[str, Any] = {"get": staticmethod(get), "token": self.token}
        handler = type("Handler", (_Handler,), {**own, "post": post and staticmethod(post)})
        try:
            self._server = _Server((_HOST, port), handler)
        except OSError as error:
            raise ConfigError(f"port={port}: {error.strerror}; give another, or 0") from error
        self._thread = threading.Thread(target=self._server.serve_forever, name="page", daemon=True)

    @property
    def url(self) -> str:
        """Address of the page."""
        return f"http://{_HOST}:{self._server.server_address[1]}/{self.token}/"

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *error: object) -> None:
        self._server.shutdown()
        self._server.server_close()
        self._thread.join(5.0)


def check_port(port: int) -> None:
    """Checks the number of a page's port.

    Raises:
        ConfigError: The port is invalid.
    """
    if not 0 <= port <= _LAST_PORT:
        raise ConfigError(f"port={port}: give 1 to {_LAST_PORT}, or 0 for any that is free")


class _Server(ThreadingHTTPServer):
    daemon_threads = True

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Ignores errors of disconnecting browsers."""


class _Handler(BaseHTTPRequestHandler):
    get: Callable[[str, Mapping[str, str]], PageAnswer]
    post: Callable[[str, bytes], PageAnswer] | None
    token: str
    protocol_version = "HTTP/1.1"
    # head and body are two writes: with Nagle's algorithm the second would wait for an
    # acknowledgement of the first
    disable_nagle_algorithm = True
    timeout = _SILENCE

    def do_GET(self) -> None:
        """Answers a request for something."""
        if (path := self._allowed()) is not None:
            query = dict(parse_qsl(urlsplit(self.path).query))
            self._answer(self.get(path, query))

    def do_POST(self) -> None:
        """Answers a request with a body."""
        # a body that is refused is not read: the connection ends, so that it is no next request
        self.close_connection = True
        if (path := self._allowed()) is None:
            return
        length = self.headers.get("Content-Length", "")
        if self.post is None:
            self._answer(PageAnswer(b"this page takes nothing\n", status=405))
        elif not length.isdecimal() or int(length) > _LARGEST:
            self._answer(PageAnswer(b"say the length, at most 4 MiB\n", status=413))
        else:
            self._answer(self.post(path, self.rfile.read(int(length))))

    def _allowed(self) -> str | None:
        """The path below the token; None for a request refused with an answer."""
        token, _, rest = urlsplit(self.path).path.lstrip("/").partition("/")
        port = self.server.server_address[1]  # type: ignore[index]
        hosts = (f"{_HOST}:{port}", f"localhost:{port}")
        # compared in constant time, so that response times tell nothing about the token
        good = hmac.compare_digest(token.encode(), self.token.encode())
        # a browser sends the origin of the page that asks: another one has no business here
        origins = (None, *(f"http://{host}" for host in hosts))
        if good and self.headers.get("Host") in hosts and self.headers.get("Origin") in origins:
            return unquote(rest)
        said = b"give the whole address that the command printed\n"
        self._answer(PageAnswer(said, status=403))
        return None

    def _answer(self, answer: PageAnswer) -> None:
        nonce, body = "", answer.body
        if answer.kind.startswith("text/html"):
            nonce = secrets.token_urlsafe(12)
            body = body.replace(b"NONCE", nonce.encode())
        self.send_response(answer.status)
        policy = "default-src 'none'; img-src 'self' blob: data:; connect-src 'self'; "
        policy += f"style-src 'nonce-{nonce}'; script-src 'nonce-{nonce}'"
        for key, value in (
            ("Content-Type", answer.kind),
            ("Content-Length", str(len(body))),
            ("Cache-Control", "no-store"),  # an address stays, and its picture changes
            ("Content-Security-Policy", policy),
            ("Cross-Origin-Resource-Policy", "same-origin"),
            ("Referrer-Policy", "no-referrer"),
            ("X-Content-Type-Options", "nosniff"),
        ):
            self.send_header(key, value)
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, format: str, *args: Any) -> None:
        """Logs nothing, since the terminal shows the status line."""
