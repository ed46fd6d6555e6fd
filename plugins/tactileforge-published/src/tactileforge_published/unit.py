"""UniT: a VQGAN of a single object under a GelSight Mini with markers."""

from __future__ import annotations

from typing import Any

import torch

from tactileforge.encoders import AS_THEY_ARE
from tactileforge_published.layout import (
    ConversionPlan,
    Keys,
    State,
    WeightLayout,
    depth_of,
)
from tactileforge_published.vqgan import VqganEncoder

#: Height and width of frames in training on the key; the files do not hold them.
_SIZE = [128, 160]


def _plan(state: State) -> ConversionPlan:
    """Plans the conversion; its frames are blue, green, red, so those channels are reversed."""
    levels = range(depth_of(state, "encoder.down"))
    options: dict[str, Any] = {
        "channels": [len(state[f"encoder.down.{i}.block.0.conv1.weight"]) for i in levels],
        "blocks": depth_of(state, "encoder.down.0.block"),
        "attention": [i for i in levels if f"encoder.down.{i}.attn.0.q.weight" in state],
        "latent": len(state["quant_conv.weight"]),
        "frames": 1,
        "image_size": list(_SIZE),
        "spacing": 0.0,
        "pixels": dict(AS_THEY_ARE),
    }
    # for its names alone: nothing is computed
    with torch.device("meta"):
        names = VqganEncoder(**options).state_dict()
    keys: Keys = {name: f"{'' if name[:6] == 'quant_' else 'encoder.'}{name}" for name in names}
    return ConversionPlan("vqgan", options, keys, {"conv_in.weight": lambda x: x.flip(1)})


LAYOUT = WeightLayout(
    name="unit",
    title="UniT",
    marks={
        "encoder.conv_in.weight": (None, 3, 3, 3),
        "encoder.mid.attn_1.q.weight": (None, None, 1, 1),
        "encoder.conv_out.weight": (3, None, 3, 3),
        "quant_conv.weight": (3, 3, 1, 1),
        "quantize.embedding.weight": (1024, 3),
    },
    plan=_plan,
    prefixes=("", "vqgan."),
    unused={
        "decoder.*": "decoder",
        "post_quant_conv.*": "decoder",
        "quantize.*": "code book: its map is read before it is looked up",
        "loss.*": "losses of training",
    },
    outside="head of a task",
)
