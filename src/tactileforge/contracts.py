"""Contracts of sensors, data sets, encoders, heads and objectives, for plugin authors.

A plugin is a class. Its constructor parameters are explicit, their defaults are plain data (they
become the plugin's configuration), its construction does no I/O, and the module imports no vendor
SDK at top level. Parameters named in `CONTEXT` are not configuration: the framework passes them in.

Data flows one way::

    sensor or data set -> Recording -> batch (uint8) -> encoder -> views -> heads -> objectives ->
    loss

Axes. ``x`` points to the right of the image, ``y`` down the image, ``z`` into the gel. Forces are
those of the object on the gel, in newton: pressing is positive ``z``, an object that drags the gel
to the right of the image is positive ``x``.

A batch is a plain dict:

| key | type and shape | meaning |
|---|---|---|
| `frames` | uint8 (B, T, 3, H, W) | RGB, oldest first |
| `background` | uint8 (B, 3, H, W) | no-contact frame of the same recording |
| `sensor` | list of B names | the encoder maps names to its own rows |
| `force` | float32 (B, T, 3), `force_valid` bool (B, 3) | newton; which axes are labelled |
| `force_scale` | float32 (B, 3) | divisor of forces, newton, from the `SensorSpec` |
| `action` | int64 (B,) | index into `ACTIONS`; -1 unknown |
| `object` | int64 (B,) | identity across sensors; -1 unknown |
| `text` | list of B strings | "" where there is none |
| `image` | uint8 (B, 3, h, w), `image_valid` bool (B,) | paired camera image |
| `surface` | uint8 (B, T, 3, 32, 32), `surface_valid` bool (B,) | see `data.labels.displacement` |
| `group` | int64 (B,) | samples with one non-negative group were drawn together for matching |
| `aspect` | float32 (B,) | width over height of the frames as recorded, before they are resized |
| `upright` | bool (B,) | True where a mirrored or turned clip would be wrong, see `Recording` |

A sample without a label stays out of that objective's loss, and changes nothing in it.

Heads and objectives may declare extra columns (`Column`), which are cut from tracks of the
recordings:

| key | type and shape | meaning |
|---|---|---|
| NAME | float32 or int64 (B, steps, ...) | the track at the clip's frames, or in a window |
| NAME `_valid` | bool (B, steps) | False without the track, at NaN, outside of the recording |

A data set with a ``cut`` of its own may add further keys, listed in its `provides`, and
``tokens``, float16 (B, touches of a sample, L, width), of a frozen encoder in place of frames
(`Remembering`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import (
    TYPE_CHECKING,
    Any,
    ClassVar,
    Literal,
    Protocol,
    Self,
    TypeAlias,
    runtime_checkable,
)

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    import torch
    from matplotlib.figure import Figure
    from torch import Tensor, nn

    from tactileforge.means import Mean
    from tactileforge.sensors.simulation import Simulation

Batch: TypeAlias = dict[str, Any]

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

#: Keys of the batch itself: no column may use one as its name.
BATCH_KEYS = frozenset(
    {
        *("frames", "background", "sensor", "group", "clip", "skipped", "paired", "tokens"),
        *("force", "force_valid", "force_scale", "action", "object", "text"),
        *("image", "image_valid", "surface", "surface_valid", "aspect", "upright"),
        *("flip", "coded", "warp", "warp_turn", "relight"),  # added where clips are augmented
    }
)

#: Axes of a force, in the order of its columns.
AXES = ("x", "y", "z")

#: Grey value of a background without effect: subtraction and the offset of 130/255 cancel.
NEUTRAL_BACKGROUND = 130

#: Constructor parameters that the framework fills in; they never appear in a configuration.
CONTEXT = frozenset(
    {"encoder", "text_encoder", "image_encoder", "teacher", "column_sizes", "facts"}
)


@dataclass(frozen=True, kw_only=True)
class SensorSpec:
    """A type of sensor, as data. A live driver, a data set and an encoder refer to it by name.

    Attributes:
        name: Name that users type.
        height: Rows of a frame as the sensor gives it; 0 for a wrench or robot.
        width: Columns of a frame; 0 for a wrench or robot.
        fps: Frames, or samples, received per second.
        area_mm: Height and width of the sensing area, mm; None where it is not public.
        force_scale: Divisor of forces along x, y and z, newton.
        markers: Whether the gel carries markers.
        dome: Whether the gel is domed (else flat).
        kind: Content of a `Frame`: ``image`` pixels of a camera; ``array`` taxels, drawn as pixels,
            and their values; ``wrench`` forces and torques alone; ``robot`` its state and command.
        states: Number of values of a robot's state, the first in `Frame.raw`.
        actions: Number of values of a robot's command, after its state.
        simulation: Parameters of the simulation, see `sensors.simulation.Simulation`; None without
            one.
    """

    name: str
    height: int
    width: int
    fps: float
    area_mm: tuple[float, float] | None
    force_scale: tuple[float, float, float]
    markers: bool = False
    dome: bool = False
    kind: Literal["image", "array", "wrench", "robot"] = "image"
    states: int = 0
    actions: int = 0
    simulation: Simulation | None = None


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
        >>> from tactileforge.plugin import ArrayFrames
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
class Frame:
    """One frame of a live sensor; its content depends on `SensorSpec.kind`.

    Attributes:
        array: uint8 (H, W, 3), RGB. For an ``array`` sensor its taxels, drawn by its layout: red,
            green and blue are x, y and z, and 128 is the value without contact (`sensors.taxels`).
            Empty, (0, 0, 3), for a ``wrench`` or ``robot``.
        time: Time of capture, monotonic seconds (``time.monotonic()``).
        raw: float32, the values as the sensor gave them: for a ``wrench`` sensor (6,), forces x, y,
            z in N and torques x, y, z in N m; for an ``array`` sensor (taxels, values of each); for
            a ``robot`` (states + actions,), its state and the command that follows it; None for an
            ``image`` sensor.

    Example:
        >>> import numpy as np
        >>> frame = Frame(array=np.zeros((240, 320, 3), np.uint8), time=12.5)
        >>> frame.array.shape, frame.raw is None
        ((240, 320, 3), True)
    """

    array: NDArray[np.uint8]
    time: float
    raw: NDArray[np.float32] | None = None


@runtime_checkable
class Sensor(Protocol):
    """A live sensor: a camera, taxel array, wrench sensor or robot, as its ``spec.kind`` says.

    A sensor is a context manager, and closes on an exception. It needs no thread of its own:
    recorders and viewers read it in a thread of theirs, and open it again after a `SensorError`.
    `open` must therefore work after `close`. A sensor that is zeroed in `open` also has ``reopen``,
    which is then called in its place and keeps the zero.

    A class that inherits from this one is opened and closed by ``with`` without further code.

    A sensor may have an ``address``, a string with the open device, for example ``/dev/video2``;
    "" while none is open. Two open sensors must not have the same address. It may also have a
    ``unit``, the serial number of the open device, which does not depend on the port.

    Example:
        >>> import numpy as np
        >>> from tactileforge.plugin import spec
        >>> class Still(Sensor):
        ...     spec = spec("digit")
        ...     def discover(self):
        ...         return ["still"]
        ...     def open(self):
        ...         pass
        ...     def read(self, timeout=1.0):
        ...         return Frame(array=np.full((320, 240, 3), 110, np.uint8), time=0.0)
        ...     def close(self):
        ...         pass
        >>> with Still() as sensor:
        ...     sensor.read().array.shape
        (320, 240, 3)
    """

    spec: SensorSpec

    def discover(self) -> list[str]:
        """Addresses of the attached devices; [] where there are none."""
        ...

    def open(self) -> None:
        """Claims the device.

        Raises:
            SensorError: The device is absent, busy, or not the one asked for.
            ConfigError: An option is missing or wrong.
        """
        ...

    def read(self, timeout: float = 1.0) -> Frame:
        """Returns the next unread frame.

        Raises:
            TactileForgeError: The sensor is not open.
            SensorError: The device is gone; it may be opened again.
            TimeoutError: No new frame came within ``timeout`` seconds.
            EOFError: A finite source has ended.
        """
        ...

    def close(self) -> None:
        """Releases the device; a second call does nothing."""
        ...

    def __enter__(self) -> Self:
        self.open()
        return self

    def __exit__(self, *error: object) -> None:
        self.close()


@dataclass(frozen=True, kw_only=True)
class Guess:
    """A format recognised in a folder or file, and the options to read it.

    A data set may have ``recognise(root: Path) -> Guess | None``, a static method. It looks at
    names, headers and at most a few small files, executes nothing, raises nothing for foreign
    files, and returns None for them.

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
    read. ``notes``, if there is one, gets a line for each recording that was read with doubt.

    A large data set may also have ``sources(split)``, see `data.batches.sources.Sharded`: it is
    then opened part by part while it is read, and not as a whole.

    Example:
        >>> from tactileforge.plugin import build
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


