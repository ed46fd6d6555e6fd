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
        """Opens them; decodes nothing. What cannot be opened is left out, and ``bad`` is told."""
        ...


@dataclass(frozen=True)
class Source:
    """One of the places that clips are drawn from.

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
        """The recordings of some parts, in the order of `index.sort_key`; one key comes once."""
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
    """A data set that need not be opened as a whole (see `contracts.Dataset`)."""

    def sources(self, split: str) -> list[Source]:
        """The sources of a split; nothing but indices is read."""
        ...


@dataclass(frozen=True)
class InMemory:
    """The part that a data set is whose recordings are all at hand."""

    content: Sequence[Recording]
    seconds: float

    @property
    def recordings(self) -> int:
        """Number of recordings."""
        return len(self.content)

    def open(self, bad: Bad) -> Sequence[Recording]:
        """All of them."""
        return self.content


def sources_of(dataset: Dataset, split: str) -> list[Source]:
    """The sources of a data set; one that is not in parts is one source of one part.

    Raises:
        DataNotFoundError: Something is missing; see `contracts.Dataset.recordings`.
    """
    if isinstance(dataset, Sharded):
        return dataset.sources(split)
    content = list(dataset.recordings(split))
    summary = Summary.of(content)
    return [Source("", [InMemory(content, summary.seconds)], summary)] if content else []
