"""Times of images from their names: stamps, dates, seconds, and counters with gaps.

Numbers are compared as whole nanoseconds: a float cannot hold a stamp of 19 digits.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from decimal import Decimal
from itertools import pairwise
from math import gcd

import numpy as np
from numpy.typing import NDArray

from tactileforge.data.frames.video_clock import FASTEST_RATE
from tactileforge.data.labels.clock import UNITS, date_unit

_NUMBER = re.compile(r"\d+(?:\.\d+)?")
#: A date of this century with its time of day, and a part of a second: digits behind a mark, or
#: three, six or nine of them at once.
_DATE = re.compile(
    r"(20\d\d)[-_.]?([01]\d)[-_.]?([0-3]\d)[-_T ]{0,2}"
    r"([0-2]\d)[-_.h:]?([0-5]\d)[-_.m:]?([0-5]\d)"
    r"(?:[-_.,s](\d{1,9})(?!\d)|(\d{9}|\d{6}|\d{3})(?!\d))?"
)
#: A time of day with a part of a second, in names without a date of the year first.
_DAYTIME = re.compile(
    r"(?<!\d)([01]?\d|2[0-3])[-_.h:]([0-5]\d)[-_.m:]([0-5]\d)[-_.,s:](\d{3,9})(?!\d)"
)
#: A number with the unit of a time.
_UNITED = re.compile(r"(?<![\d.])(\d+(?:\.\d+)?)[ _]?([mun]?s)(?![^\W_])")
#: Seconds since 1970 and what stands behind the point.
_POINT = re.compile(r"(?<!\d)(\d{10})\.(\d{1,9})(?!\d)")
#: Whole nanoseconds of a unit; see the top of this file.
_NS = {unit: round(seconds * 1e9) for unit, seconds in UNITS.items()}
#: Largest relative deviation of the step of stamps without a unit from that of the frame rate.
_CLOSE = 0.3
#: Ratio of the rate of dated names to fps from which the two contradict each other.
_APART = 1.5
#: Plausible range of a tactile camera's frames per second.
_RATES = 1.0, FASTEST_RATE
#: Largest median step of a frame counter; below it, gaps count as dropped frames.
_DROPPED = 10
#: Nanoseconds of a day.
_DAY = 24 * 3600 * 10**9


@dataclass(frozen=True)
class NameTimes:
    """Times found in names.

    Attributes:
        times: float64 (T,), seconds since the first image; None for names without times.
        start: Time of the first image, seconds since 1970; None for names without dates.
        doubt: Description of an ambiguity, as a phrase; "" without one.
    """

    times: NDArray[np.float64] | None = None
    start: Decimal | None = None
    doubt: str = ""


def name_times(stems: Sequence[str], fps: float | None, unit: str | None = None) -> NameTimes:
    """Reads times from the names of the images of a sequence.

    Args:
        stems: Names without their endings, oldest first.
        fps: Frames per second, for interpreting the numbers; None if unknown.
        unit: Unit of the numbers; None to detect it.

    Example:
        >>> name_times(["f_00005", "f_00006", "f_00036"], 30.0).times.round(3).tolist()
        [0.0, 0.033, 1.033]
        >>> name_times(["1763000000000000000", "1763000000033000000"], None).times.tolist()
        [0.0, 0.033]
    """
    if len(stems) < 2:
        return NameTimes(np.zeros(len(stems)))
    dates = _dates(stems)
    if dates is not None and unit is None and not _is_counter(dates):
        return _dated(dates, fps)
    if unit is None and (since := _united(stems)):
        return NameTimes(_since(since))
    if _lost_zeros(stems):
        return NameTimes(
            doubt="the nanoseconds behind the point lack their leading zeros, so names give "
            "no times, and a wrong order"
        )
    columns = _columns(stems)
    if not columns:
        return NameTimes()
    stamps = _stamps(columns, unit)
    if stamps is not None and not _is_counter(stamps):
        return _dated(stamps, fps)
    if unit is None and (daytime := _daytimes(stems)):
        return _of_day(daytime, fps)
    rising = [column for column in columns if all(a < b for a, b in pairwise(column))]
    if not rising:
        return NameTimes()

    numbers = rising[-1]
    if unit is not None:
        return NameTimes(_since([round(number * _NS[unit]) for number in numbers]))
    if any(number != int(number) for number in numbers):
        return _seconds(numbers, fps, all(map(_NUMBER.fullmatch, stems)))
    return _counted([int(number) for number in numbers], fps)


def frame_numbers(stems: Sequence[str]) -> list[int]:
    """The numbers of frames in names, ascending; [] for stamps and other numbers.

    Example:
        >>> frame_numbers(["f_00010", "f_00014"]), frame_numbers(["1763000000.1", "1763000000.2"])
        ([10, 14], [])
    """
    dates, columns = _dates(stems), _columns(stems)
    stamps = _stamps(columns, None)
    if any(found is not None and not _is_counter(found) for found in (dates, stamps)):
        return []
    rising = [column for column in columns if all(a < b for a, b in pairwise(column))]
    if not rising or len(stems) < 2 or any(number != int(number) for number in rising[-1]):
        return []
    numbers = [int(number) for number in rising[-1]]
    return numbers if np.median(np.diff(numbers)) <= _DROPPED else []


def _columns(stems: Sequence[str]) -> list[list[Decimal]]:
    """Differing numbers in the names, by position; [] if names differ beyond their numbers."""
    if len({_NUMBER.sub("0", stem) for stem in stems}) > 1:
        return []
    columns = zip(*(map(Decimal, _NUMBER.findall(stem)) for stem in stems), strict=True)
    return [list(column) for column in columns if len(set(column)) > 1 or date_of(column)]


def date_of(column: Sequence[Decimal]) -> str:
    """The unit of numbers as times since 1970; "" for none."""
    return date_unit(np.array([float(number) for number in column]))


def _dates(stems: Sequence[str]) -> list[int] | None:
    """Calendar dates in names, ns since 1970; None without dates, or dates without seconds."""
    out = []
    for stem in stems:
        found = _DATE.search(stem)
        if not found:
            return None
        try:
            date = datetime(*map(int, found.groups()[:6])).replace(tzinfo=UTC)  # type: ignore[arg-type]
        except ValueError:
            return None
        part = found[7] or found[8] or ""
        out.append(int(date.timestamp()) * 10**9 + int(part.ljust(9, "0")))
    return out


def _stamps(columns: Sequence[Sequence[Decimal]], unit: str | None) -> list[int] | None:
    """Stamps in names, ns since 1970; a number after whole seconds may be their nanoseconds."""
    for place, column in enumerate(columns):
        found = date_of(column)
        if not found or (unit is not None and unit != found):
            continue
        stamps = [int(number * _NS[found]) for number in column]
        if found == "s" and all(number == int(number) for number in column):
            after = columns[place + 1] if place + 1 < len(columns) else None
            part = _part_ns(after) if after is not None else 0
            if after is not None and part:
                stamps = [a + int(b) * part for a, b in zip(stamps, after, strict=True)]
        if len(set(stamps)) > 1:
            return stamps
    return None


def _part_ns(column: Sequence[Decimal]) -> int:
    """Nanoseconds of a unit of the numbers behind whole seconds; 0 for counters of images.

    A counter goes up by 1 all along, and within a second not beyond the fastest camera.
    """
    largest = max(column)
    if largest >= 10**9 or largest <= _RATES[1] or any(one != int(one) for one in column):
        return 0
    if len(column) > 1 and all(after - before == 1 for before, after in pairwise(column)):
        return 0
    # nanoseconds, microseconds or milliseconds, by the digits of the largest
    return 1 if largest >= 10**6 else 1000 if largest >= 1000 else 10**6


def _lost_zeros(stems: Sequence[str]) -> bool:
    """Whether nanoseconds behind a point are written without leading zeros: 7.5 for 7.000000005."""
    found = [_POINT.search(stem) for stem in stems]
    if not all(found):
        return False
    parts = [(int(one[1]) * 10**9, one[2]) for one in found if one]
    widths = {len(part) for _, part in parts}
    if len(widths) == 1 or max(widths) < 9:
        return False
    # read as written, such stamps jump back and forth; read as a count, they go on evenly
    as_written = np.diff(sorted(whole + int(part.ljust(9, "0")) for whole, part in parts))
    as_count = np.diff(sorted(whole + int(part) for whole, part in parts))
    return bool(as_count.std() < as_written.std())


def _united(stems: Sequence[str]) -> list[int] | None:
    """Times with a unit behind them in names (``0040ms``), ns; None without plausible ones."""
    found = [_UNITED.search(stem) for stem in stems]
    if len({one and one[2] for one in found}) != 1 or found[0] is None:
        return None
    out = [int(Decimal(one[1]) * _NS[one[2]]) for one in found if one]
    steps = np.diff(out)
    is_camera = (steps > 0).all() and _RATES[0] <= 1e9 / float(np.median(steps)) <= _RATES[1]
    return out if is_camera else None


def _daytimes(stems: Sequence[str]) -> list[int] | None:
    """Times of day in names, ns, over midnight; None without plausible ones."""
    found = [_DAYTIME.search(stem) for stem in stems]
    if not all(found):
        return None
    out: list[int] = []
    for one in found:
        assert one is not None
        seconds = (int(one[1]) * 60 + int(one[2])) * 60 + int(one[3])
        now = seconds * 10**9 + int(one[4].ljust(9, "0"))
        days = 0 if not out else out[-1] // _DAY + (now < out[-1] % _DAY - _DAY // 2)
        out.append(now + days * _DAY)
    steps = np.diff(out)
    # a counter behind numbers goes up evenly and is faster than a camera
    is_even = len(steps) > 1 and np.ptp(steps) == 0
    is_camera = (steps > 0).all() and _RATES[0] <= 1e9 / float(np.median(steps)) <= _RATES[1]
    return out if is_camera and not is_even else None


def _of_day(times: list[int], fps: float | None) -> NameTimes:
    since = _since(times)
    rate = 1 / float(np.median(np.diff(since)))
    if not fps or 1 / _APART < rate / fps < _APART:
        return NameTimes(since)
    words = f"names are times of day, {rate:.3g} a second, and fps is {fps:g}; the names count"
    return NameTimes(since, doubt=words)


def _dated(stamps: list[int], fps: float | None) -> NameTimes:
    if any(b <= a for a, b in pairwise(stamps)):
        return NameTimes(doubt="the stamps in names do not increase, so they give no times")
    times = _since(stamps)
    rate = 1 / float(np.median(np.diff(times)))
    doubt = ""
    if fps and not 1 / _APART < rate / fps < _APART:
        doubt = f"names come {rate:.3g} times a second and fps is {fps:g}; the names count"
    return NameTimes(times, Decimal(stamps[0]) / 10**9, doubt)


def _is_counter(stamps: Sequence[int]) -> bool:
    """Whether stamps are faster than any camera: a number after a date then counts images."""
    return 0 <= stamps[-1] - stamps[0] < (len(stamps) - 1) * 1e9 / _RATES[1]


def _seconds(numbers: Sequence[Decimal], fps: float | None, alone: bool) -> NameTimes:
    """Times from fractions, as seconds if they fit the rate; ``alone`` for purely numeric names."""
    times = _since([int(number * 10**9) for number in numbers])
    steps = np.diff(times)
    rate = 1 / float(np.median(steps))
    if fps and abs(rate / fps - 1) <= _CLOSE:
        return NameTimes(times)
    is_likely = alone and _RATES[0] <= rate <= _RATES[1] and float(np.ptp(steps)) > 1e-6
    doubt = f"names may be seconds, {rate:.3g} a second{_else(fps)}" if is_likely else ""
    return NameTimes(doubt=doubt)


def _counted(numbers: list[int], fps: float | None) -> NameTimes:
    """Times from whole numbers: counters of frames with gaps, or stamps since the start."""
    steps = np.diff(numbers)
    usual = int(np.median(steps))
    if (steps == steps[0]).all() or not fps:
        return NameTimes()
    places = np.array([number - numbers[0] for number in numbers], np.float64)
    # most follow their neighbour: a counter of frames, and gaps are dropped ones
    if (steps == 1).mean() >= 0.5:
        return NameTimes(places / fps)
    for unit, ns in _NS.items():
        if unit != "s" and abs(usual * ns * fps / 1e9 - 1) <= _CLOSE:
            return NameTimes(_since([number * ns for number in numbers]))
    # every n-th frame was kept: the steps are multiples of the usual one
    stride = gcd(*(int(step) for step in steps))
    if stride == usual or usual <= _DROPPED:
        return NameTimes(places / (fps * (stride if stride == usual else 1)))
    for unit, ns in _NS.items():
        rate = 1e9 / (usual * ns)
        if unit != "s" and _RATES[0] <= rate <= _RATES[1]:
            return NameTimes(doubt=f"names may be times in {unit}, {rate:.3g} a second{_else(fps)}")
    return NameTimes(doubt="the numbers in names leave some out; frames are spread evenly")


def _else(fps: float | None) -> str:
    """End of a doubt: its consequence."""
    return f", where fps is {fps:g}; frames are spread evenly" if fps else ""


def _since(stamps: Sequence[int]) -> NDArray[np.float64]:
    return np.array([stamp - stamps[0] for stamp in stamps], np.float64) / 1e9
