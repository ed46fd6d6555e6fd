"""A file with a force head gives forces, without torch and without this package."""

import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from tactileforge_export import export, read_facts
from videos import write_video

import tactileforge
from tactileforge import cli
from tactileforge.encoders.plain_vit import PlainViT
from tactileforge.encoders.preprocess import ANYTOUCH2
from tactileforge.encoders.tactile_vit import TactileViT
from tactileforge.errors import ConfigError, DataError, DataNotFoundError
from tactileforge.heads.force import ForceHead
from tactileforge.hub import CLASS_FORMAT, ClassFacts, ClassHead
from tactileforge.hub.files import make_header, save_checkpoint

onnxruntime = pytest.importorskip("onnxruntime")
pytest.importorskip("onnxscript")

ROOT = Path(__file__).parents[3]
pytestmark = pytest.mark.filterwarnings("ignore:force. an estimate")

NODE = {"name": "tactile_vit", "size": "tiny", "depth": 1, "frames": 4, "image_size": 32}
NODE |= {"sensors": {"digit": 1, "gelsight": 3}}
HEADS = {"force": {"node": {"name": "force"}, "scale": {"digit": [1.0, 2.0, 4.0]}}}


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    torch.manual_seed(3)
    options: dict[str, Any] = {key: value for key, value in NODE.items() if key != "name"}
    vit = TactileViT(**options).eval()
    header = make_header(vit, NODE, licence="MIT", spacing=0.1, name="thing.tiny", heads=HEADS)
    path = tmp_path_factory.mktemp("model") / "thing.safetensors"
    save_checkpoint(path, vit, header, heads={"force": ForceHead(vit).eval()})
    return path


@pytest.fixture(scope="module")
def exported(file: Path, tmp_path_factory: pytest.TempPathFactory) -> str:
    return export(file, tmp_path_factory.mktemp("onnx") / "thing.onnx", size=(40, 48)).path


def clips(count: int) -> np.ndarray:
    return np.random.default_rng(1).integers(0, 256, (count, 4, 40, 48, 3), dtype=np.uint8)


def run(path: str, frames: np.ndarray, rows: list[int], *names: str) -> list[np.ndarray]:
    session = onnxruntime.InferenceSession(path, providers=["CPUExecutionProvider"])
    frames = np.ascontiguousarray(np.moveaxis(frames, -1, 2))
    feed = {"frames": frames, "background": frames[:, 0], "sensor": np.array(rows)}
    found: list[np.ndarray] = session.run(list(names), feed)
    return found


@pytest.mark.slow
def test_forces_are_the_models(file: Path, exported: str) -> None:
    model = tactileforge.load(file)
    facts = read_facts(exported)
    force, cls = run(exported, clips(3), facts.sensor_ids(["digit"] * 3), "force", "cls")
    assert np.abs(force - model.force(clips(3), "first", "digit").numpy()).max() < 2e-5
    assert np.abs(cls - model.encode(clips(3), "first", "digit").numpy()).max() < 5e-5
    assert facts.force["scale"] == {"digit": [1.0, 2.0, 4.0]}
    assert facts.force["unit"] == "relative"
    assert [axis[0] for axis in facts.force["axes"]] == ["x", "y", "z"]
    assert facts.weights == model.fingerprint
    assert facts.version == tactileforge.__version__
    assert facts.preprocessing["mean"] == pytest.approx(ANYTOUCH2["mean"])
    assert facts.error < 5e-5


@pytest.mark.slow
def test_no_scale_is_no_number_and_an_untrained_row_is_refused(exported: str) -> None:
    facts = read_facts(exported)
    assert facts.sensors == {"digit": 1, "gelsight": 3, "universal": 19}
    force, cls = run(exported, clips(3), [1, 3, 19], "force", "cls")
    assert np.isfinite(force).all(axis=(1, 2)).tolist() == [True, False, False]
    assert np.isfinite(cls).all()
    for row in (0, 2, 7, 18):
        with pytest.raises(Exception, match=r"invalid index|out of (data )?bounds"):
            run(exported, clips(1), [row], "cls")


