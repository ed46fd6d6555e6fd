"""Numbers, marks and words of the tables, against hand-computed ones."""

import csv
import json
import math
import re
from pathlib import Path
from typing import Any

import pytest
from tactileforge_bench.output import comparison_tables, published, setting_tables
from tactileforge_bench.output.grid import (
    ColumnHead,
    Notes,
    Table,
    TableEntry,
    decimals,
    fixed,
    ranks,
)
from tactileforge_bench.output.published import PublishedScore
from tactileforge_bench.output.render import (
    latex_text,
    markdown_text,
    render_latex,
    render_markdown,
)
from tactileforge_bench.output.write import write_all
from tactileforge_bench.results.intervals import (
    Interval,
    difference_interval,
    mean_interval,
    student_t,
)
from tactileforge_bench.results.load import read_results
from tactileforge_bench.results.scores import collect_scores

from tactileforge.errors import ConfigError, DataError, DataNotFoundError

RMSE = {"name": "rmse_sum_axes", "unit": "mN", "better": "lower"}
ACCURACY = {"name": "accuracy", "unit": "%", "better": "higher"}


def task(name: str, metrics: list[dict[str, str]], **fields: Any) -> dict[str, Any]:
    content = {"name": name, "title": name.capitalize(), "probe": "attentive", "data": "sim"}
    content |= {"split": "by indenter", "metrics": metrics, "main": metrics[0]["name"]}
    return content | {"selection": "validation"} | fields


def model(name: str, **fields: Any) -> dict[str, Any]:
    content = {"name": name, "title": name.upper(), "group": "model", "recipe": name}
    return content | {"sha256": "", "facts": {}} | fields


def cells(task: str, model: str, metric: str, *values: Any, **fields: Any) -> list[dict[str, Any]]:
    return [
        {"task": task, "model": model, "seed": seed, "setting": {}, "metrics": {metric: value}}
        | {"epoch": seed, "curve": {}, "predictions": ""}
        | fields
        for seed, value in enumerate(values)
    ]


def results() -> dict[str, Any]:
    """Two models in two tasks, one ablation."""
    return {
        "format": 1,
        "suite": "sim",
        "versions": {"torch": "2"},
        "settings": {"seeds": 3},
        "tasks": [task("force", [RMSE]), task("action", [ACCURACY])],
        "models": [model("a"), model("b"), model("a2", group="ablation", recipe="a")],
        "cells": [
            *cells("force", "a", "rmse_sum_axes", 100.0, 110.0, 120.0),
            *cells("force", "b", "rmse_sum_axes", 150.0),
            *cells("force", "a2", "rmse_sum_axes", 170.0),
            *cells("action", "a", "accuracy", 80.0, 82.0, 84.0),
            *cells("action", "b", "accuracy", 90.0),
            *cells("action", "a2", "accuracy", 81.0),
        ],
        "training": [],
        "not_run": [],
    }


def write(folder: Path, content: dict[str, Any]) -> Path:
    (folder / "results.json").write_text(json.dumps(content))
    return folder


def main(folder: Path, content: dict[str, Any]) -> dict[str, list[TableEntry]]:
    loaded = read_results(write(folder, content))
    grid = comparison_tables.main_table(loaded, collect_scores(loaded))
    assert grid
    return {row[0].text: list(row[1:]) for row in grid.rows} | {
        f"note {mark}": [TableEntry(text)] for mark, text in grid.notes
    }


@pytest.mark.parametrize(
    ("freedom", "t"),  # printed tables of Student's t, two sides, 5 %
    [(1, 12.706), (2, 4.303), (3, 3.182), (4, 2.776), (9, 2.262), (30, 2.042), (120, 1.980)],
)
def test_students_t_is_that_of_the_printed_tables(freedom: int, t: float) -> None:
    assert student_t(freedom) == pytest.approx(t, abs=5e-4)


def test_interval_of_three_values_and_of_one() -> None:
    three = mean_interval([100.0, 110.0, 120.0])
    assert three.mean == 110
    assert three.half == pytest.approx(4.30265 * 10 / math.sqrt(3), rel=1e-5)  # deviation is 10
    assert math.isnan(mean_interval([5.0]).half)


