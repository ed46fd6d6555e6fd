"""``compile=true`` and `Model.compile`: blocks and preprocessing as compiled kernels."""

from __future__ import annotations

from typing import Any

import torch
from torch import nn

from tactileforge.encoders.preprocess import Preprocess
from tactileforge.encoders.transformer import Block

#: Kernels that blocks may have: one a sequence length and width, with and without gradients.
_VARIANTS = 64


def compile_blocks(module: nn.Module, **options: Any) -> int:
    """Compiles the preprocessing and the blocks of the encoder and the heads, in place.

    Blocks of one shape share their kernels, which torch keeps on disk: a deep encoder compiles as
    fast as a shallow one, and a second run sooner. Weights keep their names. Shapes are fixed, so
    that a resumed run computes with the kernels of the run. Towers for text and images stay as they
    are: they meet another number of captions in every batch.

    Args:
        module: Before its training, or a model.
        **options: See `torch.compile`; shapes are fixed unless they say otherwise.

    Returns:
        Number of modules that are compiled.
    """
    torch._dynamo.config.recompile_limit = _VARIANTS
    # balance= differentiates one graph several times, and so may not give its memory away
    torch._functorch.config.donated_buffer = False
    parts = [
        part
        for name, part in module.named_modules()
        if isinstance(part, Block | Preprocess) and not _in_tower(name)
    ]
    for part in parts:
        part.compile(**{"dynamic": False, **options})
    return len(parts)


def _in_tower(name: str) -> bool:
    """Whether the path of a module leads through a tower, as heads name them."""
    return any(step.endswith("_encoder") for step in name.split("."))
