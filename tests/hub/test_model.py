"""A loaded model: any layout of pixels gives the vectors of the encoder, or a helpful error."""

import copy
import pickle
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from torch import Tensor
from videos import greys, write_video

import tactileforge
from tactileforge.contracts import NEUTRAL_BACKGROUND
from tactileforge.data.frames.lazy import VideoFrames
from tactileforge.encoders.feature_groups import SCALES
from tactileforge.encoders.plain_vit import PlainViT
from tactileforge.encoders.tactile_vit import TactileViT
from tactileforge.errors import ConfigError, DataError
from tactileforge.hub.files import make_header, open_encoder, save_checkpoint
from tactileforge.hub.model import Model


@pytest.fixture
def model(checkpoint: Path) -> Model:
    return tactileforge.load(checkpoint)


@pytest.fixture
def frames() -> np.ndarray:
    """Two clips, (B, T, H, W, 3), of another size than the encoder's."""
    return np.random.default_rng(0).integers(0, 256, (2, 4, 40, 48, 3), dtype=np.uint8)


@pytest.fixture
def still() -> np.ndarray:
    return np.random.default_rng(1).integers(100, 150, (40, 48, 3), dtype=np.uint8)


def test_vectors_are_those_of_the_encoder(
    model: Model, vit: TactileViT, frames: np.ndarray, still: np.ndarray
) -> None:
    x = torch.from_numpy(frames).movedim(-1, 2)
    background = torch.from_numpy(still).movedim(-1, 0).expand(2, -1, -1, -1)
    with torch.no_grad():
        tokens, cls = vit(x, background, torch.tensor([1, 0]))
    names = ["digit", "gelsight"]
    expected = {"tokens": tokens, "cls": tokens[:, 0], "projected": cls}
    for tap, values in expected.items():
        vectors = model.features(frames, still, names, tap=tap)
        torch.testing.assert_close(vectors, values, atol=1e-5, rtol=0)
    assert torch.equal(model.encode(frames, still, names), vectors)
    assert cls.dtype == torch.float32


def test_weights_that_change_are_used(model: Model, frames: np.ndarray) -> None:
    """The faster copies of weights never outlive their originals."""

    def check() -> Tensor:
        vectors = model.encode(frames, "none", "digit")
        x = torch.from_numpy(frames).movedim(-1, 2)
        with torch.no_grad():
            neutral = torch.full_like(x[:, 0], NEUTRAL_BACKGROUND)
            cls = model.encoder(x, neutral, torch.ones(2).long())[1]
        torch.testing.assert_close(vectors, cls, atol=1e-5, rtol=1e-4)
        return vectors

    before = check()
    model.encoder.requires_grad_(True)
    optimizer = torch.optim.SGD(model.encoder.parameters(), lr=1e-3)
    x = torch.from_numpy(frames).movedim(-1, 2)
    model.encoder(x, x[:, 0], torch.ones(2).long())[1].square().sum().backward()
    optimizer.step()
    stepped = check()
    assert (stepped - before).abs().max() > 1e-2
    model.encoder.load_state_dict({k: -v for k, v in model.encoder.state_dict().items()})
    assert (check() - stepped).abs().max() > 1e-2
    model.encoder.project = torch.nn.Linear(192, 512, bias=False)
    check()
    for parameter in model.encoder.parameters():
        parameter.data.mul_(1.5)
    check()


def test_an_encoder_with_a_forward_of_its_own_is_asked_by_it(model: Model) -> None:
    class Doubled(TactileViT):
        def forward(self, *inputs: Tensor) -> tuple[Tensor, Tensor]:
            tokens, cls = super().forward(*inputs)
            return tokens, 2 * cls

    clip = np.random.default_rng(0).integers(0, 256, (4, 40, 48, 3), dtype=np.uint8)
    expected = model.encode(clip, "none", "digit")
    encoder = Doubled("tiny", frames=4, image_size=32)
    encoder.load_state_dict(model.encoder.state_dict())
    vectors = Model(encoder, model.header).encode(clip, "none", "digit")
    torch.testing.assert_close(vectors, 2 * expected, atol=1e-5, rtol=0)
    forward = model.encoder.forward
    model.encoder.forward = lambda *inputs: (forward(*inputs)[0], torch.zeros(1, 512))
    assert not model.encode(clip, "none", "digit").any()


