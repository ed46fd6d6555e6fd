"""The release gate on a card: results of `bench suite=[real,real_held_out]` for some weights.

Nothing here needs torch. Differences are those of the bench: paired, with 95 %
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
from tactileforge.util.files import write_text

FILE = "gate.json"
#: What a probe reads: the mean of the patch tokens, ``summary`` and ``patches`` as in
#: `Model.features`, or the groups of `Model.groups`, weighed.
TOKENS = ("pooled", "summary", "patches", "groups")
#: Suites of the gate; the second one chooses nothing.
SUITES = ("real", "real_held_out")
#: Task of the row of all counted tasks together.
MEAN = "mean"
#: What the mean has to be above, in words.
COMPARED = {
    "random": "random weights",
    "pixels": "pixels",
    "statistics": "picture statistics",
    "photographs": "photographs with all that is free",
}
#: Their names in the bench.
BENCH_NAMES = dict(zip(COMPARED, COMPARED, strict=True)) | {"photographs": "imagenet"}


@dataclass(frozen=True, kw_only=True)
class Gate:
    """One task of the gate.

    Attributes:
        model: Tag of the weights.
        suite: ``real``, or ``real_held_out``.
        task: Name of the task in print.
        tokens: Features for the probe; one of `TOKENS`.
        metric: Name of the metric, accuracies as shares; ``mean`` in the row of all tasks together.
        value: The number.
        chance: Value of a probe without features.
        random: Lead over random weights of the same architecture, mean of three, with the lower and
            the upper end of its interval.
        pixels: Lead over 16 x 16 pixels of the difference, likewise.
        statistics: Lead over picture statistics, likewise.
        photographs: Lead over a network of photographs by the reading that suits it best in the
            suite, its free groups (pixels, statistics) among them, likewise.
        counted: Whether it counts, and the row of all tasks together has it.
    """

    model: str
    suite: str
    task: str
    tokens: str
    metric: str
    value: float
    chance: float
    random: list[float]
    pixels: list[float]
    statistics: list[float]
    photographs: list[float]
    counted: bool = True

    @property
    def not_above(self) -> list[str]:
        """What it is not above beyond the interval, in words."""
        return [words for name, words in COMPARED.items() if getattr(self, name)[1] <= 0]

    @property
    def is_below_random(self) -> bool:
        """Whether it counts and is below random weights beyond the interval."""
        return self.counted and self.random[2] < 0


def gate_faults(rows: Sequence[Gate], tokens: str) -> list[str]:
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
        if mean.not_above:
            faults.append(f"{suite} not above {', '.join(mean.not_above)}")
    single = [row for row in read if row.metric != MEAN]
    measured = {row.suite for row in single}
    faults += [f"{suite} without single tasks" for suite in means if suite not in measured]
    for suite, mean in means.items():
        counted = [row for row in single if row.suite == suite and row.counted]
        faults += [line for line in _carried(counted) if not mean.not_above]
    below = [row.task for row in single if row.is_below_random]
    return faults + [f"below random weights: {task}" for task in below]


def without_largest(leads: Sequence[float]) -> float:
    """Mean lead over tasks without the largest one; 0 for a single task.

    Example:
        >>> without_largest([0.5, 0.25, -0.25])
        0.0
    """
    return (sum(leads) - max(leads)) / (len(leads) - 1) if len(leads) > 1 else 0.0


def _carried(counted: Sequence[Gate]) -> list[str]:
    """Leads of a suite from a single task, in words."""
    faults = []
    for name, words in COMPARED.items() if len(counted) > 1 else ():
        leads = {row.task: getattr(row, name)[0] for row in counted}
        if sum(leads.values()) > 0 >= without_largest([*leads.values()]):
            most = max(leads, key=leads.__getitem__)
            faults.append(f"{counted[0].suite} above {words} by one task alone: {most}")
    return faults


def gate_passes(rows: Sequence[Gate], tokens: str) -> bool:
    """Whether some weights pass with the features recommended by their card."""
    return not gate_faults(rows, tokens)


def gate_verdict(rows: Sequence[Gate], tokens: str) -> str:
    """The outcome in a few words."""
    if not rows:
        return "not measured"
    faults = gate_faults(rows, tokens)
    return f"fails with {tokens}: {'; '.join(faults)}" if faults else f"passes with {tokens}"


def read_gates(
    folder: str | Path, tag: str, tokens: str, words: Sequence[str], sha256: str = ""
) -> list[Gate]:
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


def _row(path: Path, gate: Any, row: Any, tag: str, chance: dict[str, float]) -> Gate:
    task, above = gate["tasks"][row["task"]], row["above"]
    leads = {name: above.get(BENCH_NAMES[name]) for name in COMPARED}
    absent = [COMPARED[name] for name, lead in leads.items() if not lead]
    if absent or row["task"] not in chance:
        raise DataError(
            f"{path}: not compared with {', '.join(absent) or 'chance'}: no baselines; bench them"
            " without baselines=[]; photographs need pip install 'tactileforge[distill]'"
        )
    return Gate(
        model=tag,
        suite=gate["suite"],
        task=task["title"],
        tokens=row["reading"],
        metric=task["metric"],
        value=row["value"],
        chance=chance[row["task"]],
        **{name: [lead["value"], lead["low"], lead["high"]] for name, lead in leads.items()},
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
