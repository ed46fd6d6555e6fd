"""A model is a module: it moves, changes type, compiles, and trains as part of another."""

import copy
from pathlib import Path
from typing import Any

import lightning
import numpy as np
import pytest
import torch
from torch.nn import functional as F

import tactileforge
from tactileforge.encoders.plain_vit import PlainViT
from tactileforge.encoders.summary import summary_width
from tactileforge.encoders.tactile_vit import TactileViT
from tactileforge.errors import ConfigError, DataError
from tactileforge.heads.force import ForceHead
from tactileforge.hub.files import make_header, save_checkpoint
from tactileforge.hub.int8_linear import Int8Linear
from tactileforge.hub.model import Model
from tactileforge.hub.precision import has_bfloat16_units

pytestmark = pytest.mark.filterwarnings("ignore:force. an estimate")

NODE = {"name": "tactile_vit", "size": "tiny", "frames": 4, "image_size": 32}
HEADS = {"force": {"node": {"name": "force"}, "scale": {"digit": [1.0] * 3}}}


@pytest.fixture
def file(vit: TactileViT, tmp_path: Path) -> Path:
    header = make_header(vit, NODE, licence="MIT", spacing=0.05, heads=HEADS)
    save_checkpoint(tmp_path / "a.safetensors", vit, header, heads={"force": ForceHead(vit).eval()})
    return tmp_path / "a.safetensors"


@pytest.fixture
def model(file: Path) -> Model:
    return tactileforge.load(file)


@pytest.fixture
def frames() -> np.ndarray:
    """Two plausible clips of touch: smooth, and not black."""
    coarse = np.random.default_rng(0).normal(120, 40, (2, 4, 5, 6, 3))
    return coarse.repeat(8, 2).repeat(8, 3).clip(0, 255).astype(np.uint8)


def test_calling_is_encoding_with_gradients(model: Model, frames: np.ndarray) -> None:
    assert isinstance(model, torch.nn.Module)
    assert not any(p.requires_grad for p in model.parameters())
    expected = model.encode(frames, "first", "digit")
    torch.testing.assert_close(model(frames, "first", "digit"), expected, atol=1e-5, rtol=0)
    tokens = model(frames[0], "first", "digit", tap="tokens")
    assert tokens.shape == (14, 192)
    names = {name.split(".")[0] for name, _ in model.named_parameters()}
    assert names == {"encoder", "heads"}
    assert {name.split(".")[0] for name in model.state_dict()} == names
    model.requires_grad_(True)
    assert not model.encode(frames, "first", "digit").requires_grad
    model(frames, "first", "digit").sum().backward()
    grad = model.encoder.embed.weight.grad
    assert grad is not None
    assert grad.abs().sum() > 0


class Policy(lightning.LightningModule):
    """Somebody's policy on touch."""

    def __init__(self, touch: Model) -> None:
        super().__init__()
        self.touch = touch
        self.action = torch.nn.Linear(touch.projected, 2)

    def training_step(self, batch: torch.Tensor, index: int) -> torch.Tensor:
        return self.action(self.touch(batch, "first", "digit")).square().mean()

    def configure_optimizers(self) -> Any:
        known = [p for p in self.parameters() if p.requires_grad]
        return torch.optim.SGD(known, lr=1e-3)


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("trained", [False, True])
def test_a_model_in_somebodys_lightning_module(
    model: Model, frames: np.ndarray, trained: bool
) -> None:
    policy = Policy(model.requires_grad_(trained))
    before = copy.deepcopy(policy.state_dict())
    assert any(key.startswith("touch.encoder.") for key in before)
    trainer = lightning.Trainer(
        max_steps=1, accelerator="cpu", logger=False, enable_checkpointing=False,
        enable_progress_bar=False, enable_model_summary=False,
    )  # fmt: skip
    trainer.fit(policy, torch.utils.data.DataLoader(torch.from_numpy(frames), 2))
    after = policy.state_dict()
    changed = {key for key in before if not torch.equal(before[key], after[key])}
    assert "action.weight" in changed
    assert ("touch.encoder.embed.weight" in changed) == trained


