"""Clocks for tests of sensors: no verdict hangs on how busy the machine is.

Put one in place of the module ``time`` in a driver::

    clock = FakeTime()
    monkeypatch.setattr("my_package.sensor.time", clock)
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator


class FakeTime:
    """The part of the module ``time`` that drivers use; it passes only where somebody sleeps.

    Attributes:
        now: Monotonic seconds.

    Example:
        >>> clock = FakeTime(5.0)
        >>> clock.sleep(0.5)
        >>> clock.monotonic()
        5.5
    """

    def __init__(self, now: float = 1000.0) -> None:
        self.now = now

    def monotonic(self) -> float:
        """Monotonic seconds."""
        return self.now

    def sleep(self, seconds: float) -> None:
        """Lets the time pass."""
        self.now += max(0.0, seconds)


class TimedLink:
    """A link whose packets arrive when they are due, on a clock of its own.

    Args:
        clock: The clock, which waiting moves on.
        packets: One after the other; may be endless.
        fps: Packets a second.
        delay: Seconds until the first.
    """

    address = "timed"

    def __init__(
        self, clock: FakeTime, packets: Iterable[bytes], fps: float, delay: float = 0.0
    ) -> None:
        self.clock, self.period = clock, 1 / fps
        self._packets: Iterator[bytes] = iter(packets)
        self._due = clock.now + delay

    def receive(self, timeout: float) -> bytes:
        """The next packet; b"" where it is not due within ``timeout`` seconds, or was the last."""
        wait = self._due - self.clock.now
        self.clock.sleep(min(wait, timeout))
        if wait > timeout:
            return b""
        packet = next(self._packets, b"")
        if packet:
            self._due += self.period
        else:
            self.clock.sleep(timeout)
        return packet

    def send(self, data: bytes) -> None:
        """Takes what is sent, and does nothing."""

    def close(self) -> None:
        """Does nothing."""
