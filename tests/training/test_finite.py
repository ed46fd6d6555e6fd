"""NaN and infinite numbers are named, and never replace finite ones."""

from pathlib import Path
from typing import Any

import pytest
import torch
from torch import nn

from tactileforge import cli
from tactileforge.runs.checkpoint_file import read_checkpoint
from tactileforge.runs.folder import BEST, LAST
from tactileforge.training.checkpoints import best_checkpoint
from tactileforge.training.finite import FiniteWatch, NotFiniteError, broken
from tactileforge.training.fitting import _way_back

SMALL = ["train", "scale=demo", "debug=steps", "data.scenes=3", "data.val=1", "data.size=32"]
SMALL += ["encoder.image_size=32", "batch.size=4", "batch.workers=0", "curriculum=constant"]
SMALL += ["objective=[pixel,force]", "optim.lr=1e30", "trainer.max_steps=8"]


class Parts(nn.Module):
    def __init__(self) -> None:
        super().__init__()
        self.encoder = nn.Linear(2, 2)
        self.heads = nn.ModuleDict({"dino": nn.Linear(2, 2)})
        self.register_buffer("mask", torch.tensor([0.0, -torch.inf]))


def spoil(where: str, parts: Parts, optimizer: torch.optim.Optimizer) -> None:
    with torch.no_grad():
        if where == "heads.dino":  # as an EMA copy
            parts.heads["dino"].requires_grad_(False).weight[0, 0] = torch.nan
        elif where == "optimizer":
            optimizer.state[parts.encoder.weight]["exp_avg_sq"][0, 0] = torch.inf
        else:
            parts.encoder.bias[1] = torch.inf


@pytest.mark.parametrize("where", ["encoder", "heads.dino", "optimizer"])
def test_each_kind_of_number_is_looked_at(where: str) -> None:
    parts = Parts()
    optimizer = torch.optim.AdamW(parts.parameters())
    parts.encoder(torch.ones(2)).sum().backward()
    optimizer.step()
    watch = FiniteWatch(["pixel", "force"])
    watch.start(parts)
    watch.note({"pixel": torch.tensor(1.0)}, 0)
    watch.check(parts, [optimizer], 1)  # the mask is as it was meant to be
    watch.note({"pixel": torch.tensor(1.0), "force": torch.tensor(torch.nan)}, 3)
    watch.note({"pixel": torch.tensor(torch.inf), "force": torch.tensor(torch.nan)}, 4)
    spoil(where, parts, optimizer)
    part = "encoder" if where == "optimizer" else where
    with pytest.raises(NotFiniteError) as error:
        watch.check(parts, [optimizer], 5)
    assert str(error.value) == (
        f"step 5: weights are not finite ({part}); the loss is not finite: 'force' since step 3, "
        "'pixel' since step 4"
    )


def test_weights_alone_may_be_broken() -> None:
    watch, parts = FiniteWatch(["pixel"]), Parts()
    watch.start(parts)
    watch.note({"pixel": torch.tensor(1.0)}, 0)
    spoil("encoder", parts, torch.optim.AdamW(parts.parameters()))
    with pytest.raises(NotFiniteError, match=r"\(encoder\); every loss was finite"):
        watch.check(parts, [], 1)


def finite(path: Path) -> bool:
    found = read_checkpoint(path)
    states = [one for state in found.get("optimizer_states", []) for one in state["state"].values()]
    pairs = [*found["state_dict"].items(), *(pair for state in states for pair in state.items())]
    return not broken(pairs)


@pytest.mark.slow
def test_what_was_saved_before_stays(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Saved after every step, and validated, to make each kind of checkpoint."""
    run = tmp_path / "my run"
    words = [f"hydra.run.dir='{run}'", "trainer.save_every=1", "trainer.log_every_n_steps=20"]
    words += ["trainer.val_check_interval=1", "trainer.keep_best=val/pixel"]
    assert cli.run([*SMALL, *words]) == 1
    said = capsys.readouterr().err.splitlines()[-1]
    assert "'force' since step 1, 'pixel' since step 1. The checkpoint of step 1 stays" in said
    assert f"tactileforge train resume='{run}'" in said
    assert finite(run / LAST)
    assert not (run / BEST).exists()  # its first validation was not finite
    assert cli.run(["report", str(run)]) == 0  # of weights with which nothing is finite
    assert (run / "report.html").is_file()


@pytest.mark.slow
def test_nothing_is_saved_where_nothing_was_finite(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = [f"hydra.run.dir={tmp_path}", "trainer.log_every_n_steps=20"]
    assert cli.run([*SMALL, *words]) == 1
    said = capsys.readouterr().err.splitlines()[-1]
    assert said.startswith("error: step 7; the loss is not finite: 'force' since step 1, 'pixel'")
    assert said.endswith("Nothing was saved before: start again with a smaller optim.lr=")
    assert not (tmp_path / LAST).exists()


@pytest.mark.parametrize(
    ("done", "said"), [(True, "no learning rate is the cause"), (False, "optim.lr=")]
)
def test_at_the_first_step_no_learning_rate_is_blamed(
    tmp_path: Path, done: bool, said: str
) -> None:
    assert said in _way_back(tmp_path, "32-true", done)


def test_the_best_is_a_number(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (best,) = best_checkpoint(tmp_path, "val/pixel")
    called: list[Any] = []
    monkeypatch.setattr(type(best).__mro__[1], "on_validation_end", lambda *_: called.append(1))
    for score in (torch.nan, torch.inf, 0.5):
        trainer: Any = type("T", (), {"callback_metrics": {"val/pixel": torch.tensor(score)}})()
        best.on_validation_end(trainer, None)  # type: ignore[arg-type]
    assert called == [1]
