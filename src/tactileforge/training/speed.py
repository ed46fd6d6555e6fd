"""Speed of training: clips per second, share of the time spent waiting for data, MFU."""

from __future__ import annotations

import logging
import re
import time
from typing import Any

import lightning as L
import torch
from lightning.pytorch.callbacks import Callback
from torch.utils.flop_counter import FlopCounterMode

from tactileforge.training.module import log_interval
from tactileforge.util.processes import cpus

log = logging.getLogger(__name__)

#: Dense bf16 peak of a card, operations per second, by a part of its name; the first match is
#: taken. Source: NVIDIA's data sheets, without sparsity.
PEAKS = {
    "B200": 2250e12,
    "H200": 989e12,
    "H100 PCIe": 756e12,
    "H100 NVL": 835e12,
    "H100": 989e12,
    "A100": 312e12,
    "A10": 125e12,
    "L40S": 362e12,
    "L4": 121e12,
    "RTX A6000": 155e12,
    "RTX 4090": 165e12,
    "RTX 3090": 71e12,
}

#: Share of the time spent waiting for data above which the loader limits the speed.
WAITING = 0.2
#: Number of consecutive logged values above `WAITING` before a warning.
_PATIENCE = 3


class Speed(Callback):
    """Logs ``speed/clips_per_s``, ``speed/waiting`` and, on a known device, ``speed/mfu``.

    Values cover the time since the last logging, without validation and without the first step of a
    process, in which workers start and kernels are compiled. ``waiting`` is the share of the time
    spent waiting for the loader while the device was idle. ``mfu`` (model FLOPs utilisation) is the
    number of operations in matrix products and convolutions, forward and backward, over the peak of
    the device in the same time. Operations are counted once, in the first step with the same active
    objectives, and include those on masked tokens. That step runs uncompiled, since torch never
    compiles what it first sees under a counter; a resumed run takes the counts from its checkpoint,
    so that it compiles the same steps. Nothing here waits for the device.

    Args:
        workers: Number of worker processes of the loader, ``batch.workers``.

    Attributes:
        peak: Peak of the device, operations per second; None if unknown, then nothing is counted.
    """

    def __init__(self, workers: int) -> None:
        self.workers = workers
        self.peak: float | None = None
        self._start: float | None = None
        self._pause = 0.0
        self._seen = self._waiting = 0.0
        self._clips = self._flops = self._slow = 0
        self._warned = False
        self._done: torch.cuda.Event | None = None
        self._counter: FlopCounterMode | None = None
        self._counted: dict[frozenset[str], int] = {}

    def on_train_start(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        """Looks up the peak of the device."""
        device = pl_module.device
        if device.type == "cuda":
            self.peak = peak_of(torch.cuda.get_device_name(device))
            self._done = torch.cuda.Event()  # type: ignore[no-untyped-call]

    def on_train_batch_start(
        self, trainer: L.Trainer, pl_module: L.LightningModule, batch: Any, batch_idx: int
    ) -> None:
        """Adds the waiting time for the batch, if the device was idle meanwhile."""
        waited = getattr(trainer.train_dataloader, "waited", 0.0)
        # while the device still computes the last step, the wait for the next batch costs nothing
        if self._done is None or self._done.query():  # type: ignore[no-untyped-call]
            self._waiting += waited - self._seen
        self._seen = waited
        # counted once for each set of active objectives: counting itself slows a step down
        if self.peak and _active(pl_module) not in self._counted:
            torch.compiler.set_stance("force_eager")
            self._counter = FlopCounterMode(display=False)
            self._counter.__enter__()  # type: ignore[no-untyped-call]

    def on_train_batch_end(
        self,
        trainer: L.Trainer,
        pl_module: L.LightningModule,
        outputs: Any,
        batch: Any,
        batch_idx: int,
    ) -> None:
        """Counts the batch, and logs together with the losses."""
        if self._done is not None:
            self._done.record()
        active = _active(pl_module) if self.peak else frozenset()
        if self._stop_counting(active):
            self._start = None  # kernels are compiled in the next step
            return
        stepped = (trainer.fit_loop.total_batch_idx + 1) % trainer.accumulate_grad_batches == 0
        # the first step starts the clock: workers start in it, and kernels are compiled
        if self._start is None:
            self._restart()
            return
        self._clips += len(batch["group"])
        self._flops += self._counted.get(active, 0)
        if stepped and trainer.global_step % log_interval(trainer) == 0:
            seconds = time.perf_counter() - self._start
            # of all processes: each has a share of the clips of a step
            values = {"speed/clips_per_s": trainer.world_size * self._clips / seconds}
            values["speed/waiting"] = min(1.0, self._waiting / seconds)
            if self.peak:
                values["speed/mfu"] = self._flops / seconds / self.peak
            pl_module.log_dict(values)
            if trainer.is_global_zero:
                self._judge(values["speed/waiting"], cpus() // trainer.num_devices)
            self._restart()

    def on_validation_start(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        """Pauses the clock."""
        self._pause = time.perf_counter()

    def on_validation_end(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        """Resumes the clock."""
        if self._start is not None:
            self._start += time.perf_counter() - self._pause

    def on_exception(
        self, trainer: L.Trainer, pl_module: L.LightningModule, exception: BaseException
    ) -> None:
        """Stops counting."""
        self._stop_counting(frozenset())

    def _restart(self) -> None:
        self._start = time.perf_counter()
        self._waiting, self._clips, self._flops = 0.0, 0, 0

    def state_dict(self) -> dict[str, Any]:
        """Operations of a step by active objectives; empty where nothing is counted."""
        counted = [[sorted(active), flops] for active, flops in self._counted.items()]
        return {"counted": counted} if counted else {}

    def load_state_dict(self, state_dict: dict[str, Any]) -> None:
        """Takes over what `state_dict` has."""
        self._counted = {frozenset(active): int(flops) for active, flops in state_dict["counted"]}

    def _stop_counting(self, active: frozenset[str]) -> bool:
        """Ends the count of a step; returns whether it was counted."""
        if self._counter is None:
            return False
        self._counter.__exit__(None, None, None)  # type: ignore[no-untyped-call]
        torch.compiler.set_stance("default")
        self._counted[active] = self._counter.get_total_flops()
        self._counter = None
        return True

    def _judge(self, waiting: float, available: int) -> None:
        # in a row: one slow file, or a cache that fills, is no reason for advice
        self._slow = self._slow + 1 if waiting > WAITING else 0
        if self._slow >= _PATIENCE and not self._warned:
            log.warning(
                "the step waits for data %.0f %% of the time: %s",
                100 * waiting,
                advice(self.workers, available),
            )
            self._warned = True


def peak_of(name: str) -> float | None:
    """Peak of a card by its name, operations per second; None if it is not known.

    Example:
        >>> peak_of("NVIDIA H100 80GB HBM3")
        989000000000000.0
    """
    found = (peak for key, peak in PEAKS.items() if re.search(rf"\b{key}\b", name))
    return next(found, None)


def advice(workers: int, available: int) -> str:
    """Advice for a run limited by the loader.

    Args:
        workers: Number of worker processes of the loader.
        available: Number of CPUs for one training process.

    Example:
        >>> advice(2, 8)
        'raise batch.workers (2 now, for 8 CPUs)'
    """
    if workers < available:
        return f"raise batch.workers ({workers} now, for {available} CPUs)"
    return (
        f"batch.workers={workers} takes all CPUs; pack the data at the encoder's size "
        "(tactileforge data pack), or raise batch.cache_mb"
    )


def _active(module: Any) -> frozenset[str]:
    return frozenset(key for key, weight in module.current_weights().items() if weight)
