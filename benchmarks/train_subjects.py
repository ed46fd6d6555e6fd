"""Timed training steps: ours and VideoMAE's of equal size, and their operations."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import torch
from omegaconf import OmegaConf
from torch import Tensor, nn

from tactileforge import compose
from tactileforge.contracts import Batch
from tactileforge.encoders import VIT_SIZES
from tactileforge.encoders.compiled import compile_blocks
from tactileforge.testing import batch as make_batch
from tactileforge.training import TouchModule

#: Decoder of each of our two heads: width, heads.
DECODER = (512, 8)
#: Side of a patch (pixels), length of a tube (frames), and masked share of tubes.
PATCH, TUBE, MASK = 16, 2, 0.75
OBJECTIVES = {
    "pixel+diff": ["pixel", "diff"],
    "all five": ["pixel", "diff", "align", "match", "force"],
}


@dataclass(frozen=True)
class Case:
    """A timed training step.

    Attributes:
        subject: ``pixel+diff``, ``all five`` or ``videomae``.
        size: Size of the encoder, a key of `SIZES`.
        frames: Frames per clip.
        batch: Clips per batch.
        compiled: Whether blocks are compiled.
        data: Origin of batches: ``resident`` on the device, ``host`` memory, or ``loader``, decoded
            by workers.
        image: Height and width, pixels.
        layers: Blocks of each of our two decoders.
        scenes: Number of simulated touches of the loader.
    """

    subject: str
    size: str
    frames: int = 4
    batch: int = 64
    compiled: bool = False
    data: str = "resident"
    image: int = 224
    layers: int = 6
    scenes: int = 8


@dataclass(frozen=True)
class Subject:
    """A module, its loss of a batch, and a batch on the host."""

    module: nn.Module
    loss: Callable[[Batch], Tensor]
    batch: Batch


def build(case: Case) -> Subject:
    """Builds a subject on the host."""
    torch.manual_seed(0)
    built = _videomae(case) if case.subject == "videomae" else _ours(case)
    if case.compiled and isinstance(built.module, TouchModule):
        compile_blocks(built.module)
    elif case.compiled:
        for layer in _layers(built.module):
            layer.compile(dynamic=False)
    return built


def config_of(case: Case) -> dict[str, Any]:
    """The configuration of a run of our recipe for a case."""
    names = OBJECTIVES[case.subject]
    words = [f"objective=[{','.join(names)}]", f"encoder.size={case.size}", "data=sim"]
    words += [f"encoder.frames={case.frames}", f"encoder.image_size={case.image}"]
    words += [f"batch.size={case.batch}", f"data.size={case.image}", "data.val=1"]
    # towers that need no download: what is measured is the encoder
    words += [f"data.scenes={case.scenes}", "text_encoder=byte", "image_encoder=vit", "init=null"]
    words += [f"head.{key}.depth={case.layers}" for key in ("pixel", "diff")]
    config: Any = OmegaConf.to_container(compose("anytouch2", words), resolve=True)
    return dict(config)


def _ours(case: Case) -> Subject:
    module = TouchModule.from_config(config_of(case), {"text", "image"})
    weights = dict.fromkeys(OBJECTIVES[case.subject], 1.0)
    batch = make_batch(size=case.batch, frames=case.frames, image=case.image)
    return Subject(module, lambda batch: module.losses(batch, weights)[0], batch)


def _videomae(case: Case) -> Subject:
    from transformers import VideoMAEConfig, VideoMAEForPreTraining

    width, depth, heads = VIT_SIZES[case.size]
    decoder, decoder_heads = DECODER
    module = VideoMAEForPreTraining(
        VideoMAEConfig(
            image_size=case.image,
            patch_size=PATCH,
            num_frames=case.frames,
            tubelet_size=TUBE,
            hidden_size=width,
            num_hidden_layers=depth,
            num_attention_heads=heads,
            intermediate_size=4 * width,
            decoder_hidden_size=decoder,
            decoder_num_hidden_layers=2 * case.layers,  # we have two decoders
            decoder_num_attention_heads=decoder_heads,
            decoder_intermediate_size=4 * decoder,
            norm_pix_loss=False,
            attn_implementation="sdpa",
        )
    )
    count = (case.image // PATCH) ** 2
    hidden = torch.rand(case.batch, count).argsort(1).argsort(1) >= _kept(count)
    batch: Batch = {
        "frames": torch.randn(case.batch, case.frames, 3, case.image, case.image),
        "mask": hidden.repeat(1, case.frames // TUBE),
    }

    def loss(batch: Batch) -> Tensor:
        out: Tensor = module(batch["frames"], bool_masked_pos=batch["mask"]).loss
        return out

    return Subject(module, loss, batch)


def _layers(module: Any) -> list[nn.Module]:
    return [*module.videomae.encoder.layer, *module.decoder.decoder_layers]


def _kept(count: int) -> int:
    return max(1, round(count * (1 - MASK)))


def step_flops(case: Case) -> int:
    """Operations of matrix products of a step, from the sizes alone; 0 for ``all five``.

    A product of (n, k) and (k, m) is 2 n k m; backward counts twice, and recomputation does not
    count. A block of width w on L tokens with R outputs has ``6 L w^2 + 18 R w^2`` in its linear
    layers (queries, keys and values for all tokens; the others for the outputs) and ``4 L R w`` in
    attention. Masked tokens count like others: these are computed operations, not useful ones. The
    first layer has no gradient of its input.
    """
    if case.subject == "all five":
        return 0
    width, depth, _ = VIT_SIZES[case.size]
    decoder, layers = DECODER[0], case.layers
    count, slots = (case.image // PATCH) ** 2, case.frames // TUBE
    pixels = 3 * TUBE * PATCH**2
    kept, masked, every = slots * _kept(count), slots * (count - _kept(count)), slots * count
    if case.subject == "videomae":
        embedded, seen, projected, prefix = every, kept, 0, 0
        deep = block_flops(every, every, decoder) * 2 * layers
        into, read = seen * width * decoder, masked * decoder * pixels
    else:
        prefix, projected = 6, 512
        embedded, seen = kept, kept + prefix
        whole = block_flops(every + prefix, every + prefix, decoder)
        deep = 2 * (whole * (layers - 1) + block_flops(every + prefix, masked, decoder))
        into, read = 2 * seen * projected * decoder, 2 * masked * decoder * pixels
    middle = block_flops(seen, seen, width) * depth + 2 * seen * width * projected
    return case.batch * (3 * (middle + deep + 2 * into + 2 * read) + 4 * embedded * pixels * width)


def block_flops(tokens: int, read: int, width: int) -> int:
    """Operations of a block's forward pass; see `step_flops`."""
    return 6 * tokens * width**2 + 18 * read * width**2 + 4 * tokens * read * width
