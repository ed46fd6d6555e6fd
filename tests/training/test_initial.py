"""Weights not taken over by a new run are named, with the option."""

import logging
from pathlib import Path
from typing import Any

import pytest
import torch
from omegaconf import OmegaConf

from tactileforge.cli._compose import compose
from tactileforge.hub.cards import find_card, zoo_folder
from tactileforge.hub.header import read_header
from tactileforge.runs.checkpoint_file import left_out
from tactileforge.training import initial
from tactileforge.training.initial import warn_of_dropped
from tactileforge.training.module import TouchModule

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


def test_the_precedence_of_init_scale_and_freeze() -> None:
    """The table of docs/configuration.md: sizes of the model, training and heads of the run."""
    words = ["init=anytouch2.tiny", "objective=[pixel]", "encoder.mask_ratio=0.4", "freeze=true"]
    for scale in ("demo", "tiny"):
        made = compose("anytouch2", [f"scale={scale}", *words])
        run: dict[str, Any] = OmegaConf.to_container(made, resolve=True)  # type: ignore[assignment]
        steps, width = run["trainer"]["max_steps"], run["head"]["pixel"].get("width")
        state = initial.start_from(run)
        model = find_card("anytouch2.tiny")[1]
        header = read_header(Path(str(zoo_folder() / model.file)))
        sizes = {key: run["encoder"][key] for key in ("size", "depth", "image_size", "patch")}
        assert sizes == {key: header.encoder[key] for key in sizes}, "of the model"
        assert run["encoder"]["mask_ratio"] == 0.4, "of the run"
        assert (run["trainer"]["max_steps"], run["head"]["pixel"].get("width")) == (steps, width)
        module = TouchModule.from_config(run, {"text", "force"})
        assert state is not None
        left_out(module, state)
        assert not any(weight.requires_grad for weight in module.encoder.parameters())
        assert all(weight.requires_grad for weight in module.heads.parameters())
        assert not module.train().encoder.training, "freeze keeps it in evaluation mode"
