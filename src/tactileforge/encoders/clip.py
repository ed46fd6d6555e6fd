"""CLIP's text and image towers, through ``transformers`` (extra ``clip``)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar, Literal

import torch
from torch import Tensor, nn
from torch.nn import functional as F

from tactileforge.encoders.tactile_vit import CLIP_MEAN, CLIP_STD
from tactileforge.errors import PluginError
from tactileforge.util.origin import install_extra


class ClipTower(nn.Module):
    """One tower of a CLIP model in the layout of ``transformers``.

    Weights are read as safetensors only. Unlike other plugins, this one reads files in its
    constructor, because their configuration holds its sizes.

    Args:
        path: Folder, or name on the model hub, e.g. ``laion/CLIP-ViT-B-16-DataComp.XL-s13B-b90K``.
        tower: Kind of tower: ``text`` or ``image``.
        frozen: Whether its weights stay fixed in training.

    Raises:
        PluginError: ``transformers`` is not installed, or the files cannot be read.
    """

    expected_failures: ClassVar[dict[str, str]] = {
        "constructing does no io": "the files at `path` say how large the tower is"
    }

    def __init__(self, path: str, tower: Literal["text", "image"], frozen: bool = True) -> None:
        super().__init__()
        try:
            import transformers
        except ImportError as error:
            raise PluginError(
                f"the clip towers need transformers: {install_extra('clip')}"
            ) from error
        text = tower == "text"
        kind: Any = (
            transformers.CLIPTextModelWithProjection
            if text
            else transformers.CLIPVisionModelWithProjection
        )
        try:
            self.model: nn.Module = kind.from_pretrained(path, use_safetensors=True)
            self.tokenizer = transformers.CLIPTokenizerFast.from_pretrained(path) if text else None
        except (OSError, ValueError, RuntimeError) as error:
            why, small = str(error).splitlines()[0], {"text": "byte", "image": "vit"}[tower]
            raise PluginError(
                f"{tower}_encoder.path={path}: cannot load CLIP: {why} One that needs no download: "
                f"{tower}_encoder={small}"
            ) from error
        self.modality = tower
        self.frozen = frozen
        config: Any = self.model.config
        self.width = int(config.projection_dim)
        self.image_size = 0 if text else int(config.image_size)
        self.register_buffer("mean", torch.tensor(CLIP_MEAN).view(3, 1, 1), persistent=False)
        self.register_buffer("std", torch.tensor(CLIP_STD).view(3, 1, 1), persistent=False)
        self.mean: Tensor
        self.std: Tensor
        self.requires_grad_(not frozen)

    def train(self, mode: bool = True) -> ClipTower:
        """Sets the mode; a frozen tower stays in evaluation mode."""
        return super().train(mode and not self.frozen)

    def forward(self, batch: Sequence[str] | Tensor) -> Tensor:
        """Encodes B strings, or uint8 images (B, 3, h, w), to (B, width)."""
        # a graph through frozen weights would only take memory
        with torch.set_grad_enabled(torch.is_grad_enabled() and not self.frozen):
            if isinstance(batch, Tensor):
                size = (self.image_size, self.image_size)
                # clamped: bicubic interpolation overshoots
                x = F.interpolate(batch.float() / 255, size, mode="bicubic", antialias=True).clamp(
                    0, 1
                )
                out: Tensor = self.model(pixel_values=(x - self.mean) / self.std).image_embeds
                return out
            tokens = self.tokenizer(  # type: ignore[misc]
                list(batch), padding=True, truncation=True, return_tensors="pt"
            ).to(self.mean.device, non_blocking=True)
            out = self.model(**tokens).text_embeds
            return out
