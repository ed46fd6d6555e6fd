"""Options of a LeRobot data set that is written, and what came of it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from tactileforge.plugin import ConfigError
from tactileforge_lerobot import folder
from tactileforge_lerobot.episode import Episode

_IMAGES = ("auto", "video", "png", "camera")


class Vectors(Protocol):
    """Source of the ``observation.environment_state`` of an episode's rows."""

    @property
    def about(self) -> dict[str, Any]:
        """Their provenance, as plain data."""
        ...

    def __call__(self, shown: Episode) -> NDArray[np.float32]:
        """The vectors of an episode, float32 (N, size)."""
        ...


@dataclass(frozen=True, kw_only=True)
class LeRobotOptions:
    """How a data set is written.

    Attributes:
        fps: Rows per second, a whole number; None for the rate of the fastest sensor of the first
            episode.
        devices: Sensors, by the label ``device`` or the type; None for all.
        images: ``video``; ``png``, without loss, in the parquet files; ``auto``: arrays as png; or
            ``camera``: the paired camera alone, no frames of touch.
        robot: LeRobot's ``robot_type``.
        data_mb: Size from which a new parquet file is begun.
        video_mb: Size from which a new video is begun.
    """

    fps: int | None = None
    devices: list[str] | None = None
    images: str = "auto"
    robot: str | None = None
    data_mb: float = 100.0
    video_mb: float = 200.0

    def __post_init__(self) -> None:
        if self.fps is not None and self.fps < 1:
            raise ConfigError(f"fps={self.fps}: give a whole number above 0")
        if self.images not in _IMAGES:
            raise ConfigError(f"images={self.images}: give {', '.join(_IMAGES)}")


@dataclass
class LeRobotSummary:
    """Summary of the written data set.

    Attributes:
        episodes: Number of episodes.
        rows: Of all.
        fps: Rows per second.
        dropped: Frames that no row shows, by device.
        features: Names.
        vectors: Size of the vectors of a row; 0 where there are none.
    """

    episodes: int = 0
    rows: int = 0
    fps: int = 0
    dropped: dict[str, int] = field(default_factory=dict)
    features: list[str] = field(default_factory=list)
    vectors: int = 0

    @property
    def lacks(self) -> list[str]:
        """Features that LeRobot's policies need, and that no recording carried."""
        return [feature for feature in folder.ROBOT.values() if feature not in self.features]
