"""Contact from the difference with the background, and slip from forces."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactileforge.errors import ConfigError
from tactileforge.sensors.background import squares


@dataclass(frozen=True, kw_only=True)
class ContactOptions:
    """Thresholds of contact.

    Attributes:
        begin: Difference to the background from which contact begins, grey levels.
        end: Difference to the background below which contact ends, grey levels.
    """

    begin: float = 8.0
    end: float = 5.0

    def __post_init__(self) -> None:
        if not 0 < self.end <= self.begin:
            raise ConfigError(
                f"contact.begin={self.begin}, contact.end={self.end}: give 0 < end <= begin"
            )


@dataclass(frozen=True, kw_only=True)
class SlipOptions:
    """Thresholds of slip.

    Attributes:
        friction: Ratio of shear to normal force at slip, the slope of the friction cone.
        least: Normal force below which slip is not estimated, N: ratios of small forces are noise.
        drop: Share of the shear that has to vanish within ``window`` at a steady normal force, 0
            to 1.
        window: Time window of ``drop``, s.
    """

    friction: float = 0.5
    least: float = 0.3
    drop: float = 0.3
    window: float = 0.15

    def __post_init__(self) -> None:
        if not (self.friction > 0 and self.least > 0 and 0 < self.drop < 1 and self.window > 0):
            raise ConfigError(
                "slip: give friction, least, window above 0, and drop between 0 and 1"
            )


class BackgroundChange:
    """Difference of images from the background, in grey levels.

    Both are averaged over squares of eight pixels. The result is the 99th percentile over squares
    of the change in their strongest colour, or the largest change of a taxel for arrays.

    Args:
        background: Frame without contact, uint8 (H, W, 3).
        camera: Whether images are of a camera, not of an array.
    """

    def __init__(self, background: NDArray[np.uint8], camera: bool = True) -> None:
        self._camera = camera
        self._still = squares(background, camera)
        # a camera has a hundred squares and more, some of them noisy; an array has few taxels
        self._percent = 99 if camera else 100

    def __call__(self, image: NDArray[np.uint8]) -> float:
        """Computes the difference of an image, uint8 (H, W, 3), grey levels."""
        change = np.abs(squares(image, self._camera) - self._still).max(-1)
        return float(np.percentile(change, self._percent))


class ContactDetector:
    """Contact with hysteresis: separate thresholds for its begin and end."""

    def __init__(self, options: ContactOptions) -> None:
        self.options = options
        self.is_on = False

    def update(self, difference: float) -> bool:
        """Updates contact with the difference of the newest image; returns whether it is on."""
        self.is_on = difference >= (self.options.end if self.is_on else self.options.begin)
        return self.is_on


class SlipEstimator:
    """Estimates slip from forces alone: slip is inferred, not observed.

    Slip begins when the shear reaches the friction cone (Coulomb), and ends when the ratio is a
    fifth below. It is also on for a moment after a sudden drop of shear at a steady normal force,
    as of a sticking object that comes loose. The true friction of an object is not known: set it.
    """

    def __init__(self, options: SlipOptions) -> None:
        self.options = options
        self.is_on = False
        self._recent: deque[tuple[float, float, float]] = deque()

    def update(self, time: float, force: NDArray[np.floating], contact: bool) -> bool:
        """Updates slip from the newest force; returns whether it slips.

        Args:
            time: Time of the force, s.
            force: Force along x, y and z, (3,), N.
            contact: Whether there is contact.
        """
        options = self.options
        shear, normal = math.hypot(force[0], force[1]), float(force[2])
        if not contact or normal < options.least:
            # forgotten: the next touch is another hold
            self._recent.clear()
            self.is_on = False
            return False
        while self._recent and self._recent[0][0] < time - options.window:
            self._recent.popleft()
        # hysteresis: slip ends a fifth below the cone, so that noise does not toggle it
        edge = options.friction * (0.8 if self.is_on else 1.0)
        # a drop from a weak hold (half the cone) is noise, and one with the normal force is
        # lifting, not slip
        has_let_go = any(
            before >= 0.5 * options.friction * pressed
            and shear <= (1 - options.drop) * before
            and abs(normal - pressed) <= 0.1 * pressed
            for _, before, pressed in self._recent
        )
        self.is_on = shear >= edge * normal or has_let_go
        self._recent.append((time, shear, normal))
        return self.is_on
