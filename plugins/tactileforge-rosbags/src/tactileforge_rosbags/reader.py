"""Bags as recordings: one per touch, and interval if there are some."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tactileforge.contracts import Frames, FrameSubset, Recording
from tactileforge.errors import ConfigError, DataError
from tactileforge.reading import OptionalKeys
from tactileforge.specs import spec
from tactileforge_rosbags.bags import Bag, changed
from tactileforge_rosbags.map_keys import BagMap, IntervalKeys, TouchKeys, finger_of
from tactileforge_rosbags.series import Clock, rising
from tactileforge_rosbags.topic_frames import KINDS, BagFrames, open_frames
from tactileforge_rosbags.tracks import TrackReader, present

#: Time before the first and after the last frame in which pictures of the camera count, s.
_AROUND = 1.0


@dataclass(frozen=True)
class _Part:
    """Frames of a recording: a whole bag, or an interval of it."""

    key: str
    about: IntervalKeys | None
    rows: NDArray[np.int64]


@dataclass
class BagFile:
    """A bag, and its recordings.

    Attributes:
        bag: The bag.
        keys: The map.
        bad: Is told of touches and messages that are left out.
        note: Is told of facts inferred.
        optional: Is told which optional topics of the map are there.
    """

    bag: Bag
    keys: BagMap
    bad: Callable[[DataError], object]
    note: Callable[[str], object]
    optional: OptionalKeys

    def __post_init__(self) -> None:
        self._changed = changed(self.bag.path)
        self._reads = TrackReader(self.bag, self.keys, self._left_out, self.note, self.optional)

    def recordings(self) -> Iterator[Recording]:
        """Yields the recordings, touch by touch.

        Raises:
            DataError: The bag is damaged, empty, or has no topic of touch.
        """
        topics = self.bag.topics
        if not any(topic.count for topic in topics.values()):
            raise DataError(f"{self.bag}: no message; record it again")
        if not any(touch.topic in topics for touch in self.keys.touch):
            held = sorted(topic.name for topic in topics.values() if topic.kind in KINDS)
            raise DataError(
                f"{self.bag}: no topic of touch ({self.keys.touch[0].topic}); topics of pictures: "
                f"{', '.join(held) or '(none)'}; correct data.topics or map"
            )
        for touch in self.keys.touch:
            try:
                yield from self._touch(touch)
            except DataError as error:
                self.bad(error)

    def _touch(self, touch: TouchKeys) -> Iterator[Recording]:
        frames, line = open_frames(self.bag, touch, self._changed)
        self._left_out(line)
        stamps = self._clock(frames)
        series, repeated = rising(frames.series, stamps)
        if repeated:
            total = len(frames)
            self._left_out(f"{series}: {repeated} of {total} frames left out: they repeat a time")
        frames = BagFrames(series, touch, frames.stored)
        for part in self._parts(frames):
            try:
                yield self._recording(touch, frames, part, stamps)
            except DataError as error:
                self.bad(error)

    def _clock(self, frames: BagFrames) -> bool:
        """Whether header stamps are the clock."""
        series = frames.series
        if self.keys.clock == "bag":
            return False
        if series.stamped is None:
            self.note(f"{series.topic}: headers without stamps, so the time of recording counts")
            return False
        self.note(f"{series.topic}: times are the stamps of the headers; data.clock=bag for others")
        return True

    def _parts(self, frames: BagFrames) -> Iterator[_Part]:
        intervals = self.keys.intervals.get(self.bag.name)
        if intervals is None:
            yield _Part(self.bag.name, None, np.arange(len(frames)))
            return
        seconds = (frames.series.recorded - self.bag.start) / 1e9
        for number, about in enumerate(intervals):
            rows = np.flatnonzero((seconds >= about.start) & (seconds < about.stop))
            if len(rows):
                yield _Part(f"{self.bag.name}/{number:03d}", about, rows)
            else:
                self._left_out(
                    f"{frames.series}: no frame from {about.start:g} s to {about.stop:g} s, where "
                    f"the bag has {seconds[0]:.4g} s to {seconds[-1]:.4g} s; correct intervals"
                )

    def _recording(
        self, touch: TouchKeys, whole: BagFrames, part: _Part, stamps: bool
    ) -> Recording:
        keys, about = self.keys, part.about
        series = whole.series.take(part.rows)
        frames = BagFrames(series, touch, whole.stored)
        clock = Clock(series, stamps)
        force, own = self._reads.force(touch, clock)
        tracks, labels = self._reads.tracks(clock)
        camera, camera_times = self._camera(clock)
        times = (clock.times - clock.times[0]) / 1e9
        return Recording(
            key=f"{part.key}/{finger_of(touch)}",
            sensor=self._sensor(touch),
            frames=frames,
            times=times,
            no_contact=self._still(whole, frames),
            force=force,
            object=(about.object if about else "") or keys.object or None,
            text=(about.text if about else "") or keys.text or None,
            image=camera,
            image_times=camera_times,
            labels={
                "episode": part.key.replace("/", "_"),
                "finger": finger_of(touch),
                **labels,
                **keys.labels,
                **(about.labels if about else {}),
            },
            tracks={**tracks, **own},
            source=keys.source or f"ROS bag {self.bag.name}",
            tier=1 if force is not None else keys.tier,
            licence=keys.licence,
        )

    def _sensor(self, touch: TouchKeys) -> str:
        try:
            return spec(touch.sensor).name
        except ConfigError as error:
            raise ConfigError(f"{touch.topic}: {error}") from error

    def _still(self, whole: BagFrames, frames: BagFrames) -> Frames | None:
        if self.keys.background == "none":
            return None
        return FrameSubset(whole if self.keys.background == "bag" else frames, [0])

    def _camera(self, clock: Clock) -> tuple[Frames | None, NDArray[np.float64] | None]:
        """Pictures of the camera around the frames, and their times."""
        keys = self.keys.camera
        topic = "" if keys is None else present(self.bag, keys.topic, self.optional)
        if keys is None or not topic:
            return None, None
        named = replace(keys, topic=topic)
        frames, line = open_frames(self.bag, named, self._changed)
        self._left_out(line)
        series, _ = rising(frames.series, clock.stamps and frames.series.stamped is not None)
        times = (clock.of(series) - clock.times[0]) / 1e9
        last = (clock.times[-1] - clock.times[0]) / 1e9
        rows = np.flatnonzero((times >= -_AROUND) & (times <= last + _AROUND))
        if not len(rows):
            raise DataError(
                f"{series}: no picture within {_AROUND:g} s of {clock.touch.topic}; if their "
                "stamps are of different clocks, give data.clock=bag"
            )
        return BagFrames(series.take(rows), named, frames.stored), times[rows]

    def _left_out(self, line: str) -> None:
        if line:
            self.bad(DataError(line))
