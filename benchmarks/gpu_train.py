"""Training on one GPU: clips per second, MFU, memory, and cost of the loader; under 8 minutes.

A step is forward in bf16 autocast, backward, clipping and fused AdamW; ours also preprocesses
uint8 frames. The peer is `VideoMAEForPreTraining` of transformers, of equal size (a decoder of 12
layers, for our two of 6), on preprocessed floats. MFU is `train_subjects.step_flops` over time and
the GPU's dense bf16 peak; the count of `torch.utils.flop_counter` for the same step is reported
beside it. Every row is written as soon as it is measured, so a stopped run keeps its rows.

Run: python gpu_train.py
Smoke test without a GPU: python gpu_train.py --tiny --device cpu
"""

from __future__ import annotations

import argparse
import dataclasses
import gc
import statistics
import time
from collections.abc import Callable, Iterator
from itertools import chain, repeat
from pathlib import Path
from typing import Any

import torch
from common import RESULTS, write
from torch.nn.attention import SDPBackend, sdpa_kernel
from torch.utils.flop_counter import FlopCounterMode
from train_subjects import Case, Subject, build, config_of, step_flops

from tactileforge.contracts import Batch
from tactileforge.data.batches.transfer import Transfer, pin
from tactileforge.data.labels.augment import fill_captions
from tactileforge.training import build_data
from tactileforge.training.speed import peak_of
from tactileforge.util.processes import cpus

#: Timed duration of a row, s; warm-up steps; and largest number of timed steps.
SECONDS, WARMUP, STEPS = 3.0, 3, 60
#: Steps per synchronisation: waiting after each would add its launch latency to the time.
ROUND = 5
GIB = 2**30


def cases() -> list[Case]:
    """Cases to measure, the most important first."""
    pair = ("pixel+diff", "videomae")
    eager = [
        Case(subject, size, batch=batch)
        for size, batch in (("base", 64), ("large", 32))
        for subject in pair
    ]
    compiled = [Case(subject, "base", compiled=True) for subject in pair]
    # touches for many batches an epoch: a loader reads no batch of the next epoch ahead
    many: dict[str, Any] = {"data": "loader", "scenes": 96}
    loaded = [Case("pixel+diff", "base", compiled=True, data="host")]
    loaded += [Case("pixel+diff", "base", compiled=True, **many)]
    small = [Case(subject, size, batch=128) for size in ("tiny", "small") for subject in pair]
    small += [Case("pixel+diff", "tiny", batch=128, **many)]
    five = [Case("all five", "base")]
    long = [
        Case(subject, "base", frames, batch)
        for frames, batch in ((2, 128), (8, 32), (16, 16))
        for subject in pair
    ]
    growth = [Case("pixel+diff", "base", batch=batch) for batch in (8, 32, 128)]
    growth += [Case("videomae", "base", batch=batch) for batch in (8, 32)]
    deep = [Case("pixel+diff", "large", frames, batch) for frames, batch in ((2, 64), (16, 8))]
    slow = [Case(subject, "large", batch=32, compiled=True) for subject in pair]
    slow += [Case("all five", "base", compiled=True)]
    slow += [Case("pixel+diff", size, batch=128, compiled=True) for size in ("small", "tiny")]
    return [*eager, *compiled, *loaded, *small, *five, *long, *growth, *deep, *slow]


def tiny_cases() -> list[Case]:
    """Each kind of row once, for a machine without a GPU."""
    size: dict[str, Any] = {"size": "tiny", "frames": 2, "image": 32, "layers": 1, "scenes": 3}
    rows = [Case(name, batch=4, **size) for name in ("pixel+diff", "videomae", "all five")]
    rows += [Case("pixel+diff", batch=2, **size), Case("pixel+diff", batch=0, **size)]
    return [*rows, *(Case("all five", batch=4, data=x, **size) for x in ("host", "loader"))]


def measure(case: Case, device: torch.device, seconds: float, steps: int) -> dict[str, Any]:
    """Times a case.

    Args:
        case: One of `cases`.
        device: Device of the step.
        seconds: Duration of timing, s; at least two rounds are timed.
        steps: Steps of a round.

    Returns:
        Clips per second, MFU, memory and operations; None for values unknown on this device.
    """
    begun = time.perf_counter()
    subject = build(case)
    subject.module.to(device)
    step = stepper(subject, device)
    batches = source(case, subject, device)
    counted = count(subject, next(batches), device)
    if device.type == "cuda":
        torch.cuda.reset_peak_memory_stats()
    for _ in range(WARMUP):
        step(next(batches))
    finish(device)
    ready = time.perf_counter() - begun
    times = timed(lambda: step(next(batches)), device, seconds, steps)
    per_step = statistics.median(times)
    flops = step_flops(case)
    peak = peak_of(torch.cuda.get_device_name()) if device.type == "cuda" else None
    return {
        "clips_per_s": case.batch / per_step,
        "step_s": per_step,
        "step_s_min_max": [min(times), max(times)],
        "mfu": (flops or counted) / per_step / peak if peak else None,
        "flops": flops or None,
        "flops_counted": counted,
        "memory_gib": torch.cuda.max_memory_allocated() / GIB if device.type == "cuda" else None,
        "seconds_before": ready,
        "parameters": sum(p.numel() for p in subject.module.parameters()),
    }


def stepper(subject: Subject, device: torch.device) -> Callable[[Batch], None]:
    """A training step of a subject, for batches on its device."""
    parameters = [p for p in subject.module.parameters() if p.requires_grad]
    optimizer = torch.optim.AdamW(parameters, lr=1e-4, fused=True)

    def step(batch: Batch) -> None:
        with torch.autocast(device.type, torch.bfloat16):
            loss = subject.loss(batch)
        torch.autograd.backward(loss)
        torch.nn.utils.clip_grad_norm_(parameters, 1.0)
        optimizer.step()
        optimizer.zero_grad()

    return step


