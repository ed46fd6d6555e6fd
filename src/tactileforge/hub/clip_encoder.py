"""An encoder with its preprocessing: clips in, features out."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import cached_property
from itertools import chain
from typing import Any, Literal

import torch
from torch import Tensor

from tactileforge.encoders.feature_groups import check_groups, encode_groups, joint_vector
from tactileforge.encoders.summary import encode_summary, summary_width
from tactileforge.errors import ConfigError
from tactileforge.hub.clips import GivenClips, check_batch_size
from tactileforge.hub.forces import warn_of_light
from tactileforge.hub.inputs import (
    ClipInputs,
    prepare_clips,
    squash_clips,
    uses_background,
    warn_of_swapped_clips,
)
from tactileforge.hub.sensor_rows import name_each, row_each, takes_any_sensor
from tactileforge.hub.taps import Tap, check_tap, read_layers, read_tap
from tactileforge.util.threads import few_threads

#: Parameters times frames of the largest batch that one thread computes within a frame of 30 Hz.
_SMALL = 12_000_000


class ClipEncoder:
    """Features of users' clips: checked, prepared as in training, encoded batch by batch.

    Args:
        encoder: A touch encoder; see `contracts.Encoder`.
        trained_here: Whether it has a recipe; imported weights have none.

    Attributes:
        encoder: The touch encoder.
        squashed: Height and width of squashed frames in its training; see `Model.squashed`.
        reading: Name of the tap of a clip's vector; see `Model.reading`.
    """

    def __init__(self, encoder: Any, trained_here: bool) -> None:
        self.encoder = encoder
        size: tuple[int, int] = encoder.image_size
        self.squashed = size if trained_here else None
        self.reading: Literal["summary", "projected"] = "summary" if trained_here else "projected"

    @cached_property
    def any_sensor(self) -> bool:
        """Whether it ignores the sensor type."""
        return takes_any_sensor(self.encoder)

    @property
    def device(self) -> torch.device:
        """Device of its weights."""
        # int8 layers have buffers alone, and raw pixels have neither
        first = next(chain(self.encoder.parameters(), self.encoder.buffers()), torch.empty(0))
        return first.device

    @property
    def vector_size(self) -> int:
        """Length of a clip's vector."""
        if self.reading == "summary":
            return summary_width(self.encoder)
        width: int = self.encoder.projected
        return width

    def prepare(self, clips: GivenClips, check: bool = True) -> ClipInputs:
        """Frames and backgrounds of a batch, uint8, as in training; whether it was one clip.

        Args:
            clips: The clips.
            check: Whether to warn of swapped colours.

        Raises:
            DataError: Frames or background are not what the encoder takes.
            ConfigError: No background, or an unknown word for it.
        """
        needed = uses_background(self.encoder)
        inputs = prepare_clips(clips.frames, clips.background, self.encoder.frames, needed)
        # a background that is taken from the clip has its order of colours
        if check and clips.checks and clips.background is not None and not clips.word:
            warn_of_swapped_clips(inputs)
        return squash_clips(inputs, self.squashed)

    def names(self, clips: GivenClips, count: int) -> list[str]:
        """Sensor name of each clip; see `sensor_rows.name_each` for errors."""
        return name_each(clips.sensor, count, list(self.encoder.sensors), self.any_sensor)

    def rows(self, clips: GivenClips, count: int) -> Tensor:
        """Rows of the sensor table; see `sensor_rows.row_each` for errors."""
        names = self.names(clips, count)
        return row_each(self.encoder, names, clips.unknown_sensor, self.any_sensor)

    def read(self, tap: str, *clips: Tensor) -> Tensor:
        """The encoder's output at a tap, for frames, backgrounds and sensor rows."""
        return read_tap(self.encoder, tap, *self._moved(clips))

    def run(self, *clips: Tensor) -> tuple[Tensor, Tensor]:
        """Tokens and projected class tokens, of frames, backgrounds and sensor rows."""
        out: tuple[Tensor, Tensor] = self.encoder(*self._moved(clips))
        return out

    def run_for_vector(self, *clips: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Tokens, projected class tokens, and the vectors of `Model.encode`, from one pass."""
        if self.reading == "projected":
            tokens, projected = self.run(*clips)
            return tokens, projected, projected.float()
        tokens, projected, summary = encode_summary(self.encoder, *self._moved(clips))
        return tokens, projected, self._scaled(summary)

    def vector(self, *clips: Tensor) -> Tensor:
        """The vectors of `Model.encode`, of frames, backgrounds and sensor rows."""
        return self._scaled(self.read(self.reading, *clips))

    def tapped(self, tap: Tap, clips: GivenClips, stacklevel: int = 4) -> Tensor:
        """Reads a tap, as `Model.features` does.

        Args:
            tap: Name of the tap.
            clips: The clips.
            stacklevel: Level of the caller of the public method, for warnings.
        """
        check_tap(self.encoder, tap)
        batches, single = self._batches(clips, stacklevel + 1)
        with self.computing(len(batches[0][0])):
            out = torch.cat([self.read(tap, *batch).float() for batch in batches])
        return out[0] if single else out

    def layered(self, layers: Sequence[int], clips: GivenClips) -> list[Tensor]:
        """Outputs of blocks, as `Model.features` gives them with ``layers``."""
        batches, single = self._batches(clips, 4)
        with self.computing(len(batches[0][0])):
            done = [read_layers(self.encoder, layers, *self._moved(batch)) for batch in batches]
        joint = [torch.cat(parts).float() for parts in zip(*done, strict=True)]
        return [x[0] for x in joint] if single else joint

    def grouped(
        self, names: Sequence[str] | None, clips: GivenClips, stacklevel: int = 4
    ) -> dict[str, Tensor]:
        """Reads groups, as `Model.groups` does.

        Args:
            names: Names of groups; None takes all.
            clips: The clips.
            stacklevel: Level of the caller of the public method, for warnings.
        """
        wanted = check_groups(self.encoder, names)
        batches, single = self._batches(clips, stacklevel + 1)
        with self.computing(len(batches[0][0])):
            moved = (self._moved(batch) for batch in batches)
            done = [encode_groups(self.encoder, x, still, rows, wanted) for x, still, rows in moved]
        joint = {name: torch.cat([part[name] for part in done]) for name in wanted}
        return {name: values[0] if single else values for name, values in joint.items()}

    def encoded(self, groups: Sequence[str] | Literal["all"] | None, clips: GivenClips) -> Tensor:
        """Vectors, as `Model.encode` gives them."""
        if groups is None and self.reading == "projected":
            return self.tapped("projected", clips, 5)
        names = ["summary"] if groups is None else None if groups == "all" else groups
        return joint_vector(self.grouped(names, clips, 5))

    def with_gradients(self, tap: Tap, clips: GivenClips) -> Tensor:
        """Reads a tap of all clips at once, as `Model.forward` does."""
        check_tap(self.encoder, tap)
        x, still, single = self.prepare(clips)
        out = self.read(tap, x, still, self.rows(clips, len(x))).float()
        return out[0] if single else out

    def _batches(self, clips: GivenClips, stacklevel: int) -> tuple[list[tuple[Tensor, ...]], bool]:
        """Frames, backgrounds and sensor rows, batch by batch; and whether it was one clip.

        Warns of changed light, in the name of the caller of the public method.
        """
        check_batch_size(clips.batch_size)
        x, still, single = inputs = self.prepare(clips)
        if clips.checks:
            warn_of_light("clips", inputs, self.encoder, clips.background, stacklevel=stacklevel)
        parts = [
            torch.split(part, clips.batch_size) for part in (x, still, self.rows(clips, len(x)))
        ]
        return list(zip(*parts, strict=True)), single

    @cached_property
    def _cost(self) -> int:
        """Parameters times frames, a measure of the work of a clip."""
        frames: int = self.encoder.frames
        return frames * sum(int(one.numel()) for one in self.encoder.parameters())

    @contextmanager
    def computing(self, clips: int) -> Iterator[None]:
        """Computes without gradients, and a few clips of a small encoder with one thread.

        Args:
            clips: Number of clips of a batch.
        """
        with torch.no_grad(), few_threads(clips * self._cost <= _SMALL):
            yield

    def _moved(self, clips: Sequence[Tensor]) -> list[Tensor]:
        return [part.to(self.device) for part in clips]

    def _scaled(self, vector: Tensor) -> Tensor:
        """Vectors of the tap `reading` as `Model.encode` gives them."""
        if self.reading == "projected":
            return vector.float()
        return joint_vector({"summary": vector.float()})


def check_device(device: str | torch.device) -> torch.device:
    """The device of a name.

    Raises:
        ConfigError: There is no such device on this machine.
    """
    try:
        parsed = torch.device(device)
        # torch.device takes names of absent devices, too: only using one tells
        torch.empty(0, device=parsed)
    except (RuntimeError, AssertionError, TypeError, NotImplementedError) as error:
        reason = str(error).strip().splitlines()[0]
        raise ConfigError(
            f"device={str(device)!r}: not on this machine ({reason}); give cpu, or cuda where "
            "torch.cuda.is_available()"
        ) from error
    return parsed
