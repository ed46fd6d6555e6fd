"""A CPU training step with denormals (below 1e-38) kept, and flushed to 0 as in `threads.flushed`.

A decoder initialised to attend to neighbours (``scale=tiny``) has attention weights as small as
that elsewhere. Both take turns in one process, on one thread. CPU time counts, excluding other
programs; the medians leave out the first round.

Run: python benchmarks/denormals.py
"""

from __future__ import annotations

import time
from functools import partial
from typing import Any

import torch
from common import ratio, save, side_by_side
from omegaconf import OmegaConf

from tactileforge import compose
from tactileforge.testing import batch as make_batch
from tactileforge.training import TouchModule

BATCH, ROUNDS = 16, 5
OPTIONS = ["scale=tiny", "encoder.depth=4", "objective=[pixel,diff]"]


def main() -> None:
    torch.set_num_threads(1)
    config: Any = OmegaConf.to_container(compose("anytouch2", OPTIONS), resolve=True)
    module = TouchModule.from_config(config, {"text", "image"})
    batch = make_batch(size=BATCH, frames=4, image=128)
    losses: dict[str, float] = {}

    def step(name: str) -> None:
        torch.set_flush_denormal(name == "flushed")
        torch.manual_seed(0)
        module.zero_grad()
        loss: Any = module.losses(batch, {"pixel": 1.0, "diff": 1.0})[0]
        loss.backward()
        losses[name] = loss.item()

    subjects = {name: partial(step, name) for name in ("kept", "flushed")}
    times = side_by_side(subjects, ROUNDS, clock=time.process_time)
    save(
        "denormals",
        {
            "what": f"a step of pixel + diff, scale=tiny, {BATCH} clips, before its first update",
            "how": f"CPU seconds of one thread, median of {ROUNDS} rounds, in turn",
            "cpu_s": {name: round(value["median_s"], 3) for name, value in times.items()},
            "flushed, times as fast": ratio(times, "flushed", "kept"),
            "loss": losses,
        },
    )


if __name__ == "__main__":
    main()
