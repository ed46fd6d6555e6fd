"""Base of drivers for packets of numbers, over a serial port or the network."""

from __future__ import annotations

import struct
from abc import abstractmethod
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tactileforge.errors import ConfigError
from tactileforge.sensors.continuity import Arrival, changes_by_at_most
from tactileforge.sensors.framing import (
    Datagrams,
    Framing,
    PacketParser,
    Parser,
    hex_bytes,
    payload_size,
)
from tactileforge.sensors.links import Link, SerialLink, TcpLink, UdpLink, attached_ports
from tactileforge.sensors.stream import StreamSensor

#: Picture of a device without pictures.
NO_PICTURE: NDArray[np.uint8] = np.zeros((0, 0, 3), np.uint8)
_LINKS = ("serial", "udp", "tcp")
#: Largest number of a network port.
_LAST_PORT = 65535


@dataclass(frozen=True)
class Line:
    """Connection to a device.

    Attributes:
        port: Path of the serial port, or ``HOST:PORT``; ``:PORT`` takes datagrams from anybody.
        link: Kind of connection: ``serial``, ``udp`` or ``tcp``.
        baudrate: Bits a second.
        usb: Vendor and product of the USB device of the serial port; "" for any.
    """

    port: str = ""
    link: str = "serial"
    baudrate: int = 115200
    usb: str = ""


@dataclass(frozen=True)
class Marks:
    """Framing of the numbers of a packet; bytes are hexadecimal.

    Attributes:
        header: First bytes of a packet.
        footer: Last bytes of a packet.
        checksum: Name of the checksum, one of `checksums.CHECKSUMS`.
        covers: Bytes covered by the checksum: ``packet`` (header and payload) or ``payload``.
        request: Bytes to make the device send; "" for none.
        farewell: Bytes to make the device stop; "" for none.
    """

    header: str = "aa55"
    footer: str = ""
    checksum: str = "none"
    covers: str = "packet"
    request: str = ""
    farewell: str = ""


class PacketSensor(StreamSensor):
    """Base of devices with packets of numbers.

    Args:
        line: Connection to the device.
        payload: Format of the payload, as for `struct`.
        least: Smallest number of values in the payload.
        marks: Framing of the payload.
        fps: Packets a second.

    Attributes:
        most_change: Largest change of each value of ``Frame.raw`` from packet to packet, set by the
            subclass. Without a checksum, a larger one must be confirmed by the next packet.

    Raises:
        ConfigError: Invalid option.
    """

    most_change: NDArray[np.float64]

    def __init__(self, line: Line, payload: str, least: int, marks: Marks, fps: float) -> None:
        super().__init__()
        if line.link not in _LINKS:
            raise ConfigError(f"link={line.link!r}: give {', '.join(_LINKS)}")
        self.port, self.link = line.port, line.link
        self.baudrate, self.usb = line.baudrate, line.usb
        self.payload = payload
        self.request = hex_bytes("request", marks.request)
        self.farewell = hex_bytes("farewell", marks.farewell)
        self.spec = replace(self.spec, fps=fps)
        size, self.count = payload_size(payload)
        if self.count < least:
            what = self.spec.kind
            raise ConfigError(
                f"payload={payload!r} carries {self.count} values: a {what} has "
                f"{'six' if least == 6 else least}"
            )
        self.framing = Framing(
            payload=size,
            header=hex_bytes("header", marks.header),
            footer=hex_bytes("footer", marks.footer),
            checksum=marks.checksum,
            covers=marks.covers,
        )

    def discover(self) -> list[str]:
        """Ports of the USB device if one is named; else the port if it exists."""
        if self.link != "serial":
            return []  # a network is not searched
        return attached_ports(self.port, self.usb)

    def connect(self) -> Link:
        """Open the serial port, or connect."""
        if self.link == "serial":
            return SerialLink(self.port or next(iter(self.discover()), ""), self.baudrate)
        host, colon, number = self.port.rpartition(":")
        if not colon or not number.isdecimal() or int(number) > _LAST_PORT:
            raise ConfigError(
                f"port={self.port!r}: give HOST:PORT, e.g. 192.168.1.1:49152, at most {_LAST_PORT}"
            )
        if self.link == "udp":
            return UdpLink(host, int(number)) if host else UdpLink("", listen=int(number))
        return TcpLink(host, int(number))

    def new_parser(self) -> Parser:
        """Build a parser: of whole datagrams for UDP, else of packets."""
        if self.link == "udp":
            return Datagrams(self.framing.payload)
        return PacketParser(self.framing)

    def start(self, link: Link) -> None:
        """Send the request, if there is one."""
        if self.request:
            link.send(self.request)

    def stop(self, link: Link) -> None:
        """Send the farewell, if there is one."""
        if self.farewell:
            link.send(self.farewell)

    def follows(self, before: Arrival | None, after: Arrival) -> bool:
        """Whether a packet is proven by a checksum, or by a plausible change of its values."""
        if self.framing.checksum != "none":
            return True
        return before is not None and self.is_smooth(before, after)

    def is_smooth(self, before: Arrival, after: Arrival) -> bool:
        """Whether the values change by at most `most_change` a packet."""
        return changes_by_at_most(self.most_change, before, after, self.spec.fps)

    def numbers(self, payload: bytes) -> NDArray[np.float64]:
        """Unpack the numbers of a packet, float64 (count,)."""
        return np.array(struct.unpack(self.payload, payload), np.float64)

    @abstractmethod
    def decode(self, payload: bytes) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
        """Decode a packet; see `StreamSensor.decode`."""
