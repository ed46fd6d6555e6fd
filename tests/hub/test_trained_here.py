"""A model trained here sees frames as its training did, from any caller."""

import numpy as np
import pytest
import torch
from shipped import SHIPPED

import tactileforge
from tactileforge.data.batches.clips import resize_frame
from tactileforge.encoders.feature_groups import SCALES
from tactileforge.encoders.plain_vit import PlainViT
from tactileforge.encoders.preprocess import SPARSH
from tactileforge.hub import forces
from tactileforge.hub.files import make_header
from tactileforge.hub.model import Model
from tactileforge.sensors.light import changed_light

pytestmark = pytest.mark.filterwarnings("ignore:(force|surface). an estimate")


def touch(model: Model, column: int, grows: bool = True) -> np.ndarray:
    """A clip of 240 x 320 pixels of a growing contact."""
    rows, columns = np.mgrid[:240, :320]
    bump = np.exp(-((rows - 120) ** 2 + (columns - column) ** 2) / 400)[..., None]
    change = 60 * bump * np.array([1, 0.2, -1])
    shares = np.arange(1, model.frames + 1) / model.frames if grows else np.ones(model.frames)
    return np.stack([still() + share * change for share in shares]).clip(0, 255).astype(np.uint8)


def still() -> np.ndarray:
    slope = np.linspace(110, 130, 320)[None, :, None]
    return np.broadcast_to(slope, (240, 320, 3)).astype(np.uint8)


def small(model: Model, images: np.ndarray) -> np.ndarray:
    size = model.encoder.image_size
    flat = [resize_frame(image, size) for image in images.reshape(-1, *images.shape[-3:])]
    return np.stack(flat).reshape(*images.shape[:-3], *size, 3)


@pytest.mark.parametrize("name", SHIPPED)
def test_encode_sees_what_training_and_the_stream_see(name: str) -> None:
    model = tactileforge.load(name)
    sensor = model.sensors[0] if model.sensors else "digit"
    clip = touch(model, 60, grows=False)
    vector = model.encode(clip, still(), sensor)
    shown = model.encode(small(model, clip), small(model, still()), sensor)
    assert torch.equal(vector, shown)
    stream = model.stream(sensor, background=still())
    for number in range(model.frames * 8):
        found = stream.push(clip[0], number / 60)
    assert found is not None
    assert torch.allclose(torch.from_numpy(found.embedding), vector, atol=1e-5)
    batch = torch.from_numpy(np.stack([clip, touch(model, 200)])).movedim(-1, -3)
    first = model.encode(small(model, clip), small(model, clip[0]), sensor)
    assert torch.allclose(model.encode(batch, "first", sensor)[0], first, atol=1e-5)


def test_a_contact_near_the_edge_is_seen() -> None:
    """The sides of a wide frame were turned and cut off."""
    model = tactileforge.load("touch.tiny")
    nothing = np.stack([still()] * model.frames)
    calm = model.features(nothing, still(), "digit")
    for column in (12, 308):
        touched = model.features(touch(model, column), still(), "digit")
        assert (touched - calm).norm() > 0.1 * calm.norm()


@pytest.mark.parametrize("name", SHIPPED)
def test_a_vector_is_the_scaled_summary(name: str) -> None:
    model = tactileforge.load(name)
    clip, sensor = touch(model, 60), model.sensors[0] if model.sensors else "digit"
    vector = model.encode(clip, still(), sensor)
    assert len(vector) == model.vector_size == model.group_sizes["summary"]
    summary = model.features(clip, still(), sensor, tap="summary")
    torch.testing.assert_close(vector, SCALES["summary"] * summary)
    assert torch.equal(model.encode(clip, still(), sensor, groups=["summary"]), vector)
    reading = model.readings(clip, still(), sensor)
    torch.testing.assert_close(reading.vector, vector, atol=1e-5, rtol=0)


def test_calling_and_reading_heads_see_the_same() -> None:
    model = tactileforge.load("anytouch2.tiny")
    clip = touch(model, 60)
    given = clip[None], still(), "digit"
    shown = small(model, clip)[None], small(model, still()), "digit"
    with torch.no_grad():
        assert torch.equal(model(*given), model(*shown))
    assert torch.equal(model.force(*given), model.force(*shown))
    assert torch.equal(model.surface(*given), model.surface(*shown))
    inputs, others = model.force_inputs(*given), model.force_inputs(*shown)
    assert inputs.keys() == others.keys()
    assert all(torch.equal(value, others[key]) for key, value in inputs.items())


def test_light_is_looked_at_once_for_all_inputs(monkeypatch: pytest.MonkeyPatch) -> None:
    looked = []
    monkeypatch.setattr(
        forces, "changed_light", lambda *images: looked.append(images) or changed_light(*images)
    )
    model = tactileforge.load("anytouch2.tiny")
    inputs = model.force_inputs(touch(model, 60)[None], still(), "digit")
    assert len(inputs) > 3
    assert len(looked) == 1


def test_imported_weights_see_frames_as_they_are() -> None:
    encoder = PlainViT("tiny", depth=1, frames=1, tube=1, image_size=32, pixels=SPARSH).eval()
    node = {"name": "plain_vit"}
    frames = np.random.default_rng(0).integers(0, 256, (1, 48, 64, 3), np.uint8)
    for recipe, same in (({}, False), ({"a": 1}, True)):
        header = make_header(encoder, node, licence="MIT", spacing=0.0, recipe=recipe)
        model = Model(encoder, header)
        assert model.reading == ("projected" if not recipe else "summary")
        found = model.features(frames, "none", "digit")
        shown = model.features(small(model, frames), "none", "digit")
        assert torch.equal(found, shown) == same
        assert model.squash(frames).shape[1:3] == ((32, 32) if same else (48, 64))
