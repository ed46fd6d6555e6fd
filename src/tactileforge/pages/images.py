"""Images embedded in a page."""

from __future__ import annotations

import base64
import io
from collections.abc import Sequence

import numpy as np
import torch
from markupsafe import Markup
from numpy.typing import ArrayLike, NDArray
from PIL import Image
from torch import Tensor

from tactileforge.pages.templating import piece

#: Largest width of an embedded frame, pixels.
_WIDEST = 144
#: Grey level of no change in a difference image.
_GREY = 128


def frame_data_url(frame: Tensor) -> tuple[str, int, int]:
    """A frame as a data URL, and its width and height in pixels.

    Args:
        frame: Frame, float (3, H, W) in 0..1.
    """
    image = Image.fromarray((frame.permute(1, 2, 0) * 255).round().to(torch.uint8).numpy())
    if image.width > _WIDEST:
        size = (_WIDEST, max(1, round(image.height * _WIDEST / image.width)))
        image = image.resize(size, Image.Resampling.LANCZOS)
    file = io.BytesIO()
    # colours at full resolution: lights of a gel differ in colour alone
    image.save(file, "JPEG", quality=90, subsampling=0)
    text = base64.b64encode(file.getvalue()).decode()
    return f"data:image/jpeg;base64,{text}", image.width, image.height


def image(pixels: NDArray[np.uint8] | Tensor, alt: str) -> Markup:
    """An image embedded in the page.

    Args:
        pixels: uint8 (H, W, 3), or a float tensor (3, H, W) in 0..1.
        alt: Description for screen readers, plain text.
    """
    if isinstance(pixels, np.ndarray):
        pixels = torch.from_numpy(pixels).permute(2, 0, 1) / 255
    return piece("image", *frame_data_url(pixels), alt)


def amplified_difference(change: ArrayLike, gain: float) -> NDArray[np.uint8]:
    """An amplified change as an image around mid-grey.

    Args:
        change: Change, (H, W, 3), grey levels.
        gain: Factor of amplification.
    """
    levels = np.clip(np.round(_GREY + gain * np.asarray(change)), 0, 255)
    return np.asarray(levels, np.uint8)


def strip(images: Sequence[Markup | None], columns: int, label: str = "") -> Markup:
    """Images in rows, below a label; None leaves a place empty."""
    name = piece("strip_name", label) if label else Markup()
    return name + piece("strip", images, columns)


def noted(shown: Markup, note: str) -> Markup:
    """An image of a strip, with a few words below."""
    return piece("noted", shown, note)


def captioned(shown: Markup, caption: str) -> Markup:
    """An image alone, with a caption below; both may be empty."""
    return piece("captioned", shown, caption)


def figure(
    pictures: Sequence[NDArray[np.uint8]],
    caption: str,
    alt: str | Sequence[str],
    columns: int,
    width: int | None = None,
) -> Markup:
    """Small images in a row, and a caption below.

    Args:
        pictures: Images, each uint8 (H, W, 3).
        caption: Caption, plain text.
        alt: Description for screen readers, of all images or of each.
        columns: Number of images in a row.
        width: Largest width of the row, pixels.
    """
    words = [alt] * len(pictures) if isinstance(alt, str) else alt
    images = [image(pixels, text) for pixels, text in zip(pictures, words, strict=True)]
    return piece("figure", images, caption, columns, width)
