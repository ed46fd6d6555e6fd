"""Writes the results of a benchmark: tables as Markdown and LaTeX, a CSV file, and a page.

A number is the mean over seeds with its 95 % interval. What was not run says so, and why.
"""

from __future__ import annotations

from pathlib import Path

from tactileforge.plugins import write_text
from tactileforge_bench.output import (
    comparison_tables,
    gate_table,
    published,
    render,
    setting_tables,
)
from tactileforge_bench.output.csv_export import long_form
from tactileforge_bench.output.grid import Table
from tactileforge_bench.output.published import PublishedScore
from tactileforge_bench.output.report import bench_page
from tactileforge_bench.results.load import read_results
from tactileforge_bench.results.results import Results
from tactileforge_bench.results.scores import Scores, collect_scores

_LATEX_HEAD = "% Needs \\usepackage{booktabs,amssymb} and \\usepackage[T1]{fontenc}.\n"


def write_all(folder: Path) -> list[Path]:
    """Writes ``table.md``, ``table.tex``, ``table.csv``, ``report.html``, and ``gate.json``.

    Each is written whole, or not at all; the last only where probes are in closed form.

    Args:
        folder: With ``results.json`` and ``predictions/``; of a bench that has ended or not.

    Returns:
        The files.

    Raises:
        DataNotFoundError: There is no ``results.json``.
        DataError: It contradicts itself.
        ConfigError: A key of it is missing, unknown or of another type.
    """
    results = read_results(folder)
    all_scores = collect_scores(results)
    rows = published.published_beside(results)
    gate = gate_table.gate_table(gate_table.write_gate(folder, results), results)
    grids = tables(results, all_scores, rows, gate)
    texts = {
        "table.md": "\n".join(map(render.render_markdown, grids)),
        "table.tex": _LATEX_HEAD + "\n".join(map(render.render_latex, grids)),
        "table.csv": long_form(results, all_scores, rows),
        "report.html": bench_page(folder, results, all_scores, rows, gate),
    }
    for name, text in texts.items():
        write_text(folder / name, text)
    return [folder / name for name in texts]


def tables(
    results: Results, all_scores: Scores, rows: list[PublishedScore], gate: Table | None = None
) -> list[Table]:
    """All tables with content, measured numbers first."""
    # in the order of the files: what decides comes first, numbers of others last
    grids = [
        gate,
        comparison_tables.main_table(results, all_scores),
        comparison_tables.ablation_table(results, all_scores),
        setting_tables.settings_table(results, all_scores),
        *published.beside_tables(results, all_scores, rows),
        published.published_table(rows),
    ]
    return [grid for grid in grids if grid]
