"""``tactileforge data pack | filter | inspect | lerobot``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from tactileforge import registry, settings
from tactileforge.contracts import Dataset
from tactileforge.errors import ConfigError, unknown


def main(argv: Sequence[str]) -> int:
    """Runs the verb.

    Args:
        argv: The words after ``tactileforge data``.

    Returns:
        The exit code.

    Raises:
        TactileForgeError: Something is wrong; says the fix.
    """
    verbs = {"pack": _pack, "filter": _filter, "inspect": _inspect, "lerobot": _lerobot}
    action, *words = argv or ["--help"]
    if action in ("-h", "--help"):
        print(f"tactileforge data {'|'.join(verbs)} data=NAME [key=value ...]; --help shows keys")
        return 0
    if action not in verbs:
        raise ConfigError(unknown("action of tactileforge data", action, verbs))
    if words in (["--help"], ["-h"]):
        print(settings.text(action))
        return 0
    from tactileforge.compose import plain

    config = plain(action, words)
    node = config["data"]
    verbs[action](registry.build("datasets", node), node["name"], config)
    return 0


def _pack(dataset: Dataset, name: str, config: Mapping[str, Any]) -> None:
    from tactileforge.packing import PackOptions, pack, summary

    out = Path(config["out"])
    print(summary(pack(dataset, name, out, PackOptions.of(config["pack"]))))
    print(f"train on them: tactileforge train data=shards data.root={out}")


def _filter(dataset: Dataset, name: str, config: Mapping[str, Any]) -> None:
    from tactileforge.packing import PackOptions
    from tactileforge.packing.preview import preview

    out, options = Path(config["out"]), PackOptions.of(config["pack"])
    page = preview(dataset, name, out, options, config["recordings"], config["frames"])
    print(f"page: {page}")


def _inspect(dataset: Dataset, name: str, config: Mapping[str, Any]) -> None:
    from tactileforge.inspection import inspect

    print(inspect(dataset, name, Path(config["out"]), config["recordings"]))
    print(f"page: {config['out']}")


def _lerobot(dataset: Dataset, name: str, config: Mapping[str, Any]) -> None:
    from tactileforge.lerobot.write import LeRobotOptions, write_dataset

    splits = ("train", "val")
    recordings = (one for split in splits for one in dataset.recordings(split))
    found = write_dataset(recordings, Path(config["out"]), LeRobotOptions(**config["lerobot"]))
    lost = ", ".join(f"{device} {count}" for device, count in found.dropped.items() if count)
    print(
        f"{found.episodes} episodes, {found.rows} rows at {found.fps} per second; frames that no "
        f"row shows: {lost or 'none'}"
    )
    print(f"features: {', '.join(found.features)}")
    print(f"LeRobot reads it: LeRobotDataset('local/touch', root='{config['out']}')")
