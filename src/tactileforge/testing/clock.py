"""Clocks for tests of sensors, independent of the load of the machine.

Put one in place of the module ``time`` in a driver::

    clock = FakeTime()
    monkeypatch.setattr("my_package.sensor.time", clock)
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator


class FakeTime:
    """A stand-in for the module ``time`` in drivers. Its time passes only during `sleep`.

    Attributes:
        now: Current monotonic time, s.

    Example:
        >>> clock = FakeTime(5.0)
        >>> clock.sleep(0.5)
        >>> clock.monotonic()
        5.5
    """

    def __init__(self, now: float = 1000.0) -> None:
        self.now = now

    def monotonic(self) -> float:
        """Current monotonic time, s."""
        return self.now

    def sleep(self, seconds: float) -> None:
        """Advances the clock."""
        self.now += max(0.0, seconds)


class TimedLink:
    """A link with packets arriving at a fixed rate of a fake clock.

    Args:
        clock: Clock to advance while waiting.
        packets: Packets in order; may be endless.
        fps: Packets per second.
        delay: Time until the first packet, s.
    """

    address = "timed"

    def __init__(
        self, clock: FakeTime, packets: Iterable[bytes], fps: float, delay: float = 0.0
    ) -> None:
        self.clock, self.period = clock, 1 / fps
        self._packets: Iterator[bytes] = iter(packets)
        self._due = clock.now + delay

    def receive(self, timeout: float) -> bytes:
        """The next packet; b"" if it is not due within ``timeout`` seconds, or after the last."""
        wait = self._due - self.clock.now
        self.clock.sleep(min(wait, timeout))
        if wait > timeout:
            return b""
        packet = next(self._packets, b"")
        if packet:
            self._due += self.period
        else:  # time passes for a caller that waits in vain, too
            self.clock.sleep(timeout)
        return packet

    def send(self, data: bytes) -> None:
        """Ignores the data."""

    def close(self) -> None:
        """Does nothing."""
