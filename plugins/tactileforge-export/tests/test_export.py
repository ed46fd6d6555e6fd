"""Exported files compute the same as the module, name themselves, or do not exist."""

import contextlib
import json
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from tactileforge_export import Exported, export, facts, program, read_facts
from torch import nn
from torch.nn import functional as F

import tactileforge
from tactileforge import cli
from tactileforge.encoders.plain_vit import PlainViT
from tactileforge.encoders.preprocess import ANYTOUCH2
from tactileforge.encoders.tactile_vit import TactileViT
from tactileforge.errors import ConfigError, DataError, DataNotFoundError, TactileForgeError
from tactileforge.hub.files import describe_input, make_header, save_checkpoint

onnxruntime = pytest.importorskip("onnxruntime")
onnx = pytest.importorskip("onnx")
pytest.importorskip("onnxscript")

NODE = {"name": "tactile_vit", "size": "tiny", "depth": 1, "frames": 4, "image_size": 32}
SENSORS = ["digit", "gelsight", "universal", "dm", "digit"]


@pytest.fixture(scope="module")
def vit() -> TactileViT:
    torch.manual_seed(7)
    options: dict[str, Any] = {key: value for key, value in NODE.items() if key != "name"}
    return TactileViT(**options).eval().requires_grad_(False)


