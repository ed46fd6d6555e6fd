"""Bags below a folder, and open bags, kept for the next clip."""

from __future__ import annotations

import atexit
import os
from collections import OrderedDict
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path
from threading import RLock
from typing import Any

from tactileforge.errors import ConfigError, DataError, DataNotFoundError, unknown
from tactileforge.plugins import check_pointer
from tactileforge.reading import MOST_BYTES, check_unpacked, folders_below, zstd_size
from tactileforge_rosbags.guards import (
    CheckedChunks,
    check_metadata,
    check_packed,
    check_tables,
    check_unindexed,
    limit_chunks,
    limit_tables,
)

#: Ends of the files of bags.
_ENDS = (".bag", ".db3", ".mcap")
#: Ends of a file of a folder with ``metadata.yaml`` that is compressed whole.
_PACKED = tuple(f"{end}.zstd" for end in _ENDS)
#: Name of the file that makes a folder a bag.
_METADATA = "metadata.yaml"
#: Characters of a path that an address of sqlite gives a meaning.
_SQLITE = frozenset("?#%")
#: Connection, time and bytes of a message.
_Raw = tuple[Any, int, bytes]
#: Number of bags that stay open in a process.
_KEPT = 4


@dataclass(frozen=True)
class Topic:
    """A topic of a bag.

    Attributes:
        name: Its name.
        kind: Type of its messages, such as ``sensor_msgs/msg/Image``; "" for several.
        count: Number of messages.
    """

    name: str
    kind: str
    count: int


@dataclass(frozen=True)
class Bag:
    """A bag on disk, opened when it is read.

    Attributes:
        path: Its folder or file.
        name: Its name in the data set.
    """

    path: str
    name: str

    def __str__(self) -> str:
        return self.path

    @property
    def topics(self) -> dict[str, Topic]:
        """Its topics by name.

        Raises:
            DataError: The bag is damaged, or compressed in an unknown way.
        """
        with _OPEN.bag(self.path) as opened:
            return opened.topics

    @property
    def start(self) -> int:
        """Time of its first message, ns."""
        with _OPEN.bag(self.path) as opened, _named(self.path):
            return int(opened.reader.start_time)

    def messages(
        self, topic: str, start: int | None = None, stop: int | None = None
    ) -> Iterator[tuple[int, Any]]:
        """Yields times of recording, ns, and messages of a topic, in order of time.

        Args:
            topic: Name of the topic.
            start: First time, ns; None for the first of all.
            stop: Time after the last, ns; None for all.

        Raises:
            DataError: The bag is damaged, has no such topic, or defines its type in another way.
        """
        with _OPEN.bag(self.path) as opened:
            yield from opened.messages(topic, start, stop)

    def topic(self, name: str, kinds: tuple[str, ...]) -> Topic:
        """A topic of one of some types.

        Raises:
            DataError: It is not there, of another type, or empty; names the nearest.
        """
        known = self.topics
        if name not in known:
            raise DataError(f"{self}: {unknown('topic', name, known)}; correct data.topics or map")
        found = known[name]
        if found.kind not in kinds:
            wanted = " or ".join(kinds)
            others = ", ".join(sorted(one.name for one in known.values() if one.kind in kinds))
            raise DataError(
                f"{self}, {name}: messages of {found.kind or 'several types'}, where {wanted} is "
                f"expected; of that type are: {others or '(none)'}"
            )
        if not found.count:
            raise DataError(f"{self}, {name}: no message; record it again, or leave it out")
        return found


def find_bags(root: Path) -> Iterator[Bag]:
    """Yields the bags below a folder, in order of their paths: folders, and files beside them.

    Args:
        root: The folder, or a single bag.

    Raises:
        DataNotFoundError: There is none.
    """
    paths = [root] if root.suffix in _ENDS and root.is_file() else [*_walk(root)]
    if not paths:
        raise DataNotFoundError(
            f"{root}: no bag: no folder with {_METADATA}, and no file that ends like "
            f"{', '.join(_ENDS)}; set data.root to a bag, or to the folder of the bags"
        )
    for path in paths:
        name = path.relative_to(root).as_posix() if path != root else root.name
        yield Bag(str(path), name.removesuffix(path.suffix) if path.suffix in _ENDS else name)


def _walk(root: Path) -> Iterator[Path]:
    bags: list[Path] = []
    for place in folders_below(root) if root.is_dir() else ():
        names = _names(place)
        if any(place.is_relative_to(bag) for bag in bags):
            continue
        if _METADATA in names and any(name.endswith(_ENDS + _PACKED) for name in names):
            bags.append(place)
            yield place
        else:
            yield from (one for one in _files(place) if one.suffix in _ENDS)


def _files(folder: Path) -> list[Path]:
    return sorted(one for one in folder.iterdir() if one.is_file() and one.name[0] != ".")


def _names(place: Path) -> list[str]:
    return [one.name for one in _files(place)] if place.is_dir() else [place.name]