@dataclass(frozen=True)
class Features:
    """Output of an encoder on a full view.

    Attributes:
        tokens: float (B, L, width), the last hidden state; prefix tokens first, patches after.
        cls: float (B, projected), the projected class token.
        prefix: Number of tokens before the patches.
        grid: Temporal slots, rows, columns of the patches.

    Example:
        >>> import torch
        >>> seen = Features(torch.zeros(2, 1 + 2 * 4 * 4, 192), torch.zeros(2, 256), 1, (2, 4, 4))
        >>> seen.tokens[:, seen.prefix :].unflatten(1, seen.grid).shape
        torch.Size([2, 2, 4, 4, 192])
    """

    tokens: Tensor
    cls: Tensor
    prefix: int
    grid: tuple[int, int, int]


@dataclass(frozen=True)
class MaskedFeatures:
    """Output of an encoder on a view with masked tubes.

    Attributes:
        tokens: float (B, prefix + slots * K, projected), projected visible tokens.
        cls: float (B, projected), the projected class token.
        kept: int64 (B, K), spatial positions that are visible, the same in every slot.
        masked: int64 (B, M), the other positions, ascending.
        prefix: Number of tokens before the patches.
        grid: Temporal slots, rows, columns.

    Example:
        >>> import torch
        >>> kept, masked = torch.tensor([[0, 3]]), torch.tensor([[1, 2]])
        >>> tokens = torch.zeros(1, 1 + 2 * 2, 192)
        >>> seen = MaskedFeatures(tokens, torch.zeros(1, 192), kept, masked, 1, (2, 2, 2))
        >>> seen.masked.shape[1] / (seen.grid[1] * seen.grid[2])
        0.5
    """

    tokens: Tensor
    cls: Tensor
    kept: Tensor
    masked: Tensor
    prefix: int
    grid: tuple[int, int, int]


