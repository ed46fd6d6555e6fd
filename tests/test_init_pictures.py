"""A run of several frames started from a network of single pictures, such as CLIP's."""

from pathlib import Path

import pytest
import torch

import tactileforge
from tactileforge import compose
from tactileforge.encoders import TactileViT
from tactileforge.errors import ConfigError
from tactileforge.hub import make_header, save_checkpoint
from tactileforge.hub.starting_point import inflated
from tactileforge.runs.checkpoint_file import read_checkpoint

CLIP = {"frames": 1, "tube": 1, "sensor_tokens": 0, "patch": 16, "spacing": 0.0}
PICTURE = {"name": "tactile_vit", "size": "tiny", "depth": 2, "image_size": 32, "projected": 16}
PICTURE |= CLIP
WORDS = ["scale=demo", "debug=steps", "objective=[pixel]", "data.scenes=3", "data.val=1"]
WORDS += [
    "data.size=32",
    "batch.size=4",
    "encoder.image_size=32",
    "encoder.size=tiny",
    "encoder.depth=2",
]
WORDS += [
    "encoder.norm_in=true",
    "encoder.projected=16",
    "encoder.patch=16",
    "encoder.frames=4",
    "encoder.tube=2",
]


@pytest.fixture
def picture(tmp_path: Path) -> tuple[Path, TactileViT]:
    """A file with a network of single pictures, and the network."""
    torch.manual_seed(1)
    encoder = TactileViT(**{key: value for key, value in PICTURE.items() if key != "name"})
    file = tmp_path / "picture.safetensors"
    save_checkpoint(file, encoder, make_header(encoder, PICTURE, licence="MIT", spacing=0.0))
    return file, encoder


@pytest.mark.slow
def test_a_still_clip_starts_as_its_picture(picture, tmp_path: Path) -> None:
    file, encoder = picture
    words = [*WORDS, f"init=file:{file}", "optim.lr=0"]
    tactileforge.train(compose("anytouch2", words), folder=tmp_path / "run")
    state = read_checkpoint(tmp_path / "run")["state_dict"]
    still = torch.rand(1, 1, 3, 32, 32)
    clip = TactileViT(
        **{k: v for k, v in PICTURE.items() if k != "name"} | {"frames": 4, "tube": 2}
    )
    patches = clip.patchify(still.expand(-1, 4, -1, -1, -1))
    embedded = patches @ state["encoder.embed.weight"].T
    expected = encoder.embed(encoder.patchify(still)).expand(-1, 2, -1, -1)
    torch.testing.assert_close(embedded, expected)
    position = state["encoder.position"]
    torch.testing.assert_close(position[1:5], encoder.position[1:].detach())
    torch.testing.assert_close(position[5:], encoder.position[1:].detach())
    block = "transformer.blocks.1.mlp.0.weight"
    torch.testing.assert_close(state[f"encoder.{block}"], encoder.state_dict()[block])
    assert state["encoder.sensor_table"].std() > 0  # is new


def test_a_network_of_another_size_is_named(picture, tmp_path: Path) -> None:
    words = [*WORDS, f"init=file:{picture[0]}", "encoder.depth=3"]
    with pytest.raises(ConfigError, match=r"its pictures go into .*give encoder.depth=2"):
        tactileforge.train(compose("anytouch2", words), folder=tmp_path / "run")


def test_the_recipe_of_anytouch2_takes_all_of_clip() -> None:
    """Its encoder at scale=paper has a place for each tensor of ViT-B/16; the sensors are new."""
    options = {"size": "base", "depth": 12, "image_size": 224, "projected": 512}
    config = compose("anytouch2").encoder
    node = {key: value for key, value in config.items() if key != "name"}
    with torch.device("meta"):
        theirs, ours = TactileViT(**CLIP | options), TactileViT(**node)
    state = {f"encoder.{key}": value for key, value in theirs.state_dict().items()}
    start = inflated("clip.vitb16", {"name": "tactile_vit", **CLIP, **options}, state, config)
    own = {f"encoder.{key}": value.shape for key, value in ours.state_dict().items()}
    assert {key: value.shape for key, value in start.items()}.items() <= own.items()
    assert own.keys() - start.keys() == {"encoder.sensor_table"}
