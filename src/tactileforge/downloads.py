"""Bytes behind a URL: no more than were stated, no waiting for ever, and retries that are said."""

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

from tactileforge.links import SILENCE, Link, Refused

#: Bytes that are needed in `SILENCE` seconds of waiting: 2 kB/s, less than any link has.
_LEAST = 1 << 16
#: Bytes a second on the whole, and the seconds before that counts.
_RATE, _START = 16_384, 600.0
#: Attempts, and seconds before the second; then twice as many, and so on.
_ATTEMPTS, _PAUSE = 4, 0.5
#: Seconds that a server may ask for between two attempts.
_LONGEST = 60.0
#: Answers after which another attempt may go well.
_BUSY = frozenset({408, 425, 429})
_sleep = time.sleep
_now = time.monotonic


class Dropped(OSError):
    """A connection that ended before all bytes were sent, or a server that is busy.

    Attributes:
        pause: Seconds that the server asks for; None where it does not.
    """

    pause: float | None = None


class TooMuch(OSError):
    """A body of more bytes than were stated."""


class _Pace:
    """Time that a download has left. Waiting for bytes counts; writing them does not.

    Args:
        seconds: Time in all.
    """

    def __init__(self, seconds: float) -> None:
        self.left = seconds
        self.opens()

    def opens(self) -> None:
        """Starts the time in which a server has to answer."""
        self.window, self.needed = 2 * SILENCE, 0

    def sends(self) -> None:
        """Starts the time in which the next `_LEAST` bytes have to come."""
        self.window, self.needed = SILENCE, _LEAST

    def waits(self) -> float:
        """Seconds that the next bytes may take."""
        return max(0.0, min(self.left, self.window))

    def took(self, seconds: float, count: int) -> None:
        """Counts bytes, and the seconds for which they were waited for."""
        self.left -= seconds
        self.window -= seconds
        self.needed -= count
        if self.needed <= 0:
            self.sends()

    def error(self) -> TimeoutError:
        """Says what took too long."""
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
    """Copies a URL to a file; where the connection drops, from the start again.

    Args:
        url: Any that webdataset opens, but no command.
        limit: Bytes that it may have; not one more is read than the first beyond.
        out: It is emptied first.
        whole: Whether all came, where the server states no length. What is short time after time
            is left to the caller to judge.
        seconds: Time in all; None for what ``limit`` bytes take on a slow link.
        headers: Headers for the server of the URL; those it sends on to do not get them.
        moved: Is told the bytes that are written so far.

    Raises:
        TooMuch: It sends more than ``limit`` bytes.
        TimeoutError: It sends nothing, or too little, for too long.
        OSError: It cannot be reached, or the connection dropped too often.
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
            if stated or whole() or attempt == _ATTEMPTS:
                return
            raise Dropped(f"the connection ended after {count} bytes, and not all came")
        except Dropped as error:
            if attempt == _ATTEMPTS:
                raise OSError(f"{error}, attempt {attempt}") from error
            _wait(url, error, attempt, pace)


def _chunks(
    url: str, limit: int, headers: Mapping[str, str], pace: _Pace
) -> Generator[bytes, None, None]:
    """Yields the length that is stated, b"" for none; then the body, whoever sends it."""
    left = limit
    link = Link(url, limit + 1, headers)
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
    # of a body that is cut off, http.client gives what there is
    if stated and limit - left < int(stated):
        raise Dropped(f"the connection ended after {limit - left} of {int(stated)} bytes")


def _next(link: Link, pace: _Pace) -> bytes:
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
    """The error to raise: `Dropped` where another attempt may go well."""
    text = str(error) or repr(error)
    if not isinstance(error, Refused):
        final = isinstance(error, ValueError | InvalidURL | FileNotFoundError | PermissionError)
        return OSError(f"{text}, attempt 1") if final else Dropped(text)
    if error.code < 500 and error.code not in _BUSY:
        return OSError(f"{text}, attempt 1")
    dropped = Dropped(text)
    dropped.pause = retry_after(error.headers)
    return dropped


def _wait(url: str, error: Dropped, attempt: int, pace: _Pace) -> None:
    """Says why there is another attempt, and waits for it."""
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
    """Seconds that a server asks for, as a number or a date; None where it says nothing usable.

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
