"""Contracts of sensors, data sets, encoders, heads and objectives, for plugin authors.

A plugin is a class. Its constructor parameters are explicit, their defaults are plain data (they
become the plugin's configuration), constructing does no I/O, and the module imports no vendor SDK
at top level. Parameters named in `CONTEXT` are not configuration: the framework passes them in.

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
| `force_scale` | float32 (B, 3) | newton that count as 1, from the `SensorSpec` |
| `action` | int64 (B,) | index into `ACTIONS`; -1 unknown |
| `object` | int64 (B,) | identity across sensors; -1 unknown |
| `text` | list of B strings | "" where there is none |
| `image` | uint8 (B, 3, h, w), `image_valid` bool (B,) | paired camera image |
| `surface` | uint8 (B, T, 3, 32, 32), `surface_valid` bool (B,) | see `data.labels.displacement` |
| `group` | int64 (B,) | samples with one non-negative group were drawn together for matching |

A sample without a label stays out of that objective's loss, and changes nothing in it.

Heads and objectives may declare extra columns (`Column`), which are cut from tracks of the
recordings:

| key | type and shape | meaning |
|---|---|---|
| NAME | float32 or int64 (B, steps, ...) | the track at the clip's frames, or in a window |
| NAME `_valid` | bool (B, steps) | False without the track, at NaN, outside of the recording |

A data set that cuts its recordings in a way of its own may give further keys, as its `provides`
says, and ``tokens``, float16 (B, touches of a sample, L, width), of a frozen encoder in place of
frames (`Remembering`).
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

#: Labels of a batch: what a data set may provide, and an objective may need.
LABELS = ("force", "action", "object", "text", "image", "surface")

#: Keys of every batch, which no column may have.
BATCH_KEYS = frozenset(
    {
        *("frames", "background", "sensor", "group", "clip", "skipped", "paired", "tokens"),
        *("force", "force_valid", "force_scale", "action", "object", "text"),
        *("image", "image_valid", "surface", "surface_valid", "flip", "coded"),
    }
)

#: Axes of a force, in the order of its columns.
AXES = ("x", "y", "z")

#: A background of this value, subtracted and offset by 130/255, leaves a frame as it is.
NEUTRAL_BACKGROUND = 130

#: Constructor parameters that the framework fills in; they never appear in a configuration.
CONTEXT = frozenset(
    {"encoder", "text_encoder", "image_encoder", "teacher", "column_sizes", "facts"}
)


@dataclass(frozen=True, kw_only=True)
class SensorSpec:
    """A type of sensor, as data. A live driver, a data set and an encoder refer to it by name.

    Attributes:
        name: The word users type.
        height: Rows of a frame as the sensor gives it; 0 for a wrench or robot.
        width: Columns of a frame; 0 for a wrench or robot.
        fps: Frames, or samples, per second that really arrive.
        area_mm: Height and width of the sensing area, mm; None where it is not public.
        force_scale: Newton per axis (x, y, z) that count as 1; forces are normalised by it.
        markers: Whether the gel carries markers.
        dome: Whether the gel is domed (else flat).
        kind: What `Frame` carries: ``image`` pixels of a camera; ``array`` taxels, drawn as pixels,
            and their values; ``wrench`` forces and torques alone; ``robot`` its state and action.
        states: Values of a robot that are its state; they come first.
        actions: Values of a robot that are the command after that state.
        simulation: How it is simulated, see `sensors.simulation.Simulation`; None if it is not.
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
    """Lazy frames of one recording: decoded only when they are read."""

    def __len__(self) -> int:
        """The number of frames."""
        ...

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width."""
        ...

    def read(self, indices: Sequence[int]) -> NDArray[np.uint8]:
        """Decodes the frames asked for, in that order.

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
    """One continuous touch by one sensor, with everything that its source provides.

    Attributes:
        key: Unique within its data set.
        sensor: Name of a `SensorSpec`.
        frames: Lazy frames.
        times: float64 (T,), seconds, strictly increasing.
        no_contact: Frames without contact, whose median is the background; None where the source
            has none and says so (then nothing is subtracted).
        force: float32 (T, 3), newton; NaN is no label: a frame without any is a row of NaN, and a
            source that knows z alone has NaN in x and y.
        action: int64 (T,), index into `ACTIONS`, -1 unknown.
        object: Name of what is touched, the same for every sensor that touches it.
        text: Caption; ``{action}`` in it stands for the action of the clip.
        image: Paired camera image.
        image_times: float64, seconds on the clock of ``times``, ascending, one for each view; None
            where they are spread evenly over the recording.
        surface: Displacement of the gel's surface, an image a frame; see `displacement`.
        labels: Whatever else is known, by name.
        tracks: Whatever else is known per frame: arrays (T, ...) by name.
        source: Where the recording comes from.
        tier: Tier of the tactile dynamic pyramid, 1 (force) to 5 (static).
        licence: SPDX identifier, or the plain words where there is none.
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
        """Median time between frames, s; 0 where there is one frame."""
        return float(np.median(np.diff(self.times))) if len(self.times) > 1 else 0.0

    def background(self) -> NDArray[np.uint8] | None:
        """Decodes the frames without contact: their median, uint8 (H, W, 3); None without any.

        Raises:
            DataError: A frame cannot be decoded.
        """
        if self.no_contact is None:
            return None
        frames = self.no_contact.read(range(len(self.no_contact)))
        median: NDArray[np.uint8] = np.median(frames, axis=0).astype(frames.dtype)
        return median

    def select(self, rows: Sequence[int]) -> Recording:
        """Some frames with all that is known per frame; background and camera views stay.

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
    """An extra column of the batch, which a head or objective declares.

    Its class attribute ``columns`` is a tuple of them, or a function of its options (a static
    method) that gives one. Flips of a clip do not change it.

    Attributes:
        name: Key of the batch; ``NAME_valid``, bool (B, steps), says which steps are labelled.
        track: Of `Recording.tracks`; "" for the one of this name.
        window: Steps of the recording, from the first to the one after the last, counted from the
            last frame of the clip: ``(0, 8)`` is a chunk of that frame and the seven after it,
            ``(-1, 1)`` the one before it and itself. None takes the frames of the clip.
        dtype: Of the batch.
        statistics: Whether mean and deviation over the training data are measured.
    """

    name: str
    track: str = ""
    window: tuple[int, int] | None = None
    dtype: Literal["float32", "int64"] = "float32"
    statistics: bool = False