class Views(Protocol):
    """One batch seen by an encoder; each view is computed once, at its first use."""

    @property
    def patches(self) -> Tensor:
        """Float (B, slots, N, 3 * tube * patch * patch): the normalised frames, in patches."""
        ...

    @property
    def full(self) -> Features:
        """Features of the full view: every patch is visible."""
        ...

    @property
    def masked(self) -> MaskedFeatures:
        """Features of the masked view: masked patches are not embedded."""
        ...


class Encoder(Protocol):
    """A touch encoder (a ``torch.nn.Module``). It owns its preprocessing and its sensor table.

    Attributes:
        width: Size of a token.
        projected: Size of a projected token.
        frames: Frames of a clip (T).
        image_size: Height and width of its input.
        tube: Frames of a patch.
        patch: Rows and columns of a patch.
        prefix: Tokens before the patches.
        grid: Temporal slots, rows, columns.
        sensors: Row of each sensor name in the sensor table.
    """

    width: int
    projected: int
    frames: int
    image_size: tuple[int, int]
    tube: int
    patch: int
    prefix: int
    grid: tuple[int, int, int]
    sensors: dict[str, int]

    def views(self, batch: Batch, universal: float = 0.0) -> Views:
        """Starts the views of a batch; nothing is computed yet.

        Args:
            batch: Batch in the format of this module's table.
            universal: Chance that a sample takes the universal sensor tokens, 0 to 1.
        """
        ...

    def __call__(self, frames: Tensor, background: Tensor, sensor: Tensor) -> tuple[Tensor, Tensor]:
        """Tokens (B, L, width) and projected class tokens (B, projected) of a full view.

        Args:
            frames: uint8 (B, T, 3, H, W), any H and W.
            background: uint8 (B, 3, H, W).
            sensor: int64 (B,), rows of the sensor table.
        """
        ...


class Head(Protocol):
    """Maps features to a prediction (a ``torch.nn.Module``); ``head.K`` feeds ``objective.K``.

    A head may declare ``columns``, see `Column`, and gets their sizes if its constructor has the
    parameter ``column_sizes``. A head with the parameter ``facts`` may list in ``fixed_facts`` the
    facts of a data set that must be equal in its run and in the run it is initialised from.
    """

    def __call__(self, views: Views, batch: Batch) -> Any:
        """The prediction, in the format of the objective of the same name."""
        ...


