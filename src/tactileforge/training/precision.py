"""The precision of a run: ``trainer.precision=auto`` for this machine and model."""

from __future__ import annotations

import copy
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, TypeAlias

import torch

from tactileforge.contracts import Batch
from tactileforge.data.batches.clips import Clips, collate
from tactileforge.data.labels.augment import fill_captions
from tactileforge.training.module import TouchModule
from tactileforge.util.distributed import count_processes

#: CPU seconds of a step in fp32 and in bf16.
Timing: TypeAlias = tuple[float, float]

#: Abilities of a CPU that make bf16 matrix products faster than fp32 ones, best first.
_NATIVE = {"amx_bf16": "AMX", "avx512_bf16": "AVX-512 BF16"}
#: Least speed-up of a step in bf16: near 1, timing noise could give equal runs other precisions.
GAIN = 1.3
#: Least number of steps of a run for the probe, which itself costs several steps.
_STEPS = 50
#: Clips of the probe, timed rounds, and seconds after which no further round starts.
_CLIPS, _ROUNDS, _SECONDS = 2, 3, 10.0


@dataclass(frozen=True)
class Precision:
    """The precision of a run.

    Attributes:
        name: Name for Lightning's trainer, such as ``32-true`` or ``bf16-mixed``.
        reason: Reason for the choice, as a clause.
    """

    name: str
    reason: str


def choose_precision(
    options: Mapping[str, Any], measure: Callable[[], Timing], native: str | None = None
) -> Precision:
    """Chooses the precision of a new run; the run keeps it, so nothing is chosen on resume.

    Args:
        options: Options of ``trainer``.
        measure: Function that times a step, see `step_times`; called only in a single process on a
            CPU with fast bf16.
        native: Feature of this CPU behind fast bf16, "" without one; None to detect it, see
            `native_bf16`.
    """
    if options["precision"] != "auto":
        return Precision(str(options["precision"]), "as asked for")
    if torch.cuda.is_available() and options["accelerator"] != "cpu":
        if torch.cuda.is_bf16_supported(including_emulation=False):
            return Precision("bf16-mixed", "the accelerator computes in bf16")
        return Precision("32-true", "the accelerator has no bf16")
    if not (native := native_bf16() if native is None else native):
        return Precision("32-true", "this CPU has no fast bf16")
    if count_processes(options) > 1:  # each would measure, and they could disagree
        return Precision("32-true", "with several processes bf16 is not tried on a CPU")
    if 0 <= options.get("max_steps", -1) < _STEPS:
        return Precision("32-true", f"bf16 is not tried for less than {_STEPS} steps")
    single, half = measure()
    gain = single / half
    measured = f"{native}: a step in bf16 is {gain:.2f} times as fast as in fp32"
    if gain >= GAIN:
        return Precision("bf16-mixed", measured)
    return Precision("32-true", f"{measured}, and {GAIN} is asked for")


def native_bf16() -> str:
    """Name of this CPU's feature behind fast bf16 products; "" without one."""
    has = torch.cpu.get_capabilities()
    return next((name for key, name in _NATIVE.items() if has.get(key)), "")


def step_times(module: TouchModule, clips: Clips) -> Timing:
    """CPU time of forward and backward of all objectives on two clips, in fp32 and in bf16, s.

    The precisions take turns, and the fastest step of each counts, so that both meet the same
    disturbances. The module is left unchanged.

    Args:
        module: Module before its training.
        clips: Clips of the training data.
    """
    with torch.random.fork_rng(devices=[]):
        rows = [clips[(row, 0)] for row in range(min(_CLIPS, len(clips)))]
        batch = collate(rows)
        fill_captions(batch)
        trial = copy.deepcopy(module).train()
        best = [float("inf")] * 2
        start = time.process_time()
        for number in range(1 + _ROUNDS):
            for half in (False, True):
                seconds = _step(trial, batch, half)
                if number:  # the first is a warm-up
                    best[half] = min(best[half], seconds)
            if number and time.process_time() - start > _SECONDS:
                break
    return best[0], best[1]


def _step(module: TouchModule, batch: Batch, half: bool) -> float:
    start = time.process_time()  # of all threads: other programs do not count
    with torch.autocast("cpu", torch.bfloat16, enabled=half, cache_enabled=False):
        loss = module.losses(batch, module.weights)[0]
    torch.autograd.backward(loss)
    seconds = time.process_time() - start
    module.zero_grad()
    return seconds
