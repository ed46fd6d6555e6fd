"""The data set ``generated``: procedural touch for demonstrations, with nothing to download.

It is drawn, not simulated: see `datasets.drawn`.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from tactileforge.contracts import ACTIONS, FrameSubset, Recording
from tactileforge.datasets.drawn import SENSORS, SHAPES, DrawnFrames, Shape, touch, view
from tactileforge.errors import ConfigError, unknown

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_FPS = 30.0
_FRICTION = 0.6
_SHEAR_STIFFNESS = 5.0  # N/mm, until the contact slips
#: Validation has numbers of its own: it does not change with the number of recordings.
_FIRST_VAL = 300_000
#: Ends of the phases as shares of the time: rest, press, hold, move, hold, leave; then rest.
_PHASES = (0.1, 0.3, 0.36, 0.72, 0.78, 0.95)
#: Way of the indenter: x and y in mm, angle in rad (clockwise in the image).
_MOTIONS = {
    "slide_left": (-3.0, 0.0, 0.0),
    "slide_right": (3.0, 0.0, 0.0),
    "slide_up": (0.0, -3.0, 0.0),
    "slide_down": (0.0, 3.0, 0.0),
    "rotate_cw": (0.0, 0.0, 0.9),
    "rotate_ccw": (0.0, 0.0, -0.9),
}


class Generated:
    """Indenters pressed, slid or turned, and lifted, on three sensors; drawn on demand.

    Three neighbouring recordings are one touch on three sensors. Forces are exact and consistent
    with the motion: a power of the depth (Hertz), and a spring that slips at the friction cone.

    Args:
        recordings: Number of recordings for training.
        val: Number of recordings for validation.
        size: Height and width of a frame.
        seconds: Length of a recording.
        seed: Another seed, other recordings.

    Raises:
        ConfigError: A number is not positive.
    """

    provides = frozenset({"force", "action", "object", "text", "image"})

    def __init__(
        self,
        recordings: int = 48,
        val: int = 12,
        size: int = 112,
        seconds: float = 3.0,
        seed: int = 0,
    ) -> None:
        if min(recordings, size, seconds) <= 0 or val < 0:
            raise ConfigError(
                "generated: recordings, size and seconds are positive, val is not < 0"
            )
        self.ranges = {"train": range(recordings), "val": range(_FIRST_VAL, _FIRST_VAL + val)}
        self.size = size
        self.seconds = seconds
        self.seed = seed
        self.skipped: list[str] = []

    def recordings(self, split: str) -> Iterator[Recording]:
        """Yields the recordings of a split; nothing is drawn yet.

        Args:
            split: ``train`` or ``val``.

        Raises:
            ConfigError: An unknown split.
        """
        if split not in self.ranges:
            raise ConfigError(unknown("split", split, self.ranges))
        yield from map(self._recording, self.ranges[split])

    def plot(self, recording: Recording) -> Figure:
        """A figure of a recording."""
        from tactileforge.datasets.figure import plot

        return plot(recording)

    def _recording(self, index: int) -> Recording:
        contact, sensor = index // len(SENSORS), list(SENSORS)[index % len(SENSORS)]
        name = list(SHAPES)[contact % len(SHAPES)]
        # What is round shows no rotation.
        motions = list(_MOTIONS)[: 4 if SHAPES[name].round else None]
        motion = motions[(contact + contact // len(SHAPES)) % len(motions)]
        times = np.arange(max(8, round(self.seconds * _FPS))) / _FPS
        rng = np.random.default_rng([self.seed, contact])
        path, action = _trajectory(len(times), motion, rng)
        key = (self.seed, index)
        frames = DrawnFrames(
            len(times), self.size, partial(touch, name, sensor, path, self.size, key)
        )
        return Recording(
            key=f"generated/{index:06d}_{sensor}_{name}_{motion}",
            sensor=sensor,
            frames=frames,
            times=times,
            no_contact=FrameSubset(frames, [0]),
            force=_force(path, SHAPES[name]),
            action=action,
            object=name,
            text=f"{{action}} a {name}",
            image=DrawnFrames(1, self.size, partial(view, name, self.size, key)),
            source="drawn by tactileforge",
            tier=1,
            licence="CC0-1.0",
        )


def _trajectory(
    count: int, motion: str, rng: np.random.Generator
) -> tuple[NDArray[np.float32], NDArray[np.int64]]:
    """Position (mm), angle (rad) and depth (mm) of the indenter, (T, 4), and the actions."""
    phase = np.arange(count) / (count - 1)
    press, _, move, _, leave = (_ramp(phase, start, stop) for start, stop in pairwise(_PHASES))
    depth = rng.uniform(0.5, 1.1) * (press - leave)
    way = np.outer(move, _MOTIONS[motion])
    start = np.array([*rng.uniform(-1.5, 1.5, 2), rng.uniform(-np.pi, np.pi)])
    path = np.column_stack([start + way - way[-1] / 2, depth]).astype(np.float32)
    action = np.full(count, -1, np.int64)
    for ramp, name in ((press, "press"), (move, motion), (leave, "leave")):
        action[(ramp > 0) & (ramp < 1)] = ACTIONS.index(name)
    return path, action


def _ramp(phase: NDArray[np.float64], start: float, stop: float) -> NDArray[np.float64]:
    """From 0 to 1, with no jump of the speed."""
    x = np.clip((phase - start) / (stop - start), 0, 1)
    out: NDArray[np.float64] = x * x * (3 - 2 * x)
    return out


def _force(path: NDArray[np.float32], shape: Shape) -> NDArray[np.float32]:
    """Forces on the gel, (T, 3), newton."""
    force = np.zeros((len(path), 3), np.float32)
    force[:, 2] = shape.stiffness * np.maximum(path[:, 3], 0) ** shape.exponent
    for i in range(1, len(path)):
        shear = force[i - 1, :2] + _SHEAR_STIFFNESS * (path[i, :2] - path[i - 1, :2])
        limit = _FRICTION * force[i, 2]
        force[i, :2] = shear * min(1.0, limit / max(float(np.hypot(*shear)), 1e-9))
    return force
