"""Writes labels of touch as annotations of TLabel, a JSON a recording."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tactileforge.cli import Command
from tactileforge.contracts import Dataset
from tactileforge.plugins import build


@dataclass(frozen=True, kw_only=True)
class TLabelExport:
    """Labels of touch as annotations of TLabel.

    Attributes:
        out: Folder of the files; it must not exist.
        contact_n: Normal force from which a frame without a track `contact` is in contact, N.
    """

    out: str
    contact_n: float = 0.1


def export(keys: TLabelExport, config: dict[str, Any]) -> None:
    """Writes labels of touch as annotations of TLabel, a JSON a recording; no pictures.

    Raises:
        ConfigError: The folder exists.
        DataError: No recording has contacts, by a track or forces, and a background.
    """
    from tactileforge_datasets.tlabel_writer import write_tlabel

    dataset: Dataset = build("datasets", config["data"])
    parts = {split: dataset.recordings(split) for split in ("train", "val")}
    counts, skipped = write_tlabel(parts, Path(keys.out), keys.contact_n)
    for line in skipped[:3]:
        print(line)
    if len(skipped) > 3:
        print(f"and {len(skipped) - 3} more")
    print(
        f"{counts['files']} files, {counts['frames']} frames; {counts['left out']} frames of "
        "unknown contact, or without a visible place, are left out"
    )
    print(f"read them: tlabel.load('{keys.out}/train/000000.json')")


COMMANDS = {"": Command(run=export, keys=TLabelExport, groups={"data": "???"}, into=True)}
