"""Published files recognised by name and refused, with reasons."""

from __future__ import annotations

from dataclasses import dataclass
from fnmatch import fnmatchcase

from tactileforge_published.layout import State


@dataclass(frozen=True)
class KnownFile:
    """A refused published file.

    Attributes:
        marks: Patterns of names of tensors; each fits at least one tensor of such a file.
        reason: What it is, why it is not imported, and what to do instead.
    """

    marks: tuple[str, ...]
    reason: str

    def fits(self, state: State) -> bool:
        """Whether a file is of this kind."""
        return all(any(fnmatchcase(key, mark) for key in state) for mark in self.marks)


REFUSED = (
    KnownFile(
        ("*head.pooler.query_tokens*",),
        "this file holds a force head of AnyTouch 2 but no encoder: import "
        "checkpoint-4frames.pth, and read the head with published.force_head",
    ),
    KnownFile(
        ("*patch_embed.img.proj.weight", "*bottleneck", "*fusion_blocks.0.img.attn.qkv.weight"),
        "this is a Sparsh-X that exchanges bottleneck tokens between images, sound, motion and "
        "pressure: its image tokens are not those of images alone. Import the model of images "
        "(facebook/sparsh-x-img)",
    ),
    KnownFile(
        ("*patch_embed.??[!g]*.proj.weight", "*fusion_blocks.0.attn.qkv.weight"),
        "this is a Sparsh-X of other senses than images, read together or alone: import the model "
        "of images (facebook/sparsh-x-img)",
    ),
    KnownFile(
        ("*quantize.embedding.weight", "*quant_conv.weight", "*encoder.down.0.block.0.conv1.*"),
        "this is a VQGAN, but not UniT's, which has 1024 codes of 3 numbers: what its map means is "
        "not known here. Build the encoder vqgan of its shape and load its weights yourself",
    ),
)
