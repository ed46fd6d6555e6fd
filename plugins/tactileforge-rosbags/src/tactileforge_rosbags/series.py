"""Messages of a topic: their times, and the ones left out."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactileforge.data import nearest
from tactileforge.errors import DataError
from tactileforge_rosbags.bags import Bag

#: Nanoseconds of a second.
_SECOND = 1_000_000_000


@dataclass(frozen=True)
class Series:
    """Times of the messages of a topic, in order of recording.

    Attributes:
        bag: The bag.
        topic: Name of the topic.
        recorded: int64 (n,), times of recording, ns.
        stamped: int64 (n,), stamps of the headers, ns; None where one has none.
        place: int64 (n,), number of each message among those of the same time of recording.
    """

    bag: Bag
    topic: str
    recorded: NDArray[np.int64]
    stamped: NDArray[np.int64] | None
    place: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.recorded)

    def __str__(self) -> str:
        return f"{self.bag}, {self.topic}"

    def take(self, rows: NDArray[Any]) -> Series:
        """Some of the messages."""
        stamped = None if self.stamped is None else self.stamped[rows]
        return Series(self.bag, self.topic, self.recorded[rows], stamped, self.place[rows])


@dataclass(frozen=True)
class Scan:
    """A topic after its first pass.

    Attributes:
        series: Times of the good messages.
        values: What was read of each, one after another.
        bad: Number of messages left out.
        first: The first of them, and why; "" for none.
    """

    series: Series
    values: Any
    bad: int
    first: str

    @property
    def line(self) -> str:
        """A line on the messages left out; "" for none."""
        total = self.bad + len(self.series)
        if not self.bad:
            return ""
        return f"{self.series}: {self.bad} of {total} messages left out, the first: {self.first}"


def scan(bag: Bag, topic: str, kinds: tuple[str, ...], read: Callable[[Any], Any]) -> Scan:
    """Reads a topic once.

    Args:
        bag: The bag.
        topic: Name of the topic.
        kinds: Types of messages that are read.
        read: Function from a message to what is kept of it; raises a `DataError` to leave it out.

    Raises:
        DataError: The bag is damaged, the topic is not there or of another type, or no message is
            good.
    """
    bag.topic(topic, kinds)
    rows: list[tuple[int, int, int]] = []
    values: list[Any] = []
    bad, first = 0, ""
    for number, (time, place, message) in enumerate(placed(bag, topic, None, None)):
        try:
            values.append(read(message))
        except DataError as error:
            bad += 1
            first = first or f"message {number}, {error}"
            continue
        rows.append((time, place, _stamp(message)))
    if not rows:
        raise DataError(f"{bag}, {topic}: none of its {bad} messages can be read; {first}")
    recorded, place_of, stamped = np.asarray(rows, np.int64).T.copy()
    series = Series(bag, topic, recorded, stamped if stamped.all() else None, place_of)
    return Scan(series, values, bad, first)


def placed(
    bag: Bag, topic: str, start: int | None, stop: int | None
) -> Iterator[tuple[int, int, Any]]:
    """Yields messages with their time, ns, and number among those of the same time."""
    seen: Counter[int] = Counter()
    last = None
    for time, message in bag.messages(topic, start, stop):
        if time != last:
            seen.clear()
        yield time, seen[time], message
        seen[time] += 1
        last = time


def _stamp(message: Any) -> int:
    """Stamp of a message, ns; 0 for none."""
    header = getattr(message, "header", None)
    return 0 if header is None else header.stamp.sec * _SECOND + header.stamp.nanosec


@dataclass(frozen=True)
class Clock:
    """The clock of a recording's frames.

    Attributes:
        touch: Its frames.
        stamps: Whether it is the clock of header stamps, and not that of recording.
    """

    touch: Series
    stamps: bool

    @property
    def times(self) -> NDArray[np.int64]:
        """Times of the frames, ns."""
        return self.of(self.touch)

    def of(self, series: Series) -> NDArray[np.int64]:
        """Times of other messages on this clock, ns.

        Messages without stamps are put on the clock of stamps by their time of recording, less the
        median delay of the frames.
        """
        if not self.stamps:
            return series.recorded
        if series.stamped is not None:
            return series.stamped
        return series.recorded - self.delay

    @property
    def delay(self) -> int:
        """Median time from the stamp of a frame to its recording, ns."""
        stamped = self.touch.recorded if self.touch.stamped is None else self.touch.stamped
        return int(np.median(self.touch.recorded - stamped))


def rising(series: Series, stamps: bool) -> tuple[Series, int]:
    """Frames of distinct times.

    Args:
        series: The frames.
        stamps: Whether their stamps count.

    Returns:
        The frames, and the number of those left out.

    Raises:
        DataError: Times fall.
    """
    times = Clock(series, stamps).times
    steps = np.diff(times)
    if len(falls := np.flatnonzero(steps < 0)):
        row = int(falls[0])
        fix = "give data.clock=bag" if stamps else "record it again"
        raise DataError(
            f"{series}: times fall by {-steps[row] / _SECOND:.4g} s at message {row + 1}; {fix}"
        )
    keep = np.concatenate([[True], steps > 0])
    return series.take(keep), int(len(keep) - keep.sum())


def nearest_rows(
    times: NDArray[np.int64], at: NDArray[np.int64], gap: float
) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """Rows of the nearest times, and whether each is near enough.

    Args:
        times: Times to choose from, ns, in any order.
        at: Times to find, ns.
        gap: Largest difference, s.
    """
    order = np.argsort(times, kind="stable")
    base = at[0]
    rows = order[nearest((times[order] - base) / _SECOND, (at - base) / _SECOND)]
    return rows, np.abs(times[rows] - at) <= gap * _SECOND


def between(
    times: NDArray[np.int64],
    at: NDArray[np.int64],
    gap: float,
    values: NDArray[np.float32],
) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """Values at other times, between the two nearest; and whether one is near enough.

    A value at a time that was measured is that one to the bit; where one neighbour alone is near
    enough, as before the first value, it counts.

    Args:
        times: Times of the values, ns, in any order.
        at: Times to find, ns.
        gap: Largest difference, s.
        values: float32 (n, C).

    Returns:
        float32 (m, C), and bool (m,).
    """
    rows, near = nearest_rows(times, at, gap)
    out: NDArray[np.float32] = values[rows]
    if len(times) < 2:
        return out, near
    order = np.argsort(times, kind="stable")
    after = np.searchsorted(times[order], at).clip(1, len(times) - 1)
    first, second = order[after - 1], order[after]
    since, until = at - times[first], times[second] - at
    # at a time that was measured, the value stays as it is
    inside = (since > 0) & (until > 0) & (np.maximum(since, until) <= gap * _SECOND)
    share = (since[inside] / (since + until)[inside])[:, None]
    out[inside] = values[first[inside]] * (1 - share) + values[second[inside]] * share
    return out, near
