"""The page of a bench: one file, drawn from predictions, with words for missing pictures."""

import json
import re
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tactileforge_bench.output.charts import POINTS, confusion, correlation, rmse, scatter
from tactileforge_bench.output.write import write_all
from tactileforge_bench.results.predictions import read_predictions

from tactileforge.errors import ConfigError, DataError

METRICS = {
    "force": {"name": "rmse_sum_axes", "unit": "mN", "better": "lower"},
    "slip": {"name": "f1", "unit": "%", "better": "higher"},
}
VOID = {"meta", "wbr", "link", "br", "img", "path", "use", "rect", "circle"}


class Page(HTMLParser):
    """Tables by id, headings, attributes and visible text; every tag must be closed."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.tables: dict[str, list[list[str]]] = {}
        self.links: list[str] = []
        self.ids: list[str] = []
        self.text = ""
        self._open: list[str] = []
        self._rows: list[list[str]] = []
        self.feed(html)
        assert self._open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        content = dict(attrs)
        self.links += [v for k, v in attrs if k in ("href", "src", "xlink:href", "action") and v]
        self.ids += [content["id"]] if content.get("id") else []
        if tag not in VOID:
            self._open.append(tag)
        if tag == "table":
            self._rows = self.tables[str(content["id"])] = []
        elif tag == "tr":
            self._rows.append([])
        elif tag in ("td", "th"):
            self._rows[-1].append("")

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.handle_starttag(tag, attrs)
        if tag not in VOID:
            self._open.pop()

    def handle_endtag(self, tag: str) -> None:
        if tag not in VOID:
            assert self._open.pop() == tag

    def handle_data(self, data: str) -> None:
        if self._open and self._open[-1] == "style":
            return
        self.text += data
        if any(tag in ("td", "th") for tag in self._open):
            self._rows[-1][-1] += data


def bench(folder: Path, models: int = 2, tasks: int = 2, points: int = 60) -> dict[str, Any]:
    """A bench with forces in half of the tasks, and classes in the other."""
    (folder / "predictions").mkdir()
    rng = np.random.default_rng(0)
    names = [f"model_{i}" for i in range(models)]
    content: dict[str, Any] = {
        "format": 1, "suite": "<sim>", "versions": {"torch": "2"}, "settings": {"epochs": 3},
        "models": [
            {"name": name, "title": f"<{name}>", "group": "model", "recipe": "", "sha256": "",
             "facts": {"parameters": 123456}} for name in names
        ],
        "tasks": [], "cells": [], "not_run": [],
        "training": [
            {"model": names[0], "objective": "pixel", "step": [0, 10, 20],
             "train": [1.0, 0.5, None], "validation": [None, 0.6, None]}
        ],
    }  # fmt: skip
    for i in range(tasks):
        kind = ("force", "slip")[i % 2]
        name, metric = f"{kind}{i}", METRICS[kind]
        content["tasks"].append(
            {"name": name, "title": f"{kind} & {i}", "probe": "attentive", "data": "sim",
             "split": "by object", "metrics": [metric], "main": metric["name"],
             "selection": "validation"}
        )  # fmt: skip
        for model in names:
            path = f"predictions/{name}.{model}.0.npz"
            if kind == "force":
                truth = rng.normal(size=(points, 3)).astype(np.float32)
                arrays = {"truth": truth, "predicted": truth + 0.1, "axes": np.array(list("xyz"))}
            else:
                truth = rng.integers(0, 20, points)
                arrays = {"truth": truth, "predicted": rng.integers(0, 20, points)}
                arrays["names"] = np.array([f"class {c}" for c in range(20)])
            np.savez(folder / path, **arrays)
            content["cells"].append(
                {"task": name, "model": model, "seed": 0, "setting": {}, "epoch": None,
                 "metrics": {metric["name"]: 300.0}, "curve": {}, "predictions": path}
            )  # fmt: skip
    return content


def page(folder: Path, content: dict[str, Any]) -> tuple[Page, str]:
    (folder / "results.json").write_text(json.dumps(content))
    html = write_all(folder)[-1].read_text()
    return Page(html), html


@pytest.mark.slow
def test_the_page_is_one_file_with_every_table_and_picture(tmp_path: Path) -> None:
    content = bench(tmp_path)
    content["tasks"][0]["title"] = "Cloth, GelSight"  # its published numbers stand beside ours
    parsed, html = page(tmp_path, content)
    assert not [link for link in parsed.links if not link.startswith(("#", "data:"))]
    assert not re.findall(r"url\((?!#)|@import|<script", html)
    assert len(parsed.ids) == len(set(parsed.ids))
    assert set(re.findall(r"url\(#([^)]+)\)", html)) <= set(parsed.ids)
    assert {"main", "details-force0", "details-slip1", "published", "encoders"} <= set(
        parsed.tables
    )
    assert all(cell for rows in parsed.tables.values() for row in rows for cell in row)
    assert parsed.tables["main"][1] == ["<model_0>", "300.0", "300.0", "1"]
    assert html.count("<svg role") == 2 + 2 * 3 + 2 + 1  # bars, forces, confusions, a loss
    assert parsed.text.count("RMSE 100 mN") == 6
    assert parsed.text.count("r 1.00") == 6
    assert "true x (N)" in parsed.text
    assert "All 4 pairs of a model and a task were run." in parsed.text


@pytest.mark.slow
def test_losses_of_probes_are_drawn_where_they_are_known(tmp_path: Path) -> None:
    content = bench(tmp_path)
    _, before = page(tmp_path, content)
    assert "Of the probes, by epoch" not in before
    content["cells"][0]["curve"] = {"train": [0.4, 0.2, 0.1], "validation": [0.5, None, 0.3]}
    content["cells"][1]["curve"] = {"train": [None, None], "validation": []}
    parsed, html = page(tmp_path, content)
    assert html.count("<svg role") == before.count("<svg role") + 1
    assert "no loss is a finite number" in parsed.text
    assert "loss over epochs" in html
    assert parsed.text.index("Of the probes, by epoch") > parsed.text.index("a panel an objective")
    content["cells"][0]["curve"] = {"train": "falling"}
    with pytest.raises(ConfigError, match="curve is"):
        page(tmp_path, content)


def test_what_was_not_run_is_told(tmp_path: Path) -> None:
    content = bench(tmp_path)
    content["cells"] = content["cells"][:1]
    content["not_run"] = [
        {"task": "slip1", "model": None, "reason": "the data is absent", "fix": "download <it>"},
        {"task": "cloth", "model": None, "reason": "one class", "fix": ""},
    ]
    parsed, _ = page(tmp_path, content)
    assert parsed.tables["main"][1:] == [
        ["<model_0>", "300.0", "not runb", "1"],
        ["<model_1>", "not runa", "not runb", "none"],
    ]
    assert "The data is absent. Download <it>." in parsed.text
    assert "Task cloth was not run. One class." in parsed.text
    assert "3 of 4 pairs of a model and a task were not run" in parsed.text


@pytest.mark.slow
def test_predictions_that_are_gone_or_not_finite_are_told(tmp_path: Path) -> None:
    content = bench(tmp_path)
    (tmp_path / content["cells"][0]["predictions"]).unlink()
    (tmp_path / content["cells"][2]["predictions"]).write_bytes(b"PK no zip")
    truth = np.ones((4, 3))
    predicted = np.array([[np.nan, 1, 1]] * 3 + [[np.nan, np.inf, 1]])
    np.savez(tmp_path / content["cells"][1]["predictions"], truth=truth, predicted=predicted)
    parsed, html = page(tmp_path, content)
    assert parsed.text.count("no picture.") == 2
    assert "no prediction is a finite number" in parsed.text
    assert "1 of 4 predictions are no finite number" in parsed.text
    assert html.count("<svg role") == 2 + 2 + 1 + 1  # with the bars


@pytest.mark.slow
def test_fifteen_models_in_six_tasks_stay_below_five_megabytes(tmp_path: Path) -> None:
    """By the size of one picture of each kind, with the largest number of points."""
    _, html = page(tmp_path, bench(tmp_path, models=1, points=1000))
    pictures = re.findall(r"<svg role.*?</svg>", html, re.S)
    force, classes = sum(map(len, pictures[:3])), len(pictures[3])
    assert 15 * 3 * (force + classes) + 15 * 5 * len(pictures[4]) < 4_500_000


def test_scatter_draws_at_most_so_many_points_and_keeps_them_inside() -> None:
    rng = np.random.default_rng(0)
    truth = rng.normal(size=5000)
    drawing = scatter(truth, 100 * truth, "x", (-1.0, 1.0))
    dots = max(re.findall(r'd="([^"]+)"', drawing), key=len)
    assert dots.count("M") == POINTS
    box = [float(v) for v in re.search(r'viewBox="([^"]+)"', drawing)[1].split()]  # type: ignore[index]
    numbers = [float(v) for v in re.findall(r"[\d.]+", dots)]
    assert min(numbers) >= 0
    assert max(numbers) <= max(box)
    assert f"RMSE {1000 * 99 * np.sqrt((truth**2).mean()):.0f} mN" in drawing
    plain = scatter(truth, truth + 0.5, "x", (-1.0, 1.0), "")
    assert "RMSE 0.5<" in plain
    assert ">true x<" in plain
    assert "RMSE 0.5 mm" in scatter(truth, truth + 0.5, "x", (-1.0, 1.0), "mm")


def test_error_and_correlation_in_closed_form() -> None:
    truth = np.array([0.0, 1.0, 2.0, 3.0])
    assert rmse(truth, truth + np.array([1, -1, 1, -1])) == 1
    assert correlation(truth, 5 - 2 * truth) == pytest.approx(-1)
    assert np.isnan(correlation(truth, np.ones(4)))


def test_confusion_counts_true_classes_in_rows() -> None:
    truth, predicted = np.array([0, 0, 0, 0, 1]), np.array([0, 0, 0, 1, 1])
    drawing, counts = confusion(truth, predicted, ["none", "slip", "never"])
    assert counts.tolist() == [[3, 1, 0], [0, 1, 0], [0, 0, 0]]
    texts = re.findall(r"<text[^>]*>([^<]*)</text>", drawing)
    assert {"75", "25", "100", "none (4)", "slip (1)", "never (0)"} <= set(texts)
    twenty = [f"a class with name {i}" for i in range(20)]
    drawing, _ = confusion(np.arange(20), np.arange(20), twenty)
    assert drawing.count(">100<") == 20
    assert "a class with …" in drawing


@pytest.mark.parametrize(
    ("arrays", "words"),
    [
        ({"truth": np.ones((2, 3))}, "'predicted' is missing"),
        ({"truth": np.ones((2, 3)), "predicted": np.ones((2, 2))}, r"\(2, 3\) and \(2, 2\)"),
        ({"truth": np.ones((0, 3)), "predicted": np.ones((0, 3))}, "not both"),
        (
            {"truth": np.array([0]), "predicted": np.array([2]), "names": np.array(["a", "b"])},
            "classes are not whole numbers from 0 to 1",
        ),
        (
            {"truth": np.ones((2, 3)), "predicted": np.ones((2, 3)), "axes": np.array(["x"])},
            "names 1 columns of 3",
        ),
    ],
)
def test_broken_predictions_name_the_array(tmp_path: Path, arrays: Any, words: str) -> None:
    np.savez(tmp_path / "p.npz", **arrays)
    with pytest.raises(DataError, match=words):
        read_predictions(tmp_path / "p.npz")


def test_several_classifiers_of_one_task_are_read(tmp_path: Path) -> None:
    truth = np.array([[0, 1, 2], [2, 1, 0]])
    names = np.array(["-", "0", "+"])
    np.savez(tmp_path / "p.npz", truth=truth, predicted=truth, names=names)
    parsed = read_predictions(tmp_path / "p.npz")
    assert parsed.columns == ("x", "y", "z")
    assert parsed.names == ("-", "0", "+")
    assert parsed.truth.tolist() == truth.tolist()
