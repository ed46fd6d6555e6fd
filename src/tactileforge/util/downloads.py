"""Downloads within stated limits of size and time, with retries shown to the user."""

from __future__ import annotations

import re
import sys
import time
from collections.abc import Callable, Generator, Mapping
from contextlib import closing
from datetime import UTC, datetime
from email.message import Message
from email.utils import parsedate_to_datetime
from http.client import InvalidURL
from typing import BinaryIO

from tactileforge.util.url_reader import SILENCE, Refused, UrlReader

#: Bytes required in `SILENCE` seconds of waiting: 2 kB/s, slower than any working link.
_LEAST = 1 << 16
#: Average rate, bytes per second, for the time limit of a download, and the seconds added to it.
_RATE, _START = 16_384, 600.0
#: Number of attempts, and seconds before the second; each further pause is twice as long.
_ATTEMPTS, _PAUSE = 4, 0.5
#: Longest pause between two attempts that a server may ask for, s.
_LONGEST = 60.0
#: Status codes below 500 after which another attempt may succeed: timeout, too early, too many
#: requests.
_BUSY = frozenset({408, 425, 429})
_sleep = time.sleep
_now = time.monotonic


class _Final(OSError):
    """Another attempt would fail in the same way."""


class Dropped(OSError):
    """The connection ended before the last byte, or the server is busy.

    Attributes:
        pause: Pause that the server asks for, s; None without one.
    """

    pause: float | None = None


class TooMuch(OSError):
    """A body of more bytes than stated."""


class _Pace:
    """Time left to a download. Waiting for bytes counts; writing them does not.

    Args:
        seconds: Total time, s.
    """

    def __init__(self, seconds: float) -> None:
        self.left = seconds
        self.opens()

    def opens(self) -> None:
        """Starts the time limit of the server's first answer."""
        self.window, self.needed = 2 * SILENCE, 0

    def sends(self) -> None:
        """Starts the time limit of the next `_LEAST` bytes."""
        self.window, self.needed = SILENCE, _LEAST

    def waits(self) -> float:
        """Time left for the next bytes, s."""
        return max(0.0, min(self.left, self.window))

    def took(self, seconds: float, count: int) -> None:
        """Counts bytes, and the seconds of waiting for them."""
        self.left -= seconds
        self.window -= seconds
        self.needed -= count
        if self.needed <= 0:
            self.sends()

    def error(self) -> TimeoutError:
        """Error with the exceeded limit."""
        if self.left <= self.window:
            return TimeoutError("it takes longer than its size allows")
        if not self.needed:
            return TimeoutError(f"it does not answer in {2 * SILENCE:g} s")
        return TimeoutError(f"it sends less than {_LEAST} bytes in {SILENCE:g} s")


def copy(
    url: str,
    limit: int,
    out: BinaryIO,
    whole: Callable[[], bool] = lambda: True,
    *,
    seconds: float | None = None,
    headers: Mapping[str, str] | None = None,
    moved: Callable[[int], object] = lambda count: None,
) -> None:
    """Copies a URL to a file, and starts again from the first byte after a dropped connection.

    Args:
        url: URL of any scheme that webdataset opens, but no command.
        limit: Largest number of bytes; at most one byte more is read.
        out: File to write; it is emptied first.
        whole: Function that tells whether all bytes came, for a server that states no length. A
            body that is still short after the last attempt is left to the caller to judge.
        seconds: Total time, s; None for the time of ``limit`` bytes on a slow link.
        headers: Headers for the server of the URL; servers it redirects to do not get them.
        moved: Function to call with the number of bytes written so far.

    Raises:
        TooMuch: The server sends more than ``limit`` bytes.
        TimeoutError: The server sends nothing, or too little, for too long.
        OSError: The server cannot be reached, or the connection dropped too often.
    """
    pace = _Pace(_START + limit / _RATE if seconds is None else seconds)
    for attempt in range(1, _ATTEMPTS + 1):
        out.seek(0)
        out.truncate()
        try:
            with closing(_chunks(url, limit, headers or {}, pace)) as chunks:
                stated, count = next(chunks), 0
                for chunk in chunks:
                    out.write(chunk)
                    count += len(chunk)
                    moved(count)
            # without a stated length a connection that ends early looks like the end of the body
            if stated or whole() or attempt == _ATTEMPTS:
                return
            raise Dropped(f"the connection ended after {count} bytes, and not all came")
        except Dropped as error:
            if attempt == _ATTEMPTS:
                raise OSError(f"{error}, attempt {attempt}") from error
            _wait(url, error, attempt, pace)
        except _Final as error:
            raise OSError(f"{error}, attempt {attempt}") from error


