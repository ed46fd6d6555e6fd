"""A parser of packets with a header alone; its bytes may occur among the values as well."""

from __future__ import annotations

#: Headers in a row, a packet apart, as proof of the start of a packet.
PROOFS = 3


class GridParser:
    """A `Parser` of packets of fixed size, with a header and nothing else to find them by.

    The start of packets is decided only when a single offset fits, with the header `PROOFS` times
    in a row. A packet is accepted when the header of the next one follows it. After the first one
    without such a header, the start is searched again.

    Args:
        header: First bytes of a packet.
        payload: Bytes of a packet after the header.

    Attributes:
        good: Accepted packets.
        bad: Packets without a header after them, and searches with no offset or several.
        lost: Bytes outside of packets.
    """

    def __init__(self, header: bytes, payload: int) -> None:
        self.header, self.size = header, len(header) + payload
        self.good = self.bad = self.lost = 0
        self._buffer = bytearray()
        self._locked = False

    @property
    def waiting(self) -> int:
        """Bytes not yet decided on."""
        return len(self._buffer)

    def feed(self, data: bytes) -> list[bytes]:
        """Takes the next bytes; see `Parser.feed`."""
        self._buffer += data
        payloads: list[bytes] = []
        place = 0
        while len(self._buffer) >= place + self._needed():
            step = self._packet(place, payloads) if self._locked else self._search(place)
            place += step
        del self._buffer[:place]
        return payloads

    def _needed(self) -> int:
        """Bytes needed for the next decision."""
        headers = 1 if self._locked else PROOFS
        return headers * self.size + len(self.header)

    def _packet(self, place: int, payloads: list[bytes]) -> int:
        """Takes the packet at a place, and returns the number of bytes to advance."""
        end = place + self.size
        if not self._buffer.startswith(self.header, end):
            self.bad += 1
            self._locked = False
            return 0
        self.good += 1
        payloads.append(bytes(self._buffer[place + len(self.header) : end]))
        return self.size

    def _search(self, place: int) -> int:
        """Searches the start of packets, and returns the number of bytes to advance."""
        fits = []
        start, end = place - 1, place + self.size + len(self.header) - 1
        while (start := self._buffer.find(self.header, start + 1, end)) >= 0:
            fits += [start] if self._fits(start) else []
        self._locked = len(fits) == 1
        self.bad += not self._locked
        step = fits[0] - place if self._locked else self.size
        self.lost += step
        return step

    def _fits(self, start: int) -> bool:
        places = range(start, start + PROOFS * self.size, self.size)
        return all(self._buffer.startswith(self.header, offset) for offset in places)
