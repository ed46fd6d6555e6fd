"""Writes the release gate of a model into its card."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tactileforge.cli import Command
from tactileforge.hub import find_card, zoo_folder
from tactileforge.plugins import sha256
from tactileforge_bench.results.release_gate import read_gate, stamp_card, write_gate


@dataclass(frozen=True, kw_only=True)
class _Gate:
    """Keys of ``zoo gate``.

    Attributes:
        model: Name of a model, NAME.TAG.
        benches: Folders of benches.
        measured: Name in the benches of what became the model's file, for example run:RUN; its
            card gets hash and size of the file. "" for the file that the card has.
    """

    model: str
    benches: list[str]
    measured: str = ""


def _gate(keys: _Gate, _: dict[str, Any]) -> None:
    """Writes the results of the release gate into the card of a model."""
    card, weight = find_card(keys.model)
    folder = Path(str(zoo_folder()))
    path, file = folder / "recipe" / f"{card.name}.md", folder / weight.file
    words, known = [f"{card.name}.{weight.tag}", f"file:{file}"], weight.sha256
    if keys.measured:
        words, known = [keys.measured], ""
    rows = [
        row
        for bench in keys.benches
        for row in read_gate(bench, weight.tag, weight.reading, words, known)
    ]
    if keys.measured:
        stamp_card(path, weight.tag, sha256(file), file.stat().st_size)
    print(f"{path}: {write_gate(path, rows)}")


COMMANDS = {"": Command(run=_gate, keys=_Gate, bare=("model", "benches"))}