@pytest.mark.slow
def test_sensors_of_one_row_keep_their_scales(tmp_path: Path) -> None:
    """Two sensors alike to the encoder have force scales of their own."""
    options: dict[str, Any] = {key: value for key, value in NODE.items() if key != "name"}
    options["sensors"] = {"digit": 1, "gelsight": 1}
    scale = {"digit": [1.0, 2.0, 4.0], "gelsight": [10.0, 20.0, 40.0]}
    vit = TactileViT(**options).eval()
    header = make_header(
        vit,
        {**options, "name": "tactile_vit"},
        licence="MIT",
        spacing=0.1,
        name="thing.tiny",
        heads={"force": {"node": {"name": "force"}, "scale": scale}},
    )
    file = tmp_path / "thing.safetensors"
    save_checkpoint(file, vit, header, heads={"force": ForceHead(vit).eval()})
    path = export(file, tmp_path / "thing.onnx", size=(40, 48)).path
    model, facts = tactileforge.load(file), read_facts(path)
    for name in scale:
        (force,) = run(path, clips(1), facts.sensor_ids([name]), "force")
        assert np.abs(force - model.force(clips(1), "first", name).numpy()).max() < 1e-4


@pytest.mark.slow
def test_the_torch_program_too(file: Path, tmp_path: Path) -> None:
    """And estimated newtons where they are asked for."""
    given = {"format": "torch_export", "size": (40, 48), "force_unit": "uncalibrated"}
    done = export(file, tmp_path / "a.pt2", **given)
    assert done.force["unit"] == "uncalibrated"
    program = torch.export.load(done.path).module()
    frames = torch.from_numpy(clips(2)).movedim(-1, 2).contiguous()
    _, _, force = program(frames, frames[:, 0], torch.tensor([1, 1]))
    expected = tactileforge.load(file).force(clips(2), "first", "digit", unit="uncalibrated")
    torch.testing.assert_close(force, expected, atol=1e-5, rtol=0)


@pytest.mark.slow
def test_a_file_gives_no_newtons_that_nobody_measured(file: Path, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="unit='N' needs the calibration= of this unit"):
        export(file, tmp_path / "a.onnx", force_unit="N")


@pytest.mark.slow
def test_rounded_weights_are_not_exported(file: Path, tmp_path: Path) -> None:
    for dtype in ("bfloat16", "int8"):
        model = tactileforge.load(file, dtype=dtype)  # type: ignore[arg-type]
        with pytest.raises(ConfigError, match="export takes float32 weights"):
            export(model, tmp_path / "a.onnx")


@pytest.mark.slow
def test_what_is_built_like_t3_exports_for_one_size(tmp_path: Path) -> None:
    """A stem and a mean for each sensor; the shorter side to an edge, the centre cut out."""
    pixels = {**ANYTOUCH2, "fit": "cover", "edge": 36, "offset": None}
    pixels |= {"mean": [[0.1, 0.2, 0.3], [0.4, 0.5, 0.6]], "std": [[0.2] * 3, [0.3] * 3]}
    encoder = PlainViT(
        "tiny", depth=2, frames=1, tube=1, image_size=32, positions="learned", class_token=True,
        layer_scale=None, stems=2, stem_depth=1, sensors={"mini": 0, "digit": 1}, pool="class",
        spacing=0.0, pixels=pixels,
    )  # fmt: skip
    assert export(encoder, tmp_path / "t3.onnx", size=(48, 64)).error < 2e-5
    with pytest.raises(
        ConfigError, match=r"^ONNX has no graph .* any size: give it, size=\[H,W\]; or"
    ):
        export(encoder, tmp_path / "other.onnx")


BLOCKED = """
import sys
class Refuse:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in ("torch", "tactileforge"):
            raise ImportError(name)
sys.meta_path.insert(0, Refuse())
"""


