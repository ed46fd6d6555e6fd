"""Heads kept beside an encoder, and their forces."""

import json
from pathlib import Path

import numpy as np
import pytest
import torch
from omegaconf import OmegaConf
from safetensors.torch import load_file, save_file

import tactileforge
from tactileforge.data.labels.displacement import decode_displacement
from tactileforge.encoders.tactile_vit import TactileViT
from tactileforge.errors import ConfigError, DataError, PluginError
from tactileforge.heads.force import ForceHead
from tactileforge.heads.surface import SurfaceHead
from tactileforge.hub import pack
from tactileforge.hub.files import make_header, open_model, save_checkpoint
from tactileforge.hub.starting_point import starting_weights
from tactileforge.runs.folder import LAST
from tactileforge.specs.published import spec
from tactileforge.training.checkpoints import AtomicCheckpointIO
from tactileforge.training.initial import start_from

NODE = {"name": "tactile_vit", "size": "tiny", "frames": 4, "image_size": 32}
HEADS = {"force": {"node": {"name": "force"}, "scale": {"digit": [1.0, 2.0, 4.0]}}}


@pytest.fixture
def head(vit: TactileViT) -> ForceHead:
    torch.manual_seed(3)
    return ForceHead(vit).eval()


@pytest.fixture
def file(vit: TactileViT, head: ForceHead, tmp_path: Path) -> Path:
    header = make_header(vit, NODE, licence="MIT", spacing=0.05, heads=HEADS)
    save_checkpoint(tmp_path / "a.safetensors", vit, header, heads={"force": head})
    return tmp_path / "a.safetensors"


def clips(count: int) -> np.ndarray:
    return np.random.default_rng(1).integers(0, 256, (count, 4, 40, 48, 3), dtype=np.uint8)


def test_forces_are_those_of_the_head_in_newton(
    file: Path, vit: TactileViT, head: ForceHead
) -> None:
    model = tactileforge.load(file)
    frames = clips(2)
    batch = torch.from_numpy(frames).movedim(-1, -3)
    views = vit.views({"frames": batch, "background": batch[:, 0], "sensor": ["digit", "digit"]})
    with torch.no_grad():
        expected = head(views, {}).force * torch.tensor([1.0, 2.0, 4.0])
    with pytest.warns(UserWarning, match=r"^force: an estimate, not a measurement"):
        force = model.force(frames, "first", "digit", unit="uncalibrated")
    with pytest.warns(UserWarning, match=r"^force: an estimate"):
        single = model.force(frames[1], "first", "digit", unit="uncalibrated")
    assert force.shape == (2, 3, 3)
    assert torch.allclose(force, expected, atol=1e-5)
    assert torch.allclose(single, expected[1], atol=1e-5)
    both = model.readings(frames, "first", ["digit", "digit"])
    assert torch.allclose(both.vector, model.encode(frames, "first", "digit"), atol=1e-5)
    assert not any(p.requires_grad for p in model.heads["force"].parameters())


def test_without_a_calibration_forces_are_shares_of_the_scale(file: Path) -> None:
    """Nothing is clipped, signs stay, and nothing but what was asked for is newton."""
    model = tactileforge.load(file)
    clip = clips(1)[0]
    force = model.force(clip, "first", "digit")  # an estimate would warn, which fails
    assert torch.equal(force, model.force(clip, "first", "digit", unit="relative"))
    assert force.min() < 0 < force.abs().max() <= 1
    with pytest.warns(UserWarning, match="no calibration= of this unit"):
        newton = model.force(clip, "first", "digit", unit="uncalibrated")
    assert torch.allclose(force * torch.tensor([1.0, 2.0, 4.0]), newton, atol=1e-6)
    assert (model.force_unit(), model.force_unit(unit="uncalibrated")) == (
        *("relative", "uncalibrated"),
    )
    reading = model.readings(clip, "first", "digit")
    assert reading.force_unit == "relative"
    assert torch.equal(reading.force, force)
    assert torch.equal(reading.newton, newton)
    with pytest.raises(ConfigError, match=r"unit='N' needs the calibration= of this unit"):
        model.force(clip, "first", "digit", unit="N")
    with pytest.raises(ConfigError, match=r"unit of force 'relativ'.*did you mean 'relative'"):
        model.force(clip, "first", "digit", unit="relativ")  # type: ignore[arg-type]
    with pytest.raises(ConfigError, match="unit='relative' is what the model says by itself"):
        model.force_unit("mine.yaml", "relative")
    assert model.force_unit("mine.yaml") == "N"


