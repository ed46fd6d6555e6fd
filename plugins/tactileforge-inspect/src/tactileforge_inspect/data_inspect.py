"""Writes a page about a data set, to look at before training."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tactileforge.cli import Command
from tactileforge.errors import home_path
from tactileforge.pages import Shown
from tactileforge.plugins import build, dump_yaml, write_text
from tactileforge_inspect.guess import guess_words


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


def _inspect(keys: _Inspect, config: dict[str, Any]) -> Shown:
    """Writes a page about a data set, to look at before training."""
    from tactileforge.datasets import LAYOUT_FILE, recognise
    from tactileforge_inspect.write import inspect

    node, out = config["data"], Path(keys.out)
    # known since `guess_words` looked at the path
    doubts = recognise(home_path(keys.path))[0][1].doubts if keys.path else ()
    data = build("datasets", node, "data")
    layouts = node.get("layouts") if node["name"] == "recordings" else None
    # as in the file: a layout file, or an option of the group ``data``, with what the set guessed
    read = {"layouts": layouts} if layouts else {**node, **getattr(data, "guessed", {})}
    found = inspect(data, node["name"], out, keys.recordings, doubts=doubts, layout=dump_yaml(read))
    print(found)
    shown = Shown(out, out, value=found)
    print(f"page: {keys.out}")
    if not keys.path:
        return shown
    kept = out.with_suffix(".yaml")
    write_text(kept, dump_yaml(read))
    if layouts:
        print(f"layout: {kept}; correct it, and keep it as {Path(keys.path) / LAYOUT_FILE}")
    elif node["name"] != "recordings":
        print(f"options: {kept}; keep it as DIR/data/NAME.yaml, for --config-dir DIR data=NAME")
    return shown


COMMANDS = {
    "": Command(
        run=_inspect, keys=_Inspect, groups={"data": "???"}, bare=("path",), prepare=guess_words
    )
}
