"""Speed of training: logs, counts, and a warning about a slow loader."""

import logging
import re
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import lightning as L
import pytest
import torch
from torch import Tensor, nn
from torch.utils.data import DataLoader, IterableDataset

from tactileforge.api import train
from tactileforge.cli._compose import compose
from tactileforge.data.batches.loader import Loader
from tactileforge.pages.curves import Curve, read_metrics
from tactileforge.report.speed import speed_fact, speed_verdict
from tactileforge.training import speed
from tactileforge.training.speed import Speed, advice, peak_of

#: Steps of a run of clips of 5 numbers, and of a linear layer of 5 inputs and 7 outputs.
STEPS, CLIPS, INPUTS, OUTPUTS = 40, 3, 5, 7


class Clock:
    """Time, passing only on request."""

    def __init__(self) -> None:
        self.now = 0.0

    def perf_counter(self) -> float:
        return self.now


class Batches(IterableDataset[Any]):
    def __init__(self, clock: Clock, seconds: float) -> None:
        self.clock, self.seconds = clock, seconds

    def __iter__(self) -> Iterator[dict[str, Tensor]]:
        for _ in range(STEPS):
            self.clock.now += self.seconds
            yield {"frames": torch.ones(CLIPS, INPUTS), "group": -torch.ones(CLIPS)}


class Layer(nn.Linear):
    """Of its own: a module of torch is not compiled by itself."""

    def forward(self, given: Tensor) -> Tensor:
        return super().forward(given)


