"""Images that are part of a page."""

from __future__ import annotations

import base64
import io
from collections.abc import Sequence
from html import escape

import numpy as np
import torch
from numpy.typing import NDArray
from PIL import Image
from torch import Tensor

#: Pixels; wider frames are shrunk.
_WIDEST = 144


def jpeg(frame: Tensor) -> tuple[str, int, int]:
    """A frame as a data URL, and its width and height in pixels.

    Args:
        frame: float (3, H, W) in 0..1.
    """
    image = Image.fromarray((frame.permute(1, 2, 0) * 255).round().to(torch.uint8).numpy())
    if image.width > _WIDEST:
        size = (_WIDEST, max(1, round(image.height * _WIDEST / image.width)))
        image = image.resize(size, Image.Resampling.LANCZOS)
    file = io.BytesIO()
    image.save(file, "JPEG", quality=90, subsampling=0)
    text = base64.b64encode(file.getvalue()).decode()
    return f"data:image/jpeg;base64,{text}", image.width, image.height


def image(picture: NDArray[np.uint8], alt: str) -> str:
    """An image, uint8 (H, W, 3), embedded in the page."""
    url, width, height = jpeg(torch.from_numpy(picture).permute(2, 0, 1) / 255)
    return f'<img src="{url}" width="{width}" height="{height}" alt="{escape(alt)}" loading="lazy">'


def figure(pictures: Sequence[NDArray[np.uint8]], caption: str, alt: str, columns: int) -> str:
    """Images in a row, and a caption below."""
    images = "".join(image(picture, alt) for picture in pictures)
    return (
        f'<figure><div class="strip" style="grid-template-columns:repeat({columns},1fr);'
        f'margin:0">{images}</div><figcaption style="font-size:.75rem;line-height:1.3;'
        f'overflow-wrap:anywhere">{escape(caption)}</figcaption></figure>'
    )
