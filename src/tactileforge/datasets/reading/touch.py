"""A touch of a layout before it is opened."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from tactileforge.datasets.reading.tables import LabelRow


@dataclass(frozen=True)
class LayoutTouch:
    """One touch before it is opened.

    Attributes:
        name: Its file, or its folder for an image sequence, from the folder of the layout.
        paths: Its files.
        row: What is known of it.
    """

    name: str
    paths: list[Path]
    row: LabelRow
