"""The data set ``rosbags``: topics of ROS bags as recordings."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from tactileforge.contracts import Guess, Recording
from tactileforge.errors import ConfigError, DataError, check_names, home_path
from tactileforge.reading import (
    Drawn,
    OptionalKeys,
    add_once,
    check_data_licence,
    check_share,
    check_split,
    held_out_names,
    load_map,
)

if TYPE_CHECKING:
    from tactileforge_rosbags.map_keys import BagMap


class Rosbags(Drawn):
    """ROS bags, one recording a sensor and bag or interval (`docs/data.md`).

    Read are rosbag2 in sqlite3 and mcap, and ROS 1 bags, by the package ``rosbags``, without ROS:
    topics of raw and compressed pictures, of wrenches and of joint states.

    Args:
        root: Folder of the bags, or a single bag.
        topics: Type of the sensor by topic of touch: ``{/digit/image: digit}``; {} with ``map``.
        map: What says more: wrenches, camera, joints, intervals; its keys, or a YAML file of them;
            "" for none.
        clock: ``header`` for the stamps of messages, where they are set, or ``bag`` for the time of
            recording; null for what the map says.
        background: ``first`` where recordings begin without contact, ``bag`` where bags do, or
            ``none``; null for what the map says.
        licence: Licence of the recordings, where the map has none.
        val: Share of the bags held out for validation.

    Raises:
        ConfigError: An option is invalid, or options contradict each other.
    """

    def __init__(
        self,
        root: str,
        topics: Mapping[str, str] | None = None,
        map: str | Mapping[str, Any] = "",
        clock: Literal["header", "bag"] | None = None,
        background: Literal["none", "first", "bag"] | None = None,
        licence: str = "",
        val: float = 0.1,
    ) -> None:
        check_share(val)
        if topics and map:
            raise ConfigError("give data.topics, or data.map=FILE.yaml with `touch`, not both")
        check_data_licence("data.licence", licence)
        self.root, self.val = home_path(root), val
        self.map = map if isinstance(map, str) else dict(map)
        self.topics = dict(topics or {})
        self.clock, self.background, self.licence = clock, background, licence
        self.skipped: list[str] = []
        self._notes: list[str] = []
        self._optional = OptionalKeys()
        self._failed: DataError | None = None

    @cached_property
    def keys(self) -> BagMap:
        """The map.

        Raises:
            ConfigError: The file cannot be read, a key is invalid, or no topic is named.
            DataNotFoundError: There is no bag.
        """
        from tactileforge_rosbags.map_files import check_map, map_of

        if not self.map and not self.topics:
            raise ConfigError(
                f"{self.root}: which topics are touch? data.topics={{TOPIC: SENSOR}}, or a map: "
                f"data.map=FILE.yaml (docs/data.md); {self._held()}"
            )
        if isinstance(self.map, Mapping):
            keys = check_map("data.map", self.map)
        elif self.map:
            keys = check_map(self.map, load_map(home_path(self.map)))
        else:
            keys = map_of(self.topics)
        return replace(
            keys,
            clock=self.clock or keys.clock,
            background=self.background or keys.background,
            licence=keys.licence or self.licence,
        )

    def _held(self) -> str:
        """Names of the picture topics of the first readable bag."""
        from tactileforge_rosbags.bags import find_bags
        from tactileforge_rosbags.topic_frames import KINDS

        for bag in find_bags(self.root):
            try:
                found = sorted(one.name for one in bag.topics.values() if one.kind in KINDS)
            except DataError:
                continue  # named when it is read
            return f"topics of pictures: {', '.join(found) or '(none)'}"
        return "no bag can be read"

    @property
    def notes(self) -> list[str]:
        """Facts inferred, or read with doubt, a line each."""
        return list(dict.fromkeys([*self._notes, *self._optional.lines()]))

    @cached_property
    def provides(self) -> frozenset[str]:
        """Labels named by the map; empty without one."""
        try:
            keys = self.keys
        except (ConfigError, DataError):
            return frozenset()
        parts = [part for parts in keys.intervals.values() for part in parts]
        stated = {
            "force": any(one.force and one.force.at == "gel" for one in keys.touch),
            "object": keys.object or any(part.object for part in parts),
            "text": keys.text or any(part.text for part in parts),
            "image": keys.camera is not None,
        }
        return frozenset(name for name, there in stated.items() if there)

    def recordings(self, split: str) -> Iterator[Recording]:
        """Yields the recordings of a split, bag by bag.

        A bag, touch or message that cannot be read is left out and listed in ``skipped``.

        Args:
            split: ``train`` or ``val``.

        Raises:
            DataNotFoundError: There is no bag.
            DataError: No recording of the split can be read.
            ConfigError: An unknown split, sensor or bag of an interval, or no topic is named.
        """
        from tactileforge_rosbags.bags import find_bags
        from tactileforge_rosbags.reader import BagFile

        check_split(split)
        keys, opened = self.keys, False
        bags = [*find_bags(self.root)]
        check_names("bag of `intervals`", keys.intervals, {bag.name for bag in bags})
        held = held_out_names([bag.name for bag in bags], self.val)
        for bag in bags:
            if ("val" if bag.name in held else "train") != split:
                continue
            try:
                file = BagFile(bag, self.keys, self._skip, self._notes.append, self._optional)
                for recording in file.recordings():
                    opened = True
                    yield recording
            except DataError as error:
                self._skip(error)
        if self._failed is not None and not opened:
            raise self._failed

    def _skip(self, error: DataError) -> None:
        self._failed = error
        add_once(self.skipped, error)

    @property
    def held_out(self) -> list[str]:
        """The held-out unit."""
        return ["by bag, with all its sensors and cameras"] if self.val else []

    @staticmethod
    def recognise(root: Path) -> Guess | None:
        """Recognises bags by their files, and touch by the names of topics.

        Args:
            root: Folder or file.
        """
        from tactileforge_rosbags.guess import guess

        return guess(root)
