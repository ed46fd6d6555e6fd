"""Writes touch as parquet with images; data=image_tables and Hugging Face's datasets read it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tactileforge.cli import Command
from tactileforge.contracts import Dataset
from tactileforge.plugins import build


@dataclass(frozen=True, kw_only=True)
class ParquetExport:
    """Touch as parquet with images in its cells.

    Attributes:
        out: Folder of the tables; it must not exist.
        file_mb: Size of a file from which a new one is begun, MB.
    """

    out: str
    file_mb: float = 500.0


def export(keys: ParquetExport, config: dict[str, Any]) -> None:
    """Writes touch as parquet with images; data=image_tables and Hugging Face's datasets read it.

    Raises:
        ConfigError: The folder exists.
        DataError: There are no recordings.
    """
    from tactileforge_datasets.parquet_writer import write_parquet

    dataset: Dataset = build("datasets", config["data"])
    parts = {split: dataset.recordings(split) for split in ("train", "val")}
    rows = write_parquet(parts, Path(keys.out), keys.file_mb)
    print(f"{sum(rows.values())} rows: {', '.join(f'{split} {n}' for split, n in rows.items())}")
    print(f"read it: datasets.load_dataset('parquet', data_dir={keys.out!r}), data=image_tables")


COMMANDS = {"": Command(run=export, keys=ParquetExport, groups={"data": "???"}, into=True)}
