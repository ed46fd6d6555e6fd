"""Writes a page about a data set, to look at before training."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tactileforge.cli import Command
from tactileforge.errors import TactileForgeError, home_path
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
    from tactileforge.datasets import recognise
    from tactileforge_inspect.write import inspect

    node, out = config["data"], Path(keys.out)
    # known since `guess_words` looked at the path
    doubts = recognise(home_path(keys.path))[0][1].doubts if keys.path else ()
    kept = _keep(keys, node, out) if keys.path else []
    try:
        data = build("datasets", node, "data")
        # as in a file, with what the set guessed
        read = _options(node | getattr(data, "guessed", {}))
        found = inspect(
            data, node["name"], out, keys.recordings, doubts=doubts, layout=dump_yaml(read)
        )
    except TactileForgeError:
        print("\n".join(kept))
        raise
    kept = _keep(keys, read, out) if keys.path else []
    print(found)
    print("\n".join([f"page: {keys.out}", *kept]))
    return Shown(out, out, value=found)


def _options(node: dict[str, Any]) -> dict[str, Any]:
    """Options as a layout file has them, or of the group ``data``."""
    layouts = node.get("layouts") if node.get("name") == "recordings" else None
    return {"layouts": layouts} if layouts else node


def _keep(keys: _Inspect, node: dict[str, Any], out: Path) -> list[str]:
    """Keeps the options of a guess, to be corrected; returns how to."""
    from tactileforge.datasets import LAYOUT_FILE

    kept, read = out.with_suffix(".yaml"), _options(node)
    write_text(kept, dump_yaml(read))
    if "layouts" in read and "name" not in read:
        return [f"layout: {kept}; correct it, and keep it as {Path(keys.path or '') / LAYOUT_FILE}"]
    if node["name"] == "recordings":
        return []
    return [f"options: {kept}; keep it as DIR/data/NAME.yaml, for --config-dir DIR data=NAME"]


COMMANDS = {
    "": Command(
        run=_inspect, keys=_Inspect, groups={"data": "???"}, bare=("path",), prepare=guess_words
    )
}
