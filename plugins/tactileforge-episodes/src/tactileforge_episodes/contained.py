"""Containers of other packages as files of arrays."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactileforge.errors import DataError
from tactileforge.plugins import load
from tactileforge.reading import Container, Facts
from tactileforge_episodes.arrays import ArrayFile


class ContainedFile(ArrayFile):
    """A file or folder read by a plugin of the kind ``containers``.

    Args:
        name: Path of the file or folder.
        kind: Name of the plugin.

    Raises:
        DataError: It is damaged.
        PluginError: The plugin lacks one of the four methods of a `Container`.
    """

    def __init__(self, name: str, kind: str) -> None:
        super().__init__(name)
        self.container: Container = load("containers", kind)(name)

    def times(self, key: str) -> NDArray[np.float64] | None:
        """Times of the rows, where the format has them; see `Container.times`."""
        return self.container.times(key)

    def _list(self) -> Iterable[str]:
        return self.container.keys()

    def _look(self, key: str) -> Facts:
        return self.container.array(key).facts

    def _rows(self, key: str, facts: Facts, start: int, stop: int) -> NDArray[Any]:
        values = np.asarray(self.container.array(key).rows(range(start, stop)))
        wanted = (stop - start, *facts.shape[1:]) if facts.shape else ()
        if values.size != np.prod(wanted, dtype=int):
            raise DataError(f"{self.name}, {key}: rows of {values.shape}, where {wanted} are said")
        return values.reshape(wanted)
