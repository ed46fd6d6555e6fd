"""A model that is ready for use: uint8 frames in, vectors out."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Sequence
from itertools import islice
from pathlib import Path
from typing import Any, Literal

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from tactileforge.contracts import Frames
from tactileforge.errors import ConfigError, unknown
from tactileforge.hub.cards import Card
from tactileforge.hub.header import Header
from tactileforge.hub.inputs import Images, prepare
from tactileforge.hub.video import Times, cut, open_video

#: What to do with a sensor that the model never saw.
Policy = Literal["error", "universal"]
Tap = Literal["projected", "cls", "tokens"]


class Model:
    """An encoder in eval mode, with its preprocessing and what is known of it.

    It is frozen: `encode` keeps no gradients. The encoder itself can be trained like any module,
    after ``model.encoder.requires_grad_(True)``.

    Args:
        encoder: A touch encoder; see `contracts.Encoder`.
        header: Of its file.
        card: Of the zoo, where it has one.
        device: Where it computes.

    Attributes:
        encoder: The ``torch.nn.Module``.
        header: Of its file.
        card: Of the zoo, or None.
        frames: Frames of a clip, T.
        projected: Size of a vector.
    """

    def __init__(
        self,
        encoder: Any,
        header: Header,
        card: Card | None = None,
        device: str | torch.device = "cpu",
    ) -> None:
        self.encoder = encoder.to(device).eval()
        self.header = header
        self.card = card
        self.device = torch.device(device)
        self.frames: int = encoder.frames
        self.projected: int = encoder.projected
        if hasattr(encoder, "unknown_sensor"):
            encoder.unknown_sensor = "error"  # the policy is an argument of `encode`
        self._any_sensor = _takes_any_sensor(encoder)

    @property
    def sensors(self) -> list[str]:
        """The sensors that it knows; none where it does not tell them apart."""
        return [] if self._any_sensor else list(self.encoder.sensors)

    @property
    def spacing(self) -> float:
        """Seconds between the frames of a clip; 0 for one frame."""
        return self.header.spacing

    @property
    def recipe(self) -> dict[str, Any]:
        """The resolved recipe that trained it; empty for imported weights."""
        return self.header.recipe

    def __repr__(self) -> str:
        size = sum(p.numel() for p in self.encoder.parameters()) / 1e6
        return (
            f"Model({self.header.name or self.header.encoder['name']}: {size:.1f} M parameters, "
            f"{self.frames} frames {self.spacing:.3g} s apart, vectors of {self.projected})"
        )

    def encode(
        self,
        frames: Images,
        background: Images | str | None = None,
        sensor: str | Sequence[str] | None = None,
        *,
        unknown_sensor: Policy = "error",
        batch_size: int = 32,
    ) -> Tensor:
        """One vector a clip.

        Args:
            frames: uint8, RGB, oldest first, of any size: one clip (T, H, W, 3) or (T, 3, H, W), or
                a batch with B in front. numpy or torch.
            background: A frame without contact of the same recording, of the frames' size: one,
                or one a clip. ``"first"`` takes the first frame of each clip, ``"none"`` subtracts
                nothing. May be left out only where the model uses none.
            sensor: Name of the sensor, or one name a clip; ``"universal"`` takes the universal
                tokens. May be left out where the model knows one sensor, or none.
            unknown_sensor: ``error``, or ``universal`` to take the universal tokens, and warn.
            batch_size: Clips that are computed at once.

        Returns:
            float32 (projected,), or (B, projected) for a batch, on the model's device.

        Raises:
            DataError: Frames or background are not what the model takes; says both.
            ConfigError: No background, or no such sensor.
        """
        return self.features(
            frames,
            background,
            sensor,
            tap="projected",
            unknown_sensor=unknown_sensor,
            batch_size=batch_size,
        )

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
        """What the encoder makes of clips, at one of its taps.

        Args:
            frames: See `encode`.
            background: See `encode`.
            sensor: See `encode`.
            tap: ``tokens`` (L, width), the last hidden state: prefix tokens, then patches in order
                of slot, row, column. ``cls`` (width,), the class token among them. ``projected``
                (projected,), what `encode` gives.
            unknown_sensor: See `encode`.
            batch_size: See `encode`.

        Returns:
            float32, with B in front for a batch.

        Raises:
            DataError: See `encode`.
            ConfigError: See `encode`; or the encoder has no class token.
        """
        if tap not in ("tokens", "cls", "projected"):
            raise ConfigError(unknown("tap", tap, ("tokens", "cls", "projected")))
        if tap == "cls" and self.encoder.prefix == 0:
            raise ConfigError("the model has no class token: take tap=projected or tap=tokens")
        steps = getattr(self.encoder, "pixels", None)
        needed = getattr(steps, "offset", 0) is not None
        x, still, single = prepare(frames, background, self.frames, needed)
        rows = self._rows(sensor, len(x), unknown_sensor)
        parts = zip(*(torch.split(part, batch_size) for part in (x, still, rows)), strict=True)
        with torch.no_grad():
            out = torch.cat([self._tap(tap, *part) for part in parts])
        return out[0] if single else out

    def cut(
        self, video: str | Path | Frames, hop: float = 0.2, times: Times | None = None
    ) -> Iterator[tuple[float, NDArray[np.uint8]]]:
        """Cuts a video into clips as the model was trained on; reads one at a time.

        Args:
            video: A file, or frames.
            hop: Seconds between the ends of neighbouring clips; at least one frame.
            times: float64, seconds of each frame, increasing; a file knows its own.

        Returns:
            For each clip the time of its last frame, s, and its frames, uint8 (T, H, W, 3).

        Raises:
            ConfigError: No times for frames that know none.
            DataError: The video is too short for one clip.
        """
        return cut(open_video(video), self.frames, self.spacing, hop, times)

    def encode_video(
        self,
        video: str | Path | Frames,
        background: Images | str | None = None,
        sensor: str | None = None,
        *,
        hop: float = 0.2,
        times: Times | None = None,
        unknown_sensor: Policy = "error",
        batch_size: int = 16,
    ) -> tuple[Times, Tensor]:
        """Vectors along a video; only ``batch_size`` clips are in memory at once.

        Args:
            video: See `cut`.
            background: See `encode`, but ``"first"`` is the first frame of the video.
            sensor: See `encode`.
            hop: See `cut`.
            times: See `cut`.
            unknown_sensor: See `encode`.
            batch_size: Clips that are read and computed at once.

        Returns:
            float64 (n,), the time of each clip's last frame, s, and float32 (n, projected).

        Raises:
            ConfigError: See `encode` and `cut`.
            DataError: See `cut`; or a frame cannot be decoded.
        """
        frames = open_video(video)
        if isinstance(background, str) and background == "first":
            background = frames.read([0])[0]
        ends: list[float] = []
        vectors: list[Tensor] = []
        clips_of = self.cut(frames, hop, times)
        while batch := list(islice(clips_of, batch_size)):
            ends += [end for end, _ in batch]
            stacked = np.stack([clip for _, clip in batch])
            vectors.append(self.encode(stacked, background, sensor, unknown_sensor=unknown_sensor))
        return np.array(ends), torch.cat(vectors)

    def _tap(self, tap: Tap, frames: Tensor, background: Tensor, rows: Tensor) -> Tensor:
        out = self.encoder(frames.to(self.device), background.to(self.device), rows.to(self.device))
        tokens, projected = out
        found: Tensor = {"tokens": tokens, "cls": tokens[:, 0], "projected": projected}[tap]
        return found.float()

    def _rows(self, sensor: str | Sequence[str] | None, count: int, policy: Policy) -> Tensor:
        """Rows of the sensor table, int64 (count,)."""
        if policy not in ("error", "universal"):
            raise ConfigError(f"unknown_sensor={policy!r}: give error or universal")
        if self._any_sensor:
            return torch.zeros(count, dtype=torch.int64)
        known: dict[str, int] = self.encoder.sensors
        if sensor is None:
            if len(known) > 1:
                raise ConfigError(f"which sensor? Give sensor=..., one of: {', '.join(known)}")
            sensor = next(iter(known))
        names = [sensor] * count if isinstance(sensor, str) else list(sensor)
        if len(names) != count:
            raise ConfigError(f"{len(names)} sensors for {count} clips: one name, or one a clip")
        universal: int | None = getattr(self.encoder, "universal", None)
        if universal is not None:
            known = {"universal": universal, **known}
        strange = sorted({name for name in names if name not in known})
        if strange and (universal is None or policy == "error"):
            fix = "unknown_sensor='universal' takes the tokens that fit no sensor in particular."
            fix = "" if universal is None else fix
            raise ConfigError(unknown("sensor of the model", strange[0], known, fix))
        if strange:
            warnings.warn(
                f"the model never saw {', '.join(strange)}: it takes the universal sensor tokens, "
                "which are not meant for predicting force",
                stacklevel=4,
            )
        return torch.tensor([known.get(name, universal) for name in names])


def _takes_any_sensor(encoder: Any) -> bool:
    """Whether it does not tell sensors apart."""
    if not encoder.sensors:
        return True
    if not hasattr(encoder, "rows"):
        return False
    try:
        encoder.rows([""])
    except ConfigError:
        return False
    return True
