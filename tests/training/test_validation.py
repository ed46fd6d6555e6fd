"""Every run ends with a validation, and metrics without labels are absent everywhere."""

import csv
from pathlib import Path
from typing import Any

import pytest
import torch
from omegaconf import OmegaConf

from tactileforge.api import metric, train
from tactileforge.cli._compose import compose
from tactileforge.errors import ConfigError
from tactileforge.objectives.force import Force
from tactileforge.training import progress
from tactileforge.training.trainer import check_options

SMALL = ["scale=demo", "data.scenes=3", "data.val=1", "data.size=32", "encoder.image_size=32"]
SMALL += ["batch.size=4", "batch.workers=0", "curriculum=constant", "objective=[pixel,force]"]


def rows(folder: Path) -> list[dict[str, str]]:
    return list(csv.DictReader((folder / "metrics.csv").read_text().splitlines()))


@pytest.mark.slow
@pytest.mark.parametrize(
    "words",
    [
        ["trainer.max_steps=3", "trainer.val_check_interval=160", "trainer.log_every_n_steps=50"],
        ["trainer.max_steps=3", "trainer.val_check_interval=2"],
        ["trainer.max_epochs=1", "trainer.max_steps=-1", "trainer.check_val_every_n_epoch=5"],
    ],
)
def test_the_end_is_validated_once(tmp_path: Path, words: list[str]) -> None:
    always = [] if "max_epochs" in words[0] else ["trainer.check_val_every_n_epoch=null"]
    module = train(compose("anytouch2", [*SMALL, *always, *words]), tmp_path)
    steps = [int(row["step"]) for row in rows(tmp_path) if row["val/pixel"]]
    last = module.global_step - 1
    assert steps == ([1, last] if "trainer.val_check_interval=2" in words else [last])
    assert [row for row in rows(tmp_path) if row["train/loss"]]
    logged = module.trainer.callback_metrics
    losses = [float(logged[f"val/{key}"]) for key in ("pixel", "force")]
    assert metric(module, None) == pytest.approx(sum(losses))


@pytest.mark.parametrize("value", [0, 0.0, -1])
def test_an_interval_of_0_is_refused(value: float) -> None:
    for key in ("val_check_interval", "check_val_every_n_epoch", "log_every_n_steps", "save_every"):
        made = compose("anytouch2", [*SMALL, f"trainer.{key}={value}"])
        config: Any = OmegaConf.to_container(made, resolve=True)
        with pytest.raises(ConfigError, match=rf"trainer\.{key}={value}: give "):
            check_options(config)


@pytest.mark.slow
def test_absent_is_not_zero(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """In the file, the bar and the report; the second and third of four steps have no label."""
    forward, shown, batches = Force.forward, [], []

    def bare(self: Force, prediction: Any, batch: dict[str, Any]) -> Any:
        batches.append(1)
        known = (
            batch["force_valid"] if len(batches) == 1 else torch.zeros_like(batch["force_valid"])
        )
        return forward(self, prediction, batch | {"force_valid": known})

    class Shown(progress.Bar):
        def set_postfix(self, values: dict[str, str], **_: Any) -> None:
            shown.append(values["force"])

    monkeypatch.setattr(Force, "forward", bare)
    monkeypatch.setattr(progress, "Bar", Shown)
    words = ["trainer.max_steps=3", "trainer.log_every_n_steps=1", "trainer.limit_val_batches=0"]
    train(compose("anytouch2", [*SMALL, *words]), tmp_path)
    found = [row["train/force"] for row in rows(tmp_path)]
    assert float(found[0]) > 0
    assert found[1:] == ["", ""]
    assert [row["train/force/mae_x_N"] for row in rows(tmp_path)][1:] == ["", ""]
    assert shown[1:] == ["no label", "no label"]
    assert float(shown[0]) > 0
