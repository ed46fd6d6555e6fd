"""Options of first weights, and networks by name: hooks of encoders with weights elsewhere."""

from dataclasses import replace

import pytest
import torch
from tactileforge_bench.fit.models import model_entry

import tactileforge
from tactileforge import compose
from tactileforge.errors import ConfigError
from tactileforge.hub.files import make_header, save_checkpoint
from tactileforge.hub.header import read_header
from tactileforge.plugins import registry

NETS = """
import torch
from tactileforge.encoders.pixels import PixelEncoder
from tactileforge.errors import ConfigError

READ = []

class Net(PixelEncoder):
    starting_options = ("pretrained", "path")
    named_by = "model"

    def __init__(self, model: str = "small", pretrained: bool = False, path: str | None = None,
                 frames: int = 2, image_size: int | list[int] | None = None):
        if model not in ("small", "large"):
            raise ConfigError(f"model={model}: small or large")
        if (pretrained or path) and torch.get_default_device().type != "meta":
            READ.append((model, pretrained, path))
        super().__init__(frames=frames, image_size=image_size or 16)
        self.settled = {"image_size": self.image_size[0]}
        self.weight = torch.nn.Parameter(torch.randn(self.grid[1]))

    def state_for(self, after):
        return {"weight": torch.full_like(after.weight, 7.0)}
"""


@pytest.fixture
def nets(installed):
    installed("toy-nets", "[tactileforge.encoders]\nnets = toy_nets:Net", {"toy_nets.py": NETS})
    import toy_nets

    toy_nets.READ.clear()
    return toy_nets


@pytest.fixture
def packed(nets, tmp_path):
    node = {"name": "nets", "model": "large", "pretrained": True, "frames": 2, "image_size": None}
    encoder = registry.build("encoders", node)
    path = tmp_path / "nets.safetensors"
    save_checkpoint(path, encoder, make_header(encoder, node, licence="MIT", spacing=0.1))
    nets.READ.clear()
    return path


def test_options_of_first_weights_are_left_out(nets):
    node = {"name": "nets", "model": "large", "pretrained": True, "path": "x.pth"}
    assert registry.without_start("encoders", node) == {"name": "nets", "model": "large"}
    other = {"name": "pixels", "path": "x"}
    assert registry.without_start("encoders", other) == other
    assert registry.without_start("encoders", {"name": "absent", "path": "x"})["path"] == "x"


def test_a_file_has_settled_options_and_no_first_weights(packed):
    assert read_header(packed).encoder == {
        "name": "nets",
        "model": "large",
        "frames": 2,
        "image_size": 16,
    }


def test_a_header_that_asks_for_first_weights_gets_none(packed, nets, tmp_path):
    header = read_header(packed)
    header = replace(header, encoder=header.encoder | {"pretrained": True})
    model = tactileforge.load(f"file:{packed}")
    save_checkpoint(tmp_path / "other.safetensors", model.encoder, header)
    again = tactileforge.load(f"file:{tmp_path}/other.safetensors")
    assert torch.equal(again.encoder.weight, model.encoder.weight)
    assert nets.READ == []


def test_an_encoder_may_know_its_state_at_another_size(packed):
    with pytest.warns(UserWarning, match="interpolated"):
        model = tactileforge.load(f"file:{packed}", frames=4, image_size=32)
    assert model.encoder.weight.tolist() == [7.0] * 4


@pytest.mark.slow
@pytest.mark.parametrize("group", ["encoder", "image_encoder"])
def test_a_typed_name_is_that_of_the_network(group, nets):
    for words in (
        [f"{group}=nets", f"{group}.name=large"],
        [f"{group}.name=large", f"{group}=nets"],
        [f"{group}=nets", f"{group}.model=large"],
    ):
        node = compose("anytouch2", words)[group]
        assert (node.name, node.model) == ("nets", "large")


def test_the_name_of_any_other_encoder_stays_its_plugin(nets):
    assert compose("anytouch2", ["encoder=pixels", "encoder.name=nets"]).encoder.name == "nets"


def test_the_bench_takes_a_network_by_its_name(nets):
    assert model_entry("nets:large").open[0]().header.encoder["model"] == "large"
    assert nets.READ == [("large", True, None)]
    nets.READ.clear()
    model_entry("nets:small:weights.pth").open[0]()
    assert nets.READ == [("small", False, "weights.pth")]
    nets.READ.clear()
    first, second, _ = (one() for one in model_entry("untrained:nets:large").open)
    assert not torch.equal(first.encoder.weight, second.encoder.weight)
    assert nets.READ == []
    with pytest.raises(ConfigError, match="model=huge: small or large"):
        model_entry("nets:huge")
    with pytest.raises(ConfigError, match=r"unknown model 'pixels:x'.*timm:NETWORK"):
        model_entry("pixels:x")
