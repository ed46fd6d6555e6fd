"""The release gate on a card: results of `bench suite=[real,real_held_out]` for some weights.

Nothing here needs torch. Differences are those of the bench: paired, with 95 %
intervals.
"""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from tactileforge.errors import ConfigError, DataError, DataNotFoundError
from tactileforge.hub import Card, Measurement, Weight, parse_card
from tactileforge.plugins import install_command, write_text

FILE = "gate.json"
#: Suites of the gate; the second one chooses nothing.
SUITES = ("real", "real_held_out")
#: Task of the row of all counted tasks together, whose metrics are all 1 at best.
MEAN = "mean"
#: What the mean has to be above: its name in the bench, and in words.
COMPARED = {
    "random": "random weights",
    "pixels": "pixels",
    "statistics": "picture statistics",
    "imagenet": "photographs with all that is free",
}


def not_above(row: Measurement) -> list[str]:
    """Baselines within the interval or above, in words."""
    return [words for words in COMPARED.values() if row.above[words][1] <= 0]


def is_below_random(row: Measurement) -> bool:
    """Whether it counts and is below random weights beyond the interval."""
    return row.counted and row.above[COMPARED["random"]][2] < 0


def gate_faults(rows: Sequence[Measurement], tokens: str) -> list[str]:
    """Lists the reasons against some weights, in words; [] for none.

    They pass if the mean of the counted tasks of each suite is above random weights, pixels,
    picture statistics and photographs read best, in value still without the task that carries
    most of each lead, and no counted task is below random weights, each beyond the 95 % interval.

    Args:
        rows: All rows of the weights.
        tokens: Features by which they are judged, those recommended by their card.
    """
    read = [row for row in rows if row.tokens == tokens]
    means = {row.suite: row for row in read if row.metric == MEAN}
    faults = [f"{suite} not measured" for suite in SUITES if suite not in means]
    for suite, mean in means.items():
        if level := not_above(mean):
            faults.append(f"{suite} not above {', '.join(level)}")
    single = [row for row in read if row.metric != MEAN]
    measured = {row.suite for row in single}
    faults += [f"{suite} without single tasks" for suite in means if suite not in measured]
    for suite, mean in means.items():
        counted = [row for row in single if row.suite == suite and row.counted]
        faults += [line for line in _carried(counted) if not not_above(mean)]
    below = [row.task for row in single if is_below_random(row)]
    return faults + [f"below random weights: {task}" for task in below]


def without_largest(leads: Sequence[float]) -> float:
    """Mean lead over tasks without the largest one; 0 for a single task.

    Example:
        >>> without_largest([0.5, 0.25, -0.25])
        0.0
    """
    return (sum(leads) - max(leads)) / (len(leads) - 1) if len(leads) > 1 else 0.0


def _carried(counted: Sequence[Measurement]) -> list[str]:
    """Leads of a suite from a single task, in words."""
    faults = []
    for words in COMPARED.values() if len(counted) > 1 else ():
        leads = {row.task: row.above[words][0] for row in counted}
        if sum(leads.values()) > 0 >= without_largest([*leads.values()]):
            most = max(leads, key=leads.__getitem__)
            faults.append(f"{counted[0].suite} above {words} by one task alone: {most}")
    return faults


def gate_passes(rows: Sequence[Measurement], tokens: str) -> bool:
    """Whether some weights pass with the features recommended by their card."""
    return not gate_faults(rows, tokens)


def gate_verdict(rows: Sequence[Measurement], tokens: str) -> str:
    """The outcome in a few words."""
    if not rows:
        return "not measured"
    faults = gate_faults(rows, tokens)
    return f"fails with {tokens}: {'; '.join(faults)}" if faults else f"passes with {tokens}"


