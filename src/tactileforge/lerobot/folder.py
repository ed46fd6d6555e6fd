"""Folder layout of a LeRobot data set of version 3."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache, lru_cache
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactileforge.errors import ConfigError, DataError, DataNotFoundError
from tactileforge.untrusted import load_json

VERSION = "v3.0"
DATA = "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
VIDEO = "videos/{video_key}/chunk-{chunk_index:03d}/file-{file_index:03d}.mp4"
EPISODES = "meta/episodes/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
INFO, STATS, TASKS = "meta/info.json", "meta/stats.json", "meta/tasks.parquet"
#: Touch metadata beside LeRobot's: background, object, labels and so on of each recording.
TOUCH = "meta/tactileforge.json"
#: Version of that file.
TOUCH_VERSION = 1
#: Files of a chunk.
CHUNK = 1000
#: Tracks of a robot, and LeRobot's features of them: one of an episode, whatever its sensors.
ROBOT = {"state": "observation.state", "robot_action": "action"}
#: Feature that LeRobot's policies read as it is; see `write_dataset`.
ENVIRONMENT = "observation.environment_state"
#: Row groups of images that stay in memory: LeRobot writes one an episode.
_GROUPS = 8
#: Features that every data set has.
COMMON: dict[str, dict[str, Any]] = {
    "timestamp": {"dtype": "float32", "shape": [1], "names": None},
    "frame_index": {"dtype": "int64", "shape": [1], "names": None},
    "episode_index": {"dtype": "int64", "shape": [1], "names": None},
    "index": {"dtype": "int64", "shape": [1], "names": None},
    "task_index": {"dtype": "int64", "shape": [1], "names": None},
}


def import_arrow() -> ModuleType:
    """The package pyarrow, with ``parquet``.

    Raises:
        ConfigError: It is not installed.
    """
    try:
        import pyarrow.parquet
    except ImportError as error:
        raise ConfigError(
            "LeRobot data sets are parquet files: pip install 'tactileforge[lerobot]'"
        ) from error
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
        features: By name: dtype, shape, names.
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
            DataNotFoundError: There is none.
            DataError: It is of another version, or not what LeRobot writes.
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
                float(info_json["fps"]),
                {str(key): dict(value) for key, value in info_json["features"].items()},
                str(info_json.get("data_path") or DATA),
                str(info_json.get("video_path") or VIDEO),
            )
            dtypes = [(feature["dtype"], feature["shape"]) for feature in info.features.values()]
        except (ValueError, KeyError, TypeError, AttributeError, OSError) as error:
            raise DataError(f"{path}: not a LeRobot info file ({error!r})") from error
        if not version.startswith("v3."):
            raise DataError(
                f"{path}: format {version}, but only v3 can be read; convert it with LeRobot's "
                "own script"
            )
        if not info.fps > 0 or not dtypes:
            raise DataError(f"{path}: fps={info.fps} and {len(dtypes)} features")
        return info

    def data_file(self, root: Path, place: Mapping[str, int]) -> Path:
        """The parquet file of a chunk and file number.

        Raises:
            DataError: The pattern has an unknown field, or leads out of the data set.
        """
        return _filled(root, "data_path", self.data_path, place)

    def video_file(self, root: Path, feature: str, place: Mapping[str, int]) -> Path:
        """The video of a feature, by chunk and file number.

        Raises:
            DataError: The pattern has an unknown field, or leads out of the data set.
        """
        return _filled(root, "video_path", self.video_path, {"video_key": feature, **place})

    def pictures(self) -> list[str]:
        """Names of the features that are videos or images."""
        return [
            key for key, feature in self.features.items() if feature["dtype"] in ("video", "image")
        ]


def _filled(root: Path, key: str, pattern: str, fields: Mapping[str, str | int]) -> Path:
    where = f"{root / INFO}, {key}"
    try:
        name = pattern.format(**fields)
    except (LookupError, ValueError, TypeError, AttributeError) as error:
        raise DataError(
            f"{where}: {pattern!r} cannot be filled in ({error!r}); it may name {', '.join(fields)}"
        ) from error
    return inside(root, name, where)


def inside(root: Path, name: str, where: str) -> Path:
    """A file of a data set; its links may lead to the files that Hugging Face's cache shares.

    Args:
        root: The data set.
        name: Path of the file from there.
        where: Place that names it, for messages.

    Raises:
        DataError: It lies outside the data set.
    """
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
    """The columns of a parquet file.

    Raises:
        DataError: It cannot be read.
    """
    try:
        return list(import_arrow().parquet.read_schema(path).names)
    except (OSError, ValueError, import_arrow().lib.ArrowException) as error:
        raise DataError(f"{path}: cannot be read ({error}); download it again") from error


@cache
def read_parquet(path: Path, columns: tuple[str, ...] | None = None) -> Any:
    """Some columns of a parquet file, kept in memory.

    Raises:
        DataNotFoundError: There is no such file.
        DataError: It cannot be read, or lacks a column.
    """
    parquet = import_arrow().parquet
    if not path.is_file():
        raise DataNotFoundError(f"{path}: not there; download the data set again")
    try:
        return parquet.read_table(path, columns=None if columns is None else list(columns))
    except (OSError, ValueError, KeyError, import_arrow().lib.ArrowException) as error:
        raise DataError(f"{path}: cannot be read ({error}); download it again") from error


@cache
def _group_starts(path: Path) -> NDArray[np.int64]:
    """The first row of each row group of a parquet file, and the number of rows."""
    about = import_arrow().parquet.read_metadata(path)
    sizes = [about.row_group(i).num_rows for i in range(about.num_row_groups)]
    return np.cumsum([0, *sizes])


@lru_cache(maxsize=_GROUPS)
def _read_group(path: Path, column: str, number: int) -> Any:
    return import_arrow().parquet.ParquetFile(path).read_row_group(number, [column])[column]


def read_cell(path: Path, column: str, row: int) -> Any:
    """One cell of a large column; of each file no more than a few row groups stay in memory.

    Raises:
        DataError: The file cannot be read, or lacks the column.
    """
    try:
        starts = _group_starts(path)
        number = int(np.searchsorted(starts, row, side="right")) - 1
        return _read_group(path, column, number)[row - int(starts[number])].as_py()
    except (OSError, ValueError, KeyError, import_arrow().lib.ArrowException) as error:
        raise DataError(f"{path}: cannot be read ({error}); download it again") from error
