from collections.abc import Callable
from typing import Any

import pytest
import torch
from omegaconf import OmegaConf

from tactileforge.cli._compose import compose
from tactileforge.errors import ConfigError
from tactileforge.plugins import registry
from tactileforge.training import parts
from tactileforge.training.assemble import build_data
from tactileforge.training.parts import outline

RECIPES = ["anytouch1", "anytouch2", "dino", "mae", "t3", "unitouch", "vjepa"]


def plain(recipe: str, *overrides: str) -> dict[str, Any]:
    config = OmegaConf.to_container(compose(recipe, overrides), resolve=True)
    assert isinstance(config, dict)
    return config  # type: ignore[return-value]


@pytest.mark.parametrize("recipe", RECIPES)
def test_an_outline_has_the_sizes_and_no_weights(recipe: str) -> None:
    node = plain(recipe, "scale=demo")["encoder"]
    built, whole = outline(node), registry.build("encoders", node)
    for name in ("width", "projected", "frames", "image_size", "tube", "patch", "grid", "sensors"):
        assert getattr(built, name) == getattr(whole, name)
    shapes = {key: value.shape for key, value in whole.state_dict().items()}
    assert {key: value.shape for key, value in built.state_dict().items()} == shapes
    assert all(parameter.is_meta for parameter in built.parameters())


def test_an_encoder_that_computes_in_its_constructor_is_built(
    installed: Callable[..., None], monkeypatch: pytest.MonkeyPatch
) -> None:
    code = (
        "import torch\n"
        "class Eager(torch.nn.Module):\n"
        "    def __init__(self, start: float = 0.5):\n"
        "        super().__init__()\n"
        "        self.frames = int(torch.rand(1).item() + 2)\n"
        "        self.weight = torch.nn.Parameter(torch.zeros(4))\n"
    )
    entry = "[tactileforge.encoders]\neager = eager_encoder:Eager\n"
    installed("tactileforge-eager", entry, {"eager_encoder.py": code})
    state = torch.get_rng_state()
    assert outline({"name": "eager"}).frames == 2
    assert torch.equal(torch.get_rng_state(), state)
    monkeypatch.setattr(parts, "_MOST", 3)
    with pytest.raises(ConfigError, match=r"encoder=eager would have 4 weights, and at most 3"):
        outline({"name": "eager"})
    with pytest.raises(ConfigError, match=r"option of encoder 'eager' 'size'.*~encoder\.size"):
        outline({"name": "eager", "size": 1})


@pytest.mark.slow
def test_first_weights_depend_on_the_seed_and_not_on_the_data() -> None:
    words = ("scale=demo", "data.scenes=3", "data.val=1", "data.size=32", "objective=[pixel]")
    config = plain("anytouch2", *words)
    torch.manual_seed(3)
    expected = registry.build("encoders", config["encoder"]).state_dict()
    torch.manual_seed(3)
    _, node = build_data(config)
    state = registry.build("encoders", node).state_dict()
    assert all(torch.equal(state[key], value) for key, value in expected.items())
