"""Base of packet sensors: opening, reading, time stamps, counters."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections import deque
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from tactileforge.contracts import Frame, Sensor, SensorSpec
from tactileforge.errors import SensorError, TactileForgeError
from tactileforge.sensors.continuity import Arrival, Continuity
from tactileforge.sensors.framing import Parser
from tactileforge.sensors.links import Link


class Stamper:
    """Time stamps for packets received together: the last one now, the others a period apart.

    Args:
        period: Seconds between packets.
    """

    def __init__(self, period: float) -> None:
        self.period = period
        self._last = -np.inf

    def stamp(self, count: int, now: float) -> list[float]:
        """Strictly increasing times of ``count`` packets received by ``now``, monotonic seconds."""
        times = []
        for behind in range(count - 1, -1, -1):
            earliest = float(np.nextafter(self._last, np.inf))
            self._last = max(now - behind * self.period, earliest)
            times.append(self._last)
        return times


class StreamSensor(Sensor, ABC):
    """Base of sensors with packets over a `Link`; a driver connects and decodes them.

    Attributes:
        spec: Spec of the sensor.
        address: Address of the open device; "" for none.
        unit: Serial number of the device; "" for none.
        parser: Parser of the open connection, with its counters; None before the first.
        continuity: Filter of the open connection, with the number of dropped packets.
        keeps_zero: Whether the open connection replaces a lost one. Then no new zero is taken, as
            the sensor may be under load.
    """

    spec: SensorSpec

    def __init__(self) -> None:
        self.address = self.unit = ""
        self.parser: Parser | None = None
        self.continuity = Continuity(self.follows)
        self.keeps_zero = False
        self._before: dict[str, int] = {}  # dropped packets of earlier connections
        self._link: Link | None = None
        self._frames: deque[Frame] = deque()
        self._stamper = Stamper(0.0)

    @abstractmethod
    def connect(self) -> Link:
        """Open the connection.

        Raises:
            SensorError: The device is absent or busy.
        """

    @abstractmethod
    def new_parser(self) -> Parser:
        """Build a parser for a new connection."""

    @abstractmethod
    def decode(self, payload: bytes) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
        """Decode one packet to image and raw values; see `contracts.Frame`.

        Raises:
            ValueError: Impossible packet; it is counted as bad.
        """

    def follows(self, before: Arrival | None, after: Arrival) -> bool:
        """Whether a packet can come right after another; see `Continuity`.

        Args:
            before: Last packet; None at the start.
            after: New packet.
        """
        return True

    def start(self, link: Link) -> None:
        """Tell the device to send; most need no request."""

    def stop(self, link: Link) -> None:
        """Tell the device to stop; it may be disconnected already."""

    def ready(self) -> None:
        """Hook called once the device is open, for example to take a baseline."""

    @property
    def drops(self) -> dict[str, int]:
        """Dropped packets by reason, those of earlier connections included."""
        bad = 0 if self.parser is None else self.parser.bad
        now = {"implausible": bad, "jumped": self.continuity.jumps}
        return {reason: count + self._before.get(reason, 0) for reason, count in now.items()}

    def set_rate(self, fps: float) -> None:
        """Set the measured packet rate, 1/s."""
        self.spec = replace(self.spec, fps=fps)
        self._stamper.period = 1 / fps

    def discover(self) -> list[str]:
        """Addresses of the attached devices; a driver overrides it to find its own."""
        return []

    def open(self) -> None:
        """Connect.

        Raises:
            SensorError: The device is absent or busy.
            ConfigError: An option is missing or wrong.
        """
        self._open(keeps_zero=False)

    def reopen(self) -> None:
        """Connect again after a loss, and keep the zero; raises the errors of `open`."""
        self._open(keeps_zero=True)

    def _open(self, keeps_zero: bool) -> None:
        self.close()
        self.keeps_zero = keeps_zero
        link = self.connect()
        self._link, self.address = link, link.address
        self.unit = getattr(link, "unit", "")
        # before parser and continuity are replaced, as they hold the counts
        self._before = self.drops
        self.parser = self.new_parser()
        self.continuity = Continuity(self.follows)
        self._stamper = Stamper(1 / self.spec.fps)
        try:
            self.start(link)
            self.ready()
        except BaseException:
            self.close()
            raise

    def read(self, timeout: float = 1.0) -> Frame:
        """Read the next packet.

        Raises:
            TactileForgeError: The sensor is not open.
            SensorError: The device is gone.
            TimeoutError: No packet within ``timeout`` seconds.
        """
        end = time.monotonic() + timeout
        while not self._frames:
            link, parser = self._link, self.parser
            if link is None or parser is None:
                raise TactileForgeError(
                    f"the sensor {self.spec.name} is not open: use it in a with block, or call "
                    "open()"
                )
            left = end - time.monotonic()
            if left <= 0:
                raise TimeoutError(self._silence(parser, timeout))
            self.take(parser, link.receive(left))
        return self._frames.popleft()

    def take(self, parser: Parser, data: bytes) -> None:
        """Take received bytes; `read` returns their packets next."""
        now = time.monotonic()
        payloads = parser.feed(data)
        for payload, taken in zip(payloads, self._stamper.stamp(len(payloads), now), strict=True):
            try:
                array, raw = self.decode(payload)
            except ValueError:
                parser.good -= 1
                parser.bad += 1
                continue
            new = Arrival(payload, Frame(array=array, time=taken, raw=raw))
            self._frames.extend(one.frame for one in self.continuity.take(new))

    def _silence(self, parser: Parser, timeout: float) -> str:
        fix = "is it on, and does it send by itself?"
        if parser.lost or parser.bad:
            fix = (
                f"{parser.lost} bytes came that are not packets ({parser.bad} nearly were): are "
                "baud rate, header and payload right?"
            )
        return f"{self.address}: no packet within {timeout:g} s; {fix}"

    def close(self) -> None:
        """Close the device; a second call does nothing."""
        link, self._link = self._link, None
        self.address = self.unit = ""
        self._frames.clear()
        if link is None:
            return
        try:
            self.stop(link)
        except SensorError:
            pass  # the device is gone already
        finally:
            link.close()
