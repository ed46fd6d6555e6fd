"""Every recipe of the zoo composes, names what is installed, has a card, and trains two steps."""

from pathlib import Path

import pytest

from tactileforge.compose import compose
from tactileforge.train import train

ZOO = Path(__file__).parents[1] / "zoo" / "recipe"
RECIPES = sorted(path.stem for path in ZOO.glob("*.yaml"))


@pytest.mark.parametrize("recipe", RECIPES)
def test_two_steps(recipe: str, tmp_path: Path) -> None:
    overrides = ["scale=demo", "debug=steps", "encoder.image_size=32", "batch.size=8"]
    module = train(compose(recipe, overrides), tmp_path)
    assert module.global_step == 2
    assert (tmp_path / "report.html").exists()
    assert (ZOO / f"{recipe}.md").read_text().startswith("---\ntitle:")


def test_anytouch2_is_the_papers() -> None:
    config = compose("anytouch2")
    assert config.encoder.size == "base"
    assert (config.encoder.frames, config.encoder.tube, config.encoder.mask_ratio) == (4, 2, 0.75)
    assert [config.head.pixel[k] for k in ("width", "depth", "heads")] == [512, 6, 8]
    assert {k: v.weight for k, v in config.objective.items()} == {
        "pixel": 1.0,
        "diff": 1.0,
        "align": 1.0,
        "match": 0.02,
        "force": 0.1,
    }
    assert (config.objective.align.alpha_tv, config.objective.align.alpha_tl) == (0.2, 0.2)
    starts = {key: row.start * 40 for key, row in config.curriculum.objective.items()}
    assert starts == {"match": 20, "force": 20, "align": 30}
    assert (config.curriculum.universal.low, config.curriculum.universal.high) == (0.0, 0.75)
    assert (config.batch.size, config.optim.lr, config.trainer.max_epochs) == (64, 3e-4, 40)
    assert config.optim.warmup * 40 == 1
