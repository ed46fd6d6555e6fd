"""The data set ``mixture``: several data sets at once."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

from tactileforge.contracts import Dataset, Recording
from tactileforge.data.batches.sources import Bad, Part, Source, sources_of
from tactileforge.errors import ConfigError, DataNotFoundError, check_names
from tactileforge.plugins import registry
from tactileforge.reading.drawn import Drawn


class Mixture(Drawn):
    """Several data sets as one; every batch holds a fixed share of each.

    Objects are distinct between data sets: ``cup`` of one is not the ``cup`` of another. Command
    line: ``data=mixture +data@data.sources.a=sim +data@data.sources.b=octopi data.weights.b=2``.

    Args:
        sources: Configuration of each data set, by a name of its own: ``name`` is the plugin; null
            drops one.
        weights: Weight of each data set in a batch, by that name; without one, its share of a
            batch is its share of all clips.
    """

    def __init__(
        self,
        sources: dict[str, dict[str, Any] | None] | None = None,
        weights: dict[str, float] | None = None,
    ) -> None:
        self.given = {name: node for name, node in (sources or {}).items() if node is not None}
        self.weights = dict(weights or {})
        check_names("source in data.weights", self.weights, self.given)

    @cached_property
    def datasets(self) -> dict[str, Dataset]:
        """The data sets, by name.

        Raises:
            DataNotFoundError: There are no sources.
            ConfigError: A source is a mixture itself.
        """
        if not self.given:
            raise DataNotFoundError(
                "data=mixture has no sources; add some: +data@data.sources.a=sim "
                "+data@data.sources.b=shards data.sources.b.root=DIR"
            )

        nodes: Mapping[str, Mapping[str, Any]] = self.given
        if any(node.get("name") == "mixture" for node in nodes.values()):
            raise ConfigError("a source of data=mixture is a mixture; list its sources instead")
        return {
            name: registry.build("datasets", node, f"data.sources.{name}")
            for name, node in nodes.items()
        }

    @property
    def provides(self) -> frozenset[str]:
        """Labels provided by any of the data sets."""
        return frozenset[str]().union(*(data.provides for data in self.datasets.values()))

    @property
    def skipped(self) -> list[str]:
        """Lines about the unreadable recordings of all data sets."""
        return [line for data in self.datasets.values() for line in data.skipped]

    @property
    def notes(self) -> list[str]:
        """Lines about doubtful recordings of all data sets."""
        noted = ((name, getattr(data, "notes", ())) for name, data in self.datasets.items())
        return [f"{name}: {line}" for name, lines in noted for line in lines]

    @property
    def held_out(self) -> list[str]:
        """The held-out unit of each of the data sets."""
        said = ((name, getattr(data, "held_out", ())) for name, data in self.datasets.items())
        return [f"{name}: {line}" for name, lines in said for line in lines]

    def sources(self, split: str) -> list[Source]:
        """The sources of all data sets; see `data.batches.sources.Sharded`."""
        return [
            replace(
                source,
                name=name,
                parts=[_Named(name, part) for part in source.parts],
                weight=self.weights.get(name),
            )
            for name, data in self.datasets.items()
            for source in sources_of(data, split)
        ]

    def recordings(self, split: str) -> Iterator[Recording]:
        """Yields the recordings of a split, data set after data set."""
        for name, data in self.datasets.items():
            for recording in data.recordings(split):
                yield _named(name, recording)


@dataclass(frozen=True)
class _Named:
    """A part of a source; prefixes its recordings with the name of their data set."""

    name: str
    part: Part

    @property
    def recordings(self) -> int:
        """Number of recordings."""
        return self.part.recordings

    @property
    def seconds(self) -> float:
        """Total duration, s."""
        return self.part.seconds

    def open(self, bad: Bad) -> Iterator[Recording]:
        """Opens them; see `data.batches.sources.Part`."""
        for recording in self.part.open(bad):
            yield _named(self.name, recording)


def _named(name: str, recording: Recording) -> Recording:
    label = recording.object
    whole = None if label is None else f"{name}/{label}"
    return replace(recording, key=f"{name}/{recording.key}", object=whole)
