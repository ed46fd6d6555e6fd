"""Holds back a packet that does not continue its stream, until the next says which is true."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tactileforge.contracts import Frame


class Arrival(NamedTuple):
    """A packet that has come.

    Attributes:
        payload: Its bytes, without header, checksum and footer.
        frame: What they mean.
    """

    payload: bytes
    frame: Frame


def changes_by_at_most(
    most: NDArray[np.float64] | float,
    before: Arrival,
    after: Arrival,
    fps: float,
    columns: Sequence[int] | slice = slice(None),
) -> bool:
    """Whether values change by no more than they may, in the packets between two.

    Args:
        most: Largest change of a value from packet to packet.
        before: The earlier packet.
        after: The later one; packets may have been lost between them.
        fps: Packets a second.
        columns: Of ``Frame.raw``, along its last axis; all without.
    """
    old, new = before.frame, after.frame
    assert old.raw is not None
    assert new.raw is not None
    packets = max(1.0, (new.time - old.time) * fps)
    change = np.abs(new.raw.astype(np.float64) - old.raw)[..., columns]
    return bool((change <= most * packets).all())


class Continuity:
    """Lets through the packets that continue a stream.

    One that does not is held back. If the next continues it, the stream has jumped: both are let
    through, and nothing true is lost. Else it was false, and is dropped. So a single false packet
    never passes, and never hides the true ones that come after it.

    Args:
        follows: Whether the second can come right after the first; None stands for nothing before.

    Attributes:
        last: The latest that was let through.
        jumps: Packets that were dropped.

    Example:
        >>> def near(a, b):
        ...     return a is not None and abs(a.frame - b.frame) < 2
        >>> stream = Continuity(near)
        >>> numbers = [1, 2, 70, 3, 40, 41]
        >>> [[a.frame for a in stream.take(Arrival(b"", n))] for n in numbers], stream.jumps
        ([[], [1, 2], [], [3], [], [40, 41]], 1)
    """

    def __init__(self, follows: Callable[[Arrival | None, Arrival], bool]) -> None:
        self._follows = follows
        self.last: Arrival | None = None
        self.jumps = 0
        self._held: Arrival | None = None

    def take(self, new: Arrival) -> list[Arrival]:
        """The packets that are let through now, oldest first."""
        held, self._held = self._held, None
        if self._follows(self.last, new):
            self.jumps += held is not None
            accepted = [new]
        elif held is not None and self._follows(held, new):
            accepted = [held, new]
        else:
            self.jumps += held is not None
            self._held = new
            return []
        self.last = new
        return accepted
