"""The page of a bench: its tables and pictures in one HTML file."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from markupsafe import Markup

from tactileforge.pages import (
    Section,
    bars_figure,
    details,
    facts,
    html_page,
    joined,
    next_commands,
    panel,
    panels,
    paragraph,
    preformatted,
    verdict,
)
from tactileforge_bench.output import comparison_tables, published, setting_tables
from tactileforge_bench.output.figure_sections import draw_figures
from tactileforge_bench.output.grid import ColumnHead, Table, TableEntry
from tactileforge_bench.output.published import PublishedScore
from tactileforge_bench.output.render import render_html
from tactileforge_bench.results.intervals import difference_interval
from tactileforge_bench.results.results import Results
from tactileforge_bench.results.scores import Scores, edge_rates, titles

#: Largest number of tasks drawn as bars.
_DRAWN = 12


def bench_page(
    folder: Path,
    results: Results,
    scores: Scores,
    rows: Sequence[PublishedScore],
    gate: Table | None = None,
) -> str:
    """The whole page.

    Args:
        folder: Folder of the predictions.
        results: Results of the bench.
        scores: The same, by task and model.
        rows: Published numbers.
        gate: The release gate, where it was measured.
    """
    grid = comparison_tables.main_table(results, scores)
    body = render_html(grid) if grid else paragraph("There is no model, or no task.")
    body = _bars(results, scores) + body
    parts = [Section("models", "Models", body)]
    for name, title, grid in (
        ("gate", gate.title.partition(":")[0] if gate else "", gate),
        ("ablation", "Ablations", comparison_tables.ablation_table(results, scores)),
        ("setting", "Settings", setting_tables.settings_table(results, scores)),
    ):
        if grid:
            parts.append(Section(name, title, render_html(grid)))
    parts += draw_figures(folder, results, scores)
    body = paragraph("Every metric of each task, in the setting of the main table.")
    for task in results.tasks:
        grid = setting_tables.details_table(results, scores, task)
        body += details(task.title, render_html(grid) if grid else paragraph("There is no model."))
    parts.append(Section("details", "All metrics", body))
    # numbers of others, apart from ours: they may come from another split or epoch
    theirs = Markup()
    for beside in published.beside_tables(results, scores, rows):
        theirs += render_html(beside, heading=True)
    if every := published.published_table(rows):
        theirs += details(f"{every.title}: all of the zoo", render_html(every))
    if theirs:
        parts.append(Section("theirs", "Published", theirs))
    parts += [_about(results), next_commands(_next(results))]
    return html_page(f"Touch encoders compared: {results.suite}", _top(results, scores), parts)


def _bars(results: Results, scores: Scores) -> Markup:
    """The main metric of each task as bars with intervals, of two models or more."""
    names, drawn = titles(results), []
    for task in results.tasks[:_DRAWN]:
        bars = [
            (names[model.name], interval.mean, interval.half)
            for model in comparison_tables.main_models(results)
            for score in scores.get((task.name, model.name), [])[:1]
            if (interval := score.interval())
        ]
        if len(bars) < 2:
            continue
        metric = task.metric()
        label = " ".join(filter(None, (metric.name, f"({metric.unit})" * bool(metric.unit))))
        drawn.append(panel(task.title, bars_figure(f"{label}, {metric.better} is better", bars)))
    if not drawn:
        return Markup()
    note = "Bars are means over the seeds, lines their intervals of 95 %; one seed has none."
    return paragraph(note, soft=True) + panels(drawn, wide=True)


def _next(results: Results) -> list[tuple[str, str]]:
    """Next commands after a bench."""
    model = results.models[0].name if results.models else "MODEL"
    data = " classes.root=DIR classes.sensor=NAME" * (results.suite == "classes")
    return [
        (
            f"tactileforge bench suite={results.suite}{data} 'model=[{model},run:RUN]'",
            "compare another model, or a run of yours, in the same way",
        ),
        (f"tactileforge zoo show {model}", "what a model learned from, its licence and its limits"),
        (
            f"tactileforge export model={model} format=onnx",
            "one file that runs without this package; head=heads/FILE puts the classes of a task "
            "into it",
        ),
    ]


def _top(results: Results, scores: Scores) -> Markup:
    seeds = sorted({cell.seed for cell in results.cells})
    about = {
        "Suite": results.suite,
        "Models": str(len(results.models)),
        "Tasks": str(len(results.tasks)),
        "Probes trained": str(len(results.cells)),
        "Seeds": ", ".join(map(str, seeds)) or "none",
        "Versions": ", ".join(
            f"{key} {results.versions[key]}"
            for key in ("tactileforge", "torch")
            if key in results.versions
        ),
    }
    every = len(results.tasks) * len(results.models)
    count = sum(
        (task.name, model.name) in scores for task in results.tasks for model in results.models
    )
    ran = "bad", f"{every - count} of {every} pairs of a model and a task were not run; see below."
    # a pair may have numbers and yet be listed: one of its seeds or metrics was not run
    if count == every and not results.not_run:
        ran = "good", f"All {every} pairs of a model and a task were run."
    return facts(about) + verdict([*_leaders(results, scores), ran, *_warnings(results, scores)])


def _leaders(results: Results, scores: Scores) -> list[tuple[str, str]]:
    """Best models by task, and the tasks with a lead beyond the interval."""
    first: dict[str, list[str]] = {}
    clear = compared = 0
    for task in results.tasks:
        known = [
            (interval, model.name)
            for model in comparison_tables.main_models(results)
            for score in scores.get((task.name, model.name), [])[:1]
            if (interval := score.interval())
        ]
        # of one model there is no best
        if len(known) < 2:
            continue
        compared += 1
        known.sort(key=lambda row: row[0].mean, reverse=task.metric().better == "higher")
        first.setdefault(known[0][1], []).append(task.title)
        gap = difference_interval(known[0][0], known[1][0])
        clear += abs(gap.mean) > gap.half
    if not compared:
        return [("plain", "No task has numbers of two models: there is nothing to compare.")]
    names = titles(results)
    order = sorted(first, key=lambda name: -len(first[name]))
    told = "; ".join(f"{names[name]} in {len(first[name])} of {compared}" for name in order)
    text = f"Best mean by task: {told}. Ahead of the second beyond the interval in {clear}."
    return [("plain", text)]


def _warnings(results: Results, scores: Scores) -> list[tuple[str, str]]:
    lines = []
    test = [task.title for task in results.tasks if task.selection == "test"]
    if test:
        text = f"The epoch was chosen on the test set, so numbers are optimistic: {', '.join(test)}"
        lines.append(("bad", f"{text}."))
    single = sum(len(some[0].cells) == 1 for some in scores.values())
    if single:
        text = f"{single} of {len(scores)} numbers of the tables come from one seed: no interval."
        lines.append(("plain", text))
    bad = sum(
        (one := score.interval()) is None or len(one.values) < len(score.cells)
        for some in scores.values()
        for score in some
    )
    if bad:
        lines.append(("bad", f"{bad} probes gave no finite number in at least one seed."))
    return lines + [("plain", f"{hint}.") for hint in edge_rates(results, scores)]


def _about(results: Results) -> Section:
    body = joined(
        render_html(grid, heading=True) for grid in (_tasks(results), _models(results)) if grid
    )
    for title, values in (
        ("Settings of the bench", results.settings),
        ("Versions", results.versions),
    ):
        text = "\n".join(f"{key}: {_plain(value)}" for key, value in values.items())
        if text:
            body += details(title, preformatted(text))
    return Section("about", "What was run", body)


def _tasks(results: Results) -> Table | None:
    if not results.tasks:
        return None
    head = map(ColumnHead, ("Task", "probe", "data", "split", "epoch chosen on"))
    rows = [
        [TableEntry(task.title), *map(_text, (task.probe, task.data, task.split, task.selection))]
        for task in results.tasks
    ]
    return Table("tasks", "Tasks", "As the suite defines them.", list(head), rows)


def _models(results: Results) -> Table | None:
    if not results.models:
        return None
    keys = list(dict.fromkeys(key for model in results.models for key in model.facts))
    names = titles(results)
    rows = [
        [
            TableEntry(names[model.name]),
            _text(model.name),
            _text(model.recipe),
            *(_known(_plain(model.facts.get(key))) for key in keys),
            _known(model.sha256[:12]),
        ]
        for model in results.models
    ]
    head = [ColumnHead(word) for word in ("Model", "name", "recipe", *keys, "SHA-256")]
    return Table("encoders", "Models", "First digits of the hash of the weights.", head, rows)


def _text(text: str) -> TableEntry:
    return TableEntry(text or "not known", tone="text")


def _known(text: str) -> TableEntry:
    return TableEntry(text) if text else TableEntry("not known", tone="soft")


def _plain(value: Any) -> str:
    if value is None:
        return ""
    if isinstance(value, str):
        return value
    if isinstance(value, int) and not isinstance(value, bool):
        return f"{value:,}" if abs(value) >= 10_000 else str(value)
    return json.dumps(value, ensure_ascii=False).replace('"', "").strip("[]")
