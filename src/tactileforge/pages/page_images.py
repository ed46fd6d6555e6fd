"""Pictures of a page: the difference from the background, and JPEG."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

#: Largest length of the longer side of an image on the page, pixels; small images are enlarged by
#: the largest whole factor to at most half of it.
_LARGE = 480
#: Amplification of differences, for visibility.
_GAIN = 2.0


def difference_image(image: NDArray[np.uint8], background: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Difference of image and background, amplified twice, around mid-grey; uint8 (H, W, 3).

    Args:
        image: uint8 (H, W, 3).
        background: uint8 (H, W, 3); one of another size leaves the image as it is.

    Example:
        >>> still = np.full((4, 4, 3), 100, np.uint8)
        >>> int(difference_image(still + np.uint8(10), still)[0, 0, 0])
        148
    """
    if image.shape != background.shape:
        return image
    change = image.astype(np.float32) - background
    return np.asarray((128 + _GAIN * change).clip(0, 255), np.uint8)


def page_jpeg(image: NDArray[np.uint8]) -> bytes:
    """Encodes an RGB image as JPEG, resized to fit the page.

    Args:
        image: uint8 (H, W, 3).

    Example:
        >>> page_jpeg(np.zeros((4, 4, 3), np.uint8))[:2].hex()
        'ffd8'
    """
    longest = max(image.shape[:2])
    if longest > _LARGE:
        factor, how = _LARGE / longest, cv2.INTER_AREA
    else:
        factor, how = max(1, _LARGE // (2 * longest)), cv2.INTER_NEAREST
    sized = cv2.resize(image, None, fx=factor, fy=factor, interpolation=how)
    good, data = cv2.imencode(".jpg", cv2.cvtColor(sized, cv2.COLOR_RGB2BGR))
    assert good  # an image in memory can be written
    return bytes(data.tobytes())
