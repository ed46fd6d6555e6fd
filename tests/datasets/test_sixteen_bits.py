"""Grey pictures of 16 bits in folders: touch with its range, and depth."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image

from tactileforge.data.frames.lazy import ImageFrames
from tactileforge.data.frames.stacks import StackFrames
from tactileforge.data.frames.stamp import stamp_of
from tactileforge.datasets.recordings import Recordings
from tactileforge.errors import ConfigError, DataError

COUNT = 10


def values(bits: int) -> np.ndarray:
    """Slowly changing pictures, uint16 (T, 48, 64), up to nearly white."""
    ramp = np.linspace(0.2, 0.6, 48 * 64).reshape(48, 64)
    steps = np.linspace(0, 0.35, COUNT)[:, None, None]
    return np.round((ramp + steps) * (2**bits - 1)).astype(np.uint16)


def expected(pictures: np.ndarray, bits: int) -> np.ndarray:
    grey = np.rint(pictures * (255 / (2**bits - 1))).astype(np.uint8)
    return np.repeat(grey[..., None], 3, axis=-1)


def write(folder: Path, pictures: np.ndarray, ending: str = "png") -> None:
    folder.mkdir(parents=True, exist_ok=True)
    for number, picture in enumerate(pictures):
        cv2.imwrite(str(folder / f"{number:03d}.{ending}"), picture)


def stack(path: Path, pictures: np.ndarray) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    first, *others = map(Image.fromarray, pictures)
    first.save(path, save_all=True, append_images=others)


def read(root: Path) -> tuple[dict[str, np.ndarray], dict[str, object], list[str]]:
    guess = Recordings.recognise(root)
    assert guess is not None
    data = Recordings(**guess.options)
    found = [one for split in ("train", "val") for one in data.recordings(split)]
    assert not data.skipped
    frames = {one.key.partition("/")[2]: one.frames.read(range(len(one.frames))) for one in found}
    (layout,) = guess.options["layouts"].values()
    return frames, layout, list(guess.doubts)


@pytest.mark.parametrize("bits", [10, 12, 14, 16])
@pytest.mark.parametrize("ending", ["png", "tif"])
def test_the_range_of_pictures_is_guessed_and_said(tmp_path: Path, bits: int, ending: str) -> None:
    for take in range(2):
        write(tmp_path / f"tactile/take_{take}", values(bits), ending)
    frames, layout, doubts = read(tmp_path)
    assert layout["white"] == 2**bits - 1
    assert layout["each"] == "sequence"
    assert sum(line.startswith("white: ") and f"({bits} bits)" in line for line in doubts) == 1
    assert len(frames) == 2
    for shown in frames.values():
        np.testing.assert_array_equal(shown, expected(values(bits), bits))


@pytest.mark.parametrize("kind", ["npy", "tiff"])
def test_stacks_of_touch(tmp_path: Path, kind: str) -> None:
    path = tmp_path / f"a/tactile.{kind}"
    path.parent.mkdir(parents=True)
    if kind == "npy":
        np.save(path, values(12))
    else:
        stack(path, values(12))
    frames, layout, _ = read(tmp_path)
    assert layout["white"] == 4095
    (shown,) = frames.values()
    np.testing.assert_array_equal(shown, expected(values(12), 12))


def test_a_depth_stays_a_depth(tmp_path: Path) -> None:
    for take in range(2):
        write(tmp_path / f"take_{take}/tactile", values(8).astype(np.uint8))
        write(tmp_path / f"take_{take}/depth", values(14))
        np.save(tmp_path / f"take_{take}/tactile_depth.npy", values(14))
    frames, layout, doubts = read(tmp_path)
    assert "white" not in layout
    assert not any(line.startswith("white") for line in doubts)
    assert {Path(key).name for key in frames} == {"tactile"}


def test_a_depth_alone_is_no_touch(tmp_path: Path) -> None:
    write(tmp_path / "depth", values(14))
    guess = Recordings.recognise(tmp_path)
    assert guess is not None
    (layout,) = guess.options["layouts"].values()
    assert "white" not in layout
    with pytest.raises(DataError, match=r"I;16 pixels, 16 bits.* value of white: 1023, 4095"):
        list(Recordings(**guess.options).recordings("train"))


def test_a_background_of_16_bits(tmp_path: Path) -> None:
    write(tmp_path / "tactile/take", values(12))
    cv2.imwrite(str(tmp_path / "background.png"), values(12)[0])
    guess = Recordings.recognise(tmp_path)
    assert guess is not None
    (one,) = Recordings(**guess.options, val=0).recordings("train")
    np.testing.assert_array_equal(one.background(), expected(values(12), 12)[0])


def test_values_beyond_white_are_an_error(tmp_path: Path) -> None:
    write(tmp_path, values(14))
    frames = ImageFrames(sorted(tmp_path.glob("*.png")), white=4095)
    with pytest.raises(DataError, match="where 0 to 4095 is expected; correct `white`"):
        frames.read([0])


def test_white_is_checked(tmp_path: Path) -> None:
    layout = {"images": "*.png", "each": "touch", "sensor": "digit", "background": "none"}
    with pytest.raises(ConfigError, match=r"white is 200; .* 1023, 4095, 16383 or 65535"):
        Recordings(root=str(tmp_path), layouts={"mine": {**layout, "white": 200}})


def test_another_white_is_another_stamp(tmp_path: Path) -> None:
    write(tmp_path, values(12))
    stack(tmp_path / "a.tiff", values(12))
    paths = sorted(tmp_path.glob("*.png"))
    assert stamp_of(ImageFrames(paths, white=4095)) != stamp_of(ImageFrames(paths, white=65535))
    first, second = (StackFrames(tmp_path / "a.tiff", white=one) for one in (4095, 65535))
    assert stamp_of(first) != stamp_of(second)
