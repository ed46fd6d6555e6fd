"""List of the episodes of a LeRobot data set, versions 2.0, 2.1 and 3."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from tactileforge.data import without_companions
from tactileforge.errors import DataError, DataNotFoundError
from tactileforge.plugins import load_json
from tactileforge.reading import regular_text
from tactileforge_lerobot import folder
from tactileforge_lerobot.info import Info
from tactileforge_lerobot.parquet import WRONG, column_names, read_parquet

#: Required columns of each file of episodes, and required keys of a line of episodes.
_NEEDED = ("episode_index", "length", "data/chunk_index", "data/file_index")
_NEEDED_2 = _NEEDED[:2]


def read_episodes(root: Path, info: Info) -> list[dict[str, Any]]:
    """Reads number, length, tasks and, in version 3, location of each episode, in order.

    Raises:
        DataNotFoundError: There are none.
        DataError: A file is damaged, or an episode is listed twice.
    """
    place = root / ("meta/episodes" if info.version == 3 else folder.EPISODES_2)
    needed = _NEEDED if info.version == 3 else _NEEDED_2
    rows = list(_tables(place) if info.version == 3 else json_lines(place))
    if not rows:
        raise DataNotFoundError(f"{place}: no episodes there")
    seen = set()
    for row in rows:
        for name in needed:
            if type(row.get(name)) is not int or not 0 <= row[name] < 1 << 40:
                raise DataError(
                    f"{place}: {name} is {str(row.get(name))[:60]}, no whole number; download the "
                    "data set again"
                )
        if row["episode_index"] in seen:
            raise DataError(
                f"{place}: episode {row['episode_index']} is there twice; download the data set "
                "again"
            )
        seen.add(row["episode_index"])
    return sorted(rows, key=lambda row: int(row["episode_index"]))


def _tables(place: Path) -> Iterator[dict[str, Any]]:
    """Rows of the tables of episodes of version 3, without statistics."""
    for path in sorted(without_companions([*place.glob("*/*.parquet")], place)):
        names = column_names(path)
        if lacks := [name for name in _NEEDED if name not in names]:
            raise DataError(f"{path}: no column {lacks[0]}; download it again")
        wanted = tuple(name for name in names if not name.startswith("stats/"))
        try:
            yield from read_parquet(path, wanted).to_pylist()
        except WRONG as error:
            raise DataError(f"{path}: cannot be read ({error!r}); download it again") from error


def json_lines(path: Path) -> Iterator[dict[str, Any]]:
    """Yields the objects of a file with one JSON object a line.

    Raises:
        DataNotFoundError: There is no such file.
        DataError: It cannot be read; names the line.
    """
    if not path.is_file():
        raise DataNotFoundError(f"{path}: not there; download the data set again")
    try:
        for number, line in enumerate(regular_text(path).split("\n"), 1):
            if line.strip():
                yield _json_object(line, f"{path}, line {number}")
    except (OSError, UnicodeError) as error:
        raise DataError(f"{path}: cannot be read ({error}); download it again") from error


def _json_object(line: str, where: str) -> dict[str, Any]:
    try:
        held = load_json(line)
    except ValueError as error:
        raise DataError(f"{where}: not JSON ({error}); download the data set again") from error
    if not isinstance(held, dict):
        raise DataError(f"{where}: {line.strip()[:60]} is not a JSON object; download it again")
    return held


def read_tasks(root: Path, info: Info) -> dict[int, str]:
    """Reads the words of each task, by its number; empty without a file of tasks.

    Raises:
        DataError: The file is damaged.
    """
    path = root / (folder.TASKS if info.version == 3 else folder.TASKS_2)
    if not path.is_file():
        return {}
    if info.version == 2:
        held = list(json_lines(path))
        numbers, words = ([row.get(name) for row in held] for name in ("task_index", "task"))
    else:
        table = read_parquet(path).to_pydict()
        numbers = table.get("task_index", [])
        words = table.get("task", table.get("__index_level_0__", []))
    return {
        number: str(word)
        for number, word in zip(numbers, words, strict=False)
        if type(number) is int and word is not None
    }
