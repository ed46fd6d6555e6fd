"""Options of a recording."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from tactileforge.contracts import ACTIONS
from tactileforge.data.frames.image_codecs import CODECS
from tactileforge.errors import ConfigError, unknown
from tactileforge.sensors.background import Background


@dataclass(frozen=True, kw_only=True)
class RecordOptions:
    """The keys of ``tactileforge record``, beside its sensors.

    Attributes:
        out: Folder of the shards; takes are added to those that it holds.
        takes: How many; None until stopped.
        seconds: How long each lasts; None until stopped.
        pause: Seconds between two.
        split: ``train`` or ``val``.
        object: What is touched, by the same name for every sensor.
        text: Caption.
        action: One of `contracts.ACTIONS` for the whole take.
        tier: Of the tactile dynamic pyramid; None for 1 with forces, 3 with an action, else 2.
        labels: Whatever else is known, for example {operator: ana}.
        source: Where the recordings come from.
        licence: SPDX identifier.
        background: How frames without contact are taken.
        axes: Axes of the wrench sensor that are x, y and z of a gel, for example [x,-y,-z]; of all,
            or by sensor: {digit: [x,-y,-z], gelsight_mini: [x,y,z]}.
        calibration: Files of `tactileforge calibrate`, by sensor, that go along as a label:
            {digit: digit.yaml}.
        depth: Optical calibrations, by sensor, whose depth is kept as the track ``depth_um``: a
            name that ships, or a file, as in {digit: digit}; needs a background.
        tare: Whether the wrench without contact is subtracted.
        codec: How pictures are stored: jpg, or without loss png or webp; those of arrays always
            without loss.
        quality: Of JPEG.
        segment: Seconds after which what was recorded is written and safe.
        join: Whether the segments of a take become one shard when it ends.
        queue: Frames of a sensor that may wait to be encoded; more are dropped.
        workers: Threads that encode.
        reconnect: Seconds for which a sensor that is lost is waited for.
        min_free_gb: Space on the disk, GB, below which recording ends.
    """

    out: str
    takes: int | None = 1
    seconds: float | None = None
    pause: float = 3.0
    split: str = "train"
    object: str | None = None
    text: str | None = None
    action: str | None = None
    tier: int | None = None
    labels: Mapping[str, str | float] = field(default_factory=dict)
    source: str = ""
    licence: str = ""
    background: Background = field(default_factory=Background)
    axes: Sequence[str] | Mapping[str, Sequence[str]] = ("x", "y", "z")
    calibration: Mapping[str, str] = field(default_factory=dict)
    depth: Mapping[str, str] = field(default_factory=dict)
    tare: bool = True
    codec: str = "jpg"
    quality: int = 95
    segment: float = 5.0
    join: bool = True
    queue: int = 32
    workers: int = 2
    reconnect: float = 10.0
    min_free_gb: float = 0.5

    def __post_init__(self) -> None:
        if self.split not in ("train", "val"):
            raise ConfigError(unknown("split", self.split, ("train", "val")))
        if self.action is not None and self.action not in ACTIONS:
            raise ConfigError(unknown("action", self.action, ACTIONS))
        if self.codec not in CODECS:
            raise ConfigError(unknown("codec", self.codec, CODECS))
        if not 1 <= self.quality <= 100:
            raise ConfigError(f"quality={self.quality}: give 1 to 100")
        if self.tier is not None and not 1 <= self.tier <= 5:
            raise ConfigError(f"tier={self.tier}: give 1 to 5")
        if self.depth and not self.background.seconds:
            raise ConfigError("depth needs a background: give background.seconds above 0")
        for name in ("takes", "seconds", "segment", "queue", "workers"):
            value = getattr(self, name)
            if value is not None and not value > 0:
                raise ConfigError(f"{name}={value}: give a value above 0")
