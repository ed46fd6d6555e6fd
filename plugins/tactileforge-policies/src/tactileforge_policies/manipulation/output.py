"""The table of manipulation: success with its interval, and paired differences."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from tactileforge_bench.output.grid import ColumnHead, Notes, Table, TableEntry, Tone
from tactileforge_bench.output.render import render_html, render_markdown
from tactileforge_bench.results.bootstrap import GroupedScore, ScoreInterval, compared

from tactileforge.pages import MINUS, Section, html_page, paragraph
from tactileforge.plugins import commit, write_text
from tactileforge_policies.manipulation.paired import paired_difference
from tactileforge_policies.manipulation.plan import Plan, Setting
from tactileforge_policies.manipulation.run import CellResult
from tactileforge_policies.rollouts.results import wilson

_SIMULATED = (
    "Success in a simulation says how policies compare with each other in it; it is no proof for a "
    "robot."
)
_SUCCESS = (
    "Share of rollouts that succeed, in percent, with its 95 % interval: of one training, Wilson; "
    "of several, bootstrap over starts and trainings. Starts and physics are the same for all rows."
)
_PAIRED = (
    "Difference of the success to that of {title}, in percent, with its 95 % interval: of one "
    "training, by score (Newcombe, 1998, method 10), starts paired; of several, bootstrap over "
    "starts, paired, and over trainings. Filled where the interval leaves 0 out."
)


def tally(result: CellResult) -> GroupedScore:
    """Groups success by start, for the bootstrap of the release gate."""
    groups = tuple(str(episode.seed) for episode in result.episodes)
    top = np.array([[float(episode.success)] for episode in result.episodes])
    return GroupedScore(groups, top, np.ones_like(top), 0.0, 1.0)


def difference(ours: Sequence[CellResult], theirs: Sequence[CellResult]) -> ScoreInterval:
    """Difference of two policies' success, for the same starts.

    For one training each, the interval is by score; for several, by the bootstrap, as it covers
    their spread. Where all pairs agree, the bootstrap has no width, and the interval is that of the
    first trainings, by score.
    """
    score = compared([tally(cell) for cell in ours], [tally(cell) for cell in theirs])
    several = len(ours) > 1 or len(theirs) > 1
    if several and score.low < score.high:
        return score
    first = [[episode.success for episode in cells[0].episodes] for cells in (ours, theirs)]
    return paired_difference(*first)


class Outcome:
    """Results of a plan, by policy and setting.

    Args:
        plan: The plan.
        results: Results of its cells.
    """

    def __init__(self, plan: Plan, results: Sequence[CellResult]) -> None:
        self.plan = plan
        self.results = results

    def of(self, policy: str, setting: Setting) -> list[CellResult]:
        """Completed cells of all trainings of a policy."""
        return [
            result
            for result in self.results
            if result.episodes and (result.cell.policy, result.cell.setting) == (policy, setting)
        ]

    def reasons(self, policy: str, setting: Setting) -> list[str]:
        """Reasons of the skipped cells."""
        return [
            result.reason
            for result in self.results
            if result.reason and (result.cell.policy, result.cell.setting) == (policy, setting)
        ]


def write_outputs(plan: Plan, results: Sequence[CellResult]) -> list[Path]:
    """Writes ``results.json``, ``table.md`` and ``report.html``.

    Args:
        plan: The plan.
        results: Results of its cells.

    Returns:
        Paths of the files.
    """
    outcome = Outcome(plan, results)
    tables = [success_table(outcome), *difference_tables(outcome)]
    texts = {
        "results.json": json.dumps(_plain(outcome), indent=1),
        "table.md": f"{_SIMULATED}\n\n" + "\n".join(map(render_markdown, tables)),
        "report.html": _page(outcome, tables),
    }
    for name, text in texts.items():
        write_text(plan.folder / name, text)
    return [plan.folder / name for name in texts]


def success_table(outcome: Outcome) -> Table:
    """Table of success, policies by settings."""
    notes, settings = Notes(), outcome.plan.settings
    rows = [
        [
            TableEntry(row.title),
            *(_success(outcome, name, setting, notes) for setting in settings),
        ]
        for name, row in outcome.plan.policies.items()
    ]
    head = [ColumnHead("Policy"), *(ColumnHead(setting.title) for setting in settings)]
    return Table("success", "Success", _SUCCESS, head, rows, notes.items())


def _success(outcome: Outcome, name: str, setting: Setting, notes: Notes) -> TableEntry:
    marks = tuple(map(notes.letter, outcome.reasons(name, setting)))
    found = outcome.of(name, setting)
    if not found:
        return TableEntry("not run", marks=marks, tone="soft")
    count = sum(len(cell.episodes) for cell in found)
    successes = sum(cell.summary.successes for cell in found)
    low, high = _interval(found)
    return TableEntry(
        f"{100 * successes / count:.0f}", marks=marks, below=f"{100 * low:.0f} to {100 * high:.0f}"
    )


def _interval(found: Sequence[CellResult]) -> tuple[float, float]:
    """Interval of the success, by the method of `difference`, as trainings share their starts."""
    if len(found) > 1:
        score = compared([tally(cell) for cell in found])
        if score.low < score.high:
            return score.low, score.high
    return wilson(found[0].summary.successes, len(found[0].episodes))


def difference_tables(outcome: Outcome) -> list[Table]:
    """One table for each reference row (``against``)."""
    return [
        _differences(outcome, other)
        for other in outcome.plan.options.against
        if other in outcome.plan.policies and len(outcome.plan.policies) > 1
    ]


def _differences(outcome: Outcome, other: str) -> Table:
    plan, settings = outcome.plan, outcome.plan.settings
    title = plan.policies[other].title
    rows = [
        [TableEntry(row.title), *(_difference(outcome, name, other, s) for s in settings)]
        for name, row in plan.policies.items()
        if name != other
    ]
    head = [ColumnHead("Policy"), *(ColumnHead(setting.title) for setting in settings)]
    return Table(
        f"above-{other}", f"Compared with {title}", _PAIRED.format(title=title), head, rows
    )


def _difference(outcome: Outcome, name: str, other: str, setting: Setting) -> TableEntry:
    ours, theirs = outcome.of(name, setting), outcome.of(other, setting)
    if not ours or not theirs:
        return TableEntry("not run", tone="soft")
    score = difference(ours, theirs)
    value, low, high = (_percent(number) for number in (score.value, score.low, score.high))
    tone: Tone = "good" if score.low > 0 else "bad" if score.high < 0 else ""
    mark = {"good": " ▲", "bad": " ▼"}.get(tone, "")
    return TableEntry(f"{value}{mark}", tone=tone, below=f"{low} to {high}")


def _percent(share: float) -> str:
    return f"{100 * share + 0.0:+.0f}".replace("-", MINUS)


def _plain(outcome: Outcome) -> dict[str, Any]:
    plan = outcome.plan
    return {
        "commit": commit(),
        "options": json.loads(json.dumps(asdict(plan.options))),
        "cells": [_cell(result) for result in outcome.results],
        "differences": [
            {"policy": name, "against": other, "setting": asdict(setting)}
            | asdict(difference(outcome.of(name, setting), outcome.of(other, setting)))
            for other in plan.options.against
            for name in plan.policies
            for setting in plan.settings
            if name != other and outcome.of(name, setting) and outcome.of(other, setting)
        ],
    }


def _cell(result: CellResult) -> dict[str, Any]:
    cell = result.cell
    about = {"policy": cell.policy, "seed": cell.seed, "setting": asdict(cell.setting)}
    if not result.episodes:
        return about | {"not_run": result.reason}
    succeeded = [episode.seed for episode in result.episodes if episode.success]
    return about | asdict(result.summary) | {"succeeded": succeeded}


def _page(outcome: Outcome, tables: Sequence[Table]) -> str:
    plan = outcome.plan
    sections = [Section(grid.name, grid.title, render_html(grid)) for grid in tables]
    return html_page(
        "Policies compared", paragraph(plan.told()) + paragraph(_SIMULATED, soft=True), sections
    )