@dataclass(frozen=True, kw_only=True)
class ColumnSize:
    """What a head is told of a column, in its parameter ``column_sizes``: a mapping by name.

    Attributes:
        shape: Of one step.
        mean: Over all steps of the training data, flat; None where it was not asked for.
        deviation: Alike.
    """

    shape: tuple[int, ...]
    mean: tuple[float, ...] | None = None
    deviation: tuple[float, ...] | None = None


@dataclass(frozen=True)
class FrameSubset:
    """Some frames of other frames, still lazy.

    Attributes:
        base: The frames to take from.
        rows: Which of them, in order.
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
        """Decodes; see `Frames.read`."""
        return self.base.read([self.rows[i] for i in indices])


@dataclass(frozen=True, kw_only=True)
class Frame:
    """One frame of a live sensor; what it carries depends on `SensorSpec.kind`.

    Attributes:
        array: uint8 (H, W, 3), RGB. Of an ``array`` sensor its taxels, drawn by its layout: red,
            green and blue are x, y and z, and 128 is the value without contact (`sensors.taxels`).
            Of a ``wrench`` or ``robot`` empty, (0, 0, 3).
        time: Monotonic seconds (``time.monotonic()``) at which it was taken.
        raw: float32, the values as the sensor gave them: of a ``wrench`` sensor (6,), forces x, y,
            z in N and torques x, y, z in N m; of an ``array`` sensor (taxels, values of each); of a
            ``robot`` (states + actions,), its state and the command that follows it; None of an
            ``image`` sensor.
    """

    array: NDArray[np.uint8]
    time: float
    raw: NDArray[np.float32] | None = None


@runtime_checkable
class Sensor(Protocol):
    """A live sensor: a camera, taxel array, wrench sensor or robot, as its ``spec.kind`` says.

    Use it as a context manager; it closes on an exception. It needs no thread of its own: whoever
    records or shows it reads it in one, and opens it again after a `SensorError`. So `open` works
    again after `close`. A sensor that takes a zero in `open` has a ``reopen`` too, which is called
    then in its place and keeps the zero.

    A class that inherits from this one is opened and closed by ``with`` as it stands.

    A sensor may have an ``address``, a string: which device is open, for example
    ``/dev/video2``, "" while none is. Two open sensors must not have the same. It may also have a
    ``unit``, the serial number of the open device, which it keeps wherever it is plugged in.
    """

    spec: SensorSpec

    def discover(self) -> list[str]:
        """Addresses of the attached devices; [] where there are none."""
        ...

    def open(self) -> None:
        """Claims the device.

        Raises:
            SensorError: It is absent, busy, or not what was asked for.
            ConfigError: An option is missing or wrong.
        """
        ...

    def read(self, timeout: float = 1.0) -> Frame:
        """Returns the next unread frame.

        Raises:
            TactileForgeError: The sensor is not open.
            SensorError: The device is gone; it may be opened again.
            TimeoutError: No new frame within ``timeout`` seconds.
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


