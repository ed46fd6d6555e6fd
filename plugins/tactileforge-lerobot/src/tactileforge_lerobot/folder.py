"""Names of files and features of a LeRobot data set."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from tactileforge.errors import DataError

VERSION = "v3.0"
DATA = "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
VIDEO = "videos/{video_key}/chunk-{chunk_index:03d}/file-{file_index:03d}.mp4"
EPISODES = "meta/episodes/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
INFO, STATS, TASKS = "meta/info.json", "meta/stats.json", "meta/tasks.parquet"
#: The same in versions 2.0 and 2.1, with one episode a file.
DATA_2 = "data/chunk-{episode_chunk:03d}/episode_{episode_index:06d}.parquet"
VIDEO_2 = "videos/chunk-{episode_chunk:03d}/{video_key}/episode_{episode_index:06d}.mp4"
EPISODES_2, TASKS_2 = "meta/episodes.jsonl", "meta/tasks.jsonl"
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
#: Types of numeric features.
NUMBERS = (
    *(f"float{bits}" for bits in (16, 32, 64)),
    *(f"{kind}{bits}" for kind in ("int", "uint") for bits in (8, 16, 32, 64)),
    "bool",
)
#: Features of every data set.
COMMON: dict[str, dict[str, Any]] = {
    "timestamp": {"dtype": "float32", "shape": [1], "names": None},
    "frame_index": {"dtype": "int64", "shape": [1], "names": None},
    "episode_index": {"dtype": "int64", "shape": [1], "names": None},
    "index": {"dtype": "int64", "shape": [1], "names": None},
    "task_index": {"dtype": "int64", "shape": [1], "names": None},
}


def chunk_and_file(number: int) -> dict[str, int]:
    """Chunk and file of the n-th file."""
    return {"chunk_index": number // CHUNK, "file_index": number % CHUNK}


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
        raise DataError(f"{where}: {name[:60]!r} is not a path; correct it")
    path = root / name
    try:
        real, folder = path.resolve(), root.resolve()
    except RuntimeError:  # up to Python 3.12
        raise DataError(f"{where}: {name} is a link that loops; put the file there") from None
    shared = folder.parent.parent / "blobs" if folder.parent.name == "snapshots" else folder
    if not real.is_relative_to(folder) and not real.is_relative_to(shared):
        raise DataError(
            f"{where}: {name} lies outside the data set, and is not opened; put the file into "
            f"{root}, and correct the path"
        )
    return path
