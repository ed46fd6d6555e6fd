"""``compile=true`` and `Model.compile`: blocks and preprocessing as compiled kernels."""

from __future__ import annotations

from typing import Any

import torch
from torch import nn

from tactileforge.encoders.preprocess import Preprocess
from tactileforge.encoders.transformer import Block

#: Most kernels of a block: one per sequence length and width, with and without gradients.
_VARIANTS = 64


def compile_blocks(module: nn.Module, **options: Any) -> int:
    """Compiles the preprocessing and the blocks of the encoder and the heads, in place.

    Blocks of one shape share their kernels, which torch caches on disk: a deep encoder compiles as
    fast as a shallow one, and a second run starts sooner. Weights keep their names. Shapes are
    fixed, so that a resumed run computes with the kernels of the first. Towers for text and images
    are not compiled, because the number of captions differs from batch to batch.

    Args:
        module: Module before its training, or a model.
        **options: Options of `torch.compile`; ``dynamic`` is False unless given.

    Returns:
        Number of compiled modules.
    """
    # beyond its limit torch runs a block uncompiled, and its default is lower
    torch._dynamo.config.recompile_limit = _VARIANTS
    # balance= differentiates one graph several times, which torch refuses with donated buffers
    torch._functorch.config.donated_buffer = False
    parts = [
        part
        for name, part in module.named_modules()
        # towers of heads (text_encoder, image_encoder) stay as they are
        if isinstance(part, Block | Preprocess)
        and not any(step.endswith("_encoder") for step in name.split("."))
    ]
    for part in parts:
        part.compile(**{"dynamic": False, **options})
    return len(parts)
