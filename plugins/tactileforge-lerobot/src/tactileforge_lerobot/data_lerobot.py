"""Writes touch as a LeRobot data set, format v3; data=lerobot reads one (docs/lerobot.md)."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from tactileforge.cli import Command
from tactileforge.contracts import Dataset
from tactileforge.plugins import build
from tactileforge_lerobot.options import LeRobotOptions, LeRobotSummary, Vectors


@dataclass(frozen=True, kw_only=True)
class Export:
    """Touch as a LeRobot data set.

    Attributes:
        out: Folder of the data set; it must not exist.
        lerobot: Options of the written data set.
    """

    out: str
    lerobot: LeRobotOptions = field(default_factory=LeRobotOptions)


def export(keys: Export, config: dict[str, Any]) -> None:
    """Writes touch as a LeRobot data set, format v3; data=lerobot reads one (docs/lerobot.md)."""
    write(keys.out, keys.lerobot, config)


def write(
    out: str, options: LeRobotOptions, config: dict[str, Any], vectors: Vectors | None = None
) -> LeRobotSummary:
    """Writes both splits of the data set of a configuration, and prints a summary.

    Args:
        out: Folder of the LeRobot data set.
        options: Options of the written data set.
        config: The whole configuration; ``data`` is the data set to write.
        vectors: Source of further vectors, None for none; see `write.write_dataset`.
    """
    from tactileforge_lerobot.write import write_dataset

    dataset: Dataset = build("datasets", config["data"])
    splits = ("train", "val")
    recordings = (recording for split in splits for recording in dataset.recordings(split))
    written = write_dataset(recordings, Path(out), options, vectors)
    lost = ", ".join(f"{device} {count}" for device, count in written.dropped.items() if count)
    print(
        f"{written.episodes} episodes, {written.rows} rows at {written.fps} per second; frames "
        f"that no row shows: {lost or 'none'}"
    )
    print(f"features: {', '.join(written.features)}")
    if written.lacks:
        lacks = " and ".join(f"no {feature}" for feature in written.lacks)
        print(f"{lacks}: LeRobot trains no policy on it (docs/lerobot.md#policies)")
    print(f"LeRobot reads it: LeRobotDataset('local/touch', root={out!r})")
    return written


COMMANDS = {"": Command(run=export, keys=Export, groups={"data": "???"}, into=True)}
