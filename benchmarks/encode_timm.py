"""Batch encoding by the shipped models, against timm's networks: time for equal operations.

`Model.encode` takes clips of uint8 of the encoder's size, subtracts their background and gives its
features; timm's networks take images of uint8, brought to float32 and normalised. Operations are
those of products of matrices and convolutions, counted by torch. Transformers are compared with
timm's ViT of equal width, depth and image, a network of photographs with timm's EfficientNet-Lite0,
and the model with both with both; all with random weights there, which take as long.

Run: python benchmarks/encode_timm.py, where timm is installed
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import timm
import torch
from common import save, side_by_side
from torch.utils.flop_counter import FlopCounterMode

import tactileforge

#: Clips of a batch.
BATCH = 32
#: Networks of timm, with their options, and those beside each model.
NETWORKS: dict[str, dict[str, Any]] = {
    "vit_tiny_patch16_224": {"depth": 4, "img_size": 128},
    "tf_efficientnet_lite0": {},
}
PEERS = {
    "anytouch2.tiny": ["vit_tiny_patch16_224"],
    "anytouch2.tiny-real": ["vit_tiny_patch16_224", "tf_efficientnet_lite0"],
    "touch.tiny": ["tf_efficientnet_lite0"],
}


def operations(call: Callable[[], object]) -> float:
    """Operations of a call, in billions."""
    with FlopCounterMode(display=False) as counter:
        call()
    return float(counter.get_total_flops()) / 1e9


def ours(name: str) -> Callable[[], object]:
    """Encoding of a batch of clips by a shipped model."""
    model = tactileforge.load(name)
    height, width = model.encoder.image_size
    shape = (BATCH, model.encoder.frames, height, width, 3)
    clips = np.random.default_rng(0).integers(0, 256, shape, np.uint8)
    sensor = model.sensors[0]
    return lambda: model.encode(clips, "first", sensor, checks=False)


def theirs(names: Sequence[str]) -> Callable[[], object]:
    """Networks of timm on two images of 128 x 128 a clip, as many as ours have slots of time."""
    networks = [
        timm.create_model(name, pretrained=False, num_classes=0, **NETWORKS[name]).eval()
        for name in names
    ]
    images = torch.randint(0, 256, (2 * BATCH, 3, 128, 128), dtype=torch.uint8)
    mean, std = torch.full((3, 1, 1), 0.45), torch.full((3, 1, 1), 0.22)

    def call() -> object:
        with torch.inference_mode():
            pixels = (images.float() / 255 - mean) / std
            return [network(pixels) for network in networks]

    return call


def main() -> None:
    calls = {name: ours(name) for name in PEERS}
    calls |= {f"timm beside {name}": theirs(peers) for name, peers in PEERS.items()}
    billions = {name: operations(call) for name, call in calls.items()}
    times = side_by_side(calls, rounds=9, warmup=1)
    rows = {}
    for name, networks in PEERS.items():
        each = {
            key: times[key]["median_s"] / billions[key] for key in (name, f"timm beside {name}")
        }
        rows[name] = {
            "timm": networks,
            "operations, billions": round(billions[name], 2),
            "operations of timm's, billions": round(billions[f"timm beside {name}"], 2),
            "clips a second": round(BATCH / times[name]["median_s"], 1),
            "time for equal operations": round(each[name] / each[f"timm beside {name}"], 3),
        }
    save("encode_timm", {"what": __doc__, "models": rows, "times": times})


if __name__ == "__main__":
    main()
