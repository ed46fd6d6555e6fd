"""Simulated touches for comparison with real ones, one in memory at a time."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from tactileforge_sim.config import SimConfig
from tactileforge_sim.generate import recordings

from reality import measures
from tactileforge.contracts import FrameSubset, Recording
from tactileforge.data.shards import shards
from tactileforge.errors import DataError
from tactileforge.plugins import Bar

#: The trial of the ToucHD demonstrations, in the range of both sensors' forces; indenters with
#: edges reveal failures of a fit.
_TRIAL: dict[str, Any] = {
    "motions": "force_trial",
    "seconds": 2.0,
    "force": (4.0, 9.0),
    "indenters": ("one_quarter_cylindrical", "square_prism", "regular_triangular"),
}


def config(sensor: str, **changes: Any) -> SimConfig:
    """Configuration of touches for a sensor, at the size of compared images.

    Args:
        sensor: Type of the sensor.
        changes: Fields of `tactileforge_sim.config.SimConfig` that replace the defaults here.

    Raises:
        ConfigError: The sensor is not simulated, or a value in ``changes`` is invalid.
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
        "codec": "png",  # lossless: artefacts of JPEG would be measured too
    }
    return SimConfig(**(how | changes))


def trial(sensor: str, **changes: Any) -> SimConfig:
    """Configuration of force trials: press, slides in four directions, lift."""
    return config(sensor, **(_TRIAL | changes))


def simulated(config: SimConfig, scenes: range, progress: bool = False) -> Iterator[Recording]:
    """Plays scenes and yields their recordings; each is readable until the next is requested.

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
