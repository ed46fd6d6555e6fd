"""Keys of a layout as they are written: types and defaults; `docs/data.md` has their meanings."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True)
class BackgroundRule:
    """Frames without contact: those of a file, or some of the recording.

    Attributes:
        file: An image, or a video of which ``first`` or ``last`` says which frames.
        first: The first frames.
        last: The last frames.
        median: Frames spread evenly over the recording, whose median leaves the contact out.
    """

    file: str | None = None
    first: int = 0
    last: int = 0
    median: bool = False


@dataclass(frozen=True)
class CropKeys:
    """A crop as it is written: its box, and its sensor where it is not that of the layout."""

    box: tuple[int, int, int, int]
    sensor: str | None = None


@dataclass(frozen=True)
class LabelKeys:
    """The CSV of labels as it is written: its file, and the column that names the touch."""

    file: str | None = None
    key: str = "file"


@dataclass(frozen=True)
class ForceKeys:
    """Forces as they are written; see `FrameTable`."""

    file: str = field(metadata={"example": '"{stem}.csv"'})
    columns: tuple[str | int | None, ...] = field(metadata={"example": "[fx, fy, fz]"})
    frame: str | None = None
    time: str | None = None
    sign: tuple[float, float, float] = (1.0, 1.0, 1.0)
    lag_s: float = 0.0
    key: str | None = None
    unit: str | None = None
    partial: bool = False


@dataclass(frozen=True)
class ClockKeys:
    """Origin of times, or of the order, of frames.

    Attributes:
        file: A CSV; None where the names of the images say it.
        column: Its column of times or places.
        key: Its column of the names of images; None where row ``i`` is frame ``i``.
        unit: Unit of the times; None for seconds, or that of a date.
    """

    file: str | None = None
    column: str | None = None
    key: str | None = None
    unit: str | None = None


@dataclass(frozen=True)
class FrameTable:
    """A CSV of values per frame, or on a clock of its own.

    Attributes:
        file: Path from the layout's folder.
        frame: Column of the frame number; None: row ``i`` is frame ``i``, or `time` says when.
        columns: Columns of the values; "" for one that there is not.
        sign: What each value is multiplied by.
        lag_s: Seconds by which the images lag the values.
        time: Column of the seconds since the first frame; None where rows are frames.
        key: Column of the names of images; None where rows have other places.
        unit: Unit of `time`; None for seconds, or that of a date.
        partial: Whether rows may cover a part of the recording, or more than it.
    """

    file: str
    frame: str | None
    columns: tuple[str, ...]
    sign: tuple[float, ...] = (1.0, 1.0, 1.0)
    lag_s: float = 0.0
    time: str | None = None
    key: str | None = None
    unit: str | None = None
    partial: bool = False


@dataclass(frozen=True)
class ActionKeys:
    """Actions of a CSV as they are written; see `FrameTable`."""

    file: str = field(metadata={"example": '"{stem}.csv"'})
    column: str = field(metadata={"example": "action"})
    frame: str | None = None
    key: str | None = None


@dataclass(frozen=True)
class RangeKeys:
    """An action as it is written: its first frame and the one after its last."""

    frames: tuple[int, int]
    action: str


@dataclass(frozen=True, kw_only=True)
class LayoutKeys:
    """A layout as it is written; see `docs/data.md`."""

    background: BackgroundRule | str = field(
        metadata={"example": "{first: 3}, {file: f.png} or none"}
    )
    videos: str | tuple[str, ...] | None = None
    images: str | tuple[str, ...] | None = None
    each: str | None = None
    path: str = "."
    sensor: str | None = None
    fps: float | None = None
    times: str | ClockKeys | None = None
    order: str | ClockKeys | None = None
    channels: str = "rgb"
    rotate: int = 0
    crops: dict[str, CropKeys] = field(default_factory=dict)
    labels: LabelKeys = field(default_factory=LabelKeys)
    words: dict[Any, dict[Any, Any]] = field(default_factory=dict)
    force: ForceKeys | None = None
    action: str | ActionKeys | tuple[RangeKeys, ...] | None = None
    object: str | None = None
    text: str | tuple[str, ...] = ()
    image: str | None = None
    source: str = ""
    licence: str = ""
    tier: int = 5
    split: str = "recording"
