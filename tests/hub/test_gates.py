"""The release gate on cards: models to ship, and their rows."""

import hashlib
import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from tactileforge.cli import run
from tactileforge.errors import ConfigError, DataError, DataNotFoundError
from tactileforge.hub import cards, gates, pack
from tactileforge.hub.gates import TOKENS, Gate, count_won, gate_passes, gate_verdict
from tactileforge.hub.table import gate_rows

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


def row(task: int, tokens: str, random_low: float, pixels_low: float) -> Gate:
    return Gate(
        model="small",
        suite="real",
        task=f"Task {task}: 'a', \"b\"",
        tokens=tokens,
        metric="r2",
        value=0.5,
        chance=0.0,
        random=random_low + 0.1,
        random_low=random_low,
        pixels=pixels_low + 0.1,
        pixels_low=pixels_low,
    )


def rows(wins: int, of: int = 5, tokens: tuple[str, ...] = TOKENS) -> list[Gate]:
    lows = [0.05 if i < wins else -0.05 for i in range(of)]
    return [row(i, kind, low, 0.01) for kind in tokens for i, low in enumerate(lows)]


@pytest.mark.parametrize(("wins", "good"), [(5, True), (3, True), (2, False), (0, False)])
def test_the_majority_passes(wins: int, good: bool) -> None:
    assert gate_passes(rows(wins)) == good
    assert count_won(rows(wins), "pooled") == (wins, 5)


def test_half_of_the_tasks_or_one_kind_of_tokens_is_not_enough() -> None:
    assert not gate_passes(rows(2, of=4))
    assert not gate_passes(rows(5, tokens=("pooled",)))
    assert not gate_passes([])
    assert gate_verdict([]) == "not measured"
    assert gate_verdict(rows(2)) == "fails: 2 of 5 pooled, 2 of 5 summary, 2 of 5 patches"


def test_what_does_not_count_is_neither_won_nor_lost() -> None:
    counted = [replace(row, counted=i != 0) for i, row in enumerate(rows(3, tokens=("pooled",)))]
    assert count_won(counted, "pooled") == (2, 4)


def test_pixels_have_to_be_beaten_too() -> None:
    assert row(0, "pooled", 0.1, 0.1).beats
    assert not row(0, "pooled", 0.1, -0.001).beats
    assert not row(0, "pooled", -0.001, 0.1).beats


@pytest.mark.parametrize("name", cards.card_names())
def test_what_is_shipped_passes_or_says_that_it_is_a_demonstration(name: str) -> None:
    shipped = cards.read_card(name)
    for weight in shipped.weights:
        if weight.kind == "shipped":
            assert shipped.gate(weight), (
                f"measure it: tactileforge zoo gate {name}.{weight.tag} BENCH"
            )
            assert shipped.may_ship(weight), (
                f"{name}.{weight.tag} {gate_verdict(shipped.gate(weight))}"
            )


def test_every_file_in_the_zoo_is_on_a_card() -> None:
    folder = Path(str(cards.zoo_folder() / "weights"))
    listed = {
        w.file for name in cards.card_names() for w in cards.read_card(name).weights if w.file
    }
    assert {f"weights/{path.name}" for path in folder.glob("*.safetensors")} == listed


@pytest.mark.parametrize(
    ("wins", "more", "text", "good"),
    [
        (3, "", "Trained for a day.", True),
        (2, "", "Trained for a day.", False),
        (2, "", "It is a demonstration.", False),
        (2, "\n    demonstration: true", "Trained for a day.", False),
        (2, "\n    demonstration: true", "It is a demonstration, no more.", True),
    ],
)
def test_a_made_up_bad_card_may_not_ship(
    wins: int, more: str, text: str, good: bool, tmp_path: Path
) -> None:
    path = tmp_path / "a.md"
    path.write_text(card(more, text))
    gates.write_gates(path, rows(wins))
    parsed = cards.parse_card("a", path.read_text(), recipe=False)
    assert parsed.gates == rows(wins)
    assert parsed.may_ship(parsed.weights[0]) == good
    table = gate_rows(parsed, parsed.weights[0])
    assert [line[-1] for line in table[1:6]] == ["yes"] * wins + ["no"] * (5 - wins)


def test_a_card_that_was_not_measured_may_not_ship() -> None:
    parsed = cards.parse_card("a", card(), recipe=False)
    assert not parsed.may_ship(parsed.weights[0])


def test_writing_again_replaces_and_keeps_the_rest(tmp_path: Path) -> None:
    path = tmp_path / "a.md"
    path.write_text(card())
    gates.write_gates(path, rows(2))
    once = path.read_text()
    gates.write_gates(path, rows(3))
    gates.write_gates(path, rows(2))
    assert path.read_text() == once
    assert re.sub(r"gates:\n(?:  - .*\n)*", "", once) == card()


