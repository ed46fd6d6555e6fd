"""The release gate on a card: results of `bench suite=[real,real_held_out]` for some weights.

Nothing here needs torch. Differences are those of `bench.results.gate`: paired, with 95 %
intervals.
"""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tactileforge.errors import ConfigError, DataError, DataNotFoundError
from tactileforge.files import write_text

FILE = "gate.json"
#: Which tokens a probe reads.
TOKENS = ("pooled", "summary", "patches")
#: Task of the row of all tasks together, which is no task to win.
MEAN = "mean"


@dataclass(frozen=True, kw_only=True)
class Gate:
    """One task of the gate.

    Attributes:
        model: Tag of the weights.
        suite: ``real``, or ``real_held_out``.
        task: Name of the task in print.
        tokens: Features for the probe: ``pooled``, the mean of the patch tokens; ``summary``, see
            `Model.features`; all ``patches``; or ``groups``, weighed, see `Model.groups`.
        metric: Name of the metric, accuracies as shares; ``mean`` in the row of all tasks together.
        value: The number.
        chance: Value of a probe without features.
        random: Lead over random weights of the same architecture, mean of three.
        random_low: Lower end of its interval.
        pixels: Lead over 16 x 16 pixels of the difference.
        pixels_low: Lower end of its interval.
        counted: Whether it counts, and the row of all tasks together has it.
    """

    model: str
    suite: str
    task: str
    tokens: str
    metric: str
    value: float
    chance: float
    random: float
    random_low: float
    pixels: float
    pixels_low: float
    counted: bool = True

    @property
    def beats(self) -> bool:
        """Whether it beats random weights and pixels, both beyond the interval."""
        return self.random_low > 0 and self.pixels_low > 0


def count_won(rows: Sequence[Gate], tokens: str) -> tuple[int, int]:
    """Number of counted tasks won with one kind of tokens, and number of all counted tasks."""
    chosen = [row for row in rows if row.tokens == tokens and row.metric != MEAN and row.counted]
    return sum(row.beats for row in chosen), len(chosen)


def gate_passes(rows: Sequence[Gate]) -> bool:
    """Whether most tasks are won with each kind of tokens; False without tasks."""
    counts = [count_won(rows, tokens) for tokens in TOKENS]
    return all(2 * wins > every > 0 for wins, every in counts)


def gate_verdict(rows: Sequence[Gate]) -> str:
    """The outcome in a few words."""
    if not rows:
        return "not measured"
    counts = {tokens: count_won(rows, tokens) for tokens in TOKENS}
    parts = [f"{wins} of {every} {tokens}" for tokens, (wins, every) in counts.items()]
    return f"{'passes' if gate_passes(rows) else 'fails'}: {', '.join(parts)}"


def read_gates(folder: str | Path, tag: str, words: Sequence[str], sha256: str = "") -> list[Gate]:
    """The rows of some weights.

    Args:
        folder: Folder of a bench with ``gate.json``.
        tag: Tag of the weights.
        words: Possible names of the model in the bench.
        sha256: Expected hash of the file; "" leaves it unchecked.

    Raises:
        DataNotFoundError: There is no gate in the folder.
        DataError: The bench did not measure the model, or measured another file.
    """
    path = Path(folder) / FILE
    if not path.is_file():
        raise DataNotFoundError(
            f"{path}: no such file; measure the model: tactileforge bench suite=real "
            f"model=[{words[0]}]"
        )
    gate = json.loads(path.read_text("utf-8"))
    name = next((word for word in words if word in gate["models"]), None)
    if name is None:
        raise DataError(f"{path}: measured {', '.join(gate['models'])}, not {words[0]}")
    if sha256 not in ("", gate["models"][name]["sha256"]):
        raise DataError(f"{path}: measured other weights of {name}; run the bench again")
    chance = {row["task"]: row["value"] for row in gate["rows"] if row["model"] == "chance"}
    chosen = [row for row in gate["rows"] if row["model"] == name]
    return [_row(path, gate, row, tag, chance) for row in chosen]


def _row(path: Path, gate: Any, row: Any, tag: str, chance: dict[str, float]) -> Gate:
    task, above = gate["tasks"][row["task"]], row["above"]
    if not {"random", "pixels"} <= above.keys() or row["task"] not in chance:
        raise DataError(f"{path}: no baselines; run the bench without baselines=[]")
    return Gate(
        model=tag,
        suite=gate["suite"],
        task=task["title"],
        tokens=row["reading"],
        metric=task["metric"],
        value=row["value"],
        chance=chance[row["task"]],
        random=above["random"]["value"],
        random_low=above["random"]["low"],
        pixels=above["pixels"]["value"],
        pixels_low=above["pixels"]["low"],
        counted=task.get("counted", True),
    )


def write_gates(card: Path, rows: Sequence[Gate]) -> None:
    """Replaces the gate rows of one model in the front matter of its card.

    Args:
        card: The file ``NAME.md``.
        rows: All of one tag.

    Raises:
        ConfigError: The card has no list of results to put them before.
    """
    text = card.read_text("utf-8")
    # as text, not by a writer of YAML: the rest of a card stays as it was typed
    found = re.search(r"^gates:\n((?:  - .*\n)*)", text, flags=re.M)
    kept = [
        line
        for line in (found[1].splitlines() if found else [])
        if not any(line.startswith(f"  - {{model: {row.model}, ") for row in rows)
    ]
    block = "\n".join(["gates:", *kept, *map(_line, rows), ""])
    text = re.sub(r"^gates:\n(?:  - .*\n)*", "", text, count=1, flags=re.M)
    head, mark, rest = text.partition("\nresults:")
    if not mark:
        raise ConfigError(f"{card}: no line 'results:' in its front matter")
    write_text(card, f"{head}\n{block}results:{rest}")


def stamp_card(card: Path, tag: str, sha256: str, size: int) -> None:
    """Updates hash and size of a file of weights in its card.

    Args:
        card: The file ``NAME.md``.
        tag: Tag of the weights.
        sha256: New hash of the file.
        size: New size of the file, bytes.

    Raises:
        ConfigError: The card has no such line for the tag.
    """
    text = card.read_text("utf-8")
    for key, value in (("sha256", sha256), ("bytes", str(size))):
        pattern = rf"(^  - tag: {re.escape(tag)}\n(?:    .*\n)*?    {key}: )\w+"
        text, count = re.subn(pattern, rf"\g<1>{value}", text, flags=re.M)
        if not count:
            raise ConfigError(f"{card}: weights {tag!r} have no line {key}: to write it to")
    write_text(card, text)


def _line(row: Gate) -> str:
    values = {**vars(row), "task": json.dumps(row.task)}
    words = [f"{key}: {value}" for key, value in values.items()]
    return f"  - {{{', '.join(words)}}}"
