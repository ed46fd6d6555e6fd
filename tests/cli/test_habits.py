"""The same habits on every verb, and the order of precedence."""

import csv
import os
import re
import subprocess
import sys
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest
import yaml
from hydra.core.utils import JobReturn, JobStatus
from omegaconf import OmegaConf

from tactileforge import cli
from tactileforge.api import metric
from tactileforge.cli._complete import complete
from tactileforge.cli._compose import compose
from tactileforge.cli._options import options, yaml_text
from tactileforge.cli._sweep import SweepTable
from tactileforge.cli._words import read
from tactileforge.errors import ConfigError

SMALL = ["scale=demo", "debug=steps", "data.scenes=3", "data.val=1", "data.size=32"]
SMALL += ["encoder.image_size=32", "batch.size=4", "objective=[pixel]"]


def said(capsys: pytest.CaptureFixture[str], *words: str) -> str:
    assert cli.run(words) == 0
    return capsys.readouterr().out


def error_of(capsys: pytest.CaptureFixture[str], *words: str) -> str:
    assert cli.run(words) == 1
    err = capsys.readouterr().err
    assert err.startswith("error: ")
    assert err.count("\n") == 1, "one line"
    return err


@pytest.fixture(autouse=True)
def _elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


@pytest.mark.slow
def test_every_command_has_help_that_says_each_key(capsys: pytest.CaptureFixture[str]) -> None:
    assert set(cli.verbs()) >= {"train", "sim", "data", "zoo", "plugins", "record", "live", "bench"}
    for verb in cli.verbs():
        for action, command in cli.commands(verb).items():
            out = said(capsys, *filter(None, (verb, action)), "--help")
            assert command.about
            assert command.about in out
            keys = command.keys.__dataclass_fields__ if command.keys else ()
            typed = {real: name for name, real in command.also.items()}
            for key in (typed.get(one, one) for one in keys):
                before, _, _ = out.partition(f"\n{key}:")
                assert before != out, key
                assert before.rpartition("\n")[2].startswith("#"), (
                    f"{verb} {action}: {key} has no meaning"
                )


@pytest.mark.parametrize(
    ("words", "value"),
    [
        (["train", "scale=demo"], ["trainer", "max_steps", 800]),
        (["data", "inspect", "data=sim"], ["recordings", 400]),
        (["zoo", "list"], ["pattern", "*"]),
        (["sim", "out=x"], ["action_seconds", 0.6]),
        (["record", "sensor=sim", "out=x"], ["background", "seconds", 1.0]),
        (["record", "sensor=sim", "out=x", "labels={who: ana}"], ["labels", "who", "ana"]),
        (["live", "sensor=sim", "depth={sim: digit}"], ["depth", "sim", "digit"]),
    ],
)
def test_cfg_job_prints_what_would_be_used(
    words: list[str], value: list[object], capsys: pytest.CaptureFixture[str]
) -> None:
    node = yaml.safe_load(said(capsys, *words, "--cfg", "job"))
    for key in value[:-1]:
        node = node[key]
    assert node == value[-1]
    assert not os.listdir()


