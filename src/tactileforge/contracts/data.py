"""Contracts of data: frames, recordings, columns, data sets."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import (
    TYPE_CHECKING,
    Any,
    Literal,
    Protocol,
    runtime_checkable,
)

import numpy as np
from numpy.typing import NDArray

from tactileforge.errors import DataError, in_utf8

if TYPE_CHECKING:
    from matplotlib.figure import Figure


#: The eight atomic actions (paper, section Method), in the order of their labels.
ACTIONS = (
    "press",
    "leave",
    "slide_left",
    "slide_right",
    "slide_up",
    "slide_down",
    "rotate_cw",
    "rotate_ccw",
)


#: Labels of a batch, which data sets may provide and objectives may need.
LABELS = ("force", "action", "object", "text", "image", "surface")


#: Axes of a force, in the order of its columns.
AXES = ("x", "y", "z")


#: Grey value of a background without effect: subtraction and the offset of 130/255 cancel.
NEUTRAL_BACKGROUND = 130


class Frames(Protocol):
    """Lazy frames of one recording, decoded when they are read."""

    def __len__(self) -> int:
        """The number of frames."""
        ...

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width."""
        ...

    def read(self, indices: Sequence[int]) -> NDArray[np.uint8]:
        """Decodes frames, in the order asked for.

        Args:
            indices: Frame numbers, each in ``0..len - 1``; repeats are allowed.

        Returns:
            uint8 (n, H, W, 3), RGB.

        Raises:
            DataError: A frame cannot be decoded; the message names the file.
        """
        ...