class _OpenBag:
    """An open bag; messages are decoded by definitions of ROS, never by those in the bag."""

    def __init__(self, path: str) -> None:
        try:
            from rosbags.rosbag1 import Reader as Reader1
            from rosbags.rosbag2 import Reader as Reader2
            from rosbags.typesys import Stores, get_typestore
        except ImportError as error:
            raise ConfigError(
                f"data=rosbags cannot import rosbags ({error}): pip install rosbags lz4"
            ) from error
        self.path = path
        with _named(path):
            _check_files(Path(path))
        if _SQLITE & set(path) and any(name.endswith(".db3") for name in _names(Path(path))):
            raise DataError(f"{path}: sqlite misreads ?, # and % in a path; rename the bag")
        self.is1 = path.endswith(".bag")
        self.store = get_typestore(Stores.ROS1_NOETIC if self.is1 else Stores.LATEST)
        with _named(path):
            self.reader: Any = Reader1(path) if self.is1 else Reader2(path)
            self.reader.open()
        try:
            limit_chunks(path, self.reader) if self.is1 else _limit(path, self.reader)
        except DataError:
            self.reader.close()
            raise

    @cached_property
    def topics(self) -> dict[str, Topic]:
        """Topics by name."""
        with _named(self.path):
            found = self.reader.topics
            return {
                name: Topic(name, info.msgtype or "", info.msgcount) for name, info in found.items()
            }

    def messages(
        self, topic: str, start: int | None, stop: int | None
    ) -> Iterator[tuple[int, Any]]:
        """Yields messages; see `Bag.messages`."""
        with _named(self.path):
            connections = self.reader.topics[topic].connections
            for connection in connections:
                self._check_type(connection.msgtype, connection.digest)
            decode = self.store.deserialize_ros1 if self.is1 else self.store.deserialize_cdr
            for connection, time, raw in self.reader.messages(connections, start, stop):
                if type(time) is not int or type(raw) is not bytes:  # sqlite has no types
                    raise TypeError(f"{topic} has a message of {type(raw)} at {time!r:.20}")
                yield time, decode(raw, connection.msgtype)

    def _check_type(self, kind: str, digest: str) -> None:
        """Raises a `DataError` for a bag with another meaning of a type name of ROS."""
        known = self.store.generate_msgdef(kind)[1] if self.is1 else self.store.hash_rihs01(kind)
        if digest and digest != known:
            raise DataError(
                f"{self.path}: its {kind} is not that of ROS (digest {digest[:16]}); convert it"
            )


def _check_files(path: Path) -> None:
    """Raises a `DataError` for a file without end, to unpack or to run, when it is opened."""
    check_metadata(path / _METADATA)
    for file in _files(path) if path.is_dir() else [path]:
        if file.name.endswith(_PACKED):
            check_packed(file)
        elif file.suffix == ".db3":
            check_tables(file)
        elif file.suffix == ".mcap":
            check_unindexed(file)


def _limit(path: str, reader: Any) -> None:
    """Makes an open bag check unpacked chunks while it is read."""
    for storage in getattr(reader.storage, "storages", [reader.storage]):
        if hasattr(storage, "dbconn"):
            limit_tables(storage)
        if getattr(storage, "chunks", None):
            storage.messages = CheckedChunks(path, storage).messages
        if reader.compression_mode == "message":
            storage.messages = partial(_checked, path, storage.messages)


def _checked(path: str, messages: Callable[..., Iterator[_Raw]], *which: Any) -> Iterator[_Raw]:
    """Single compressed messages, each checked to unpack to a picture at most."""
    for found in messages(*which):
        size, is_bound = zstd_size(found[2])
        if not is_bound:  # of the first frame, behind which others may be
            size = max(size, zstd_size(found[2], whole=True)[0])
        if why := f"{size} bytes" if size > MOST_BYTES else check_unpacked(len(found[2]), size):
            raise DataError(f"{path}: a message of {len(found[2])} bytes unpacks to more: {why}")
        yield found


class _OpenBags:
    """The most recently read bags, open."""

    def __init__(self) -> None:
        self.forget()

    def forget(self) -> None:
        """Leaves the open bags of a parent process to it."""
        self._lock = RLock()
        self._bags: OrderedDict[tuple[str, int], _OpenBag] = OrderedDict()

    @contextmanager
    def bag(self, path: str) -> Iterator[_OpenBag]:
        """An open bag for one thread at a time.

        Raises:
            DataError: It cannot be opened.
        """
        with self._lock:
            key = (path, changed(path))
            if key not in self._bags:
                self._bags[key] = _OpenBag(path)
            self._bags.move_to_end(key)
            yield self._bags[key]
            while len(self._bags) > _KEPT:
                self._bags.popitem(last=False)[1].reader.close()

    def close(self) -> None:
        """Closes all."""
        while self._bags:
            self._bags.popitem()[1].reader.close()


def changed(path: str) -> int:
    """Time of the last change of a bag, ns.

    Raises:
        DataError: It is gone.
    """
    place = Path(path)
    try:
        files = [place, *place.iterdir()] if place.is_dir() else [place]
        return max(one.stat().st_mtime_ns for one in files)
    except OSError as error:
        raise DataError(f"{path}: cannot be read: {error}") from error


@contextmanager
def _named(path: str) -> Iterator[None]:
    """Names the bag in errors of rosbags: damaged files raise errors of any type there."""
    try:
        yield
    except (ConfigError, DataError):
        raise
    except Exception as error:
        place = Path(path)
        for file in _files(place) if place.is_dir() else [place]:
            check_pointer(file)
        why = " ".join(str(error).split()) or "unexpected end or content"
        raise DataError(
            f"{path}: cannot be read ({type(error).__name__}: {why}); copy it again, or repair it: "
            "ros2 bag reindex, rosbag reindex, mcap recover"
        ) from error


_OPEN = _OpenBags()
os.register_at_fork(after_in_child=_OPEN.forget)
atexit.register(_OPEN.close)
