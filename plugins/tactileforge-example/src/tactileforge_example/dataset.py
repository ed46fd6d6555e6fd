"""A synthetic data set: every recording is one press of a ball, drawn on reading."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from tactileforge.contracts import ACTIONS, FrameSubset, Recording
from tactileforge.specs import spec
from tactileforge_example.synthetic import press

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class PressFrames:
    """Frames of one press.

    Attributes:
        depths: Depth of the ball in each frame, in its radii.
        shape: Height and width.
        centre: Position of the ball, y and x in -1..1.
    """

    depths: NDArray[np.float64]
    shape: tuple[int, int]
    centre: tuple[float, float]

    def __len__(self) -> int:
        return len(self.depths)

    def read(self, indices: Sequence[int]) -> NDArray[np.uint8]:
        """Draws the requested frames, uint8 (n, H, W, 3)."""
        return np.stack([press(self.depths[i], *self.shape, self.centre) for i in indices])


class DummyPresses:
    """Presses in random places and of random depth. Nothing here was measured.

    Forces follow a Hertz contact, ``5 N * depth ** 1.5``, without shear.

    Args:
        sensor: Type of sensor; it sets size and rate of the frames.
        count: Number of recordings; every fourth is for validation.
        frames: Number of frames of a recording.
        seed: Random seed; the same seed gives the same recordings.
    """

    def __init__(
        self, sensor: str = "dummy", count: int = 16, frames: int = 40, seed: int = 0
    ) -> None:
        self.sensor = sensor
        self.count = count
        self.frames = frames
        self.seed = seed
        self.provides = frozenset({"force", "action"})
        self.skipped: list[str] = []

    def recordings(self, split: str) -> Iterator[Recording]:
        """Yields the recordings of a split, ``train`` or ``val``."""
        for i in range(self.count):
            if ("val" if i % 4 == 3 else "train") == split:
                yield self._recording(i)

    def _recording(self, i: int) -> Recording:
        device = spec(self.sensor)
        random = np.random.default_rng([self.seed, i])
        centre = (random.uniform(-0.4, 0.4), random.uniform(-0.4, 0.4))
        phase = np.linspace(0, np.pi, self.frames)
        depths = random.uniform(0.2, 0.5) * np.sin(phase)
        frames = PressFrames(depths, (device.height, device.width), centre)
        force = np.zeros((self.frames, 3), np.float32)
        force[:, 2] = 5 * np.maximum(depths, 0) ** 1.5
        pressing = phase < np.pi / 2
        return Recording(
            key=f"press-{i:03d}",
            sensor=self.sensor,
            frames=frames,
            times=np.arange(self.frames) / device.fps,
            no_contact=FrameSubset(frames, [0]),
            force=force,
            action=np.where(pressing, ACTIONS.index("press"), ACTIONS.index("leave")),
            source="synthetic: drawn by tactileforge-example, not measured",
            licence="Apache-2.0",
        )

    def plot(self, recording: Recording) -> Figure:
        """Plots four frames of a recording above its normal force."""
        from matplotlib import pyplot

        figure: Figure
        figure, axes = pyplot.subplot_mosaic([["0", "1", "2", "3"], ["force"] * 4])
        for i, row in enumerate(np.linspace(0, len(recording.frames) - 1, 4).astype(int)):
            axes[str(i)].imshow(recording.frames.read([row])[0])
            axes[str(i)].set_axis_off()
        if recording.force is not None:
            axes["force"].plot(recording.times, recording.force[:, 2])
        axes["force"].set(xlabel="time (s)", ylabel="normal force (N)")
        return figure
