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

_CAPTION = (
    "Closed-form probes; accuracies as shares. In brackets the 95 % interval (bootstrap over "
    "recordings or objects). Below, what it is above random weights of its architecture (r) and "
    "above 16 x 16 pixels (p), paired, with the lower end of the interval; in the mean also above "
    "picture statistics (s) and a network of photographs, read best (i). ▲ above the first two "
    "beyond the interval; ▼ below one of them beyond it. Tasks in brackets do not count. A model "
    "passes whose mean is above all four beyond the interval, in value without any one task too, "
    "with no task below random weights."
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
    rows = []
    for model, reading in keys:
        # None where the model was not run on a task
        cells = [known.get((model, reading, task.name)) for task in tasks]
        mean = known.get((model, reading, MEAN))
        entries = [_entry(row) for row in (*cells, mean)]
        found = outcomes.get(model, {}).get(reading)
        verdict = _verdict(found, task_titles) if found else ""
        rows.append([TableEntry(names[model]), TableEntry(reading), *entries, TableEntry(verdict)])
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
    return Table(
        name="gate",
        title=f"Release gate: {results.suite}",
        caption=_CAPTION + more,
        head=[
            ColumnHead("Model"),
            ColumnHead("tokens"),
            *heads,
            ColumnHead("Mean"),
            ColumnHead("passes"),
        ],
        rows=rows,
    )


def _verdict(found: Mapping[str, Any], titles: Mapping[str, str]) -> str:
    """Whether a model passes the suite with some features, or why not.

    Args:
        found: Outcome with these features; see `gate.gate_outcome`.
        titles: Titles of tasks, by name.
    """
    level = [words for name, words in COMPARED.items() if name not in found["mean_above"]]
    below = [titles[name] for name in found["below_random"]]
    faults = [f"not above {', '.join(level)}"] if level else []
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
