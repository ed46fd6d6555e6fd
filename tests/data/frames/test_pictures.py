from io import BytesIO
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image

from tactileforge.data.frames.encoded import EncodedFrames
from tactileforge.data.frames.lazy import ImageFrames
from tactileforge.errors import DataError

#: 12 bits in 16, as a scientific camera gives them.
DEEP = np.random.default_rng(0).integers(0, 4096, (6, 8, 3)).astype(np.uint16)
SHOWN = (DEEP >> 4).astype(np.uint8)


@pytest.mark.parametrize("ending", ["png", "tif", "ppm"])
def test_16_bits_of_colour_are_refused_as_those_of_grey(tmp_path: Path, ending: str) -> None:
    for name, pixels in (("colour", DEEP), ("grey", DEEP[..., 0])):
        path = tmp_path / f"{name}.{ending if name == 'colour' else ending.replace('ppm', 'pgm')}"
        cv2.imwrite(str(path), pixels)
        with pytest.raises(DataError, match=rf"{path.name}: .*convert it to 8 bits a channel"):
            ImageFrames([path])
        with pytest.raises(DataError, match="convert it to 8 bits a channel"):
            EncodedFrames("x", [path.read_bytes()]).read([0])


@pytest.mark.parametrize("ending", ["png", "tif", "ppm", "bmp"])
def test_8_bits_of_colour_are_read(tmp_path: Path, ending: str) -> None:
    path = tmp_path / f"a.{ending}"
    cv2.imwrite(str(path), SHOWN[..., ::-1])
    np.testing.assert_array_equal(ImageFrames([path]).read([0])[0], SHOWN)


def test_16_bits_with_alpha(tmp_path: Path) -> None:
    path = tmp_path / "a.png"
    cv2.imwrite(str(path), np.dstack([DEEP, DEEP[..., :1]]))
    with pytest.raises(DataError, match=r"a\.png: 16 bits a channel \(RGBA\)"):
        ImageFrames([path])


def test_an_alpha_counts_where_something_is_transparent(tmp_path: Path) -> None:
    alpha = np.full((6, 8, 1), 255, np.uint8)
    path = tmp_path / "a.png"
    Image.fromarray(np.dstack([SHOWN, alpha])).save(path)
    np.testing.assert_array_equal(ImageFrames([path]).read([0])[0], SHOWN)
    alpha[0] = 0
    Image.fromarray(np.dstack([SHOWN, alpha])).save(path)
    with pytest.raises(DataError, match=r"a\.png: 17% of its pixels are transparent"):
        ImageFrames([path]).read([0])


def test_colours_of_a_printer(tmp_path: Path) -> None:
    path = tmp_path / "a.jpg"
    Image.fromarray(SHOWN).convert("CMYK").save(path)
    with pytest.raises(DataError, match=r"a\.jpg: CMYK pixels; convert it to RGB"):
        ImageFrames([path])


def test_a_palette_is_read_as_its_colours(tmp_path: Path) -> None:
    few = (SHOWN // 128 * 128).astype(np.uint8)
    palette = Image.fromarray(few).convert("P", palette=Image.Palette.ADAPTIVE)
    stored = BytesIO()
    palette.save(stored, "PNG")
    read = EncodedFrames("x", [stored.getvalue()]).read([0])[0]
    np.testing.assert_array_equal(read, np.asarray(palette.convert("RGB")))
