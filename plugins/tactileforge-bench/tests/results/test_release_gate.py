"""The release gate on cards: models to ship, and their rows."""

import hashlib
import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from tactileforge_bench.results.release_gate import (
    COMPARED,
    MEAN,
    SUITES,
    gate_faults,
    gate_passes,
    gate_verdict,
    may_ship,
    read_gate,
    stamp_card,
    write_gate,
)
from tactileforge_bench.verbs import zoo_gate

from tactileforge.cli import run
from tactileforge.errors import ConfigError, DataError, DataNotFoundError
from tactileforge.hub import Measurement, cards
from tactileforge.hub.table import measured_rows

SHA = "5a" * 32
CARD = """---
title: A model
licence: MIT
paper: "Something, arXiv 2600.00001"
code: https://example.org/code
sensors: [digit]
data: [simulated]
frames: 2
spacing: 0.1
weights:
  - tag: small
    file: weights/a.small.safetensors
    sha256: {sha}
    bytes: 1000
    licence: Apache-2.0{more}
results:
  - {{task: "A task", metric: "accuracy", value: 3, unit: "%", model: small, source: "docs/a.md"}}
---

# A model

It reads touch.

## `small`

{text}
"""


def card(more: str = "", text: str = "Trained for a day.") -> str:
    return CARD.format(sha=SHA, more=more, text=text)


def row(
    task: str, suite: str = "real", low: float = 0.05, tokens: str = "summary", **more
) -> Measurement:
    """A row with the same lead over everything but what is given."""
    lead = [low + 0.1, low, low + 0.2]
    above = {words: more.get(name, lead) for name, words in COMPARED.items()}
    metric = "mean" if task == MEAN else "r2"
    name = f"Task {task}: 'a', \"b\""
    return Measurement(
        model="small",
        suite=suite,
        task=name,
        tokens=tokens,
        metric=metric,
        value=0.5,
        chance=0.0,
        counted=more.get("counted", True),
        above=above,
    )


def with_lead(row: Measurement, name: str, lead: list[float]) -> Measurement:
    return replace(row, above=row.above | {COMPARED[name]: lead})


def rows(good: bool = True, tokens: str = "summary") -> list[Measurement]:
    """Two tasks and the mean of each suite; of bad weights the second mean is level."""
    low = 0.05 if good else -0.05
    return [
        row(task, suite, low if (task, suite) == (MEAN, SUITES[1]) else 0.05, tokens)
        for suite in SUITES
        for task in ("1", "2", MEAN)
    ]


def test_means_of_both_suites_have_to_be_above_everything() -> None:
    assert gate_passes(rows(), "summary")
    assert gate_verdict(rows(), "summary") == "passes with summary"
    words = "random weights, pixels, picture statistics, photographs with all that is free"
    fault = f"fails with summary: real_held_out not above {words}"
    assert gate_verdict(rows(good=False), "summary") == fault
    assert gate_verdict([], "summary") == "not measured"
    assert gate_faults(rows()[:3], "summary") == ["real_held_out not measured"]


@pytest.mark.parametrize("name", list(COMPARED))
def test_one_of_them_level_is_a_fault(name: str) -> None:
    level = [0.1, 0.0, 0.2]
    worse = [with_lead(x, name, level) if x.metric == MEAN else x for x in rows()]
    said = COMPARED[name]
    assert gate_faults(worse, "summary") == [f"{suite} not above {said}" for suite in SUITES]


def test_no_task_that_counts_may_be_below_random_weights() -> None:
    lost = row("3", random=[-0.1, -0.2, -0.05])
    assert gate_faults([*rows(), lost], "summary") == [f"below random weights: {lost.task}"]
    assert gate_passes([*rows(), replace(lost, counted=False)], "summary")
    # beyond the interval: one that reaches above it is level
    assert gate_passes([*rows(), with_lead(lost, "random", [-0.1, -0.2, 0.01])], "summary")


def test_no_task_may_carry_the_mean() -> None:
    big, none = [0.4, 0.3, 0.5], [0.0, -0.1, 0.1]
    changed = [
        x if x.metric == MEAN else with_lead(x, "imagenet", big if "Task 1" in x.task else none)
        for x in rows()
    ]
    said = "above photographs with all that is free by one task alone: Task 1: 'a', \"b\""
    assert gate_faults(changed, "summary") == [f"{suite} {said}" for suite in SUITES]
    third = [row("3", suite, imagenet=[0.01, -0.1, 0.1]) for suite in SUITES]
    assert gate_passes([*changed, *third], "summary")


