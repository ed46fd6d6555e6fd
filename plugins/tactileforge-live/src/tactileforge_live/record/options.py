"""Options of a recording."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from tactileforge.contracts import ACTIONS
from tactileforge.data import CODECS
from tactileforge.errors import ConfigError, unknown
from tactileforge.reading import check_data_licence
from tactileforge.sensors import Background


@dataclass(frozen=True, kw_only=True)
class RecordOptions:
    """Keys of ``tactileforge record``, except its sensors.

    Attributes:
        out: Folder of the shards; takes are added to existing ones.
        takes: Number of takes; None until stopped.
        seconds: Duration of a take, s; None until stopped.
        pause: Time between two takes, s.
        split: Split of the recordings: ``train`` or ``val``.
        object: Name of the touched object, for all sensors.
        text: Caption of the recordings.
        action: Action of the whole take, one of `contracts.ACTIONS`.
        tier: Tier of the tactile dynamic pyramid, 1 to 5; None for 1 with forces, 3 with an action,
            else 2.
        labels: Further labels, for example {operator: ana}.
        source: Source of the recordings, in words.
        licence: SPDX identifier of the recordings, or several plain words.
        background: Options of the frames without contact.
        axes: Axes of the wrench sensor along x, y and z of a gel, for example [x,-y,-z]; for all
            sensors, or by sensor: {digit: [x,-y,-z], gelsight_mini: [x,y,z]}.
        calibration: Files of `tactileforge calibrate`, by sensor, stored as a label:
            {digit: digit.yaml}.
        depth: Optical calibrations, by sensor, for the track ``depth_um``: a shipped name or a
            file, as in {digit: digit}; needs a background.
        markers: Sensors whose gels have printed dots, for the tracks ``markers``, ``marker_field``
            and ``marker_motion``, as in [gelsight_mini]; needs a background.
        tare: Whether to subtract the wrench without contact.
        codec: Format of stored images: jpg, or without loss png or webp; those of arrays are always
            without loss.
        quality: Quality of JPEG, 1 to 100.
        segment: Duration of a segment, s; segments are written to disk at once.
        join: Whether to join the segments of a take into one shard at its end.
        queue: Largest number of frames of a sensor waiting for encoding; more are dropped.
        workers: Number of encoding threads.
        reconnect: Time to wait for a lost sensor, s.
        ignore: Checks of the running sensors to leave out, by code: [TF603] (docs/checks.md).
        min_free_gb: Free space on the disk below which recording ends, GB.
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
    markers: tuple[str, ...] = ()
    tare: bool = True
    codec: str = "jpg"
    quality: int = 95
    segment: float = 5.0
    join: bool = True
    queue: int = 32
    workers: int = 2
    reconnect: float = 10.0
    ignore: tuple[str, ...] = ()
    min_free_gb: float = 0.5

    def __post_init__(self) -> None:
        if self.split not in ("train", "val"):
            raise ConfigError(unknown("split", self.split, ("train", "val")))
        if self.action is not None and self.action not in ACTIONS:
            raise ConfigError(unknown("action", self.action, ACTIONS))
        if self.codec not in CODECS:
            raise ConfigError(unknown("codec", self.codec, CODECS))
        check_data_licence("licence", self.licence)
        if not 1 <= self.quality <= 100:
            raise ConfigError(f"quality={self.quality}: give 1 to 100")
        if self.tier is not None and not 1 <= self.tier <= 5:
            raise ConfigError(f"tier={self.tier}: give 1 to 5")
        if self.depth and not self.background.seconds:
            raise ConfigError("depth needs a background: give background.seconds above 0")
        if self.markers and not self.background.seconds:
            raise ConfigError("markers need a background: give background.seconds above 0")
        for name in ("takes", "seconds", "segment", "queue", "workers"):
            value = getattr(self, name)
            if value is not None and not value > 0:
                raise ConfigError(f"{name}={value}: give a value above 0")
