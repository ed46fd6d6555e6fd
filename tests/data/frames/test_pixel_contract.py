from typing import Any

import numpy as np
import pytest

from tactileforge.data.frames.encoded import EncodedFrames
from tactileforge.data.frames.image_codecs import encode_image
from tactileforge.data.frames.lazy import ArrayFrames
from tactileforge.data.frames.pixel_contract import checked_pixels, value_fix
from tactileforge.errors import DataError

PICTURE = np.zeros((4, 6, 3), np.uint8)


@pytest.mark.parametrize(
    ("pixels", "message"),
    [
        (np.full((4, 6, 3), 30000, np.uint16), r"uint16 from 3e\+04 .* 16 bits to 8 .*x >> 8\)"),
        (np.full((4, 6, 3), 4000, np.int32), r"scale 12 bits to 8 with \(x >> 4\)"),
        (np.full((4, 6, 3), 200, np.int64), r"convert with x\.astype\(np\.uint8\)"),
        (np.full((4, 6, 3), 1e6), r"scale them to 0\.\.255 by what the camera calls white"),
        (np.full((4, 6, 3), 0.5), r"np\.rint\(255 \* x\)"),
        (np.full((4, 6, 3), np.nan, np.float32), "72 of its values NaN or infinite"),
        (np.full((4, 6, 3), -1.0), "as they were before normalisation"),
        (np.zeros((4, 6, 4), np.uint8), r"leave out the alpha: \[\.\.\., :3\]"),
        (np.zeros((4, 6, 1), np.uint8), "repeat grey ones three times"),
        (np.zeros((4, 6), np.uint8), "repeat grey ones three times"),
        ([[0]], "expected a numpy array of uint8"),
    ],
)
def test_pictures_of_another_kind_are_refused_with_their_fix(pixels: Any, message: str) -> None:
    with pytest.raises(DataError, match=f"here: .*{message}"):
        checked_pixels(pixels, "here")


def test_no_advice_wraps_around() -> None:
    for high, kind in ((1000, "uint16"), (30000, "uint16"), (65535, "int64"), (300.0, "float32")):
        x = np.array([0, high], kind)
        advice = value_fix(x)
        assert "astype" not in advice or ">>" in advice
        if ">>" in advice:
            shift = int(advice.split(">> ")[1][0])
            assert (x.astype(np.int64) >> shift).max() <= 255


def test_every_door_of_arrays_is_checked() -> None:
    shaped: Any = PICTURE / 255
    with pytest.raises(DataError, match="not float64"):
        ArrayFrames(shaped[None])
    with pytest.raises(DataError, match=r"x, frame 0: .*found float64"):
        EncodedFrames("x", [shaped]).read([0])
    with pytest.raises(DataError, match="found float64"):
        encode_image(shaped, "png")
    assert checked_pixels(PICTURE, "x", 3) is PICTURE