def source(case: Case, subject: Subject, device: torch.device) -> Iterator[Batch]:
    """An endless iterator of a case's batches on the device."""
    transfer = Transfer()
    if case.data == "resident":
        return repeat(transfer(subject.batch, device))
    if case.data == "host":
        kept = pin(subject.batch) if device.type == "cuda" else subject.batch
        return (transfer(kept, device) for _ in repeat(None))
    config = config_of(case)
    config["batch"] |= {"workers": max(1, cpus() - 1)}
    data, _ = build_data(config)
    loader = data.train_dataloader()
    return (transfer(_captioned(x), device) for x in chain.from_iterable(repeat(loader)))


def _captioned(batch: Batch) -> Batch:
    fill_captions(batch)
    return batch


def count(subject: Subject, batch: Batch, device: torch.device) -> int:
    """Operations of a step, counted by torch with attention as matrix products.

    Blocks run uncompiled: a block that torch first sees under a counter is never compiled.
    """
    counter = FlopCounterMode(display=False)
    few = {key: value[:1] for key, value in batch.items() if key not in ("skipped", "paired")}
    size = len(batch["frames"])
    stance = torch.compiler.set_stance("force_eager")
    autocast = torch.autocast(device.type, torch.bfloat16)
    with stance, counter, sdpa_kernel(SDPBackend.MATH), autocast:
        torch.autograd.backward(subject.loss(few))
    subject.module.zero_grad()
    return counter.get_total_flops() * size


def timed(
    step: Callable[[], None], device: torch.device, seconds: float, steps: int
) -> list[float]:
    """Seconds per step, in rounds of some steps with one synchronisation at their end."""
    times: list[float] = []
    end = time.perf_counter() + seconds
    while len(times) < 2 or (time.perf_counter() < end and steps * len(times) < STEPS):
        start = time.perf_counter()
        for _ in range(steps):
            step()
        finish(device)
        times.append((time.perf_counter() - start) / steps)
    return times


def finish(device: torch.device) -> None:
    """Waits for the device."""
    if device.type == "cuda":
        torch.cuda.synchronize()


def attempt(case: Case, device: torch.device, seconds: float, steps: int) -> dict[str, Any]:
    """A row of measurements, or of the error; frees memory."""
    row = dataclasses.asdict(case)
    try:
        row |= measure(case, device, seconds, steps)
    except torch.OutOfMemoryError:
        row["error"] = "out of memory"
    except Exception as error:  # a failed row must not end the others
        row["error"] = f"{type(error).__name__}: {str(error)[:300]}"
    torch.compiler.reset()
    gc.collect()
    if device.type == "cuda":
        torch.cuda.empty_cache()
    return row


def summary(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Ratios to VideoMAE, cost of loading, and memory per clip, from the measured rows."""
    known = {_key(row): row for row in rows if "clips_per_s" in row}
    found: dict[str, Any] = {}
    for key, row in known.items():
        subject, size, frames, batch, compiled, data = key
        name = f"{size}, {frames} frames, batch of {batch}" + ", compiled" * compiled
        peer = known.get(("videomae", *key[1:]))
        if subject == "pixel+diff" and peer:
            found[f"{name}: times as fast as VideoMAE"] = row["clips_per_s"] / peer["clips_per_s"]
        resident = known.get((*key[:5], "resident"))
        if data != "resident" and resident:
            share = row["clips_per_s"] / resident["clips_per_s"]
            found[f"{name}, {subject}: {data}, share of resident"] = share
        least = [r for k, r in known.items() if k[:3] == key[:3] and k[4:] == key[4:]]
        low = min(least, key=lambda r: r["batch"])
        if row["memory_gib"] and low["batch"] < batch:
            grown = (row["memory_gib"] - low["memory_gib"]) / (batch - low["batch"])
            found[f"{name}, {subject}: GiB a clip"] = grown
    return {key: round(value, 4) for key, value in found.items()}


def _key(row: dict[str, Any]) -> tuple[str, str, int, int, bool, str]:
    fields = ("subject", "size", "frames", "batch", "compiled", "data")
    return tuple(row[name] for name in fields)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--device", default="cuda" if torch.cuda.is_available() else "cpu")
    parser.add_argument("--tiny", action="store_true", help="each kind of row once, in seconds")
    parser.add_argument("--compiled", action="store_true", help="compiled rows alone")
    parser.add_argument("--minutes", type=float, default=7.5, help="no row starts after that")
    parser.add_argument("--out", type=Path, default=RESULTS / "gpu_train.json")
    options = parser.parse_args()
    device = torch.device(options.device)
    end = time.perf_counter() + 60 * options.minutes
    torch.set_float32_matmul_precision("high")
    duration, steps = (0.0, 1) if options.tiny else (SECONDS, ROUND)
    rows: list[dict[str, Any]] = []
    chosen = tiny_cases() if options.tiny else cases()
    for case in [one for one in chosen if one.compiled] if options.compiled else chosen:
        if time.perf_counter() < end:
            rows.append(attempt(case, device, duration, steps))
        else:
            rows.append(dataclasses.asdict(case) | {"error": "out of time: --minutes"})
        what = "a training step in bf16 on one device; memory_gib is the peak, mfu of step_flops"
        write(options.out, {"what": what, "summary": summary(rows), "rows": rows})


if __name__ == "__main__":
    main()
