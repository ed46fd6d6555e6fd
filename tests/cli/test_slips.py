"""Slips of a user on every verb: one line, with the fix, before any work."""

from pathlib import Path

import pytest
from made_files import make_files

from tactileforge import cli

NAMED = ["data=recordings", "data.root=DIR"]


@pytest.fixture(autouse=True)
def _elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def error_of(capsys: pytest.CaptureFixture[str], *words: str) -> str:
    assert cli.run(words) == 1
    err = capsys.readouterr().err
    assert err.startswith("error: ")
    assert err.count("\n") == 1, "one line"
    return err


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["train", "objective=[a.b.Contrast]"], "A class of yours is a.b:Contrast"),
        (["train", "encoder=net.Tiny"], "unknown encoder 'net.Tiny'"),
        (["train", "encoder=net.Tiny"], "A class of yours is net:Tiny"),
        (["train", "scale=tiny", "batch.size=-1"], "batch.size=-1: give a whole number"),
        (
            ["train", "scale=tiny", "objective.dino.weight=3"],
            "nothing reads objective.dino.weight: objective 'dino' is not chosen",
        ),
        (
            ["train", "scale=tiny", "objective.pixal.weight=3"],
            "'objective.pixel.weight'? Known in objective: align, diff, force, match, pixel\n",
        ),
        (["report", "nowhere"], "nowhere: no config.yaml there; give the folder of a run"),
        (
            ["train", "callbacks.early_stopping.patience=3"],
            "callback 'early_stopping' is not chosen; callbacks=[early_stopping] chooses it",
        ),
        (
            ["train", "data=."],
            "data=. is a path: videos and images are data=recordings data.root=.",
        ),
        (["train", "--cfg", "jbo"], "unknown value of --cfg 'jbo'; did you mean 'job'"),
        (["train", "--info", "plugin"], "unknown value of --info 'plugin'; did you mean 'plugins'"),
        (["bench", "model=[file:no]"], "no: no such file; correct the path"),
        (["bench", "model=[run:no]"], "no: no config.yaml there; give the folder of a run"),
        (["bench", "model=[untrained:anytuch2]"], "did you mean 'anytouch2'"),
        (["bench", "model=[untrained:mae.bsae]"], "did you mean 'base'"),
        (["bench", "model=[pixels]", "device=gpu0"], "device='gpu0': not on this machine"),
        (["data", "emebd"], "did you mean 'embed'"),
        (["data", "inspect", "nowhere"], "nowhere: no such folder or file; correct the path"),
        (["data", "inspect", *NAMED, "recordings=0"], "recordings=0: give 1 or more"),
        (["data", "pack", *NAMED, "data.val=1.5", "out=o"], "data.val is 1.5; give the share"),
        (["data", "pack", "data=sim", "data.val=1.5", "out=o"], "data.val is 1.5, which is not"),
        (
            ["calibrate", *NAMED, "out=c.yaml", "fit=auot"],
            "unknown fit 'auot'; did you mean 'auto'",
        ),
        (["export", "model=run:no"], "give the folder of a run"),
        (["zoo", "pack", "no", "licence=apache"], "did you mean 'Apache-2.0'"),
        (["zoo", "pcak"], "did you mean 'pack'"),
        (["zoo", "show", "anytouch2.tinny"], "did you mean 'tiny'"),
        (["plugins", "new", "sensr", "mine"], "did you mean 'sensor'"),
        (["live", "sensor=simm"], "did you mean 'sim'"),
        (["record", "sensor=sim", "out=r", "licence=cc by 4.0"], "did you mean 'CC-BY-4.0'"),
        (["sim", "out=o", "motions=atomc"], "did you mean 'atomic'"),
        (["sim", "out=o", "indenters=pretrian"], "did you mean 'pretrain'"),
        (["sim", "out=o", "sensors=digit"], "give a list: [digit]"),
        (["sim", "out=o", "processes=0"], "processes=0: give 1 or more"),
        (
            ["train", "data=mixture", "+data.weights={a: 1}", "data.weights={a: 2, b: 1}"],
            "A key that is new: +data.weights.b=",
        ),
    ],
)
def test_a_slip_is_one_line_that_names_the_fix(
    words: list[str], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    if "data.root=DIR" in words:
        make_files("DIR", Path())
    before = set(Path().rglob("*"))
    assert message in error_of(capsys, *words)
    assert set(Path().rglob("*")) == before, "nothing is left"


def test_two_suites_with_a_task_of_one_name_are_named(capsys: pytest.CaptureFixture[str]) -> None:
    Path("own/suite").mkdir(parents=True)
    for name, defaults in (("a", ""), ("b", ""), ("c", "defaults: [a, _self_]\n")):
        rows = f"suites: {{{name}: A}}\ntasks: {{grasp: {{title: {name}}}}}\n"
        Path(f"own/suite/{name}.yaml").write_text(f"# @package _global_\n{defaults}{rows}")
    words = ["bench", "--config-dir", "own", "model=[pixels]"]
    found = error_of(capsys, *words, "suite=[a,b]")
    assert "own/suite/a.yaml and " in found
    assert "own/suite/b.yaml have a task of one name, 'grasp': rename it" in found
    # one that begins with another changes its task
    assert "tasks.grasp" in error_of(capsys, *words, "suite=[c]")


GRASP = {
    "title": "Is it grasped",
    "data": "{name: recordings, root: DIR, val: 0.3}",
    "target": '"label:grasped"',
    "probe": "{name: linear}",
    "metrics": "[accuracy, f1]",
    "split": "{test: {side: val}, validation: {share: 0.15, group: object}, unseen: [object]}",
}


def suite(**changes: str) -> list[str]:
    """A suite of one's own with one task, in ``own/suite``; the words that run it."""
    Path("own/suite").mkdir(parents=True)
    rows = "\n".join(f"    {key}: {value}" for key, value in (GRASP | changes).items())
    text = f"# @package _global_\nsuites: {{mine: Mine}}\ntasks:\n  grasp:\n{rows}\n"
    Path("own/suite/mine.yaml").write_text(text)
    make_files("DIR", Path())
    words = ["bench", "--config-dir", "own", "suite=mine", "model=[pixels]", "workers=0"]
    return [*words, "seeds=1", "out=mine", "cache=cache"]


REST = "validation: {share: 0.15, group: object}"


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"target": '"labels:grasped"'}, "unknown target of task grasp 'labels:grasped'"),
        ({"tagret": "force"}, "unknown key of tasks.grasp 'tagret'; did you mean 'target'"),
        ({"probe": "{name: linaer}"}, "unknown probe 'linaer'; did you mean 'linear'"),
        ({"probe": "{name: linear, epoch: 3}"}, "did you mean 'epochs'"),
        ({"split": "{tets: {side: val}}"}, "did you mean 'test'"),
        ({"split": f"{{{REST}}}"}, "give one of test, as in test: {side: val}, and folds: 5"),
        ({"split": f"{{folds: 1, {REST}}}"}, "tasks.grasp.split.folds is 1; give 2 or more"),
        ({"split": f"{{test: {{side: vall}}, {REST}}}"}, "did you mean 'val'"),
        (
            {"split": "{test: {side: val}, validation: {share: 2}}"},
            "split.validation.share is 2; give a share between 0 and 1",
        ),
        (
            {"split": f"{{test: {{side: val}}, {REST}, unseen: [objct]}}"},
            "has no 'objct'; did you mean 'object'? It has: side, sensor",
        ),
        (
            {"split": f"{{test: {{object: o77}}, {REST}}}"},
            "no recording for test: unknown value of object 'o77'; did you mean 'o7'? Known: o0",
        ),
        ({"metrics": "[acuracy]"}, "did you mean 'accuracy'"),
        ({"data": "{preset: labsett}"}, "unknown data 'labsett'. Known:"),
        ({"data": "{name: recordings, rooot: DIR}"}, "did you mean 'root'"),
        ({"data": "{name: recordings, root: DIR, val: 1.5}"}, "data.val is 1.5; give the share"),
    ],
)
def test_a_slip_in_a_suite_of_ones_own_is_one_line(
    changes: dict[str, str], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert message in error_of(capsys, *suite(**changes))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"target": '"label:graspd"'}, "unknown label 'graspd'; did you mean 'grasped'"),
        ({"target": '"numbers:object"'}, "give target: label:NAME"),
        ({"data": "{name: recordings, root: nowhere}"}, "set tasks.grasp.data.root to the folder"),
    ],
)
def test_what_cannot_be_run_is_named_and_the_rest_runs(
    changes: dict[str, str], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """A suite goes on without a task of unfit data: status 3, and a line with the fix."""
    assert cli.run(suite(**changes)) == 3
    line = next(row for row in capsys.readouterr().out.splitlines() if row.startswith("not run: "))
    assert message in line
