"""EXIF orientations: the same upright pixels at every door."""

from io import BytesIO
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image, ImageOps
from tactileforge_datasets.webdataset import WebDataset
from tactileforge_live.sensor_stream import read_background

from tactileforge.data.frames.encoded import EncodedFrames
from tactileforge.data.frames.image_codecs import check_upright
from tactileforge.data.frames.lazy import ImageFrames
from tactileforge.datasets.recordings import Recordings
from tactileforge.errors import ConfigError, DataError

FORMATS = {"jpg": "JPEG", "png": "PNG", "webp": "WEBP", "tif": "TIFF"}
RNG = np.random.default_rng(0)
PIXELS = cv2.resize(RNG.integers(0, 255, (6, 8, 3), np.uint8), (32, 24))


def tagged(orientation: int, ending: str) -> bytes:
    exif = Image.Exif()
    exif[0x0112] = orientation
    out = BytesIO()
    options = {"lossless": True} if ending == "webp" else {}
    Image.fromarray(PIXELS).save(out, FORMATS[ending], exif=exif, **options)
    return out.getvalue()


def upright(data: bytes) -> NDArray[np.uint8]:
    """Pixels by Pillow, upright by the tag."""
    with Image.open(BytesIO(data)) as image:
        return np.asarray(ImageOps.exif_transpose(image).convert("RGB"))


@pytest.mark.parametrize("ending", FORMATS)
@pytest.mark.parametrize("orientation", range(1, 9))
def test_files_bytes_and_backgrounds_are_upright(
    tmp_path: Path, ending: str, orientation: int
) -> None:
    data = tagged(orientation, ending)
    wanted = upright(data)
    assert (wanted.shape == PIXELS.shape) == (orientation < 5)
    path = tmp_path / f"0.{ending}"
    path.write_bytes(data)
    frames = ImageFrames([path])
    assert frames.shape == wanted.shape[:2]
    np.testing.assert_array_equal(frames.read([0])[0], wanted)
    np.testing.assert_array_equal(EncodedFrames("x", [data]).read([0])[0], wanted)
    np.testing.assert_array_equal(read_background(str(path)), wanted)
    if ending == "jpg":
        np.testing.assert_allclose(cv2.imread(str(path))[..., ::-1].astype(int), wanted, atol=4)


def test_data_sets_are_upright_and_a_mixture_is_said(tmp_path: Path) -> None:
    for number in range(6):
        (tmp_path / f"{number}.png").write_bytes(tagged(3 if number % 3 == 0 else 1, "png"))
    layout = {"images": "*.png", "each": "touch", "sensor": "digit", "background": "none"}
    data = Recordings(str(tmp_path), {"a": layout}, val=0)
    found = list(data.recordings("train"))
    np.testing.assert_array_equal(found[0].frames.read([0])[0], PIXELS[::-1, ::-1])
    np.testing.assert_array_equal(found[1].frames.read([0])[0], PIXELS)
    assert data.notes == [
        "a: 2 of 6 images have an EXIF orientation, and are turned by it; were all taken the same "
        "way up?"
    ]
    for number in range(6):
        (tmp_path / f"{number}.png").write_bytes(tagged(3, "png"))
    data = Recordings(str(tmp_path), {"a": layout}, val=0)
    assert len(list(data.recordings("train"))) == 6
    assert data.notes == [], "all alike is no doubt"


def test_samples_of_tars_are_upright(tmp_path: Path) -> None:
    import tarfile

    data = tagged(6, "jpg")
    with tarfile.open(tmp_path / "a.tar", "w") as tar:
        info = tarfile.TarInfo("x.jpg")
        info.size = len(data)
        tar.addfile(info, BytesIO(data))
    layout = {"touch": "jpg", "sensor": "digit", "background": "none"}
    (one,) = WebDataset(str(tmp_path), layout, val=0).recordings("train")
    np.testing.assert_array_equal(one.frames.read([0])[0], upright(data))


@pytest.mark.parametrize("ending", ["jpg", "png", "webp"])
def test_shards_take_upright_pictures_alone(ending: str) -> None:
    check_upright(tagged(1, ending), "x")
    with pytest.raises(DataError, match="x: has the EXIF orientation 6; encode its upright"):
        check_upright(tagged(6, ending), "x")


@pytest.mark.parametrize(
    ("image", "wanted"),
    [
        (Image.fromarray(PIXELS).convert("P"), "same"),
        (Image.fromarray(PIXELS).convert("RGBA"), "same"),
        (Image.fromarray(PIXELS).convert("CMYK"), "CMYK pixels; convert it to RGB"),
        (Image.fromarray(PIXELS.astype(np.uint16)[..., 0] * 256), "convert it to 8 bits"),
        (Image.fromarray(PIXELS[..., :2], "LA"), "transparent"),
    ],
    ids=["palette", "RGBA", "CMYK", "16 bits", "grey and alpha"],
)
def test_other_pictures_are_the_same_or_refused_at_every_door(
    tmp_path: Path, image: Image.Image, wanted: str
) -> None:
    path = tmp_path / ("0.jpg" if image.mode == "CMYK" else "0.png")
    image.save(path)
    if wanted == "same":
        pixels = np.asarray(image.convert("RGB"))
        np.testing.assert_array_equal(ImageFrames([path]).read([0])[0], pixels)
        np.testing.assert_array_equal(EncodedFrames("x", [path.read_bytes()]).read([0])[0], pixels)
        np.testing.assert_array_equal(read_background(str(path)), pixels)
        return
    with pytest.raises(DataError, match=wanted):
        ImageFrames([path]).read([0])
    with pytest.raises(DataError, match=wanted):
        EncodedFrames("x", [path.read_bytes()]).read([0])
    with pytest.raises(ConfigError, match=f"background.image=.*({wanted}|save it as RGB)"):
        read_background(str(path))
