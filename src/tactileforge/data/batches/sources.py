"""Sources of recordings, each in parts that are opened as a whole."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Protocol, TypeAlias, runtime_checkable

from tactileforge.contracts import Dataset, Recording
from tactileforge.data.labels.plausible import impossible
from tactileforge.data.shards.index import sort_recordings
from tactileforge.data.shards.summary import Summary

#: Is told of what cannot be read: a line that names it, and how many recordings it costs.
Bad: TypeAlias = Callable[[str, int], None]


class Part(Protocol):
    """Some recordings that are opened together: a shard, or all of a small data set."""

    @property
    def recordings(self) -> int:
        """Number of recordings."""
        ...

    @property
    def seconds(self) -> float:
        """Total duration, s."""
        ...

    def open(self, bad: Bad) -> Iterable[Recording]:
        """Opens the recordings without decoding; unreadable ones are reported to ``bad``."""
        ...


@dataclass(frozen=True)
class Source:
    """A source of recordings, in parts.

    Attributes:
        name: For messages; "" where there is but one.
        parts: All of it.
        summary: What the parts hold together.
        weight: Share of a batch, relative to the other sources; None for the share it has of all
            clips.
    """

    name: str
    parts: Sequence[Part]
    summary: Summary
    weight: float | None = None

    def open(self, which: Iterable[int], bad: Bad) -> list[Recording]:
        """Opens recordings of some parts in the order of `index.sort_key`; one key comes once."""
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
class Sharded(Protocol):
    """A data set that can be opened shard by shard (see `contracts.Dataset`)."""

    def sources(self, split: str) -> list[Source]:
        """Returns the sources of a split; only indices are read."""
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
    """Returns the sources of a data set; one without parts is one source of one part.

    Raises:
        DataNotFoundError: Something is missing; see `contracts.Dataset.recordings`.
    """
    if isinstance(dataset, Sharded):
        return dataset.sources(split)
    content = list(dataset.recordings(split))
    summary = Summary.of(content)
    return [Source("", [InMemory(content, summary.seconds)], summary)] if content else []
