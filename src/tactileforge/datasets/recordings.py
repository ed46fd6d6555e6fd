"""The data set ``recordings``: folders of videos or images, described by layouts."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from omegaconf import OmegaConf

from tactileforge.contracts import Recording
from tactileforge.datasets.layout import EXAMPLE, Layout, parse
from tactileforge.datasets.reader import Reader
from tactileforge.datasets.splits import held_out_parts, is_held_out
from tactileforge.errors import ConfigError, DataError, DataNotFoundError, unknown

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: A file of this name in the root describes the data that it came with.
LAYOUT_FILE = "tactileforge.yaml"


class Recordings:
    """Touch recordings in folders, described by layouts (see `docs/data.md`).

    Args:
        root: Folder of the data.
        layouts: Layout by name; a layout of None is left out. None reads ``tactileforge.yaml`` in the
            root, a mapping with the one key ``layouts``.
        val: Share that is held out for validation where a layout does not say which.

    Raises:
        ConfigError: A layout is wrong: names the layout and the key.

    Example:
        >>> data = Recordings("touches", {"a": {
        ...     "videos": "*.mp4", "sensor": "digit", "background": {"first": 3}}})
        >>> sorted(data.provides)
        []
    """

    def __init__(
        self, root: str = ".", layouts: Mapping[str, Any] | None = None, val: float = 0.1
    ) -> None:
        if not 0 <= val < 1:
            raise ConfigError(f"val is {val}; give the share that is held out, 0 to below 1")
        self.root = Path(root).expanduser()
        self.val = val
        self.skipped: list[str] = []
        self._given = parse_all(layouts) if layouts else None

    @cached_property
    def layouts(self) -> list[Layout]:
        """The layouts, those given or those of the root."""
        return self._given if self._given is not None else _shipped(self.root)

    @cached_property
    def provides(self) -> frozenset[str]:
        """Labels that at least one layout gives."""
        return frozenset().union(*(layout.provides for layout in self.layouts))

    def recordings(self, split: str) -> Iterator[Recording]:
        """Yields the recordings of a split, layout by layout, files in natural order.

        A recording that cannot be opened is left out and listed in ``skipped``.

        Args:
            split: ``train`` or ``val``.

        Raises:
            ConfigError: An unknown split, or a value of a label that cannot be used.
            DataNotFoundError: A folder or file is missing.
            DataError: Labels contradict the files, or no recording can be opened.
        """
        if split not in ("train", "val"):
            raise ConfigError(unknown("split", split, ("train", "val")))
        opened, failed = 0, []
        for layout in self.layouts:
            reader = Reader(layout, self.root)
            for touch in reader.touches():
                side = self._side(layout, touch.key, touch.group, touch.split)
                if side not in (split, "time"):
                    continue
                try:
                    found = reader.open(touch)
                except _Unreadable as error:
                    failed.append(str(error))
                    continue
                opened += 1
        ...
