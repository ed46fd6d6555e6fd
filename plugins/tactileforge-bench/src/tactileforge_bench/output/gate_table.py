"""The release gate as a table, and as a file."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from tactileforge.plugins import write_text
from tactileforge_bench.output.grid import ColumnHead, Table, TableEntry, fixed
from tactileforge_bench.results import gate
from tactileforge_bench.results.gate import GateRow
from tactileforge_bench.results.release_gate import COMPARED, FILE, MEAN
from tactileforge_bench.results.results import Results
from tactileforge_bench.results.scores import titles

#: Titles of the table: with all baselines of the release gate, and with some.
GATE, BESIDE = "Release gate", "Beside what is free"
_CAPTION = (
    "Closed-form probes; accuracies as shares. In brackets the 95 % interval (bootstrap over "
    "recordings or objects). Below, what it is above random weights of its architecture (r) and "
    "above 16 x 16 pixels (p), paired, with the lower end of the interval; in the mean also above "
    "picture statistics (s) and a network of photographs, read best (i). ▲ above the first two "
    "beyond the interval; ▼ below one of them beyond it. Tasks in brackets do not count."
)
_PASSES = (
    " A model passes whose mean is above all four beyond the interval, in value without any one "
    "task too, with no task below random weights."
)


def write_gate(folder: Path, results: Results) -> list[GateRow]:
    """Writes ``gate.json``, unless no probe is in closed form."""
    rows = gate.compute_gate(folder, results)
    if rows:
        plain = gate.gate_to_plain(rows, results)
        write_text(folder / FILE, json.dumps(plain, indent=1, allow_nan=False) + "\n")
    return rows


def gate_table(gate_rows: Sequence[GateRow], results: Results) -> Table | None:
    """The table of the release gate; None if it is empty."""
    if not gate_rows:
        return None
    names = titles(results)
    keys = list(dict.fromkeys((row.model, row.reading) for row in gate_rows))
    known = {(row.model, row.reading, row.task): row for row in gate_rows}
    tasks = gate.gate_tasks(results)
    task_titles = {task.name: task.title for task in tasks}
    outcomes = gate.gate_outcomes(gate_rows, results)
    absent = _absent(gate_rows)
    rows = []
    for model, reading in keys:
        # None where the model was not run on a task
        cells = [known.get((model, reading, task.name)) for task in tasks]
        mean = known.get((model, reading, MEAN))
        entries = [_entry(row) for row in (*cells, mean)]
        row = [TableEntry(names[model]), TableEntry(reading), *entries]
        if not absent:
            found = outcomes.get(model, {}).get(reading)
            row.append(TableEntry(_verdict(found, task_titles) if found else ""))
        rows.append(row)
    heads = [
        ColumnHead(task.title if task.counted else f"({task.title})", task.main) for task in tasks
    ]
    metrics = gate.left_out(results)
    unjudged = ", ".join(
        f"{t.title} ({metrics[t.name]})" for t in results.tasks if t.name in metrics
    )
    more = (
        f" Not judged, since the main metric is not a sum over clips: {unjudged}."
        if unjudged
        else ""
    )
    # a gate that lacks a baseline says nothing about passing
    rule = f" The release gate needs {', '.join(absent)} too." if absent else _PASSES
    return Table(
        name="gate",
        title=f"{GATE if not absent else BESIDE}: {results.suite}",
        caption=_CAPTION + rule + more,
        head=[
            ColumnHead("Model"),
            ColumnHead("tokens"),
            *heads,
            ColumnHead("Mean"),
            *([] if absent else [ColumnHead("passes")]),
        ],
        rows=rows,
    )


def _absent(gate_rows: Sequence[GateRow]) -> list[str]:
    """What the release gate compares with and this bench did not run, in words."""
    means = [row for row in gate_rows if row.task == MEAN]
    ran = {name for row in means for name in row.above}
    lacks = [words for name, words in COMPARED.items() if name not in ran]
    return lacks if means else ["a second task that counts"]


def _verdict(found: Mapping[str, Any], titles: Mapping[str, str]) -> str:
    """Whether a model passes the suite with some features, or why not.

    Args:
        found: Outcome with these features; see `gate.gate_outcome`.
        titles: Titles of tasks, by name.
    """
    level = [words for name, words in COMPARED.items() if name not in found["mean_above"]]
    below = [titles[name] for name in found["below_random"]]
    faults = [f"not above {', '.join(level)}"] if level else []
    carried = [COMPARED[name] for name in found["carried_by_one"]]
    faults += [f"one task carries the lead over {', '.join(carried)}"] if carried else []
    faults += [f"below random weights: {', '.join(below)}"] if below else []
    return "; ".join(faults) or "yes"


def _entry(row: GateRow | None) -> TableEntry:
    if row is None:
        return TableEntry("not run", tone="soft")
    against = COMPARED if row.task == MEAN else gate.AGAINST
    leads = [(name, row.above[name]) for name in against if name in row.above]
    below = [
        f"{name[0]} {fixed(lead.value, 3, signed=True)} (> {fixed(lead.low, 2, signed=True)})"
        for name, lead in leads
    ]
    lost = any(row.above[name].high < 0 for name in gate.AGAINST if name in row.above)
    sign = " ▲" if row.beats else " ▼" if lost else ""
    score = row.score
    text = f"{fixed(score.value, 3)} [{fixed(score.low, 2)}, {fixed(score.high, 2)}]{sign}"
    return TableEntry(
        text, below=", ".join(below), tone="good" if row.beats else "bad" if lost else ""
    )
