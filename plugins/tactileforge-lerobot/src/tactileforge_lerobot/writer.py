"""Writer of a LeRobot data set, episode by episode."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactileforge.contracts import Recording
from tactileforge.data import encode_image
from tactileforge.errors import DataError
from tactileforge.plugins import write_text
from tactileforge_lerobot import folder
from tactileforge_lerobot.episode import (
    AlignedRows,
    episode,
    episode_features,
    episode_rate,
    image_rows,
    number_rows,
)
from tactileforge_lerobot.options import LeRobotOptions, LeRobotSummary, Vectors
from tactileforge_lerobot.parquet import import_arrow
from tactileforge_lerobot.statistics import image_statistics, number_statistics, sample_frames
from tactileforge_lerobot.tables import column, common, tasks
from tactileforge_lerobot.touch import describe_touch
from tactileforge_lerobot.videos import Videos, read_parts


class Writer:
    """A growing data set, written episode by episode.

    Args:
        root: Folder of the data set.
        options: Options of the written data set.
        vectors: Source of further vectors, None for none; see `write.write_dataset`.
    """

    def __init__(self, root: Path, options: LeRobotOptions, vectors: Vectors | None) -> None:
        self.root, self.options, self.vectors = root, options, vectors
        self.found = LeRobotSummary()
        self.features: dict[str, dict[str, Any]] = {}
        self.tasks: dict[str, int] = {}
        self.episodes: list[dict[str, Any]] = []
        self.touch: list[dict[str, Any]] = []
        self.seen: dict[str, list[NDArray[Any]]] = {}
        self.videos: dict[str, Videos] = {}
        self.data: Any = None
        self.files = 0

    def __enter__(self) -> Writer:
        (self.root / "meta").mkdir(parents=True)
        return self

    def __exit__(self, *error: object) -> None:
        if self.data is not None:
            self.data.close()
        for video in self.videos.values():
            video.close()

    def add(self, group: list[Recording]) -> None:
        """Adds an episode."""
        fps = self.found.fps = self.found.fps or self.options.fps or episode_rate(group)
        added = episode(group, fps)
        vectors = self.vectors(added) if self.vectors else None
        self._check(added, vectors)
        number, start = len(self.episodes), self.found.rows
        columns, about = self._columns(added, vectors)
        task = self.tasks.setdefault(added.task, len(self.tasks))
        shared = common(len(added), fps, number, start, task)
        self.found.rows += len(added)
        for name, values in shared.items():
            about |= self._statistics(name, values, number_statistics(values))
        self._rows({**columns, **shared})
        place = folder.chunk_and_file(self.files)
        self.episodes.append(
            {
                "episode_index": number,
                "tasks": [added.task],
                "length": len(added),
                **{f"data/{key}": value for key, value in place.items()},
                "dataset_from_index": start,
                "dataset_to_index": self.found.rows,
                **about,
                "meta/episodes/chunk_index": 0,
                "meta/episodes/file_index": 0,
            }
        )
        self.touch.append(
            {
                name: describe_touch(self.root, number, name, part)
                for name, part in added.parts.items()
            }
        )
        for name, count in added.dropped.items():
            self.found.dropped[name] = self.found.dropped.get(name, 0) + count

    def _columns(
        self, added: AlignedRows, vectors: NDArray[np.float32] | None
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        """Builds the columns of an episode, and the statistics and locations of its features."""
        columns: dict[str, Any] = {}
        about: dict[str, Any] = {}
        for name, feature in self.features.items():
            if feature["dtype"] in ("video", "image"):
                seen = image_rows(added, name)
                small = sample_frames(seen)
                about |= self._statistics(name, small, image_statistics(small))
                if feature["dtype"] == "video":
                    about |= self._video(name, feature).add(seen)
                else:
                    encoded = (encode_image(p, "png") for part in read_parts(seen) for p in part)
                    columns[name] = [{"bytes": image, "path": None} for image in encoded]
            else:
                values = vectors if name == folder.ENVIRONMENT else number_rows(added, name)
                assert values is not None
                columns[name] = values
                about |= self._statistics(name, values, number_statistics(values))
        return columns, about

    def _statistics(
        self, name: str, values: NDArray[Any], statistics: dict[str, list[Any]]
    ) -> dict[str, Any]:
        """Stores values of a feature for the total statistics, and returns those of the episode."""
        self.seen.setdefault(name, []).append(values)
        return {f"stats/{name}/{key}": value for key, value in statistics.items()}

    def _check(self, added: AlignedRows, vectors: NDArray[np.float32] | None) -> None:
        declared = episode_features(added, self.options.images)
        if vectors is not None:
            self.found.vectors = vectors.shape[1]
            declared[folder.ENVIRONMENT] = {
                "dtype": "float32",
                "shape": [vectors.shape[1]],
                "names": None,
            }
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
        arrow = import_arrow()
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
        self.data.write_table(table)  # one row group per episode, as LeRobot does

    def finish(self) -> LeRobotSummary:
        """Closes the data files and writes ``meta/``.

        Raises:
            DataError: There are no episodes.
        """
        if not self.episodes:
            raise DataError("there are no recordings to write; look at data= and devices=")
        self.__exit__()
        arrow = import_arrow()
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
        if self.vectors:
            touch["vectors"] = self.vectors.about
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
