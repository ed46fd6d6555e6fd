"""Vectors of a frozen encoder for every row of a LeRobot data set (`docs/lerobot.md`)."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from tactileforge.contracts import Recording
from tactileforge.data import held_clips
from tactileforge.errors import ConfigError, DataError, unknown
from tactileforge.sensors import warn_of_slow_frames

if TYPE_CHECKING:
    from tactileforge.hub import Model
    from tactileforge_lerobot.episode import AlignedRows

_VECTORS = ("pooled", "cls", "projected", "encode")


@dataclass(frozen=True, kw_only=True)
class EmbedOptions:
    """Options of encoding touch as vectors.

    Attributes:
        vector: ``pooled``, the mean of the patch tokens; ``cls``, the class token; ``projected``;
            or ``encode``, the vector of ``model.encode`` and ``model.stream``.
        unknown_sensor: Treatment of a sensor outside of the model's training: ``error``, or
            ``universal``.
        batch_size: Clips per batch.
    """

    vector: str = "pooled"
    unknown_sensor: str = "error"
    batch_size: int = 32

    def __post_init__(self) -> None:
        if self.vector not in _VECTORS:
            raise ConfigError(unknown("embed.vector", self.vector, _VECTORS))
        if self.unknown_sensor not in ("error", "universal"):
            raise ConfigError(
                unknown("embed.unknown_sensor", self.unknown_sensor, ("error", "universal"))
            )
        if self.batch_size < 1:
            raise ConfigError(f"embed.batch_size={self.batch_size}: give 1 or more")


class TouchVectors:
    """Vectors of the rows of an episode, concatenated over devices in the order of their names.

    The clip of a row ends with the row's frame, and holds nothing later. Where it would reach back
    before the recording, the first frame is repeated.

    Args:
        model: A loaded model; it stays unchanged.
        name: Name or path of the model, for the metadata.
        options: Options of the vectors.

    Attributes:
        devices: Names in the order of their vectors; empty before the first episode.
    """

    def __init__(self, model: Model, name: str, options: EmbedOptions) -> None:
        self.model, self.name, self.options = model, name, options
        self.devices: list[str] = []

    @property
    def about(self) -> dict[str, Any]:
        """Settings to repeat for running a policy, as plain data."""
        clip = {"frames": self.model.frames, "spacing": self.model.spacing}
        return {"model": self.name, **asdict(self.options), **clip, "devices": self.devices}

    def __call__(self, shown: AlignedRows) -> NDArray[np.float32]:
        """Encodes the rows of an episode, float32 (N, devices * width).

        Warns where the frame rate is too low for the clips of the model's training.

        Raises:
            DataError: The devices differ from those of earlier episodes, or a frame cannot be
                decoded.
            ConfigError: The model does not know the sensor.
        """
        devices = sorted(shown.parts)
        if not self.devices:
            self.devices = devices
            period = max(part.period for part in shown.parts.values()) or 1.0
            warn_of_slow_frames(period, self.model.spacing, self.model.frames)
        if devices != self.devices:
            keys = ", ".join(part.key for part in shown.parts.values())
            raise DataError(
                f"{keys}: vectors of {', '.join(devices)}, but those before are of "
                f"{', '.join(self.devices)}; choose sensors with lerobot.devices=[...]"
            )
        return np.concatenate([self._of(shown.parts[d], shown.rows[d]) for d in devices], axis=1)

    def _of(self, part: Recording, rows: NDArray[np.int64]) -> NDArray[np.float32]:
        """Encodes the clips with given last frames of a recording, (N, width)."""
        ends, places = np.unique(rows, return_inverse=True)
        clips = held_clips(part.times, ends, self.model.frames, self.model.spacing)
        still = part.background()
        size = self.options.batch_size
        out = [
            self._encode(part, clips[i : i + size], "none" if still is None else still)
            for i in range(0, len(clips), size)
        ]
        return np.concatenate(out)[places]

    def _encode(
        self, part: Recording, clips: NDArray[np.int64], background: NDArray[np.uint8] | str
    ) -> NDArray[np.float32]:
        needed, places = np.unique(clips, return_inverse=True)
        frames = part.frames.read(needed.tolist())[places.reshape(clips.shape)]
        pooled = self.options.vector == "pooled"
        tap: Any = "patches" if pooled else self.options.vector
        unknown_sensor: Any = self.options.unknown_sensor
        clip = frames, background, part.sensor
        if self.options.vector == "encode":
            vectors = self.model.encode(*clip, unknown_sensor=unknown_sensor)
        else:
            vectors = self.model.features(*clip, tap=tap, unknown_sensor=unknown_sensor)
        out: NDArray[np.float32] = (vectors.mean((1, 2, 3)) if pooled else vectors).cpu().numpy()
        return out
