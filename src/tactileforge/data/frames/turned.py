"""Frames with swapped colours, or turned upright."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactileforge.contracts import Frames


@dataclass(frozen=True)
class TurnedFrames:
    """Frames of a file as seen by the sensor, still lazy.

    Attributes:
        base: Frames of the file.
        bgr: Whether the file has blue before green and red.
        turns: Quarter turns, clockwise, to put a frame upright.
        mirror: Axis to mirror along before the turn: ``x`` exchanges left and right, ``y`` top and
            bottom; "" for none.
    """

    base: Frames
    bgr: bool
    turns: int
    mirror: str = ""

    def __len__(self) -> int:
        return len(self.base)

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width of the upright frame, pixels."""
        height, width = self.base.shape
        return (width, height) if self.turns % 2 else (height, width)

    def read(self, indices: Sequence[int]) -> NDArray[np.uint8]:
        """Decode frames; see `contracts.Frames.read`."""
        frames = self.base.read(indices)
        if self.bgr:
            frames = frames[..., ::-1]
        if self.mirror:
            frames = frames[:, :, ::-1] if self.mirror == "x" else frames[:, ::-1]
        # numpy turns counter-clockwise, layouts turn clockwise
        return np.ascontiguousarray(np.rot90(frames, -self.turns, axes=(1, 2)))


def turned(frames: Frames, bgr: bool, turns: int, mirror: str = "") -> Frames:
    """Turn frames upright and their colours to RGB; returns the same frames without a change."""
    return TurnedFrames(frames, bgr, turns, mirror) if bgr or turns or mirror else frames