@pytest.mark.parametrize(
    ("word", "message"),
    [
        ("objective.pixel.weight=high", "objective.pixel.weight is 'high', which is not of type"),
        ("head.pixel.width=1.5", "head.pixel.width is 1.5, which is not of type int"),
        ("encoder.depth=two", "encoder.depth is 'two', which is not of type int"),
        ("data.scenes=2.5", "data.scenes is 2.5, which is not of type int"),
        ("optim.lr=fast", "optim.lr is 'fast', which is not of type float"),
        ("optim.schedule=cosin", "unknown optim.schedule 'cosin'; did you mean 'cosine'?"),
        ("trainer.max_steps=ten", "trainer.max_steps is 'ten', which is not of type int"),
        ("+trainer.max_stepz=3", "unknown key 'trainer.max_stepz'; did you mean 'trainer.max_st"),
        ("seed=x", "seed=x: give a whole number"),
    ],
)
def test_cfg_job_refuses_what_training_refuses(
    word: str, message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert message in error_of(capsys, "train", word, "--cfg", "job")


def test_cfg_job_shows_what_is_chosen_and_not_more(capsys: pytest.CaptureFixture[str]) -> None:
    shown = yaml.safe_load(said(capsys, "train", "objective=[pixel,dino]", "--cfg", "job"))
    assert [*shown["objective"]] == [*shown["head"]] == ["pixel", "dino"]
    part = said(capsys, "train", "--cfg", "job", "--package", "head.pixel", "--resolve")
    assert yaml.safe_load(part)["name"] == "pixel"
    wrong = error_of(capsys, "train", "--cfg", "job", "-p", "head.pixl")
    assert "unknown block 'head.pixl'; did you mean 'head.pixel'" in wrong


def test_keys_are_shown_by_the_names_that_are_typed(capsys: pytest.CaptureFixture[str]) -> None:
    for words in (["plugins", "new"], ["zoo", "get"]):
        shown = said(capsys, *words, "--help")
        assert "\nfrom: null" in shown
        assert not re.search("^(source|file):", shown, re.MULTILINE)


def test_multirun_of_a_verb_without_plugins(capsys: pytest.CaptureFixture[str]) -> None:
    out = said(capsys, "zoo", "show", "-m", "model=mae,clip")
    assert "mae.base: " in out
    assert "zoo show clip " in out


@pytest.mark.slow
def test_multirun_trains_each_in_a_folder_of_its_own() -> None:
    from tactileforge.runs.checkpoint_file import read_checkpoint

    assert cli.run(["train", "-m", "seed=0,1", *SMALL]) == 0
    (sweep,) = Path("runs/sweeps").iterdir()
    assert {p.name for p in sweep.iterdir()} == {
        *("0", "1", "multirun.yaml", "sweep.csv", "sweep.html"),
        *(".lock", ".sweep.json", ".choosing"),
    }
    for number in range(2):
        assert yaml.safe_load((sweep / str(number) / "config.yaml").read_text())["seed"] == number
        assert (sweep / str(number) / "report.html").is_file()
    first, second = (read_checkpoint(sweep / str(number))["state_dict"] for number in range(2))
    assert any((first[key] != second[key]).any() for key in first)


@pytest.mark.slow
@pytest.mark.parametrize("launcher", ["joblib", "ray"])
def test_the_jobs_of_a_launcher_are_gathered_in_a_table(launcher: str) -> None:
    """Two processes at once, each in a folder of its own; the smallest loss comes first."""
    pytest.importorskip(f"hydra_plugins.hydra_{launcher}_launcher")
    code = "import sys; from tactileforge.cli import run; sys.exit(run(sys.argv[1:]))"
    words = ["train", "-m", "optim.lr=1e-5,1e-2", f"hydra/launcher={launcher}", *SMALL]
    done = subprocess.run([sys.executable, "-c", code, *words], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    (sweep,) = Path("runs/sweeps").iterdir()
    with (sweep / "sweep.csv").open() as file:
        head, *rows = csv.reader(file)
    assert head == ["job", "optim.lr", "loss"]
    assert {row[1] for row in rows} == {"1e-05", "0.01"}
    losses = [float(row[2]) for row in rows]
    assert losses == sorted(losses)
    assert "sweep:" in done.stdout
    for job, rate, loss in rows:
        found = yaml.safe_load((sweep / job / "config.yaml").read_text())
        assert found["optim"]["lr"] == float(rate)
        assert np.isfinite(float(loss))


def test_the_table_of_a_sweep_has_what_differs(capsys: pytest.CaptureFixture[str]) -> None:
    jobs = [("a=1 b=2", 0.5), ("a=2 b=2", float("nan")), ("a=3 b=2", 0.25)]
    for number, (words, loss) in enumerate(jobs):
        Path(f"s/{number}").mkdir(parents=True)
        overrides = {"task": words.split()}
        hydra = {"mode": "MULTIRUN", "job": {"num": number}, "overrides": overrides}
        hydra |= {"runtime": {"output_dir": f"s/{number}"}, "sweep": {"dir": "s"}}
        job = JobReturn(_return_value=loss, status=JobStatus.COMPLETED)
        SweepTable().on_job_end(OmegaConf.create({"hydra": hydra}), job)
    SweepTable().on_multirun_end(OmegaConf.create({"hydra": {"sweep": {"dir": "s"}}}))
    text = Path("s/sweep.csv").read_text().split()
    assert text == ["job,a,loss", "2,3,0.25", "0,1,0.5", "1,2,nan"]
    assert capsys.readouterr().out.splitlines()[1].split() == ["2", "3", "0.25"]


def test_a_job_that_fails_leaves_the_table_of_those_before(
    capsys: pytest.CaptureFixture[str],
) -> None:
    done = {"mode": "MULTIRUN", "job": {"num": 0}, "overrides": {"task": ["~augment", "a=1"]}}
    done |= {"runtime": {"output_dir": "s/0"}, "sweep": {"dir": "s"}}
    Path("s/0").mkdir(parents=True)
    job = JobReturn(_return_value=0.5, status=JobStatus.COMPLETED)
    SweepTable().on_job_end(OmegaConf.create({"hydra": done}), job)
    Path("s/1").mkdir()
    other = {"job": {"num": 1}, "runtime": {"output_dir": "s/1"}}
    failed = OmegaConf.create({"hydra": done | other})
    job = JobReturn(_return_value=ConfigError("no room"), status=JobStatus.FAILED)
    SweepTable().on_job_end(failed, job)
    rows = ["job,loss,failed", "0,0.5,", "1,,no room"]
    assert Path("s/sweep.csv").read_text().splitlines() == rows


def test_words_that_sweeps_and_flags_are_given() -> None:
    lists = "objective=[pixel,diff,force],[pixel,diff,match]"
    words = read(["-m", lists, "~augment", "--trainer.max_steps", "4", "--optim.lr=1"])
    assert words.overrides == [lists, "~augment", "trainer.max_steps=4", "optim.lr=1"]
    with pytest.raises(ConfigError, match="has diff twice"):
        read(["objective=[pixel],[diff,diff]"])


def test_a_metric_that_no_run_has_is_named_before(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.run(["train", *SMALL, "optimized_metric=val/pixle"]) == 1
    assert "'val/pixle'; did you mean 'val/pixel'" in capsys.readouterr().err


@pytest.mark.slow
def test_a_new_key_that_nothing_reads_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    for word in ("lr=1e-4", "+lr=1e-4"):
        said = error_of(capsys, "train", *SMALL, word)
        assert "unknown key 'lr'; did you mean 'optim.lr'? Known:" in said
        assert "A key that is new" not in said
    assert "did you mean 'trainer.max_epochs'" in error_of(capsys, "train", *SMALL, "+epochs=3")
    key = "data.layouts.pads.object=nut"
    said = error_of(capsys, "train", "data=recordings", "data.root=.", key)
    assert "data.layouts is empty here. A key that is new: +data.layouts.pads.object=" in said


def test_options_of_a_head_that_the_recipe_does_not_name(
    capsys: pytest.CaptureFixture[str],
) -> None:
    words = ["objective=[pixel,dino]", "head.dino.prototypes=7", "--cfg", "job", "-p", "head.dino"]
    assert "prototypes: 7" in said(capsys, "train", *words)
    wrong = error_of(capsys, "train", *SMALL, "head.pixel.widht=3")
    assert "unknown key 'head.pixel.widht'; did you mean 'head.pixel.width'" in wrong


def test_two_mistakes_are_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    words = ("sensor=sim", "objct=mug", "secnds=3", "out=x")
    assert "unknown key 'objct'" in error_of(capsys, "record", *words)
    assert "unknown dataset 're+a'" in error_of(capsys, "train", *SMALL, "data.name=re+a")


def test_what_is_deleted_has_no_value(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.run(["train", "~augment", "--cfg", "job"]) == 0
    assert "augment" not in capsys.readouterr().out


def test_the_number_of_a_job_is_that_of_validation_where_there_is_one() -> None:
    def found(logged: dict[str, float], name: str | None = None) -> float:
        module: Any = SimpleNamespace(
            objectives=["pixel", "force"], trainer=SimpleNamespace(callback_metrics=logged)
        )
        return metric(module, name)

    trained = {"train/pixel": 1.0, "train/force": 2.0}
    assert found(trained) == 3.0, "a run that was too short to be validated"
    assert found(trained | {"val/pixel": 0.5, "val/force": 0.25}) == 0.75
    assert found(trained, "train/force") == 2.0
    with pytest.raises(ConfigError, match="did you mean 'train/force'"):
        found(trained, "train/forse")


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["trian"], "did you mean 'train'"),
        (["train", "trainer.max_step=3"], "did you mean 'trainer.max_steps'"),
        (["train", "trainr.max_steps=3"], "did you mean 'trainer.max_steps'"),
        (["train", "data=recordings"], "give data.root=..."),
        (["train", "data=public_samples"], "give data.root=..."),
        (["train", *SMALL, "optim.lr=abc"], "optim.lr is 'abc', which is not of type float"),
        (["train", *SMALL, "+trainer.foo=1"], "unknown key of trainer 'foo'"),
        (["train", *SMALL, "logger=wandb"], "[wandb]'"),
        (["train", "resume=nope"], "give the folder of a run"),
        (["train", *SMALL, "init=anytouch2.tiny"], "so encoder.image_size=32 cannot be given"),
        (["train", *SMALL, "encoder.depth=100000"], "encoder.depth=100000: at most 256"),
        (["bench", "model=[pixelz]"], "did you mean 'pixels'"),
        (["bench", "model=[anytouch2.tinny,pixels]"], "tiny"),
        (["sim", "out=x", "sise=3"], "did you mean 'size'"),
        (["sim", "out=x", "size=big"], "size is 'big', which is not of type int"),
        (["data", "pack", "data=sim", "out=x", "pack.codek=png"], "did you mean 'pack.codec'"),
        (["export", "x", "model=y"], "'x' is not key=value"),
        (["zoo", "list", "--markdwn"], "did you mean 'markdown'"),
    ],
)
def test_mistakes_are_one_line_and_leave_nothing(
    words: list[str], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert message in error_of(capsys, *words)
    assert not [item for item in Path().rglob("*") if item.is_file()]


@pytest.mark.slow
def test_an_explicit_curriculum_wins_over_a_scale() -> None:
    constant = compose("anytouch2", ["curriculum=constant", "scale=demo"]).curriculum
    assert not constant.objective
    assert constant.universal.high == 0.0
    assert compose("anytouch2", ["scale=demo"]).curriculum.objective.force.start == 0.1
    assert compose("anytouch2", ["scale=tiny"]).curriculum.objective.align.start == 0.2
    assert compose("anytouch2", []).curriculum.objective.align.start == 0.75


DERIVED = "# @package _global_\ndefaults: [anytouch2, _self_]\nobjective: {force: {weight: 0.3}}\n"


@pytest.mark.slow
def test_a_recipe_of_ones_own_wins_over_a_scale(capsys: pytest.CaptureFixture[str]) -> None:
    Path("mine/recipe").mkdir(parents=True)
    Path("mine/recipe/soft.yaml").write_text(DERIVED)
    for where in (
        ["--config-dir", "mine"],
        [f"hydra.searchpath=[file://{Path('mine').resolve()}]"],
    ):
        out = said(capsys, "train", *where, "recipe=soft", "scale=demo", "--cfg", "job")
        config = yaml.safe_load(out)
        assert config["objective"]["force"]["weight"] == 0.3
        assert config["objective"]["match"]["weight"] == 0.1, "of the scale"
        assert config["encoder"]["norm_in"] is False, "tuned for the recipe that it derives from"
        key = "objective.force.weight"
        told = said(capsys, "train", *where, "recipe=soft", "scale=demo", "--explain", key)
        assert told.startswith(f"{key} = 0.3\n")
        assert "did you mean 'soft'" in error_of(capsys, "train", *where, "recipe=sof")
    assert "mean 'soft'" in error_of(capsys, "train", "hydra.searchpath=[mine]", "recipe=sof")
    assert options("recipe", ["pkg://nowhere"]) == options("recipe")
    Path("mine/recipe/soft.yaml").write_text(DERIVED.partition("\n")[2])
    message = error_of(capsys, "train", "--config-dir", "mine", "recipe=soft", "scale=demo")
    assert "the first line of its YAML has to be '# @package _global_'" in message
    Path("mine/recipe/soft.yaml").write_text(DERIVED.replace("[anytouch2", "[{/recipe: anytouch2}"))
    message = error_of(capsys, "train", "--config-dir", "mine", "recipe=soft", "scale=demo")
    assert "begins with defaults: [OTHER, _self_]" in message


@pytest.mark.slow
def test_explain_says_where_a_value_is_from(capsys: pytest.CaptureFixture[str]) -> None:
    key = "objective.force.weight"
    first, *rows = said(capsys, "train", "scale=demo", f"{key}=2", "--explain", key).splitlines()
    assert first == f"{key} = 2"
    assert [row.split() for row in rows[:-1]] == [
        ["objective=force,", "its", "own", "default", "1.0"],
        ["recipe/anytouch2.yaml", "0.1"],
        ["scale/demo.yaml", "1.0"],
        ["command", "line", "2"],
    ]
    assert "did you mean" in error_of(capsys, "train", "--explain", "objective.force.wieght")


@pytest.mark.parametrize(
    ("line", "found"),
    [
        ("tactileforge tr", ["train "]),
        ("tactileforge data p", ["pack ", "parquet "]),
        ("tactileforge train scale=d", ["demo"]),
        ("tactileforge train sca", ["scale="]),
        ("tactileforge train objective=[pixel,for", ["[pixel,force"]),
        ("tactileforge data pack data=ycb", ["ycb_slide"]),
        ("tactileforge record qua", ["quality="]),
        ("tactileforge train trainer.max_s", ["trainer.max_steps="]),
        ("tactileforge train --optim.wei", ["--optim.weight_decay="]),
        ("tactileforge train data=recordings data.roo", ["data.root="]),
        ("tactileforge train objective.force.sh", ["objective.force.shear="]),
        ("tactileforge train --cf", ["--cfg"]),
    ],
)
def test_completion(line: str, found: list[str]) -> None:
    assert complete(line) == found


def test_options_of_ones_own_are_completed() -> None:
    Path("mine/recipe").mkdir(parents=True)
    Path("mine/recipe/soft.yaml").write_text(DERIVED)
    assert complete("tactileforge train --config-dir mine recipe=so") == ["soft"]


def test_help_tells_every_key_and_the_options_that_are_chosen(
    capsys: pytest.CaptureFixture[str],
) -> None:
    out = said(capsys, "train", "data=recordings", "--help")
    for key in ("max_steps", "val_check_interval", "lr", "clip", "hop", "cache_mb", "root"):
        before, found, _ = out.partition(f"\n  {key}:")
        assert found, key
        assert before.rpartition("\n")[2].startswith("  # "), f"{key} has no meaning"
    assert "objective.force:" in out
    assert "taxels" not in out


def test_the_page_of_keys_is_that_of_the_code(capsys: pytest.CaptureFixture[str]) -> None:
    """Written anew by ``tactileforge plugins keys markdown=true > docs/keys.md``."""
    page = Path(__file__).parents[2] / "docs" / "keys.md"
    assert said(capsys, "plugins", "keys", "markdown=true") == page.read_text("utf-8")


def test_the_page_has_the_usual_optimizer_and_what_all_of_them_have(
    capsys: pytest.CaptureFixture[str],
) -> None:
    page = (Path(__file__).parents[2] / "docs" / "keys.md").read_text("utf-8")
    usual = page.partition("### optim=adamw\n")[2].partition("\n### ")[0]
    own = page.partition("### optim=sgd\n")[2].partition("\n### ")[0]
    shared = ("warmup", "schedule", "clip", "layer_decay")
    for key in ("lr", "betas", *shared):
        assert f"\n  {key}: " in usual, key
    assert "one_cycle" in usual
    assert "Each has `warmup`, `schedule`, `clip`, `layer_decay`, `rates` too, as `adamw`." in page
    assert "\nmomentum: 0" in own
    out = said(capsys, "train", "optim=sgd", "--help").partition("\noptim:  # sgd\n")[2]
    for key in ("momentum", *shared):
        assert f"\n  {key}: " in out, key


@pytest.mark.slow
def test_what_would_be_used_has_the_optimizers_own_learning_rate(
    capsys: pytest.CaptureFixture[str],
) -> None:
    words = ("recipe=mae", "scale=finetune", "optim=torch.optim:SGD", "--cfg", "job")
    own = yaml.safe_load(said(capsys, "train", *words))["optim"]
    assert (own["lr"], own["momentum"]) == (1e-3, 0)
    assert yaml.safe_load(said(capsys, "train", *words, "optim.lr=0.2"))["optim"]["lr"] == 0.2


def test_every_key_of_the_page_has_a_meaning() -> None:
    """Of verbs, of groups and of each installed plugin; a heading of keys needs none."""
    lines = (Path(__file__).parents[2] / "docs" / "keys.md").read_text("utf-8").splitlines()
    keys = [(before, line) for before, line in pairwise(lines) if re.match(r"\s*\w+: \S", line)]
    assert len(keys) > 400
    assert [line for before, line in keys if not before.strip().startswith("# ")] == []


@pytest.mark.parametrize("path", ["trainer/default", "optim/adamw", "batch/default"])
def test_every_key_of_a_group_has_a_meaning(path: str) -> None:
    lines = yaml_text(path).splitlines()
    keys = [place for place, line in enumerate(lines) if not line.startswith("#")]
    assert keys
    assert all(lines[place - 1].startswith("# ") for place in keys)


@pytest.mark.slow
def test_a_run_below_a_file_is_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    Path("notes").write_text("mine")
    for folder in ("notes", "notes/run", "/proc/nothing/run"):
        err = error_of(capsys, "train", *SMALL, f"hydra.run.dir={folder}")
        assert "give another hydra.run.dir=" in err
    assert Path("notes").read_text() == "mine"


LAYOUT = """layouts:
  cups: {images: "*.png", each: touch, sensor: digit, background: none, labels: {file: l.csv}%s}
"""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("text", "extra", "message"),
    [
        (
            "file,name\na.png,caf\xe9\n",
            ', object: "{name}"',
            "is not UTF-8; download it again, save it as CSV UTF-8",
        ),
        ("file,file\na.png,b\n", "", "two columns are called 'file'"),
        (
            "file\na.png\n",
            ", force: {file: f.csv, columns: [fx, fx, null]}",
            "give each axis a column of its own",
        ),
    ],
)
def test_labels_that_cannot_be_read_are_one_line(
    text: str, extra: str, message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    cv2.imwrite("a.png", np.zeros((32, 32, 3), np.uint8))
    Path("l.csv").write_bytes(text.encode("latin1"))
    Path("tactileforge.yaml").write_text(LAYOUT % extra)
    err = error_of(
        capsys, "train", "data=recordings", "data.root=.", "objective=[pixel]", *SMALL[:2]
    )
    assert message in err


def test_jobs_in_the_help_are_quoted_as_a_shell_needs(capsys: pytest.CaptureFixture[str]) -> None:
    assert """'jobs=["hydra/launcher=ray"]'""" in said(capsys, "bench", "--help")