@runtime_checkable
class Dataset(Protocol):
    """A reader: yields recordings, and declares their labels.

    ``provides`` holds batch keys, of `LABELS`. One that cuts its recordings in a way of its own has
    ``cut``, which is called like `data.batches.clips.Clips`; what it returns may have ``provides``,
    further keys of its samples, and ``facts``, plain data by name that heads are given as ``facts``
    and a run keeps in its configuration.
    ``skipped`` grows as `recordings` meets files it cannot read: one line each, which names the
    file. ``notes``, where there is one, likewise grows by lines on recordings that are read, and
    may be read wrongly.

    A large data set may also have ``sources(split)``, see `data.batches.sources.Sharded`: it is
    then opened part by part while it is read, and not as a whole.
    """

    skipped: list[str]

    @property
    def provides(self) -> frozenset[str]:
        """Batch keys of the labels that at least one recording may carry."""
        ...

    def recordings(self, split: str) -> Iterable[Recording]:
        """The recordings of a split (``train`` or ``val``), in an order that never changes.

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
    """

    tokens: Tensor
    cls: Tensor
    kept: Tensor
    masked: Tensor
    prefix: int
    grid: tuple[int, int, int]


class Views(Protocol):
    """One batch seen by an encoder; each view is computed once, when first asked for."""

    @property
    def patches(self) -> Tensor:
        """Float (B, slots, N, 3 * tube * patch * patch): the normalised frames, in patches."""
        ...

    @property
    def full(self) -> Features:
        """Every patch is seen."""
        ...

    @property
    def masked(self) -> MaskedFeatures:
        """Masked patches are not embedded."""
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
            batch: See the table above.
            universal: Chance that a sample is given the universal sensor tokens.
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
    """Features to a prediction (a ``torch.nn.Module``); ``head.K`` feeds ``objective.K``.

    It may declare ``columns``, see `Column`, and is given their sizes where its constructor has the
    parameter ``column_sizes``. One that asks for ``facts`` of a data set may name in
    ``fixed_facts`` those that have to be the same in a run that it starts from.
    """

    def __call__(self, views: Views, batch: Batch) -> Any:
        """The prediction: whatever the objective of the same name understands."""
        ...


@runtime_checkable
class AfterStep(Protocol):
    """A head or objective with state that is updated after each step, such as an EMA.

    Having the method is enough. What it changes (EMA copies, temperatures) are buffers or frozen
    parameters, so that checkpoints keep them and a resumed run goes on with them.
    """

    def after_step(self, encoder: Encoder, step: int, total: int) -> None:
        """Called before the first step (``step`` is 0), and after each optimiser step.

        Args:
            encoder: The touch encoder, with the weights of this step.
            step: Optimiser steps taken so far.
            total: Steps of the run.
        """
        ...


