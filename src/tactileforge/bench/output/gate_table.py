"""The release gate as a table, and as a file."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

from tactileforge.bench.output.grid import Entry, Grid, Head, fixed
from tactileforge.bench.results import gate
from tactileforge.bench.results.gate import Row, Score
from tactileforge.bench.results.results import Results
from tactileforge.bench.results.scores import titles
from tactileforge.files import write_text

_CAPTION = (
    "Closed-form probes; accuracies as shares. In brackets the 95 % interval (bootstrap over "
    "recordings or objects). Below, what it is above random weights of its architecture (r) and "
    "above 16 x 16 pixels (p), paired, with the lower end of the interval. ▲ above both beyond the "
    "interval; ▼ below one of them beyond it."
)


def write(folder: Path, results: Results) -> list[Row]:
    """Writes ``gate.json``, unless no probe is in closed form."""
    rows = gate.rows(folder, results)
    if rows:
        plain = gate.plain(rows, results)
        write_text(folder / gate.FILE, json.dumps(plain, indent=1, allow_nan=False) + "\n")
    return rows


def grid(gate_rows: Sequence[Row], results: Results) -> Grid | None:
    """The table of the release gate; None if it is empty."""
    if not gate_rows:
        return None
    names = titles(results)
    keys = list(dict.fromkeys((row.model, row.reading) for row in gate_rows))
    known = {(row.model, row.reading, row.task): row for row in gate_rows}
    rows = []
    for model, reading in keys:
        cells = [known.get((model, reading, task.name)) for task in results.tasks]
        entries = [_entry(row) if row else Entry("not run", tone="soft") for row in cells]
        rows.append([Entry(names[model]), Entry(reading), *entries, Entry(_won(cells))])
    heads = [Head(task.title, task.main) for task in results.tasks]
    return Grid(
        name="gate",
        title=f"Release gate: {results.suite}",
        caption=_CAPTION,
        head=[Head("Model"), Head("tokens"), *heads, Head("won")],
        rows=rows,
    )


def _entry(row: Row) -> Entry:
    below = [f"{name[0]} {_signed(row.above[name])}" for name in gate.AGAINST if name in row.above]
    lost = any(row.above[name].high < 0 for name in gate.AGAINST if name in row.above)
    sign = " ▲" if row.beats else " ▼" if lost else ""
    score = row.score
    text = f"{fixed(score.value, 3)} [{fixed(score.low, 2)}, {fixed(score.high, 2)}]{sign}"
    return Entry(text, below=", ".join(below), tone="good" if row.beats else "bad" if lost else "")


def _signed(score: Score) -> str:
    return f"{fixed(score.value, 3, signed=True)} (> {fixed(score.low, 2, signed=True)})"


def _won(rows: Sequence[Row | None]) -> str:
    measured = [row for row in rows if row and row.above]
    return f"{sum(row.beats for row in measured)} of {len(measured)}" if measured else "none"
