"""Packets that have only a header, which may stand inside of them as well."""

from __future__ import annotations

#: Headers in a row, a packet apart, that show where packets begin.
PROOFS = 3


class GridParser:
    """The `Parser` of packets of one size that begin with a header.

    Where packets begin is decided only when a single place fits: the header is there `PROOFS` times
    in a row, and nowhere else. A packet counts when the header of the next one follows it. After
    the first that does not, the place is looked for anew.

    Args:
        header: What a packet begins with.
        payload: Bytes behind it.

    Attributes:
        good: Packets found.
        bad: Packets that no header follows, and searches that had no single answer.
        lost: Bytes that belong to no packet.
    """

    def __init__(self, header: bytes, payload: int) -> None:
        self.header, self.size = header, len(header) + payload
        self.good = self.bad = self.lost = 0
        self._buffer = bytearray()
        self._locked = False

    @property
    def waiting(self) -> int:
        """Bytes that are not yet decided on."""
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
        """Bytes that the next decision takes."""
        headers = 1 if self._locked else PROOFS
        return headers * self.size + len(self.header)

    def _packet(self, place: int, payloads: list[bytes]) -> int:
        """Takes the packet at a place; how far to go on."""
        end = place + self.size
        if not self._buffer.startswith(self.header, end):
            self.bad += 1
            self._locked = False
            return 0
        self.good += 1
        payloads.append(bytes(self._buffer[place + len(self.header) : end]))
        return self.size

    def _search(self, place: int) -> int:
        """Looks for the one place where packets begin; how far to go on."""
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
