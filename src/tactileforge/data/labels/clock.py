"""Comparison of two clocks: the times of labels, and those of their frames."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from decimal import Decimal, InvalidOperation

import numpy as np
from numpy.typing import NDArray

from tactileforge.errors import ConfigError, DataError, unknown

#: Units of time, and their seconds.
UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
#: Years 2001 to 2103 in seconds since 1970: a number of that size is a date, in the unit that
#: makes it one.
_DATES = 1e9, 4.2e9
_NAMES = {"s": "seconds", "ms": "milliseconds", "us": "microseconds", "ns": "nanoseconds"}
#: Ratio of the steps of labels and frames above which the labels are in another unit, or useless.
_SPARSE = 5.0
#: Largest plausible seconds between labels.
_SLOW = 0.5
#: Largest ratio of the durations of labels and frames for a unit to be told.
_AS_LONG = 2.5
#: Usual ratios of durations for a wrong rate (60: minutes for seconds), and their tolerance.
_RATES = (2, 3, 4, 5, 10, 60)
_CLOSE = 0.04
#: Shares of the recording: labels of its length that start later than the first are shifted; up to
#: the second, two recorders were started by hand.
_SHIFT = 0.3
_START = 0.1
#: Ratio of durations below which labels are in another unit.
_SHORT = 0.05
#: Relative difference of steps, with as many rows as frames, from which the rate is another one.
_STEP = 0.15
#: Ratio of durations from which sparse rows are numbers, not seconds.
_LONG = 5.0
#: Ratios of the usual rates of videos (24, 25, 30), and their tolerance.
_VIDEO_RATES, _NEAR = (24 / 30, 25 / 30, 30 / 25, 30 / 24), 0.01
#: Share of labelled frames below which a warning is due.
_HALF = 0.5
#: Smallest number of frames and rows to compare rates and durations.
_LEAST = 4


#: A date with the time of day, with a zone or none, and the time of day itself.
_STAMP = re.compile(
    r"(\d{4}-\d\d-\d\d|\d{4}/\d\d/\d\d)[T _](\d\d:\d\d:\d\d)([.,]\d+)?\s?(Z|[+-]\d\d:?\d\d)?"
)
_OF_DAY = re.compile(r"(\d{1,2}):(\d\d):(\d\d)([.,]\d+)?(?:\s?([ap])\.?m\.?)?", re.IGNORECASE)
#: A date of a spreadsheet or a program of another country, before the time of day.
_WRITTEN = re.compile(r"(\d{1,2})([/.-])(\d{1,2})\2(\d{4})[ T,_]+(\d{1,2}:.*)")
_DAY = 86_400


def clock_number(cell: str) -> Decimal:
    """The number in a cell of times; of a date or time of day, its seconds.

    Dates without a zone are taken for UTC: only differences matter.

    Args:
        cell: A number, ``2024-10-27T23:59:59.5`` (seconds since 1970), or ``23:59:59.5``; also
            ``27.10.2024 23:59:59`` and ``10/27/2024 11:59:59.5 PM``.

    Raises:
        ValueError: It is none of these, or not finite; or its day and its month may be exchanged.

    Example:
        >>> clock_number("1.5e3"), clock_number("2001-09-09 01:46:40.25"), clock_number("0:01:02")
        (Decimal('1.5E+3'), Decimal('1000000000.25'), Decimal('62.0'))
    """
    if match := _STAMP.fullmatch(cell):
        text = f"{match[1].replace('/', '-')}T{match[2]}{match[4] or '+00:00'}"
        whole = int(datetime.fromisoformat(text).astimezone(UTC).timestamp())
        return whole + Decimal((match[3] or ".0").replace(",", "."))
    if match := _OF_DAY.fullmatch(cell):
        hours, minutes, seconds = (int(match[i]) for i in (1, 2, 3))
        part = Decimal((match[4] or ".0").replace(",", "."))
        if match[5]:
            hours = hours % 12 + 12 * (match[5].lower() == "p")
        return 3600 * hours + 60 * minutes + seconds + part
    if (match := _WRITTEN.fullmatch(cell)) and _OF_DAY.fullmatch(match[5]):
        return _midnight(match) + clock_number(match[5])
    try:
        value = Decimal(cell)
    except InvalidOperation:
        raise ValueError(f"{cell!r} is no number, date or time of day") from None
    if not value.is_finite():
        raise ValueError(f"{cell!r} is not finite")
    return value


def _midnight(date: re.Match[str]) -> int:
    """Seconds since 1970 at the start of a day, its month first before a.m. and p.m."""
    first, second = int(date[1]), int(date[3])
    is_american = date[2] != "." and date[5][-1] in "mM."
    if date[2] != "." and not is_american and max(first, second) <= 12 and first != second:
        raise ValueError(f"{date[0]!r}: {first} or {second} may be the month; write year-month-day")
    day, month = (
        (second, first) if second > 12 or (is_american and first <= 12) else (first, second)
    )
    return int(datetime(int(date[4]), month, day, tzinfo=UTC).timestamp())


def after_midnight(before: Decimal, now: Decimal, cell: str) -> Decimal:
    """A time of day in the days of the one before it; other times as they are.

    Args:
        before: The time before, which may be of a later day.
        now: The number of ``cell``.
        cell: The cell.

    Example:
        >>> after_midnight(Decimal(86399), Decimal(1), "0:00:01")
        Decimal('86401')
    """
    if not _OF_DAY.fullmatch(cell):
        return now
    days = before // _DAY
    now += days * _DAY
    return now + _DAY if before - now > _DAY // 2 else now


@dataclass(frozen=True)
class Misfit:
    """A contradiction between the times of labels and those of frames.

    Attributes:
        words: Problem, as words to follow the name of the column.
        fix: Fix, as a phrase.
        unit: Fitting unit; "" if another unit would not help.
        plain: Whether that unit alone is the fix.
        certain: Whether labels would be wrong; false for labels that are only few.
        doubtful: Whether the times may be right all the same; ``partial`` of `misfit` says so.
    """

    words: str
    fix: str
    unit: str = ""
    plain: bool = False
    certain: bool = True
    doubtful: bool = False


def date_unit(values: NDArray[np.float64]) -> str:
    """Unit of time of values since 1970; "" for none.

    Example:
        >>> date_unit(np.array([1.7e12, 1.8e12])), date_unit(np.array([0.0, 2.0]))
        ('ms', '')
    """
    # units are a factor of 1000 apart and dates of one of 4.2, so a number fits one unit at most
    for unit, seconds in UNITS.items():
        low, high = (date / seconds for date in _DATES)
        if len(values) and values.min() >= low and values.max() < high:
            return unit
    return ""


def seconds_since(values: Sequence[Decimal], zero: Decimal, unit: str = "s") -> NDArray[np.float64]:
    """Seconds of times since a zero, exact: a float cannot hold a date in nanoseconds.

    Args:
        values: Times in their unit.
        zero: Zero, in seconds.
        unit: Unit of the times.

    Example:
        >>> seconds_since([Decimal("1763000000000000005")], Decimal(1763000000), "ns").tolist()
        [5e-09]
    """
    scale = Decimal(str(UNITS[unit]))
    return np.array([float(value * scale - zero) for value in values], np.float64)


def seconds_of(unit: str, where: str) -> float:
    """Seconds of a unit of time.

    Raises:
        ConfigError: Unknown unit.
    """
    if unit not in UNITS:
        raise ConfigError(f"{where}: {unknown('unit', unit, UNITS)}")
    return UNITS[unit]


def check_rising(
    times: NDArray[np.float64], where: str, fix: str, row: str = "frame", shown: str = "{:g} s"
) -> None:
    """Check times for strict increase.

    Args:
        times: float64 (T,).
        where: Place of the times, for the message.
        fix: Fix, as a phrase.
        row: Word for what has a time.
        shown: Format of a time in the message.

    Raises:
        DataError: A time is not after the one before.

    Example:
        >>> check_rising(np.array([0.0, 0.5]), "take 1", "correct it")
        >>> check_rising(np.array([0.0, 0.5, 0.5]), "take 1", "correct it")
        Traceback (most recent call last):
        tactileforge.errors.DataError: take 1: the time of frame 2, 0.5 s, is not after ...
    """
    wrong = np.flatnonzero(~(np.diff(times) > 0))
    if len(wrong):
        i = int(wrong[0]) + 1
        raise DataError(
            f"{where}: the time of {row} {i}, {shown.format(times[i])}, is not after that of the "
            f"{row} before, {shown.format(times[i - 1])}; {fix}"
        )


def misfit(
    rows: NDArray[np.float64], frames: NDArray[np.float64], partial: bool = False
) -> Misfit | None:
    """Find a contradiction between the times of labels and frames; None without one.

    Labels may start late, end early, go on after the last frame, and have a rate of their own. They
    may not be in another unit, begin at another zero, or last twice or half as long from the same
    start, as with a wrong rate.

    Args:
        rows: Times of labels, float64 (n,), ascending; presumably seconds.
        frames: Times of frames, float64 (T,), seconds, ascending.
        partial: Whether labels are known to last longer or shorter than the frames.

    Example:
        >>> misfit(np.arange(0, 2240.0, 10), np.arange(68) / 30).words
        'ends at 2230, the recording at 2.23 s: is it milliseconds?'
    """
    if not len(rows) or not len(frames):
        return None
    # the unit first: in a wrong one, zero and rate look wrong as well
    found = _unit(rows, frames) or _apart(rows, frames)
    if found is None and not partial:
        found = _number_of_rows(rows, frames) or _rate(rows, frames) or _few(rows, frames)
    return found


def _unit(rows: NDArray[np.float64], frames: NDArray[np.float64]) -> Misfit | None:
    """Labels in another unit, or numbers of frames: too sparse for seconds."""
    span = float(frames[-1] - frames[0])
    if len(rows) < 2 or len(frames) < 2 or span <= 0:
        return None
    step, length = float(np.median(np.diff(rows))), float(rows[-1] - rows[0])
    period = float(np.median(np.diff(frames)))
    if step <= _SPARSE * period:
        return None
    inside = int(((rows >= frames[0]) & (rows <= frames[-1])).sum())
    is_lost = len(rows) > _LEAST and inside < 2 and step > _SLOW
    if step == 1 and rows[0] in (0, 1) and abs(len(rows) - len(frames)) <= 1:
        return Misfit(
            f"{_ends(rows, frames)}: is it the number of the frame?",
            "give frame: in place of time:",
        )
    for unit, seconds in UNITS.items():
        as_long = 1 / _AS_LONG <= length * seconds / span <= _AS_LONG
        if unit == "s" or not (as_long or (is_lost and step * seconds <= _SLOW)):
            continue
        question, plain = f"is it {_NAMES[unit]}", False
        if date_unit(rows) == unit:
            question += " since 1970"
        elif not frames[0] - span <= rows[0] * seconds <= frames[-1]:
            question += " of another zero"
        else:
            plain = True
        words = f"{_ends(rows, frames)}: {question}?"
        return Misfit(words, "give seconds since the first frame", unit, plain)
    return None


def _number_of_rows(rows: NDArray[np.float64], frames: NDArray[np.float64]) -> Misfit | None:
    """Labels by number, or in an unknown unit: sparse, and much longer than the frames."""
    span, length = float(frames[-1] - frames[0]), float(rows[-1] - rows[0])
    if min(len(rows), len(frames)) <= _LEAST or length <= _LONG * span:
        return None
    if float(np.median(np.diff(rows))) <= _SPARSE * float(np.median(np.diff(frames))):
        return None
    is_counted = bool((np.diff(rows) == 1).all())
    what = "the number of the row" if is_counted else "another unit"
    rate = (len(rows) - 1) / span
    return Misfit(
        f"{_ends(rows, frames)}: is it {what}?",
        f"give seconds since the first frame ({rate:.3g} rows a second would fit)",
        doubtful=True,
    )


def _apart(rows: NDArray[np.float64], frames: NDArray[np.float64]) -> Misfit | None:
    """Labels without overlap: they count from another zero."""
    if len(frames) < 2 and not date_unit(rows):
        return None  # a still: any row may be its label
    if rows[-1] >= frames[0] and rows[0] <= frames[-1]:
        return None
    return Misfit(
        f"goes from {_number(rows[0])} to {_number(rows[-1])} and does not overlap the times of "
        f"the frames ({frames[0]:.3g} to {frames[-1]:.3g} s)",
        "give seconds since the first frame",
    )


def _rate(rows: NDArray[np.float64], frames: NDArray[np.float64]) -> Misfit | None:
    """Labels of another duration, or shifted ones."""
    span, length = float(frames[-1] - frames[0]), float(rows[-1] - rows[0])
    if len(frames) < _LEAST or len(rows) < _LEAST or span <= 0 or length <= 0:
        return None
    late = float(rows[0] - frames[0])
    spans = _spans(rows, frames)
    if abs(late) <= _START * span:
        times = _times(length / span)
        if length < _SHORT * span:
            times = f"{length / span:.2g} times"
        steps = float(np.median(np.diff(rows)) / np.median(np.diff(frames)))
        is_slow = min(abs(steps - 1), abs(length / span - 1)) > _STEP
        if abs(len(rows) - len(frames)) <= 1 and is_slow:
            times = f"{steps:.3g} times"
        if times:
            rate = (len(rows) - 1) / span
            fps = len(frames) / (length + float(np.median(np.diff(rows))))
            return Misfit(
                f"{spans}, {times} as long: is the rate or unit another one?",
                f"{rate:.3g} rows a second would fit, or fps: {fps:.3g}",
                doubtful=True,
            )
    elif abs(length / span - 1) <= _START and abs(late) > _SHIFT * span:
        way = "late" if late > 0 else "early"
        return Misfit(
            f"{spans}, as long but {abs(late):.3g} s {way}: is it another zero?",
            "give seconds since the first frame",
            doubtful=True,
        )
    return None


def _few(rows: NDArray[np.float64], frames: NDArray[np.float64]) -> Misfit | None:
    """Labels of less than half of the frames, or as long as at another usual rate of videos."""
    if len(frames) < _LEAST:
        return None
    spans = _spans(rows, frames)
    share = float(((frames >= rows[0]) & (frames <= rows[-1])).mean())
    if share < _HALF:
        return Misfit(
            f"{spans}: only {100 * share:.0f} % of them get a label",
            "see whether both clocks start at the first frame",
            certain=False,
        )
    span, length = float(frames[-1] - frames[0]), float(rows[-1] - rows[0])
    is_together = span > 0 and abs(rows[0] - frames[0]) <= _NEAR * span
    for ratio in _VIDEO_RATES:
        if is_together and len(rows) >= _LEAST and abs(length / span / ratio - 1) <= _NEAR:
            return Misfit(
                f"{spans}, {length / span:.2g} times as long: are 25 frames a second taken for 30, "
                "or the like?",
                "see whether both clocks run at the same rate",
                certain=False,
            )
    return None


def _times(ratio: float) -> str:
    for times in _RATES:
        if abs(ratio / times - 1) <= _CLOSE:
            return f"{times} times"
        if abs(ratio * times - 1) <= _CLOSE:
            return "half" if times == 2 else f"1/{times}"
    return ""


def _ends(rows: NDArray[np.float64], frames: NDArray[np.float64]) -> str:
    return f"ends at {_number(rows[-1])}, the recording at {frames[-1]:.3g} s"


def _spans(rows: NDArray[np.float64], frames: NDArray[np.float64]) -> str:
    ours = f"goes from {_number(rows[0])} to {_number(rows[-1])}"
    return f"{ours}, the frames from {frames[0]:.3g} to {frames[-1]:.3g} s"


def _number(value: float) -> str:
    """Format a time as it stands in the file."""
    return f"{value:.10g}" if abs(value) >= 1e6 else f"{value:.4g}"
