"""Last words of a run cut short from outside."""

import re
from pathlib import Path

import pytest
import torch

from tactileforge import api
from tactileforge.cli._compose import compose
from tactileforge.errors import ConfigError
from tactileforge.pages.curves import read_metrics
from tactileforge.runs.folder import LAST
from tactileforge.training import fitting


@pytest.mark.parametrize(
    ("error", "lost"),
    [
        (RuntimeError("[pair.cc:537] Read error [127.0.0.1]:6473: Connection reset by peer"), True),
        (RuntimeError("[pair.cc:547] Connection closed by peer [127.0.0.1]:6473"), True),
        (torch.distributed.DistBackendError("in the words of any version of NCCL"), True),
        (torch.distributed.DistNetworkError("in the words of any version of torch"), True),
        (RuntimeError("mat1 and mat2 shapes cannot be multiplied (4x2 and 3x4)"), False),
    ],
)
def test_a_lost_process_is_not_taken_for_a_mistake(error: RuntimeError, lost: bool) -> None:
    assert fitting._is_of_group(error) is lost


def test_the_way_back_is_quoted(tmp_path: Path) -> None:
    run = tmp_path / "my run"
    assert fitting._kept(run) == "Nothing was saved before: give the same command again"
    (run / LAST).parent.mkdir(parents=True)
    (run / LAST).touch()
    assert fitting._kept(run).endswith(f"tactileforge train resume='{run}'")


@pytest.mark.slow
def test_a_number_of_the_encoder_changes_over_the_run(tmp_path: Path) -> None:
    words = ["scale=demo", "encoder.image_size=32", "batch.size=8", "batch.workers=0"]
    words += ["data.scenes=3", "data.val=1", "data.size=32", "objective=[pixel]"]
    words += ["trainer.max_steps=4", "trainer.log_every_n_steps=1", "logger=csv"]
    words += ["+curriculum.values.encoder.mask_ratio={end: 0.5, low: 0.25, high: 0.75}"]
    module = api.train(compose("anytouch2", words), tmp_path)
    assert module.encoder.mask_ratio == 0.75
    curve = read_metrics(tmp_path)["encoder.mask_ratio"]
    assert curve.values.tolist() == pytest.approx([0.25, 0.5, 0.75, 0.75])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("word", "message"),
    [
        ("encoder.mask_ratoi", "'mask_ratoi'"),
        ("encoders.mask_ratio", "part in curriculum.values 'encoders'"),
        ("encoder.mask_ratio", "mask_ratio is 1.5"),
    ],
)
def test_a_number_that_cannot_change_so_is_named(word: str, message: str, tmp_path: Path) -> None:
    words = ["scale=demo", "encoder.image_size=32", "batch.size=8", "batch.workers=0"]
    words += ["data.scenes=3", "data.val=1", "data.size=32", "objective=[pixel]"]
    words += ["trainer.max_steps=4", f"+curriculum.values.{word}={{low: 0.25, high: 1.5}}"]
    with pytest.raises(ConfigError, match=re.escape(message)):
        api.train(compose("anytouch2", words), tmp_path)
