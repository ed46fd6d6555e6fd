from pathlib import Path

import pytest
from demonstrated import demonstrations

from tactileforge.api import train
from tactileforge.cli._compose import compose


@pytest.mark.slow
@pytest.mark.parametrize("recipe", ["diffusion_policy", "imitation"])
def test_two_steps(recipe: str, tmp_path: Path) -> None:
    overrides = ["scale=demo", "debug=steps", "encoder.image_size=32", "batch.size=8"]
    root = demonstrations(tmp_path / "data", 4, steps=6)
    overrides += ["data=demonstrations", f"data.root={root}", "init=null"]
    module = train(compose(recipe, overrides), tmp_path / "run")
    assert module.global_step == 2
    assert (tmp_path / "run" / "report.html").exists()


def test_diffusion_policy_is_the_papers() -> None:
    """The sizes are those of the paper, appendix Real-world task setup."""
    config = compose("diffusion_policy", ["data=demonstrations", "data.root=DIR"])
    head = config.head.denoise
    assert (list(head.channels), head.step_width, head.kernel, head.groups) == (
        [128, 256, 512],
        256,
        5,
        8,
    )
    assert (head.pooler.queries, head.execute, config.data.horizon) == (30, 2, 8)
    assert (config.freeze, config.init) == (True, "anytouch2.tiny")
    assert (config.optim.lr, config.batch.size, config.trainer.max_epochs) == (1e-4, 64, 100)
    assert round(config.data.val * 50) == 8
    small = compose(
        "diffusion_policy",
        [
            "scale=tiny",
            "init=null",
            "data.val=0.5",
            "seed=3",
            "data=demonstrations",
            "data.root=DIR",
        ],
    )
    assert (small.init, small.seed, small.trainer.max_steps) == (None, 3, -1)
