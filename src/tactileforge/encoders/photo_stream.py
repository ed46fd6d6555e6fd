"""A second stream of an encoder: a network for photographs, applied to pictures of touch."""

from __future__ import annotations

import torch
from torch import Tensor, nn

from tactileforge.contracts import NEUTRAL_BACKGROUND
from tactileforge.encoders.backbone import patches_at
from tactileforge.encoders.efficientnet_lite import Lite0, on_grid, usual_deviation
from tactileforge.encoders.preprocess import DIFFERENCE_GAIN, Preprocess
from tactileforge.errors import ConfigError


class PhotoStream(nn.Module):
    """Tokens from the maps of a frozen EfficientNet-Lite0, applied to each tube.

    The input of the network is the difference of the last frame of a tube to the frame without
    contact, around mid-grey. Its maps at an eighth, a sixteenth and a thirty-second of the size are
    resampled to the grid of the patches, and a linear layer with orthogonal initial weights turns
    them into tokens. Hidden patches are replaced by mid-grey, so that nothing of them reaches their
    neighbours.
    Source: two parallel streams as in Simonyan and Zisserman (2014), weights of photographs like
    those of CLIP in AnyTouch 2.

    Args:
        grid: Numbers of temporal slots, rows and columns.
        tube: Frames of a patch.
        patch: Rows and columns of a patch.
        width: Size of a token, at most 472.
        pixels: Preprocessing of the frames.

    Raises:
        ConfigError: Height or width is not a multiple of 32, or sensors are normalised differently.
    """

    deviation: Tensor

    def __init__(
        self, grid: tuple[int, int, int], tube: int, patch: int, width: int, pixels: Preprocess
    ) -> None:
        super().__init__()
        if any(side % 32 for side in pixels.size):
            raise ConfigError(
                "encoder.photo_stream needs height and width that are multiples of 32, and "
                f"encoder.image_size is {pixels.size}"
            )
        if pixels.mean.ndim != 3:
            raise ConfigError("encoder.photo_stream needs one encoder.pixels.mean for all sensors")
        self.grid, self.tube, self.patch, self.pixels = grid, tube, patch, pixels
        self.grey = (NEUTRAL_BACKGROUND if pixels.offset is None else pixels.offset) / 255
        self.network = Lite0().requires_grad_(False)
        # constants: not in state dicts
        self.register_buffer("deviation", usual_deviation(), persistent=False)
        self.project = nn.Linear(len(self.deviation), width)
        nn.init.orthogonal_(self.project.weight)
        nn.init.zeros_(self.project.bias)
        # from the start: the norms of the network keep the statistics of photographs
        self.train(self.training)

    def train(self, mode: bool = True) -> PhotoStream:
        """Sets the mode; the frozen network stays in evaluation mode."""
        super().train(mode)
        self.network.eval()
        return self

    def forward(self, patches: Tensor, kept: Tensor | None) -> Tensor:
        """Computes tokens, float (B, slots * (K or N), width).

        Args:
            patches: float (B, slots, N, P), normalised frames.
            kept: int64 (B, K), visible spatial positions; None for all.
        """
        with torch.no_grad():
            # hidden patches are mid-grey to the network, and their tokens are left out after it
            maps = self.maps(patches, kept)
            if kept is not None:
                maps = patches_at(maps, kept)
        out: Tensor = self.project((maps / self.deviation).flatten(1, 2))
        return out

    def maps(self, patches: Tensor, kept: Tensor | None) -> Tensor:
        """Maps of the network, float (B, slots, N, 472); arguments as of `forward`."""
        slots, rows, columns = self.grid
        pictures = self.pictures(patches, kept).to(self.deviation.dtype)
        maps = on_grid(self.network.features(pictures.flatten(0, 1)), (rows, columns))
        return maps.reshape(-1, slots, *maps.shape[1:])

    def pictures(self, patches: Tensor, kept: Tensor | None) -> Tensor:
        """Input of the network, about 0.5, (B, slots, 3, H, W); arguments as of `forward`."""
        slots, rows, columns = self.grid
        cells = (len(patches), slots, rows, columns, 3, self.patch, self.patch)
        tubes = patches.view(*patches.shape[:3], 3, self.tube, self.patch, self.patch)
        # back to grey levels: the network has a normalisation of its own
        x = DIFFERENCE_GAIN * (
            tubes[:, :, :, :, -1] * self.pixels.std + self.pixels.mean - self.grey
        )
        if kept is not None:
            shown = x.new_zeros(len(x), rows * columns).scatter(1, kept, 1.0)
            x = x * shown[:, None, :, None, None, None]
        return 0.5 + x.view(cells).permute(0, 1, 4, 2, 5, 3, 6).flatten(5).flatten(3, 4)
