"""Headers of tar files within limits, for Python's tarfile."""

from __future__ import annotations

import tarfile
from typing import Self

#: Most bytes of a header that stands before another: a long name, or values of PAX.
_MOST_HEADER = 1 << 20
#: Types of such headers: those of PAX, of Solaris, and of GNU.
_BEFORE = (tarfile.XHDTYPE, tarfile.XGLTYPE, tarfile.SOLARIS_XHDTYPE, b"L", b"K")


class BoundedTarInfo(tarfile.TarInfo):
    """A member of a tar, as ``tarinfo`` of `tarfile.open`: its further headers are small.

    Python reads them whole, of whatever size they say.
    """

    @classmethod
    def frombuf(cls, buf: bytes | bytearray, encoding: str, errors: str) -> Self:
        """A member by its header.

        Raises:
            ReadError: It is a header of another one, and larger than any name or list of values.
        """
        made = super().frombuf(buf, encoding, errors)
        if made.type in _BEFORE and made.size > _MOST_HEADER:
            raise tarfile.ReadError(f"a header of {made.size} bytes")
        return made
