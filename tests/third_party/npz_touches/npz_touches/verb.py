"""Counts the touches of a folder."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from tactileforge.plugin import Command, build


@dataclass(frozen=True, kw_only=True)
class Count:
    """Touches of a folder.

    Attributes:
        root: Folder of the files.
        split: ``train`` or ``val``.
    """

    root: str
    split: str = "train"


def count(keys: Count, _: dict[str, Any]) -> None:
    """Counts the touches of a folder."""
    data = build("datasets", {"name": "npz_touches", "root": keys.root})
    print(sum(1 for _ in data.recordings(keys.split)), "touches")


COMMANDS = {"": Command(run=count, keys=Count, bare=("root",))}
