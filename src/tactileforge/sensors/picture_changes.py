"""Detection of rolled, turned or recoloured pictures in the middle of a stream."""

from __future__ import annotations

from itertools import permutations

import numpy as np
from numpy.typing import NDArray

from tactileforge.contracts import Frame

#: Changes with their fixes.
CHANGES = {
    "rolled": "its pictures have rolled: rows or columns begin elsewhere than at first; plug it "
    "out and in, and use a shorter cable",
    "turned": "its pictures are turned or mirrored, and were not at first; is its driver set up "
    "twice?",
    "recoloured": "its pictures have other colours than at first: are red and blue swapped, is a "
    "light out, does its white balance adjust itself?",
}
#: Seconds from the first frame to the reference picture: the first frames may be odd.
_SETTLE = 0.5
#: Shorter side of the compared pictures, pixels.
_SIZE = 30
#: Smallest mean change from the reference to look into, grey levels; and seconds between looks at a
#: slowly changing picture.
_CALM, _EVERY = 6.0, 0.5
#: Smallest jump of the mean change to look into at once, grey levels.
_SUDDEN = 3.0
#: Largest share of the change left after undoing it, and smallest shift, as a share of the side.
_REMAINS, _SHIFT = 0.4, 0.04
#: Smallest change of the median colour beyond any touch, grey levels.
_COLOUR = 40.0
#: Contrast of a dead channel at most, and of a working one at least (also between channels), grey
#: levels.
_DEAD, _ALIVE = 1.0, 8.0


class PictureChanges:
    """Comparison of the pictures of one camera with its first.

    A change counts if undoing it (rolling back, turning back, swapping channels back) gives the
    first picture again, but for touch; or if the median colour differs.

    """

    def __init__(self) -> None:
        self._begun: float | None = None
        self._reference: NDArray[np.uint8] | None = None
        self._small: NDArray[np.int16] = np.zeros((0, 0, 3), np.int16)
        self._state, self._looked, self._change = "", 0.0, 0.0

    def look(self, frame: Frame) -> str:
        """Compare a picture: returns its change, one of `CHANGES`; "" for none."""
        reference = self._reference
        if reference is None or reference.shape != frame.array.shape:
            if self._begun is None:
                self._begun = frame.time
            if frame.time - self._begun >= _SETTLE:
                self._reference, self._small = frame.array, _smaller(frame.array)
            return ""
        change = _difference(_smaller(frame.array), self._small)
        sudden = abs(change - self._change) > _SUDDEN
        if change < _CALM:
            self._state = ""
        elif sudden or frame.time - self._looked > _EVERY:
            self._looked = frame.time
            self._state = change_of(frame.array, reference)
        self._change = change
        return self._state


def change_of(picture: NDArray[np.uint8], reference: NDArray[np.uint8]) -> str:
    """Change of a picture, one of `CHANGES`; "" for none but touch.

    Args:
        picture: uint8 (H, W, 3).
        reference: Earlier picture, uint8 (H, W, 3).
    """
    # from cheap to dear; the median colour comes last, as the others change it, too
    small, want = _smaller(picture), _smaller(reference)
    most = _REMAINS * _difference(small, want)
    if min(_difference(small[..., list(order)], want) for order in _ORDERS) < most:
        return "recoloured"
    quarters = [np.rot90(small, 1), np.rot90(small, 3)]  # another shape, unless square
    turned = [small[::-1], small[:, ::-1], small[::-1, ::-1], *quarters]
    if min(_difference(one, want) for one in turned) < most:
        return "turned"
    rolled = (_difference(_smaller(one), want) for one in _rolled(picture, reference))
    if min(rolled, default=most) < most:
        return "rolled"
    # it has become grey, or has lost a channel
    now, before = (np.ptp(one, axis=2).mean() for one in (small, want))
    dead = (small.std(axis=(0, 1)) < _DEAD) & (want.std(axis=(0, 1)) > _ALIVE)
    has_lost_colour = dead.any() or (now < _DEAD and before > _ALIVE)
    if np.abs(_colour(small) - _colour(want)).max() > _COLOUR or has_lost_colour:
        return "recoloured"
    return ""


_ORDERS = [order for order in permutations(range(3)) if order != (0, 1, 2)]


def _smaller(picture: NDArray[np.uint8]) -> NDArray[np.int16]:
    step = max(1, min(picture.shape[:2]) // _SIZE)
    return picture[::step, ::step].astype(np.int16)


def _difference(one: NDArray[np.int16], other: NDArray[np.int16]) -> float:
    return float(np.abs(one - other).mean()) if one.shape == other.shape else np.inf


def _colour(small: NDArray[np.int16]) -> NDArray[np.float64]:
    median = np.median(small, axis=(0, 1))
    colour: NDArray[np.float64] = median - median.mean()
    return colour


def _rolled(picture: NDArray[np.uint8], reference: NDArray[np.uint8]) -> list[NDArray[np.uint8]]:
    """Picture rolled back by the shifts of its sums of rows, of columns, and of both."""
    shifts = [_shift(picture, reference, axis) for axis in (0, 1)]
    candidates = [(shifts[0], 0), (0, shifts[1]), tuple(shifts)]
    return [
        np.roll(picture, (-down, -right), (0, 1))
        for down, right in dict.fromkeys(candidates)
        if down or right
    ]


def _shift(picture: NDArray[np.uint8], reference: NDArray[np.uint8], axis: int) -> int:
    """Roll of a picture along an axis, pixels; 0 for a negligible one."""
    # circular cross-correlation of two profiles by the Fourier transform: a roll is circular
    sums = [one.sum(axis=(1 - axis, 2), dtype=np.float64) for one in (picture, reference)]
    waves = [np.fft.rfft(one - one.mean()) for one in sums]
    fits = np.fft.irfft(waves[0] * waves[1].conj(), len(sums[0]))
    shift = int(fits.argmax())
    size = len(fits)
    return shift if min(shift, size - shift) > _SHIFT * size else 0
