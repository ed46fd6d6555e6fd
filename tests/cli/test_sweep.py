"""Sweeps: folders of jobs, continued sweeps, jobs in processes of their own."""

import csv
import json
import math
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from hydra.core.utils import JobReturn, JobStatus
from omegaconf import OmegaConf

from tactileforge import cli
from tactileforge.cli import _job
from tactileforge.cli._sweep import (
    JOB,
    SweepTable,
    _gather,
    ended,
    job_folder,
    stopped_sweep,
)
from tactileforge.errors import TactileForgeError
from tactileforge.runs.folder import LAST

SMALL = ["scale=demo", "debug=steps", "data.scenes=3", "data.val=1", "data.size=32"]
SMALL += ["encoder.image_size=32", "batch.size=4", "objective=[pixel]"]


@pytest.fixture(autouse=True)
def _elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def test_a_job_has_the_folder_that_it_had_before_whatever_its_number() -> None:
    assert job_folder("s", 0, ["seed=0", "a=1"]) == "0"
    assert job_folder("s", 1, ["seed=1", "a=1"]) == "1"
    assert job_folder("s", 0, ["a=1", "seed=1"]) == "1", "other order of jobs and words"
    assert job_folder("s", 1, ["seed=0", "a=1", "hydra.verbose=true"]) == "0"
    assert job_folder("s", 1, ["seed=2", "a=1"]) == "2", "a new job leaves the others alone"
    assert job_folder("s", 7, ["seed=3", "a=1"]) == "7"
    assert job_folder("s", 7, ["seed=3", "a=1"]) == "7"


def started(words: list[str], folder: str, monkeypatch: pytest.MonkeyPatch) -> SweepTable:
    monkeypatch.setattr(sys, "argv", ["tactileforge", *words])
    table = SweepTable()
    table.on_multirun_start(OmegaConf.create({"hydra": {"sweep": {"dir": folder}}}))
    return table


def test_the_same_command_finds_the_sweep_that_was_stopped(monkeypatch: pytest.MonkeyPatch) -> None:
    words = ["-m", "seed=0,1", "scale=demo"]
    monkeypatch.setattr("tactileforge.cli._sweep.is_claimed", lambda folder: False)
    assert stopped_sweep(words) is None
    started(words, "runs/sweeps/2026-01-01", monkeypatch)
    assert stopped_sweep(words) == Path("runs/sweeps/2026-01-01")
    assert stopped_sweep(["scale=demo", "-m", "seed=0,1", "hydra/launcher=joblib"]) is not None
    assert stopped_sweep([*words, "a=1"]) is None
    assert stopped_sweep([*words, "hydra.sweep.dir=x"]) is None
    new = started(words, "runs/sweeps/2026-01-02", monkeypatch)
    assert stopped_sweep(words) == Path("runs/sweeps/2026-01-02")
    done = OmegaConf.create({"hydra": {"sweep": {"dir": "runs/sweeps/2026-01-02"}}})
    monkeypatch.setattr(sys, "argv", ["tactileforge", "train", "seed=1"])  # as the last job left it
    new.on_multirun_end(done)
    assert stopped_sweep(words) == Path("runs/sweeps/2026-01-01")


def test_two_processes_do_not_run_one_sweep(monkeypatch: pytest.MonkeyPatch) -> None:
    words = ["-m", "seed=0,1"]
    code = (
        "import sys; from omegaconf import OmegaConf; from tactileforge.cli._sweep import *\n"
        "table = SweepTable()\n"
        "config = OmegaConf.create({'hydra': {'sweep': {'dir': sys.argv[1]}}})\n"
        "try: table.on_multirun_start(config)\n"
        "except Exception as error: sys.exit(str(error))"
    )
    started(words, "s", monkeypatch)
    done = subprocess.run([sys.executable, "-c", code, "s"], capture_output=True, text=True)
    assert (
        done.stderr.strip() == "s: another process runs this sweep; give another hydra.sweep.dir="
    )


def job(
    folder: Path,
    train: Any = lambda: math.nan,
    devices: int = 1,
    words: tuple[str, ...] = ("seed=1",),
) -> float:
    trainer = {"devices": devices, "accelerator": "cpu", "num_nodes": 1}
    config = {"trainer": trainer, "objective": {"pixel": {}}, "optimized_metric": None}
    return _job.run_job(folder, config, list(words), [], train)


def gathered(*jobs: tuple[str, float]) -> list[list[str]]:
    """The table of jobs, by their words and results."""
    for number, (words, metric) in enumerate(jobs):
        folder = Path("s") / job_folder("s", number, words.split())
        (folder / JOB).write_text(json.dumps({"words": words.split(), "metric": metric}))
    return _gather(OmegaConf.create({"optimized_metric": "val/force"}), Path("s"))


