"""Tracks and force of a recording: wrenches and joints of its bag."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactileforge.checks import clocks_apart
from tactileforge.errors import DataError
from tactileforge.reading import OptionalKeys
from tactileforge_rosbags.bags import Bag
from tactileforge_rosbags.map_keys import BagMap, TouchKeys, plain
from tactileforge_rosbags.series import Clock, Series
from tactileforge_rosbags.values import JOINTS, WRENCHES, force_of, read_joints, read_wrench

_Found = Mapping[str, NDArray[np.float32]]


@dataclass
class TrackReader:
    """Reads the tracks of recordings of a bag.

    Attributes:
        bag: The bag.
        keys: The map.
        left_out: Is told of messages that are left out, a line each.
        note: Is told of facts inferred.
        optional: Is told which optional topics of the map are there.
    """

    bag: Bag
    keys: BagMap
    left_out: Callable[[str], object]
    note: Callable[[str], object]
    optional: OptionalKeys

    def force(self, touch: TouchKeys, clock: Clock) -> tuple[NDArray[np.float32] | None, _Found]:
        """Force on the gel, or the track ``wrench`` for a wrench elsewhere.

        Args:
            touch: The touch.
            clock: Clock of its frames.

        Raises:
            DataError: The topic is not there, of another type or empty, or of another time.
        """
        about = touch.force
        topic = present(self.bag, about.topic, self.optional) if about else ""
        if about is None or not topic:
            return None, {}
        wrench = self._wrench(topic, clock, about.lag_s)
        if about.at == "gel":
            return force_of(wrench, about), {}
        self.note(f"{topic}: not on the gel (at: {about.at}), so a track, and no label of force")
        return None, {"wrench": wrench}

    def tracks(self, clock: Clock) -> tuple[_Found, dict[str, str]]:
        """Tracks of wrenches and joints, and the label ``joints`` with the names of those.

        Args:
            clock: Clock of the frames.

        Raises:
            DataError: A topic that the map names cannot be read.
        """
        tracks: dict[str, NDArray[np.float32]] = {}
        for name, topic in self._wrenches().items():
            if there := present(self.bag, topic, self.optional):
                read = self._reader(name, there, clock)
                tracks |= self._free(self.keys.tracks is None, read)
        joints = self._all(JOINTS) if self.keys.state is None else self.keys.state
        topics = [name for topic in joints if (name := present(self.bag, topic, self.optional))]
        labels: dict[str, str] = {}

        def read_all() -> _Found:
            found, names, scans = read_joints(self.bag, topics, clock, self.keys.gap)
            for one in scans:
                self.left_out(one.line)
            if names:
                labels["joints"] = " ".join(names)
            return found

        tracks |= self._free(self.keys.state is None, read_all)
        return tracks, labels

    def _wrenches(self) -> Mapping[str, str]:
        """Wrench topics read as tracks, by name."""
        if self.keys.tracks is not None:
            return self.keys.tracks
        used = {one.force.topic.removesuffix("?") for one in self.keys.touch if one.force}
        return {f"wrench_{plain(one)}": one for one in self._all(WRENCHES) if one not in used}

    def _reader(self, name: str, topic: str, clock: Clock) -> Callable[[], _Found]:
        return lambda: {name: self._wrench(topic, clock, 0.0)}

    def _free(self, free: bool, read: Callable[[], _Found]) -> _Found:
        """The labels read, or a note on a refusal for topics named by nobody."""
        try:
            return read()
        except DataError as error:
            if not free:
                raise
            self.note(f"left out: {error}")
            return {}

    def _wrench(self, topic: str, clock: Clock, lag_s: float) -> NDArray[np.float32]:
        wrench, found = read_wrench(self.bag, topic, clock, self.keys.gap, lag_s)
        self.left_out(found.line)
        if clock.stamps and found.series.stamped is None:
            self.note(
                f"{topic}: without stamps, so its time of recording less the delay of "
                f"{clock.touch.topic} ({clock.delay / 1e6:.4g} ms) counts"
            )
        elif clock.stamps and found.series.stamped is not None:
            pictures, forces = clock.touch, found.series
            if words := clocks_apart({one.topic: _both(one) for one in (pictures, forces)}):
                self.note(f"{words}; data.clock=bag takes the times of recording for both")
        return wrench

    def _all(self, kinds: tuple[str, ...]) -> tuple[str, ...]:
        topics = self.bag.topics.values()
        return tuple(sorted(one.name for one in topics if one.kind in kinds and one.count))


def _both(series: Series) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Stamps of messages and their times of recording, s, from the first of these."""
    stamped = series.recorded if series.stamped is None else series.stamped
    start = series.recorded[0]
    return (stamped - start) / 1e9, (series.recorded - start) / 1e9


def present(bag: Bag, topic: str, optional: OptionalKeys) -> str:
    """Name of a topic; "" for an absent topic with a ``?`` at the end of its name."""
    name = topic.removesuffix("?")
    if not topic.endswith("?"):
        return name
    is_there = name in bag.topics
    optional.add(name, bag, is_there)
    return name if is_there else ""
