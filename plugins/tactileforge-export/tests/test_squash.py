"""Exported graphs squash frames as training did."""

from pathlib import Path

import numpy as np
import pytest
import torch
from tactileforge_export import export, read_facts
from tactileforge_export.squash import Squash

import tactileforge
from tactileforge.data.batches.clips import resize_frame
from tactileforge.encoders import TactileViT
from tactileforge.hub import Model, make_header, save_checkpoint


@pytest.mark.parametrize("wanted", [(128, 128), (224, 224), (320, 240)])
@pytest.mark.parametrize(
    "size", [(240, 320), (480, 640), (152, 184), (265, 133), (61, 47), (320, 240), (200, 100)]
)
def test_squashing_is_opencvs_to_a_grey_level(
    size: tuple[int, int], wanted: tuple[int, int]
) -> None:
    image = np.random.default_rng(0).integers(0, 256, (*size, 3), np.uint8)
    found = Squash(wanted)(torch.from_numpy(image).movedim(-1, 0)).movedim(0, -1).numpy()
    change = np.abs(found - resize_frame(image, wanted))
    assert change.max() <= 1
    assert change.mean() < 0.08


@pytest.mark.parametrize("size", [(240, 320), (480, 640), (128, 128)])
def test_the_usual_sizes_of_cameras_are_opencvs_exactly(size: tuple[int, int]) -> None:
    image = np.random.default_rng(0).integers(0, 256, (*size, 3), np.uint8)
    found = Squash((128, 128))(torch.from_numpy(image).movedim(-1, 0)).movedim(0, -1).numpy()
    assert np.array_equal(found, resize_frame(image, (128, 128)))


@pytest.mark.parametrize("wanted", [64, 96, 160, 224])
@pytest.mark.parametrize("size", [(240, 320), (480, 640), (720, 1280)])
def test_means_round_as_opencvs(size: tuple[int, int], wanted: int) -> None:
    """Half to even; a few sums that OpenCV takes in float32 fall to the other side."""
    if max(size) < 1.5 * wanted:
        pytest.skip("interpolated")
    image = np.random.default_rng(0).integers(0, 256, (*size, 3), np.uint8)
    found = Squash((wanted, wanted))(torch.from_numpy(image).movedim(-1, 0)).movedim(0, -1).numpy()
    assert np.mean(found != resize_frame(image, (wanted, wanted))) < 1 / 80


@pytest.fixture(scope="module")
def one_block(tmp_path_factory: pytest.TempPathFactory) -> Model:
    """A model with a recipe, as those trained here."""
    torch.manual_seed(0)
    node = {"size": "tiny", "depth": 1, "frames": 4, "image_size": 128}
    encoder = TactileViT(**node).eval()  # type: ignore[arg-type]
    node = {"name": "tactile_vit", **node}
    header = make_header(encoder, node, licence="MIT", spacing=0.1, recipe={"recipe": "mae"})
    file = tmp_path_factory.mktemp("model") / "model.safetensors"
    save_checkpoint(file, encoder, header)
    return tactileforge.load(file)


@pytest.mark.slow
@pytest.mark.parametrize(("size", "int8", "most"), [(None, False, 1e-4), ((240, 320), True, 0.5)])
def test_the_graph_of_a_model_that_was_trained_here_is_encode(
    size: tuple[int, int] | None, int8: bool, most: float, one_block: Model, tmp_path: Path
) -> None:
    """The shipped one with a stream of photographs, and one of a block."""
    onnxruntime = pytest.importorskip("onnxruntime")
    pytest.importorskip("onnxscript")
    model = one_block if int8 else tactileforge.load("touch.tiny")
    coarse = np.random.default_rng(0).normal(120, 40, (3, model.frames, 12, 16, 3))
    clips = coarse.repeat(20, 2).repeat(20, 3).clip(0, 255).astype(np.uint8)
    expected = model.encode(clips, "first", "digit").numpy()
    projected = model(clips, "first", "digit").detach().numpy()
    frames = np.ascontiguousarray(np.moveaxis(clips, -1, 2))
    feed = {"frames": frames, "background": frames[:, 0]}
    done = export(model, tmp_path / "touch.onnx", size=size, int8=int8)
    assert read_facts(done.path).preprocessing["squashed"] == [128, 128]
    session = onnxruntime.InferenceSession(done.path, providers=["CPUExecutionProvider"])
    rows = np.array(done.sensor_ids(["digit"] * 3))
    cls, vectors = session.run(["cls", "vector"], feed | {"sensor": rows})
    assert np.abs(cls - projected).max() < most
    assert np.abs(vectors - expected).max() < most
    if int8:
        assert done.int8["cosine"] > 0.99


@pytest.mark.slow
def test_a_program_of_any_size_is_encode(one_block: Model, tmp_path: Path) -> None:
    model = one_block
    done = export(model, tmp_path / "touch.pt2", format="torch_export")
    program = torch.export.load(done.path).module()
    rng = np.random.default_rng(0)
    frames = torch.from_numpy(rng.integers(0, 256, (2, model.frames, 3, 240, 320), np.uint8))
    rows = torch.tensor(done.sensor_ids(["digit", "gelsight"]))
    expected = model.encode(frames, "first", ["digit", "gelsight"])
    _, cls, vector = program(frames, frames[:, 0], rows)
    torch.testing.assert_close(vector, expected, atol=1e-4, rtol=0)
    projected = model(frames, "first", ["digit", "gelsight"])
    torch.testing.assert_close(cls, projected, atol=1e-4, rtol=0)
