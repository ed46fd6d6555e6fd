"""Parts of a training step of AnyTouch 2 (base, pixel + diff), and gains of fused AdamW and bf16.

Parts take turns in one process, on one thread. CPU time counts (`time.process_time`), excluding
other programs; the medians leave out the first round.

Run: python benchmarks/step_parts.py
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Sequence
from typing import Any

import torch
from common import save
from omegaconf import OmegaConf
from torch import Tensor

from tactileforge import compose
from tactileforge.testing import batch as make_batch
from tactileforge.training import TouchModule

BATCH, ROUNDS = 2, 4
PARTS = (
    "forward",
    "backward",
    "clipping",
    "AdamW, a loop",
    "AdamW, fused",
    "forward, bf16",
    "backward, bf16",
)


def timed(what: Callable[[], Any]) -> tuple[float, Any]:
    """CPU seconds and result of a call."""
    start = time.process_time()
    out = what()
    return time.process_time() - start, out


def main() -> None:
    torch.set_num_threads(1)
    config: Any = OmegaConf.to_container(
        compose("anytouch2", ["objective=[pixel,diff]"]), resolve=True
    )
    module = TouchModule.from_config(config, {"text", "image"})
    batch = make_batch(size=BATCH, frames=4, image=224)
    parameters = [p for p in module.parameters() if p.requires_grad]
    loop = torch.optim.AdamW(parameters, lr=1e-4)
    fused = torch.optim.AdamW(parameters, lr=1e-4, fused=True)

    def loss() -> Tensor:
        return module.losses(batch, {"pixel": 1.0, "diff": 1.0})[0]

    rounds = []
    for _ in range(ROUNDS):
        module.zero_grad()
        forward, out = timed(loss)
        backward, _ = timed(out.backward)
        clipping, _ = timed(lambda: torch.nn.utils.clip_grad_norm_(parameters, 1.0))
        updates = timed(loop.step)[0], timed(fused.step)[0]
        module.zero_grad()
        with torch.autocast("cpu", torch.bfloat16):
            forward_half, out = timed(loss)
        rounds.append((forward, backward, clipping, *updates, forward_half, timed(out.backward)[0]))
    keep(rounds)


def keep(rounds: Sequence[tuple[float, ...]]) -> None:
    """Writes medians, and shares and ratios of them."""
    of = dict(zip(PARTS, map(statistics.median, zip(*rounds[1:], strict=True)), strict=True))
    work = of["forward"] + of["backward"]
    half = of["forward, bf16"] + of["backward, bf16"]
    before, after, low = (
        number + of["clipping"] + of[optimiser]
        for number, optimiser in (
            (work, "AdamW, a loop"),
            (work, "AdamW, fused"),
            (half, "AdamW, fused"),
        )
    )
    save(
        "step_parts",
        {
            "what": f"parts of a training step, base, {BATCH} clips of 4 frames of 224 x 224",
            "how": f"CPU seconds of one thread, median of {len(rounds) - 1} rounds, in turn",
            "cpu_s": {name: round(value, 3) for name, value in of.items()},
            "share of AdamW before and after": [
                round(of["AdamW, a loop"] / before, 3),
                round(of["AdamW, fused"] / after, 3),
            ],
            "AdamW fused, times as fast": round(of["AdamW, a loop"] / of["AdamW, fused"], 2),
            "step with AdamW fused, times as fast": round(before / after, 3),
            "bf16, forward and backward, times as fast": round(work / half, 2),
            "bf16, step with AdamW fused, times as fast": round(after / low, 2),
        },
    )


if __name__ == "__main__":
    main()
