"""Times of the frames of a touch, from its layout, its names, a CSV or the video."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from decimal import Decimal
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tactileforge.data.frames.stacks import StackFrames
from tactileforge.data.frames.video import VideoFrames
from tactileforge.data.frames.video_clock import rate_doubt, video_times
from tactileforge.data.labels.clock import (
    UNITS,
    after_midnight,
    check_rising,
    clock_number,
    date_unit,
    seconds_since,
)
from tactileforge.errors import ConfigError, DataError
from tactileforge.reading.image_rows import ImageRows
from tactileforge.reading.layout import DatasetLayout
from tactileforge.reading.layout_keys import ClockKeys
from tactileforge.reading.name_times import name_times
from tactileforge.reading.order import by_pattern
from tactileforge.reading.split_times import part_of_second
from tactileforge.reading.tables import read_cells

#: Median step of frames, s (or, with fps, as a multiple of its period), beyond which times need an
#: explicit unit: milliseconds taken for seconds are 33 a frame at 30 Hz.
_SLOW = 5.0


@dataclass(frozen=True)
class FrameClock:
    """Times of frames.

    Attributes:
        times: float64 (T,), seconds since the first frame.
        start: Time of the first frame, seconds since 1970; None if unknown.
        doubt: Description of an ambiguity, as a phrase; "" without one.
    """

    times: NDArray[np.float64]
    start: Decimal | None = None
    doubt: str = ""


class Clocks:
    """Computes the times and the order of frames.

    Args:
        layout: The layout.
        rows: Look-up of CSV rows by image.
    """

    def __init__(self, layout: DatasetLayout, rows: ImageRows) -> None:
        self.layout = layout
        self.rows = rows

    def times(
        self,
        paths: list[Path],
        video: VideoFrames | StackFrames | None,
        file: Callable[[str], Path],
    ) -> FrameClock:
        """The times of the frames of a touch.

        Raises:
            DataError: The times do not increase, are not one per frame, or look like another unit.
            ConfigError: The layout takes times from names without any times, or says none of a
                stack.
        """
        layout = self.layout
        if isinstance(layout.times, ClockKeys) and layout.times.file is not None:
            path = file(layout.times.file)
            count = len(paths) if video is None else len(video)
            return _of_values(
                layout.times, path, self._values(layout.times, path, paths, count), layout.fps
            )
        if video is None:
            return _of_names(layout, paths)
        if layout.fps or layout.singles:
            return FrameClock(np.arange(len(video)) / (layout.fps or 1.0))
        fix = f"give layout {layout.name!r} the rate of the camera: fps: 30"
        if isinstance(video, StackFrames):
            raise ConfigError(f"{video.path}: a stack has no times; {fix}, or times: of a CSV")
        return FrameClock(video_times(video, fix), doubt=rate_doubt(video))

    def ordered(self, paths: list[Path], file: Callable[[str], Path]) -> list[Path]:
        """The images of a sequence in the layout's order, or unchanged without one.

        Raises:
            DataError: An image has no place, or two share one.
        """
        order = self.layout.order
        if isinstance(order, str):
            return by_pattern(paths, order, self.layout.name) if order else paths
        path = file(order.file or "")
        places = self._values(order, path, paths, len(paths))
        if len(set(places)) < len(places):
            raise DataError(
                f"{path}: {order.column!r} gives two images of {paths[0].parent} one place; give "
                "each its own"
            )
        return [paths[i] for i in sorted(range(len(places)), key=places.__getitem__)]

    def _values(self, keys: ClockKeys, path: Path, paths: list[Path], count: int) -> list[Decimal]:
        """A column of numbers, one per frame."""
        column = keys.column or ""
        if keys.key is not None:
            # a file without a template serves all touches
            found = self.rows.find(path, keys.key, [column], paths, "{" not in (keys.file or ""))
            if lost := [paths[i] for i in range(count) if i not in found]:
                raise DataError(f"{path}: no row of {lost[0]}; add it, or move the image out")
            rows = [found[i] for i in range(count)]
        else:
            rows = read_cells(path, [column], whole=True)
        if len(rows) != count:
            raise DataError(
                f"{path}: {len(rows)} times for {count} frames; give one per frame, or the column "
                "of the names of images (key:)"
            )
        part = part_of_second(column, rows)
        values: list[Decimal] = []
        for where, cells in rows:
            now = _value(cells[column], f"{where}, column {column!r}")
            now = after_midnight(values[-1], now, cells[column]) if values else now
            values.append(now + part(cells))
        return values


def _value(cell: str, where: str) -> Decimal:
    try:
        return clock_number(cell)
    except ValueError:
        raise DataError(f"{where}: {cell!r} is not a finite number; fill it in") from None


def _of_values(
    keys: ClockKeys, path: Path, exact: Sequence[Decimal], fps: float | None
) -> FrameClock:
    """Times from the numbers of a column, in its unit."""
    values = np.array([float(value) for value in exact])
    check_rising(values, str(path), f"correct {keys.column!r}", shown="{:.10g}")
    date = date_unit(values)
    unit = keys.unit or date or "s"
    # from the first, before the unit: a date in nanoseconds uses all digits of a float
    start = exact[0] * Decimal(str(UNITS[unit]))
    times = seconds_since(exact, start, unit) if date else (values - values[0]) * UNITS[unit]
    period = float(np.median(np.diff(times))) if len(times) > 1 else 0.0
    if keys.unit is None and not date and (period > _SLOW or (fps and period * fps > _SLOW)):
        likely = next((unit for unit in ("ms", "us") if period * UNITS[unit] < 1), "ns")
        raise DataError(
            f"{path}: by {keys.column!r}, frames come every {period:.3g} s: is it another unit? "
            f"Give times: {{..., unit: {likely}}}, or unit: s if it is right"
        )
    return FrameClock(times, start if date else None)


def _of_names(layout: DatasetLayout, paths: list[Path]) -> FrameClock:
    even = FrameClock(np.arange(len(paths)) / (layout.fps or 1.0))
    if layout.each != "sequence" or layout.times == "even" or len(paths) < 2:
        return even
    unit = layout.times.unit if isinstance(layout.times, ClockKeys) else None
    found = name_times([path.stem for path in paths], layout.fps, unit)
    if found.times is not None:
        return FrameClock(found.times, found.start, found.doubt)
    if layout.times and layout.fps is None:
        raise ConfigError(
            f"{paths[0].parent}: names such as {paths[0].stem!r} and {paths[1].stem!r} give no "
            f"times{f': {found.doubt}' if found.doubt else ''}; give layout {layout.name!r} fps:, "
            "or times: {file: times.csv, column: t}"
        )
    fix = f"{found.doubt}: give times: names, times: {{unit: ms}} or times: even"
    return FrameClock(even.times, doubt=fix if found.doubt else "")
