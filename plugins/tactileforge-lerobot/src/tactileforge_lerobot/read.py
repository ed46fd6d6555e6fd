"""Episodes of a LeRobot data set as touch recordings."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactileforge.contracts import ACTIONS, Frames, FrameSubset, Recording
from tactileforge.data import ImageFrames, stated
from tactileforge.errors import DataError
from tactileforge_lerobot import folder
from tactileforge_lerobot.episodes import read_episodes, read_tasks
from tactileforge_lerobot.feature_frames import Pictures, Touch, split_part
from tactileforge_lerobot.forces import Forces
from tactileforge_lerobot.info import Info
from tactileforge_lerobot.parquet import WRONG
from tactileforge_lerobot.rows import EpisodeRows, check_feature
from tactileforge_lerobot.touch import read_touch
from tactileforge_lerobot.touch_features import ReadOptions, TouchFeature


class LeRobotFolder:
    """A LeRobot data set on this machine, of version 2.0, 2.1 or 3.

    Args:
        root: Folder of the data set.
        name: Name of the data set in keys.
        reading: Options of the features.

    Attributes:
        notes: A line for each recording that was read with doubt.
    """

    def __init__(self, root: Path, name: str, reading: ReadOptions) -> None:
        self.root, self.name, self.reading = root, name, reading
        self.notes: list[str] = []
        self._forces = Forces(reading)

    @cached_property
    def info(self) -> Info:
        """Metadata of the data set; see `Info.read`."""
        return Info.read(self.root)

    @cached_property
    def episodes(self) -> list[EpisodeRows]:
        """Rows of each episode, in order; nothing but their list is read."""
        missing = self.reading.missing
        listed = read_episodes(self.root, self.info)
        return [EpisodeRows(self.root, self.info, about, missing) for about in listed]

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

    @cached_property
    def _pictures(self) -> Pictures:
        return Pictures(self.root, self.info, self.reading.drawing)

    @cached_property
    def _tasks(self) -> dict[int, str]:
        return read_tasks(self.root, self.info)

    def known(self, feature: str, what: str) -> str:
        """Checks the name of a feature, and returns it; see `rows.check_feature`."""
        check_feature(self.root, self.info, split_part(feature)[0], what)
        return feature

    def is_own(self, feature: str, name: str) -> bool:
        """Whether a feature is one of those of `write`, with a column of this name."""
        about = self.info.features.get(feature, {})
        return about.get("names") == [name] and about["shape"] == [1]

    def recording(self, number: int, touch: TouchFeature, camera: str | None) -> Recording | None:
        """Reads one touch feature of one episode; None for a device absent from that episode.

        Args:
            number: Index of the episode.
            touch: The touch feature.
            camera: Name of the feature with the camera's view of the scene; None for none.

        Raises:
            DataError: A file is damaged, or contradicts the others.
            ConfigError: Options of drawing do not fit the feature.
        """
        rows = self.episodes[number]
        try:
            return self._recording(rows, number, touch, camera)
        except WRONG as error:
            raise DataError(
                f"{self.root}: episode {rows.number}, {touch.images}: its tables "
                f"contradict meta/ ({error!r}); download the data set again"
            ) from error

    def _recording(
        self, rows: EpisodeRows, number: int, touch: TouchFeature, camera: str | None
    ) -> Recording | None:
        about = self.touch[number].get(touch.device) if self.touch else None
        if self.touch and about is None:
            return None
        about = about or {}
        seen = self._pictures.touch(rows, touch.images, about.get("shape"), self._home(rows, about))
        key = str(about.get("key") or f"{self.name}/{number:06d}/{touch.device}")
        kept, times = self._kept(rows, touch.device, seen.lost, key)
        force = self._forces.read(rows, touch, self.episodes)[kept] if touch.force else None
        has_view = camera is not None and about.get("image", True)
        view = self._pictures.frames(rows, camera, None) if camera and has_view else None
        still = self._upright(seen.still, touch.images)
        return Recording(
            key=key,
            sensor=str(about.get("sensor") or touch.sensor),
            frames=self._upright(FrameSubset(seen.frames, kept.tolist()), touch.images),
            times=times,
            no_contact=self._stored_stills(about) if about else still,
            force=force,
            action=self._action(rows, touch.device, kept),
            object=stated(about.get("object") or self._object) or None,
            text=stated(about.get("text") or (None if about else self._task(rows))) or None,
            image=None if view is None else FrameSubset(view, kept.tolist()),
            image_times=None if view is None else times,
            labels=about.get("labels") or self._labels(number, touch.device),
            tracks=self._tracks(rows, touch.device, about, kept, seen),
            source=str(about.get("source") or f"LeRobot data set {self.name}"),
            tier=int(about.get("tier") or (1 if force is not None else 2)),
            licence=str(about.get("licence") or ""),
        )

    def _upright(self, frames: Frames | None, feature: str) -> Any:
        """Pictures as the sensor sees them; numbers are drawn as they are."""
        is_picture = split_part(feature)[0] in self.info.pictures()
        return self.reading.stream.upright(frames) if frames and is_picture else frames

    @property
    def _object(self) -> str | None:
        return self.name.rpartition("/")[2] if self.reading.objects else None

    def _labels(self, number: int, device: str) -> dict[str, str | float]:
        return {"episode": f"{self.name.replace('/', '_')}_{number:05d}", "finger": device}

    def _home(self, rows: EpisodeRows, about: dict[str, Any]) -> EpisodeRows | None:
        """Episode with a first frame without contact; None for none, or a stored one."""
        if about or self.reading.background == "none":
            return None
        return self.episodes[0] if self.reading.objects else rows

    def _kept(
        self, rows: EpisodeRows, device: str, lost: NDArray[np.bool_], key: str
    ) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """Rows of the frames of the recording, and their times."""
        own = f"observation.time.{device}"
        times = rows.times(own if self.is_own(own, "seconds") else "")
        # A frame of a slow sensor may be repeated in several rows; each frame is kept once.
        kept = np.flatnonzero(np.diff(times, prepend=-np.inf) > 0)
        if len(kept) < len(times) and folder.ROBOT["robot_action"] in self.info.features:
            # In a demonstration each row has a command of its own, so all rows are kept, on the
            # regular times of the rows.
            kept = np.arange(len(times))
            times = times[0] + kept / self.info.fps
        if lost.all():
            raise DataError(f"{key}: no row has values of all taxels; leave the episode out")
        if lost.any():
            note = f"{key}: {int(lost.sum())} of {len(lost)} rows lack values of taxels, left out"
            self.notes += [note] * (note not in self.notes)
            kept = kept[~lost[kept]]
        return kept, times[kept]

    def _tracks(
        self,
        rows: EpisodeRows,
        device: str,
        about: dict[str, Any],
        kept: NDArray[np.int64],
        seen: Touch,
    ) -> dict[str, NDArray[Any]]:
        """Reads stored tracks; without metadata of `write`, the robot's and those of options."""
        if about:
            return self._stored_tracks(rows, device, about.get("tracks") or {}, kept)
        named = {track: name for track, name in folder.ROBOT.items() if name in self.info.features}
        for feature in self.reading.tracks:
            self.known(feature, "data.tracks")
            named[feature.removeprefix("observation.").replace(".", "_")] = feature
        tracks: dict[str, NDArray[Any]] = {}
        for track, feature in named.items():
            values = rows.numbers(feature)[kept].reshape(len(kept), *rows.shape(feature))
            tracks[track] = values.astype(np.float32) if track in folder.ROBOT else values
        if seen.values is not None:
            tracks["taxels"] = seen.values[kept]
        return dict(sorted(tracks.items()))

    def _stored_tracks(
        self,
        rows: EpisodeRows,
        device: str,
        tails: dict[str, list[int]],
        kept: NDArray[np.int64],
    ) -> dict[str, NDArray[Any]]:
        tracks: dict[str, NDArray[Any]] = {}
        for name, tail in sorted(tails.items()):
            feature = folder.ROBOT.get(name, f"observation.{name}.{device}")
            if feature not in self.info.features:
                continue
            values = rows.numbers(feature)[kept]
            if int(np.prod(tail)) != values.shape[1]:
                raise DataError(
                    f"{self.root / folder.TOUCH}: {feature} has {values.shape[1]} columns, not "
                    f"those of {tail}; remove the file if the data set was changed"
                )
            values = values.reshape(len(kept), *tail)
            tracks[name] = values.astype(np.float32) if name in folder.ROBOT else values
        return tracks

    def _action(
        self, rows: EpisodeRows, device: str, kept: NDArray[np.int64]
    ) -> NDArray[np.int64] | None:
        feature = f"observation.touch.{device}"
        if not self.is_own(feature, "action"):
            return None
        actions: NDArray[np.int64] = rows.numbers(feature)[kept, 0].astype(np.int64)
        if ((actions < -1) | (actions >= len(ACTIONS))).any():
            raise DataError(f"{self.root}: {feature} has values outside -1 to {len(ACTIONS) - 1}")
        return actions

    def _stored_stills(self, about: dict[str, Any]) -> Frames | None:
        where = f"{self.root / folder.TOUCH}, background"
        files: Sequence[str] = about.get("background", ())
        paths = [folder.inside(self.root, file, where) for file in files]
        return ImageFrames(paths) if paths else None

    def _task(self, rows: EpisodeRows) -> str | None:
        named = rows.about.get("tasks")
        if isinstance(named, list) and named:
            return str(named[0])
        if not self._tasks:
            return None
        return self._tasks.get(int(rows.numbers("task_index")[0, 0]))
