"""A small convolutional touch encoder that starts from a network for photographs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import torch
from torch import Tensor, nn

from tactileforge.encoders.convolutional import ConvBackbone
from tactileforge.encoders.efficientnet_lite import Lite0, on_grid, usual_deviation
from tactileforge.encoders.preprocess import DIFFERENCE_GAIN
from tactileforge.errors import ConfigError

#: The change from the background, around 0, amplified as for the network of photographs.
DIFFERENCE: dict[str, Any] = {
    "offset": 130,
    "fit": "squash",
    "filter": "bilinear",
    "mean": (130 / 255,) * 3,
    "std": (1 / DIFFERENCE_GAIN,) * 3,
}


class TactileCnn(ConvBackbone):
    """Encodes the change of each frame from its background with EfficientNet-Lite0.

    See `ConvBackbone` for tokens: the maps of the network at an eighth, a sixteenth and a
    thirty-second of the size, at one place, each divided by its usual deviation. The vector is a
    linear layer on their mean. Norms keep the statistics of their weights, so it serves to go on
    from weights, of photographs (``init=imagenet``) or of another run, rather than to train from
    random ones. With ``photo_stream`` the network of photographs stays beside the one that learns.
    Source of the network: Tan and Le 2019, see `efficientnet_lite.Lite0`.

    Args:
        frames: Frames of a clip; each has tokens of its own.
        image_size: Height and width of resized frames, multiples of 32 pixels, or one number.
        projected: Width of the vector.
        sensors: Table of sensors, without effect on the features.
        mask_ratio: Share of spatial positions hidden in the masked view, the same in every slot.
        spacing: Seconds between the frames of a clip in training; 0 for one frame.
        pixels: Options of preprocessing, see `preprocess.Preprocess`.
        photo_stream: Whether tokens have the maps of a second network behind their own, which stays
            as it starts: ``init=RUN+imagenet`` gives it the weights of photographs.

    Attributes:
        width: Size of a token, 472, or 944 with ``photo_stream``.
        prefix: Number of tokens before the patches, 0.
        grid: Numbers of temporal slots, rows and columns.

    Raises:
        ConfigError: 32 does not divide the size.

    Example:
        >>> import torch
        >>> encoder = TactileCnn(frames=2, image_size=64).eval()
        >>> frames = torch.zeros(1, 2, 3, 48, 48, dtype=torch.uint8)
        >>> tokens, vector = encoder(frames, frames[:, 0], encoder.sensor_ids(["digit"]))
        >>> tokens.shape, vector.shape
        (torch.Size([1, 32, 472]), torch.Size([1, 512]))
    """

    deviation: Tensor

    def __init__(
        self,
        frames: int = 2,
        image_size: int | Sequence[int] = 128,
        projected: int = 512,
        sensors: dict[str, int] | None = None,
        mask_ratio: float = 0.75,
        spacing: float = 1 / 15,
        pixels: Mapping[str, Any] = DIFFERENCE,
        photo_stream: bool = False,
    ) -> None:
        width = sum(Lite0.channels) * (1 + photo_stream)
        super().__init__(width, frames, image_size, 16, sensors, mask_ratio, spacing, pixels)
        if any(side % 32 for side in self.image_size):
            raise ConfigError(f"encoder.image_size={image_size}: give multiples of 32")
        self.projected = projected
        self.network = Lite0()
        self.photographs = Lite0().requires_grad_(False) if photo_stream else None
        # constants: not in state dicts
        self.register_buffer("deviation", usual_deviation(), persistent=False)
        self.project = nn.Linear(width, projected)
        # from the start: the norms keep the statistics of the weights
        self.train(self.training)

    def train(self, mode: bool = True) -> TactileCnn:
        """Sets the mode; networks stay in evaluation mode, and the first is trained in it."""
        super().train(mode)
        for network in self._networks():
            network.eval()
        return self

    def _networks(self) -> list[Lite0]:
        return [self.network] if self.photographs is None else [self.network, self.photographs]

    def map(self, pictures: Tensor) -> Tensor:
        """Joined maps of pictures (n, 3, height, width), (n, width, height / 16, width / 16)."""
        _, rows, columns = self.grid
        found = [
            on_grid(network.features(0.5 + pictures), (rows, columns)) / self.deviation
            for network in self._networks()
        ]
        joined = (torch.cat(found, 2) if len(found) > 1 else found[0]).mT
        return joined.reshape(*joined.shape[:2], rows, columns)
