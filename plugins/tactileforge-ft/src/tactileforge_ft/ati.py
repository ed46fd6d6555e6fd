"""ATI Net F/T and Ethernet Axia: forces and torques over Ethernet, up to 7,000 a second.

"Raw data transfer": a request of 8 bytes over UDP starts the stream, and each record of 36 bytes
carries two sequence numbers, a status and six counts. The counts per unit, and the unit, are read
from the page ``netftapi2.xml`` of the device.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Sequence
from dataclasses import dataclass, replace
from urllib.error import URLError
from urllib.request import ProxyHandler, build_opener

import numpy as np
from numpy.typing import NDArray

from tactileforge.contracts import Frame, SensorSpec
from tactileforge.errors import SensorError
from tactileforge.sensors import Arrival, ForceTorque, Link, Parser

#: Commands of a request.
STOP, START, BIAS = 0x0000, 0x0002, 0x0042
#: Bit of a status for any error.
ERROR = 1 << 31
#: Size of the units of the device, N and N m; their names are written without dashes and blanks.
FORCES = {"n": 1.0, "kn": 1e3, "lbf": 4.4482216152605, "klbf": 4448.2216152605}
FORCES |= {"kgf": 9.80665, "gf": 9.80665e-3}
TORQUES = {"nm": 1.0, "nmm": 1e-3, "knm": 1e3, "kgfcm": 0.0980665}
TORQUES |= {"lbfin": 0.1129848290276167, "lbfft": 1.3558179483314004}
_PAGE_BYTES = 1 << 20
_WRAP = 1 << 32
#: Largest step of the record number without a need of confirmation by the next record: forwards for
#: lost records, backwards for late ones.
NEAR = 16


def request(command: int, count: int = 0) -> bytes:
    """Packs a request.

    Args:
        command: `STOP`, `START` or `BIAS`.
        count: Number of records to send; 0 for an endless stream.

    Example:
        >>> request(START).hex()
        '1234000200000000'
    """
    return struct.pack(">HHI", 0x1234, command, count)


@dataclass(frozen=True)
class Settings:
    """Settings reported by the device.

    Attributes:
        force: Force of a count, N.
        torque: Torque of a count, N m.
        rate: Records a second; None where the device does not state it.
    """

    force: float
    torque: float
    rate: float | None


class AtiNetFT(ForceTorque):
    """An ATI Net F/T, read in N and N m.

    Lost records are counted. A record is dropped if it comes twice or too late, or if its status is
    an error, as its values are then invalid. A record more than `NEAR` ahead, or with a jump in
    force, is dropped unless the next one continues from it.

    Args:
        host: Name or IP address of the device.
        port: Its UDP port for raw data transfer.
        bias: Whether the reading at opening becomes zero.
        http_port: Port of its web pages.
        most: Largest plausible force (N) and torque (N m).

    Attributes:
        missed: Number of records lost on the way, since opening.
        status: Status of the last record.
    """

    spec = SensorSpec(
        name="ati_netft",
        height=0,
        width=0,
        fps=7000.0,
        area_mm=None,
        force_scale=(10.0, 10.0, 10.0),
        kind="wrench",
    )

    def __init__(
        self,
        host: str = "192.168.1.1",
        port: int = 49152,
        bias: bool = False,
        http_port: int = 80,
        most: Sequence[float] = (10_000.0, 1_000.0),
    ) -> None:
        super().__init__(
            port=f"{host}:{port}", link="udp", payload=">3I6i", most=most, fps=self.spec.fps
        )
        self.page = f"http://{host}:{http_port}/netftapi2.xml"
        self.bias = bias
        self.missed = self.status = self._errors = 0

    def connect(self) -> Link:
        """Reads the size of a count, and opens the link for the records.

        Raises:
            SensorError: The device does not answer, or its units are unknown.
        """
        settings_held = settings(fetch(self.page), self.page)
        self.scale = np.repeat([settings_held.force, settings_held.torque], 3)
        if settings_held.rate:
            self.spec = replace(self.spec, fps=settings_held.rate)
        self.missed = self.status = self._errors = 0
        return super().connect()

    def start(self, link: Link) -> None:
        """Requests an endless stream, after zeroing; a reopened device keeps its zero."""
        if self.bias and not self.keeps_zero:
            link.send(request(BIAS))
        link.send(request(START))

    def stop(self, link: Link) -> None:
        """Ends the stream."""
        link.send(request(STOP))

    def wrench(self, payload: bytes) -> NDArray[np.float64]:
        """Unpacks forces and torques of a record; see `ForceTorque.wrench`.

        Raises:
            ValueError: Its status is an error, or a record as new has come already.
        """
        status: int = struct.unpack_from(">I", payload, 8)[0]
        last = self.continuity.last
        if last is not None and (_number(last.payload) - _number(payload)) % _WRAP < NEAR:
            raise ValueError("a record that came already, or too late")
        self.status = status
        if status & ERROR:
            self._errors += 1
            raise ValueError(f"status 0x{status:08x}")
        return super().wrench(payload)

    def follows(self, before: Arrival | None, after: Arrival) -> bool:
        """Whether a record continues the last one; a stream begins with number 1."""
        last = 0 if before is None else _number(before.payload)
        is_next = 0 < (_number(after.payload) - last) % _WRAP <= NEAR
        return is_next and (before is None or self.is_smooth(before, after))

    def take(self, parser: Parser, data: bytes) -> None:
        """Takes a datagram, and counts the missing records before it."""
        before, count = self.continuity.last, len(self._frames)
        super().take(parser, data)
        last = self.continuity.last
        if last is None or last is before:
            return
        if before is not None:
            ahead = (_number(last.payload) - _number(before.payload)) % _WRAP
            came = len(self._frames) - count + self._errors
            self.missed += max(0, ahead - came) if ahead < _WRAP // 2 else 0
        self._errors = 0

    def read(self, timeout: float = 1.0) -> Frame:
        """Waits for the next record; see `StreamSensor.read`.

        Raises:
            TimeoutError: No valid record within ``timeout`` seconds.
        """
        try:
            return super().read(timeout)
        except TimeoutError as error:
            if not self.status & ERROR:
                raise
            raise TimeoutError(
                f"{self.address}: its records say status 0x{self.status:08x}, an error; look it up "
                "under status code in its manual"
            ) from error


def _number(payload: bytes) -> int:
    number: int = struct.unpack_from(">I", payload)[0]
    return number


def fetch(page: str, timeout: float = 3.0) -> str:
    """Fetches the text of a page of the device, and bypasses any proxy of the machine.

    Args:
        page: Address of the page.
        timeout: Longest wait, s.

    Raises:
        SensorError: The page cannot be fetched.
    """
    try:
        with build_opener(ProxyHandler({})).open(page, timeout=timeout) as answer:
            text: bytes = answer.read(_PAGE_BYTES)
    except (URLError, OSError, ValueError) as error:
        raise SensorError(
            f"{page}: does not answer ({error}); is the sensor on, and is host= right?"
        ) from error
    return text.decode("latin-1")


def settings(text: str, page: str = "netftapi2.xml") -> Settings:
    """Reads the page of settings.

    Args:
        text: Content of the page.
        page: Address of the page, for errors.

    Raises:
        SensorError: A value is missing or invalid.
    """

    def field(name: str) -> str:
        match = re.search(rf"<{name}>\s*([^<]*?)\s*</{name}>", text, re.IGNORECASE)
        return match[1] if match else ""

    def per_count(counts: str, unit: str, units: dict[str, float]) -> float:
        number, name = field(counts), field(unit)
        known = units.get(re.sub(r"[^a-z]", "", name.lower()))
        if known is None:
            raise SensorError(f"{page}: {unit} is {name!r}; set it to one of {', '.join(units)}")
        try:
            return known / float(number)
        except (ValueError, ZeroDivisionError) as error:
            raise SensorError(f"{page}: {counts} is {number!r}, not a number of counts") from error

    rate = field("comrdtrate")
    return Settings(
        force=per_count("cfgcpf", "scfgfu", FORCES),
        torque=per_count("cfgcpt", "scfgtu", TORQUES),
        rate=float(rate) if rate.isdecimal() and int(rate) else None,
    )
