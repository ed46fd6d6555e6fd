"""Simulated touches to compare with real ones, one in memory at a time."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from reality import measures
from tactileforge.bars import Bar
from tactileforge.contracts import FrameSubset, Recording
from tactileforge.data.shards import shards
from tactileforge.errors import DataError
from tactileforge.sim.config import SimConfig
from tactileforge.sim.generate import recordings

#: The trial of the ToucHD demonstrations, at both sensors' forces; edges show where a fit fails.
_TRIAL: dict[str, Any] = {
    "motions": "force_trial",
    "seconds": 2.0,
    "force": (4.0, 9.0),
    "indenters": ("one_quarter_cylindrical", "square_prism", "regular_triangular"),
}


def config(sensor: str, **changes: Any) -> SimConfig:
    """Configuration of touches for a sensor, at the size at which images are compared.

    Args:
        sensor: Its type.
        changes: Of `sim.config.SimConfig`, instead of what is chosen here.

    Raises:
        ConfigError: The simulator does not know the sensor, or a word in ``given``.
    """
    how: dict[str, Any] = {
        "sensors": (sensor,),
        "indenters": "all",
        "motions": "atomic",
        "size": measures.SIDE,
        "seconds": 0.5,
        "force": (0.5, 8.0),
        "markers": None,
        "viscosity": 0.0,
        "lag": 0.0,
        "seed": 0,
        "codec": "png",  # JPEG would be compared as well
    }
    return SimConfig(**(how | changes))


def trial(sensor: str, **changes: Any) -> SimConfig:
    """Configuration of force trials: press, slides in four directions, lift."""
    return config(sensor, **(_TRIAL | changes))


def simulated(config: SimConfig, scenes: range, progress: bool = False) -> Iterator[Recording]:
    """Plays scenes and yields their recordings; each can be read until the next is asked for.

    All frames before the first contact are its background.

    Args:
        config: The simulated scenes.
        scenes: Numbers of the scenes.
        progress: Whether to show a progress bar.

    Raises:
        DataError: A scene starts in contact.
    """
    label = f"simulating {', '.join(config.sensors)}"
    with tempfile.TemporaryDirectory() as folder:
        for number in Bar(scenes, desc=label, unit="touch", disable=not progress):
            path = Path(folder) / f"{number}.tar"
            shards.write_shard(path, recordings(config, number))
            for recording in shards.read_shard(path):
                yield _from_rest(recording)
            path.unlink()


def _from_rest(recording: Recording) -> Recording:
    assert recording.force is not None
    touched = recording.force[:, 2] > 0
    first = int(np.argmax(touched)) if touched.any() else len(touched)
    if first == 0:
        raise DataError(f"{recording.key} starts in contact: choose motions that press first")
    return replace(recording, no_contact=FrameSubset(recording.frames, range(first)))