@pytest.fixture(scope="module")
def checkpoint(vit: TactileViT, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("checkpoint") / "thing.safetensors"
    save_checkpoint(
        path, vit, make_header(vit, NODE, licence="MIT", spacing=0.05, name="thing.tiny")
    )
    return path


@pytest.fixture(scope="module")
def any_size(checkpoint: Path, tmp_path_factory: pytest.TempPathFactory) -> Exported:
    return export(checkpoint, tmp_path_factory.mktemp("onnx") / "thing.onnx")


@pytest.fixture(scope="module")
def rounded(checkpoint: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An int8 file, written by the verb."""
    path = tmp_path_factory.mktemp("int8") / "a.onnx"
    words = [f"model=file:{checkpoint}", "size=[48,64]", "int8=true", f"out={path}"]
    with contextlib.redirect_stdout(StringIO()) as said:
        assert cli.run(["export", *words]) == 0
    assert f"cosine at least {read_facts(path).int8['cosine']:.5f}" in said.getvalue()
    return path


def noise(batch: int, height: int, width: int) -> tuple[torch.Tensor, torch.Tensor]:
    """The hardest frames to resize: independent pixels."""
    rng = torch.Generator().manual_seed(batch)
    shape = (batch, 5, 3, height, width)
    x = torch.randint(0, 256, shape, dtype=torch.uint8, generator=rng)
    return x[:, 1:].contiguous(), x[:, 0].contiguous()


def run_onnx(path: str, *inputs: torch.Tensor) -> list[torch.Tensor]:
    session = onnxruntime.InferenceSession(path, providers=["CPUExecutionProvider"])
    names = ("frames", "background", "sensor")
    feed = {name: value.numpy() for name, value in zip(names, inputs, strict=True)}
    return [torch.from_numpy(value) for value in session.run(["tokens", "cls"], feed)]


@pytest.mark.slow
@pytest.mark.parametrize("batch", [1, 2, 5])
@pytest.mark.parametrize("size", [(48, 64), (61, 47), (32, 32), (20, 30), (240, 320)])
def test_onnx_of_any_size(
    vit: TactileViT, any_size: Exported, batch: int, size: tuple[int, int]
) -> None:
    frames, background = noise(batch, *size)
    rows = torch.tensor(any_size.sensor_ids(SENSORS[:batch]))
    outputs = run_onnx(any_size.path, frames, background, rows)
    with torch.no_grad():
        expected = vit(frames, background, rows)
    for mine, theirs in zip(expected, outputs, strict=True):
        assert (mine - theirs).abs().max() < 5e-5
        assert mine.std() > 0.1


@pytest.mark.slow
def test_onnx_file_is_named_and_says_nothing_of_this_machine(any_size: Exported) -> None:
    model = onnx.load(any_size.path)
    onnx.checker.check_model(model, full_check=True)
    shapes = {
        value.name: [axis.dim_param or axis.dim_value for axis in value.type.tensor_type.shape.dim]
        for value in (*model.graph.input, *model.graph.output)
    }
    assert shapes == {
        "frames": ["batch", 4, 3, "height", "width"],
        "background": ["batch", 3, "height", "width"],
        "sensor": ["batch"],
        "tokens": ["batch", 14, 192],
        "cls": ["batch", 512],
    }
    data = Path(any_size.path).read_bytes()
    assert str(Path(__file__).parents[3]).encode() not in data
    assert b"site-packages" not in data


@pytest.mark.slow
def test_metadata(any_size: Exported, vit: TactileViT) -> None:
    assert read_facts(any_size.path) == any_size
    assert any_size.error < 2e-5
    session = onnxruntime.InferenceSession(any_size.path)
    outputs = json.loads(session.get_modelmeta().custom_metadata_map["tactileforge"])
    assert len(outputs.pop("weights")) == 16
    assert outputs == {
        "background": facts.BACKGROUND,
        "classes": {},
        "error": any_size.error,
        "force": {},
        "format": "onnx",
        "frames": 4,
        "int8": {},
        "licence": "MIT",
        "model": "thing.tiny",
        "sensors": {**vit.sensors, "universal": 19},
        "outputs": {name: facts.OUTPUTS[name] for name in ("tokens", "cls")},
        "preprocessing": describe_input(vit),
        "size": [],
        "spacing": 0.05,
        "version": tactileforge.__version__,
    }
    assert any_size.sensor_ids(["universal", "digit"]) == [19, 1]
    with pytest.raises(ConfigError, match=r"unknown sensor of .*'digitt'; did you mean 'digit'"):
        any_size.sensor_ids(["digitt"])


@pytest.mark.slow
def test_torch_export(vit: TactileViT, tmp_path: Path) -> None:
    done = export(vit, tmp_path / "thing.pt2", format="torch_export", size=(48, 64))
    assert done.error == 0
    assert (done.model, done.licence, done.size) == ("", "", [48, 64])
    assert read_facts(done.path) == done
    extra = {facts.KEY: ""}
    data = Path(done.path).read_bytes()
    loaded = torch.export.load(done.path, extra_files=extra).module()
    assert json.loads(extra[facts.KEY])["sensors"]["universal"] == 19
    assert b"site-packages" not in data
    for batch in (1, 2, 5):
        frames, background = noise(batch, 48, 64)
        frames = frames.movedim(2, -1).contiguous().movedim(-1, 2)  # as cameras lay them out
        rows = torch.tensor(done.sensor_ids(SENSORS[:batch]))
        for mine, theirs in zip(
            vit(frames, background, rows), loaded(frames, background, rows), strict=True
        ):
            assert torch.equal(mine, theirs)


@pytest.mark.slow
@pytest.mark.parametrize(("format", "size"), [("onnx", (48, 80)), ("torch_export", (90, 70))])
def test_other_preprocessing(tmp_path: Path, format: Any, size: tuple[int, int]) -> None:
    """Turned if wide, cut, bicubic; no background; a stem for each sensor."""
    pixels = {**ANYTOUCH2, "fit": "portrait", "filter": "bicubic", "offset": None}
    pixels |= {"mean": [[0.1, 0.2, 0.3], [0.4, 0.5, 0.6]], "std": [[0.2] * 3, [0.3] * 3]}
    encoder = PlainViT(
        "tiny",
        depth=2,
        image_size=(48, 32),
        stems=2,
        stem_depth=1,
        sensors={"a": 0, "b": 1},
        pixels=pixels,
    )
    done = export(encoder, tmp_path / "file", format=format, size=size)
    assert done.error < 1e-5
    assert done.sensors == {"a": 0, "b": 1}
    with pytest.raises(ConfigError, match=r"depends on the size of the frames: .*size=\[H,W\]"):
        export(encoder, tmp_path / "other", format=format)
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


class Resize(nn.Module):
    def forward(self, x: torch.Tensor) -> torch.Tensor:
        return F.interpolate(x, (224, 224), mode="bilinear", antialias=True)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")
def test_resizing_is_torchs(tmp_path: Path) -> None:
    """Matrices made at run time, against torch's kernel, on sizes of sensors."""
    from tactileforge_export.onnx_file import _resize

    shape = {2: torch.export.Dim("height", min=3), 3: torch.export.Dim("width", min=3)}
    table = {torch.ops.aten._upsample_bilinear2d_aa.default: _resize("bilinear")}
    torch.onnx.export(
        Resize(),
        (torch.rand(1, 1, 32, 48),),
        tmp_path / "resize.onnx",
        input_names=["x"],
        dynamic_shapes=(shape,),
        dynamo=True,
        verbose=False,
        custom_translation_table=table,
    )
    session = onnxruntime.InferenceSession(tmp_path / "resize.onnx")
    for size in ((64, 64), (120, 160), (240, 320), (288, 384), (320, 427), (480, 640), (224, 224)):
        x = torch.rand(1, 1, *size)
        outputs = session.run(None, {"x": x.numpy()})[0]
        assert np.abs(outputs - Resize()(x).numpy()).max() < 6e-6, size


@pytest.mark.slow
def test_int8(vit: TactileViT, any_size: Exported, rounded: Path) -> None:
    size = (48, 64)
    done = read_facts(rounded)
    assert done.error < 2e-5  # of the file before it was rounded
    assert Path(done.path).stat().st_size < 0.35 * Path(any_size.path).stat().st_size
    assert 0.002 < done.int8["relative"] < 0.05
    assert 0.998 < done.int8["cosine"] < 1
    frames, background = noise(5, *size)
    rows = torch.tensor(done.sensor_ids(SENSORS))
    outputs = run_onnx(done.path, frames, background, rows)[1]
    expected = vit(frames, background, rows)[1]
    assert F.cosine_similarity(outputs, expected).min() > 0.998
    nodes = onnx.load(done.path).graph.node
    assert sum("Integer" in node.op_type for node in nodes) == 4 + 2  # embed and project
    # two products in attention a block, two of resizing: none of them has weights
    assert sum(node.op_type == "MatMul" for node in nodes) == 2 + 2


@pytest.mark.slow
def test_a_file_that_differs_is_not_kept(
    vit: TactileViT, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "thing.pt2"
    path.write_text("before")
    load = program.ProgramFile.load

    def off(self: Any, path: Path) -> Any:
        run = load(self, path)
        return lambda *inputs: [x + 2e-4 for x in run(*inputs)]

    monkeypatch.setattr(program.ProgramFile, "load", off)
    with pytest.raises(TactileForgeError, match=r"differ from the module's by 0.0002, more than"):
        export(vit, path, format="torch_export", size=(40, 40))
    assert path.read_text() == "before"
    assert [p.name for p in tmp_path.iterdir()] == ["thing.pt2"]
    done = export(vit, path, format="torch_export", size=(40, 40), tolerance=1e-3)
    assert done.error == pytest.approx(2e-4, rel=1e-2)


@pytest.mark.slow
def test_numbers_that_are_not_finite_are_a_difference(vit: TactileViT) -> None:
    def run(*inputs: torch.Tensor) -> Any:
        tokens, cls = vit(*inputs)
        return tokens, cls * float("nan")

    assert program.compare_outputs(run, vit, [(40, 40)]).largest == float("inf")


@pytest.mark.slow
def test_clips_are_the_same_each_time_and_use_every_row(vit: TactileViT) -> None:
    first, again = (program.synthetic_clips(vit, 6, (40, 50)) for _ in range(2))
    assert all(torch.equal(a, b) for a, b in zip(first, again, strict=True))
    frames, background, sensor = first
    assert frames.shape == (6, 4, 3, 40, 50)
    assert background.shape == (6, 3, 40, 50)
    assert sorted(sensor.tolist()) == sorted(vit.sensors.values())
    change = (frames.float() - background[:, None]).flatten(2).std(dim=2)
    assert (change[:, -1] > 2 * change[:, 0]).all()


@pytest.mark.slow
def test_bad_input(vit: TactileViT, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "file"
    with pytest.raises(ConfigError, match="unknown format 'onx'; did you mean 'onnx'"):
        export(vit, path, format="onx")  # type: ignore[arg-type]
    with pytest.raises(ConfigError, match="int8=true needs format=onnx"):
        export(vit, path, format="torch_export", int8=True)
    for size in ((240,), (240, 0), (240, 320.0)):
        with pytest.raises(ConfigError, match="give height and width"):
            export(vit, path, size=size)  # type: ignore[arg-type]
    with pytest.raises(ConfigError, match="tolerance=nan: give a number"):
        export(vit, path, tolerance=float("nan"))
    with pytest.raises(ConfigError, match="int8=perhaps: give true or false"):
        export(vit, path, int8="perhaps")  # type: ignore[arg-type]
    with pytest.raises(ConfigError, match="is a folder: give the name of a file"):
        export(vit, tmp_path)
    with pytest.raises(ConfigError, match="unknown model 'anytouch3'; did you mean 'anytouch"):
        export("anytouch3", path)
    with pytest.raises(DataNotFoundError, match="no such file"):
        export("file:nothing.safetensors", path)
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(
        ConfigError, match=r"needs onnx.*: pip install .*/tactileforge-export\[onnx\]'"
    ):
        export(vit, path)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_read_says_what_is_wrong(tmp_path: Path, any_size: Exported) -> None:
    with pytest.raises(DataNotFoundError, match="no such file"):
        read_facts(tmp_path / "nothing.onnx")
    other = tmp_path / "other.onnx"
    other.write_bytes(b"no protobuf")
    with pytest.raises(DataError, match="not written by tactileforge export"):
        read_facts(other)
    model = onnx.load(any_size.path)
    del model.metadata_props[:]
    onnx.save(model, other)
    with pytest.raises(DataError, match=r"not written by tactileforge export: .* is missing"):
        read_facts(other)


@pytest.mark.slow
def test_verb(
    checkpoint: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    monkeypatch.chdir(tmp_path)
    words = [f"model=file:{checkpoint}", "format=torch_export", "size=[48,64]"]
    assert cli.run(["export", *words]) == 0
    assert capsys.readouterr().out.endswith("differs from the module by 0 at most\n")
    assert read_facts("thing.pt2").model == "thing.tiny"
    assert cli.run(["export", "--help"]) == 0
    assert "tolerance: 0.0001" in capsys.readouterr().out
    assert cli.run(["export", "modell=x"]) == 1
    assert "unknown key 'modell'; did you mean 'model'" in capsys.readouterr().err
    assert cli.run(["export"]) == 1
    assert "give model=..." in capsys.readouterr().err
    assert cli.run(["export", words[0], "size=240"]) == 1
    assert "size=[240]: give height and width" in capsys.readouterr().err