def test_an_encoder_put_in_its_place_is_asked(
    model: Model, frames: np.ndarray, still: np.ndarray
) -> None:
    usual = model.features(frames, still, "digit")
    other = copy.deepcopy(model.encoder)
    with torch.no_grad():
        for weight in other.parameters():
            weight.mul_(0.5)
    model.encoder = other
    assert not torch.allclose(model.features(frames, still, "digit"), usual)


def test_a_model_can_be_copied_after_use(model: Model, frames: np.ndarray) -> None:
    expected = model.encode(frames, "none", "digit")
    for other in (copy.deepcopy(model), pickle.loads(pickle.dumps(model))):
        assert torch.equal(other.encode(frames, "none", "digit"), expected)


def test_every_layout_is_the_same(model: Model, frames: np.ndarray, still: np.ndarray) -> None:
    expected = model.encode(frames, still, "digit")
    first = np.moveaxis(frames, -1, 2)  # not contiguous
    for x in (first, torch.from_numpy(frames), torch.from_numpy(first)):
        for y in (still, np.moveaxis(still, -1, 0), torch.from_numpy(still), np.stack([still] * 2)):
            assert torch.equal(model.encode(x, y, "digit"), expected)
    assert torch.allclose(model.encode(frames[0], still, "digit"), expected[0], atol=1e-5)
    backwards = np.ascontiguousarray(frames[..., ::-1])[..., ::-1]  # BGR turned round
    backwards.flags.writeable = False
    assert torch.equal(model.encode(backwards, still, "digit"), expected)
    assert torch.allclose(model.encode(frames, still, "digit", batch_size=1), expected, atol=1e-5)


def test_backgrounds_by_word(model: Model, frames: np.ndarray) -> None:
    neutral = np.full((40, 48, 3), NEUTRAL_BACKGROUND, np.uint8)
    expected = model.encode(frames, neutral, "digit")
    assert torch.equal(model.encode(frames, "none", "digit"), expected)
    expected = model.encode(frames, frames[:, 0], "digit")
    assert torch.equal(model.encode(frames, "first", "digit"), expected)


def test_vectors_can_train_a_probe(model: Model, frames: np.ndarray) -> None:
    probe = torch.nn.Linear(model.projected, 1)
    probe(model.encode(frames, "none", "digit")).sum().backward()
    assert probe.weight.grad is not None


@pytest.mark.parametrize(
    ("shape", "message"),
    [
        ((5, 40, 48, 3), "5 frames .* takes 4"),
        ((3, 3, 40, 48), "3 frames .* takes 4"),
        ((3, 40, 48, 3), "3 frames .* takes 4"),
        ((3, 4, 40, 48), r"expected \(T, H, W, 3\) .* found \(3, 4, 40, 48\)"),
        ((2, 3, 4, 40, 48), "colours are before the time"),
        ((40, 48, 4), "expected"),
        ((2, 40, 48, 3), "2 frames .* takes 4"),
        ((4, 40, 48, 1), "expected"),
    ],
)
def test_frames_of_another_shape(model: Model, shape: tuple[int, ...], message: str) -> None:
    with pytest.raises(DataError, match=message):
        model.encode(np.zeros(shape, np.uint8), "none", "digit")


