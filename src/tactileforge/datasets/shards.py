"""The data set ``shards``: tar files of recordings, written by `tactileforge data pack`."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from tactileforge.contracts import Guess, Recording
from tactileforge.data.batches.sources import Bad, Source, loaded_source
from tactileforge.data.shards import index, shards
from tactileforge.data.shards.fetch import ShardFolder
from tactileforge.data.shards.foreign import ForeignShardError, check_foreign, is_foreign
from tactileforge.data.shards.index import Index, IndexEntry
from tactileforge.data.shards.summary import Summary
from tactileforge.errors import ConfigError, DataError, DataNotFoundError, command, unknown
from tactileforge.reading.drawn import Drawn
from tactileforge.reading.notes import Lines, add_once
from tactileforge.reading.splits import (
    HOLD_OUT,
    SPLITS,
    check_share,
    check_split,
    held_out,
)
from tactileforge.util.files import cache_folder
from tactileforge.util.regular import MOST_WHOLE, read_regular


class Shards(Drawn):
    """Shards of a folder, with ``index.json`` (`docs/shards.md`).

    They may be on this machine or behind a URL. Remote shards are fetched on demand, verified and
    cached. A local folder may lack an index: all of its ``train-*.tar`` or ``val-*.tar`` are then
    opened at once.

    Args:
        root: Folder of the shards, or its URL.
        cache: Folder of the cache for remote shards; None for the user's cache folder.
        cache_gb: Size limit of the cache, GB; None for no limit. It must hold the shards read by
            all workers at a time.
        val: Share of the training held out for validation, with all recordings opened at once; 0
            uses the stored shards of validation only.
        hold_out: Unit of holding out: ``take`` for whole takes, with all their sensors; ``object``
            for all takes of an object; ``time`` for stretches of half a second.

    Raises:
        ConfigError: A share outside 0..1, or an unknown unit.
    """

    #: Possible labels of shards; the index lists those of its shards.
    provides = frozenset({"force", "action", "object", "text", "image", "surface"})

    def __init__(
        self,
        root: str,
        cache: str | None = None,
        cache_gb: float | None = None,
        val: float = 0.0,
        hold_out: str = "take",
    ) -> None:
        check_share(val)
        if hold_out not in HOLD_OUT:
            raise ConfigError(unknown("hold_out", hold_out, HOLD_OUT))
        self.val = val
        self.hold_out = hold_out
        self.root = root
        self.cache = cache
        self.cache_gb = cache_gb
        self.skipped: list[str] = Lines()

    @staticmethod
    def recognise(root: Path) -> Guess | None:
        """Guess whether a folder has an index of shards, or shards without one."""
        if not root.is_dir():
            return None
        loose = [*sorted(root.glob("train-*.tar")), *sorted(root.glob("val-*.tar"))]
        try:
            index.parse_index(read_regular(root / index.INDEX_FILE, MOST_WHOLE), str(root))
        except (OSError, DataError):
            if not loose or is_foreign(loose[0]):
                return None
        return Guess(options={"root": str(root)}, format="shards of tactileforge", score=1.0)

    @property
    def folder(self) -> ShardFolder:
        """Folder of the shards."""
        return ShardFolder(self.root, cache_folder(self.cache) / "shards", self.cache_gb)

    @cached_property
    def index(self) -> Index | None:
        """The index; None for a local folder without one.

        Raises:
            DataNotFoundError: There is neither an index nor a shard.
            DataError: The index is damaged or cannot be fetched, or the shards were written by
                another program.
        """
        folder = self.folder
        if folder.remote or (folder.path / index.INDEX_FILE).exists():
            return index.parse_index(
                folder.text(index.INDEX_FILE), f"{self.root}/{index.INDEX_FILE}"
            )
        if not any(folder.path.glob("train-*.tar")):
            for path in sorted(folder.path.glob("*.tar"))[:1]:
                check_foreign(path)
            pack = command("data", "pack", "data=NAME", f"out={self.root}")
            raise DataNotFoundError(
                f"{folder.path}: neither {index.INDEX_FILE} nor train-*.tar here; set data.root to "
                f"a folder of shards, or make one: {pack}"
            )
        return None

    def sources(self, split: str) -> list[Source]:
        """One source with a part per shard; see `data.batches.sources.Sharded`.

        Args:
            split: ``train`` or ``val``.

        Raises:
            DataNotFoundError: There are no shards.
            ConfigError: An unknown split.
        """
        check_split(split)
        if not self.val:
            return self._stored(split)
        # a part of the training is held out: one source of that part, or of the rest
        stored = {side: self._stored(side) for side in SPLITS}
        training = [
            recording
            for source in stored["train"]
            for part in source.parts
            for recording in part.open(self._note)
        ]
        content = [*held_out(training, self.val, self.hold_out, split)]
        if split == "val":
            content += [
                recording
                for source in stored["val"]
                for part in source.parts
                for recording in part.open(self._note)
            ]
        return loaded_source(next((source.name for source in stored["train"]), ""), content)

    @property
    def held_out(self) -> list[str]:
        """The held-out unit, beyond the shards of validation."""
        return [f"by {self.hold_out}, of the training shards"] if self.val else []

    def _stored(self, split: str) -> list[Source]:
        """One source of the shards of a split."""
        index, folder = self.index, self.folder
        if index is None:
            return self._unindexed(split)
        entries = index.splits.get(split, [])
        summary = Summary()
        for entry in entries:
            summary.merge(entry.summary)
        parts = [_Shard(folder, entry) for entry in entries]
        return [Source(index.name, parts, summary)] if summary.recordings else []

    def recordings(self, split: str) -> Iterator[Recording]:
        """Yields the recordings of a split, shard after shard.

        Damaged recordings are left out and listed in ``skipped``.

        Args:
            split: ``train`` or ``val``.

        Raises:
            DataNotFoundError: There are no shards.
            ConfigError: An unknown split.
        """
        for source in self.sources(split):
            for part in source.parts:
                yield from part.open(self._note)

    def _unindexed(self, split: str) -> list[Source]:
        content: list[Recording] = []
        for path in sorted(self.folder.path.glob(f"{split}-*.tar")):
            try:
                content += shards.read_shard(path, lambda error: self._note(str(error), 1))
            except ForeignShardError:  # not damaged: none of them is ours
                raise
            except DataError as error:
                self._note(str(error), 1)
        return loaded_source("", content)

    def _note(self, line: str, count: int) -> None:
        add_once(self.skipped, line)


@dataclass(frozen=True)
class _Shard:
    """A shard as a part of its source."""

    folder: ShardFolder
    entry: IndexEntry

    @property
    def recordings(self) -> int:
        """Number of recordings."""
        return self.entry.summary.recordings

    @property
    def seconds(self) -> float:
        """Total duration, s."""
        return self.entry.summary.seconds

    def open(self, bad: Bad) -> Iterator[Recording]:
        """Fetches the shard on demand, yields its recordings; see `data.batches.sources.Part`."""
        left, lines = self.recordings, []
        # lines are reported after the last recording: only then is known how many are lost
        try:
            path = self.folder.get(self.entry.file, self.entry.bytes, self.entry.sha256)
            for recording in shards.read_shard(path, lambda error: lines.append(str(error))):
                left -= 1
                yield recording
        except DataError as error:
            lines.append(str(error))
        # The first line also stands for the recordings lost without a line of their own.
        for line in lines[1:]:
            bad(line, 1)
        if lines:
            bad(lines[0], max(1, left - len(lines) + 1))