class TrainingClips(Protocol):
    """All clips that are cut from the training data, as `Prepared` is given them.

    An item is one row of a batch, decoded when it is asked for.
    """

    @property
    def recordings(self) -> Sequence[Recording]:
        """Recordings that are cut; some of those of a source that is read window by window."""

    @property
    def strides(self) -> NDArray[np.int32]:
        """Of each recording: its frames from one frame of a clip to the next."""

    @property
    def scales(self) -> Mapping[str, tuple[float, float, float]]:
        """Newton along x, y and z that count as 1, by sensor."""

    def __len__(self) -> int: ...

    def __getitem__(self, clip: int, /) -> dict[str, Any]: ...


@runtime_checkable
class Remembering(Protocol):
    """Clips that hold the tokens of a frozen encoder in place of frames (`Dataset`'s ``cut``).

    Having the method is enough.
    """

    def remember(self, encode: Callable[[Tensor, Tensor, Sequence[str]], Tensor]) -> None:
        """Computes the tokens of every clip once; called before the first step where ``freeze``.

        Args:
            encode: Tokens (n, L, width) of frames uint8 (n, T, 3, H, W), backgrounds
                (n, 3, H, W) and names of sensors.
        """
        ...

    def __len__(self) -> int: ...


@runtime_checkable
class Prepared(Protocol):
    """A head or objective that measures its training data before the first step of a new run.

    Having the method is enough. What it finds are buffers: a resumed run takes them from its
    checkpoint.
    """

    def prepare(self, clips: TrainingClips) -> None:
        """Called once, on every rank with the same clips; draws no random numbers.

        Args:
            clips: Those of the training data.
        """
        ...


@runtime_checkable
class Scored(Protocol):
    """An objective with scores of a whole split that are not means over batches, such as R2.

    In validation they take the place of its further scalars, which are logged in training.
    """

    def sums(self, prediction: Any, batch: Batch) -> Tensor:
        """Sums of one batch that add up over batches and ranks; float64 of any shape."""
        ...

    def scores(self, sums: Tensor) -> dict[str, float]:
        """Scores by name, from the sums of all batches; one that has no value is left out."""
        ...


class Objective(Protocol):
    """A prediction and a batch to a loss (a ``torch.nn.Module``).

    ``head`` names the head it is used with unless the configuration says otherwise. ``needs`` lists
    labels among `Dataset.provides`; ``"text|image"`` asks for at least one of the two. The
    framework checks them against the data before the first step. It may declare ``columns``, see
    `Column`. An objective with ``pairs = True``
    asks for a share of each batch to be drawn in pairs of one ``group``.
    """

    head: ClassVar[str]
    needs: ClassVar[frozenset[str]]

    def __call__(
        self, prediction: Any, batch: Batch
    ) -> tuple[Tensor | Mean, Mapping[str, Tensor | Mean]]:
        """The loss, and further scalars to log by name.

        A `means.Mean`, as `distributed.masked_mean` returns it, counts by its labels in validation,
        and is absent where there are none. A tensor is a scalar, and counts by the clips of the
        batch.
        """
        ...


class OptimizerPlugin(Protocol):
    """Options of an optimiser, and what builds it.

    The constructor's parameters are the keys of ``optim``, beside ``warmup``, ``schedule`` and
    ``clip``, which every optimiser has.
    """

    def build(
        self, parameters: Sequence[tuple[str, nn.Parameter]], fused: bool
    ) -> torch.optim.Optimizer:
        """Builds the optimiser of a run.

        Args:
            parameters: Names and parameters that are trained, in a fixed order.
            fused: Whether a step may be one kernel; not with a scaler of gradients.

        Returns:
            A single optimiser. Its learning rate is scaled by the schedule, in each group alike.
        """
        ...
