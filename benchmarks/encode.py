"""Encoding of clips, against Hugging Face's CLIP vision tower on as many tokens.

10 x 11 patches in 2 slots and 6 prefix tokens are 226 tokens, as are 15 x 15 patches and a class
token. At the recipe's size, 398 tokens are compared with the nearest square, 401. Ours includes
preprocessing from uint8.

Run: python benchmarks/encode.py
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import torch
from common import ratio, save, side_by_side
from transformers import CLIPVisionConfig, CLIPVisionModel

from tactileforge.encoders import TactileViT


def ours(size: int | Sequence[int], batch: int) -> tuple[Callable[[], object], int]:
    """Our encoder on a batch of 4-frame clips, and its number of tokens."""
    encoder = TactileViT("base", frames=4, image_size=size).eval()
    frames = torch.randint(0, 256, (batch, 4, 3, *encoder.image_size), dtype=torch.uint8)
    rows = encoder.sensor_ids(["digit"] * batch)
    with torch.no_grad():
        tokens = encoder(frames, frames[:, 0], rows)[0].shape[1]
    return lambda: encoder(frames, frames[:, 0], rows), tokens


def clip(size: int, batch: int) -> tuple[Callable[[], object], int]:
    """CLIP's ViT-B/16 vision tower at a size, and its number of tokens."""
    tower = CLIPVisionModel(
        CLIPVisionConfig(
            hidden_size=768,
            intermediate_size=3072,
            num_hidden_layers=12,
            num_attention_heads=12,
            image_size=size,
            patch_size=16,
            hidden_act="gelu",
        )
    ).eval()
    pixels = torch.randn(batch, 3, size, size)
    return lambda: tower(pixel_values=pixels), (size // 16) ** 2 + 1


def main() -> None:
    built = {
        "tactile_vit, 226 tokens": ours((160, 176), 4),
        "clip, 226 tokens": clip(240, 4),
        "tactile_vit, 398 tokens": ours(224, 4),
        "clip, 401 tokens": clip(320, 4),
    }
    for name, (_, tokens) in built.items():
        assert str(tokens) in name
    with torch.inference_mode():
        times = side_by_side({name: call for name, (call, _) in built.items()}, rounds=9, warmup=1)
    save(
        "encode",
        {
            "what": "encoder(frames) for 4 clips, base, fp32",
            "times": times,
            "times as fast as CLIP, 226 tokens": ratio(
                times, "tactile_vit, 226 tokens", "clip, 226 tokens"
            ),
            "times as fast as CLIP, 398 against 401 tokens": ratio(
                times, "tactile_vit, 398 tokens", "clip, 401 tokens"
            ),
        },
    )


if __name__ == "__main__":
    main()
