"""What a training step of AnyTouch 2 (base) is made of, and what each change to it is worth.

Parts and variants take turns in one process, on one thread. CPU time counts (`process_time`), so
that other programs do not, and medians are kept. "before" is a decoder that puts tokens in the
order of their places and reads for all of them in its last block, with the optimiser as a loop.

Run: python benchmarks/step_parts.py
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from typing import Any

import torch
from common import save
from omegaconf import OmegaConf
from torch import Tensor
from train_step import videomae_step

from tactileforge.compose import compose
from tactileforge.contracts import MaskedFeatures
from tactileforge.heads.decoder import MaskedDecoder, masked_patches
from tactileforge.module import TouchModule
from tactileforge.testing import batch as make_batch

BATCH, ROUNDS = 2, 3
FIVE = ("pixel", "diff", "align", "match", "force")


def build(names: tuple[str, ...]) -> TouchModule:
    """AnyTouch 2 in the paper's size."""
    composed = compose("anytouch2", [f"objective=[{','.join(names)}]"])
    config: Any = OmegaConf.to_container(composed, resolve=True)
    return TouchModule.from_config(config, {"text", "image"})


def decode_all(decoder: MaskedDecoder, features: MaskedFeatures) -> Tensor:
    """The decoder as it was: every token at its place, and read for in every block."""
    slots = features.grid[0]
    x = decoder.embed(features.tokens)
    prefix, visible = x.split([features.prefix, x.shape[1] - features.prefix], dim=1)
    tokens = decoder._placed(visible.unflatten(1, (slots, -1)), features)
    tokens = tokens + decoder.position.flatten(1, 2)
    x = decoder.transformer(torch.cat([prefix, tokens.flatten(1, 2)], dim=1))
    x = x[:, features.prefix :].unflatten(1, (slots, -1))
    out: Tensor = decoder.predict(decoder.norm(masked_patches(x, features)))
    return out


def subjects() -> dict[str, Callable[[], object]]:
    """Parts of a step and their variants, by name."""
    module, batch = build(FIVE), make_batch(size=BATCH, frames=4, image=224)
    features = module.encoder.views(batch).masked
    tokens = features.tokens.detach().requires_grad_()
    fixed = MaskedFeatures(
        tokens, features.cls, features.kept, features.masked, features.prefix, features.grid
    )
    decoder: Any = module.heads["pixel"].decoder

    def step(names: tuple[str, ...], half: bool = False) -> None:
        with torch.autocast("cpu", torch.bfloat16, enabled=half, cache_enabled=False):
            loss = module.losses(batch, dict.fromkeys(names, 1.0))[0]
        torch.autograd.backward(loss)

    def back(out: Tensor) -> None:
        torch.autograd.backward(out.square().mean())

    step(FIVE)  # every parameter has a gradient
    two = [*module.encoder.parameters()]
    two += [p for key in ("pixel", "diff") for p in module.heads[key].parameters()]
    loop = torch.optim.AdamW(two, lr=1e-6)
    fused = torch.optim.AdamW(two, lr=1e-6, fused=True)
    return {
        "pixel + diff, forward and backward": lambda: step(("pixel", "diff")),
        "pixel + diff, forward and backward, bf16": lambda: step(("pixel", "diff"), True),
        "one decoder, before": lambda: back(decode_all(decoder, fixed)),
        "one decoder": lambda: back(decoder(fixed)),
        "AdamW, before": loop.step,
        "AdamW, fused": fused.step,
        "clipping": lambda: torch.nn.utils.clip_grad_norm_(two, 1.0),
        "VideoMAE of equal size, a whole step": videomae_step(12, BATCH)[0],
        "all five, forward and backward": lambda: step(FIVE),
    }


def main() -> None:
    torch.set_num_threads(1)
    times: dict[str, list[float]] = {}
    built = subjects()
    for number in range(1 + ROUNDS):
        for name, subject in built.items():
            start = time.process_time()
            subject()
            if number:
                times.setdefault(name, []).append(time.process_time() - start)
        if number:
            keep(times, number)


def keep(times: dict[str, list[float]], rounds: int) -> None:
    """Writes what is known after so many rounds."""
    middle = {name: statistics.median(values) for name, values in times.items()}
    work = middle["pixel + diff, forward and backward"]
    half = middle["pixel + diff, forward and backward, bf16"]
    decoders = 2 * (middle["one decoder, before"] - middle["one decoder"])
    after = work + middle["clipping"] + middle["AdamW, fused"]
    before = work + decoders + middle["clipping"] + middle["AdamW, before"]
    share = {
        "decoders": 2 * middle["one decoder"] / after,
        "encoder, preprocessing, losses": (work - 2 * middle["one decoder"]) / after,
        "AdamW": middle["AdamW, fused"] / after,
        "clipping": middle["clipping"] / after,
    }
    halved = half + middle["clipping"] + middle["AdamW, fused"]
    videomae = middle["VideoMAE of equal size, a whole step"]
    save(
        "step_parts",
        {
            "what": f"parts of a training step, base, {BATCH} clips of 4 frames of 224 x 224, fp32",
            "how": f"CPU seconds of one thread, median of {rounds} rounds, variants in turn",
            "cpu_s": {name: round(value, 4) for name, value in middle.items()},
            "share of a step with pixel + diff": {k: round(v, 3) for k, v in share.items()},
            "step now, times as fast as before": round(before / after, 3),
            "AdamW fused, times as fast": round(
                middle["AdamW, before"] / middle["AdamW, fused"], 2
            ),
            "decoder now, times as fast": round(
                middle["one decoder, before"] / middle["one decoder"], 3
            ),
            "bf16, forward and backward, times as fast": round(work / half, 2),
            "bf16, whole step, times as fast": round(after / halved, 2),
            "times as fast as VideoMAE of equal size": round(
                videomae / (after - middle["clipping"]), 3
            ),
            "all five, multiple of pixel + diff, without the optimiser": round(
                middle["all five, forward and backward"] / work, 2
            ),
        },
    )


if __name__ == "__main__":
    main()
