"""Bytes behind a URL: no more than were stated, no waiting for ever, and retries that are said."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Generator, Iterator
from contextlib import closing, suppress
from http.client import HTTPException
from queue import Empty, Queue
from typing import Any, BinaryIO
from urllib.error import HTTPError
from urllib.parse import urlparse
from urllib.request import Request, urlopen

#: Bytes of a read. One that takes longer than the second, in seconds, is silence.
_CHUNK, _SILENCE = 1 << 16, 30.0
#: Chunks that are read before they are asked for.
_AHEAD = 16
#: Attempts to open a URL, and seconds before the second; then twice as many, and so on.
_ATTEMPTS, _PAUSE = 4, 0.5


class Dropped(OSError):
    """A connection ended before all bytes were sent."""


def copy(url: str, limit: int, out: BinaryIO) -> None:
    """Copies a URL to a file; where the connection drops, from the start again.

    Args:
        url: As for `chunks`.
        limit: Likewise.
        out: It is emptied first.

    Raises:
        OSError: See `chunks`; or the connection dropped too often.
    """
    for attempt in range(1, _ATTEMPTS + 1):
        out.seek(0)
        out.truncate()
        try:
            for chunk in chunks(url, limit):
                out.write(chunk)
            return
        except Dropped as error:
            if attempt == _ATTEMPTS:
                raise OSError(f"{error}, attempt {attempt}") from error
            _wait(url, error, attempt)


def chunks(url: str, limit: int) -> Iterator[bytes]:
    """Reads a URL.

    Args:
        url: Any that webdataset opens, but no command.
        limit: Bytes that it may have; not one more is read than the first beyond.

    Raises:
        OSError: It cannot be reached, sends nothing for too long, or sends more.
        Dropped: The connection ended early.
    """
    left = limit
    with closing(_opened(url)) as stream, closing(_read_ahead(stream, limit + 1)) as arrived:
        for chunk in arrived:
            left -= len(chunk)
            if left < 0:
                raise OSError(f"it sends more than the {limit} bytes that are stated")
            yield chunk
        # of a body that is cut off, http.client gives what there is
        promised = getattr(stream, "headers", {}).get("Content-Length")
        if promised is not None and limit - left < int(promised):
            raise Dropped(f"the connection ended after {limit - left} of {promised} bytes")


def _opened(url: str) -> Any:
    for attempt in range(1, _ATTEMPTS + 1):
        try:
            return _open(url)
        except (OSError, ValueError, HTTPException) as error:
            refused = isinstance(error, HTTPError) and error.code < 500
            if refused or isinstance(error, ValueError) or attempt == _ATTEMPTS:
                raise OSError(f"{error}, attempt {attempt}") from error
            _wait(url, error, attempt)
    raise AssertionError


def _wait(url: str, error: Exception, attempt: int) -> None:
    """Says why there is another attempt, and waits for it."""
    print(f"{url}: {error}; attempt {attempt + 1} of {_ATTEMPTS}", file=sys.stderr)
    time.sleep(_PAUSE * 2 ** (attempt - 1))


def _open(url: str) -> Any:
    if urlparse(url).scheme in ("http", "https"):
        request = Request(url, headers={"User-Agent": "tactileforge"})
        return urlopen(request, timeout=_SILENCE)
    from webdataset.gopen import gopen

    return gopen(url)


def _read_ahead(stream: Any, limit: int) -> Generator[bytes, None, None]:
    """Chunks of a stream, whoever gives them; what is silent is left behind.

    A thread reads: not every stream has a timeout of its own.
    """
    arrived: Queue[bytes | BaseException] = Queue(_AHEAD)
    unwanted = threading.Event()

    def read() -> None:
        left = limit
        try:
            while left and not unwanted.is_set():
                chunk = stream.read(min(_CHUNK, left))
                left -= len(chunk)
                arrived.put(chunk)
                if not chunk:
                    return
            arrived.put(b"")
        except BaseException as error:
            arrived.put(error)

    threading.Thread(target=read, daemon=True).start()
    try:
        while chunk := _next(arrived, stream):
            yield chunk
    finally:
        unwanted.set()
        with suppress(Empty):  # makes room for what the thread has still to put
            while True:
                arrived.get_nowait()


def _next(arrived: Queue[bytes | BaseException], stream: Any) -> bytes:
    try:
        answer = arrived.get(timeout=_SILENCE)
    except Empty:
        process = getattr(stream, "proc", None)
        if process is not None:
            process.kill()
        raise TimeoutError(f"it sends less than {_CHUNK} bytes in {_SILENCE:g} s") from None
    if isinstance(answer, BaseException):
        raise Dropped(str(answer) or repr(answer)) from answer
    return answer
