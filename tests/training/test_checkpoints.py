from pathlib import Path
from types import SimpleNamespace

import pytest
from lightning.pytorch.callbacks import ModelCheckpoint

from tactileforge.api import train
from tactileforge.cli._compose import compose
from tactileforge.runs.folder import BEST
from tactileforge.training.checkpoints import Checkpoints, best_checkpoint


class Steps:
    """A trainer of several processes, one of them asked to stop."""

    def __init__(self, world: int, other: bool = False) -> None:
        self.world_size, self.log_every_n_steps, self.accumulate_grad_batches = world, 4, 1
        self.fit_loop = SimpleNamespace(total_batch_idx=-1)
        self.global_step, self.asked, self.saved = 0, 0, 0
        self.should_stop = False
        self.strategy = SimpleNamespace(reduce_boolean_decision=self.reduced)
        self.other = other

    def reduced(self, mine: bool, all: bool) -> bool:
        self.asked += 1
        return mine or self.other

    def save_checkpoint(self, path: Path) -> None:
        self.saved += 1

    def step(self, callback: Checkpoints) -> None:
        self.global_step += 1
        self.fit_loop.total_batch_idx += 1
        callback.on_train_batch_end(self, None, None, None, 0)  # type: ignore[arg-type]


def test_one_process_stops_after_its_step(tmp_path: Path) -> None:
    steps, callback = Steps(1), Checkpoints(tmp_path, every=10)
    steps.step(callback)
    callback.interrupted = True
    steps.step(callback)
    assert (steps.should_stop, steps.saved, steps.asked) == (True, 1, 0)


@pytest.mark.parametrize("here", [True, False])
def test_processes_agree_where_they_wait_anyway(tmp_path: Path, here: bool) -> None:
    steps, callback = Steps(2), Checkpoints(tmp_path, every=10)
    for _ in range(4):
        steps.step(callback)
    assert steps.asked == 1
    callback.interrupted = here
    steps.other = not here
    for _ in range(3):
        steps.step(callback)
        assert not steps.should_stop
    steps.step(callback)
    assert (steps.should_stop, steps.saved, steps.asked) == (True, 1, 2)
    callback.on_train_end(steps, None)  # type: ignore[arg-type]
    assert (callback.interrupted, steps.saved) == (True, 1)


def test_a_signal_that_comes_too_late_stopped_nothing(tmp_path: Path) -> None:
    steps, callback = Steps(2), Checkpoints(tmp_path, every=10)
    steps.step(callback)
    callback.interrupted = True
    callback.on_train_end(steps, None)  # type: ignore[arg-type]
    assert (callback.interrupted, steps.saved) == (False, 1)


@pytest.mark.slow
def test_the_best_waits_for_an_objective_that_is_asleep(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    words = ["scale=demo", "debug=steps", "data.scenes=3", "data.val=1", "data.size=32"]
    words += ["encoder.image_size=32", "batch.size=4", "batch.workers=0"]
    words += ["trainer.max_steps=4", "trainer.val_check_interval=1", "trainer.keep_best=val/force"]
    starts = [f"curriculum.objective.force.{edge}" for edge in ("start=0.5", "end=1.0")]
    found = []
    for name, more in (("wakes", starts), ("sleeps", ["objective.force.weight=0"])):
        train(compose("anytouch2", [*words, *more]), tmp_path / name)
        found.append((tmp_path / name / BEST).is_file())
    assert found == [True, False]
    said = [row.getMessage() for row in caplog.records if "keep_best" in row.getMessage()]
    assert len(said) == 1
    assert "keep_best=val/force: never validated" in said[0]
    assert "val/pixel" in said[0]


@pytest.mark.parametrize(
    ("metric", "mode"),
    [
        ("val/force", "min"),
        ("val/force/mae_z", "min"),
        ("val/force/r2_z", "max"),
        ("val/classify/accuracy", "max"),
    ],
)
def test_the_best_accuracy_is_the_largest(tmp_path: Path, metric: str, mode: str) -> None:
    (best,) = best_checkpoint(tmp_path, metric)
    assert isinstance(best, ModelCheckpoint)
    assert (best.monitor, best.mode) == (metric, mode)


@pytest.mark.slow
def test_the_best_is_known_after_a_stop_and_in_another_folder(tmp_path: Path) -> None:
    """The last checkpoint is older than the validation with the best score."""
    words = ["scale=demo", "debug=steps", "data.scenes=3", "data.val=1", "data.size=32"]
    words += ["encoder.image_size=32", "batch.size=4", "batch.workers=0", "objective=[pixel]"]
    words += ["trainer.max_steps=2", "trainer.val_check_interval=1", "trainer.keep_best=val/pixel"]
    module = train(compose("anytouch2", words), tmp_path / "before")
    (keeper,) = (c for c in module.trainer.callbacks if isinstance(c, ModelCheckpoint))
    (tmp_path / "before").rename(tmp_path / "after")
    (after,) = best_checkpoint(tmp_path / "after", "val/pixel")
    assert isinstance(after, ModelCheckpoint)
    after.load_state_dict({**keeper.state_dict(), "best_model_score": None, "best_k_models": {}})
    assert after.best_model_path == str(tmp_path / "after" / BEST)
    assert after.best_model_score == keeper.best_model_score
    assert not after.check_monitor_top_k(module.trainer, keeper.best_model_score + 0.1)
    assert after.check_monitor_top_k(module.trainer, keeper.best_model_score - 0.1)