def test_floats_beyond_1_are_refused_with_the_fix(model: Model, frames: np.ndarray) -> None:
    x = frames.astype(np.float32)
    with pytest.raises(DataError, match=r"found float32 from 0 to .*rint\(x\)"):
        model.encode(x, "none", "digit")
    with pytest.raises(DataError, match=r"torch.float32 from 0 .*round\(\).byte\(\)"):
        model.encode(torch.from_numpy(x), "none", "digit")
    with pytest.raises(DataError, match=r"from -0.5 to .*before normalisation"):
        model.encode(x / x.max() - 0.5, "none", "digit")
    with pytest.raises(DataError, match="found int64"):
        model.encode([1], "none", "digit")


def test_backgrounds_that_do_not_fit(model: Model, frames: np.ndarray, still: np.ndarray) -> None:
    with pytest.raises(DataError, match="20 x 48 pixels, but the frames have 40 x 48"):
        model.encode(frames, still[:20], "digit")
    with pytest.raises(DataError, match="3 of them for 2 clips"):
        model.encode(frames, np.stack([still] * 3), "digit")
    with pytest.raises(ConfigError, match=r"no background: .*background='none' subtracts nothing"):
        model.encode(frames, sensor="digit")
    with pytest.raises(ConfigError, match="background='median'"):
        model.encode(frames, "median", "digit")


def test_sensors(model: Model, frames: np.ndarray, vit: TactileViT) -> None:
    assert model.sensors == list(vit.sensors)
    with pytest.raises(ConfigError, match=r"no sensor is named: .*gelsight, digit"):
        model.encode(frames, "none")
    with pytest.raises(ConfigError, match=r"did you mean 'digit'.*unknown_sensor='universal'"):
        model.encode(frames, "none", "digitt")
    with pytest.raises(ConfigError, match="3 sensors for 2 clips"):
        model.encode(frames, "none", ["digit"] * 3)
    with pytest.raises(ConfigError, match="give error or universal"):
        model.encode(frames, "none", "digit", unknown_sensor="guess")  # type: ignore[arg-type]
    universal = model.encode(frames, "none", "universal")
    assert not torch.equal(universal, model.encode(frames, "none", "digit"))
    with pytest.warns(UserWarning, match=r"never saw mine: .* not meant for predicting force"):
        by_policy = model.encode(frames, "none", "mine", unknown_sensor="universal")
    assert torch.equal(by_policy, universal)
    with pytest.warns(UserWarning, match="never saw mine"):
        mixed = model.encode(frames, "none", ["mine", "digit"], unknown_sensor="universal")
    assert torch.allclose(mixed[0], universal[0], atol=1e-5)


def test_models_that_need_neither_sensor_nor_background(tmp_path: Path) -> None:
    node = {
        "size": "tiny",
        "frames": 1,
        "tube": 1,
        "image_size": 32,
        "spacing": 0.0,
        "pixels": {"offset": None, "fit": "squash", "filter": "bilinear", "mean": [0.5] * 3,
                   "std": [0.5] * 3},
    }  # fmt: skip
    encoder = PlainViT(**node)  # type: ignore[arg-type]
    header = make_header(encoder, {"name": "plain_vit", **node}, licence="MIT", spacing=0)
    model = Model(encoder, header)
    assert (model.sensors, model.any_sensor) == (list(encoder.sensors), True)
    image = np.zeros((40, 48, 3), np.uint8)
    assert model.encode(image).shape == (192,)
    assert torch.equal(model.encode(image), model.encode(image[None], "none", "anything"))
    with pytest.raises(ConfigError, match="no class token"):
        model.features(image, tap="cls")


def test_several_stems_have_no_universal_one() -> None:
    node: dict[str, Any] = {"size": "tiny", "image_size": 32, "stems": 2, "stem_depth": 1}
    node["sensors"] = {"digit": 0, "gelsight": 1}
    encoder = PlainViT(**node)
    header = make_header(encoder, {"name": "plain_vit", **node}, licence="MIT", spacing=0.1)
    model = Model(encoder, header)
    frames = np.zeros((2, 32, 32, 3), np.uint8)
    assert model.encode(frames, "none", "gelsight").shape == (192,)
    for name in ("mine", "universal"):
        with pytest.raises(ConfigError, match=f"unknown sensor of the model '{name}'"):
            model.encode(frames, "none", name, unknown_sensor="universal")


