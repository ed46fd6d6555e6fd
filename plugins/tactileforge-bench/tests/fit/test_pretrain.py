"""Models trained for a bench: kinds, names, reuse and failures."""

import json
import sys
from pathlib import Path
from typing import Any

import pytest
from omegaconf import OmegaConf
from tactileforge_bench.fit import pretrain
from tactileforge_bench.fit.pretrain import PretrainJob, PretrainModel
from tactileforge_bench.verbs.bench import COMMANDS

from tactileforge.cli._compose import compose
from tactileforge.errors import ConfigError, TactileForgeError
from tactileforge.plugins import registry
from tactileforge.util import processes

ABLATIONS = ["no_align", "no_diff", "none"]


def miniature() -> dict[str, Any]:
    return COMMANDS[""].compose("bench", ["suite=[sim,public_samples]", "pretrain=miniature"])


@pytest.mark.slow
def test_the_miniature_is_what_the_issue_of_the_paper_is() -> None:
    """Objectives and frames of every model; the same data, steps and input for all."""
    config = miniature()
    models = pretrain.read_models(config["pretrain"])
    runs = pretrain.jobs(Path("x"), config["pretrain"]["words"], models)
    assert {len(jobs) for jobs in runs.values()} == {3}
    everything = {"pixel", "diff", "align", "match", "force"}
    objectives = {
        "anytouch2": everything,
        "mae": {"pixel"},
        "vjepa": {"jepa"},
        "anytouch1": {"pixel", "align", "match"},
        "align_only": {"align"},
        "no_diff": everything - {"diff"},
        "no_match": everything - {"match"},
        "no_force": everything - {"force"},
        "no_align": everything - {"align"},
        "no_schedule": everything,
        "two_frames": everything,
    }
    assert runs.keys() == objectives.keys()
    shared = set()
    for name, jobs in runs.items():
        recipe, *words = jobs[0].words
        plain: Any = OmegaConf.to_container(
            compose(recipe.removeprefix("recipe="), words), resolve=True
        )
        assert plain["objective"].keys() == objectives[name]
        encoder = registry.build("encoders", plain["encoder"])
        assert encoder.frames == {"mae": 2, "two_frames": 2, "anytouch1": 3}.get(name, 4)
        shared.add(
            json.dumps(
                [
                    {**plain["data"], "max_bad": 0},
                    plain["trainer"]["max_steps"],
                    plain["batch"]["size"],
                    encoder.image_size,
                    encoder.patch,
                    encoder.width,
                    encoder.depth,
                ]
            )
        )
    assert len(shared) == 1
    assert plain["data"]["indenters"] == "pretrain", "the bench's indenters are left out"
    assert config["tasks"]["sim_force"]["data"]["indenters"] == "bench"
    assert config["model"] == ["untrained:anytouch2", "pixels"]


def test_ablations_of_the_first_model() -> None:
    base = {"mine": PretrainModel(title="Mine", recipe="anytouch2", words=["a=1"], seeds=[3])}
    jobs = pretrain.ablations("all", ABLATIONS, base)
    assert list(jobs) == ["mine", "no_align", "no_diff"]
    assert jobs["no_diff"].words == ["a=1", "ablation=no_diff"]
    assert (jobs["no_diff"].group, jobs["no_diff"].seeds) == ("ablation", [3])
    assert list(pretrain.ablations("no_diff", ABLATIONS, {})) == ["anytouch2", "no_diff"]
    with pytest.raises(ConfigError, match="did you mean 'no_diff'"):
        pretrain.ablations("no_dif", ABLATIONS, {})
    with pytest.raises(ConfigError, match="did you mean 'recipe'"):
        pretrain.read_models({"models": {"a": {"title": "A", "recipes": "x"}}})


def test_seeds_are_those_of_all_models_but_where_one_names_its_own() -> None:
    models = pretrain.read_models(
        {"seeds": [1, 2], "models": {"a": {"title": "A"}, "b": {"title": "B", "seeds": [5]}}}
    )
    assert (models["a"].seeds, models["b"].seeds) == ([1, 2], [5])


