"""Inspects, filters and packs a data set."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from tactileforge import packing, registry
from tactileforge.cli._command import Command
from tactileforge.cli._quote import hydra_value, unquoted
from tactileforge.contracts import Dataset
from tactileforge.errors import ConfigError, command, home_path
from tactileforge.files import write_text
from tactileforge.untrusted import dump_yaml


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


@dataclass(frozen=True, kw_only=True)
class _Inspect:
    """A data set, before training on it.

    Attributes:
        path: Folder or file of unknown format, in place of ``data=``: the format is guessed.
        out: File of the page; of a guessed format, the options are kept beside it, as YAML.
        recordings: Number of recordings whose pixels are looked at; all are counted.
    """

    path: str | None = None
    out: str = "inspect.html"
    recordings: int = 400


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


def _inspect(keys: _Inspect, config: dict[str, Any]) -> None:
    """Writes a page about a data set, to look at before training."""
    from tactileforge_inspect import inspect

    from tactileforge.datasets.recordings import LAYOUT_FILE

    print(inspect(*_data(config), Path(keys.out), keys.recordings))
    print(f"page: {keys.out}")
    if not keys.path:
        return
    # the options of the guess are kept: as a layout file, or as an option of the group ``data``
    node, kept = config["data"], Path(keys.out).with_suffix(".yaml")
    layouts = node.get("layouts") if node["name"] == "recordings" else None
    write_text(kept, dump_yaml({"layouts": layouts} if layouts else node))
    if layouts:
        print(f"layout: {kept}; correct it, and keep it as {Path(keys.path) / LAYOUT_FILE}")
    elif node["name"] != "recordings":
        print(f"options: {kept}; keep it as DIR/data/NAME.yaml, for --config-dir DIR data=NAME")


def _guess(words: list[str]) -> list[str]:
    """Replaces the word of a path by the options of the best guess; later words change these."""
    from tactileforge.datasets.recognise import recognise

    path = next((word.partition("=")[2] for word in words if word.startswith("path=")), None)
    if path is None or path in ("null", "None"):
        return words
    if named := next((word for word in words if word.startswith("data=")), None):
        raise ConfigError(f"{named} and a path: leave the path out, or {named}")
    found = recognise(home_path(unquoted(path)))
    name, guess = found[0]
    others = ", ".join(f"{other} ({one.format})" for other, one in found[1:3])
    print(f"{unquoted(path)}: {guess.format}, read by data={name}" + (others and f"; or: {others}"))
    for doubt in guess.doubts:
        print(f"  to be checked: {doubt}")
    options = [f"++data.{key}={hydra_value(value)}" for key, value in guess.options.items()]
    return [f"data={name}", *options, *words]


_DATA = {"data": "???"}
COMMANDS = {
    "inspect": Command(run=_inspect, keys=_Inspect, groups=_DATA, bare=("path",), prepare=_guess),
    "filter": Command(run=_filter, keys=_Filter, groups=_DATA),
    "pack": Command(run=_pack, keys=_Pack, groups=_DATA, into=True),
}
