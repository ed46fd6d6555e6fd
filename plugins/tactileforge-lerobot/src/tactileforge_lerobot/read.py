"""Episodes of a LeRobot data set as touch recordings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactileforge.plugin import (
    ACTIONS,
    DataError,
    DataNotFoundError,
    EncodedFrames,
    Frames,
    FrameSubset,
    ImageFrames,
    Recording,
    VideoFrames,
    stated,
    unknown,
    without_companions,
)
from tactileforge_lerobot import folder
from tactileforge_lerobot.folder import Info
from tactileforge_lerobot.images import ColumnImages
from tactileforge_lerobot.touch import read_touch

#: Required columns of each file of episodes.
_NEEDED = ("episode_index", "length", "data/chunk_index", "data/file_index")

#: Largest relative difference between the rate of a video, or of rows, and that of the metadata.
_RATE = 0.1


@dataclass(frozen=True)
class TouchFeature:
    """A touch feature, its sensor and its force.

    Attributes:
        images: Name of the feature.
        sensor: Type of the sensor.
        force: Name of its force feature, "" where there is none.
        columns: Indices of the columns x, y and z of the force feature.
    """

    images: str
    sensor: str
    force: str = ""
    columns: Sequence[int] = (0, 1, 2)


class LeRobotFolder:
    """A LeRobot data set on this machine.

    Args:
        root: Folder of the data set.
    """

    def __init__(self, root: Path) -> None:
        self.root = root
        self._videos: dict[tuple[Path, tuple[int, int, int, int] | None], VideoFrames] = {}

    @cached_property
    def info(self) -> Info:
        """Metadata of the data set; see `Info.read`."""
        return Info.read(self.root)

    @cached_property
    def episodes(self) -> list[dict[str, Any]]:
        """Location of each episode, in order; without statistics."""
        rows: list[dict[str, Any]] = []
        place = self.root / "meta" / "episodes"
        for path in sorted(without_companions([*place.glob("*/*.parquet")], place)):
            names = folder.column_names(path)
            if lacks := [name for name in _NEEDED if name not in names]:
                raise DataError(f"{path}: no column {lacks[0]}; download it again")
            wanted = tuple(name for name in names if not name.startswith("stats/"))
            rows += folder.read_parquet(path, wanted).to_pylist()
        if not rows:
            raise DataNotFoundError(f"{self.root}/meta/episodes: no episodes there")
        for row in rows:
            for name in _NEEDED:
                if type(row[name]) is not int or not (name == "length") <= row[name] < 1 << 40:
                    raise DataError(
                        f"{self.root}/meta/episodes: {name} is {str(row[name])[:60]}, no whole "
                        "number; download the data set again"
                    )
        return sorted(rows, key=lambda row: int(row["episode_index"]))

    @cached_property
    def touch(self) -> list[dict[str, Any]]:
        """Touch metadata added by `write`, by episode; [] if another program wrote the data set.

        Raises:
            DataError: The file is damaged, its version is not supported, or it has a different
                number of episodes.
        """
        path = self.root / folder.TOUCH
        if not path.is_file():
            return []
        version, touches = read_touch(path)
        if version != folder.TOUCH_VERSION or len(touches) != len(self.episodes):
            raise DataError(
                f"{path}: version {version} and {len(touches)} episodes, where "
                f"{folder.TOUCH_VERSION} and {len(self.episodes)} are expected; "
                "remove it if the data set was changed"
            )
        return touches

    def recording(
        self, number: int, touch: TouchFeature, camera: str | None, background: str
    ) -> Recording | None:
        """Reads one touch feature of one episode; None for a device absent from that episode.

        Args:
            number: Index of the episode.
            touch: The touch feature.
            camera: Name of the feature with the camera's view of the scene; None for none.
            background: ``first`` where the first frame is without contact, or ``none``; ignored
                where `write` has stored the background.

        Raises:
            DataError: A file is damaged, or contradicts the others.
        """
        row = self.episodes[number]
        try:
            return self._recording(row, number, touch, camera, background)
        except folder.WRONG as error:
            raise DataError(
                f"{self.root}: episode {row['episode_index']}, {touch.images}: its tables "
                f"contradict meta/ ({error!r}); download the data set again"
            ) from error

    def _recording(
        self,
        row: dict[str, Any],
        number: int,
        touch: TouchFeature,
        camera: str | None,
        background: str,
    ) -> Recording | None:
        device = touch.images.removeprefix("observation.images.")
        about = self.touch[number].get(device) if self.touch else None
        if self.touch and about is None:
            return None
        about = about or {}
        shape = about.get("shape")
        frames = self._frames(row, touch.images, shape)
        times = self._times(row, f"observation.time.{device}")
        # A frame of a slow sensor may be repeated in several rows; each frame is kept once.
        kept = np.flatnonzero(np.diff(times, prepend=-np.inf) > 0)
        if len(kept) < len(times) and folder.ROBOT["robot_action"] in self.info.features:
            # In a demonstration each row has a command of its own, so all rows are kept, on the
            # regular times of the rows.
            kept = np.arange(len(times))
            times = times[0] + kept / self.info.fps
        force = self._numbers(row, touch.force, touch.columns) if touch.force else None
        has_view = camera is not None and about.get("image", True)
        view = self._frames(row, camera, None) if camera and has_view else None
        return Recording(
            key=str(about.get("key") or f"{self.root.name}/{number:06d}/{device}"),
            sensor=str(about.get("sensor") or touch.sensor),
            frames=FrameSubset(frames, kept.tolist()),
            times=times[kept],
            no_contact=self._still(about, frames, background),
            force=None if force is None else np.asarray(force, np.float32)[kept],
            action=self._action(row, device, kept),
            object=stated(about.get("object")) or None,
            text=stated(about.get("text") or (None if about else self._task(row))) or None,
            image=None if view is None else FrameSubset(view, kept.tolist()),
            image_times=None if view is None else times[kept],
            labels=about.get("labels")
            or {"episode": f"{self.root.name}_{number:05d}", "finger": device},
            tracks=self._tracks(row, device, about, kept),
            source=str(about.get("source") or f"LeRobot data set {self.root.name}"),
            tier=int(about.get("tier") or (1 if force is not None else 2)),
            licence=str(about.get("licence") or ""),
        )

    def _tracks(
        self, row: dict[str, Any], device: str, about: dict[str, Any], kept: NDArray[np.int64]
    ) -> dict[str, NDArray[Any]]:
        """Reads the tracks stored by `write`; without its metadata, the state and the actions."""
        tails: dict[str, list[int]] = about.get("tracks") or {}
        tracks: dict[str, NDArray[Any]] = {}
        for name in {*tails, *([] if about else folder.ROBOT)}:
            feature = folder.ROBOT.get(name, f"observation.{name}.{device}")
            if feature in self.info.features:
                values = self._numbers(row, feature)[kept]
                tail = tails.get(name, values.shape[1:])
                if int(np.prod(tail)) != values.shape[1]:
                    raise DataError(
                        f"{self.root / folder.TOUCH}: {feature} has {values.shape[1]} columns, not "
                        f"those of {tail}; remove the file if the data set was changed"
                    )
                values = values.reshape(len(kept), *tail)
                tracks[name] = values.astype(np.float32) if name in folder.ROBOT else values
        return dict(sorted(tracks.items()))

    def _frames(self, row: dict[str, Any], feature: str, shape: Sequence[int] | None) -> Frames:
        dtype = self.info.features[feature]["dtype"]
        length = int(row["length"])
        if dtype == "image":
            path, start = self._data(row)
            images = ColumnImages(self.root, path, feature, start, length)
            return EncodedFrames(f"{path}, {feature}", images)
        file = self.info.video_file(self.root, feature, self._place(row, f"videos/{feature}"))
        crop = None if shape is None else (0, 0, int(shape[1]), int(shape[0]))
        key = (file, crop)
        video = self._videos.get(key) or VideoFrames(*key)
        self._videos[key] = video
        self._check_rate(f"{key[0]}: its video", video.times)
        # Half a frame earlier, so that rounding of the time cannot skip the first frame.
        first = self._cell(row, f"videos/{feature}/from_timestamp") - 0.5 / self.info.fps
        start = int(np.searchsorted(video.times, first))
        if start + length > len(video):
            raise DataError(
                f"{key[0]}: {len(video)} frames, but episode {row['episode_index']} needs "
                f"{start + length}; download the data set again"
            )
        return FrameSubset(video, range(start, start + length))

    def _data(self, row: dict[str, Any]) -> tuple[Path, int]:
        """Finds the parquet file of an episode, and its first row there."""
        path = self.info.data_file(self.root, self._place(row, "data"))
        numbers = folder.read_parquet(path, ("episode_index",))["episode_index"].to_numpy()
        rows = np.flatnonzero(numbers == int(row["episode_index"]))
        if len(rows) != int(row["length"]) or (np.diff(rows) != 1).any():
            raise DataError(
                f"{path}: {len(rows)} rows of episode {row['episode_index']}, but its length is "
                f"{row['length']}; download the data set again"
            )
        return path, int(rows[0])

    def _place(self, row: dict[str, Any], group: str) -> dict[str, int]:
        """Chunk and file number of the data, or of a video, of an episode."""
        names = ("chunk_index", "file_index")
        return {name: int(self._cell(row, f"{group}/{name}")) for name in names}

    def _cell(self, row: dict[str, Any], name: str) -> float:
        value: Any = row.get(name)
        if type(value) not in (int, float) or not 0 <= value < 1 << 40:
            raise DataError(
                f"{self.root}/meta/episodes: {name} of episode {row['episode_index']} is "
                f"{value!r}, not a number; download the data set again"
            )
        return float(value)

    def _numbers(
        self, row: dict[str, Any], feature: str, columns: Sequence[int] | None = None
    ) -> NDArray[Any]:
        path, start = self._data(row)
        dtype = self.info.features[feature]["dtype"]
        if dtype not in folder.NUMBERS:
            raise DataError(
                f"{self.root / folder.INFO}: {feature} is of dtype {dtype!r}, no numbers "
                f"({', '.join(folder.NUMBERS)}); give another feature, or correct it"
            )
        column = folder.read_parquet(path, (feature,))[feature].slice(start, int(row["length"]))
        try:
            with np.errstate(over="ignore"):
                values = np.array(column.to_pylist(), np.dtype(dtype))
        except (ValueError, TypeError, OverflowError) as error:
            raise DataError(f"{path}: {feature}: {error}; download it again") from error
        values = values.reshape(len(values), -1)
        if columns is None:
            return values
        if max(columns) >= values.shape[1]:
            raise DataError(
                f"{path}: {feature} has {values.shape[1]} columns, but force_columns="
                f"{list(columns)}"
            )
        return values[:, list(columns)]

    def _times(self, row: dict[str, Any], feature: str) -> NDArray[np.float64]:
        """Reads the stored times of the frames; without them, the regular times of the rows."""
        if feature in self.info.features:
            return self._numbers(row, feature)[:, 0].astype(np.float64)
        if "timestamp" in self.info.features:
            stamps = self._numbers(row, "timestamp")[:, 0].astype(np.float64)
            self._check_rate(f"{self._data(row)[0]}: timestamp", stamps)
        return np.arange(int(row["length"])) / self.info.fps

    def _check_rate(self, what: str, times: NDArray[np.float64]) -> None:
        """Raises a `DataError` if the rate of times differs from the rate in the metadata."""
        fps = self.info.fps
        step = float(np.median(np.diff(times))) if len(times) > 1 else 1 / fps
        if abs(step * fps - 1) > _RATE:
            said = f"{1 / step:.4g} times a second" if step > 0 else "without a step in time"
            raise DataError(
                f"{what} comes {said}, where {self.root / folder.INFO} says fps: {fps:g}; correct "
                "the one that is wrong, or convert the video"
            )

    def _action(
        self, row: dict[str, Any], device: str, kept: NDArray[np.int64]
    ) -> NDArray[np.int64] | None:
        feature = f"observation.touch.{device}"
        if feature not in self.info.features:
            return None
        actions: NDArray[np.int64] = self._numbers(row, feature)[kept, 0].astype(np.int64)
        if ((actions < -1) | (actions >= len(ACTIONS))).any():
            raise DataError(f"{self.root}: {feature} has values outside -1 to {len(ACTIONS) - 1}")
        return actions

    def _still(self, about: dict[str, Any], frames: Frames, background: str) -> Frames | None:
        if about:
            where = f"{self.root / folder.TOUCH}, background"
            files = about.get("background", ())
            paths = [folder.inside(self.root, file, where) for file in files]
            return ImageFrames(paths) if paths else None
        return FrameSubset(frames, [0]) if background == "first" else None

    def _task(self, row: dict[str, Any]) -> str | None:
        tasks = row.get("tasks") or []
        if len(tasks):
            return str(tasks[0])
        if not (self.root / folder.TASKS).is_file():
            return None
        table = folder.read_parquet(self.root / folder.TASKS).to_pydict()
        number = int(self._numbers(row, "task_index")[0, 0])
        words = table.get("task", table.get("__index_level_0__", ()))
        named = dict(zip(table.get("task_index", ()), words, strict=False))
        return str(named[number]) if number in named else None

    def known(self, feature: str, what: str) -> str:
        """Checks the name of a feature, and returns it.

        Raises:
            DataError: There is no such feature; the message names the nearest.
        """
        if feature not in self.info.features:
            message = unknown(f"feature in {what}", feature, self.info.features)
            raise DataError(f"{self.root}: {message}")
        return feature
