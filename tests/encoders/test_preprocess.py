"""Preprocessing, written out once more with numpy and Pillow."""

from typing import Any

import numpy as np
import pytest
import torch
from PIL import Image
from tactileforge_published.clip import PIXELS as CLIP

from tactileforge.encoders.preprocess import ANYTOUCH2, SPARSH, Preprocess
from tactileforge.errors import ConfigError

PLAIN = {"offset": None, "filter": "bilinear", "mean": (0, 0, 0), "std": (1, 1, 1)}


def smooth(height: int, width: int) -> np.ndarray:
    """A picture without hard edges: Pillow rounds to whole grey levels, we do not."""
    y, x = np.mgrid[:height, :width]
    waves = [np.sin(x / 9 + i) * np.cos(y / (11 + i)) for i in range(3)]
    return np.uint8(127 + 100 * np.stack(waves, axis=-1))


def ours(image: np.ndarray, size: tuple[int, int], options: dict[str, Any]) -> np.ndarray:
    frames = torch.from_numpy(image).permute(2, 0, 1)[None, None]
    out = Preprocess.of(size, options)(frames, torch.zeros_like(frames[:, 0]))
    return out[0, 0].permute(1, 2, 0).numpy()


@pytest.mark.parametrize(("height", "width"), [(60, 80), (80, 60), (64, 64)])
def test_cover_is_a_resize_and_a_crop(height: int, width: int) -> None:
    image = smooth(height, width)
    for edge, resample in ((32, "bicubic"), (36, "bilinear")):
        options = PLAIN | {"fit": "cover", "edge": edge, "filter": resample}
        scale = edge / min(height, width)
        sides = (int(width * scale + 1e-9), int(height * scale + 1e-9))
        large = Image.fromarray(image).resize(sides, getattr(Image.Resampling, resample.upper()))
        left, top = round((sides[0] - 32) / 2), round((sides[1] - 32) / 2)
        want = np.asarray(large.crop((left, top, left + 32, top + 32))) / 255
        assert np.abs(ours(image, (32, 32), options) - want).max() < 1.6 / 255


def test_clip_normalises_after_it() -> None:
    plain = ours(smooth(60, 80), (32, 32), PLAIN | {"fit": "cover", "filter": "bicubic"})
    want = (plain - np.array(CLIP["mean"])) / np.array(CLIP["std"])
    np.testing.assert_allclose(ours(smooth(60, 80), (32, 32), CLIP), want, atol=1e-5)


def test_portrait_turns_wide_frames_clockwise() -> None:
    image = smooth(48, 64)
    turned = Image.fromarray(image).transpose(Image.Transpose.ROTATE_270)
    want = np.asarray(turned.resize((24, 32), Image.Resampling.BILINEAR)) / 255
    options = PLAIN | {"fit": "portrait"}
    assert np.abs(ours(image, (32, 24), options) - want).max() < 1 / 255
    tall = np.array(turned)
    assert (ours(tall, (32, 24), options) == ours(image, (32, 24), options)).all()
    longer = np.pad(tall, ((10, 10), (0, 0), (0, 0)))  # another aspect loses its ends
    assert (ours(longer, (32, 24), options) == ours(tall, (32, 24), options)).all()


def test_pad_is_square_and_turned_anticlockwise() -> None:
    image = smooth(48, 64)
    square = np.pad(image, ((8, 8), (0, 0), (0, 0)))
    turned = Image.fromarray(square).transpose(Image.Transpose.ROTATE_90)
    want = np.asarray(turned.resize((32, 32), Image.Resampling.BILINEAR)) / 255
    assert np.abs(ours(image, (32, 32), PLAIN | {"fit": "pad"}) - want).max() < 1 / 255


def test_sparsh_subtracts_in_whole_grey_levels() -> None:
    levels = np.arange(256)
    for still in (0, 60, 131, 255):
        diff = np.clip((levels - still) / 255 + 0.5, 0, 1)
        want = np.uint8(diff * 255) / 255
        frames = torch.from_numpy(levels.astype(np.uint8)).view(1, 1, 1, 16, 16)
        frames = frames.expand(-1, -1, 3, -1, -1)
        background = torch.full((1, 3, 16, 16), still, dtype=torch.uint8)
        out = Preprocess.of((16, 16), SPARSH | {"fit": "squash"})(frames, background)
        np.testing.assert_allclose(out[0, 0, 0].flatten().numpy(), want, atol=1e-6)


@pytest.mark.parametrize("options", [ANYTOUCH2, SPARSH])
def test_a_neutral_background_changes_nothing(options: dict[str, Any]) -> None:
    frames = torch.randint(0, 256, (2, 1, 3, 16, 16), dtype=torch.uint8)
    neutral = torch.full((2, 3, 16, 16), 130, dtype=torch.uint8)
    neutral[1, 0, 0, 0] = 131  # only the first is
    out = Preprocess.of((16, 16), options | PLAIN | {"fit": "squash", "offset": options["offset"]})
    made = out(frames, neutral)
    torch.testing.assert_close(made[0], frames[0] / 255)
    shift = (frames[1].float() - 130 + options["offset"]).clamp(0, 255) / 255
    torch.testing.assert_close(made[1, :, 1:], shift[:, 1:])


def test_each_sensor_has_its_own_mean() -> None:
    options = PLAIN | {
        "fit": "squash",
        "mean": [[0, 0, 0], [1, 2, 3]],
        "std": [[1, 1, 1], [2, 2, 2]],
    }
    frames = torch.full((2, 1, 3, 4, 4), 255, dtype=torch.uint8)
    out = Preprocess.of((4, 4), options)(frames, frames[:, 0], torch.tensor([1, 0]))
    assert out[0, 0, :, 0, 0].tolist() == [0, -0.5, -1]
    assert out[1, 0, :, 0, 0].tolist() == [1, 1, 1]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"fit": "squeeze"}, "unknown encoder.pixels.fit 'squeeze'"),
        ({"filter": "nearest"}, "encoder.pixels.filter"),
        ({"offest": 3}, "did you mean 'offset'"),
        ({"mean": (1, 2)}, "encoder.pixels.mean has shape"),
        ({"edge": 3}, "encoder.pixels.edge is 3"),
    ],
)
def test_mistakes_are_named(change: dict[str, Any], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        Preprocess.of((16, 16), ANYTOUCH2 | change)
    with pytest.raises(ConfigError, match=r"encoder\.pixels lacks std"):
        Preprocess.of((16, 16), {key: value for key, value in ANYTOUCH2.items() if key != "std"})
