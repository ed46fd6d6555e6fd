"""The camera behind the gel: focus, exposure, tone curve, noise and codec."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
import torch
import torch.nn.functional as F
from numpy.typing import NDArray
from torch import Tensor

#: Shorter side of an image at full size, pixels: the unit of `CameraModel.blur`.
FULL = 240
#: Steps of the tone curve per grey level.
_STEPS = 16
#: Lower limit of the JPEG quality.
_WORST = 10
#: Interval of key frames in the simulated MPEG stream, images.
_KEY = 15


@dataclass(frozen=True)
class CameraModel:
    """Camera of a unit: focus, exposure, tone curve, distortion and compression.

    Attributes:
        blur: Standard deviation of its defocus, pixels of an image of `FULL` rows or columns.
        exposure: Factor on all light.
        gamma: Exponent of the tone curve; 1 leaves grey levels as the calibration has them.
        distortion: Share by which a corner of the image is displaced outwards.
        jpeg: JPEG loss at full size, 100 less the quality; 0 stores images uncompressed.
        mpeg: The same for the change from the image before; 0 for no MPEG coding.
    """

    blur: float = 0.0
    exposure: float = 1.0
    gamma: float = 1.0
    distortion: float = 0.0
    jpeg: float = 0.0
    mpeg: float = 0.0

    def places(self, height: int, width: int, spacing: float, device: str = "cpu") -> Tensor:
        """Places on the gel seen by the pixels, float32 (H, W, 2), x and y, mm from the centre."""
        x = (torch.arange(width, device=device) - (width - 1) / 2) * spacing
        y = (torch.arange(height, device=device) - (height - 1) / 2) * spacing
        grid = torch.stack(torch.meshgrid(x, y, indexing="xy"), -1)
        corner = (width**2 + height**2) * (spacing / 2) ** 2
        return grid * (1 + self.distortion * grid.square().sum(-1, keepdim=True) / corner)

    def seen(self, places: Tensor, height: int, width: int, spacing: float) -> Tensor:
        """Places of the gel in an undistorted image, mm; the inverse of `places`."""
        corner = (width**2 + height**2) * (spacing / 2) ** 2
        out = places
        # The distortion has no closed inverse: three fixed-point steps.
        for _ in range(3):
            out = places / (1 + self.distortion * out.square().sum(-1, keepdim=True) / corner)
        return out

    def tone(self, light: Tensor) -> Tensor:
        """Grey levels of light (in grey levels of the calibration), in place."""
        if self.exposure != 1:
            light *= self.exposure
        if self.gamma != 1:
            # From a table in steps of 1/16 grey level: a power of every pixel costs far more.
            levels = torch.arange(_STEPS * 255 + 1, device=light.device) / (_STEPS * 255)
            table = levels.pow_(self.gamma).mul_(255)
            light.clamp_(0, 255).mul_(_STEPS).add_(0.5)
            places = light.to(torch.int32).flatten()
            torch.index_select(table, 0, places, out=light.view(-1))
        return light


class Lens:
    """Blurs an image drawn at a finer resolution, and shrinks it to its size.

    Args:
        blur: Standard deviation of a Gaussian, pixels of the fine image; the image's border is
            repeated beyond it.
        shrink: Fine pixels per pixel, along rows and columns; a divisor of both sides.
        device: Device of the images.
    """

    def __init__(self, blur: float, shrink: int, device: str | torch.device = "cpu") -> None:
        self.reach = math.ceil(3 * blur)
        steps = torch.arange(-self.reach, self.reach + 1)
        spot = torch.softmax(-0.5 * (steps / max(blur, 1e-6)) ** 2, 0)
        cell = torch.full((shrink,), 1 / shrink)
        self.kernel = F.conv1d(spot[None, None], cell[None, None], padding=shrink - 1).to(device)
        self.shrink = shrink

    def __call__(self, picture: Tensor) -> Tensor:
        """(B, 3, k H, k W) to (B, 3, H, W)."""
        if self.kernel.numel() == 1:
            return picture
        if self.shrink == 1 and picture.device.type == "cpu" and not picture.requires_grad:
            # The same without shrinking, two to four times as fast on a CPU.
            out, spot = torch.empty_like(picture), self.kernel.flatten().numpy()
            for before, after in zip(picture.flatten(0, 1), out.flatten(0, 1), strict=True):
                dst, border = after.numpy(), cv2.BORDER_REPLICATE
                cv2.sepFilter2D(before.numpy(), -1, spot, spot, dst=dst, borderType=border)
            return out
        x = F.pad(picture, (self.reach,) * 4, mode="replicate").flatten(0, 1)[None]
        count, step = x.shape[1], self.shrink
        across = self.kernel[None].expand(count, -1, -1, -1).contiguous()
        x = F.conv2d(x, across, stride=(1, step), groups=count)
        x = F.conv2d(x, across.transpose(2, 3).contiguous(), stride=(step, 1), groups=count)
        return x.view(*picture.shape[:2], *x.shape[-2:])


class Codec:
    """Compresses the images of one film in order, like a camera or a video file.

    JPEG codes each image. MPEG codes the change from the decoded image before, in the same blocks
    of cosines, without motion compensation; it replaces JPEG in a unit with both.

    Args:
        camera: Strength of the compression.
        shrink: Pixels of the sensor per pixel of the image: losses in blocks of a full image are
            small in a shrunk one.
    """

    def __init__(self, camera: CameraModel, shrink: float = 1.0) -> None:
        self.jpeg, self.mpeg = (
            round(max(_WORST, 100 - lost / max(1.0, shrink))) if lost else None
            for lost in (camera.jpeg, camera.mpeg)
        )
        self._before: NDArray[np.int16] | None = None
        self._count = 0

    def __call__(self, pictures: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """The next images (K, H, W, 3), RGB, after compression and decoding."""
        if self.jpeg is None and self.mpeg is None:
            return pictures
        return np.stack([self._next(picture) for picture in pictures])

    def _next(self, picture: NDArray[np.uint8]) -> NDArray[np.uint8]:
        if self.mpeg is None:
            return picture if self.jpeg is None else _coded(picture, self.jpeg)
        self._count += 1
        if self._before is None or self._count % _KEY == 1:
            self._before = _coded(picture, self.mpeg).astype(np.int16)
            return self._before.astype(np.uint8)
        # Coded around mid-grey, since a coded image has no negative values.
        change = np.clip(picture - self._before + 128, 0, 255).astype(np.uint8)
        now = self._before + _coded(change, self.mpeg).astype(np.int16) - 128
        self._before = np.clip(now, 0, 255)
        return self._before.astype(np.uint8)


def _coded(picture: NDArray[np.uint8], quality: int) -> NDArray[np.uint8]:
    """An image (H, W, 3), RGB, after JPEG compression."""
    blue_first = cv2.cvtColor(picture, cv2.COLOR_RGB2BGR)
    _, code = cv2.imencode(".jpg", blue_first, [cv2.IMWRITE_JPEG_QUALITY, quality])
    decoded = cv2.imdecode(code, cv2.IMREAD_COLOR)
    assert decoded is not None  # it was coded here
    return np.asarray(cv2.cvtColor(decoded, cv2.COLOR_BGR2RGB), dtype=np.uint8)