def test_means_without_their_tasks_are_not_enough() -> None:
    means = [row for row in rows() if row.metric == MEAN]
    assert gate_faults(means, "summary") == [f"{suite} without single tasks" for suite in SUITES]


def test_the_recommended_features_decide() -> None:
    both = [*rows(good=False), *rows(tokens="patches")]
    assert gate_passes(both, "patches")
    assert not gate_passes(both, "summary")
    assert len(gate_faults(both, "groups")) == 2


@pytest.mark.parametrize("name", cards.card_names())
def test_what_is_shipped_passes_or_says_that_it_is_a_demonstration(name: str) -> None:
    shipped = cards.read_card(name)
    for weight in shipped.weights:
        if weight.kind == "shipped":
            assert shipped.measurements(weight), (
                f"measure it: tactileforge zoo gate {name}.{weight.tag} BENCH"
            )
            assert weight.gate == gate_verdict(shipped.measurements(weight), weight.reading)
            assert may_ship(shipped, weight), f"{name}.{weight.tag} {weight.gate}"


def test_every_file_in_the_zoo_is_on_a_card() -> None:
    folder = Path(str(cards.zoo_folder() / "weights"))
    listed = {
        w.file for name in cards.card_names() for w in cards.read_card(name).weights if w.file
    }
    assert {f"weights/{path.name}" for path in folder.glob("*.safetensors")} == listed


@pytest.mark.parametrize(
    ("passes", "more", "text", "good"),
    [
        (True, "", "Trained for a day.", True),
        (False, "", "Trained for a day.", False),
        (False, "", "It is a demonstration.", False),
        (False, "\n    demonstration: true", "Trained for a day.", False),
        (False, "\n    demonstration: true", "It is a demonstration, no more.", True),
    ],
)
def test_a_made_up_bad_card_may_not_ship(
    passes: bool, more: str, text: str, good: bool, tmp_path: Path
) -> None:
    path = tmp_path / "a.md"
    path.write_text(card(more, text))
    write_gate(path, rows(passes))
    parsed = cards.parse_card("a", path.read_text(), recipe=False)
    assert parsed.measured == rows(passes)
    assert may_ship(parsed, parsed.weights[0]) == good
    table = measured_rows(parsed, parsed.weights[0])
    assert table[1][5:9] == ("+0.150 (> +0.050)",) * 4
    assert table[-1][5] == ("+0.150 (> +0.050)" if passes else "+0.050 (> -0.050)")


def test_a_card_may_recommend_only_known_features() -> None:
    with pytest.raises(ConfigError, match=r"reading 'sumary'.*did you mean 'summary'"):
        cards.parse_card("a", card("\n    reading: sumary"), recipe=False)


def test_a_card_that_was_not_measured_may_not_ship() -> None:
    parsed = cards.parse_card("a", card(), recipe=False)
    assert not may_ship(parsed, parsed.weights[0])


def test_writing_again_replaces_and_keeps_the_rest(tmp_path: Path) -> None:
    path = tmp_path / "a.md"
    path.write_text(card())
    write_gate(path, rows(False))
    once = path.read_text()
    write_gate(path, rows())
    write_gate(path, rows(False))
    assert path.read_text() == once
    assert re.sub(r"measured:\n(?:  - .*\n)*|    gate: .*\n", "", once) == card()


def bench(folder: Path, name: str = "a.small", sha: str = SHA, **above: Any) -> Path:
    """Writes the outputs of a bench."""
    score = {"value": 0.2, "low": 0.1, "high": 0.3}
    names = ("random", "pixels", "statistics", "imagenet")
    above = above or dict.fromkeys(names, score) | {"pixels": score | {"low": -0.1}}
    folder.mkdir(exist_ok=True)
    content = {
        "suite": "real",
        "tasks": {"t": {"title": "Task", "metric": "r2"}},
        "models": {name: {"passes": False, "sha256": sha}},
        "rows": [
            *(
                {"task": "t", "model": name, "reading": reading, **score, "above": above}
                for reading in ("pooled", "summary")
            ),
            {"task": "t", "model": "chance", "reading": "pooled", **score, "value": -0.01}
            | {"above": {}},
        ],
    }
    (folder / "gate.json").write_text(json.dumps(content))
    return folder


