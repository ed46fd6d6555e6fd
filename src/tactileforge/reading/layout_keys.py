"""Keys of a layout: types and defaults; `docs/data.md` describes them."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from tactileforge.data.frames.cut import spread_rows
from tactileforge.reading import vocabulary
from tactileforge.reading.vocabulary import Keys, OriginKeys, StreamKeys

#: Frames of the median of a recording. It leaves out a contact that covers a pixel in fewer than
#: half of them; an odd number has a frame of its own in the middle.
MEDIAN_FRAMES = 15


@dataclass(frozen=True)
class BackgroundRule:
    """Frames without contact, from a file or from the recording.

    Attributes:
        file: Path of an image, or of a video with ``first`` or ``last``; None for the recording.
        first: Number of first frames; 0.
        last: Number of last frames; 0.
        median: Whether to take the median of frames spread evenly over the recording: it leaves
            out a moving contact.
        frames: The first of some frames and the one after their last; None for none.
    """

    file: str | None = None
    first: int = 0
    last: int = 0
    median: bool = False
    frames: tuple[int, int] | None = None

    def rows(self, count: int) -> list[int]:
        """Numbers of the frames without contact.

        Args:
            count: Frames of the recording, or of the file.
        """
        if self.median:
            return spread_rows(count, MEDIAN_FRAMES)
        if self.frames:
            return list(range(min(self.frames[0], count), min(self.frames[1], count)))
        if self.last:
            return list(range(max(0, count - self.last), count))
        return list(range(min(count, self.first or count)))


@dataclass(frozen=True)
class CropKeys(Keys):
    """Keys of a crop: its box, and its sensor (None for the layout's)."""

    box: tuple[int, int, int, int]
    sensor: str | None = None


@dataclass(frozen=True)
class LabelKeys(Keys):
    """Keys of the CSV of labels.

    Attributes:
        file: Path from the layout's folder.
        key: Column of the touches' names.
        only: Whether touches without a row are left out; False.
    """

    file: str | None = None
    key: str = "file"
    only: bool = False


@dataclass(frozen=True, kw_only=True)
class ForceKeys(vocabulary.ForceKeys):
    """Keys of forces; see `FrameTable`.

    Attributes:
        times: Column of the seconds since the first frame, or the column and its unit.
    """

    file: str = field(metadata={"example": '"{stem}.csv"'})
    columns: tuple[str | int | None, ...] = field(metadata={"example": "[fx, fy, fz]"})
    frame: str | None = None
    times: str | ColumnKeys | None = None
    lag_s: float = 0.0
    key: str | None = None
    start: str | float | None = None
    partial: bool = False


@dataclass(frozen=True)
class ColumnKeys(Keys):
    """Keys of a column of times.

    Attributes:
        column: Name of the column.
        unit: Unit of the times; None for seconds, or the detected unit of dates.
    """

    column: str
    unit: str | None = None


@dataclass(frozen=True)
class ClockKeys(Keys):
    """Origin of the times or of the order of frames.

    Attributes:
        file: Path of a CSV; None for the names of the images.
        column: Column of the times or places.
        key: Column of the names of images; None if row ``i`` is frame ``i``.
        unit: Unit of the times; None for seconds, or the detected unit of dates.
    """

    file: str | None = None
    column: str | None = None
    key: str | None = None
    unit: str | None = None


@dataclass(frozen=True)
class FrameTable:
    """A CSV of values, per frame or on a clock of its own.

    Attributes:
        file: Path from the layout's folder.
        frame: Column of the frame number; None if row ``i`` is frame ``i``, or with `time`.
        columns: Columns of the values; "" for a missing one.
        sign: Factor of each value; 1.
        lag_s: Delay of the images behind the values, s; 0.
        time: Column of the seconds since the first frame; None if rows are frames.
        key: Column of the names of images; None for rows by frame or time.
        unit: Unit of `time`; None for seconds, or the detected unit of dates.
        start: Where the clock of the rows meets that of the frames: ``first_row``, ``contact``, the
            time of the first frame as a number of `time`, or a column of the labels with that
            number in braces; None for rows since the first frame, or frames with dates too.
        partial: Whether rows may cover a part of the recording or exceed it, or be missing; False.
    """

    file: str
    frame: str | None
    columns: tuple[str, ...]
    sign: tuple[float, ...] = (1.0, 1.0, 1.0)
    lag_s: float = 0.0
    time: str | None = None
    key: str | None = None
    unit: str | None = None
    start: str | float | None = None
    partial: bool = False


@dataclass(frozen=True)
class ActionKeys(Keys):
    """Keys of actions in a CSV; see `FrameTable`."""

    file: str = field(metadata={"example": '"{stem}.csv"'})
    column: str = field(metadata={"example": "action"})
    frame: str | None = None
    key: str | None = None


@dataclass(frozen=True)
class TrackKeys(Keys):
    """Keys of further values per frame in a CSV; see `FrameTable`.

    Attributes:
        file: Path from the layout's folder; recordings without the file have no such values.
        columns: Columns of the values, which become tracks.
        frame: Column of the frame number; None if row ``i`` is frame ``i``.
        key: Column of the names of images; None for rows by frame.
        drop: Column of 0 and 1; frames with 1 are left out. None for none.
    """

    file: str = field(metadata={"example": '"labels/{file}.csv"'})
    columns: tuple[str, ...] = field(metadata={"example": "[contact, slip]"})
    frame: str | None = None
    key: str | None = None
    drop: str | None = None


@dataclass(frozen=True)
class TrackRanges(Keys):
    """Keys of a track with 1 in ranges of frames, and 0 outside.

    Attributes:
        name: Name of the track.
        frames: First frame of each range, and the one after its last; in order, apart.
        margin: Frames on each side of an edge without a value, as edges are uncertain; 0.
    """

    name: str
    frames: tuple[tuple[int, int], ...]
    margin: int = 0


@dataclass(frozen=True)
class RangeKeys(Keys):
    """Keys of an action: its first frame and the one after its last."""

    frames: tuple[int, int]
    action: str


@dataclass(frozen=True, kw_only=True)
class LayoutKeys(StreamKeys, OriginKeys):
    """Keys of a layout; see `docs/data.md`."""

    background: BackgroundRule | str = field(
        metadata={"example": "{first: 3}, {file: f.png} or none"}
    )
    videos: str | tuple[str, ...] | None = None
    stream: int | dict[str, int] | None = None
    images: str | tuple[str, ...] | None = None
    each: str | None = None
    recording: str | None = None
    path: str = "."
    sensor: str | None = None
    fps: float | None = None
    times: str | ClockKeys | None = None
    order: str | ClockKeys | None = None
    white: float | None = None
    every: float = 1.0
    ignore: tuple[str, ...] = ()
    crops: dict[str, CropKeys] = field(default_factory=dict)
    labels: LabelKeys = field(default_factory=LabelKeys)
    words: dict[Any, dict[Any, Any]] = field(default_factory=dict)
    force: ForceKeys | None = None
    action: str | ActionKeys | tuple[RangeKeys, ...] | None = None
    tracks: TrackKeys | tuple[TrackRanges, ...] | None = None
    object: str | None = None
    text: str | tuple[str, ...] = ()
    camera: str | None = None
    hold_out: str = "trial"
