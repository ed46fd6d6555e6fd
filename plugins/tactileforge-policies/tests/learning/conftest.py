from collections.abc import Callable
from pathlib import Path

import pytest
from demonstrated import demonstrations

from tactileforge.cli._compose import compose

#: A policy that trains in seconds: a random encoder of one block, and a narrow U-Net.
SMALL = ["scale=demo", "init=null", "encoder.depth=1", "encoder.image_size=32"]
SMALL += ["trainer.max_epochs=2", "batch.size=8", "trainer.precision=32-true"]
SMALL += ["data.horizon=4", "data.image_size=16"]
#: Options of the diffusion policy.
NARROW = ["head.denoise.channels=[16,32]", "head.denoise.step_width=16", "head.denoise.steps=4"]
NARROW += ["head.denoise.pooler.queries=4"]


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Four demonstrations of twelve steps."""
    return demonstrations(tmp_path_factory.mktemp("demonstrations"), 4)


@pytest.fixture(scope="module")
def words(root: Path) -> list[str]:
    """Overrides of a small run on the demonstrations of ``root``."""
    return ["data=demonstrations", f"data.root={root}", *SMALL]


@pytest.fixture(scope="module")
def train_policy(words: list[str], tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Path]:
    """Trains a small policy and gives the folder of its run."""
    from tactileforge.api import train

    def make(*more: str) -> Path:
        folder = tmp_path_factory.mktemp("run") / "run"
        train(compose("diffusion_policy", [*words, *more]), folder)
        return folder

    return make


@pytest.fixture(scope="module")
def folder(train_policy: Callable[..., Path]) -> Path:
    """A run of four epochs."""
    return train_policy(*NARROW, "trainer.max_epochs=4")
