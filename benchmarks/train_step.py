"""A training step of AnyTouch 2 (base) against Hugging Face's VideoMAE of equal size, fp32.

Both take a batch of 4-frame clips at 224 x 224, mask 75 % of the tubes, and do forward, backward
and a fused AdamW step. Ours starts from uint8 frames, and subtracts, normalises and patchifies
them; VideoMAE is given finished floats. Our two decoders have 6 layers each, the peer's one has 12.

Steps take turns in one process, on one thread, with a matrix product between them. CPU seconds
count (`time.process_time`), excluding other programs; the medians leave out the first round.
Operations are `train_subjects.step_flops`, and those of all five objectives are counted by torch;
the share is relative to the rate of the matrix product.

Run: python train_step.py
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable

import torch
from common import save
from gpu_train import count
from train_subjects import Case, build, step_flops

BATCH, ROUNDS, SIDE = 2, 7, 1024


def stepper(case: Case) -> tuple[Callable[[], object], int]:
    """A training step, and its number of operations."""
    subject = build(case)
    flops = step_flops(case) or count(subject, subject.batch, torch.device("cpu"))
    optimizer = torch.optim.AdamW(subject.module.parameters(), lr=1e-4, fused=True)

    def step() -> None:
        torch.autograd.backward(subject.loss(subject.batch))
        optimizer.step()
        optimizer.zero_grad()

    return step, flops


def main() -> None:
    torch.set_num_threads(1)
    names = ("pixel+diff", "videomae", "all five")
    built = {name: stepper(Case(name, "base", batch=BATCH)) for name in names}
    matrix = torch.randn(SIDE, SIDE)
    built["matrix product"] = (lambda: matrix @ matrix), 2 * SIDE**3
    times: dict[str, list[float]] = {name: [] for name in built}
    for _ in range(ROUNDS):
        for name, (step, _) in built.items():
            start = time.process_time()
            step()
            times[name].append(time.process_time() - start)
    cpu = {name: statistics.median(values[1:]) for name, values in times.items()}
    rate = {name: flops / cpu[name] for name, (_, flops) in built.items()}
    ours = built["pixel+diff"][1]
    save(
        "train_step",
        {
            "what": f"training step, base, batch of {BATCH}, 4 frames of 224 x 224, fp32",
            "how": f"CPU seconds of one thread, median of {ROUNDS - 1} rounds, in turn",
            "cpu_s": {name: round(value, 3) for name, value in cpu.items()},
            "cpu_s of each round": times,
            "operations": {name: flops for name, (_, flops) in built.items()},
            "operations, multiple of pixel+diff": {
                name: round(built[name][1] / ours, 3) for name in names
            },
            "share of the rate of a matrix product": {
                name: round(rate[name] / rate["matrix product"], 3) for name in names
            },
            "pixel+diff, times as fast as videomae of equal size": round(
                cpu["videomae"] / cpu["pixel+diff"], 3
            ),
            "all five, multiple of pixel+diff": round(cpu["all five"] / cpu["pixel+diff"], 3),
        },
    )


if __name__ == "__main__":
    main()
