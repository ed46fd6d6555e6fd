"""The data set ``shards``: tar files of recordings, as `tactileforge sim` writes them."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from tactileforge.contracts import Recording
from tactileforge.data import shards
from tactileforge.errors import ConfigError, DataError, DataNotFoundError, unknown

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class Shards:
    """Shards of a folder: ``train-*.tar`` and ``val-*.tar`` (`docs/shards.md`).

    Args:
        root: Folder of the shards.
    """

    #: What shards may carry; what they do carry shows when they are read.
    provides = frozenset({"force", "action", "object", "text", "image"})

    def __init__(self, root: str = ".") -> None:
        self.root = Path(root).expanduser()
        self.skipped: list[str] = []

    def recordings(self, split: str) -> Iterator[Recording]:
        """Yields the recordings of a split, in the order of the files' names.

        A shard that is damaged is left out and listed in ``skipped``.

        Args:
            split: ``train`` or ``val``.

        Raises:
            DataNotFoundError: The folder has no shard for training.
            ConfigError: An unknown split.
        """
        if split not in ("train", "val"):
            raise ConfigError(unknown("split", split, ("train", "val")))
        found = sorted(self.root.glob(f"{split}-*.tar"))
        if not found and split == "train":
            raise DataNotFoundError(
                f"{self.root}: no train-*.tar here; set data.root to a folder of shards, or make "
                f"one: tactileforge sim out={self.root}"
            )
        for path in found:
            try:
                yield from list(shards.read(path))
            except DataError as error:
                if str(error) not in self.skipped:
                    self.skipped.append(str(error))

    def plot(self, recording: Recording) -> Figure:
        """A figure of a recording."""
        from tactileforge.datasets.figure import plot

        return plot(recording)