@pytest.mark.slow
@pytest.mark.parametrize("turns", [0, -1])
def test_the_script_of_the_page_needs_neither_torch_nor_tactileforge(
    file: Path, exported: str, tmp_path: Path, turns: int
) -> None:
    """Also with pictures on their side, as those of the camera of a DIGIT."""
    page = (ROOT / "docs" / "export.md").read_text()
    [script] = re.findall(r"cat > force\.py <<'END'\n(.*?)^END$", page, re.M | re.S)
    assert len(script.splitlines()) <= 32
    assert not re.search(r"torch|tactileforge\b(?!\"\])", script)
    frames = clips(5).reshape(20, 40, 48, 3)
    write_video(tmp_path / "a.avi", np.rot90(frames, turns, (1, 2)), 20, "FFV1")
    (tmp_path / "force.py").write_text(BLOCKED + script)
    command = [sys.executable, "force.py", exported, "a.avi", "digit"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    lines = done.stdout.splitlines()
    assert len(lines) == 14  # the first clip ends with the seventh frame
    model = tactileforge.load(file)
    for line, end in zip(lines, range(6, 20), strict=True):
        numbers = [float(x) for x in re.findall(r"[+-]?\d+\.\d+", line)]
        assert numbers[0] == pytest.approx(end / 20, abs=2e-3)
        clip = frames[[end - 6, end - 4, end - 2, end]]
        expected = model.force(clip, frames[0], "digit")[-1]
        assert numbers[1:] == pytest.approx(expected.tolist(), abs=6e-3)


@pytest.fixture(scope="module")
def head(file: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A head of three classes, as bench fits it to pictures without a background."""
    model, draw = tactileforge.load(file), torch.Generator().manual_seed(5)
    facts = ClassFacts(
        format=CLASS_FORMAT,
        task="classes",
        names=["bolt", "nut", "washer"],
        encoder=model.encoder_hash,
        background=False,
        sensors=["digit"],
        penalty=1.0,
        metrics={},
    )
    weight = torch.randn(3, model.projected, generator=draw) / 4
    path = tmp_path_factory.mktemp("head") / "mine.head"
    ClassHead(facts, weight, torch.tensor([0.1, -0.1, 0.0])).save(path)
    return path


@pytest.mark.slow
@pytest.mark.parametrize("format", ["onnx", "torch_export"])
def test_encoder_and_classes_are_one_file_with_the_labels_inside(
    file: Path, head: Path, tmp_path: Path, format: str
) -> None:
    out = tmp_path / "classes.file"
    words = [f"model=file:{file}", f"head={head}", f"format={format}", f"out={out}"]
    assert cli.run(["export", *words, "size=[40,48]"]) == 0
    facts = read_facts(out)
    assert facts.classes["names"] == ["bolt", "nut", "washer"]
    assert facts.classes["sensors"] == ["digit"]
    assert facts.classes["background"] == "130 everywhere: it was fitted without"
    expected = tactileforge.load(file).classify(clips(3), "none", "digit", head=head).probability
    frames = np.ascontiguousarray(np.moveaxis(clips(3), -1, 2))
    still = np.full_like(frames[:, 0], 130)
    rows = np.array(facts.sensor_ids(["digit"] * 3))
    if format == "onnx":
        session = onnxruntime.InferenceSession(out, providers=["CPUExecutionProvider"])
        feed = {"frames": frames, "background": still, "sensor": rows}
        (found,) = session.run(["probability"], feed)
    else:
        program = torch.export.load(out).module()
        found = program(*map(torch.from_numpy, (frames, still, rows)))[-1].numpy()
    assert np.abs(found - expected.numpy()).max() < 1e-5
    assert np.ptp(found) > 0.1


@pytest.mark.slow
def test_a_head_of_another_model_is_not_exported(file: Path, head: Path, tmp_path: Path) -> None:
    model = tactileforge.load(file)
    with torch.no_grad():
        next(model.encoder.parameters()).add_(1)
    with pytest.raises(ConfigError, match=r"fitted to another encoder than thing\.tiny"):
        export(model, tmp_path / "a.onnx", head=head)
    with pytest.raises(DataError, match="not a head of classes"):
        export(file, tmp_path / "a.onnx", head=file)
    with pytest.raises(DataNotFoundError, match="no such file"):
        export(file, tmp_path / "a.onnx", head=tmp_path / "none")
