"""A training step on a CPU, numbers below 1e-38 kept, and set to 0 as in `threads.flushed`.

A decoder that starts at the neighbours (``scale=tiny``) looks elsewhere with weights as small as
that. Both take turns in one process, on one thread. CPU time counts, so that other programs do not;
medians are kept, without the first round.

Run: python benchmarks/denormals.py
"""

from __future__ import annotations

import statistics
import time
from typing import Any

import torch
from common import save
from omegaconf import OmegaConf

from tactileforge.compose import compose
from tactileforge.module import TouchModule
from tactileforge.testing import batch as make_batch

BATCH, ROUNDS = 16, 6
OPTIONS = ["scale=tiny", "encoder.depth=4", "objective=[pixel,diff]"]


def main() -> None:
    torch.set_num_threads(1)
    config: Any = OmegaConf.to_container(compose("anytouch2", OPTIONS), resolve=True)
    module = TouchModule.from_config(config, {"text", "image"})
    batch = make_batch(size=BATCH, frames=4, image=128)
    seconds: dict[str, list[float]] = {"kept": [], "flushed": []}
    losses: dict[str, float] = {}
    for _ in range(ROUNDS):
        for name, spent in seconds.items():
            torch.set_flush_denormal(name == "flushed")
            torch.manual_seed(0)
            module.zero_grad()
            start = time.process_time()
            loss: Any = module.losses(batch, {"pixel": 1.0, "diff": 1.0})[0]
            loss.backward()
            spent.append(time.process_time() - start)
            losses[name] = loss.item()
    median = {name: statistics.median(spent[1:]) for name, spent in seconds.items()}
    save(
        "denormals",
        {
            "what": f"a step of pixel + diff, scale=tiny, {BATCH} clips, before its first update",
            "how": f"CPU seconds of one thread, median of {ROUNDS - 1} rounds, in turn",
            "cpu_s": {name: round(value, 3) for name, value in median.items()},
            "flushed, times as fast": round(median["kept"] / median["flushed"], 2),
            "loss": losses,
        },
    )


if __name__ == "__main__":
    main()
