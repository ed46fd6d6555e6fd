"""Base of drivers whose packets carry numbers, over a serial port or the network."""

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

#: What a device without pictures has for one.
NO_PICTURE: NDArray[np.uint8] = np.zeros((0, 0, 3), np.uint8)
_LINKS = ("serial", "udp", "tcp")
#: Largest number of a port of the network.
_LAST_PORT = 65535


@dataclass(frozen=True)
class Line:
    """Connection to a device.

    Attributes:
        port: Path of the serial port, or ``HOST:PORT``; ``:PORT`` takes datagrams that
            anybody sends to this machine.
        link: ``serial``, ``udp`` or ``tcp``.
        baudrate: Bits a second.
        usb: Vendor and product of the USB device that the serial port belongs to.
    """

    port: str = ""
    link: str = "serial"
    baudrate: int = 115200
    usb: str = ""


@dataclass(frozen=True)
class Marks:
    """Framing of the numbers of a packet; all but the checksum hexadecimal.

    Attributes:
        header: What a packet begins with.
        footer: What it ends with.
        checksum: See `checksums.CHECKSUMS`.
        covers: What the checksum is of: ``packet`` (header and payload) or ``payload``.
        request: What makes the device send; "" for one that sends by itself.
        farewell: What makes it stop.
    """

    header: str = "aa55"
    footer: str = ""
    checksum: str = "none"
    covers: str = "packet"
    request: str = ""
    farewell: str = ""


class PacketSensor(StreamSensor):
    """A device that sends packets of numbers.

    Args:
        line: How it is reached.
        payload: What a packet carries, as `struct` writes it.
        least: How many numbers that must be.
        marks: What is around them.
        fps: Packets a second.

    Attributes:
        most_change: Largest change of each value of ``Frame.raw`` from packet to packet, set by the
            subclass. Where there is no checksum, a larger one must be borne out by the next packet.

    Raises:
        ConfigError: An option makes no sense.
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
        """Ports of the USB device, if one is named; else the port, if it exists."""
        if self.link != "serial":
            return []  # a network is not searched
        return attached_ports(self.port, self.usb)

    def connect(self) -> Link:
        """Opens the serial port, or connects."""
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
        """Whole datagrams of UDP; else packets."""
        if self.link == "udp":
            return Datagrams(self.framing.payload)
        return PacketParser(self.framing)

    def start(self, link: Link) -> None:
        """Sends the request, if there is one."""
        if self.request:
            link.send(self.request)

    def stop(self, link: Link) -> None:
        """Sends the farewell, if there is one."""
        if self.farewell:
            link.send(self.farewell)

    def follows(self, before: Arrival | None, after: Arrival) -> bool:
        """Whether it has changed by no more than can be; a checksum says it as well."""
        if self.framing.checksum != "none":
            return True
        return before is not None and self.is_smooth(before, after)

    def is_smooth(self, before: Arrival, after: Arrival) -> bool:
        """Whether it has changed by no more than can be from packet to packet."""
        return changes_by_at_most(self.most_change, before, after, self.spec.fps)

    def numbers(self, payload: bytes) -> NDArray[np.float64]:
        """The numbers of a packet, float64 (count,)."""
        return np.array(struct.unpack(self.payload, payload), np.float64)

    @abstractmethod
    def decode(self, payload: bytes) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
        """See `StreamSensor.decode`."""