def test_the_table_has_mean_and_deviation_over_the_seeds_of_a_configuration() -> None:
    lines = gathered(
        *(("optim.lr=1 seed=0", 4.0), ("optim.lr=1 seed=1", 6.0)),
        *(("optim.lr=2 seed=0", 1.0), ("optim.lr=2 seed=1", 2.0), ("optim.lr=2 seed=2", math.nan)),
        ("optim.lr=3 seed=0", 3.0),
    )
    assert lines == [
        ["job", "optim.lr", "seed", "val/force", "seeds", "mean", "deviation"],
        ["2", "2", "0", "1", "2", "1.5", "0.70711"],
        ["3", "2", "1", "2", "2", "1.5", "0.70711"],
        ["5", "3", "0", "3", "1", "3", ""],
        ["0", "1", "0", "4", "2", "5", "1.4142"],
        ["1", "1", "1", "6", "2", "5", "1.4142"],
        ["4", "2", "2", "nan", "2", "1.5", "0.70711"],
    ]
    with Path("s/sweep.csv").open() as file:
        assert list(csv.reader(file)) == lines
    page = Path("s/sweep.html").read_text()
    means = [page.index(f">{mean}<") for mean in ("1.5", "3", "5")]
    assert "By configuration, over seeds" in page
    assert means == sorted(means), "the best configuration first"


def test_the_table_of_a_sweep_without_seeds_has_none_of_their_columns() -> None:
    assert gathered(("a=1", 4.0), ("a=2", 3.0))[0] == ["job", "a", "val/force"]


def test_a_job_that_fails_has_a_row_with_its_error() -> None:
    job = OmegaConf.create(
        {
            "optimized_metric": "loss",
            "hydra": {
                "mode": "RunMode.MULTIRUN",
                "overrides": {"task": ["optim.lr=1e30"]},
                "runtime": {"output_dir": "s/1"},
                "sweep": {"dir": "s"},
            },
        }
    )
    Path("s/0").mkdir(parents=True)
    Path("s/1").mkdir()
    Path("s/0", JOB).write_text(json.dumps({"words": ["optim.lr=1"], "metric": 0.5}))
    failed = JobReturn(status=JobStatus.FAILED)
    failed.return_value = TactileForgeError("step 3; the loss is not finite\nand more")
    SweepTable().on_job_end(job, failed)
    assert list(csv.reader(Path("s/sweep.csv").read_text("utf-8").splitlines())) == [
        ["job", "optim.lr", "loss", "failed"],
        ["0", "1", "0.5", ""],
        ["1", "1e30", "", "step 3; the loss is not finite"],
    ]
    assert "the loss is not finite" in Path("s/sweep.html").read_text("utf-8")
    assert ended(Path("s/1")) is None, "the same command tries it again"


def test_a_job_that_has_ended_is_taken(caplog: pytest.LogCaptureFixture) -> None:
    folder = Path("s") / job_folder("s", 0, ["seed=1"])
    assert ended(folder) is None
    (folder / JOB).write_text(json.dumps({"words": ["seed=1"], "metric": 0.25}))
    with caplog.at_level("INFO"):
        assert job(folder, lambda: pytest.fail("it was trained again")) == 0.25
    assert "taken, as it has ended: s/0 (seed=1)" in caplog.text


def test_a_job_without_a_number_takes_that_of_its_file_or_comes_last(
    caplog: pytest.LogCaptureFixture,
) -> None:
    Path("s").mkdir()
    assert job(Path("s")) == math.inf
    assert "s: no finite number to rank this job by, so it comes last" in caplog.text
    Path("s/metrics.csv").write_text("step,train/pixel,val/pixel\n1,3,\n2,,0.5\n3,2,\n")
    assert job(Path("s")) == 0.5
    assert job(Path("s"), lambda: 0.75) == 0.75


def test_a_job_that_is_stopped_says_that_the_sweep_goes_on() -> None:
    def stopped() -> float:
        raise KeyboardInterrupt("stopped at step 3; go on with: tactileforge train resume=s")

    with pytest.raises(KeyboardInterrupt, match=r"^stopped at step 3; go on with: the same"):
        job(Path("s"), stopped)