def test_another_number_of_frames(checkpoint: Path, vit: TactileViT, frames: np.ndarray) -> None:
    """Four frames are two slots: one slot has their mean, of a line through both."""
    with pytest.warns(UserWarning, match="trained on 4 frames; its positions were interpolated"):
        model = tactileforge.load(checkpoint, frames=2)
    cells = vit.position[1:].view(2, 4, -1)
    assert torch.equal(model.encoder.position[0], vit.position[0])
    assert torch.allclose(model.encoder.position[1:], cells.mean(0))
    assert model.encode(frames[:, :2], "none", "digit").shape == (2, 512)
    with pytest.warns(UserWarning, match="interpolated to 8"):
        model = tactileforge.load(checkpoint, frames=8)
    longer = model.encoder.position[1:].view(4, 4, -1)
    assert torch.allclose(longer[0], cells[0])
    assert torch.allclose(longer[1], 0.75 * cells[0] + 0.25 * cells[1], atol=1e-6)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        tactileforge.load(checkpoint, frames=4)
    with pytest.raises(ConfigError, match="tubes of 2 frames"):
        tactileforge.load(checkpoint, frames=3)


def test_fixed_positions_are_not_stretched(tmp_path: Path, installed: Callable[..., None]) -> None:
    entry = "[tactileforge.encoders]\nsines = tactileforge.encoders.plain_vit:PlainViT\n"
    installed("tactileforge-sines", entry, {})
    node: dict[str, Any] = {"name": "sines", "size": "tiny", "image_size": [32, 32]}
    encoder = PlainViT("tiny", image_size=[32, 32])
    save_checkpoint(tmp_path / "a", encoder, make_header(encoder, node, licence="MIT", spacing=0.1))
    _, header = open_encoder(tmp_path / "a")
    assert (header.package, header.package_version) == ("tactileforge-sines", "1.0")
    with pytest.raises(ConfigError, match="no learned positions over time"):
        open_encoder(tmp_path / "a", frames=4)


@pytest.fixture
def video(tmp_path: Path) -> Path:
    """A second of 20 Hz; frame i has the grey level 10 i."""
    return write_video(tmp_path / "touch.avi", greys(20, 10, (40, 48)), 20, "FFV1")


@pytest.mark.filterwarnings("ignore:clips. in .* the light has changed")  # pictures are made
def test_videos_are_cut_by_time(model: Model, video: Path) -> None:
    assert model.spacing == 0.05
    cuts = list(model.cut(video, hop=0.2))
    levels = [clip[:, 0, 0, 0].tolist() for _, clip in cuts]
    assert levels[:2] == [[0, 10, 20, 30], [40, 50, 60, 70]]
    assert [end for end, _ in cuts] == pytest.approx([0.15, 0.35, 0.55, 0.75, 0.95])
    times, vectors = model.encode_video(video, "first", "digit", batch_size=2)
    frames = VideoFrames(video)
    array = frames.read(range(len(frames)))
    _, again = model.encode_video(array, "first", "digit", batch_size=2, times=frames.times)
    assert torch.equal(again, vectors)
    assert times.tolist() == pytest.approx([end for end, _ in cuts])
    black = np.zeros((40, 48, 3), np.uint8)  # the first frame of the video
    expected = torch.stack([model.encode(clip, black, "digit") for _, clip in cuts])
    assert torch.allclose(vectors, expected, atol=1e-5)


