"""Raw values of devices, at their own rate, in a shard beside its recordings."""

from __future__ import annotations

import io
import re
import tarfile
import zlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from tokenize import TokenError
from typing import TypeAlias
from zipfile import BadZipFile, ZipFile

import numpy as np
from numpy.typing import NDArray

from tactileforge.data import shard_members
from tactileforge.errors import DataError

#: Name of a member of a shard with raw values.
_RAW = re.compile(r"raw\.(?P<name>.+)\.npz")

#: Errors of zipfile and numpy on damaged bytes.
_DAMAGE = (
    *(ValueError, KeyError, OSError, EOFError, BadZipFile, zlib.error),
    *(MemoryError, NotImplementedError, RuntimeError),  # wrong size, method, password
    *(ArithmeticError, SyntaxError, TokenError, TypeError),  # numpy reads headers as Python
)

#: Times, float64 (N,), s, and values, float32 (N, ...), of a device.
Raw: TypeAlias = tuple[NDArray[np.float64], NDArray[np.float32]]


def append_raw(path: Path, raw: Mapping[str, Raw]) -> None:
    """Adds raw values to a shard; readers of recordings skip them."""
    if not raw:
        return
    # USTAR, as the recordings' own members: other formats would add headers between them
    with tarfile.open(path, "a", format=tarfile.USTAR_FORMAT) as tar:
        for name, (times, values) in raw.items():
            content = io.BytesIO()
            np.savez(content, times=times, values=values)
            info = tarfile.TarInfo(f"raw.{name}.npz")
            info.size = content.tell()
            content.seek(0)
            tar.addfile(info, content)


def read_raw(path: Path) -> dict[str, Raw]:
    """Raw values of the devices in a recorded shard.

    Args:
        path: File of the shard.

    Returns:
        Times, float64 (N,), s since the begin of the take, and values, float32 (N, ...), by name of
        the sensor; (N, 6) in N and N m for a wrench sensor, in its own axes and without tare.

    Raises:
        DataError: The file is not a shard, or is damaged.
    """
    values_by_name: dict[str, Raw] = {}
    for name, content in shard_members(path):
        if match := _RAW.fullmatch(name):
            try:
                values_by_name[match["name"]] = _arrays(content)
            except _DAMAGE as error:
                raise DataError(f"{path}: {name} is damaged ({error}); record it again") from error
    return values_by_name


def _arrays(content: bytes) -> Raw:
    # our files are not compressed, so a larger size is a damaged file or a decompression bomb
    with ZipFile(io.BytesIO(content)) as archive:
        if (size := sum(member.file_size for member in archive.infolist())) > len(content):
            raise ValueError(f"{len(content)} bytes that state to be {size}")
    with np.load(io.BytesIO(content), allow_pickle=False) as held:
        return held["times"], held["values"]


def merge_raw(paths: Sequence[Path]) -> dict[str, Raw]:
    """Concatenates the raw values of several segments of one take, in order."""
    parts: dict[str, list[Raw]] = {}
    for path in paths:
        for name, raw in read_raw(path).items():
            parts.setdefault(name, []).append(raw)
    return {
        name: (np.concatenate([t for t, _ in held]), np.concatenate([v for _, v in held]))
        for name, held in parts.items()
    }
