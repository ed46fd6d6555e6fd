"""A training step of AnyTouch 2 against Hugging Face's VideoMAE of equal size.

Both take a batch of 4-frame clips at 224 x 224, mask 75 % of the tubes, and do forward, backward
and an AdamW step in fp32. Ours starts from uint8 frames, and subtracts, normalises and patchifies
them; VideoMAE is given finished floats. Our two decoders have 6 layers each, so the peer of equal
size has one of 12; one of 6 layers (half our decoding) is timed too.

Run: python benchmarks/train_step.py
"""

from __future__ import annotations

from collections.abc import Callable

import torch
from common import ratio, save, side_by_side
from torch import nn
from transformers import VideoMAEConfig, VideoMAEForPreTraining

from tactileforge.compose import compose
from tactileforge.contracts import Batch
from tactileforge.module import TouchModule
from tactileforge.testing import batch as make_batch

BATCH = 4


def our_step(names: list[str]) -> tuple[Callable[[], None], int]:
    """A step with some objectives, and its number of parameters."""
    from omegaconf import OmegaConf

    config = OmegaConf.to_container(
        compose("anytouch2", [f"objective=[{','.join(names)}]"]), resolve=True
    )
    assert isinstance(config, dict)
    module = TouchModule.from_config({str(k): v for k, v in config.items()}, {"text", "image"})
    batch: Batch = make_batch(size=BATCH, frames=4, image=224)
    weights = dict.fromkeys(names, 1.0)

    def loss() -> torch.Tensor:
        return module.losses(batch, weights)[0]

    return stepper(module, loss)


def videomae_step(layers: int) -> tuple[Callable[[], None], int]:
    """A step of VideoMAE with our encoder's size and a decoder of so many layers."""
    config = VideoMAEConfig(
        image_size=224,
        patch_size=16,
        num_frames=4,
        tubelet_size=2,
        decoder_hidden_size=512,
        decoder_num_hidden_layers=layers,
        decoder_num_attention_heads=8,
        decoder_intermediate_size=2048,
        norm_pix_loss=False,
    )
    module = VideoMAEForPreTraining(config)
    pixels = torch.randn(BATCH, 4, 3, 224, 224)
    hidden = torch.rand(BATCH, 196).argsort(1).argsort(1) >= 49
    mask = hidden.repeat(1, 2)

    def loss() -> torch.Tensor:
        out: torch.Tensor = module(pixels, bool_masked_pos=mask).loss
        return out

    return stepper(module, loss)


def stepper(module: nn.Module, loss: Callable[[], torch.Tensor]) -> tuple[Callable[[], None], int]:
    """Forward, backward and an AdamW step."""
    optimizer = torch.optim.AdamW(module.parameters(), lr=1e-4)

    def step() -> None:
        optimizer.zero_grad()
        torch.autograd.backward(loss())
        optimizer.step()

    return step, sum(p.numel() for p in module.parameters())


def main() -> None:
    five = ["pixel", "diff", "align", "match", "force"]
    built = {
        "pixel+diff": our_step(["pixel", "diff"]),
        "videomae_12": videomae_step(12),
        "videomae_6": videomae_step(6),
        "pixel": our_step(["pixel"]),
        "all five": our_step(five),
    }
    times = side_by_side({name: step for name, (step, _) in built.items()}, rounds=5)
    save(
        "train_step",
        {
            "what": f"training step, base, batch of {BATCH}, 4 frames of 224 x 224, fp32",
            "parameters": {name: count for name, (_, count) in built.items()},
            "times": times,
            "pixel+diff, times as fast as videomae of equal size": ratio(
                times, "pixel+diff", "videomae_12"
            ),
            "pixel+diff, times as fast as videomae with one decoder of 6": ratio(
                times, "pixel+diff", "videomae_6"
            ),
            "pixel alone, times as fast as videomae with one decoder of 6": ratio(
                times, "pixel", "videomae_6"
            ),
            "all five, multiple of pixel+diff": round(
                1 / ratio(times, "all five", "pixel+diff"), 3
            ),
        },
    )


if __name__ == "__main__":
    main()
