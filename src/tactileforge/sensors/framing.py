"""Framing: packets in a byte stream, found by header, length, checksum and footer.

Everything here is a pure function of the bytes so far: the same packets come out, however the
stream is cut into pieces.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from tactileforge.errors import ConfigError, unknown
from tactileforge.sensors.checksums import CHECKSUMS


class Parser(Protocol):
    """Parser of bytes to payloads; a protocol beyond `Framing` brings its own.

    Attributes:
        good: Number of packets.
        bad: Number of false packets.
        lost: Number of bytes outside packets.
    """

    good: int
    bad: int
    lost: int

    def feed(self, data: bytes) -> list[bytes]:
        """Take the next bytes; returns the completed payloads, oldest first."""
        ...


@dataclass(frozen=True, kw_only=True)
class Framing:
    """Layout of packets: header, payload, checksum, footer, in this order.

    Without a checksum, a packet counts only with a mark on both sides of it: its own header and
    footer, the footer of the previous packet, or the header of the next one (it then comes when
    that one begins). So a packet with lost bytes is not taken for a whole one.

    Attributes:
        payload: Size of the payload of all packets or, with ``length_at``, of the longest, bytes.
        header: First bytes of a packet.
        footer: Last bytes of a packet.
        checksum: Name of the checksum between payload and footer, one of `CHECKSUMS`.
        covers: Bytes covered by the checksum: ``packet`` (header and payload) or ``payload``.
        length_at: Position of the length in the payload, for packets of several lengths; None for
            packets of one length.
        length_format: Format of the length, as for `struct`.
        length_plus: Bytes of payload not counted by the length.
        valid: Function that tells whether a payload is possible; None takes all. A protocol
            without header or checksum needs it, as its footer may also stand inside a payload.

    Raises:
        ConfigError: Contradicting options.
    """

    payload: int
    header: bytes = b""
    footer: bytes = b""
    checksum: str = "none"
    covers: str = "packet"
    length_at: int | None = None
    length_format: str = "B"
    length_plus: int = 0
    valid: Callable[[bytes], bool] | None = None

    def __post_init__(self) -> None:
        if self.checksum not in CHECKSUMS:
            raise ConfigError(unknown("checksum", self.checksum, CHECKSUMS))
        if self.covers not in ("packet", "payload"):
            raise ConfigError(unknown("part that a checksum covers", self.covers, _PARTS))
        if not self.header and not self.footer:
            raise ConfigError("packets have neither header nor footer: give at least one")
        if self.payload < 1:
            raise ConfigError(f"packets have a payload of {self.payload} bytes: give at least 1")
        if self.length_at is not None and not self.header:
            raise ConfigError("packets that say their length need a header")


_PARTS = ("packet", "payload")


def payload_size(payload: str) -> tuple[int, int]:
    """Number of bytes and of values of a payload.

    Args:
        payload: Format of the payload, as for `struct`.

    Raises:
        ConfigError: Invalid format.

    Example:
        >>> payload_size("<6f")
        (24, 6)
    """
    try:
        size = struct.calcsize(payload)
        return size, len(struct.unpack(payload, bytes(size)))
    except struct.error as error:
        raise ConfigError(f"payload={payload!r} ({error}); write for example '<6f'") from error


def hex_bytes(what: str, text: str) -> bytes:
    r"""Parse the hexadecimal bytes of an option.

    Raises:
        ConfigError: Invalid text; the message names the option.

    Example:
        >>> hex_bytes("header", "aa55")
        b'\xaaU'
    """
    try:
        return bytes.fromhex(text)
    except ValueError as error:
        raise ConfigError(f"{what}={text!r} is not hexadecimal; write for example aa55") from error


class PacketParser:
    r"""The `Parser` of a `Framing`.

    Args:
        framing: Layout of packets.

    Example:
        >>> parser = PacketParser(Framing(payload=2, header=b"\xaa", checksum="sum8"))
        >>> parser.feed(b"noise\xaa\x01"), parser.feed(b"\x02\xad"), parser.lost
        ([], [b'\x01\x02'], 5)
    """

    def __init__(self, framing: Framing) -> None:
        self.framing = framing
        self.good = self.bad = self.lost = 0
        self._checksum = CHECKSUMS[framing.checksum]
        #: Bytes around the payload.
        self._around = len(framing.header) + self._checksum.size + len(framing.footer)
        unproven = framing.checksum == "none"
        #: Bytes required behind, or before, a packet without any other proof.
        self._next = framing.header if unproven and not framing.footer else b""
        self._before = framing.footer if not framing.header else b""
        self._buffer = bytearray()
        self._anchored = not self._before

    @property
    def waiting(self) -> int:
        """Number of buffered bytes."""
        return len(self._buffer)

    def feed(self, data: bytes) -> list[bytes]:
        """Take the next bytes; see `Parser.feed`."""
        self._buffer += data
        payloads: list[bytes] = []
        place = 0
        while True:
            place, payload = self._step(place)
            if payload is None:
                break
            payloads += payload
        del self._buffer[:place]
        return payloads

    def _step(self, place: int) -> tuple[int, list[bytes] | None]:
        """Step from a position: returns the next one and its payload; None to wait for bytes."""
        start = self._start(place)
        self.lost += start - place
        buffer = self._buffer
        if not self._anchored or not buffer.startswith(self.framing.header, start):
            return start, None
        size = self._size(start)
        if size is None:
            return start, None
        end = start + size
        if size and len(buffer) < end + len(self._next):
            return start, None
        payload = bytes(buffer[start + len(self.framing.header) : end - self._after()])
        valid = self.framing.valid
        if size and self._holds(start, end) and (valid is None or valid(payload)):
            self.good += 1
            return end, [payload]
        self.bad += 1
        # after a false packet the search goes on inside it: a true one may begin at any of its
        # bytes
        if self._before:
            self._anchored = False
            return start, []
        self.lost += 1
        return start + 1, []

    def _start(self, place: int) -> int:
        """First possible start of a packet, at a position or after it."""
        mark = self.framing.header or self._before
        if self._anchored and not self.framing.header:
            return place
        found_at = self._buffer.find(mark, place)
        if found_at < 0:  # the mark may have begun: its last byte alone can still be missing
            return max(place, len(self._buffer) - len(mark) + 1)
        if self.framing.header:
            return found_at
        self._anchored = True
        return found_at + len(mark)

    def _after(self) -> int:
        """Number of bytes between the payload and the end of a packet."""
        return self._checksum.size + len(self.framing.footer)

    def _size(self, start: int) -> int | None:
        """Size of the packet at a position, bytes; 0 for an impossible one, None if unknown yet."""
        framing = self.framing
        if framing.length_at is None:
            return framing.payload + self._around
        at = start + len(framing.header) + framing.length_at
        width = struct.calcsize(framing.length_format)
        if len(self._buffer) < at + width:
            return None
        stated = int(struct.unpack_from(framing.length_format, self._buffer, at)[0])
        payload = stated + framing.length_plus
        fits = framing.length_at + width <= payload <= framing.payload
        return payload + self._around if fits else 0

    def _holds(self, start: int, end: int) -> bool:
        """Whether footer, checksum and the next header are in place."""
        buffer, framing = self._buffer, self.framing
        if not buffer.startswith(self._next, end):
            return False
        if not buffer.startswith(framing.footer, end - len(framing.footer)):
            return False
        if not self._checksum.size:
            return True
        stop = end - self._after()
        first = start if framing.covers == "packet" else start + len(framing.header)
        return buffer.startswith(self._checksum.of(bytes(buffer[first:stop])), stop)


class Datagrams:
    """The `Parser` of a link with separate packets: each must have the right length.

    Args:
        size: Size of a datagram, bytes.
    """

    def __init__(self, size: int) -> None:
        self.size = size
        self.good = self.bad = self.lost = 0

    def feed(self, data: bytes) -> list[bytes]:
        """Take one datagram; see `Parser.feed`."""
        if not data:
            return []
        if len(data) != self.size:
            self.bad += 1
            self.lost += len(data)
            return []
        self.good += 1
        return [data]