def test_difference_is_the_two_sample_t_interval() -> None:
    a, b = mean_interval([1.0, 2.0, 3.0]), mean_interval([6.0, 8.0])
    pooled = (2 * 1 + 1 * 2) / 3
    loaded = difference_interval(a, b)
    assert loaded.mean == -5
    assert loaded.half == pytest.approx(3.182446 * math.sqrt(pooled * (1 / 3 + 1 / 2)), rel=1e-5)
    single = mean_interval([4.0])  # one value: the variance is that of the others
    assert difference_interval(single, a).half == pytest.approx(
        4.302653 * math.sqrt(1 + 1 / 3), rel=1e-5
    )
    assert math.isnan(difference_interval(single, single).half)


def test_best_and_second_best_by_direction_with_ties() -> None:
    assert ranks([3.0, 1.0, 2.0], "lower", 0) == ["", "best", "second"]
    assert ranks([3.0, 1.0, 2.0], "higher", 0) == ["best", "", "second"]
    assert ranks([1.04, 1.01, 2.0, None, 3.0], "lower", 1) == ["best", "best", "second", "", ""]
    assert ranks([1.0, None], "lower", 1) == ["", ""]
    assert ranks([1.0, 1.0], "higher", 1) == ["best", "best"]


def test_numbers_are_printed_with_four_digits_and_never_minus_zero() -> None:
    assert [decimals([v]) for v in (1051.03, 202.14, 42.31, 0.5, 0.0)] == [0, 1, 2, 3, 0]
    assert fixed(-0.001, 2) == "0.00"
    assert fixed(-1.25, 2) == "\N{MINUS SIGN}1.25"
    assert fixed(1.25, 2, signed=True) == "+1.25"


def test_footnotes_are_lettered_and_said_once() -> None:
    notes = Notes()
    letters = [notes.letter(f"text {i}") for i in range(28)]
    assert letters[0] == "a"
    assert letters[25:] == ["z", "aa", "ab"]
    assert notes.letter("text 1") == "b"


def test_main_table_has_means_intervals_marks_and_seeds(tmp_path: Path) -> None:
    rows = main(tmp_path, results())
    assert list(rows) == ["A", "B"]  # no ablation
    assert rows["A"] == [
        TableEntry("110.0 ± 24.8", "best"),
        TableEntry("82.00 ± 4.97", "second"),
        TableEntry("3"),
    ]
    assert rows["B"] == [
        TableEntry("150.0", "second"),
        TableEntry("90.00", "best"),
        TableEntry("1"),
    ]


def test_a_task_selected_on_test_has_its_mark_and_note(tmp_path: Path) -> None:
    content = results()
    content["tasks"][0]["selection"] = "test"
    rows = main(tmp_path, content)
    assert [entry.marks for entry in rows["A"]] == [("†",), (), ()]
    assert "test set" in rows["note †"][0].text
    write_all(tmp_path)
    assert "110.0 ± 24.8** (†)" in (tmp_path / "table.md").read_text()
    assert r"\textsuperscript{\dag{}}" in (tmp_path / "table.tex").read_text()


def test_every_cell_that_was_not_run_has_its_words(tmp_path: Path) -> None:
    content = results()
    content["cells"] = [c for c in content["cells"] if (c["task"], c["model"]) != ("force", "b")]
    content["cells"] = [c for c in content["cells"] if (c["task"], c["model"]) != ("action", "a")]
    content["not_run"] = [
        {"task": "force", "model": "b", "reason": "sensor is unknown", "fix": "use another"},
        {"task": None, "model": "c", "reason": "no such file", "fix": "train it"},
    ]
    rows = main(tmp_path, content)
    assert rows["B"][0] == TableEntry("not run", marks=("a",), tone="soft")
    assert rows["note a"][0].text == "Sensor is unknown. Use another."
    assert rows["A"][1].text == "not run"
    assert "has not come to it" in rows[f"note {rows['A'][1].marks[0]}"][0].text
    assert [entry.text for entry in rows["c"]] == ["not run", "not run", "none"]
    assert rows["A"][0].rank == ""  # alone in its column
    write_all(tmp_path)
    with (tmp_path / "table.csv").open() as file:
        lines = [row for row in csv.DictReader(file) if row["origin"] == "ours"]
    assert all(row["mean"] or row["note"].startswith("not run: ") for row in lines)
    assert sum(not row["mean"] for row in lines) == 4


