"""Numbers near 0 within a run, and after it."""

import contextlib
import warnings
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import torch

import tactileforge
import tactileforge.api as training
from tactileforge.cli._compose import compose
from tactileforge.hub import clip_encoder
from tactileforge.util import threads
from tactileforge.util.threads import few_threads, flushed, use_threads


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


@pytest.fixture
def cores(monkeypatch: pytest.MonkeyPatch) -> Iterator[int]:
    """A machine with three threads, chosen by torch."""
    before = torch.get_num_threads()
    for word in threads._WORDS:
        monkeypatch.delenv(word, raising=False)
    monkeypatch.setattr(threads, "_DEFAULT", 3)
    monkeypatch.setattr(threads, "_chosen", False)
    torch.set_num_threads(3)
    yield 3
    torch.set_num_threads(before)


def _used(is_small: bool) -> int:
    with few_threads(is_small):
        return torch.get_num_threads()


def test_small_work_takes_one_thread_and_gives_the_number_back(cores: int) -> None:
    assert (_used(True), _used(False)) == (1, 3)
    with contextlib.suppress(ValueError), few_threads(True):
        raise ValueError
    assert torch.get_num_threads() == 3


def test_a_number_that_was_chosen_stays(cores: int, monkeypatch: pytest.MonkeyPatch) -> None:
    torch.set_num_threads(2)
    assert _used(True) == 2
    torch.set_num_threads(3)
    use_threads(None)
    assert _used(True) == 1
    monkeypatch.setenv("OMP_NUM_THREADS", "3")
    assert _used(True) == 3
    monkeypatch.delenv("OMP_NUM_THREADS")
    use_threads(3)
    assert _used(True) == 3


def test_a_clip_of_a_small_model_is_small_work_and_many_are_not(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    model, small = tactileforge.load("anytouch2.tiny"), list[bool]()

    def noted(is_small: bool) -> contextlib.nullcontext[None]:
        small.append(is_small)
        return contextlib.nullcontext()

    monkeypatch.setattr(clip_encoder, "few_threads", noted)
    clips = np.random.default_rng(0).integers(90, 99, (4, 4, 60, 80, 3), np.uint8)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # noise is not a gel
        model.encode(clips[0], clips[0, 0], "digit")
        model.readings(clips[0], clips[0, 0], "digit")
        model.encode(clips, clips[:, 0], "digit")
    assert small == [True, True, False]
