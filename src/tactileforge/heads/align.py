"""The head for alignment of touch, text and camera images in one space."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import torch
from torch import Tensor, nn
from torch.nn import functional as F

from tactileforge.contracts import Batch, Encoder, Views


@dataclass(frozen=True)
class Aligned:
    """Vectors of one batch in the shared space. A row is valid if its mask is True.

    Attributes:
        touch: Vectors of touch, float (B, d).
        text: Vectors of captions, float (B, d); None without a text tower.
        text_valid: bool (B,), True for samples with a caption.
        image: Vectors of camera images, float (B, d); None without an image tower.
        image_valid: bool (B,), True for samples with an image.
        scale: Inverse temperature, a scalar.
    """

    touch: Tensor
    text: Tensor | None
    text_valid: Tensor
    image: Tensor | None
    image_valid: Tensor
    scale: Tensor


class AlignHead(nn.Module):
    """Projects text and images into the space of the encoder's projected class token.

    Args:
        encoder: The touch encoder (given by the framework).
        text_encoder: Tower for captions, or None (given by the framework).
        image_encoder: Tower for camera images, or None (given by the framework).
        temperature: Initial temperature; it is learned, and never falls below 0.01.
    """

    reads: ClassVar[frozenset[str]] = frozenset({"full"})

    def __init__(
        self,
        encoder: Encoder,
        text_encoder: nn.Module | None,
        image_encoder: nn.Module | None,
        temperature: float = 0.07,
    ) -> None:
        super().__init__()
        self.text_encoder = text_encoder
        self.image_encoder = image_encoder
        self.text_project = self._projection(text_encoder, encoder)
        self.image_project = self._projection(image_encoder, encoder)
        self.log_scale = nn.Parameter(torch.tensor(-math.log(temperature)))

    @staticmethod
    def _projection(tower: nn.Module | None, encoder: Encoder) -> nn.Linear | None:
        if tower is None:
            return None
        width: int = tower.width  # type: ignore[assignment]
        # without a bias, as in CLIP
        return nn.Linear(width, encoder.projected, bias=False)

    def forward(self, views: Views, batch: Batch) -> Aligned:
        """Projects the batch to the shared space; each distinct caption is encoded once."""
        touch = views.full.cls
        text = image = None
        if self.text_encoder is not None:
            # a caption is often that of many clips of one recording
            lines = list(dict.fromkeys(batch["text"]))
            where = {line: i for i, line in enumerate(lines)}
            rows = torch.tensor([where[line] for line in batch["text"]])
            rows = rows.to(touch.device, non_blocking=True)
            text = F.embedding(rows, self.text_vectors(lines))
        if self.image_encoder is not None and self.image_project is not None:
            image = self.image_project(self.image_encoder(batch["image"]))
        text_valid = torch.tensor([line != "" for line in batch["text"]])
        text_valid = text_valid.to(touch.device, non_blocking=True)
        return Aligned(touch, text, text_valid, image, batch["image_valid"], self.scale)

    @property
    def scale(self) -> Tensor:
        """Inverse temperature, a scalar of at most 100."""
        # the limit of CLIP (Radford et al. 2021): above it training became unstable
        return self.log_scale.clamp(max=math.log(100)).exp()

    def text_vectors(self, lines: Sequence[str]) -> Tensor:
        """Projects n captions to the shared space, (n, d); the head must have a text tower."""
        assert self.text_encoder is not None
        assert self.text_project is not None
        out: Tensor = self.text_project(self.text_encoder(lines))
        return out
