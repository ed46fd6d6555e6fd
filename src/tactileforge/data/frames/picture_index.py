"""Headers of image files, kept on disk: the second start over 10^5 images opens none of them."""

from __future__ import annotations

import logging
import os
import time
from collections.abc import Callable, Sequence
from hashlib import blake2b
from pathlib import Path
from typing import NamedTuple
from zipfile import BadZipFile

import numpy as np
from numpy.typing import NDArray

from tactileforge.util.files import cache_folder, new_part

log = logging.getLogger(__name__)

#: To be raised with every change of what a header is checked for.
_RULES = 1
#: Largest number of images of one index, and of bytes of all.
_MOST, _MOST_BYTES = 1 << 20, 1 << 28
#: Fewer images are faster read than kept.
_LEAST = 100
#: Seconds since the last change of a file from which on a further one changes its times: those of
#: a memory card count in steps of 2 s.
_SETTLED = 2.0
_ROW = np.dtype([("key", "<u8"), ("height", "<u4"), ("width", "<u4"), ("is_turned", "?")])


class ImageHeader(NamedTuple):
    """What an image's header says: height and width, pixels, upright; and whether EXIF turns it."""

    height: int
    width: int
    is_turned: bool


class PictureIndex:
    """Headers of the images of a folder, kept in the cache of the program for all processes.

    A header is found by path, size, inode and times of its file: one of a changed or a new file is
    read. At most 2^20 images of a folder are kept, and 256 MB in all; of fewer than 100 none.

    Args:
        folder: Folder of the images, at any depth.

    Example:
        >>> index = PictureIndex(Path("touches"))
        >>> index.heads(["touches/0.png"], read=lambda path: ImageHeader(240, 320, False))
        [ImageHeader(height=240, width=320, is_turned=False)]
        >>> index.save()
    """

    def __init__(self, folder: Path) -> None:
        from PIL import __version__ as reader

        self._start = str(folder)
        name = f"{_RULES} {reader} {folder.resolve()}"
        digest = blake2b(os.fsencode(name), digest_size=16).hexdigest()
        self._file = cache_folder() / "pictures" / f"{digest}.npz"
        self._rows: NDArray[np.void] | None = None
        self._keys = np.empty(0, np.uint64)
        self._new: list[tuple[int, ImageHeader]] = []

    def heads(self, paths: Sequence[str], read: Callable[[str], ImageHeader]) -> list[ImageHeader]:
        """The header of each image.

        Args:
            paths: Paths of the images, below the folder as it was given.
            read: Reads the header of a file that is not known; its errors are passed on.
        """
        if self._rows is None:
            self._rows = _load(self._file)
            self._keys = np.ascontiguousarray(self._rows["key"])  # a search would copy it each time
        keys = [self._key(path) for path in paths]
        wanted = np.array([key for key, _ in keys], np.uint64)
        places = np.minimum(np.searchsorted(self._keys, wanted), len(self._keys) - 1)
        out = []
        for path, (key, is_settled), place in zip(paths, keys, places.tolist(), strict=True):
            if key and place >= 0 and int(self._keys[place]) == key:
                _, height, width, is_turned = self._rows[place].item()
                out.append(ImageHeader(height, width, is_turned))
                continue
            out.append(read(path))
            # what was changed while it was read has another key at the next start
            if is_settled and self._key(path)[0] == key:
                self._new.append((key, out[-1]))
        return out

    def save(self) -> None:
        """Writes new headers, beside those that other processes wrote; without a cache, nothing."""
        if len(self._new) < _LEAST:
            return
        new = np.array([(key, *head) for key, head in self._new], _ROW)
        try:
            rows = np.concatenate([new, _load(self._file)])
            rows = rows[np.sort(np.unique(rows["key"], return_index=True)[1])][:_MOST]
            with new_part(self._file, ".npz") as part:
                np.savez(part, rows=np.sort(rows, order="key"))
                part.replace(self._file)
            _sweep(self._file)
        except OSError as error:
            log.debug("%s: headers of images are not kept (%s)", self._file, error)
        self._rows, self._new = None, []

    def _key(self, path: str) -> tuple[int, bool]:
        """Number of the present state of a file, and whether it is old enough; 0 for none."""
        try:
            about = os.stat(path)
        except OSError:
            return 0, False
        state = (about.st_size, about.st_ino, about.st_mtime_ns, about.st_ctime_ns)
        text = f"{path.removeprefix(self._start)}\0{state}"
        key = int.from_bytes(blake2b(os.fsencode(text), digest_size=8).digest(), "little")
        return key, time.time() - max(about.st_mtime, about.st_ctime) > _SETTLED


def _load(file: Path) -> NDArray[np.void]:
    """Rows of an index, by rising key; none of a missing or damaged one."""
    try:
        with file.open("rb") as raw, np.load(raw, allow_pickle=False) as content:
            rows: NDArray[np.void] = content["rows"]
        if rows.dtype == _ROW and rows.ndim == 1:
            os.utime(file)  # those that are used are the last to be removed
            return rows
    except (OSError, ValueError, KeyError, EOFError, BadZipFile):
        pass  # it is a cache: written anew
    return np.empty(0, _ROW)


def _sweep(kept: Path) -> None:
    """Removes indices, the longest unused first, until all take no more than their limit."""
    found = [(path.stat(), path) for path in kept.parent.glob("*.npz") if path != kept]
    free = _MOST_BYTES - kept.stat().st_size
    for about, path in sorted(found, key=lambda one: -one[0].st_mtime):
        free -= about.st_size
        if free < 0:
            path.unlink(missing_ok=True)
