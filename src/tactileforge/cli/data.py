"""Inspects, filters and packs a data set; writes it in LeRobot's format, and with vectors."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from tactileforge import packing, registry
from tactileforge.cli._command import Command
from tactileforge.contracts import Dataset
from tactileforge.embed import EmbedOptions as EmbedOptions
from tactileforge.errors import command
from tactileforge.lerobot.options import LeRobotOptions as LeRobotOptions
from tactileforge.lerobot.options import LeRobotSummary, Vectors


@dataclass(frozen=True, kw_only=True)
class _Pack:
    """Recordings to shards.

    Attributes:
        out: Folder of the shards; a run that was stopped goes on there.
        pack: How.
    """

    out: str
    pack: packing.PackOptions = field(default_factory=packing.PackOptions)


@dataclass(frozen=True, kw_only=True)
class _Filter:
    """Keys of ``data filter``.

    Attributes:
        out: The page.
        recordings: How many recordings are looked at.
        frames: How many frames of each.
        pack: As of ``data pack``.
    """

    out: str = "filter.html"
    recordings: int = 24
    frames: int = 300
    pack: packing.PackOptions = field(default_factory=packing.PackOptions)


@dataclass(frozen=True, kw_only=True)
class _Inspect:
    """A data set, before training on it.

    Attributes:
        out: The page.
        recordings: Recordings whose pixels are looked at; all are counted.
    """

    out: str = "inspect.html"
    recordings: int = 400


@dataclass(frozen=True, kw_only=True)
class _LeRobot:
    """Touch as a LeRobot data set.

    Attributes:
        out: Folder of the data set; it must not exist.
        lerobot: How.
    """

    out: str
    lerobot: LeRobotOptions = field(default_factory=LeRobotOptions)


@dataclass(frozen=True, kw_only=True)
class _Tables(LeRobotOptions):
    __doc__ = LeRobotOptions.__doc__
    images: str = "camera"


@dataclass(frozen=True, kw_only=True)
class _Embed:
    """Keys of ``data embed``.

    Attributes:
        model: NAME.TAG of the zoo or file:PATH; its weights stay as they are.
        out: Folder of the data set; it must not exist.
        embed: How touch becomes vectors.
        device: Where the model computes.
        threads: How many threads it may take; None for torch's choice.
        lerobot: How the data set is written.
    """

    model: str
    out: str
    embed: EmbedOptions = field(default_factory=EmbedOptions)
    device: str = "cpu"
    threads: int | None = None
    lerobot: _Tables = field(default_factory=_Tables)


def _data(config: dict[str, Any]) -> tuple[Dataset, str]:
    node = config["data"]
    return registry.build("datasets", node), node["name"]


def _pack(keys: _Pack, config: dict[str, Any]) -> None:
    """Packs recordings into shards (docs/packing.md)."""
    dataset, name = _data(config)
    index = packing.pack(dataset, name, Path(keys.out), keys.pack, config["data"])
    print(packing.summary(index))
    print(f"train on them: {command('train', 'data=shards', f'data.root={keys.out}')}")


def _filter(keys: _Filter, config: dict[str, Any]) -> None:
    """Writes a page that shows what data pack would keep."""
    from tactileforge.packing.preview import preview

    dataset, name = _data(config)
    out = Path(keys.out)
    print(f"page: {preview(dataset, name, out, keys.pack, keys.recordings, keys.frames)}")


def _inspect(keys: _Inspect, config: dict[str, Any]) -> None:
    """Writes a page that shows a data set before training on it."""
    from tactileforge.inspection import inspect

    print(inspect(*_data(config), Path(keys.out), keys.recordings))
    print(f"page: {keys.out}")


def _lerobot(keys: _LeRobot, config: dict[str, Any]) -> None:
    """Writes touch as a LeRobot data set, format v3; data=lerobot reads one (docs/lerobot.md)."""
    _write(keys.out, keys.lerobot, config)


def _embed(keys: _Embed, config: dict[str, Any]) -> None:
    """Writes a LeRobot data set with an encoder's vectors, for LeRobot's policies.

    They are observation.environment_state (docs/lerobot.md#policies).
    """
    from tactileforge.embed import TouchVectors
    from tactileforge.hub.loading import load

    if keys.threads:
        import torch

        torch.set_num_threads(keys.threads)
    vectors = TouchVectors(load(keys.model, device=keys.device), keys.model, keys.embed)
    written = _write(keys.out, keys.lerobot, config, vectors)
    print(
        f"observation.environment_state: {written.vectors} numbers a row "
        f"({' + '.join(vectors.devices)}), {written.vectors * written.rows * 4 / 1e6:.2f} MB"
    )


def _write(
    out: str, options: LeRobotOptions, config: dict[str, Any], vectors: Vectors | None = None
) -> LeRobotSummary:
    from tactileforge.lerobot.write import write_dataset

    dataset, _ = _data(config)
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


_DATA = {"data": "???"}
COMMANDS = {
    "inspect": Command(run=_inspect, keys=_Inspect, groups=_DATA),
    "filter": Command(run=_filter, keys=_Filter, groups=_DATA),
    "pack": Command(run=_pack, keys=_Pack, groups=_DATA, into=True),
    "lerobot": Command(run=_lerobot, keys=_LeRobot, groups=_DATA, into=True),
    "embed": Command(run=_embed, keys=_Embed, groups=_DATA, into=True),
}