def test_the_numbers_are_those_of_the_bench(tmp_path: Path) -> None:
    (parsed,) = read_gate(bench(tmp_path), "small", "summary", ["a.small"], SHA)
    assert (parsed.value, parsed.chance, parsed.metric, parsed.suite) == (0.2, -0.01, "r2", "real")
    assert parsed.tokens == "summary"
    assert parsed.above["random weights"] == [0.2, 0.1, 0.3]
    assert parsed.above["pixels"] == [0.2, -0.1, 0.3]


def test_other_weights_are_refused(tmp_path: Path) -> None:
    with pytest.raises(DataNotFoundError, match=r"bench suite=real model=\[a\.small\]"):
        read_gate(tmp_path, "small", "summary", ["a.small"])
    with pytest.raises(DataError, match=r"measured b, not a\.small"):
        read_gate(bench(tmp_path, "b"), "small", "summary", ["a.small"])
    with pytest.raises(DataError, match=r"other weights of a\.small"):
        read_gate(bench(tmp_path, sha="6" * 64), "small", "summary", ["a.small"], SHA)
    with pytest.raises(DataError, match="no baselines"):
        read_gate(bench(tmp_path, random={}), "small", "summary", ["a.small"])


def test_the_verb_writes_the_card(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "recipe").mkdir()
    (tmp_path / "recipe" / "a.md").write_text(card())
    monkeypatch.setattr(cards, "zoo_folder", lambda: tmp_path)
    monkeypatch.setattr(zoo_gate, "zoo_folder", lambda: tmp_path)
    for cached in (cards.card_names, cards.read_card):
        cached.cache_clear()
    try:
        assert run(["zoo", "gate", "a.small", str(bench(tmp_path / "gate"))]) == 0
        cards.read_card.cache_clear()
        assert len(cards.read_card("a").measured) == 1
        assert run(["zoo", "show", "a"]) == 0
    finally:
        for cached in (cards.card_names, cards.read_card):
            cached.cache_clear()


def test_a_packed_run_takes_its_gate_and_the_facts_of_its_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "recipe").mkdir()
    (tmp_path / "weights").mkdir()
    (tmp_path / "recipe" / "a.md").write_text(card())
    (tmp_path / "weights" / "a.small.safetensors").write_bytes(b"123")
    monkeypatch.setattr(cards, "zoo_folder", lambda: tmp_path)
    monkeypatch.setattr(zoo_gate, "zoo_folder", lambda: tmp_path)
    for cached in (cards.card_names, cards.read_card):
        cached.cache_clear()
    try:
        folder = bench(tmp_path / "gate", name="run:runs/a")
        assert run(["zoo", "gate", "a.small", str(folder), "measured=run:runs/a"]) == 0
        cards.read_card.cache_clear()
        parsed = cards.read_card("a")
        assert (len(parsed.measured), parsed.weights[0].bytes) == (1, 3)
        assert parsed.weights[0].sha256 == hashlib.sha256(b"123").hexdigest()
    finally:
        for cached in (cards.card_names, cards.read_card):
            cached.cache_clear()


def test_a_new_file_is_stamped(tmp_path: Path) -> None:
    path = tmp_path / "a.md"
    path.write_text(card())
    stamp_card(path, "small", "ab" * 32, 77)
    weight = cards.parse_card("a", path.read_text(), recipe=False).weights[0]
    assert (weight.sha256, weight.bytes) == ("ab" * 32, 77)
    with pytest.raises(ConfigError, match="no weights 'large'"):
        stamp_card(path, "large", "ab" * 32, 77)


def test_gates_name_weights_of_the_card(tmp_path: Path) -> None:
    path = tmp_path / "a.md"
    path.write_text(card())
    write_gate(path, rows())
    text = path.read_text().replace("model: small, suite", "model: other, suite")
    with pytest.raises(ConfigError, match="measured: other with summary: no such weights"):
        cards.parse_card("a", text, recipe=False)
