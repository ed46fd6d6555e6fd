"""Filters and packs a data set; packages bring further actions."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from tactileforge import packing
from tactileforge.cli.command import Command
from tactileforge.contracts import Dataset
from tactileforge.errors import command
from tactileforge.plugins import registry


@dataclass(frozen=True, kw_only=True)
class _Pack:
    """Recordings to shards.

    Attributes:
        out: Folder of the shards; a stopped run resumes there.
        pack: Options of packing.
    """

    out: str
    pack: packing.PackOptions = field(default_factory=packing.PackOptions)


@dataclass(frozen=True, kw_only=True)
class _Filter:
    """Keys of ``data filter``.

    Attributes:
        out: File of the page.
        recordings: Number of recordings to look at.
        frames: Number of frames of each.
        pack: Options of packing, as for ``data pack``.
    """

    out: str = "filter.html"
    recordings: int = 24
    frames: int = 300
    pack: packing.PackOptions = field(default_factory=packing.PackOptions)


def _data(config: dict[str, Any]) -> tuple[Dataset, str]:
    node = config["data"]
    return registry.build("datasets", node, "data"), node["name"]


def _pack(keys: _Pack, config: dict[str, Any]) -> None:
    """Packs recordings into shards (docs/packing.md)."""
    dataset, name = _data(config)
    index = packing.pack(dataset, name, Path(keys.out), keys.pack, config["data"])
    print(packing.summary(index))
    print(f"train on them: {command('train', 'data=shards', f'data.root={keys.out}')}")


def _filter(keys: _Filter, config: dict[str, Any]) -> None:
    """Writes a page with the frames kept and dropped by data pack."""
    from tactileforge.packing.preview import preview

    dataset, name = _data(config)
    out = Path(keys.out)
    print(f"page: {preview(dataset, name, out, keys.pack, keys.recordings, keys.frames)}")


_DATA = {"data": "???"}
COMMANDS = {
    "filter": Command(run=_filter, keys=_Filter, groups=_DATA),
    "pack": Command(run=_pack, keys=_Pack, groups=_DATA, into=True),
}