def test_what_is_no_number_is_never_printed_as_one(tmp_path: Path) -> None:
    content = results()
    content["cells"] += cells("action", "b", "accuracy", 0, math.nan)[1:]
    content["cells"][3]["metrics"] = {"rmse_sum_axes": None}  # the only one of b in force
    rows = main(tmp_path, content)
    assert rows["B"][0].text == "no number"
    assert rows["B"][1].text == "90.00"
    notes = [rows[f"note {entry.marks[0]}"][0].text for entry in rows["B"][:2]]
    assert notes == ["1 of 1 seeds gave no finite number.", "1 of 2 seeds gave no finite number."]
    for path in write_all(tmp_path):
        assert "nan" not in path.read_text().lower()


def test_ablations_are_marked_where_they_are_beyond_the_interval(tmp_path: Path) -> None:
    loaded = read_results(write(tmp_path, results()))
    grid = comparison_tables.ablation_table(loaded, collect_scores(loaded))
    assert grid
    assert [row[0].text for row in grid.rows] == ["A", "A2"]
    force, action, _ = grid.rows[1][1:]
    # one against three of deviation 10 and 2: 4.303 * deviation * sqrt(4 / 3)
    assert (force.text, force.below, force.tone) == ("170.0", "+60.0 ± 49.7 ▼", "bad")
    assert (action.text, action.below, action.tone) == (
        "81.00",
        "\N{MINUS SIGN}1.00 ± 9.94 ▽",
        "",
    )
    assert force.line == "170.0 (+60.0 ± 49.7 ▼)"


@pytest.mark.parametrize(
    ("change", "half", "better", "sign"),
    [
        (2, 1, "lower", "▼"), (2, 3, "lower", "▽"), (-2, 1, "lower", "▲"), (-2, 3, "lower", "△"),
        (2, 1, "higher", "▲"), (-2, 1, "higher", "▼"), (-2, math.nan, "higher", "▽"),
        (0, 1, "lower", ""),
    ],
)  # fmt: skip
def test_signs_of_a_change(change: float, half: float, better: str, sign: str) -> None:
    assert comparison_tables.comparison_mark(Interval(change, half, ()), better)[0] == sign


def test_an_ablation_without_its_full_model_says_so(tmp_path: Path) -> None:
    content = results()
    content["models"][2]["recipe"] = "other"
    loaded = read_results(write(tmp_path, content))
    grid = comparison_tables.ablation_table(loaded, collect_scores(loaded))
    assert grid
    assert len(grid.rows) == 1
    assert grid.rows[0][1].marks == ("a",)
    assert "full model has no number" in dict(grid.notes)["a"]


def test_settings_are_ranked_model_by_model(tmp_path: Path) -> None:
    content = results()
    tried = {"lr": 0.1, "heads": 4}
    for cell in content["cells"][:3]:
        cell["setting"] = {"lr": 0.01, "heads": 4}
    content["cells"] += cells("force", "a", "rmse_sum_axes", 90.0, 91.0, setting=tried)
    loaded = read_results(write(tmp_path, content))
    grid = setting_tables.settings_table(loaded, collect_scores(loaded))
    assert grid
    rows = [[entry.text for entry in row] for row in grid.rows]
    assert rows == [["A", "lr=0.01", "110.0 ± 24.8"], ["A", "lr=0.1", "90.5 ± 6.4"]]
    assert [row[2].rank for row in grid.rows] == ["second", "best"]
    assert grid.rows[0][2].marks == ("a",)
    assert dict(grid.notes)["a"] == "The setting of the main table."
    assert main(tmp_path, content)["A"][0].text == "110.0 ± 24.8"


