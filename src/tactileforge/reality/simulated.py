"""Simulated touches to compare with real ones, one in memory at a time."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from tactileforge.contracts import FrameSubset, Recording
from tactileforge.data import shards
from tactileforge.errors import DataError
from tactileforge.sim.record import Config, recordings


def simulated(config: Config, scenes: range) -> Iterator[Recording]:
    """Plays scenes and yields their recordings; each can be read until the next is asked for.

    All frames before the first contact are its background, as many as a real recording may have.

    Args:
        config: What is simulated; the codec should lose nothing, or it is compared as well.
        scenes: Numbers of the scenes.

    Raises:
        DataError: A scene starts in contact.
    """
    with tempfile.TemporaryDirectory() as folder:
        for number in scenes:
            path = Path(folder) / f"{number}.tar"
            shards.write(path, recordings(config, number))
            for one in shards.read(path):
                yield _from_rest(one)
            path.unlink()


def _from_rest(one: Recording) -> Recording:
    assert one.force is not None
    touched = one.force[:, 2] > 0
    first = int(np.argmax(touched)) if touched.any() else len(touched)
    if first == 0:
        raise DataError(f"{one.key} starts in contact: choose motions that press first")
    return replace(one, no_contact=FrameSubset(one.frames, range(first)))
