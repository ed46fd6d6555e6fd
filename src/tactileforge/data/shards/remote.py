"""Bytes behind a URL: no more than were stated, no waiting for ever, and retries that are said."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Iterator
from contextlib import closing
from http.client import HTTPException
from typing import Any
from urllib.error import HTTPError
from urllib.parse import urlparse
from urllib.request import Request, urlopen

#: Bytes of a read. One that takes longer than the second, in seconds, is silence.
_CHUNK, _SILENCE = 1 << 16, 30.0
#: Attempts to open a URL, and seconds before the second; then twice as many, and so on.
_ATTEMPTS, _PAUSE = 4, 0.5


def chunks(url: str, limit: int) -> Iterator[bytes]:
    """Reads a URL.

    Args:
        url: Any that webdataset opens, but no command.
        limit: Bytes that it may have; not one more is read than the first beyond.

    Raises:
        OSError: It cannot be reached, sends nothing for too long, or sends more.
    """
    left = limit
    with closing(_opened(url)) as stream:
        while chunk := _read(stream, min(_CHUNK, left + 1)):
            left -= len(chunk)
            if left < 0:
                raise OSError(f"it sends more than the {limit} bytes that are stated")
            yield chunk


def _opened(url: str) -> Any:
    for attempt in range(1, _ATTEMPTS + 1):
        try:
            return _open(url)
        except (OSError, ValueError, HTTPException) as error:
            refused = isinstance(error, HTTPError) and error.code < 500
            if refused or isinstance(error, ValueError) or attempt == _ATTEMPTS:
                raise OSError(f"{error}, attempt {attempt}") from error
            print(f"{url}: {error}; attempt {attempt + 1} of {_ATTEMPTS}", file=sys.stderr)
            time.sleep(_PAUSE * 2 ** (attempt - 1))
    raise AssertionError


def _open(url: str) -> Any:
    if urlparse(url).scheme in ("http", "https"):
        request = Request(url, headers={"User-Agent": "tactileforge"})
        return urlopen(request, timeout=_SILENCE)
    from webdataset.gopen import gopen

    return gopen(url)


def _read(stream: Any, count: int) -> bytes:
    """Bytes of a stream, whoever gives them; what is silent is left behind."""
    answer: list[bytes | BaseException] = []

    def read() -> None:
        try:
            answer.append(stream.read(count))
        except BaseException as error:
            answer.append(error)

    thread = threading.Thread(target=read, daemon=True)
    thread.start()
    thread.join(_SILENCE)
    if not answer:
        process = getattr(stream, "proc", None)
        if process is not None:
            process.kill()
        raise TimeoutError(f"it sends less than {count} bytes in {_SILENCE:g} s")
    if isinstance(answer[0], BaseException):
        raise OSError(str(answer[0]) or repr(answer[0])) from answer[0]
    return answer[0]
