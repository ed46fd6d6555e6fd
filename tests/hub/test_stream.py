"""A stream predicts the same as the model on clips cut by time, at any rate of the camera."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import torch

import tactileforge
from tactileforge.encoders.tactile_vit import TactileViT
from tactileforge.errors import ConfigError, DataError, SensorError
from tactileforge.heads.force import ForceHead
from tactileforge.hub.files import make_header, save_checkpoint
from tactileforge.hub.model import Model
from tactileforge.sensors.background import Background
from tactileforge.sensors.streaming.contact import SlipOptions
from tactileforge.sensors.streaming.touch_stream import Prediction

NODE = {"name": "tactile_vit", "size": "tiny", "frames": 4, "image_size": 32}
HEADS = {"force": {"node": {"name": "force"}, "scale": {"digit": [1.0, 2.0, 4.0]}}}


@pytest.fixture
def model(vit: TactileViT, tmp_path: Path) -> Model:
    torch.manual_seed(3)
    header = make_header(vit, NODE, licence="MIT", spacing=0.1, heads=HEADS)
    save_checkpoint(tmp_path / "a.safetensors", vit, header, heads={"force": ForceHead(vit).eval()})
    return tactileforge.load(tmp_path / "a.safetensors")


def picture(i: int) -> np.ndarray:
    """A frame with noise; from the 20th on, a corner is pressed."""
    image = np.random.default_rng(i).integers(99, 102, (40, 48, 3)).astype(np.uint8)
    if i >= 20:
        image[8:24, 8:24] += 60
    return image


def pushed(stream: object, fps: float, count: int) -> Iterator[tuple[int, Prediction]]:
    for i in range(count):
        if (found := stream.push(picture(i), 5 + i / fps)) is not None:  # type: ignore[attr-defined]
            yield i, found


@pytest.mark.parametrize(("fps", "step"), [(10, 1), (20, 2), (60, 6), (25, 2)])
def test_predictions_are_the_models_at_any_rate(model: Model, fps: float, step: int) -> None:
    """25 frames a second give no tenths: clips are of every second frame."""
    stream = model.stream("digit", background=picture(0))
    found = list(pushed(stream, fps, 30))
    assert [i for i, _ in found] == list(range(3 * step, 30))
    for i, prediction in found[:: max(1, len(found) // 4)]:
        clip = np.stack([picture(i - k * step) for k in (3, 2, 1, 0)])
        force = model.force(clip, picture(0), "digit")[-1]
        assert prediction.force == pytest.approx(force.tolist(), abs=1e-5)
        assert prediction.force_unit == "relative"
        vector = model.encode(clip, picture(0), "digit")
        assert torch.allclose(torch.from_numpy(prediction.embedding), vector, atol=1e-5)
        assert prediction.time == pytest.approx(5 + i / fps)
        assert prediction.contact == (i >= 20)
    assert stream.done == len(found)


@pytest.mark.filterwarnings("ignore:force. an estimate")
def test_a_stream_and_a_batch_give_one_unit_and_slip_is_of_newtons(model: Model) -> None:
    found = {}
    for unit in ("relative", "uncalibrated"):
        given = {"force_unit": unit, "slip": SlipOptions(friction=0.6, least=0.25)}
        stream = model.stream("digit", background=picture(0), **given)
        found[unit] = [prediction for _, prediction in pushed(stream, 10, 30)]
    for shares, newtons in zip(*found.values(), strict=True):
        assert (shares.force_unit, newtons.force_unit) == tuple(found)
        assert np.multiply(shares.force, (1, 2, 4)) == pytest.approx(newtons.force, abs=1e-5)
        assert shares.slip == newtons.slip
    assert newtons.slip  # shares along z are below the least force
    clip = np.stack([picture(i) for i in range(26, 30)])
    batch = model.force(clip, picture(0), "digit", unit="uncalibrated")[-1]
    assert newtons.force == pytest.approx(batch.tolist(), abs=1e-5)


def test_the_background_is_the_median_of_the_first_second(model: Model) -> None:
    stream = model.stream("digit", background=Background(seconds=0.5), embedding=False)
    found = list(pushed(stream, 20, 14))
    assert [i for i, _ in found] == [10, 11, 12, 13]
    assert np.abs(stream.background.astype(int) - 100).max() <= 1
    assert found[0][1].embedding is None
    assert found[0][1].difference < 2
    touched = model.stream("digit", background=Background(seconds=1.5))
    with pytest.raises(SensorError, match="something touches it"):
        list(pushed(touched, 20, 40))
    first = model.stream("digit", background="first")
    assert [i for i, _ in pushed(first, 20, 8)] == [6, 7]
    assert np.array_equal(first.background, picture(0))


def test_a_camera_that_writes_into_one_buffer(model: Model) -> None:
    """Frames are copied: whoever gives them may use the memory again."""
    buffer = np.empty((40, 48, 3), np.uint8)
    mine, other = (model.stream("digit", background=picture(0)) for _ in range(2))
    for i in range(12):
        buffer[:] = picture(i)
        shared, own = mine.push(buffer, i / 10), other.push(picture(i), i / 10)
    assert shared.force == own.force


def test_slow_and_lost_frames(model: Model) -> None:
    slow = model.stream("digit", background=picture(0))
    with pytest.warns(UserWarning, match=r"every 0.333 s.* 0.1 s apart: clips are 3.3 times"):
        assert [i for i, _ in pushed(slow, 3, 6)] == [3, 4, 5]
    gap = model.stream("digit", background=picture(0))
    times = [0, 0.1, 0.2, 0.3, 0.4, 2.0, 2.1]
    found = [gap.push(picture(i), time) for i, time in enumerate(times)]
    assert [prediction is None for prediction in found] == [True] * 3 + [False] * 2 + [True] * 2


@pytest.mark.parametrize(
    ("frame", "time", "message"),
    [
        (picture(0), 1.0, "the frame before was at 1 s"),
        (picture(0), float("nan"), "time=nan"),
        (picture(0)[:20], 2.0, r"\(20, 48\) pixels, and the background and frames before"),
        (picture(0)[..., 0], 2.0, r"expected \(H, W, 3\), RGB, found \(40, 48\)"),
        (picture(0).astype(np.float32), 2.0, "found float32"),
    ],
)
def test_frames_that_are_refused(
    model: Model, frame: np.ndarray, time: float, message: str
) -> None:
    stream = model.stream("digit", background="first")
    stream.push(picture(0), 1.0)
    with pytest.raises(DataError, match=message):
        stream.push(frame, time)


def test_the_universal_tokens_are_a_sensor(model: Model) -> None:
    stream = model.stream("universal", background=picture(0))
    (_, first), *_ = pushed(stream, 10, 5)
    clip = np.stack([picture(i) for i in range(4)])
    vector = model.encode(clip, picture(0), "universal")
    assert torch.allclose(torch.from_numpy(first.embedding), vector, atol=1e-5)
    assert first.force is None


def test_streams_that_are_refused(model: Model) -> None:
    with pytest.raises(ConfigError, match="no sensor is named"):
        model.stream()
    with pytest.raises(ConfigError, match="did you mean 'digit'"):
        model.stream("digitt")
    with pytest.raises(ConfigError, match="background='none'"):
        model.stream("digit", background="none")  # type: ignore[arg-type]
    with pytest.warns(UserWarning, match="no calibration= of this unit"):
        model.stream("digit", force_unit="uncalibrated")
    with pytest.raises(ConfigError, match="needs the calibration= of this unit"):
        model.stream("digit", force_unit="N")


def test_black_frames_give_no_force(model: Model) -> None:
    stream = model.stream("digit", background=picture(0))
    for i in range(4):
        found = stream.push(picture(i) * (i < 3), i / 10)
    assert (found.trouble, found.contact, found.force, found.slip) == ("black", None, None, None)
    assert found.force_unit is None