def _chunks(
    url: str, limit: int, headers: Mapping[str, str], pace: _Pace
) -> Generator[bytes, None, None]:
    """Yields the stated length, b"" for none, and then the body in chunks."""
    left = limit
    # one byte more than stated, to notice a longer body
    link = UrlReader(url, limit + 1, headers)
    pace.opens()
    try:
        stated = _next(link, pace)
        yield stated
        while chunk := _next(link, pace):
            left -= len(chunk)
            if left < 0:
                raise TooMuch(f"it sends more than the {limit} bytes that are stated")
            yield chunk
    finally:
        link.leave()
    # http.client returns the part of a body that was cut off, without an error
    if stated and limit - left < int(stated):
        raise Dropped(f"the connection ended after {limit - left} of {int(stated)} bytes")


def _next(link: UrlReader, pace: _Pace) -> bytes:
    """The next answer of a link, as soon as it comes."""
    start = _now()
    answer = link.next(pace.waits())
    if answer is None:
        raise pace.error()
    if isinstance(answer, BaseException):
        raise _named(answer) from answer
    pace.took(_now() - start, len(answer))
    return answer


def _named(error: BaseException) -> OSError:
    """The error to raise: `Dropped` if another attempt may succeed."""
    text = str(error) or repr(error)
    if not isinstance(error, Refused):
        final = isinstance(error, ValueError | InvalidURL | FileNotFoundError | PermissionError)
        return _Final(text) if final else Dropped(text)
    if error.code < 500 and error.code not in _BUSY:
        return _Final(text)
    dropped = Dropped(text)
    dropped.pause = retry_after(error.headers)
    return dropped


def _wait(url: str, error: Dropped, attempt: int, pace: _Pace) -> None:
    """Prints the reason for another attempt, and waits for it.

    Raises:
        OSError: The time left is shorter than the pause.
    """
    pause = _PAUSE * 2 ** (attempt - 1)
    if error.pause is not None:
        pause = max(pause, min(error.pause, _LONGEST))
    if pause >= pace.left:
        raise OSError(f"{error}, attempt {attempt}, and no time for another") from error
    asked = f", {pause:g} s from now" if error.pause else ""
    print(f"{url}: {error}; attempt {attempt + 1} of {_ATTEMPTS}{asked}", file=sys.stderr)
    _sleep(pause)
    pace.left -= pause


def retry_after(headers: Message) -> float | None:
    """Pause asked for by a server, s, from a number or a date; None without a usable one.

    A date is compared with the server's own clock, where it states one.

    Example:
        >>> headers = Message()
        >>> headers["Date"] = "Thu, 01 Jan 2026 10:00:00 GMT"
        >>> headers["Retry-After"] = "Thu, 01 Jan 2026 10:00:07 GMT"
        >>> retry_after(headers)
        7.0
    """
    text = str(headers.get("Retry-After", "")).strip()
    if re.fullmatch(r"[0-9]{1,300}", text):
        return float(text)
    until = _date(text)
    if until is None:
        return None
    now = _date(str(headers.get("Date", ""))) or datetime.now(UTC)
    return max(0.0, (until - now).total_seconds())


def _date(text: str) -> datetime | None:
    try:
        date = parsedate_to_datetime(text)
    except (ValueError, TypeError, IndexError, OverflowError):
        return None
    return date if date.tzinfo else date.replace(tzinfo=UTC)
