"""Touches in ``.npz`` files: frames (T, H, W, 3) uint8, force (T, 3) in N."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from tactileforge.plugin import ArrayFrames, DataNotFoundError, Recording, label_actions


class NpzTouches:
    """One file per touch.

    Args:
        root: Folder of the files.
    """

    provides = frozenset({"force", "action"})

    def __init__(self, root: str = "touches") -> None:
        self.root = root
        self.skipped: list[str] = []

    def recordings(self, split: str) -> Iterator[Recording]:
        """The recordings of a split."""
        files = sorted(Path(self.root).glob("*.npz"))
        if not files:
            raise DataNotFoundError(f"{self.root}: no .npz file; set data.root to their folder")
        for i, file in enumerate(files):
            if ("val" if i % 5 == 4 else "train") == split:
                yield self._recording(file)

    def _recording(self, file: Path) -> Recording:
        touch = np.load(file)
        frames = ArrayFrames(touch["frames"])
        times, force = np.arange(len(frames)) / 30.0, touch["force"].astype(np.float32)
        return Recording(
            key=file.stem,
            sensor="digit",
            frames=frames,
            times=times,
            no_contact=ArrayFrames(touch["frames"][:1]),
            force=force,
            action=label_actions(times, force),
            source="made for a test",
            licence="CC0-1.0",
        )

    def plot(self, recording: Recording) -> Any:
        """A figure of one recording."""
        from matplotlib import pyplot

        figure, axis = pyplot.subplots()
        axis.imshow(recording.frames.read([0])[0])
        return figure
