"""Writes touch as zarr in the format of FTP-1; data=open_x_tactile reads it (docs/data.md)."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tactileforge.cli import Command
from tactileforge.contracts import Dataset
from tactileforge.plugins import build


@dataclass(frozen=True, kw_only=True)
class ZarrExport:
    """Touch as zarr in the format of FTP-1.

    Attributes:
        out: Folder of the groups; it must not exist.
        side: Hand of the sensor: ``right`` or ``left``.
    """

    out: str
    side: str = "right"


def export(keys: ZarrExport, config: dict[str, Any]) -> None:
    """Writes touch as zarr in the format of FTP-1; data=open_x_tactile reads it.

    Raises:
        ConfigError: The folder exists, or the side is unknown.
        DataError: There are no recordings.
    """
    from tactileforge_episodes.zarr_writer import write_zarr

    dataset: Dataset = build("datasets", config["data"])
    recordings = (one for split in ("train", "val") for one in dataset.recordings(split))
    written = write_zarr(recordings, Path(keys.out), keys.side)
    for name, (episodes, rows) in written.items():
        print(f"{name}: {episodes} episodes, {rows} rows")
    print(
        "left out: backgrounds, objects, actions and tracks, for which the format has no place; "
        f"read it: data=open_x_tactile data.root={keys.out}"
    )


COMMANDS = {"": Command(run=export, keys=ZarrExport, groups={"data": "???"}, into=True)}