@runtime_checkable
class AfterStep(Protocol):
    """A head or objective with state to update after each step, such as an EMA.

    Having the method is enough. The state (EMA copies, temperatures) is kept in buffers or frozen
    parameters, so that checkpoints hold it and a resumed run continues with it.
    """

    def after_step(self, encoder: Encoder, step: int, total: int) -> None:
        """Updates the state, before the first step (``step`` is 0) and after each optimiser step.

        Args:
            encoder: The touch encoder, with the weights of this step.
            step: Optimiser steps taken so far.
            total: Steps of the run.
        """
        ...


class TrainingClips(Protocol):
    """All clips of the training data, for the measurements of `Prepared`.

    An item is one row of a batch, decoded on access.
    """

    @property
    def recordings(self) -> Sequence[Recording]:
        """Recordings of the clips; only some for a source read window by window."""

    @property
    def strides(self) -> NDArray[np.int32]:
        """Stride of each recording: its frames from one frame of a clip to the next."""

    @property
    def scales(self) -> Mapping[str, tuple[float, float, float]]:
        """Divisor of forces along x, y and z, newton, by name of the sensor."""

    def __len__(self) -> int: ...

    def __getitem__(self, clip: int, /) -> dict[str, Any]: ...


@runtime_checkable
class Remembering(Protocol):
    """Clips with the tokens of a frozen encoder in place of frames (`Dataset`'s ``cut``).

    Having the method is enough.
    """

    def remember(self, encode: Callable[[Tensor, Tensor, Sequence[str]], Tensor]) -> None:
        """Computes the tokens of every clip once, before the first step of a run with ``freeze``.

        Args:
            encode: Function from frames uint8 (n, T, 3, H, W), backgrounds uint8 (n, 3, H, W) and
                names of sensors to tokens (n, L, width).
        """
        ...

    def __len__(self) -> int: ...


@runtime_checkable
class Prepared(Protocol):
    """A head or objective with measurements of its training data, made before a new run.

    Having the method is enough. The results are kept in buffers: a resumed run takes them from its
    checkpoint.
    """

    def prepare(self, clips: TrainingClips) -> None:
        """Measures the clips; called once, on every rank with the same ones.

        It must draw no random numbers.

        Args:
            clips: Clips of the training data.
        """
        ...


@runtime_checkable
class Scored(Protocol):
    """An objective with scores of a whole split, other than means over batches, such as R2.

    In validation the scores replace its further scalars, which are logged in training alone.
    """

    def sums(self, prediction: Any, batch: Batch) -> Tensor:
        """Sums of one batch, to be added over the batches of the split; float64 of any shape."""
        ...

    def scores(self, sums: Tensor) -> dict[str, float]:
        """Scores by name, from the sums of all batches; undefined ones are left out."""
        ...


class Objective(Protocol):
    """Maps a prediction and a batch to a loss (a ``torch.nn.Module``).

    ``head`` names the head it is used with unless the configuration says otherwise. ``needs`` lists
    labels among `Dataset.provides`; ``"text|image"`` asks for at least one of the two. The
    framework checks them against the data before the first step. An objective may declare
    ``columns``, see `Column`. An objective with ``pairs = True`` asks for a share of each batch to
    be drawn in pairs of one ``group``.
    """

    head: ClassVar[str]
    needs: ClassVar[frozenset[str]]

    def __call__(
        self, prediction: Any, batch: Batch
    ) -> tuple[Tensor | Mean, Mapping[str, Tensor | Mean]]:
        """The loss, and further scalars to log by name.

        In validation a `means.Mean`, as returned by `distributed.masked_mean`, is weighted by its
        number of labels, and left out without any. A tensor is a scalar, and is weighted by the
        number of clips in the batch.
        """
        ...


class OptimizerPlugin(Protocol):
    """Options of an optimiser, with the method to build it.

    The constructor's parameters are the keys of ``optim``, in addition to ``warmup``, ``schedule``
    and ``clip``, which every optimiser has.
    """

    def build(
        self, parameters: Sequence[tuple[str, nn.Parameter]], fused: bool
    ) -> torch.optim.Optimizer:
        """Builds the optimiser of a run.

        Args:
            parameters: Names and trained parameters, in a fixed order.
            fused: Whether a step may be one kernel; False with a gradient scaler.

        Returns:
            A single optimiser. The schedule multiplies the learning rate of each group by the same
            factor.
        """
        ...