@pytest.mark.slow
def test_compiled(model: Model, frames: np.ndarray) -> None:
    """Without generated code (`aot_eager`): testing it is up to torch."""
    compiled = torch.compile(model, backend="aot_eager")
    expected = model.encode(frames, "first", "digit")
    with torch.no_grad():
        found = compiled(frames, "first", "digit")
    torch.testing.assert_close(found, expected, atol=1e-4, rtol=0)


@pytest.mark.parametrize(("how", "dtype"), [("half", torch.float16), ("bfloat16", torch.bfloat16)])
def test_half_weights_and_whole_pixels(
    model: Model, frames: np.ndarray, how: str, dtype: torch.dtype
) -> None:
    expected = model.encode(frames, "first", "digit")
    force = model.force(frames, "first", "digit")
    mean = model.encoder.pixels.mean.clone()
    getattr(model, how)()
    assert {p.dtype for p in model.parameters()} == {dtype}
    assert model.encoder.pixels.mean.dtype == torch.float32
    assert torch.equal(model.encoder.pixels.mean, mean)
    found = model.encode(frames, "first", "digit")
    assert found.dtype == torch.float32
    assert F.cosine_similarity(found, expected).min() > 0.999
    assert (model.force(frames, "first", "digit") - force).abs().max() < 0.05
    assert model.features(frames, "first", "digit", tap="patches").shape == (2, 2, 2, 2, 192)
    assert model.features(frames, "first", "digit", tap="summary").shape[1:] == (
        summary_width(model.encoder),
    )
    model.float()
    again = model.encode(frames, "first", "digit")
    assert F.cosine_similarity(again, expected).min() > 0.999


def test_types_of_load(file: Path, model: Model, frames: np.ndarray) -> None:
    expected = model.encode(frames, "first", "digit")
    for dtype, least in (("float32", 0.999999), ("bfloat16", 0.9995), ("int8", 0.9995)):
        other = tactileforge.load(file, dtype=dtype)  # type: ignore[arg-type]
        found = other.encode(frames, "first", "digit")
        assert F.cosine_similarity(found, expected).min() > least, dtype
        assert other.fingerprint == model.fingerprint  # its calibration is that of the original
    layers = [m for m in other.encoder.modules() if isinstance(m, Int8Linear)]
    assert len(layers) == 4 * 6 + 2
    assert all(layer.weight.dtype == torch.int8 for layer in layers)
    kept = {p.dtype for p in tactileforge.load(file, dtype="auto").parameters()}
    cpu = torch.device("cpu")
    assert kept == {torch.bfloat16 if has_bfloat16_units(cpu) else torch.float32}
    with pytest.raises(ConfigError, match="unknown dtype 'float8'; did you mean 'float32'"):
        tactileforge.load(file, dtype="float8")  # type: ignore[arg-type]


def test_int8_products_are_exact_sums_of_rounded_numbers() -> None:
    linear = torch.nn.Linear(48, 16)
    x = torch.randn(2, 5, 48)
    weight = linear.weight.detach().double()
    steps = weight.abs().amax(1, keepdim=True) / 127
    rows = x.double().abs().amax(-1, keepdim=True) / 127
    expected = ((x / rows).round() * rows) @ ((weight / steps).round() * steps).T
    expected += linear.bias.detach()
    torch.testing.assert_close(Int8Linear(linear)(x).double(), expected, atol=1e-4, rtol=0)


def test_sparsh_too_in_bfloat16(frames: np.ndarray) -> None:
    """Fixed positions are buffers, not parameters."""
    encoder = PlainViT("tiny", image_size=(32, 32)).eval()
    header = make_header(encoder, {"name": "plain_vit"}, licence="MIT", spacing=0.1)
    model = Model(encoder, header)
    expected = model.encode(frames[:, :2], "first")
    found = model.bfloat16().encode(frames[:, :2], "first")
    assert F.cosine_similarity(found, expected).min() > 0.999