@dataclass(frozen=True, kw_only=True)
class Recording:
    """One continuous touch by one sensor, with all data of its source.

    Attributes:
        key: Name of the recording, unique within its data set.
        sensor: Name of a `SensorSpec`.
        frames: Lazy frames.
        times: float64 (T,), seconds, strictly increasing.
        no_contact: Frames without contact, whose median is the background; None where the source
            has none and says so (then nothing is subtracted).
        force: float32 (T, 3), newton. NaN means no label: a frame without labels is a row of NaN,
            and a source that knows z alone has NaN in x and y.
        action: int64 (T,), index into `ACTIONS`, -1 unknown.
        object: Name of the touched object, the same for every sensor that touches it.
        text: Caption; ``{action}`` in it stands for the action of the clip.
        image: Paired camera image.
        image_times: float64, seconds on the clock of ``times``, ascending, one for each view; None
            where they are spread evenly over the recording.
        surface: Displacement of the gel's surface, an image a frame; see `displacement`.
        labels: Further labels of the recording, by name. With a true ``upright``, for an object
            with text on it, say, augmentation leaves its clips as they lie.
        tracks: Further values per frame: arrays (T, ...) by name.
        source: Origin of the recording.
        tier: Tier of the tactile dynamic pyramid, 1 (force) to 5 (static).
        licence: SPDX identifier, or several plain words for a licence without one.
    """

    key: str
    sensor: str
    frames: Frames
    times: NDArray[np.float64]
    no_contact: Frames | None
    force: NDArray[np.float32] | None = None
    action: NDArray[np.int64] | None = None
    object: str | None = None
    text: str | None = None
    image: Frames | None = None
    image_times: NDArray[np.float64] | None = None
    surface: Frames | None = None
    labels: Mapping[str, str | float] = field(default_factory=dict)
    tracks: Mapping[str, NDArray[Any]] = field(default_factory=dict)
    source: str = ""
    tier: int = 5
    licence: str = ""

    def __post_init__(self) -> None:
        """Refuses a key beyond tables, pages and shards.

        Raises:
            DataError: The key comes from names of files that are not UTF-8.
        """
        if in_utf8(self.key) != self.key:
            raise DataError(f"{self.key!a}: its name is not UTF-8; rename the file or folder")

    @property
    def period(self) -> float:
        """Median time between frames, s; 0 for a single frame."""
        return float(np.median(np.diff(self.times))) if len(self.times) > 1 else 0.0

    def background(self) -> NDArray[np.uint8] | None:
        """Median of the frames without contact, uint8 (H, W, 3); None without any.

        Raises:
            DataError: A frame cannot be decoded.
        """
        if self.no_contact is None:
            return None
        frames = self.no_contact.read(range(len(self.no_contact)))
        median: NDArray[np.uint8] = np.median(frames, axis=0).astype(frames.dtype)
        return median

    def select(self, rows: Sequence[int]) -> Recording:
        """Takes some frames with their labels and tracks; background and camera views stay.

        Args:
            rows: Frame numbers, ascending.
        """
        rows = list(rows)
        return replace(
            self,
            frames=FrameSubset(self.frames, rows),
            times=self.times[rows],
            force=None if self.force is None else self.force[rows],
            action=None if self.action is None else self.action[rows],
            surface=None if self.surface is None else FrameSubset(self.surface, rows),
            tracks={name: values[rows] for name, values in self.tracks.items()},
        )

    def part(self, start: int, stop: int) -> Recording:
        """The frames ``start..stop - 1`` as a recording of their own, with the same background."""
        rows = range(start, stop)
        image = self.image
        if image is not None and self.image_times is None:
            paired = [i * len(image) // len(self.frames) for i in rows]
            image = FrameSubset(image, paired)
        return replace(self.select(rows), key=f"{self.key}[{start}:{stop}]", image=image)


@dataclass(frozen=True, kw_only=True)
class Column:
    """An extra column of the batch, declared by a head or objective.

    The class attribute ``columns`` of the head or objective is a tuple of columns, or a function of
    its options (a static method) that returns one.

    Attributes:
        name: Key of the batch; ``NAME_valid``, bool (B, steps), says which steps are labelled.
        track: Name in `Recording.tracks`; "" for the name of the column.
        window: Steps of the recording, from the first to the one after the last, counted from the
            last frame of the clip: ``(0, 8)`` is a chunk of that frame and the seven after it,
            ``(-1, 1)`` the one before it and itself. None takes the frames of the clip.
        dtype: Type of the values in the batch.
        statistics: Whether mean and deviation over the training data are measured, before any
            augmentation.
        turns: Kind of value, for mirrored and turned clips: ``vector`` for x, y (and z) in the last
            axis of a step, on the axes of the picture; ``torque`` for torques or turns about x, y
            and z, or a single number about z; ``wrench`` for three forces and three torques;
            ``pose`` for motions (4, 4) on the same axes; ``field`` for x and y at places across the
            frame, (rows, columns, 2), in shares of a side, which also move with the picture and
            grow with its scale; "" for values that stay as they are.
        shape: Shape of a step, where only one will do; None for that of the data.

    Example:
        >>> Column(name="temperature", shape=(1,), window=(0, 4)).window
        (0, 4)
    """

    name: str
    track: str = ""
    window: tuple[int, int] | None = None
    dtype: Literal["float32", "int64"] = "float32"
    statistics: bool = False
    turns: Literal["", "vector", "torque", "wrench", "pose", "field"] = ""
    shape: tuple[int, ...] | None = None


@dataclass(frozen=True, kw_only=True)
class ColumnSize:
    """Size and statistics of a column; the parameter ``column_sizes`` of a head has one by name.

    Attributes:
        shape: Shape of one step.
        mean: Mean over all steps of the training data, flat; None without `Column.statistics`.
        deviation: Standard deviation over the same steps, flat; None without `Column.statistics`.

    Example:
        >>> ColumnSize(shape=(6,)).mean is None
        True
    """

    shape: tuple[int, ...]
    mean: tuple[float, ...] | None = None
    deviation: tuple[float, ...] | None = None


@dataclass(frozen=True)
class FrameSubset:
    """A lazy selection of other frames.

    Attributes:
        base: Frames to take from.
        rows: Numbers of the selected frames, in order.

    Example:
        >>> import numpy as np
        >>> from tactileforge.data import ArrayFrames
        >>> film = ArrayFrames(np.arange(5, dtype=np.uint8).reshape(5, 1, 1, 1).repeat(3, axis=3))
        >>> FrameSubset(film, [4, 0]).read([0])[0, 0, 0].tolist()
        [4, 4, 4]
    """

    base: Frames
    rows: Sequence[int]

    def __len__(self) -> int:
        return len(self.rows)

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width."""
        return self.base.shape

    def read(self, indices: Sequence[int]) -> NDArray[np.uint8]:
        """Decodes frames of the selection; see `Frames.read`."""
        return self.base.read([self.rows[i] for i in indices])


@dataclass(frozen=True, kw_only=True)
class Guess:
    """A format recognised in a folder or file, and the options to read it.

    A data set may have ``recognise(root: Path) -> Guess | None``, a static method. It looks at
    names, headers and at most a few small files, executes nothing, raises nothing for foreign
    files, and returns None for them. For files of its kind whose meaning it cannot tell, it raises
    a `DataError` that says what is there and what to type; it is shown where no other data set
    knows them.

    Attributes:
        options: Options of the data set as plain data, with the path.
        format: Name of the format, one line.
        score: Certainty, 0..1: 1 for a signature of the format, .5 for matching names and shapes,
            .1 for any folder of pictures.
        doubts: Statements to be checked by the user, one line each: unknown units, rates, signs.

    Example:
        >>> guess = Guess(options={"name": "mine", "root": "touches"}, format="my lab's", score=0.5)
        >>> guess.options["root"], guess.doubts
        ('touches', ())
    """

    options: Mapping[str, Any]
    format: str
    score: float
    doubts: Sequence[str] = ()


@runtime_checkable
class Dataset(Protocol):
    """A data reader: yields recordings, and declares their labels.

    ``provides`` holds batch keys from `LABELS`. A data set that cuts its recordings itself has
    ``cut``, which is called like `data.batches.clips.Clips`. Its result may have ``provides``,
    further keys of its samples, and ``facts``, plain data by name that is passed to heads as
    ``facts`` and kept in the configuration of the run.
    ``skipped`` gets one line, with the name of the file, for each file that `recordings` cannot
    read. ``notes``, if there is one, gets a line for each recording that was read with doubt,
    and ``held_out`` says what is held out together.

    A large data set may also have ``sources(split)``, see `data.batches.sources.Sharded`: it is
    then opened part by part while it is read, and not as a whole.

    Example:
        >>> from tactileforge.plugins import build
        >>> data = build("datasets", {"name": "recordings", "root": "touches", "layouts": {}})
        >>> isinstance(data.skipped, list)
        True
    """

    skipped: list[str]

    @property
    def provides(self) -> frozenset[str]:
        """Batch keys of the labels of the recordings; each recording may lack some."""
        ...

    def recordings(self, split: str) -> Iterable[Recording]:
        """The recordings of a split (``train`` or ``val``), in a fixed order.

        Raises:
            DataNotFoundError: Something is missing; names the folder and the fix.
            DataError: Labels contradict the files.
        """
        ...

    def plot(self, recording: Recording) -> Figure:
        """A figure of one recording."""
        ...
