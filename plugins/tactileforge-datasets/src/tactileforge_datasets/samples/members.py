"""Index of the members of a tar, read from their headers alone."""

from __future__ import annotations

import tarfile
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import lru_cache
from io import FileIO
from pathlib import Path

from tactileforge.data import TAR_BLOCK, Blob
from tactileforge.errors import DataError
from tactileforge.plugins import check_pointer
from tactileforge.reading import check_regular

#: Starts of compressed files, and the programs that unpack them.
_PACKED = {b"\x1f\x8b": "gunzip", b"BZh": "bunzip2", b"\xfd7zXZ": "unxz", b"(\xb5/\xfd": "unzstd"}
#: Most bytes of a long name or of extended attributes of a member.
_LONG = 1 << 20


@dataclass(frozen=True)
class TarIndex:
    """Members of a tar.

    Attributes:
        path: Path of the tar.
        members: Place of each file by number, in order, with its name.
        damage: Fault after the last member; "" for a tar with its end.
    """

    path: str
    members: list[tuple[str, Blob]] = field(default_factory=list)
    damage: str = ""


def read_members(path: Path) -> TarIndex:
    """Index of a tar; the last ones are kept for as long as their files stay the same.

    Args:
        path: Path of the tar.

    Raises:
        DataError: The file is compressed, no tar, empty, or cannot be read.
    """
    try:
        check_regular(path)
        stat = path.stat()
        return _indexed(str(path), (stat.st_ino, stat.st_size, stat.st_mtime_ns))
    except OSError as error:
        raise DataError(f"{path}: cannot be read ({error}); correct the path") from error


@lru_cache(maxsize=64)
def _indexed(path: str, stamp: tuple[int, ...]) -> TarIndex:
    index, damage = TarIndex(path), ""
    # without a buffer, which would be filled anew for each header
    with open(path, "rb", buffering=0) as file:
        start = file.read(8)
        for mark, program in _PACKED.items():
            if start.startswith(mark):
                raise DataError(f"{path}: compressed, so no member can be found; {program} it")
        try:
            for name, offset, size in _members(file):
                index.members.append((name, Blob(path, offset, size)))
        except tarfile.TarError as error:
            damage = str(error)
    if not index.members:
        check_pointer(path)
        raise DataError(f"{path}: {damage or 'an empty tar'}; download it again")
    return TarIndex(path, index.members, damage)


def _members(file: FileIO) -> Iterator[tuple[str, int, int]]:
    """Yields name, offset and size of each file of a tar.

    Python's tarfile reads the same in twenty times the time.

    Raises:
        tarfile.TarError: The tar is damaged, or ends early.
    """
    end = file.seek(0, 2)
    place, long_name, said = 0, "", dict[str, str]()
    while place + TAR_BLOCK <= end:
        file.seek(place)
        header = file.read(TAR_BLOCK)
        if not header.strip(b"\0"):
            return
        size, kind = _checked(header, place), header[156:157]
        start = place + TAR_BLOCK
        if kind not in b"xL":
            size = int(said["size"]) if said.get("size", "").isdecimal() else size
        place = start + -(-size // TAR_BLOCK) * TAR_BLOCK
        if place < start or start + size > end:
            raise tarfile.ReadError(f"it ends within {_name(header)!r}")
        if kind in b"xL":
            if size > _LONG:
                raise tarfile.ReadError(f"a name of {size} bytes")
            content = file.read(size)
            # the name or the attributes of the member that follows: GNU's and POSIX's way
            if kind == b"L":
                long_name = _text(content)
            else:
                said = _attributes(content)
        else:
            if kind in b"0\0007":
                yield said.get("path") or long_name or _name(header), start, size
            long_name, said = "", {}
    raise tarfile.ReadError("it ends before its end mark")


def _checked(header: bytes, place: int) -> int:
    """Size of the content of a header.

    Raises:
        tarfile.TarError: It is not a header, by its checksum.
    """
    stated = _number(header[148:156])
    # the checksum takes its own field for blanks
    if stated != sum(header) - sum(header[148:156]) + 8 * 32:
        raise tarfile.ReadError(f"no tar, or damaged at byte {place}")
    size = _number(header[124:136])
    if size < 0:
        raise tarfile.ReadError(f"no size at byte {place}")
    return size


def _number(digits: bytes) -> int:
    """Octal digits, or a number of GNU tar in base 256; -1 for others."""
    if digits[:1] == b"\x80":
        return int.from_bytes(digits[1:])
    try:
        return int(digits.strip(b" \0") or b"0", 8)
    except ValueError:
        return -1


def _text(raw: bytes) -> str:
    # names become keys and messages, which surrogates would break
    return raw.partition(b"\0")[0].decode("utf-8", "backslashreplace")


def _name(header: bytes) -> str:
    name = _text(header[:100])
    # GNU's headers have times where ustar has the start of a long path
    prefix = _text(header[345:500]) if header[257:263] == b"ustar\0" else ""
    return f"{prefix}/{name}" if prefix else name


def _attributes(content: bytes) -> dict[str, str]:
    """Extended attributes of a member, lines of ``LENGTH KEY=VALUE``."""
    found: dict[str, str] = {}
    while content:
        length, _, _ = content.partition(b" ")
        # a length of 0 would go round for ever
        if not length.isdigit() or not 0 < int(length) <= len(content):
            break
        key, _, value = content[len(length) + 1 : int(length) - 1].partition(b"=")
        found[_text(key)] = _text(value)
        content = content[int(length) :]
    return found
