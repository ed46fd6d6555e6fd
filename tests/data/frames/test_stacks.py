"""Stacks of pictures in one file, and files of several pictures in place of one."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from tactileforge.data.frames.lazy import ImageFrames
from tactileforge.data.frames.stacks import StackFrames, is_stack, open_film
from tactileforge.data.frames.stamp import stamp_of
from tactileforge.errors import DataError, DataNotFoundError

RNG = np.random.default_rng(0)
PIXELS = RNG.integers(0, 256, (6, 10, 14, 3), np.uint8)


def save(path: Path, pixels=PIXELS, **options) -> Path:
    first, *rest = [Image.fromarray(one) for one in pixels]
    first.save(path, save_all=True, append_images=rest, **options)
    return path


@pytest.mark.parametrize("ending", [".tif", ".TIFF", ".npy"])
def test_frames_of_a_stack_are_exact(tmp_path: Path, ending: str) -> None:
    path = tmp_path / f"a{ending}"
    if ending == ".npy":
        np.save(path, PIXELS)
    else:
        save(path)
    frames = open_film(path)
    assert (len(frames), frames.shape) == (6, (10, 14))
    np.testing.assert_array_equal(frames.read([5, 0, 3]), PIXELS[[5, 0, 3]])
    np.testing.assert_array_equal(frames.crop((2, 1, 5, 4)).read([2])[0], PIXELS[2, 1:5, 2:7])
    assert stamp_of(frames)[0][0] == path.name
    assert is_stack(path)
    with pytest.raises(IndexError):
        frames.read([6])


def test_grey_arrays_have_three_channels(tmp_path: Path) -> None:
    for shape in ((6, 10, 14), (6, 10, 14, 1)):
        np.save(tmp_path / "a.npy", PIXELS[..., 0].reshape(shape))
        read = StackFrames(tmp_path / "a.npy").read([4])[0]
        np.testing.assert_array_equal(read, np.repeat(PIXELS[4, ..., :1], 3, axis=2))


def test_channels_may_come_first(tmp_path: Path) -> None:
    pixels = np.random.default_rng(1).integers(0, 256, (6, 18, 24, 3), np.uint8)
    np.save(tmp_path / "a.npy", np.moveaxis(pixels, -1, 1))
    stack = StackFrames(tmp_path / "a.npy")
    assert (len(stack), stack.shape) == (6, (18, 24))
    np.testing.assert_array_equal(stack.read([4, 1]), pixels[[4, 1]])


def test_what_is_no_stack_is_named(tmp_path: Path) -> None:
    def refused(wanted: str, kind=DataError) -> None:
        with pytest.raises(kind, match=wanted) as error:
            StackFrames(tmp_path / "a.npy")
        assert "\n" not in str(error.value)

    refused("no such file", DataNotFoundError)
    np.save(tmp_path / "a.npy", PIXELS.astype(np.float32) / 255)
    refused("float32 values.*255 \\* x")
    np.save(tmp_path / "a.npy", PIXELS[..., :2])
    refused(r"an array of \(6, 10, 14, 2\), where frames are \(T, H, W, 3\)")
    np.save(tmp_path / "a.npy", np.array([{"a": 1}]), allow_pickle=True)
    refused("objects of Python, .*numpy.savez\\('a.npz'")
    raw = (tmp_path / "a.npy").read_bytes()
    np.save(tmp_path / "a.npy", PIXELS)
    (tmp_path / "a.npy").write_bytes((tmp_path / "a.npy").read_bytes()[:300])
    refused("no readable array")
    (tmp_path / "a.npy").write_bytes(raw[:20])
    refused("no readable array")
    (tmp_path / "a.tif").write_bytes(b"damaged")
    with pytest.raises(DataError, match="not a readable stack"):
        StackFrames(tmp_path / "a.tif")
    assert not is_stack(tmp_path / "a.tif")


def test_pages_of_two_sizes_are_refused(tmp_path: Path) -> None:
    save(tmp_path / "a.tif", [PIXELS[0], PIXELS[1], PIXELS[2, :5]])
    with pytest.raises(DataError, match="page 2 has 14x5 pixels, the first 14x10"):
        StackFrames(tmp_path / "a.tif")


def test_a_reduced_copy_is_no_page(tmp_path: Path) -> None:
    path = tmp_path / "a.tif"
    first, copy = Image.fromarray(PIXELS[0]), Image.fromarray(PIXELS[1, :5, :7])
    copy.encoderinfo = {"tiffinfo": {254: 1}}
    first.save(path, save_all=True, append_images=[copy])
    with Image.open(path) as opened:
        assert opened.n_frames == 2
    np.testing.assert_array_equal(ImageFrames([path]).read([0])[0], PIXELS[0])


@pytest.mark.parametrize(
    ("name", "fix"),
    [("a.tif", "give videos: and its pattern"), ("a.webp", "save each"), ("a.png", "save each")],
)
def test_several_pictures_are_no_single_image(tmp_path: Path, name: str, fix: str) -> None:
    path = save(tmp_path / name)
    with pytest.raises(DataError, match=f"{name}: 6 pictures in one file; {fix}"):
        ImageFrames([path])


@pytest.mark.parametrize("channels", [1, 3, 4])
def test_one_picture_is_no_stack_of_narrow_ones(tmp_path: Path, channels: int) -> None:
    np.save(tmp_path / "0.npy", np.zeros((24, 32, channels), np.uint8))
    with pytest.raises(DataError, match=r"one picture of \(24, 32, .*np\.stack"):
        StackFrames(tmp_path / "0.npy")
    np.save(tmp_path / "0.npy", np.zeros((24, 32, 17), np.uint8))
    assert len(StackFrames(tmp_path / "0.npy")) == 24