def bench(folder: Path, name: str = "a.small", sha: str = SHA, **above: Any) -> Path:
    """Writes the outputs of a bench."""
    score = {"value": 0.2, "low": 0.1, "high": 0.3}
    above = above or {"random": score, "pixels": score | {"low": -0.1}}
    folder.mkdir(exist_ok=True)
    content = {
        "suite": "real",
        "tasks": {"t": {"title": "Task", "metric": "r2"}},
        "models": {name: {"passes": False, "sha256": sha}},
        "rows": [
            {"task": "t", "model": name, "reading": "pooled", **score, "above": above},
            {"task": "t", "model": "chance", "reading": "pooled", **score, "value": -0.01}
            | {"above": {}},
        ],
    }
    (folder / "gate.json").write_text(json.dumps(content))
    return folder


def test_the_numbers_are_those_of_the_bench(tmp_path: Path) -> None:
    (parsed,) = gates.read_gates(bench(tmp_path), "small", ["a.small"], SHA)
    assert (parsed.value, parsed.chance, parsed.metric, parsed.suite) == (0.2, -0.01, "r2", "real")
    assert (parsed.random_low, parsed.pixels_low, parsed.beats) == (0.1, -0.1, False)


def test_other_weights_are_refused(tmp_path: Path) -> None:
    with pytest.raises(DataNotFoundError, match=r"bench suite=real model=\[a\.small\]"):
        gates.read_gates(tmp_path, "small", ["a.small"])
    with pytest.raises(DataError, match=r"measured b, not a\.small"):
        gates.read_gates(bench(tmp_path, "b"), "small", ["a.small"])
    with pytest.raises(DataError, match=r"other weights of a\.small"):
        gates.read_gates(bench(tmp_path, sha="6" * 64), "small", ["a.small"], SHA)
    with pytest.raises(DataError, match="no baselines"):
        gates.read_gates(bench(tmp_path, random={}), "small", ["a.small"])


def test_the_verb_writes_the_card(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "recipe").mkdir()
    (tmp_path / "recipe" / "a.md").write_text(card())
    monkeypatch.setattr(cards, "zoo_folder", lambda: tmp_path)
    for cached in (cards.card_names, cards.read_card):
        cached.cache_clear()
    try:
        assert run(["zoo", "gate", "a.small", str(bench(tmp_path / "gate"))]) == 0
        cards.read_card.cache_clear()
        assert len(cards.read_card("a").gates) == 1
        assert run(["zoo", "show", "a"]) == 0
    finally:
        for cached in (cards.card_names, cards.read_card):
            cached.cache_clear()


def test_packing_writes_the_card(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "recipe").mkdir()
    (tmp_path / "recipe" / "a.md").write_text(card())
    out = tmp_path / "out.safetensors"
    monkeypatch.setattr(cards, "zoo_folder", lambda: tmp_path)
    monkeypatch.setattr(pack, "pack_run", lambda run, **options: out.write_bytes(b"123") and out)
    for cached in (cards.card_names, cards.read_card):
        cached.cache_clear()
    try:
        folder = bench(tmp_path / "gate", name="run:runs/a")
        assert run(["zoo", "pack", "runs/a", "name=a.small", f"gate={folder}"]) == 0
        cards.read_card.cache_clear()
        parsed = cards.read_card("a")
        assert (len(parsed.gates), parsed.weights[0].bytes) == (1, 3)
        assert parsed.weights[0].sha256 == hashlib.sha256(b"123").hexdigest()
    finally:
        for cached in (cards.card_names, cards.read_card):
            cached.cache_clear()


def test_a_new_file_is_stamped(tmp_path: Path) -> None:
    path = tmp_path / "a.md"
    path.write_text(card())
    gates.stamp_card(path, "small", "ab" * 32, 77)
    weight = cards.parse_card("a", path.read_text(), recipe=False).weights[0]
    assert (weight.sha256, weight.bytes) == ("ab" * 32, 77)
    with pytest.raises(ConfigError, match="'large' have no line sha256"):
        gates.stamp_card(path, "large", "ab" * 32, 77)


def test_gates_name_weights_of_the_card(tmp_path: Path) -> None:
    path = tmp_path / "a.md"
    path.write_text(card())
    gates.write_gates(path, rows(1))
    text = path.read_text().replace("model: small, suite", "model: other, suite")
    with pytest.raises(ConfigError, match="gates: other with pooled: no such weights"):
        cards.parse_card("a", text, recipe=False)
