"""Tars by patterns: on this machine, or behind any URL for webdataset."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from braceexpand import braceexpand

from tactileforge.data import ShardFolder
from tactileforge.errors import ConfigError, DataNotFoundError, nearest_name
from tactileforge.reading import kind_of, matching_files

#: Most tars of a pattern.
_MOST = 1_000_000
_RANGE = re.compile(r"\{(-?\d{1,15})\.\.(-?\d{1,15})[.}]")
_URL = re.compile(r"[a-z][a-z0-9+]+://")


@dataclass(frozen=True)
class Tar:
    """A tar of a data set.

    Attributes:
        folder: Its folder, or the URL of that.
        file: Name of the file in the folder.
    """

    folder: ShardFolder
    file: str

    @property
    def name(self) -> str:
        """Name without the ending, the start of keys."""
        return self.file.removesuffix(".tar")

    def get(self) -> Path:
        """Its path on this machine; fetches it if needed.

        Raises:
            DataError: It cannot be fetched.
        """
        return self.folder.get_unchecked(self.file)


def find_tars(
    folder: ShardFolder, patterns: Sequence[str], bad: Callable[[str], object]
) -> list[Tar]:
    """Tars of a folder by patterns, each once.

    Args:
        folder: The folder, or its URL.
        patterns: Names with brace ranges, ``train-{000..099}.tar``; on this machine also with
            ``*``, ``?`` and ``[``.
        bad: Is told of folders, pipes and the like in the place of a tar, a line each.

    Raises:
        ConfigError: A pattern is not a path below the folder, or needs a list of a server's files.
        DataNotFoundError: No file of this machine matches; names the nearest.
    """
    found: dict[str, None] = {}
    for pattern in patterns:
        for name in _expanded(pattern):
            if folder.remote and set("*[") & set(name):
                raise ConfigError(
                    f"data.tars: {name}: a server does not list its files; give a range of braces: "
                    "'data.tars=train-{000000..000099}.tar'"
                )
            found |= dict.fromkeys([name] if folder.remote else _local(folder.path, name, bad))
    return [Tar(folder, name) for name in found]


def _expanded(pattern: str) -> list[str]:
    # before braces are expanded, which would fill the memory with names
    for low, high in _RANGE.findall(pattern):
        if abs(int(high) - int(low)) >= _MOST:
            raise ConfigError(f"data.tars: {pattern} names more than {_MOST:,} tars; correct it")
    if _URL.match(pattern) or pattern.startswith("/") or ".." in pattern.split("/"):
        raise ConfigError(
            f"data.tars: {pattern} must be a name in data.root; give its folder or URL there"
        )
    try:
        return list(braceexpand(pattern))
    except ValueError as error:
        raise ConfigError(f"data.tars: {pattern}: {error}; write train-{{000..099}}.tar") from error


def _local(root: Path, name: str, bad: Callable[[str], object]) -> list[str]:
    if not root.is_dir():
        raise DataNotFoundError(f"{root}: no such folder; set data.root to the folder of the tars")
    if not set("*?[") & set(name) or (root / name).is_file():
        if not (root / name).is_file():
            near = nearest_name(name, [path.name for path in root.glob("*.tar")])
            raise DataNotFoundError(f"{root / name}: no such file{near} Correct data.tars")
        return [name]
    files, odd = matching_files(root, [name], "webdataset")
    for path in odd:
        bad(f"{path}: no file but {kind_of(path)}; left out")
    return [path.relative_to(root).as_posix() for path in files]
