"""Touch recordings as a LeRobot data set."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactileforge.contracts import Recording
from tactileforge.data.frames.image_codecs import encode_image
from tactileforge.data.shards.shards import describe_recording
from tactileforge.errors import ConfigError, DataError
from tactileforge.files import write_text
from tactileforge.lerobot import folder
from tactileforge.lerobot.episode import (
    Episode,
    device_word,
    episode,
    episode_features,
    episode_rate,
    group_takes,
    image_rows,
    number_rows,
)
from tactileforge.lerobot.statistics import image_statistics, number_statistics, sample_frames
from tactileforge.lerobot.tables import column, common, tasks
from tactileforge.lerobot.videos import Videos, pad_to_even

_IMAGES = ("auto", "video", "png")


@dataclass(frozen=True, kw_only=True)
class LeRobotOptions:
    """The keys of conf/lerobot.yaml, but those that name data and folder.

    Attributes:
        fps: Rows per second, a whole number; None for the rate of the fastest sensor of the first
            episode.
        devices: Sensors, by the label ``device`` or the type; None for all.
        images: ``video``; ``png``, without loss, in the parquet files; or ``auto``: arrays as png.
        robot: LeRobot's ``robot_type``.
        data_mb: Size from which a new parquet file is begun.
        video_mb: Size from which a new video is begun.
    """

    fps: int | None = None
    devices: list[str] | None = None
    images: str = "auto"
    robot: str | None = None
    data_mb: float = 100.0
    video_mb: float = 200.0

    def __post_init__(self) -> None:
        if self.fps is not None and self.fps < 1:
            raise ConfigError(f"fps={self.fps}: give a whole number above 0")
        if self.images not in _IMAGES:
            raise ConfigError(f"images={self.images}: give {', '.join(_IMAGES)}")


@dataclass
class LeRobotSummary:
    """Summary of the written data set.

    Attributes:
        episodes: Number of episodes.
        rows: Of all.
        fps: Rows per second.
        dropped: Frames that no row shows, by device.
        features: Names.
    """

    episodes: int = 0
    rows: int = 0
    fps: int = 0
    dropped: dict[str, int] = field(default_factory=dict)
    features: list[str] = field(default_factory=list)


def write_dataset(
    recordings: Iterable[Recording], out: Path, options: LeRobotOptions
) -> LeRobotSummary:
    """Writes a data set, beside its place, and renames it.

    Args:
        recordings: In any order; those of one take follow one another.
        out: The folder; it must not exist.
        options: How.

    Raises:
        ConfigError: The folder exists, or pyarrow is not installed.
        DataError: There are no recordings, or episodes differ in their features.
    """
    folder.import_arrow()
    if out.exists():
        raise ConfigError(f"{out} exists: give another out=, or remove it")
    part = out.with_name(f"{out.name}.{os.getpid()}.part")
    try:
        with _Writer(part, options) as writer:
            chosen = (
                recording
                for recording in recordings
                if options.devices is None
                or {device_word(recording), recording.sensor} & set(options.devices)
            )
            for group in group_takes(chosen):
                writer.add(group)
            result = writer.finish()
        part.replace(out)
    finally:
        shutil.rmtree(part, ignore_errors=True)
    return result


class _Writer:
    """A data set that grows by episodes."""

    def __init__(self, root: Path, options: LeRobotOptions) -> None:
        self.root, self.options = root, options
        self.found = LeRobotSummary()
        self.features: dict[str, dict[str, Any]] = {}
        self.tasks: dict[str, int] = {}
        self.episodes: list[dict[str, Any]] = []
        self.touch: list[dict[str, Any]] = []
        self.seen: dict[str, list[NDArray[Any]]] = {}
        self.videos: dict[str, Videos] = {}
        self.data: Any = None
        self.files = 0

    def __enter__(self) -> _Writer:
        (self.root / "meta").mkdir(parents=True)
        return self

    def __exit__(self, *error: object) -> None:
        if self.data is not None:
            self.data.close()
        for video in self.videos.values():
            video.close()

    def add(self, group: list[Recording]) -> None:
        """One more episode."""
        fps = self.found.fps = self.found.fps or self.options.fps or episode_rate(group)
        added = episode(group, fps)
        self._check(added)
        number, start = len(self.episodes), self.found.rows
        columns: dict[str, Any] = {}
        about: dict[str, Any] = {}
        for name, feature in self.features.items():
            if feature["dtype"] in ("video", "image"):
                seen = image_rows(added, name)
                values = sample_frames(seen)
                statistics = image_statistics(values)
                if feature["dtype"] == "video":
                    about |= self._video(name, feature).add(pad_to_even(seen))
                else:
                    columns[name] = [{"bytes": encode_image(p, "png"), "path": None} for p in seen]
            else:
                columns[name] = values = number_rows(added, name)
                statistics = number_statistics(values)
            self.seen.setdefault(name, []).append(values)
            about |= {f"stats/{name}/{key}": value for key, value in statistics.items()}
        task = self.tasks.setdefault(added.task, len(self.tasks))
        shared = common(len(added), fps, number, start, task)
        self.found.rows += len(added)
        for name, values in shared.items():
            self.seen.setdefault(name, []).append(values)
            about |= {
                f"stats/{name}/{key}": value for key, value in number_statistics(values).items()
            }
        self._rows({**columns, **shared})
        self.episodes.append(
            {
                "episode_index": number,
                "tasks": [added.task],
                "length": len(added),
                **{
                    f"data/{key}": value for key, value in folder.chunk_and_file(self.files).items()
                },
                "dataset_from_index": start,
                "dataset_to_index": self.found.rows,
                **about,
                "meta/episodes/chunk_index": 0,
                "meta/episodes/file_index": 0,
            }
        )
        self.touch.append(
            {name: self._about(number, name, part) for name, part in added.parts.items()}
        )
        for name, count in added.dropped.items():
            self.found.dropped[name] = self.found.dropped.get(name, 0) + count

    def _check(self, added: Episode) -> None:
        declared = episode_features(added, self.options.images)
        self.features = self.features or declared
        if declared != self.features:
            differ = sorted(
                key
                for key in {*declared, *self.features}
                if declared.get(key) != self.features.get(key)
            )
            keys = ", ".join(part.key for part in added.parts.values())
            raise DataError(
                f"{keys}: other features than the first episode ({', '.join(differ)}); LeRobot "
                "needs the same in all: choose sensors with devices=[...]"
            )

    def _video(self, name: str, feature: dict[str, Any]) -> Videos:
        height, width, _ = feature["shape"]
        if name not in self.videos:
            self.videos[name] = Videos(
                self.root, name, (width, height), self.found.fps, self.options.video_mb
            )
        return self.videos[name]

    def _rows(self, columns: dict[str, Any]) -> None:
        arrow = folder.import_arrow()
        table = arrow.Table.from_pydict(
            {
                name: column(arrow, values, self.features.get(name) or folder.COMMON[name])
                for name, values in columns.items()
            }
        )
        path = self.root / folder.DATA.format(**folder.chunk_and_file(self.files))
        if self.data is not None and path.stat().st_size > self.options.data_mb * 1e6:
            self.data.close()
            self.data = None
            self.files += 1
            path = self.root / folder.DATA.format(**folder.chunk_and_file(self.files))
        if self.data is None:
            path.parent.mkdir(parents=True, exist_ok=True)
            self.data = arrow.parquet.ParquetWriter(path, table.schema)
        self.data.write_table(table)  # one row group an episode

    def _about(self, number: int, name: str, part: Recording) -> dict[str, Any]:
        """Touch metadata that LeRobot's format has no place for."""
        left = ("version", "times", "force", "action", "tracks", "image_times")
        about = {key: value for key, value in describe_recording(part).items() if key not in left}
        rest = [] if part.no_contact is None else range(min(len(part.no_contact), 9))
        files = []
        for i in rest:
            path = f"meta/tactileforge/{number:06d}.{name}.{i}.png"
            (self.root / path).parent.mkdir(exist_ok=True)
            assert part.no_contact is not None
            (self.root / path).write_bytes(encode_image(part.no_contact.read([i])[0], "png"))
            files.append(path)
        shapes = {track: list(values.shape[1:]) for track, values in part.tracks.items()}
        return about | {"background": files, "shape": list(part.frames.shape), "tracks": shapes}

    def finish(self) -> LeRobotSummary:
        """Writes ``meta/``."""
        if not self.episodes:
            raise DataError("there are no recordings to write; look at data= and devices=")
        self.__exit__()
        arrow = folder.import_arrow()
        self.found.episodes = len(self.episodes)
        self.found.features = [*self.features, *folder.COMMON]
        for name, video in self.videos.items():
            self.features[name]["info"] = video.info()
        rows = {key: [row[key] for row in self.episodes] for key in self.episodes[0]}
        path = self.root / folder.EPISODES.format(**folder.chunk_and_file(0))
        path.parent.mkdir(parents=True)
        arrow.parquet.write_table(arrow.Table.from_pydict(rows), path)
        arrow.parquet.write_table(tasks(arrow, list(self.tasks)), self.root / folder.TASKS)
        write_text(self.root / folder.INFO, json.dumps(self._info(), indent=4))
        statistics = {
            name: image_statistics(np.concatenate(values))
            if (self.features.get(name) or {}).get("dtype") in ("video", "image")
            else number_statistics(np.concatenate(values))
            for name, values in self.seen.items()
        }
        write_text(self.root / folder.STATS, json.dumps(statistics, indent=4))
        touch = {"version": folder.TOUCH_VERSION, "episodes": self.touch}
        write_text(self.root / folder.TOUCH, json.dumps(touch, allow_nan=False))
        return self.found

    def _info(self) -> dict[str, Any]:
        return {
            "codebase_version": folder.VERSION,
            "robot_type": self.options.robot,
            "total_episodes": len(self.episodes),
            "total_frames": self.found.rows,
            "total_tasks": len(self.tasks),
            "chunks_size": folder.CHUNK,
            "data_files_size_in_mb": self.options.data_mb,
            "video_files_size_in_mb": self.options.video_mb,
            "fps": self.found.fps,
            "splits": {"train": f"0:{len(self.episodes)}"},
            "data_path": folder.DATA,
            "video_path": folder.VIDEO if self.videos else None,
            "features": self.features | folder.COMMON,
        }
