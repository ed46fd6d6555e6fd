"""Reads a URL in a thread, so the caller can stop waiting for it at any time."""

from __future__ import annotations

import socket
import string
import threading
from collections.abc import Mapping
from contextlib import suppress
from email.message import Message
from functools import partial
from http.client import HTTPConnection, HTTPSConnection
from queue import Empty, Queue
from typing import Any
from urllib.error import HTTPError
from urllib.parse import quote, urljoin, urlsplit
from urllib.request import (
    HTTPHandler,
    HTTPRedirectHandler,
    HTTPSHandler,
    Request,
    build_opener,
    url2pathname,
)

#: Longest wait for one answer of a socket, s.
SILENCE = 30.0
#: Largest size of a read, bytes.
_CHUNK = 1 << 16
#: Chunks to read ahead.
_AHEAD = 16
#: Most redirects in a row, and the status codes of a redirect.
_REDIRECTS, _MOVED = 5, frozenset({301, 302, 303, 307, 308})


class Refused(OSError):
    """An error or unfollowed redirect in place of content, answered by an HTTP server.

    Args:
        error: Error raised by urllib.
    """

    def __init__(self, error: HTTPError) -> None:
        super().__init__(str(error))
        self.code = error.code
        self.headers: Message = error.headers


class _Noted:
    """A connection with a list of its sockets, for another thread to shut."""

    sock: socket.socket

    def __init__(self, *args: Any, sockets: list[socket.socket], **options: Any) -> None:
        super().__init__(*args, **options)
        self._sockets = sockets

    def connect(self) -> None:
        super().connect()  # type: ignore[misc]
        self._sockets.append(self.sock)


class _Http(_Noted, HTTPConnection):
    pass


class _Https(_Noted, HTTPSConnection):
    pass


class _OpenHttp(HTTPHandler):
    def __init__(self, sockets: list[socket.socket]) -> None:
        super().__init__()
        self.sockets = sockets

    def http_open(self, req: Request) -> Any:
        connection: Any = partial(_Http, sockets=self.sockets)
        return self.do_open(connection, req)


class _OpenHttps(HTTPSHandler):
    def __init__(self, sockets: list[socket.socket]) -> None:
        super().__init__()
        self.sockets = sockets

    def https_open(self, req: Request) -> Any:
        connection: Any = partial(_Https, sockets=self.sockets)
        return self.do_open(connection, req)


class _Redirects(HTTPRedirectHandler):
    """Follows no redirect: urllib's own handler reads the whole body of one, of any length."""

    def redirect_request(self, *given: Any) -> None:
        return None


class UrlReader:
    """Answers of a URL in order: its stated length (b"" for none), its chunks, b"" at the end.

    Args:
        url: ``http://``, ``https://``, ``file://``, or any other scheme that webdataset opens.
        limit: Largest number of bytes to read.
        headers: Headers for the server of the URL.
    """

    def __init__(self, url: str, limit: int, headers: Mapping[str, str]) -> None:
        self._url, self._limit, self._headers = url, limit, dict(headers)
        self._arrived: Queue[bytes | BaseException] = Queue(_AHEAD)
        self._unwanted = threading.Event()
        self._sockets: list[socket.socket] = []
        self._process: Any = None
        threading.Thread(target=self._read, daemon=True).start()

    def next(self, seconds: float) -> bytes | BaseException | None:
        """The next answer, or the error at the end of the reading; None after ``seconds``."""
        with suppress(Empty):
            return self._arrived.get(timeout=seconds)
        return None

    def leave(self) -> None:
        """Ends the reading, by shutting sockets or killing the program behind the URL.

        The stream is never closed here, because closing it would wait for the thread.
        """
        self._unwanted.set()
        for sock in list(self._sockets):
            with suppress(OSError):
                sock.shutdown(socket.SHUT_RDWR)
        if self._process is not None and self._process.poll() is None:
            self._process.kill()
        with suppress(Empty):  # the thread's last puts would block on a full queue
            while True:
                self._arrived.get_nowait()

    def _read(self) -> None:
        stream = None
        try:
            stream = self._open()
            self._process = getattr(stream, "proc", None)
            length = str(getattr(stream, "headers", {}).get("Content-Length") or "").strip()
            # int() would also take digits of other scripts, signs, and any number of digits
            is_number = length.isascii() and length.isdigit() and len(length) < 20
            self._arrived.put(length.encode() if is_number else b"")
            # read1 returns what has arrived; read would wait for a whole chunk
            read = getattr(stream, "read1", stream.read)
            left = self._limit
            while left and not self._unwanted.is_set():
                chunk = read(min(_CHUNK, left))
                if not chunk:
                    break
                left -= len(chunk)
                self._arrived.put(chunk)
            stream.close()  # raises if a program was started and has failed
            self._arrived.put(b"")
        except BaseException as error:
            self._arrived.put(error)
        finally:
            with suppress(Exception):
                if stream is not None:
                    stream.close()

    def _open(self) -> Any:
        parts = urlsplit(self._url)
        if parts.scheme in ("http", "https"):
            return self._open_http(self._url)
        if parts.scheme == "file":
            return open(url2pathname(parts.path), "rb")
        from webdataset.gopen import gopen

        return gopen(self._url)

    def _open_http(self, url: str) -> Any:
        opener = build_opener(_OpenHttp(self._sockets), _OpenHttps(self._sockets), _Redirects())
        headers = {"User-Agent": "tactileforge"} | self._headers
        for _ in range(_REDIRECTS + 1):
            if not urlsplit(url).hostname:
                raise ValueError(f"{url[:200]!r} names no server")
            try:
                return opener.open(Request(url, headers=headers), timeout=SILENCE)
            except HTTPError as error:
                place = error.headers.get("Location")
                error.close()
                if error.code not in _MOVED or not place:
                    raise Refused(error) from None
            # http.client decodes headers as ISO 8859-1: so encoded, these are the bytes that came
            there = urljoin(url, quote(place, safe=string.punctuation, encoding="iso-8859-1"))
            # never from https to http: what was asked for by https is not sent in the open
            if urlsplit(there).scheme not in {"https", urlsplit(url).scheme}:
                raise ValueError(f"it sends to {there[:200]!r}, and only https is followed")
            if urlsplit(there)[:2] != urlsplit(url)[:2]:
                headers = {"User-Agent": "tactileforge"}
            url = there
        raise ValueError(f"it sends to another place more than {_REDIRECTS} times")