@pytest.fixture
def train(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> list[list[str]]:
    """Puts a small program in the place of ``tactileforge train``; the words of each call."""
    program = tmp_path / "train.py"
    program.write_text(
        """
import pathlib, sys
words = dict(word.partition("=")[::2] for word in sys.argv[1:])
folder = pathlib.Path(words.get("hydra.run.dir") or words["resume"])
(folder / "checkpoints").mkdir(parents=True, exist_ok=True)
(folder / "checkpoints" / "last.ckpt").write_text("x")
if words.get("fail"):
    print("something", file=sys.stderr)
    sys.exit("error: no such folder; download it")
if words.get("stop"):
    sys.exit(130)
(folder / "report.html").write_text("x")
"""
    )
    calls: list[list[str]] = []
    popen = processes.subprocess.Popen

    def started(command: list[str], **given: Any) -> Any:
        assert command[:4] == [sys.executable, "-m", "tactileforge", "train"]
        calls.append(command[4:])
        return popen([sys.executable, str(program), *command[4:]], **given)

    monkeypatch.setattr(processes.subprocess, "Popen", started)
    return calls


def test_a_finished_run_stays(train: list[list[str]], tmp_path: Path) -> None:
    job = PretrainJob("a-0", tmp_path / "a-0", ["recipe=mae", "seed=0"])
    pretrain.train_all([job], None)
    assert train == [["recipe=mae", "seed=0", f"hydra.run.dir={job.folder}"]]
    assert job.finished
    pretrain.pretrain(job)
    assert len(train) == 1
    with pytest.raises(ConfigError, match="holds a run of other settings"):
        pretrain.pretrain(PretrainJob("a-0", job.folder, ["recipe=mae", "seed=1"]))


def test_a_stopped_run_is_resumed(train: list[list[str]], tmp_path: Path) -> None:
    job = PretrainJob("a-0", tmp_path / "a-0", ["stop=1"])
    with pytest.raises(KeyboardInterrupt):
        pretrain.pretrain(job)
    assert not job.finished
    pretrain.pretrain(job)
    assert train[1] == [f"resume={job.folder}"]
    assert job.finished


def test_a_failed_run_says_why_when_it_is_opened(train: list[list[str]], tmp_path: Path) -> None:
    model = PretrainModel(title="A", words=["fail=1"])
    runs = pretrain.jobs(tmp_path, [], {"a": model})["a"]
    pretrain.train_all(runs, None)
    entry = pretrain.pretrained_entry("a", model, runs, "cpu")
    with pytest.raises(TactileForgeError, match=r"a-0 failed: no such folder; download it$"):
        entry.open[0]()


def test_jobs_of_hydra_train_the_same(train: list[list[str]], tmp_path: Path) -> None:
    runs = [
        PretrainJob(f"a-{i}", tmp_path / f"a-{i}", ["recipe=mae", f"seed={i}"]) for i in range(2)
    ]
    before = list(sys.argv)
    pretrain.train_all(runs, ["hydra/launcher=basic"])
    assert sys.argv == before
    assert [words[:2] for words in train] == [["recipe=mae", "seed=0"], ["recipe=mae", "seed=1"]]
    assert all(job.finished for job in runs)


@pytest.mark.slow
@pytest.mark.filterwarnings("default")  # of Ray
def test_jobs_of_ray_train_in_its_processes(tmp_path: Path) -> None:
    pytest.importorskip("hydra_plugins.hydra_ray_launcher")
    words = ["recipe=mae", "scale=demo", "debug=steps", "data.scenes=2", "data.val=1"]
    words += ["data.size=32", "encoder.image_size=32", "batch.size=4"]
    runs = [PretrainJob(f"a-{i}", tmp_path / f"a-{i}", [*words, f"seed={i}"]) for i in range(2)]
    pretrain.train_all(runs, ["hydra/launcher=ray"])
    assert all(job.finished for job in runs)


def test_curves_of_a_run(tmp_path: Path) -> None:
    rows = ["step,train/pixel,val/pixel,train/pixel/part,lr", "0,3.0,,1,1", "5,2.0,2.5,1,1"]
    (tmp_path / "metrics.csv").write_text("\n".join(rows) + "\n")
    (curve,) = pretrain.curves("a", tmp_path)
    assert (curve.objective, curve.step, curve.train) == ("pixel", [0.0, 5.0], [3.0, 2.0])
    assert str(curve.validation) == "[nan, 2.5]"
