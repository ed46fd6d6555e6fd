"""Writes a page about a data set, to look at before training."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tactileforge.cli import Command, hydra_value, unquoted
from tactileforge.errors import ConfigError, home_path
from tactileforge.plugins import build, dump_yaml, write_text


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


def _inspect(keys: _Inspect, config: dict[str, Any]) -> None:
    """Writes a page about a data set, to look at before training."""
    from tactileforge.datasets import LAYOUT_FILE
    from tactileforge_inspect.write import inspect

    node, out = config["data"], Path(keys.out)
    print(inspect(build("datasets", node, "data"), node["name"], out, keys.recordings))
    print(f"page: {keys.out}")
    if not keys.path:
        return
    # the options of the guess are kept: as a layout file, or as an option of the group ``data``
    kept = out.with_suffix(".yaml")
    layouts = node.get("layouts") if node["name"] == "recordings" else None
    write_text(kept, dump_yaml({"layouts": layouts} if layouts else node))
    if layouts:
        print(f"layout: {kept}; correct it, and keep it as {Path(keys.path) / LAYOUT_FILE}")
    elif node["name"] != "recordings":
        print(f"options: {kept}; keep it as DIR/data/NAME.yaml, for --config-dir DIR data=NAME")


def _guess(words: list[str]) -> list[str]:
    """Replaces the word of a path by the options of the best guess; later words change these."""
    path = next((word.partition("=")[2] for word in words if word.startswith("path=")), None)
    if path is None or path in ("null", "None"):
        return words
    if named := next((word for word in words if word.startswith("data=")), None):
        raise ConfigError(f"{named} and a path: leave the path out, or {named}")
    from tactileforge.datasets import recognise

    found = recognise(home_path(unquoted(path)))
    name, guess = found[0]
    others = ", ".join(f"{other} ({one.format})" for other, one in found[1:3])
    print(f"{unquoted(path)}: {guess.format}, read by data={name}" + (others and f"; or: {others}"))
    for doubt in guess.doubts:
        print(f"  to be checked: {doubt}")
    options = [f"++data.{key}={hydra_value(value)}" for key, value in guess.options.items()]
    return [f"data={name}", *options, *words]


COMMANDS = {
    "": Command(run=_inspect, keys=_Inspect, groups={"data": "???"}, bare=("path",), prepare=_guess)
}
