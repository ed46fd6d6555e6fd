"""Continuity of a stream: a packet out of line waits for the next one to confirm it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tactileforge.contracts import Frame


class Arrival(NamedTuple):
    """Received packet.

    Attributes:
        payload: Bytes of the packet, without header, checksum and footer.
        frame: Decoded frame.

    Example:
        >>> from tactileforge.contracts import Frame
        >>> picture = np.zeros((0, 0, 3), np.uint8)
        >>> Arrival(b"..", Frame(array=picture, time=0.5, raw=np.ones(6, np.float32))).frame.time
        0.5
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
    """Whether values change by at most a limit for each packet from one to another.

    Args:
        most: Largest change of a value from packet to packet.
        before: Earlier packet.
        after: Later packet; packets may have been lost between the two.
        fps: Packets a second.
        columns: Columns of ``Frame.raw`` along its last axis; by default all.

    Example:
        >>> from tactileforge.contracts import Frame
        >>> nothing = np.zeros((0, 0, 3), np.uint8)
        >>> before, after = (
        ...     Arrival(b"", Frame(array=nothing, time=n / 100, raw=np.full(6, n, np.float32)))
        ...     for n in (0, 1)
        ... )
        >>> changes_by_at_most(0.5, before, after, fps=100.0)
        False
    """
    old, new = before.frame, after.frame
    assert old.raw is not None
    assert new.raw is not None
    packets = max(1.0, (new.time - old.time) * fps)
    change = np.abs(new.raw.astype(np.float64) - old.raw)[..., columns]
    return bool((change <= most * packets).all())


class Continuity:
    """Filter of packets out of line with their stream.

    A packet that does not continue the stream waits. If the next one continues it, the stream has
    jumped: both pass, and nothing true is lost. Else it was false, and is dropped. So a single
    false packet never passes, and never hides the true ones after it.

    Args:
        follows: Function that tells whether its second packet can come right after its first; None
            as the first stands for the start.

    Attributes:
        last: Latest packet passed.
        jumps: Number of dropped packets.

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
        """Take a packet; returns the packets to pass now, oldest first."""
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
