from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from shared_fixtures import *  # noqa: F403

from tactileforge.contracts import Recording
from tactileforge.data.frames.lazy import ArrayFrames

Touch = Callable[..., Recording]

HEIGHT, WIDTH, FPS = 48, 64, 30.0


def pictures(level: NDArray[np.float64], seed: int, radius: float = 9.0) -> NDArray[np.uint8]:
    """Noisy grey pictures with a bump of radius pixels, ``level`` grey levels above the rest."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    at_y, at_x = rng.uniform(12, HEIGHT - 12), rng.uniform(12, WIDTH - 12)
    bump = np.exp(-(((y - at_y) ** 2 + (x - at_x) ** 2) / radius**2))
    flat = 120 + 0.3 * x
    noise = rng.normal(0, 1, (len(level), HEIGHT, WIDTH, 3))
    shown = flat[..., None] + level[:, None, None, None] * bump[..., None] + noise
    return np.clip(shown, 1, 254).astype(np.uint8)


@pytest.fixture
def touch() -> Touch:
    """Makes a recording of two presses of 60 grey levels without fault, 3 s at 30 Hz.

    ``edit`` changes the pictures (T, H, W, 3) in place; other fields replace the recording's.
    """

    def make(
        seed: int = 0,
        count: int = 90,
        edit: Callable[[NDArray[np.uint8]], Any] | None = None,
        height: float = 60.0,
        lag: float = 0.0,
        **fields: Any,
    ) -> Recording:
        times = np.arange(count) / FPS

        def press(at: NDArray[np.float64]) -> NDArray[np.float64]:
            wide = np.exp(-(((at - 0.8) / 0.2) ** 2)) + 0.6 * np.exp(-(((at - 2.1) / 0.3) ** 2))
            return wide if count > 1 else np.ones(count)

        array = pictures(height * press(times - lag), seed)
        if edit:
            edit(array)
        still = pictures(np.zeros(3), seed + 1000)
        normal = 4 * press(times)
        given = {
            "key": f"made/{seed}",
            "sensor": "digit",
            "frames": ArrayFrames(array),
            "times": times,
            "no_contact": ArrayFrames(still),
            "force": np.stack([0.2 * normal, 0 * normal, normal], axis=1).astype(np.float32),
            "source": "made here",
            "licence": "CC0-1.0",
        }
        return Recording(**(given | fields))

    return make


@dataclass
class Listed:
    """A data set in memory. ``breaks`` is raised when its recordings of a split have been given."""

    train: Sequence[Recording]
    val: Sequence[Recording] = ()
    skipped: list[str] = field(default_factory=list)
    breaks: Exception | None = None
    provides: frozenset[str] = frozenset()

    def recordings(self, split: str) -> Iterator[Recording]:
        yield from getattr(self, split)
        if self.breaks and split == "train":
            raise self.breaks

    def plot(self, recording: Recording) -> Any:
        raise NotImplementedError


@pytest.fixture
def listed() -> type[Listed]:
    return Listed