def test_a_faster_camera_gives_the_same_clips(model: Model) -> None:
    from tactileforge.data.frames.lazy import ArrayFrames

    array = np.arange(40, dtype=np.uint8)[:, None, None, None] * np.ones((32, 32, 3), np.uint8)
    fast = ArrayFrames(array)
    ends = [clip[:, 0, 0, 0].tolist() for _, clip in model.cut(fast, 0.05, np.arange(40) / 40)]
    assert ends[0] == [0, 2, 4, 6]
    assert ends[1] == [2, 4, 6, 8]
    with pytest.raises(ConfigError, match="seconds of each of the 40 frames"):
        next(model.cut(fast))
    with pytest.raises(DataError, match="spans 7"):
        next(model.cut(ArrayFrames(array[:6]), 0.05, np.arange(6) / 40))


def test_what_a_model_says_of_itself(model: Model) -> None:
    assert repr(model).startswith("Model(thing.tiny: 3.")
    assert model.card is None
    assert model.recipe == {}
    assert (model.frames, model.projected, str(model.device)) == (4, 512, "cpu")
    with pytest.raises(ConfigError, match="did you mean 'tokens'"):
        model.features(np.zeros(1), tap="token")  # type: ignore[arg-type]


def test_groups_are_those_of_the_encoder(model: Model, frames: np.ndarray) -> None:
    groups = model.groups(frames, "first", "digit")
    assert {name: values.shape[1] for name, values in groups.items()} == model.group_sizes
    summary = model.features(frames, "first", "digit", tap="summary")
    torch.testing.assert_close(groups["summary"], summary)
    change = frames[:, -1].astype(float) - frames[:, 0]  # (B, 40, 48, 3)
    cells = change.reshape(2, 8, 5, 8, 6, 3).mean((2, 4)).transpose(0, 3, 1, 2)
    found = groups["difference"].view(2, 2, 3, 8, 8)
    for half in (0, 1):
        np.testing.assert_allclose(found[:, half], cells, atol=1e-4)
    one = model.groups(frames[1], "first", "digit", names=["difference"], batch_size=1)
    assert list(one) == ["difference"]
    torch.testing.assert_close(one["difference"], groups["difference"][1])


def test_no_network_runs_for_free_groups(
    model: Model, frames: np.ndarray, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(type(model.encoder), "forward", lambda *_: pytest.fail("it ran"))
    groups = model.groups(frames, "first", "digit", names=["statistics", "difference"])
    assert list(groups) == ["difference", "statistics"]
    with pytest.raises(ConfigError, match="photographs"):
        model.groups(frames, "first", "digit", names=["photographs"])


def test_groups_are_joined_with_fixed_factors(model: Model, frames: np.ndarray) -> None:
    names = ["statistics", "summary"]
    groups = model.groups(frames, "first", "digit", names=names)
    wanted = [SCALES[name] * groups[name] for name in ("summary", "statistics")]
    found = model.encode(frames, "first", "digit", groups=names)
    torch.testing.assert_close(found, torch.cat(wanted, 1))
    every = model.encode(frames[0], "first", "digit", groups="all")
    assert every.shape == (sum(model.group_sizes.values()),)
    torch.testing.assert_close(every[:960], found[0, :960], rtol=1e-4, atol=1e-4)
    assert model.encode(frames, "first", "digit").shape == (2, model.projected)
    with pytest.raises(ConfigError, match="give a list of names"):
        model.encode(frames, "first", "digit", groups="summary")  # type: ignore[arg-type]


@pytest.mark.filterwarnings("ignore:clips. in .* the light has changed")  # pictures are made
def test_a_weaker_touch_has_a_smaller_vector(model: Model) -> None:
    """No norm touches the difference, also of a model with vectors of a fixed length."""
    still = np.full((40, 48, 3), 100, np.uint8)
    weak, strong = (np.stack([still, still, still, still + up]) for up in (10, 40))
    once, more = (model.encode(x, still, "digit", groups=["difference"]) for x in (weak, strong))
    assert once[:192].min() > 0
    torch.testing.assert_close(more, 4 * once)
