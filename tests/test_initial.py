"""Weights not taken over by a new run are named, with the option."""

import logging
from typing import Any

import pytest
import torch
from omegaconf import OmegaConf

from tactileforge import initial
from tactileforge.checkpoint_file import left_out
from tactileforge.compose import compose
from tactileforge.initial import warn_of_dropped
from tactileforge.module import TouchModule

SMALL = ["scale=demo", "encoder.image_size=32", "encoder.depth=1", "init=anytouch2.tiny"]


def plain(*words: str) -> dict[str, Any]:
    return OmegaConf.to_container(compose("anytouch2", [*SMALL, *words]), resolve=True)  # type: ignore[return-value]


def warned(
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
    now: list[str],
    then: list[str],
) -> str:
    """Warnings of a run of some words, started from one of others."""
    before, after = plain(*then), plain(*now)
    given = TouchModule.from_config(before, {"text", "force"}).state_dict()
    module = TouchModule.from_config(after, {"text", "force"})
    monkeypatch.setattr(initial, "starting_heads", lambda _: before["head"])
    with caplog.at_level(logging.WARNING):
        warn_of_dropped(after, left_out(module, given))
    return "\n".join(record.getMessage() for record in caplog.records)


def test_a_head_that_is_dropped(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    then = ["objective=[pixel,force]"]
    said = warned(monkeypatch, caplog, ["objective=[pixel]"], then)
    assert said.startswith("init: heads.force, objectives.force of anytouch2.tiny not taken: ")
    assert "objective=[pixel] has no force; give what it was trained with" in said


def test_a_part_of_another_shape(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    now, then = (["objective=[pixel]", f"head.pixel.width={width}"] for width in (64, 128))
    said = warned(monkeypatch, caplog, now, then)
    assert "heads.pixel of anytouch2.tiny not taken: head.pixel.width=64 (there 128)" in said


def test_what_fits_is_not_warned_of(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    more = ["objective=[pixel,force]"]
    assert warned(monkeypatch, caplog, more, ["objective=[pixel]"]) == ""
    assert left_out(torch.nn.Linear(1, 1), {"balance.factor": torch.ones(1)}) == []