def test_shares_beyond_the_scale_are_not_clipped(file: Path) -> None:
    model = tactileforge.load(file)
    with torch.no_grad():
        for p in model.heads["force"].force.parameters():
            p.mul_(30)
    with pytest.warns(UserWarning, match="frames have none .NaN.*beyond the scale"):
        force = model.force(clips(2), "first", "digit")
    assert force.isnan().any()
    assert force.nan_to_num().abs().max() <= 1


@pytest.mark.parametrize(
    ("data", "unit"), [("recordings", "N"), ("sim", "relative"), ("shards", "relative")]
)
def test_forces_learned_on_own_recordings_are_newtons(
    vit: TactileViT, head: ForceHead, tmp_path: Path, data: str, unit: str
) -> None:
    recipe = {"data": {"name": data}}
    header = make_header(vit, NODE, licence="MIT", spacing=0.05, heads=HEADS, recipe=recipe)
    save_checkpoint(tmp_path / "a.safetensors", vit, header, heads={"force": head})
    model = tactileforge.load(tmp_path / "a.safetensors")
    reading = model.readings(clips(1)[0], "first", "digit")
    assert (model.force_unit(), reading.force_unit) == (unit, unit)
    assert torch.equal(model.force(clips(1)[0], "first", "digit"), reading.force)  # no warning
    assert torch.equal(reading.force, reading.newton) == (unit == "N")
    assert model.force_unit(unit="relative") == "relative"
    assert model.force_unit(unit="uncalibrated") == ("N" if unit == "N" else "uncalibrated")


def test_the_surface_is_that_of_the_head_in_mm(vit: TactileViT, tmp_path: Path) -> None:
    torch.manual_seed(3)
    head = SurfaceHead(vit).eval()
    torch.nn.init.normal_(head.linear.weight, std=0.3)
    heads = {"surface": {"node": {"name": "surface"}}}
    header = make_header(vit, NODE, licence="MIT", spacing=0.05, heads=heads)
    save_checkpoint(tmp_path / "a.safetensors", vit, header, heads={"surface": head})
    model = tactileforge.load(tmp_path / "a.safetensors")
    frames = clips(2)
    batch = torch.from_numpy(frames).movedim(-1, -3)
    views = vit.views({"frames": batch, "background": batch[:, 0], "sensor": ["digit", "digit"]})
    with torch.no_grad():
        coded = head(views, {}).clamp(-1, 1)
    with pytest.warns(UserWarning, match=r"^surface: an estimate, not a measurement") as said:
        surface = model.surface(frames, "first", "digit")
    assert (len(said), said[0].filename) == (1, __file__)
    assert surface.shape == (2, 4, 3, 32, 32)
    image = torch.round(128 + 127 * coded).to(torch.uint8).movedim(2, -1).numpy()
    inside = (coded.abs() < 1).all(2, keepdim=True).movedim(2, -1).numpy()
    expected = decode_displacement(image)
    error = np.abs(surface.movedim(2, -1).numpy() - expected)[np.broadcast_to(inside, image.shape)]
    assert error.max() < 0.017  # half a level at 2 mm
    with pytest.warns(UserWarning, match="calibrate depth"):
        again = model.surface(frames[1], "first", "digit")
    # products of matrices of other sizes are rounded otherwise
    torch.testing.assert_close(again, surface[1], rtol=1e-4, atol=1e-4)
    with pytest.raises(ConfigError, match="no force head"):
        model.force(frames, "first", "digit")


def test_a_file_without_a_surface_head_says_so(file: Path) -> None:
    with pytest.raises(ConfigError, match="no surface head"):
        tactileforge.load(file).surface(clips(1), "first", "digit")


def test_no_scale_no_newton(file: Path) -> None:
    model = tactileforge.load(file)
    for sensor in ("gelsight", "universal"):
        assert model.readings(clips(1), "first", sensor).force is None
        with pytest.raises(ConfigError, match=r"say which sensor it is, one of: digit$"):
            model.force(clips(1), "first", sensor)


def test_files_without_heads_are_what_they_were(checkpoint: Path) -> None:
    header = json.loads(_metadata(checkpoint))
    assert "heads" not in header
    model = tactileforge.load(checkpoint)
    assert not model.heads
    assert model.readings(clips(1)[0], "first", "digit").force is None
    with pytest.raises(ConfigError, match="no force head: pack a run whose objectives include"):
        model.force(clips(1), "first", "digit")


def _metadata(path: Path) -> str:
    data = path.read_bytes()
    table = json.loads(data[8 : 8 + int.from_bytes(data[:8], "little")])
    header = json.loads(table["__metadata__"]["tactileforge"])
    del header["sha256"]  # another program writes none
    return json.dumps(header)