@pytest.mark.parametrize("device", ["cuda:99", "gpu", "meta2"])
def test_devices_that_are_not_there(file: Path, device: str) -> None:
    with pytest.raises(ConfigError, match=rf"^device='{device}': not on this machine"):
        tactileforge.load(file, device=device)


@pytest.mark.parametrize("batch_size", [0, -1, 1.5, True])
def test_batches_of_no_size(model: Model, frames: np.ndarray, batch_size: Any) -> None:
    with pytest.raises(ConfigError, match=rf"batch_size={batch_size}: give a whole number"):
        model.encode(frames, "first", "digit", batch_size=batch_size)


def test_times_and_hops_that_are_none(model: Model, frames: np.ndarray) -> None:
    from tactileforge.data.frames.lazy import ArrayFrames

    video = ArrayFrames(np.concatenate([frames[0]] * 3))
    times = np.arange(12) / 20
    for hop in (float("nan"), 0.0, -1.0, float("inf")):
        with pytest.raises(ConfigError, match=rf"hop={hop}: give the seconds"):
            model.encode_video(video, "first", "digit", hop=hop, times=times)
    with pytest.raises(ConfigError, match="batch_size=0"):
        model.encode_video(video, "first", "digit", batch_size=0, times=times)
    for row, value in ((5, np.nan), (7, times[6]), (7, times[2])):
        wrong = times.copy()
        wrong[row] = value
        with pytest.raises(DataError, match=rf"times: frame {row} is at {value:g} s after"):
            model.encode_video(video, "first", "digit", times=wrong)


@pytest.mark.parametrize("fps", [3.0, 5.0])
def test_a_slow_video_is_said_to_be_slow(model: Model, frames: np.ndarray, fps: float) -> None:
    from tactileforge.data.frames.lazy import ArrayFrames

    video = ArrayFrames(np.concatenate([frames[0]] * 2))
    with pytest.warns(UserWarning, match=rf"every {1 / fps:.3g} s.*frames 0.05 s apart"):
        model.encode_video(video, "first", "digit", times=np.arange(8) / fps)


def test_videos_of_a_varying_rate_are_cut_by_the_time_of_each_frame(model: Model) -> None:
    """A camera without frames 6 and 9 of a 20 Hz clock."""
    from tactileforge.data.frames.lazy import ArrayFrames

    shown = np.delete(np.arange(16), [6, 9])
    grey = (10 * shown)[:, None, None, None] * np.ones((32, 32, 3))
    clips = list(model.cut(ArrayFrames(grey.astype(np.uint8)), 0.05, shown / 20))
    levels = {round(20 * end): (clip[:, 0, 0, 0] // 10).tolist() for end, clip in clips}
    assert levels[5] == [2, 3, 4, 5]
    assert levels[15] == [12, 13, 14, 15]
    assert levels[10][0] == 7  # by number it would be 5
    assert all(clip[0] >= end - 4 for end, clip in levels.items())


def test_another_image_size(file: Path, vit: TactileViT, frames: np.ndarray) -> None:
    """Positions are a table over the image: a plane stays a plane in the middle."""
    rows = torch.arange(2.0).view(1, 2, 1).expand(2, 2, 2).flatten()
    with torch.no_grad():
        vit.position[1:] = rows[:, None]
    save_checkpoint(file, vit, make_header(vit, NODE, licence="MIT", spacing=0.05))
    with pytest.warns(UserWarning, match=r"trained on \[32, 32\] pixels a side; .* \[64, 48\]"):
        model = tactileforge.load(file, image_size=(64, 48))
    table = model.encoder.position[1:].view(2, 4, 3, -1)
    assert torch.equal(model.encoder.position[0], vit.position[0])
    assert (table.diff(dim=1) > 0).all()
    assert torch.allclose(table[:, 1:3].mean((1, 2)), torch.tensor(0.5), atol=1e-5)
    assert torch.allclose(table[..., :1, :], table, atol=1e-6)  # nothing changes along a row
    assert model.encode(frames, "first", "digit").shape == (2, 512)
    with pytest.raises(ConfigError, match="do not divide"):
        tactileforge.load(file, image_size=40)
