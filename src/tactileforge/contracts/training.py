"""Contracts of a training: batches, encoders, heads, objectives, optimizers."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import (
    TYPE_CHECKING,
    Any,
    ClassVar,
    Protocol,
    TypeAlias,
    runtime_checkable,
)

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    import torch
    from torch import Tensor, nn

    from tactileforge.contracts.data import Recording
    from tactileforge.util.means import Mean


Batch: TypeAlias = dict[str, Any]


#: Keys of the batch itself: no column may use one as its name.
BATCH_KEYS = frozenset(
    {
        *("frames", "background", "sensor", "group", "clip", "skipped", "paired", "tokens"),
        *("force", "force_valid", "force_scale", "action", "object", "text"),
        *("image", "image_valid", "surface", "surface_valid", "aspect", "upright"),
        *("flip", "coded", "warp", "warp_turn", "relight"),  # added where clips are augmented
    }
)


#: Constructor parameters that the framework fills in; they never appear in a configuration.
CONTEXT = frozenset(
    {"encoder", "text_encoder", "image_encoder", "teacher", "column_sizes", "facts"}
)


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

    def other(self, batch: Batch, kept: Tensor | None = None) -> Views:
        """Views of one's own by the same encoder, each a further pass of it.

        A second crop is ``views.other({**batch, "frames": crop}).full``, another mask
        ``views.other(batch, kept).masked``.

        Args:
            batch: Batch with frames uint8 (B, T, 3, H, W) of any size, background, sensor.
            kept: int64 (B, K), spatial positions that ``masked`` shows, each once in a row; None
                for a new draw.

        Raises:
            TactileForgeError: The tokens were computed once, or ``kept`` does not fit.
        """
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
    parameter ``column_sizes``. It may name the views that it reads in ``reads``, ``full`` or
    ``masked``: where a step reads both, the encoder computes them in one pass. A head with the
    parameter ``facts`` may list in ``fixed_facts`` the facts of a data set that must be equal in
    its run and in the run it is initialised from.
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
class Ramped(Protocol):
    """An objective with a curve of its own for its weight.

    Having the method is enough. A row of the curriculum for the objective goes before it.
    """

    def ramp(self, share: float) -> float:
        """Factor of the weight, 0 or more, at a share of the run's steps, 0 to 1."""
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