def test_heads_are_loaded_strictly(file: Path) -> None:
    state, metadata = load_file(file), {"tactileforge": _metadata(file)}
    assert {key.split(".")[1] for key in state if key.startswith("head.")} == {"force"}
    lost = next(key for key in state if key.startswith("head.force.delta"))
    save_file({k: v for k, v in state.items() if k != lost}, file, metadata=metadata)
    with pytest.raises(DataError, match=r"head force: .* 1 missing: delta\."):
        tactileforge.load(file)
    save_file(state | {"head.force.more": torch.ones(1)}, file, metadata=metadata)
    with pytest.raises(DataError, match=r"1 unexpected: more"):
        tactileforge.load(file)
    save_file(state | {"head.other.more": torch.ones(1)}, file, metadata=metadata)
    with pytest.raises(DataError, match=r"1 unexpected: head.other.more"):
        tactileforge.load(file)


@pytest.mark.parametrize(
    ("heads", "error", "message"),
    [
        ({"force": 3}, DataError, "head force: expected names and values, found int"),
        ({"force": {"node": {}}}, DataError, "head force has no name"),
        ({"force": {"node": {"name": "frce"}}}, PluginError, "did you mean 'force'"),
    ],
)
def test_headers_that_name_no_head(
    file: Path, heads: object, error: type[Exception], message: str
) -> None:
    header = json.loads(_metadata(file)) | {"heads": heads}
    save_file(load_file(file), file, metadata={"tactileforge": json.dumps(header)})
    with pytest.raises(error, match=message):
        tactileforge.load(file)


def test_another_number_of_frames_has_no_head(file: Path) -> None:
    encoder, heads, _ = open_model(file, frames=8)
    assert (encoder.frames, heads) == (8, {})


@pytest.fixture
def run(vit: TactileViT, head: ForceHead, tmp_path: Path) -> Path:
    """Files of a run read by `pack`."""
    config = {
        "encoder": NODE,
        "batch": {"spacing": 0.05},
        "data": {"name": "sim"},
        "head": {"force": {"name": "force", "heads": None}, "match": {"name": "match"}},
    }
    OmegaConf.save(OmegaConf.create(config), tmp_path / "config.yaml")
    state = {f"encoder.{key}": x for key, x in vit.state_dict().items()}
    state |= {f"heads.force.{key}": x for key, x in head.state_dict().items()}
    checkpoint = {"state_dict": state, "global_step": 7}
    AtomicCheckpointIO().save_checkpoint(checkpoint, tmp_path / LAST)
    return tmp_path


def test_the_force_head_of_a_run_is_packed(run: Path, head: ForceHead) -> None:
    model = tactileforge.load(pack.pack_run(run))
    assert model.heads.keys() == {"force"}
    for key, value in model.heads["force"].state_dict().items():
        assert torch.equal(value, head.state_dict()[key])
    kept = model.header.heads["force"]
    assert kept["node"] == {"name": "force", "heads": None}
    assert kept["scale"]["digit"] == list(spec("digit").force_scale)
    assert kept["scale"].keys() == set(model.sensors)


def test_a_run_without_forces_has_no_head(run: Path) -> None:
    config = OmegaConf.load(run / "config.yaml")
    config.head.pop("force")
    OmegaConf.save(config, run / "config.yaml")
    assert not tactileforge.load(pack.pack_run(run)).heads


def test_a_run_starts_from_encoder_and_heads_of_a_file(
    file: Path, vit: TactileViT, head: ForceHead
) -> None:
    node, state = starting_weights(f"file:{file}")
    assert node == NODE
    wanted = {f"encoder.{k}": v for k, v in vit.state_dict().items()}
    wanted |= {f"heads.force.{k}": v for k, v in head.state_dict().items()}
    assert state.keys() == wanted.keys()
    assert all(torch.equal(state[key], value) for key, value in wanted.items())


def test_training_takes_the_encoder_of_a_model_with_its_options(file: Path) -> None:
    plain = {
        "init": f"file:{file}",
        "encoder": {"name": "tactile_vit", "size": "base", "mask_ratio": 0.3},
    }
    state = start_from(plain)
    assert plain["encoder"] == NODE | {"mask_ratio": 0.3}
    assert "heads.force.force.probe.0.weight" in state
    with pytest.raises(ConfigError, match=r"did you mean .tiny."):
        start_from({"init": "anytouch2.tini", "encoder": {"name": "tactile_vit"}})
