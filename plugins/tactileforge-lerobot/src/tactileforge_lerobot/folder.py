"""Folder layout of a LeRobot data set of version 3."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache, lru_cache
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactileforge.plugin import DataError, DataNotFoundError, load_json

VERSION = "v3.0"
DATA = "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
VIDEO = "videos/{video_key}/chunk-{chunk_index:03d}/file-{file_index:03d}.mp4"
EPISODES = "meta/episodes/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
INFO, STATS, TASKS = "meta/info.json", "meta/stats.json", "meta/tasks.parquet"
#: Touch metadata beside LeRobot's: background, object, labels and so on of each recording.
TOUCH = "meta/tactileforge.json"
#: Version of that file.
TOUCH_VERSION = 1
#: Number of files of a chunk.
CHUNK = 1000
#: Tracks of a robot, and their features in LeRobot: one per episode, whatever its sensors.
ROBOT = {"state": "observation.state", "robot_action": "action"}
#: Feature read unchanged by LeRobot's policies; see `write_dataset`.
ENVIRONMENT = "observation.environment_state"
#: Row groups of images kept in memory: LeRobot writes one per episode.
_GROUPS = 8
#: Errors raised while reading malformed tables of other programs.
WRONG = (KeyError, IndexError, TypeError, ValueError, AttributeError, OverflowError, RecursionError)
#: Field in braces of a path: ``{file_index}`` or ``{file_index:03d}``.
_PLACE = re.compile(r"\{([a-z_]{1,40})(?::0?([1-9])d)?\}")
#: Types of numeric features.
NUMBERS = (
    *(f"float{bits}" for bits in (16, 32, 64)),
    *(f"{kind}{bits}" for kind in ("int", "uint") for bits in (8, 16, 32, 64)),
    "bool",
)
#: Largest accepted size of a feature, and rows a second; more is a damaged file.
_LARGEST, _FASTEST = 1 << 24, 1e5
#: Features of every data set.
COMMON: dict[str, dict[str, Any]] = {
    "timestamp": {"dtype": "float32", "shape": [1], "names": None},
    "frame_index": {"dtype": "int64", "shape": [1], "names": None},
    "episode_index": {"dtype": "int64", "shape": [1], "names": None},
    "index": {"dtype": "int64", "shape": [1], "names": None},
    "task_index": {"dtype": "int64", "shape": [1], "names": None},
}


def import_arrow() -> ModuleType:
    """Imports pyarrow with ``parquet``; late, as it takes half a second and ``--help`` is fast."""
    import pyarrow.parquet

    module: ModuleType = pyarrow
    return module


def chunk_and_file(number: int) -> dict[str, int]:
    """Chunk and file of the n-th file."""
    return {"chunk_index": number // CHUNK, "file_index": number % CHUNK}


@dataclass(frozen=True)
class Info:
    """``meta/info.json``.

    Attributes:
        fps: Rows per second.
        features: Description of each feature (dtype, shape, names), by its name.
        data_path: Pattern of the parquet files.
        video_path: Pattern of the videos.
    """

    fps: float
    features: dict[str, dict[str, Any]]
    data_path: str
    video_path: str

    @classmethod
    def read(cls, root: Path) -> Info:
        """Reads the file.

        Raises:
            DataNotFoundError: There is no such file.
            DataError: Its version is not supported, or its content is invalid.
        """
        path = root / INFO
        if not path.is_file():
            raise DataNotFoundError(
                f"{path}: not there; set data.root to the folder of a LeRobot data set"
            )
        try:
            info_json = load_json(path.read_text(encoding="utf-8"))
            version = str(info_json["codebase_version"])
            info = cls(
                _rate(info_json["fps"]),
                {str(key): _feature(key, value) for key, value in info_json["features"].items()},
                _pattern(info_json.get("data_path"), DATA),
                _pattern(info_json.get("video_path"), VIDEO),
            )
        except (ValueError, KeyError, TypeError, AttributeError, OSError, OverflowError) as error:
            raise DataError(f"{path}: not a LeRobot info file ({error!r})") from error
        if not version.startswith("v3."):
            raise DataError(
                f"{path}: format {version}, but only v3 can be read; convert it with LeRobot's "
                "own script"
            )
        if not 0 < info.fps <= _FASTEST or not info.features:
            raise DataError(f"{path}: fps={info.fps:g} and {len(info.features)} features")
        return info

    def data_file(self, root: Path, place: Mapping[str, int]) -> Path:
        """Path of the parquet file of a chunk and file number.

        Raises:
            DataError: The pattern has an unknown field, or leads out of the data set.
        """
        return _filled(root, "data_path", self.data_path, place)

    def video_file(self, root: Path, feature: str, place: Mapping[str, int]) -> Path:
        """Path of the video of a feature, by chunk and file number.

        Raises:
            DataError: The pattern has an unknown field, or leads out of the data set.
        """
        return _filled(root, "video_path", self.video_path, {"video_key": feature, **place})

    def pictures(self) -> list[str]:
        """Names of the features of dtype video or image."""
        return [
            key for key, feature in self.features.items() if feature["dtype"] in ("video", "image")
        ]


def _rate(value: Any) -> float:
    if type(value) not in (int, float):
        raise ValueError(f"fps is {value!r}, not a number")
    return float(value)


def _feature(name: str, value: Any) -> dict[str, Any]:
    """Checks a feature: its dtype is a plain word, its shape has sizes of a possible array."""
    feature = dict(value)
    dtype, shape = feature["dtype"], feature["shape"]
    if not isinstance(dtype, str) or not re.fullmatch(r"[a-z][a-z_]{0,30}[0-9]{0,3}", dtype):
        raise ValueError(f"{name} is of dtype {str(dtype)[:60]!r}; give {', '.join(NUMBERS)}, ...")
    if not isinstance(shape, list) or not all(
        type(size) is int and 0 <= size <= _LARGEST for size in shape
    ):
        raise ValueError(f"{name} has the shape {str(shape)[:60]}")
    return feature


def _pattern(value: Any, default: str) -> str:
    if not isinstance(value or default, str):
        raise ValueError(f"a path is {str(value)[:60]}, no text")
    return str(value or default)


def _filled(root: Path, key: str, pattern: str, fields: Mapping[str, str | int]) -> Path:
    """Fills in a path pattern; only names with a number of digits are allowed in braces.

    Unlike `str.format`, this gives the pattern of a foreign file no access to attributes.
    """
    where = f"{root / INFO}, {key}"
    try:
        name = _PLACE.sub(lambda found: _written(fields[found[1]], found[2]), pattern)
    except KeyError as error:
        raise DataError(
            f"{where}: {pattern!r} cannot be filled in ({error!r}); it may name {', '.join(fields)}"
        ) from error
    if "{" in _PLACE.sub("", pattern) or "}" in _PLACE.sub("", pattern) or len(name) > 1000:
        raise DataError(
            f"{where}: {pattern[:200]!r} cannot be filled in; it may have {', '.join(fields)} in "
            "braces, with digits as in {file_index:03d}"
        )
    return inside(root, name, where)


def _written(value: str | int, digits: str | None) -> str:
    return str(value) if digits is None or isinstance(value, str) else f"{value:0{int(digits)}d}"


def inside(root: Path, name: str, where: str) -> Path:
    """Resolves a file of a data set, and refuses paths outside of it.

    Links may lead to the shared files (``blobs``) of Hugging Face's cache.

    Args:
        root: Folder of the data set.
        name: Path of the file, relative to ``root``.
        where: Origin of the name, for messages.

    Raises:
        DataError: The file lies outside the data set.
    """
    if "\0" in name or any(len(part.encode()) > 255 for part in name.split("/")):
        raise DataError(f"{where}: {name[:60]!r} is no path; correct it")
    path = root / name
    real, folder = path.resolve(), root.resolve()
    shared = folder.parent.parent / "blobs" if folder.parent.name == "snapshots" else folder
    if not real.is_relative_to(folder) and not real.is_relative_to(shared):
        raise DataError(
            f"{where}: {name} lies outside the data set, and is not opened; put the file into "
            f"{root}, and correct the path"
        )
    return path


def column_names(path: Path) -> list[str]:
    """Names of the columns of a parquet file.

    Raises:
        DataError: It cannot be read.
    """
    try:
        return list(import_arrow().parquet.read_schema(path).names)
    except (OSError, ValueError, import_arrow().lib.ArrowException) as error:
        raise DataError(f"{path}: cannot be read ({error}); download it again") from error


@cache
def read_parquet(path: Path, columns: tuple[str, ...] | None = None) -> Any:
    """Reads some columns of a parquet file (None for all), and keeps them in memory.

    Raises:
        DataNotFoundError: There is no such file.
        DataError: It cannot be read, or lacks a column.
    """
    parquet = import_arrow().parquet
    if not path.is_file():
        raise DataNotFoundError(f"{path}: not there; download the data set again")
    try:
        return parquet.read_table(path, columns=None if columns is None else list(columns))
    except (*WRONG, OSError, import_arrow().lib.ArrowException) as error:
        raise DataError(f"{path}: cannot be read ({error}); download it again") from error


@cache
def _group_starts(path: Path) -> NDArray[np.int64]:
    """First row of each row group of a parquet file, and the number of rows."""
    about = import_arrow().parquet.read_metadata(path)
    sizes = [about.row_group(i).num_rows for i in range(about.num_row_groups)]
    return np.cumsum([0, *sizes])


@lru_cache(maxsize=_GROUPS)
def _read_group(path: Path, column: str, number: int) -> Any:
    return import_arrow().parquet.ParquetFile(path).read_row_group(number, [column])[column]


def read_cell(path: Path, column: str, row: int) -> Any:
    """Reads one cell of a large column; at most `_GROUPS` row groups stay in memory.

    Raises:
        DataError: The file cannot be read, or lacks the column.
    """
    try:
        starts = _group_starts(path)
        number = int(np.searchsorted(starts, row, side="right")) - 1
        return _read_group(path, column, number)[row - int(starts[number])].as_py()
    except (*WRONG, OSError, import_arrow().lib.ArrowException) as error:
        raise DataError(f"{path}: cannot be read ({error}); download it again") from error
