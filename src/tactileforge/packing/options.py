"""Options of packing: the keys under ``pack.`` of ``tactileforge data pack``."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

from tactileforge.data.shards.shards import CODECS
from tactileforge.errors import ConfigError, unknown

#: Executors by name.
EXECUTORS = ("local", "ray")


@dataclass(frozen=True, kw_only=True)
class Filter:
    """Filter of frames; keeps all of them by default.

    Attributes:
        laplacian: Smallest `filters.laplacian_score` of a lively frame; frames in no clip with a
            lively one are left out. One number, or one by sensor (others are not filtered); None
            keeps all.
        every: Seconds between sampled frames, before that filter; None keeps all.
        span: Length of a clip of four frames, s; see `filters.reach`.

    Raises:
        ConfigError: A value is not positive.
    """

    laplacian: float | Mapping[str, float] | None = None
    every: float | None = None
    span: float = 0.2

    def __post_init__(self) -> None:
        by_sensor = self.laplacian if isinstance(self.laplacian, Mapping) else {"": self.laplacian}
        values = {f"laplacian {sensor}".strip(): value for sensor, value in by_sensor.items()}
        for name, value in (values | {"every": self.every, "span": self.span}).items():
            if value is not None and not value > 0:
                raise ConfigError(f"pack.filter: {name} is {value}; give more than 0, or null")

    def threshold(self, sensor: str) -> float | None:
        """Smallest score of a lively frame of a sensor; None keeps all frames."""
        if isinstance(self.laplacian, Mapping):
            return self.laplacian.get(sensor)
        return self.laplacian


@dataclass(frozen=True, kw_only=True)
class PackOptions:
    """Options of packing.

    Attributes:
        codec: Codec of the images, one of `data.shards.shards.CODECS`.
        quality: Quality of jpg, 1 to 100; None for 95.
        size: Shorter side of stored images, pixels; smaller images stay unchanged. None keeps all
            sizes.
        shard_frames: Frames of a shard, before filtering.
        processes: Packing processes; None for one per core.
        executor: Name of the executor, one of `EXECUTORS`.
        max_bad: Tolerated share of damaged recordings, 0 to 1; above 0, one is always tolerated.
        filter: Filter of frames.
        markers: Types of sensors whose gels have printed dots, as in [gelsight_mini], for the
            tracks ``markers``, ``marker_field`` and ``marker_motion``.

    Raises:
        ConfigError: Invalid value.
    """

    codec: str = "jpg"
    quality: int | None = None
    size: int | None = None
    shard_frames: int = 10_000
    processes: int | None = None
    executor: str = "local"
    max_bad: float = 0.01
    filter: Filter = field(default_factory=Filter)
    markers: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if self.codec not in CODECS:
            raise ConfigError(unknown("pack.codec", self.codec, CODECS))
        if self.executor not in EXECUTORS:
            raise ConfigError(unknown("pack.executor", self.executor, EXECUTORS))
        if self.quality is not None and (self.codec != "jpg" or not 1 <= self.quality <= 100):
            raise ConfigError(f"pack.quality={self.quality}: only jpg has a quality, from 1 to 100")
        if not 0 <= self.max_bad <= 1:
            raise ConfigError(f"pack.max_bad is {self.max_bad}; give a share, from 0 to 1")
        for name in ("size", "shard_frames", "processes"):
            value = getattr(self, name)
            if value is not None and value < 1:
                raise ConfigError(f"pack.{name} is {value}; give 1 or more")

    def content(self) -> dict[str, Any]:
        """Options with an effect on the bytes of the shards, as plain data."""
        plain = asdict(self)
        # any executor gives the same bytes, and a stopped run may go on with another one
        for name in ("processes", "executor", "max_bad"):
            del plain[name]
        return plain
