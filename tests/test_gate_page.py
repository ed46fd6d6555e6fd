"""The page of the release gate, the README and the cards have the numbers of one file each."""

import re
from pathlib import Path

import gate_tables
import pytest

from tactileforge.hub import cards

ROOT = Path(__file__).parents[1]


def mean(suite: str, model: str, reading: str) -> dict:
    return gate_tables.rows_of(suite)[model, reading, "mean"]


def test_the_page_has_the_tables_of_the_results() -> None:
    text = gate_tables.PAGE.read_text("utf-8")
    assert gate_tables.filled(text) == text, "run python benchmarks/gate_tables.py"
    assert text.count("| `anytouch2.tiny-real` | patches |") == 4


@pytest.mark.parametrize("model", gate_tables.MODELS)
def test_the_readme_has_them_too(model: str) -> None:
    _, weight = cards.find_card(model)
    lines = (ROOT / "README.md").read_text("utf-8").splitlines()
    line = next(line for line in lines if line.startswith(f"| `{model}` | "))
    means = [mean(suite, model, weight.reading) for suite in gate_tables.SUITES]
    real, held_out = (f"{row['value']:.2f}".removeprefix("0") for row in means)
    assert f"| {real}, held out {held_out} |" in line


@pytest.mark.parametrize("model", gate_tables.MODELS)
def test_cards_have_them_too(model: str) -> None:
    card, weight = cards.find_card(model)
    found = {
        (row.suite, row.tokens): row for row in card.measurements(weight) if row.metric == "mean"
    }
    assert len(found) == 8
    for (suite, reading), row in found.items():
        told = mean(suite, model, reading)
        assert row.value == told["value"]
        for name, key in (
            ("random weights", "random"),
            ("photographs with all that is free", "imagenet"),
        ):
            lead = told["above"][key]
            assert row.above[name] == [lead["value"], lead["low"], lead["high"]]
    best = max(gate_tables.READINGS, key=lambda reading: found["real", reading].value)
    assert weight.reading == best, "the reading is chosen on `real`"


def test_what_has_no_touch_is_told_beside_them() -> None:
    text = (ROOT / "README.md").read_text("utf-8")
    for words, name in (
        ("photographs (EfficientNet-Lite0)", "imagenet"),
        ("picture statistics", "statistics"),
        ("16 x 16 pixels", "pixels"),
    ):
        reading = "groups" if name == "imagenet" else "pooled"  # as the gate reads them
        pair = [mean(suite, name, reading)["value"] for suite in gate_tables.SUITES]
        values = " and ".join(f"{value:.2f}".removeprefix("0") for value in pair)
        assert re.search(rf"{re.escape(words)}\s{re.escape(values)}[,.]", re.sub(r"\s+", " ", text))
