"""Options and summary of a written LeRobot data set."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from tactileforge.errors import ConfigError
from tactileforge_lerobot import folder
from tactileforge_lerobot.episode import AlignedRows

_IMAGES = ("auto", "video", "png", "camera")


class Vectors(Protocol):
    """Source of the ``observation.environment_state`` of an episode's rows."""

    @property
    def about(self) -> dict[str, Any]:
        """Provenance of the vectors, as plain data."""
        ...

    def __call__(self, shown: AlignedRows) -> NDArray[np.float32]:
        """Computes the vectors of an episode, float32 (N, size)."""
        ...


@dataclass(frozen=True, kw_only=True)
class LeRobotOptions:
    """Options of a written data set.

    Attributes:
        fps: Rows per second, a whole number; None for the rate of the fastest sensor of the first
            episode.
        devices: Sensors, by the label ``device`` or the type; None for all.
        images: ``video``; ``png``, without loss, in the parquet files; ``auto``: arrays as png, all
            others as video; or ``camera``: the paired camera alone, no frames of touch.
        robot: LeRobot's ``robot_type``; None to leave it empty.
        data_mb: Size of a parquet file from which a new one is begun, MB.
        video_mb: Size of a video from which a new one is begun, MB.
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
        rows: Number of rows of all episodes.
        fps: Rows per second.
        dropped: Number of frames outside of all rows, by device.
        features: Names of the features.
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
        """Features needed by LeRobot's policies, but absent from the data set."""
        return [feature for feature in folder.ROBOT.values() if feature not in self.features]
