"""Sources of recordings, divided into parts."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Protocol, TypeAlias, runtime_checkable

from tactileforge.contracts import Dataset, Recording
from tactileforge.data.labels.plausible import impossible
from tactileforge.data.shards.index import sort_recordings
from tactileforge.data.shards.summary import Summary

#: Callback for unreadable data: a line with its name, and the number of recordings lost.
Bad: TypeAlias = Callable[[str, int], None]


class Part(Protocol):
    """Recordings opened together: a shard, or all of a small data set."""

    @property
    def recordings(self) -> int:
        """Number of recordings."""
        ...

    @property
    def seconds(self) -> float:
        """Total duration, s."""
        ...

    def open(self, bad: Bad) -> Iterable[Recording]:
        """Open the recordings without decoding; reports unreadable ones to ``bad``."""
        ...


@dataclass(frozen=True)
class Source:
    """A source of recordings, in parts.

    Attributes:
        name: Name for messages; "" for the only source.
        parts: All parts.
        summary: Counts of all parts together.
        weight: Share of a batch, relative to the other sources; None for its share of all clips.
    """

    name: str
    parts: Sequence[Part]
    summary: Summary
    weight: float | None = None

    def open(self, which: Iterable[int], bad: Bad) -> list[Recording]:
        """Open recordings of some parts in the order of `index.sort_key`, each key once."""
        # before sorting: of two with one key, the first that is read stays
        by_key: dict[str, Recording] = {}
        for number in which:
            for recording in self.parts[number].open(bad):
                if wrong := impossible(recording):
                    bad(wrong, 1)
                elif recording.key in by_key:
                    bad(
                        f"{recording.key}: two recordings of {self.name or 'the data'} have this "
                        "key",
                        1,
                    )
                else:
                    by_key[recording.key] = recording
        return sort_recordings(by_key.values())


@runtime_checkable
class ShardedDataset(Protocol):
    """Data set with separate shards (see `contracts.Dataset`)."""

    def sources(self, split: str) -> list[Source]:
        """Sources of a split; only indices are read."""
        ...


@dataclass(frozen=True)
class InMemory:
    """A whole data set as one part, its recordings in memory."""

    content: Sequence[Recording]
    seconds: float

    @property
    def recordings(self) -> int:
        """Number of recordings."""
        return len(self.content)

    def open(self, bad: Bad) -> Sequence[Recording]:
        """All recordings."""
        return self.content


def sources_of(dataset: Dataset, split: str) -> list[Source]:
    """Sources of a data set; a data set without shards is one source of one part.

    Raises:
        DataNotFoundError: Something is missing; see `contracts.Dataset.recordings`.
    """
    if isinstance(dataset, ShardedDataset):
        return dataset.sources(split)
    return loaded_source("", list(dataset.recordings(split)))


def loaded_source(name: str, content: Sequence[Recording]) -> list[Source]:
    """One source of one part with recordings in memory; none without a recording.

    Args:
        name: Name for messages.
        content: All recordings of the source.
    """
    summary = Summary.of(content)
    return [Source(name, [InMemory(content, summary.seconds)], summary)] if content else []