def test_details_hold_every_metric(tmp_path: Path) -> None:
    content = results()
    content["tasks"][1]["metrics"] = [ACCURACY, {"name": "f1", "unit": "", "better": "higher"}]
    for cell in content["cells"]:
        if cell["task"] == "action" and cell["model"] == "a":
            cell["metrics"]["f1"] = 0.5
    loaded = read_results(write(tmp_path, content))
    grid = setting_tables.details_table(loaded, collect_scores(loaded), loaded.tasks[1])
    assert grid
    assert [entry.text for entry in grid.rows[0]] == [
        "A", "82.00 ± 4.97", "0.500 ± 0.000", "3", "0, 1, 2",
    ]  # fmt: skip
    assert grid.rows[1][2].text == "no number"


def test_published_numbers_stay_apart_and_stand_beside_ours(tmp_path: Path) -> None:
    content = results()
    content["tasks"][0]["title"] = "Sparsh Bench force, DIGIT"
    rows = [
        PublishedScore("a", "Sparsh Bench force, DIGIT", "RMSE, sum of axes", 1.5, "mN", "paper"),
        PublishedScore("z", "Sparsh Bench force, DIGIT", "RMSE, sum of axes", 9.5, "mN", "paper"),
        PublishedScore("z", "Cloth", "accuracy", 42.0, "%", "paper"),
        PublishedScore("z", "Action", "accuracy", 42.0, "", "in another unit"),
    ]
    loaded = read_results(write(tmp_path, content))
    (beside,) = published.beside_tables(loaded, collect_scores(loaded), rows)
    assert [[entry.text for entry in row] for row in beside.rows] == [
        ["A", "110.0 ± 24.8", "1.5", "paper"],
        ["B", "150.0", "not published", "no source"],
        ["z", "not in this bench", "9.5", "paper"],
    ]
    assert main(tmp_path, content)["A"][0].rank == "best"  # 1.5 takes no part
    apart = published.published_table(rows)
    assert apart
    assert [entry.text for entry in apart.rows[1]] == ["Cloth: accuracy (%)", "not published", "42"]


def test_published_numbers_of_the_zoo_are_those_of_the_paper() -> None:
    loaded = {(row.model, row.task): row.value for row in published.published_scores()}
    assert loaded["anytouch2.base", "Sparsh Bench force, DIGIT"] == 624.26
    assert loaded["anytouch1.large", "Touch and Go material, GelSight"] == 80.82


def test_csv_has_one_number_a_row(tmp_path: Path) -> None:
    content = results()
    content["tasks"][0]["title"] = "Cloth, GelSight"
    write_all(write(tmp_path, content))
    with (tmp_path / "table.csv").open() as file:
        rows = list(csv.DictReader(file))
    ours = [row for row in rows if row["origin"] == "ours"]
    assert len(ours) == 6
    first = ours[0]
    assert (first["task"], first["model"], first["seeds"]) == ("force", "a", "3")
    assert float(first["mean"]) == 110
    assert float(first["high"]) - float(first["mean"]) == pytest.approx(24.841377)
    assert float(first["mean"]) - float(first["low"]) == pytest.approx(24.841377)
    assert ours[1]["low"] == ours[1]["high"] == ""
    assert ours[1]["note"] == "one seed: no interval"
    theirs = [row for row in rows if row["origin"] == "published"]
    cloth = [row for row in published.published_scores() if row.task == "Cloth, GelSight"]
    assert len(theirs) == len(cloth) > 5
    assert all(row["source"] for row in theirs)


def test_published_numbers_of_other_tasks_are_left_out(tmp_path: Path) -> None:
    write_all(write(tmp_path, results()))
    assert "ublished" not in (tmp_path / "table.md").read_text()


