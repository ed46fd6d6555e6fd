"""The masked decoder with tokens sorted by visibility, against one with tokens sorted by place.

The latter computes all tokens in its last block too, and gathers the masked ones. Forward and
backward, the paper's size, in turn in one process on one thread; medians of CPU time
(`time.process_time`).

Run: python benchmarks/decoder.py
"""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial
from typing import Any

import torch
from common import ratio, save, side_by_side
from torch import Tensor

from tactileforge.contracts import MaskedFeatures
from tactileforge.encoders import TactileViT
from tactileforge.heads import MaskedDecoder
from tactileforge.heads.decoder import masked_patches

BATCH, ROUNDS = 1, 6
SLOTS, PATCHES, PREFIX = 2, 196, 6


def by_place(decoder: MaskedDecoder, features: MaskedFeatures) -> Tensor:
    """The former decoder, with tokens sorted by place."""
    x = decoder.embed(features.tokens)
    prefix, visible = x.split([features.prefix, x.shape[1] - features.prefix], dim=1)
    tokens = decoder._placed(visible.unflatten(1, (SLOTS, -1)), features)
    tokens = tokens + decoder.position.flatten(1, 2)
    x = decoder.transformer(torch.cat([prefix, tokens.flatten(1, 2)], dim=1))
    x = x[:, features.prefix :].unflatten(1, (SLOTS, -1))
    out: Tensor = decoder.predict(decoder.norm(masked_patches(x, features)))
    return out


def main() -> None:
    torch.set_num_threads(1)
    encoder: Any = TactileViT("base", depth=0)
    decoder = MaskedDecoder(encoder, 512, 6, 8)
    order = torch.rand(BATCH, PATCHES).argsort(1)
    kept, masked = order[:, :49].sort(1).values, order[:, 49:].sort(1).values
    tokens = torch.randn(BATCH, PREFIX + SLOTS * 49, 512, requires_grad=True)
    features = MaskedFeatures(tokens, tokens[:, 0], kept, masked, PREFIX, encoder.grid)

    def decode(way: Callable[[MaskedDecoder, MaskedFeatures], Tensor]) -> None:
        torch.autograd.backward(way(decoder, features).square().mean())

    ways = {"by place": by_place, "by visibility": MaskedDecoder.__call__}
    subjects = {name: partial(decode, way) for name, way in ways.items()}
    times = side_by_side(subjects, ROUNDS, clock=time.process_time)
    save(
        "decoder",
        {
            "what": f"decoder of 512 x 6, {BATCH} clip of 4 frames of 224 x 224, fp32",
            "how": f"CPU seconds of one thread, median of {ROUNDS} rounds, in turn",
            "cpu_s": {name: round(value["median_s"], 4) for name, value in times.items()},
            "times as fast": ratio(times, "by visibility", "by place"),
        },
    )


if __name__ == "__main__":
    main()