class Module(L.LightningModule):
    """A linear layer with steps of a given duration."""

    def __init__(self, clock: Clock, seconds: float) -> None:
        super().__init__()
        self.layer = Layer(INPUTS, OUTPUTS)
        self.clock, self.seconds = clock, seconds

    def current_weights(self) -> dict[str, float]:
        return {"pixel": 1.0, "force": 0.0 if self.global_step < STEPS // 2 else 1.0}

    def training_step(self, batch: dict[str, Tensor], batch_idx: int) -> Tensor:
        self.clock.now += self.seconds
        frames = batch["frames"].requires_grad_()  # as the blocks below the last have
        out = self.layer(frames).square().mean()
        return out + self.layer(frames).mean() if self.current_weights()["force"] else out

    def validation_step(self, batch: dict[str, Tensor], batch_idx: int) -> None:
        self.clock.now += 100

    def configure_optimizers(self) -> torch.optim.Optimizer:
        return torch.optim.SGD(self.parameters(), lr=0.01)


class Kept(L.Callback):
    """Every logged value."""

    def __init__(self) -> None:
        self.rows: list[dict[str, float]] = []

    def on_train_batch_end(self, trainer: L.Trainer, *_: object) -> None:
        row = {k: float(v) for k, v in trainer.callback_metrics.items() if k.startswith("speed/")}
        self.rows += [row] if row and trainer.global_step % 5 == 1 else []


def run(
    monkeypatch: pytest.MonkeyPatch,
    folder: Path,
    wait: float,
    step: float,
    peak: float | None = None,
    backend: Callable[..., Any] | None = None,
) -> list[dict[str, float]]:
    """Trains by a clock of its own: each batch takes ``wait`` seconds, each step ``step``."""
    clock = Clock()
    monkeypatch.setattr(time, "perf_counter", clock.perf_counter)
    callback, kept = Speed(workers=2), Kept()
    callback.peak = peak
    loader = Loader(Batches(clock, wait), batch_size=None)
    monkeypatch.setattr(Loader, "state_dict", lambda self: {})
    trainer = L.Trainer(
        accelerator="cpu",
        max_steps=STEPS,
        log_every_n_steps=5,
        val_check_interval=7,
        callbacks=[callback, kept],
        logger=False,
        enable_checkpointing=False,
        enable_progress_bar=False,
        enable_model_summary=False,
        num_sanity_val_steps=0,
        default_root_dir=folder,
    )
    module = Module(clock, step)
    if backend:
        module.layer.compile(backend=backend, dynamic=False)
    trainer.fit(
        module,
        loader,
        DataLoader([{"frames": torch.ones(1, INPUTS), "group": -torch.ones(1)}], batch_size=None),
    )
    monkeypatch.undo()
    return kept.rows


pytestmark = pytest.mark.filterwarnings("ignore")  # of Lightning, on so small a run


def test_clips_and_waiting_are_those_of_the_clock(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Batches of 3 clips, 1 s of waiting and 3 s of work each; validation takes 100 s more."""
    rows = run(monkeypatch, tmp_path, wait=1, step=3)
    expected = {"speed/clips_per_s": 3 / 4, "speed/waiting": 1 / 4}
    assert all(row == pytest.approx(expected) for row in rows[:-1])
    assert len(rows) > 1  # a loader without a length reads one ahead: the last step waits for none


def test_mfu_is_operations_over_peak(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """A linear layer: forward, and twice as much backward; one more after an objective wakes up."""
    rows = run(monkeypatch, tmp_path, wait=0, step=2, peak=1e4)
    once = 3 * 2 * CLIPS * INPUTS * OUTPUTS
    assert rows[0]["speed/mfu"] == pytest.approx(once / 2 / 1e4)
    assert rows[-1]["speed/mfu"] == pytest.approx(2 * once / 2 / 1e4)


def test_counting_leaves_compiled_blocks_compiled(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Torch never compiles what it first sees under a counter: MFU switched compile=true off."""
    compiled: list[Any] = []

    def backend(graph: Any, examples: Any) -> Any:
        compiled.append(graph)
        return graph.forward

    rows = run(monkeypatch, tmp_path, wait=0, step=2, peak=1e4, backend=backend)
    assert compiled
    once = 3 * 2 * CLIPS * INPUTS * OUTPUTS
    assert rows[0]["speed/mfu"] == pytest.approx(once / 2 / 1e4)


def test_a_resumed_run_does_not_count_again() -> None:
    """A counted step runs uncompiled: counting again would compute it otherwise."""
    first, second = Speed(workers=2), Speed(workers=2)
    assert first.state_dict() == {}
    first._counted[frozenset({"pixel", "force"})] = 7
    second.load_state_dict(first.state_dict())
    second.peak = 1e4
    weights = {"force": 1.0, "pixel": 0.5, "diff": 0.0}
    module: Any = SimpleNamespace(current_weights=lambda: weights)
    trainer: Any = SimpleNamespace(train_dataloader=SimpleNamespace(waited=0.0))
    second.on_train_batch_start(trainer, module, {}, 0)
    assert second._counter is None
    weights["diff"] = 1.0
    second.on_train_batch_start(trainer, module, {}, 0)
    assert second._counter is not None
    second.on_exception(trainer, module, KeyError())


@pytest.mark.parametrize(("wait", "warns"), [(1, True), (0.1, False)])
def test_a_loader_that_is_the_limit_is_named_once(
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
    caplog: pytest.LogCaptureFixture,
    wait: float,
    warns: bool,
) -> None:
    monkeypatch.setattr(speed, "cpus", lambda: 8)
    with caplog.at_level(logging.WARNING, "tactileforge"):
        run(monkeypatch, tmp_path, wait=wait, step=1)
    lines = [line for line in caplog.messages if "waits for data" in line]
    expected = "the step waits for data 50 % of the time: raise batch.workers (2 now, for 8 CPUs)"
    assert lines == ([expected] if warns else [])


def test_advice_is_given_once_in_a_run_by_its_first_process(
    caplog: pytest.LogCaptureFixture,
) -> None:
    module: Any = SimpleNamespace(log_dict=lambda values: None)
    trainer: Any = SimpleNamespace(
        fit_loop=SimpleNamespace(total_batch_idx=0),
        accumulate_grad_batches=1,
        global_step=1,
        log_every_n_steps=1,
        world_size=2,
        num_devices=2,
        is_global_zero=True,
    )
    for first, expected in ((True, 1), (False, 0)):
        caplog.clear()
        callback, trainer.is_global_zero = Speed(workers=2), first
        for share in (1, 1, 1, 1, 0, 1, 1, 1, 1):
            callback._restart()
            callback._waiting = share * 1e6
            callback.on_train_batch_end(trainer, module, None, {"group": [0]}, 0)
        assert sum("waits for data" in line for line in caplog.messages) == expected


def test_waiting_costs_nothing_while_the_device_works() -> None:
    callback = Speed(workers=2)
    trainer: Any = SimpleNamespace(train_dataloader=SimpleNamespace(waited=1.5))
    for busy, expected in ((True, 0.0), (False, 1.5)):
        trainer.train_dataloader.waited += 1.5
        callback._done = SimpleNamespace(query=lambda done=not busy: done)  # type: ignore[assignment]
        callback._seen = trainer.train_dataloader.waited - 1.5
        callback.on_train_batch_start(trainer, None, {}, 0)  # type: ignore[arg-type]
        assert callback._waiting == expected


def test_advice_follows_the_machine() -> None:
    assert advice(2, 8) == "raise batch.workers (2 now, for 8 CPUs)"
    assert "tactileforge data pack" in advice(8, 8)


@pytest.mark.parametrize(
    ("name", "peak"),
    [
        ("NVIDIA H100 80GB HBM3", 989e12),
        ("NVIDIA H100 PCIe", 756e12),
        ("NVIDIA A100-SXM4-40GB", 312e12),
        ("NVIDIA A10G", None),
        ("NVIDIA L4", 121e12),
        ("NVIDIA L40S", 362e12),
    ],
)
def test_peaks_are_of_whole_names(name: str, peak: float | None) -> None:
    assert peak_of(name) == peak


def test_the_report_says_the_medians_and_what_is_the_limit() -> None:
    import numpy as np

    def curve(*values: float) -> Curve:
        return Curve(np.arange(len(values)), np.array(values))

    curves = {"speed/clips_per_s": curve(1, 50, 60), "speed/waiting": curve(0.9, 0.3, 0.3)}
    assert speed_fact(curves) == "50 clips/s, 30 % waiting for data"
    assert "MFU 41 %" in speed_fact(curves | {"speed/mfu": curve(0.41)})
    ((mark, text),) = speed_verdict(curves)
    assert mark == "bad"
    assert "batch.workers" in text
    assert speed_verdict(curves | {"speed/waiting": curve(0.1)}) == []
    assert speed_fact({}) == ""


@pytest.mark.slow
def test_a_run_logs_its_speed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    overrides = ["scale=demo", "encoder.image_size=32", "batch.size=8", "batch.workers=0"]
    overrides += ["data.scenes=3", "data.val=1", "data.size=32", "trainer.max_steps=6"]
    train(compose("anytouch2", [*overrides, "trainer.log_every_n_steps=2"]), tmp_path)
    curves = read_metrics(tmp_path)
    assert curves["speed/clips_per_s"].values.min() > 0
    assert 0 < curves["speed/waiting"].values.max() <= 1  # decoded in the process itself
    assert re.search(r"clips/s=[\d.e+]+, waiting=\d+%", capsys.readouterr().err)
    assert "waiting for data" in (tmp_path / "report.html").read_text()
