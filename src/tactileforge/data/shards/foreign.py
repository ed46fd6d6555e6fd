"""Tar files of other programs, told from shards by the names of their members."""

from __future__ import annotations

import os
import re
import tarfile
from pathlib import Path

from tactileforge.data.frames.image_codecs import CODECS, GROUPS
from tactileforge.errors import DataError, command
from tactileforge.util.pointers import check_pointer
from tactileforge.util.regular import open_regular
from tactileforge.util.tars import BoundedTarInfo

#: Members to look at: a shard has a picture among the first few, after a description.
_LOOKED = 64
_GROUP = "|".join(re.escape(prefix) for prefix in GROUPS.values() if prefix)
#: Names of images of a shard. Names of descriptions (``000000.json``) are common elsewhere, too.
_OURS = re.compile(rf"\d{{6,}}\.({_GROUP})?\d{{4,}}\.({'|'.join(CODECS)})")


class ForeignShardError(DataError):
    """Error for a tar file of another program."""


_DESCRIPTION = re.compile(r"\d{6,}\.json")


def check_foreign(path: Path) -> None:
    """Check for a tar file of another program.

    Args:
        path: File without a readable recording.

    Raises:
        ForeignShardError: None of its first members is an image of a shard; the message lists
            their endings.
        DataError: It is a pointer of Git LFS.
    """
    check_pointer(path)
    names = _member_names(path)
    if not _are_foreign(names):
        return
    endings = sorted({Path(name).suffix.removeprefix(".") for name in names})
    kind = "webdataset" if len(endings) > 1 or "/" not in names[0] else "tar file"
    raise ForeignShardError(
        f"{path}: a {kind} of another program ({', '.join(endings).strip(', ') or 'no endings'}),"
        " not one of tactileforge's; read it with data=webdataset and a layout, which "
        f"{command('data', 'inspect', str(path.parent))} guesses (docs/data.md)"
    )


def is_foreign(path: Path) -> bool:
    """Whether a file is a tar file without images of a shard among its first members."""
    return _are_foreign(_member_names(path))


def _are_foreign(names: list[str]) -> bool:
    if not names or any(_OURS.fullmatch(name) for name in names):
        return False
    # descriptions alone are a shard that was cut off before its first picture
    return not all(_DESCRIPTION.fullmatch(name) for name in names)


def _member_names(path: Path) -> list[str]:
    """Names of the first files of a tar file; [] for another file."""
    names: list[str] = []
    try:
        # ":" for no compression: the first members of a compressed tar cost its unpacking
        with (
            os.fdopen(open_regular(path), "rb") as file,
            tarfile.open(None, "r:", file, tarinfo=BoundedTarInfo) as tar,
        ):
            for member in tar:
                if member.isfile():
                    names.append(member.name)
                if len(names) >= _LOOKED:
                    break
    except (tarfile.TarError, OSError, EOFError, ValueError, DataError):
        return names
    return names
