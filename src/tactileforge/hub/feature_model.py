"""An encoder with its preprocessing: clips in, vectors and tokens out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import chain
from typing import Any, Literal

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from tactileforge.encoders.summary import summary_width
from tactileforge.errors import ConfigError
from tactileforge.hub.cards import Card
from tactileforge.hub.forces import warn_of_light
from tactileforge.hub.header import Header
from tactileforge.hub.inputs import (
    ClipInputs,
    Images,
    prepare_clips,
    squash_clips,
    squash_images,
    uses_background,
    warn_of_swapped_clips,
)
from tactileforge.hub.sensor_rows import Policy, name_each, row_each, takes_any_sensor
from tactileforge.hub.taps import Tap, check_tap, read_tap


class FeatureModel(nn.Module):
    """Encoding of clips, as base of `hub.model.Model`; see there for arguments and attributes."""

    def __init__(
        self,
        encoder: Any,
        header: Header,
        card: Card | None = None,
        device: str | torch.device = "cpu",
        heads: Mapping[str, nn.Module] | None = None,
    ) -> None:
        super().__init__()
        self.encoder = encoder
        self.header = header
        self.card = card
        self.heads = nn.ModuleDict(dict(heads or {}))
        self.frames: int = encoder.frames
        self.projected: int = encoder.projected
        if hasattr(encoder, "unknown_sensor"):
            encoder.unknown_sensor = "error"  # the policy is an argument of `encode`
        self._any_sensor = takes_any_sensor(encoder)
        # checked first: a move that fails would leave a part of the weights behind
        self.to(check_device(device)).eval()

    @property
    def device(self) -> torch.device:
        """Device of its weights."""
        # int8 layers have buffers alone, and raw pixels have neither
        first = next(chain(self.encoder.parameters(), self.encoder.buffers()), torch.empty(0))
        return first.device

    @property
    def sensors(self) -> list[str]:
        """Sensors in its training; it takes others where ``any_sensor`` is true."""
        return list(self.encoder.sensors)

    @property
    def any_sensor(self) -> bool:
        """Whether it ignores the sensor type: every sensor is encoded alike, named or not."""
        return self._any_sensor

    @property
    def spacing(self) -> float:
        """Seconds between the frames of a clip; 0 for one frame."""
        return self.header.spacing

    @property
    def recipe(self) -> dict[str, Any]:
        """The resolved recipe of its training; empty for imported weights."""
        return self.header.recipe

    @property
    def squashed(self) -> tuple[int, int] | None:
        """Height and width of squashed frames in its training, before any resizing by the encoder.

        None for imported weights: their encoder was trained on frames of any size.
        """
        size: tuple[int, int] = self.encoder.image_size
        return size if self.recipe else None

    @property
    def reading(self) -> Literal["summary", "projected"]:
        """Vector of `encode` without groups: ``summary``; ``projected`` of imported weights.

        A linear probe on the summary of a model trained here reads more than on its projected class
        token (on real touches .736 against .681, and .510 against .425 held out; see
        docs/reports/gate.md). Imported weights give the vector that their authors use.
        """
        return "summary" if self.recipe else "projected"

    @property
    def vector_size(self) -> int:
        """Length of a vector of `encode`."""
        return summary_width(self.encoder) if self.reading == "summary" else self.projected

    def squash(self, images: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Images as training showed them to the encoder; `encode` and the others do it themselves.

        Args:
            images: uint8 (..., H, W, 3).
        """
        return squash_images(images, self.squashed)

    def __repr__(self) -> str:
        size = sum(x.numel() for x in self.encoder.state_dict().values()) / 1e6  # int8 is a buffer
        return (
            f"Model({self.header.name or self.header.encoder['name']}: {size:.1f} M parameters, "
            f"{self.frames} frames {self.spacing:.3g} s apart, vectors of {self.vector_size})"
        )

    def forward(
        self,
        frames: Images,
        background: Images | str | None = None,
        sensor: str | Sequence[str] | None = None,
        *,
        tap: Tap = "projected",
        unknown_sensor: Policy = "error",
    ) -> Tensor:
        """Encodes all clips at once, with gradients if they are enabled: ``model(clips, ...)``.

        Args:
            frames: Clips, uint8, RGB, in the shapes of `encode`.
            background: Frame without contact, or a word in its place, as in `encode`.
            sensor: Name of the sensor, or one name a clip, as in `encode`.
            tap: Name of a tap, as in `features`.
            unknown_sensor: Policy for unknown sensors: ``error`` or ``universal``, as in `encode`.

        Returns:
            Features of the tap, float32; shapes as in `features`.

        Raises:
            DataError: Frames or background are not what the model takes.
            ConfigError: No background, no such sensor, or no such tap of this encoder.
        """
        check_tap(self.encoder, tap)
        x, still, single = self._prepare(frames, background)
        rows = self._rows(self._names(sensor, len(x)), unknown_sensor)
        out = self._read(tap, x, still, rows).float()
        return out[0] if single else out

    def features(
        self,
        frames: Images,
        background: Images | str | None = None,
        sensor: str | Sequence[str] | None = None,
        *,
        tap: Tap = "tokens",
        unknown_sensor: Policy = "error",
        batch_size: int = 32,
    ) -> Tensor:
        """Features of clips at one of the encoder's taps.

        Args:
            frames: Clips, uint8, RGB, in the shapes of `encode`.
            background: Frame without contact, or a word in its place, as in `encode`.
            sensor: Name of the sensor, or one name a clip, as in `encode`.
            tap: ``tokens`` (L, width), as the encoder's authors use them: prefix tokens, then
                patches in order of slot, row, column. ``cls`` (width,), the class token among them.
                ``patches`` (slots, rows, columns, width), the others by their places. ``projected``
                (projected,), the vector compared with words, by heads of classes and by the
                authors' probes. ``hidden`` and ``normed`` (L, width), the last hidden state before
                and after the last norm; ``projected_tokens`` (L, projected), ``normed`` through the
                projection. ``global`` (projected,), the mean of all patches,
                projected without the norm (AnyTouch 1). ``summary`` (n,), means in the quarters of
                the image and deviations of the patches of up to four blocks; `encode` gives it,
                scaled, of a model trained here. See `encode_summary`.
            unknown_sensor: Policy for unknown sensors: ``error`` or ``universal``, as in `encode`.
            batch_size: Clips that are computed at once.

        Returns:
            float32, with B in front for a batch.

        Raises:
            DataError: Frames or background are not what the model takes.
            ConfigError: See `encode`; or the encoder has no class token, or no last norm.
        """
        return self._tapped(tap, frames, background, sensor, unknown_sensor, batch_size)

    def _tapped(self, tap: Tap, *clips: Any) -> Tensor:
        """Reads a tap, as `features` does; ``clips`` are the arguments of `_batches`."""
        check_tap(self.encoder, tap)
        batches, single = self._batches(*clips)
        with torch.no_grad():
            out = torch.cat([self._read(tap, *batch).float() for batch in batches])
        return out[0] if single else out

    def _batches(
        self,
        frames: Images,
        background: Images | str | None,
        sensor: str | Sequence[str] | None,
        unknown_sensor: Policy,
        batch_size: int,
    ) -> tuple[list[tuple[Tensor, Tensor, Tensor]], bool]:
        """Frames, backgrounds and sensor rows, batch by batch; and whether it was one clip.

        Warns of changed light, in the name of the caller of the public method.
        """
        check_batch_size(batch_size)
        x, still, single = clips = self._prepare(frames, background)
        # 5: past this, `_tapped` or `_grouped`, and the public method, to the line that called it
        warn_of_light("clips", clips, self.encoder, background, stacklevel=5)
        rows = self._rows(self._names(sensor, len(x)), unknown_sensor)
        parts = [torch.split(part, batch_size) for part in (x, still, rows)]
        return list(zip(*parts, strict=True)), single

    def compile(self, *args: Any, **kwargs: Any) -> None:
        """Compiles the preprocessing and the blocks used by `encode`, `force` and all methods.

        The first call after it, and the first call with each other batch size, takes a minute.

        Args:
            *args: No positional arguments; options have names.
            **kwargs: Options of `torch.compile`.

        Raises:
            ConfigError: The encoder has no blocks to compile: it is not one of ours.
        """
        from tactileforge.compiled import compile_blocks

        if not compile_blocks(self, *args, **kwargs):
            raise ConfigError(
                f"the encoder {self.header.encoder.get('name')} has no blocks to be compiled; "
                "leave compile() out, or compile parts of model.encoder by torch.compile"
            )

    def _prepare(
        self, frames: Images, background: Images | str | None, check: bool = True
    ) -> ClipInputs:
        """Frames and backgrounds of a batch, uint8, as in training; whether it was one clip."""
        clips = prepare_clips(frames, background, self.frames, uses_background(self.encoder))
        # a background that is taken from the clip has its order of colors
        if check and not (background is None or isinstance(background, str)):
            warn_of_swapped_clips(clips)
        return squash_clips(clips, self.squashed)

    def _read(self, tap: str, frames: Tensor, background: Tensor, rows: Tensor) -> Tensor:
        """The encoder's output at a tap."""
        inputs = [part.to(self.device) for part in (frames, background, rows)]
        return read_tap(self.encoder, tap, *inputs)

    def _pass(self, frames: Tensor, background: Tensor, rows: Tensor) -> tuple[Tensor, Tensor]:
        """Tokens and projected class tokens."""
        inputs = [part.to(self.device) for part in (frames, background, rows)]
        out: tuple[Tensor, Tensor] = self.encoder(*inputs)
        return out

    def _names(self, sensor: str | Sequence[str] | None, count: int) -> list[str]:
        return name_each(sensor, count, list(self.encoder.sensors), self._any_sensor)

    def _rows(self, names: Sequence[str], policy: Policy) -> Tensor:
        return row_each(self.encoder, names, policy, self._any_sensor)


def check_batch_size(batch_size: int) -> None:
    """Raises a ConfigError unless it is a whole number of clips, 1 or more."""
    if not isinstance(batch_size, int) or isinstance(batch_size, bool) or batch_size < 1:
        raise ConfigError(f"batch_size={batch_size!r}: give a whole number of clips, 1 or more")


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
