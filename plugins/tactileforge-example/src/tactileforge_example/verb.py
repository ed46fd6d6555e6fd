"""Prints the mean grey level of the recordings of a data set."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from tactileforge.cli import Command
from tactileforge.errors import ConfigError
from tactileforge.plugins import build


@dataclass(frozen=True, kw_only=True)
class Brightness:
    """Mean grey level of each recording.

    Attributes:
        split: Split to read, ``train`` or ``val``.
        frames: Number of frames to read of each recording, spread evenly.
    """

    split: str = "train"
    frames: int = 5

    def __post_init__(self) -> None:
        if self.frames < 1:
            raise ConfigError(f"frames={self.frames}: read at least 1")


def brightness(keys: Brightness, config: dict[str, Any]) -> None:
    """Prints the mean grey level, 0 to 255, of each recording of a data set."""
    dataset = build("datasets", config["data"])
    for recording in dataset.recordings(keys.split):
        rows = np.linspace(0, len(recording.frames) - 1, keys.frames).astype(int)
        print(f"{recording.key}  {recording.frames.read(rows.tolist()).mean():.1f}")


COMMANDS = {"": Command(run=brightness, keys=Brightness, groups={"data": "???"})}