def read_gate(
    folder: str | Path, tag: str, tokens: str, words: Sequence[str], sha256: str = ""
) -> list[Measurement]:
    """The rows of some weights: single tasks with the recommended features, means with all.

    Args:
        folder: Folder of a bench with ``gate.json``.
        tag: Tag of the weights.
        tokens: Features recommended by their card.
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
    # single tasks with the recommended features alone; docs/reports/gate.md has all
    chosen = [
        row
        for row in gate["rows"]
        if row["model"] == name and (tokens == row["reading"] or row["task"] == MEAN)
    ]
    return [_row(path, gate, row, tag, chance) for row in chosen]


def _row(path: Path, gate: Any, row: Any, tag: str, chance: dict[str, float]) -> Measurement:
    task, above = gate["tasks"][row["task"]], row["above"]
    leads = {words: above.get(name) for name, words in COMPARED.items()}
    absent = [words for words, lead in leads.items() if not lead]
    if absent or row["task"] not in chance:
        raise DataError(
            f"{path}: not compared with {', '.join(absent) or 'chance'}: no baselines; bench them"
            f" without baselines=[]; photographs need {install_command('tactileforge[distill]')}"
        )
    return Measurement(
        model=tag,
        suite=gate["suite"],
        task=task["title"],
        tokens=row["reading"],
        metric=task["metric"],
        value=row["value"],
        chance=chance[row["task"]],
        above={words: [lead["value"], lead["low"], lead["high"]] for words, lead in leads.items()},
        counted=task.get("counted", True),
    )


def may_ship(card: Card, weight: Weight) -> bool:
    """Whether weights may ship with the package: demonstrations must be marked as such.

    The text of the card then has the word *demonstration* below the heading of the weights.
    """
    if gate_passes(card.measurements(weight), weight.reading):
        return True
    below = card.text.partition(f"## `{weight.tag}`")[2].partition("\n## ")[0]
    return weight.demonstration and "demonstration" in below


def write_gate(path: Path, rows: Sequence[Measurement]) -> str:
    """Replaces the rows and the verdict of some weights in the front matter of their card.

    Args:
        path: The card, a file ``NAME.md``.
        rows: All of one tag.

    Returns:
        The verdict.

    Raises:
        ConfigError: The card has no list of results to put them before.
    """
    text = path.read_text("utf-8")
    tag = rows[0].model
    # as text, not by a writer of YAML: the rest of a card stays as it was typed
    found = re.search(r"^measured:\n((?:  - .*\n)*)", text, flags=re.M)
    others = found[1].splitlines() if found else []
    kept = [line for line in others if not line.startswith(f"  - {{model: {tag}, ")]
    block = "\n".join(["measured:", *kept, *map(_line, rows), ""])
    text = re.sub(r"^measured:\n(?:  - .*\n)*", "", text, count=1, flags=re.M)
    head, mark, rest = text.partition("\nresults:")
    if not mark:
        raise ConfigError(f"{path}: no line 'results:' in its front matter")
    text = f"{head}\n{block}results:{rest}"
    card = parse_card(path.stem, text, recipe=False)
    weight = card.weight(tag)
    verdict = gate_verdict(card.measurements(weight), weight.reading)
    write_text(path, _with_fact(text, path, tag, "gate", json.dumps(verdict)))
    return verdict


def stamp_card(path: Path, tag: str, sha256: str, size: int) -> None:
    """Updates hash and size of a file of weights in its card.

    Args:
        path: The card, a file ``NAME.md``.
        tag: Tag of the weights.
        sha256: New hash of the file.
        size: New size of the file, bytes.

    Raises:
        ConfigError: The card has no such weights.
    """
    text = path.read_text("utf-8")
    for key, value in (("sha256", sha256), ("bytes", str(size))):
        text = _with_fact(text, path, tag, key, value)
    write_text(path, text)


def _with_fact(text: str, path: Path, tag: str, key: str, value: str) -> str:
    """The text of a card with a line ``key: value`` in the list of facts of some weights."""
    found = re.search(rf"^  - tag: {re.escape(tag)}\n(?:    .*\n)*", text, flags=re.M)
    if not found:
        raise ConfigError(f"{path}: no weights {tag!r}")
    lines = found[0].splitlines(keepends=True)
    kept = [line for line in lines if not line.startswith(f"    {key}: ")]
    at = next((i for i, line in enumerate(lines) if line not in kept), len(kept))
    kept.insert(at, f"    {key}: {value}\n")
    return text[: found.start()] + "".join(kept) + text[found.end() :]


def _line(row: Measurement) -> str:
    values = {**vars(row), "task": json.dumps(row.task)}
    leads = ", ".join(f"{words}: {lead}" for words, lead in row.above.items())
    values["above"] = f"{{{leads}}}"
    return f"  - {{{', '.join(f'{key}: {value}' for key, value in values.items())}}}"