def test_markup_in_names_is_escaped() -> None:
    assert latex_text(r"50% of a_b & {c} #1 $2 ~x^2 \d") == (
        r"50\% of a\_b \& \{c\} \#1 \$2 \textasciitilde{}x\textasciicircum{}2 \textbackslash{}d"
    )
    assert latex_text("[a] *") == "{[}a] {*}"
    assert markdown_text("a|b\n*c* _d_ e_f <g>") == r"a\|b \*c\* \_d\_ e_f \<g>"
    rows = [
        [TableEntry("a_b|c"), TableEntry("1 ± 2", "best", ("†", "a"))],
        [TableEntry("d"), TableEntry("3", "second")],
    ]
    grid = Table(
        "x",
        "Title",
        "Caption",
        [ColumnHead("Model"), ColumnHead("T|1", "mN ↓")],
        rows,
        [("a", "x|y")],
    )
    tex, lines = render_latex(grid), render_markdown(grid).splitlines()
    assert r"a\_b\textbar{}c & \textbf{1 $\pm$ 2}\textsuperscript{\dag{},a} \\" in tex
    assert r"\shortstack{T\textbar{}1 \\ mN $\downarrow$}" in tex
    assert tex.index(r"\toprule") < tex.index(r"\midrule") < tex.index(r"\bottomrule")
    assert tex.isascii()
    table = [[part.strip() for part in re.split(r"(?<!\\)\|", line)[1:-1]] for line in lines[4:8]]
    assert table[0] == ["Model", r"T\|1, mN ↓"]
    assert [set(part) for part in table[1]] == [{"-"}, {"-", ":"}]
    assert table[2:] == [[r"a_b\|c", "**1 ± 2** (†) (a)"], ["d", "<ins>3</ins>"]]
    assert len({len(line) for line in lines[4:8]}) == 1  # aligned
    assert lines[-1] == r"- (a) x\|y"


def test_all_files_are_written_whole_and_again_the_same(tmp_path: Path) -> None:
    paths = write_all(write(tmp_path, results()))
    assert [path.name for path in paths] == ["table.md", "table.tex", "table.csv", "report.html"]
    before = [path.read_bytes() for path in paths]
    assert [path.read_bytes() for path in write_all(tmp_path)] == before
    assert not list(tmp_path.glob("*.part"))


GONE = object()


@pytest.mark.parametrize(
    ("place", "value", "words"),
    [
        (["tasks"], GONE, "'tasks' is missing"),
        (["suite"], GONE, "'suite' is missing"),
        (["format"], 2, "'format' is not 1"),
        (["extra"], 1, "'extra'"),
        (["tasks", 1, "title"], GONE, r"tasks\[1\]: 'title' is missing"),
        (["tasks", 0, "selection"], "best", r"tasks\[0\]: selection is 'best'"),
        (["tasks", 0, "main"], "rmse", "main metric 'rmse'.*Known: rmse_sum_axes"),
        (["tasks", 0, "metrics"], [RMSE | {"better": "up"}], r"metrics\[0\]: better is 'up'"),
        (["models", 0, "group"], "x", r"models\[0\]: group is 'x'"),
        (["models", 1, "name"], "a", "model 'a' appears 2 times"),
        (["cells", 2, "task"], "forse", r"cells\[2\]: task 'forse'; did you mean 'force'"),
        (["cells", 2, "model"], "q", r"cells\[2\]: model 'q'"),
        (["cells", 2, "metrics"], {"mse": 1.0}, r"cells\[2\]: metric 'mse'"),
        (["cells", 2, "metrics"], {"rmse_sum_axes": "x"}, "metrics.rmse_sum_axes is 'x'"),
        (["cells", 2, "seed"], "x", r"cells\[2\]: seed is 'x'"),
        (["cells", 2, "seed"], 1, "cell 'force, a, seed 1, {}' appears 2 times"),
        (["not_run"], [{"task": "force"}], r"not_run\[0\]: 'reason'"),
        (
            ["training"],
            [{"model": "a", "objective": "o", "step": [1], "train": []}],
            r"training\[0\]: train and validation need one value",
        ),
    ],
)
def test_broken_results_name_the_key(
    tmp_path: Path, place: list[Any], value: Any, words: str
) -> None:
    content = results()
    *way, last = place
    inner: Any = content
    for step in way:
        inner = inner[step]
    if value is GONE:
        del inner[last]
    else:
        inner[last] = value
    with pytest.raises((ConfigError, DataError), match=words):
        read_results(write(tmp_path, content))


def test_no_results_or_no_json(tmp_path: Path) -> None:
    with pytest.raises(DataNotFoundError, match=r"no results\.json there"):
        read_results(tmp_path)
    (tmp_path / "results.json").write_text("{")
    with pytest.raises(DataError, match="not JSON"):
        read_results(tmp_path)