@pytest.mark.parametrize("stopped", [False, True])
def test_a_job_with_several_processes_runs_apart(
    stopped: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder, given = Path("s/0"), ["seed=1", "trainer.devices=2"]
    argv = ["tactileforge", "train", "--config-dir", "mine", *given]
    monkeypatch.setattr(sys, "argv", argv)
    (folder / LAST).parent.mkdir(parents=True)
    if stopped:
        (folder / LAST).touch()
    run: list[Any] = []

    def program(command: list[str]) -> tuple[int, str]:
        run.append(command[3:])
        (folder / "metrics.csv").write_text("step,val/pixel\n2,0.5\n")
        return 0, ""

    monkeypatch.setattr(_job, "run_program", program)
    here = lambda: pytest.fail("it was trained in this process")  # noqa: E731
    assert job(folder, here, devices=2, words=tuple(given)) == 0.5
    own = ["resume=s/0"] if stopped else [*given, "hydra.run.dir=s/0"]
    assert run == [["train", "--config-dir", "mine", *own]]
    monkeypatch.setattr(_job, "run_program", lambda _: (1, "x\nerror: no\nroom"))
    with pytest.raises(TactileForgeError, match=r"^s/0: the job failed: no room$"):
        job(folder, here, devices=2, words=tuple(given))


def test_flags_that_do_not_go_together_are_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.run(["train", "-m", "seed=0,1", "--cfg", "job"]) == 1
    assert capsys.readouterr().err == (
        "error: -m and --cfg do not go together: leave -m out, and give the values of one job\n"
    )


@pytest.mark.parametrize(
    ("word", "message"),
    [
        ("hydra/launcher=null", "hydra/launcher=null: give the name of an option. Known: basic"),
        ("hydra/launcher=", "hydra/launcher=: give the name of an option. Known: basic"),
        ("hydra/sweeper=null", "hydra/sweeper=null: give the name of an option. Known: basic"),
        ("hydra/launcher=foo", "Known: basic"),
        ("hydra/launcher=joblip", "did you mean 'joblib'? Known: basic, joblib, ray"),
        ("hydra/sweeper=nevergrad", "comes with hydra-nevergrad-sweeper: pip install hydra-never"),
        ("objective=pixl", "did you mean 'pixel'?"),
        ("scale=mine", "tiny. Options of your own need --config-dir DIR"),
        ("data=null", "data=null: give the name of an option. Known: aloha, anytouch2, cloth"),
        ("objective=null", "objective=null: give the name of an option. Known: align"),
        ("objective=[pixel,3]", "objective=[pixel,3]: give the name of an option. Known: align"),
        ("callbacks=[null]", "callbacks=[null]: give the name of an option. Known: "),
        ("objective=[pixel,[diff]]", "objective=[pixel,[diff]]: give the name of an option."),
    ],
)
def test_options_that_are_none_are_one_line(
    word: str, message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.run(["train", "-m", "seed=0,1", word]) == 1
    err = capsys.readouterr().err
    assert message in err
    assert err.count("\n") == 1


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a: [1,\n b", "mine/data/x.yaml, line 2: no YAML (expected ',' or ']'"),
        ("name: sim\n\tscenes: 3\n", "mine/data/x.yaml, line 2: no YAML (found character"),
        ("defaults: foo\n", "defaults must be a list"),
        ("- a\n", ""),
        ("name: sim # caf\udce9\n", "is not UTF-8"),
    ],
)
@pytest.mark.parametrize("verb", ["train", "data inspect"])
def test_a_slip_in_an_own_yaml_is_one_line(
    verb: str, text: str, message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    Path("mine/data").mkdir(parents=True)
    Path("mine/data/x.yaml").write_text(text, "utf-8", "surrogateescape")
    assert cli.run([*verb.split(), "--config-dir", "mine", "data=x"]) == 1
    err = capsys.readouterr().err
    assert message in err
    assert err.count("\n") == 1


@pytest.mark.slow
def test_a_command_does_not_search_the_places_of_the_one_before(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A recipe of the same name as in another folder, by another command of one process."""
    words = ["train", "--config-dir", "mine", "recipe=soft", "--cfg", "job"]
    for folder, seed in (("first", 3), ("second", 4)):
        (tmp_path / folder / "mine/recipe").mkdir(parents=True)
        monkeypatch.chdir(tmp_path / folder)
        Path("mine/recipe/soft.yaml").write_text(
            f"# @package _global_\ndefaults: [anytouch2, _self_]\nseed: {seed}\n"
        )
        assert cli.run(words) == 0
        assert f"\nseed: {seed}\n" in capsys.readouterr().out


@pytest.mark.parametrize("flags", [["--cfg", "job"], ["--explain", "objective.force.weight"], []])
def test_a_recipe_without_its_package_line_is_named(
    flags: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    Path("mine/recipe").mkdir(parents=True)
    Path("mine/recipe/soft.yaml").write_text("defaults: [anytouch2, _self_]\nseed: 3\n")
    assert cli.run(["train", "--config-dir", "mine", "recipe=soft", *flags]) == 1
    assert "the first line of its YAML has to be '# @package _global_'" in capsys.readouterr().err


@pytest.mark.slow
def test_a_stopped_sweep_of_several_processes_goes_on(capfd: pytest.CaptureFixture[str]) -> None:
    """The first job has ended; of the second there is its folder alone."""
    words = ["train", "-m", *SMALL, "trainer.accelerator=cpu", "trainer.devices=2"]
    assert cli.run([*words, "seed=1", "hydra.sweep.dir=s"]) == 0
    before = (Path("s/0") / LAST).read_bytes()
    assert cli.run([*words, "seed=0,1", "hydra.sweep.dir=s"]) == 0
    assert (Path("s/0") / LAST).read_bytes() == before
    assert "taken, as it has ended" in capfd.readouterr().out
    rows = Path("s/sweep.csv").read_text().split()
    assert {row.partition(",")[0] for row in rows[1:]} == {"0", "1"}
