"""A network of timm for camera images, and as a frozen teacher: ``image_encoder=timm_image``."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from typing import Any, ClassVar

import torch
from torch import Tensor, nn

from tactileforge.encoders import Preprocess
from tactileforge_timm.encoder import pair_of
from tactileforge_timm.features import Layout, own_pixels, own_size
from tactileforge_timm.networks import create_network

log = logging.getLogger(__name__)


class TimmTower(nn.Module):
    """Camera images, or pictures of touch, to one vector each, and to a map of features.

    The vector is the network's own, the map its last features. Objective ``distill`` takes it as
    the teacher.

    Args:
        model: Name of a model of timm.
        pretrained: Whether it gets the weights that timm has for it.
        path: File of its weights, ``.safetensors``, ``.pth`` or ``.bin``; None for none.
        image_size: Height and width of resized images, or one number; None for its own.
        frozen: Whether its weights stay fixed in training.

    Raises:
        TactileForgeError: See `networks.create_network`.
    """

    starting_options: ClassVar[tuple[str, ...]] = ("pretrained", "path")
    named_by: ClassVar[str] = "model"
    modality = "image"

    def __init__(
        self,
        model: str = "resnet18",
        pretrained: bool = False,
        path: str | None = None,
        image_size: int | Sequence[int] | None = None,
        frozen: bool = True,
    ) -> None:
        super().__init__()
        self.network: Any = create_network(model, pair_of(image_size), pretrained, path)
        if frozen and not (pretrained or path):
            log.warning(
                "timm_image: %s has random weights and is frozen; give image_encoder.pretrained="
                "true, or a file as image_encoder.path",
                model,
            )
        size = pair_of(image_size) or own_size(self.network, model)
        self.image_size, self.frozen = size, frozen
        self.layout = Layout(self.network, model, size)
        self.width = self.layout.head_width
        self.pixels = Preprocess.of(size, own_pixels(self.network))
        self.requires_grad_(not frozen)
        self.train(self.training)

    def train(self, mode: bool = True) -> TimmTower:
        """Sets the mode; a frozen tower stays in evaluation mode."""
        return super().train(mode and not self.frozen)

    def forward(self, images: Tensor) -> Tensor:
        """Encodes images (B, 3, h, w) from 0 to 255, uint8 or float, to (B, width)."""
        return self.layout.vector(self.network, self._tokens(images))

    def maps(self, images: Tensor) -> list[Tensor]:
        """The last map of images (B, 3, h, w) from 0 to 255: one (B, C, rows, columns)."""
        places = self._tokens(images)[:, self.layout.prefix :].mT
        return [places.reshape(*places.shape[:2], *self.layout.grid)]

    def _tokens(self, images: Tensor) -> Tensor:
        # a graph through frozen weights would only take memory
        with torch.set_grad_enabled(torch.is_grad_enabled() and not self.frozen):
            # no background is subtracted: the image itself stands in its place
            x = self.pixels(images[:, None], images)[:, 0]
            return self.layout.tokens(self.network.forward_features(x))
