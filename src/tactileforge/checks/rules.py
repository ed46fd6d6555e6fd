"""Common parts of most checks of recordings."""

from __future__ import annotations

from collections.abc import Iterable
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from tactileforge.checks.check import Check, Examples, Finding
from tactileforge.checks.made import made_touch
from tactileforge.checks.pixels import check_pixels
from tactileforge.checks.seen import Seen
from tactileforge.contracts import Recording


class LabelCheck(Check):
    """A reason of `doubts.check_labels`: it decodes nothing.

    Attributes:
        reason: The reason.
    """

    reason: ClassVar[str] = ""

    def look(self, seen: Seen) -> Iterable[Finding]:
        """See `Check.look`."""
        for one in seen.suspicions:
            if one.reason == self.reason:
                yield self.found(seen.key, one.words, one.value)


class PixelCheck(Check):
    """A reason of `pixels.check_pixels`, from a few frames.

    Attributes:
        reason: The reason.
    """

    needs = frozenset({"frames"})
    reason: ClassVar[str] = ""

    def look(self, seen: Seen) -> Iterable[Finding]:
        """See `Check.look`."""
        found = seen.__dict__.get("pixel_suspicions")
        if found is None:
            # once for all checks of pixels
            found = list(check_pixels(seen.recording, seen.sample))
            seen.__dict__["pixel_suspicions"] = found
        for one in found:
            if one.reason == self.reason:
                yield self.found(seen.key, one.words, one.value)


def one_bad(bad: Recording) -> Examples:
    """A touch without a fault, and one with it."""
    return Examples([made_touch()], [bad])


def with_force(force: NDArray[np.floating]) -> Examples:
    """A touch with right forces, and the same with others."""
    return one_bad(made_touch(force=np.asarray(force, np.float32)))


def right_force() -> NDArray[np.float32]:
    """Forces of a drawn touch, (T, 3), N."""
    force = made_touch().force
    assert force is not None
    return force
