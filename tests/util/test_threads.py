"""Numbers near 0 within a run, and after it."""

import contextlib
from pathlib import Path

import pytest
import torch

import tactileforge.api as training
from tactileforge.cli._compose import compose
from tactileforge.util.threads import flushed


def _smallest() -> float:
    return float((torch.full((64,), 1e-30) * 1e-10).max())


def test_numbers_near_0_are_0_within_the_block_alone() -> None:
    torch.utils.deterministic.fill_uninitialized_memory = True  # type: ignore[attr-defined]
    assert _smallest() > 0
    with flushed():
        assert _smallest() == 0
        assert not torch.utils.deterministic.fill_uninitialized_memory  # type: ignore[attr-defined]
    assert _smallest() > 0
    assert torch.utils.deterministic.fill_uninitialized_memory  # type: ignore[attr-defined]


def test_an_error_ends_it_too() -> None:
    with contextlib.suppress(ValueError), flushed():
        raise ValueError
    assert _smallest() > 0


def test_a_run_trains_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    found: list[float] = []

    def checked(*_: object) -> None:
        found.append(_smallest())
        raise KeyboardInterrupt

    monkeypatch.setattr(training, "_check", checked)
    with pytest.raises(KeyboardInterrupt):
        training.train(compose("mae", ["scale=demo"]), tmp_path / "run")
    assert found == [0.0]
    assert _smallest() > 0
