"""Several processes look for unused parameters only where there may be some."""

from typing import Any

import pytest
from omegaconf import OmegaConf

from tactileforge.compose import compose
from tactileforge.train import choose_strategy


@pytest.mark.parametrize(
    ("recipe", "overrides", "strategy"),
    [
        ("mae", [], "ddp"),
        ("dino", [], "ddp"),
        ("anytouch2", ["curriculum=constant"], "ddp"),
        ("anytouch2", [], "ddp_find_unused_parameters_true"),
        ("mae", ["objective.pixel.weight=0"], "ddp_find_unused_parameters_true"),
    ],
)
def test_the_curriculum_decides(recipe: str, overrides: list[str], strategy: str) -> None:
    config: Any = OmegaConf.to_container(compose(recipe, overrides), resolve=True)
    assert choose_strategy(config) == strategy
