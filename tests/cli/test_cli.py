"""The command line: light verbs are light, and mistakes are one line with the fix."""

import errno
from collections.abc import Callable, Sequence
from pathlib import Path

import pytest
from tqdm import tqdm

from tactileforge import cli
from tactileforge.errors import DataError
from tactileforge.specs.published import SPECS


def error_of(capsys: pytest.CaptureFixture[str], *words: str) -> str:
    assert cli.run(words) == 1
    err = capsys.readouterr().err
    assert err.startswith("error: ")
    assert "Traceback" not in err
    return err


@pytest.mark.parametrize(
    "words",
    [["--help"], ["--version"], ["plugins", "list"], ["zoo", "list"], ["zoo", "show", "mae"]],
)
def test_light_verbs_import_neither_torch_nor_lightning(
    words: list[str], lightly: Callable[..., str]
) -> None:
    """Their time stands in benchmarks/hub.py: it depends on the machine."""
    lightly(words, without="torch lightning hydra cv2")


def test_an_unknown_verb_shows_the_usage(capsys: pytest.CaptureFixture[str]) -> None:
    assert "unknown verb 'trian'" in error_of(capsys, "trian")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("word", "message"),
    [
        ("data=recordngs", "recordings"),
        ("objective=[pixl]", "error: unknown objective 'pixl'; did you mean 'pixel'? Known: align"),
        ("objective=[pixel, pixel]", "a second one by a name, +objective@objective.second=pixel"),
        ("+objective@objective.loss=pixel", "another, +objective@objective.mine=pixel"),
        ("recipe=anytouch3", "anytouch2"),
        ("encoder=tactile_vitt", "tactile_vit"),
        ("encoder.sise=tiny", "encoder.sise"),
        ("curriculum.unit=epochs", "did you mean 'epoch'"),
        ("+curriculum.objective.forse.start=0.1", "did you mean 'force'"),
        ("encoder.frames=3", "change frames, image_size, tube or patch"),
        ("data.scenes=0", "scenes=0"),
        ("init=/nowhere", "no checkpoint at /nowhere"),
        ("logger.name=csvv", "did you mean 'csv'? Known: csv, mlflow, tensorboard, wandb"),
        ("seed=abc", "seed=abc: give a whole number"),
        ("optim.lr=-1", "optim.lr=-1"),
        ("text_encoder=vit", "text_encoder=vit encodes image, not text"),
        ("trainer.save_every=0", "trainer.save_every=0: give a whole number, 1 or more"),
        ("trainer.save_every=null", "trainer.save_every=None: give a whole number, 1 or more"),
        ("trainer.log_every_n_steps=0", "log_every_n_steps=0: give a whole number, 1 or more"),
        ("trainer.accumulate_grad_batches=0", "batches=0: give a whole number, 1 or more"),
        ("trainer.keep_best=val/forse", "unknown trainer.keep_best 'val/forse'; did you mean"),
        ("optim.schedule=piecewise_constant", "unknown optim.schedule 'piecewise_constant'"),
        ("batch.size=0", "batch.size=0: give a whole number, 1 or more"),
        ("batch.workers=-1", "batch.workers=-1: give a whole number, 0 or more"),
        ("+batch.foo=1", "unknown key of batch 'foo'"),
        ("+augment.foo=1", "unknown key 'augment.foo'; did you mean 'augment.colour'"),
    ],
)
def test_mistakes_are_named_before_training(
    word: str,
    message: str,
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    small = ["data.scenes=3", "data.val=1"] if not word.startswith("data") else []
    assert message in error_of(capsys, "train", "scale=demo", "debug=steps", *small, word)


def test_a_run_without_an_end_is_refused(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    words = ["train", "scale=demo", "trainer.max_steps=-1", "trainer.max_epochs=-1"]
    assert "need the length of the run; give one of the two" in error_of(capsys, *words)


def test_resume_of_nothing_says_what_to_give(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert "give the folder of a run" in error_of(capsys, "train", "resume=nothing")


@pytest.mark.parametrize(
    ("layout", "message"),
    [
        ("{images: '*.png', each: touch, sensor: digitt, background: none}", "'digit'"),
        ("{images: '*.png', each: touch, sensor: digit}", "background"),
        ("{images: '*.jpg', each: touch, sensor: digit, background: none}", "*.jpg"),
        (
            "{images: '*.png', eech: touch, sensor: digit, background: none}",
            "unknown key of layout 'mine' 'eech'; did you mean 'each'?",
        ),
    ],
)
def test_layouts_at_fault_are_named(
    layout: str,
    message: str,
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    import cv2
    import numpy as np

    monkeypatch.chdir(tmp_path)
    cv2.imwrite("a.png", np.zeros((32, 32, 3), np.uint8))
    Path("tactileforge.yaml").write_text(f"layouts: {{mine: {layout}}}\n")
    words = ["scale=demo", "debug=steps", "data=recordings", f"data.root={tmp_path}"]
    assert message in error_of(capsys, "train", *words, "objective=[pixel]")


def test_the_published_sensors_are_known() -> None:
    assert set(SPECS) == {"gelsight", "digit", "gelslim", "gelsight_mini", "duragel", "dm"}


@pytest.mark.parametrize(
    ("error", "line"),
    [
        (DataError("it is damaged"), "error: it is damaged"),
        (OSError(errno.ENOSPC, "No space left", "a/b"), "error: a/b: the disk is full"),
        (KeyboardInterrupt(), "stopped; go on with: the same command again"),
    ],
    ids=["an error", "a full disk", "Ctrl-C"],
)
def test_what_ends_a_command_stands_on_a_line_of_its_own_behind_a_bar(
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    error: BaseException,
    line: str,
) -> None:
    def work(verb: str, rest: Sequence[str]) -> int:
        for number in tqdm(range(9), desc="look", mininterval=0):
            if number == 3:
                raise error
        return 0

    monkeypatch.setattr(cli, "dispatch", work)
    assert cli.run(["data"]) in (1, 130)
    *bars, last = capsys.readouterr().err.rstrip("\n").split("\n")
    assert last.startswith(line)
    assert len(bars) == 1, "the bar is drawn once, and ends its line"
    assert "look:" in bars[0].split("\r")[-1]
