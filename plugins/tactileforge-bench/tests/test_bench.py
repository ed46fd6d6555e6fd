"""A bench from end to end: finished cells, failed ones, and continuation after a stop."""

import json
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from tactileforge_bench import run as bench_run
from tactileforge_bench.fit.features import FeatureStore
from tactileforge_bench.fit.frozen_encoder import FrozenEncoder
from tactileforge_bench.fit.models import ModelEntry, baseline_encoder
from tactileforge_bench.fit.resolve import choose_probe, result_task
from tactileforge_bench.results import load
from tactileforge_bench.results.write import Writer
from tactileforge_bench.run import Bench, BenchOptions
from tactileforge_bench.tasks.source import TaskSource
from tactileforge_bench.tasks.suite import ClipSpec, Task, parse_task

from tactileforge import cli
from tactileforge.contracts import Recording
from tactileforge.data.frames.lazy import ArrayFrames
from tactileforge.encoders.tactile_vit import TactileViT
from tactileforge.errors import ConfigError, DataNotFoundError, TactileForgeError
from tactileforge.hub.files import make_header

NODE = {"name": "tactile_vit", "size": "tiny", "frames": 4, "image_size": 32}
FORCE = {
    "title": "Force",
    "data": {"name": "made_here"},
    "clip": {"span": 0.1, "hop": 0.1},
    "target": "force",
    "probe": {"name": "force", "epochs": 2, "lr": 1e-3},
    "metrics": ["rmse_sum_axes", "rmse_z"],
    "split": {"train": {"side": "train"}, "test": {"side": "val"}, "unseen": ["object"]},
}
HARD = FORCE | {
    "title": "Hardness",
    "target": "label:hardness",
    "probe": {"name": "linear_adamw", "epochs": 2},
    "metrics": ["accuracy", "f1"],
}


def recording(number: int, sensor: str, label: float) -> Recording:
    """A square with the normal force as its brightness."""
    frames = np.full((10, 32, 32, 3), 90, np.uint8)
    push = np.abs(np.sin(np.arange(10) + number))
    frames[:, 8:24, 8:24] += (push * 100).astype(np.uint8)[:, None, None, None]
    force = np.stack([push * 0, push * 0, push * 5], axis=1).astype(np.float32)
    return Recording(
        key=f"r{number}",
        sensor=sensor,
        frames=ArrayFrames(frames),
        times=np.arange(10) / 20,
        no_contact=ArrayFrames(frames[:1] * 0 + 90),
        force=force + np.random.default_rng(number).normal(0, 0.01, force.shape).astype(np.float32),
        object=f"o{number}",
        labels={"hardness": label},
    )


@pytest.fixture
def data(monkeypatch: pytest.MonkeyPatch) -> Callable[..., None]:
    """Stands in for a data set, and says the content of the tasks."""

    def use(sensor: str = "digit", labels: Sequence[float] = (0, 1), error: Any = None) -> None:
        def opened(node: Any, sides: Any, clip: ClipSpec) -> TaskSource:
            if error:
                raise error
            made = [recording(i, sensor, labels[i % len(labels)]) for i in range(8)]
            return TaskSource(made, ["train"] * 6 + ["val"] * 2, clip)

        monkeypatch.setattr(bench_run, "open_source", opened)

    use()
    return use


def subject(seed: int = 0, name: str = "tiny") -> FrozenEncoder:
    torch.manual_seed(seed)
    encoder = TactileViT("tiny", frames=4, image_size=32)
    header = make_header(encoder, NODE, licence="MIT", spacing=0.05, recipe={"encoder": NODE})
    return FrozenEncoder(name, encoder, header)


def tiny(name: str = "tiny", count: int = 1) -> ModelEntry:
    return ModelEntry(
        name=name,
        title=name.title(),
        open=[lambda seed=seed: subject(seed, name) for seed in range(count)],  # type: ignore[misc]
    )


def bench(folder: Path, tasks: dict[str, Any], **options: Any) -> Bench:
    chosen: list[Task] = [parse_task(name, node) for name, node in tasks.items()]
    settings = BenchOptions(**{"seeds": 2, "probe": {}} | options)
    rows = [
        result_task(task, choose_probe(task, settings.probe), settings.selection) for task in chosen
    ]
    writer = Writer(folder, "made", {"seeds": settings.seeds}, rows)
    return Bench(chosen, FeatureStore(folder / "features", workers=0), writer, settings)


def test_everything_is_in_the_file(data: Any, tmp_path: Path) -> None:
    runner = bench(tmp_path, {"force": FORCE, "hard": HARD})
    runner.run(tiny())
    runner.run(
        ModelEntry(name="pixels", title="raw pixels", open=[lambda: baseline_encoder("pixels")])
    )
    loaded = load.read_results(tmp_path)
    assert [(c.task, c.model, c.seed) for c in loaded.cells] == [
        (task, model, seed)
        for model in ("tiny", "pixels")
        for task in ("force", "hard")
        for seed in (0, 1)
    ]
    assert loaded.not_run == []
    cell = loaded.cells[0]
    assert cell.metrics.keys() == {"rmse_sum_axes", "rmse_z"}
    assert 0 < cell.metrics["rmse_z"] <= cell.metrics["rmse_sum_axes"]
    assert len(cell.curve["train"]) == len(cell.curve["validation"]) == 2
    assert cell.setting["lr"] == 1e-3
    assert loaded.models[0].facts["parameters"] == sum(
        p.numel() for p in subject().encoder.parameters()
    )
    with np.load(tmp_path / cell.predictions) as kept:
        error = kept["predicted"] - kept["truth"]
        assert kept["axes"].tolist() == ["x", "y", "z"]
    rmse = 1000 * np.sqrt((error**2).mean(0))
    assert cell.metrics["rmse_sum_axes"] == pytest.approx(rmse.sum(), rel=1e-3)
    with np.load(tmp_path / loaded.cells[2].predictions) as kept:
        assert kept["truth"].dtype == np.int64
        assert set(kept["names"]) == {"0", "1"}
        accuracy = 100 * (kept["truth"] == kept["predicted"]).mean()
    assert loaded.cells[2].metrics["accuracy"] == pytest.approx(accuracy, rel=1e-5)
    assert loaded.tasks[0].selection == "validation"
    assert "unseen in test: object" in loaded.tasks[0].split


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"metrics": ["rmse_sum_axes", "accuracy"]}, "tasks.t.metrics: metric accuracy measures"),
        ({"target": "numbers:hardness", "metrics": ["mae"], "flips": True}, "set flips: false"),
        ({"split": FORCE["split"] | {"unit": "session"}}, "has no 'session'"),
    ],
)
def test_what_does_not_fit_is_refused_before_features(
    change: Any, said: str, data: Any, tmp_path: Path
) -> None:
    with pytest.raises(ConfigError, match=said):
        bench(tmp_path, {"t": FORCE | change})


def test_classes_that_training_never_saw_are_in_the_results(data: Any, tmp_path: Path) -> None:
    data(labels=(0, 1, 0, 1, 0, 1, 2, 1))
    runner = bench(tmp_path, {"hard": HARD})
    said, grey = runner.writer.notes
    assert said == "hard: 4 of 8 test labels are classes that training never saw: 2"
    assert "TF309" in grey
    assert "never saw: 2; TF309" in runner.writer.results.tasks[0].split


def test_doubts_about_the_recordings_are_told_at_their_first_task(
    data: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    opened = bench_run.open_source

    def in_grams(node: Any, sides: Any, clip: ClipSpec) -> TaskSource:
        source = opened(node, sides, clip)
        made = [
            replace(one, force=np.float32(102) * np.asarray(one.force, np.float32))
            for one in source.recordings
        ]
        return TaskSource(made, source.sides, clip)

    monkeypatch.setattr(bench_run, "open_source", in_grams)
    runner = bench(tmp_path, {"force": FORCE, "again": FORCE})
    pictures, forces = sorted(runner.writer.notes, key=lambda line: "TF201" in line)
    assert pictures.startswith("force: TF309 grey pictures in 8 of 8 recordings (r0: ")
    assert forces.startswith("force: TF201 force out of range in 8 of 8 recordings (r3: ")
    first, again = runner.writer.results.tasks
    assert "TF201" in first.split
    assert "TF201" not in again.split


@pytest.mark.slow
def test_cells_that_are_there_are_kept(
    data: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bench(tmp_path, {"force": FORCE}).run(tiny())
    before = (tmp_path / "results.json").read_text()
    trained: list[str] = []
    run = bench_run.evaluate.evaluate_probe

    def counted(prepared: Any, *rest: Any) -> Any:
        trained.append(prepared.task.name)
        return run(prepared, *rest)

    monkeypatch.setattr(bench_run.evaluate, "evaluate_probe", counted)
    bench(tmp_path, {"force": FORCE}).run(tiny())
    assert trained == []
    assert (tmp_path / "results.json").read_text() == before
    bench(tmp_path, {"force": FORCE, "hard": HARD}).run(tiny())
    assert trained == ["hard"]
    bench(tmp_path, {"force": FORCE, "hard": HARD}, seeds=1).run(tiny())
    assert trained == ["hard", "force", "hard"]
    changed = ModelEntry(name="tiny", title="Tiny", open=[lambda: subject(7)])
    bench(tmp_path, {"force": FORCE, "hard": HARD}, seeds=1).run(changed)
    assert trained[3:] == ["force", "hard"], "other weights"
    data(labels=(1, 0))
    bench(tmp_path, {"force": FORCE, "hard": HARD}, seeds=1).run(changed)
    assert trained[5:] == ["hard"], "other labels"


def test_a_bench_of_other_models_forgets_no_cell(
    data: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nor does one stopped before it came to them."""
    bench(tmp_path, {"force": FORCE}).run(tiny("a"))
    bench(tmp_path, {"force": FORCE}).run(tiny("b"))
    assert {cell.model for cell in load.read_results(tmp_path).cells} == {"b"}
    monkeypatch.setattr(bench_run.evaluate, "evaluate_probe", None)
    both = bench(tmp_path, {"force": FORCE})
    both.run(tiny("a"))
    both.run(tiny("b"))
    assert [cell.model for cell in load.read_results(tmp_path).cells] == ["a", "a", "b", "b"]


def test_trainings_take_turns(data: Any, tmp_path: Path) -> None:
    runner = bench(tmp_path, {"force": FORCE}, seeds=3)
    runner.run(tiny(count=2))
    loaded = load.read_results(tmp_path)
    assert [cell.seed for cell in loaded.cells] == [0, 1, 2]
    assert len(loaded.models[0].sha256.split()) == 2


def test_learning_rates_are_settings_and_validation_orders_them(data: Any, tmp_path: Path) -> None:
    task = FORCE | {"probe": {"name": "force", "epochs": 6, "lr": [1e-9, 3e-3]}}
    bench(tmp_path, {"force": task}).run(tiny())
    loaded = load.read_results(tmp_path).cells
    assert [cell.setting["lr"] for cell in loaded] == [3e-3, 3e-3, 1e-9, 1e-9]
    assert loaded[0].metrics["rmse_z"] < loaded[2].metrics["rmse_z"]
    assert len({cell.predictions for cell in loaded}) == 4


@pytest.mark.slow
def test_neighbours_fine_tuning_and_flips(data: Any, tmp_path: Path) -> None:
    knn = HARD | {"probe": {"name": "knn", "neighbours": 3}}
    tuned = FORCE | {"probe": {"name": "force", "epochs": 8, "finetune": 3e-4, "lr": 1e-3}}
    flips = HARD | {"flips": True}
    runner = bench(tmp_path, {"knn": knn, "tuned": tuned, "flips": flips}, seeds=1)
    entry = tiny()
    before = subject().weights
    runner.run(replace(entry, open=[lambda: subject()]))
    loaded = {cell.task: cell for cell in load.read_results(tmp_path).cells}
    assert loaded["knn"].epoch == -1
    assert loaded["knn"].setting == {"neighbours": 3}
    assert loaded["tuned"].curve["train"][-1] < 0.7 * loaded["tuned"].curve["train"][0]
    assert loaded["tuned"].setting["encoder_lr"] == 3e-4
    assert subject().weights == before
    assert len(list((tmp_path / "features").rglob("projected*.npy"))) == 4


def test_a_fine_tuned_encoder_is_a_copy(data: Any, tmp_path: Path) -> None:
    kept = subject()
    weights = {k: v.clone() for k, v in kept.encoder.state_dict().items()}
    tuned = HARD | {"probe": {"name": "linear_adamw", "epochs": 1, "finetune": 1e-2}}
    bench(tmp_path, {"t": tuned}, seeds=1).run(ModelEntry(name="a", title="A", open=[lambda: kept]))
    for name, value in kept.encoder.state_dict().items():
        torch.testing.assert_close(value, weights[name], rtol=0, atol=0)


def test_selection_on_the_test_is_marked(data: Any, tmp_path: Path) -> None:
    task = FORCE | {"probe": {"name": "force", "epochs": 5, "lr": 3e-3}}
    for selection in ("validation", "test"):
        bench(tmp_path / selection, {"f": task}, seeds=1, selection=selection).run(tiny())
    fair, best = (load.read_results(tmp_path / name) for name in ("validation", "test"))
    assert (fair.tasks[0].selection, best.tasks[0].selection) == ("validation", "test")
    assert best.cells[0].metrics["rmse_sum_axes"] <= fair.cells[0].metrics["rmse_sum_axes"] + 1e-3


def not_run(folder: Path) -> list[tuple[str, str, str]]:
    return [(row.task, row.model, row.reason) for row in load.read_results(folder).not_run]


def test_a_sensor_the_model_does_not_know(data: Any, tmp_path: Path) -> None:
    data(sensor="duragel")

    def opened() -> FrozenEncoder:
        loaded = subject()
        loaded.encoder.sensors = {"digit": 0}
        return loaded

    entry = ModelEntry(name="tiny", title="Tiny", open=[opened])
    bench(tmp_path, {"force": FORCE, "any": FORCE | {"unknown_sensor": "universal"}}).run(entry)
    ((task, model, reason),) = not_run(tmp_path)
    assert (task, model) == ("force", "tiny")
    assert "does not know the sensor duragel (it knows: digit)" in reason
    assert {cell.task for cell in load.read_results(tmp_path).cells} == {"any"}


@pytest.fixture
def encoded(monkeypatch: pytest.MonkeyPatch) -> list[tuple[str, ...]]:
    """Sensors of each batch read by an encoder."""
    seen: list[tuple[str, ...]] = []
    features = FrozenEncoder.features

    def counted(self: FrozenEncoder, batch: Any, *rest: Any) -> Any:
        seen.append(tuple(batch["sensor"]))
        return features(self, batch, *rest)

    monkeypatch.setattr(FrozenEncoder, "features", counted)
    return seen


def two_sensors(node: Any, sides: Any, clip: ClipSpec) -> TaskSource:
    """Six recordings of a DIGIT, and two of a DuraGel."""
    made = [recording(i, "digit" if i < 6 else "duragel", i % 2) for i in range(8)]
    return TaskSource(made, ["train"] * 8, clip)


RIDGE = FORCE | {"probe": {"name": "ridge"}, "metrics": ["r2"]}
FOLDS = {"folds": 2, "group": "object"}


def knows_digit() -> FrozenEncoder:
    loaded = subject()
    loaded.encoder.sensors = {"digit": 0}
    return loaded


def test_recordings_that_a_task_leaves_out_are_not_encoded(
    data: Any, tmp_path: Path, encoded: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """So an encoder may not know their sensor, nor does the policy of another task count."""
    monkeypatch.setattr(bench_run, "open_source", two_sensors)
    digit = RIDGE | {"split": FOLDS | {"only": {"sensor": "digit"}}}
    entry = ModelEntry(name="tiny", title="Tiny", open=[knows_digit])
    bench(tmp_path / "one", {"digit": digit}).run(entry)
    assert not_run(tmp_path / "one") == []
    assert {name for batch in encoded for name in batch} == {"digit"}
    every = RIDGE | {"split": FOLDS, "unknown_sensor": "universal"}
    bench(tmp_path / "two", {"digit": digit, "every": every}).run(entry)
    assert not_run(tmp_path / "two") == []
    assert {cell.task for cell in load.read_results(tmp_path / "two").cells} == {"digit", "every"}


def test_a_bench_that_goes_on_finds_its_features(
    data: Any, tmp_path: Path, encoded: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    tasks = {
        "digit": RIDGE | {"split": FOLDS | {"only": {"sensor": "digit"}}},
        "every": RIDGE | {"split": FOLDS},
    }
    monkeypatch.setattr(bench_run, "open_source", two_sensors)
    whole = bench(tmp_path / "whole", tasks)
    whole.run(tiny())
    write = Writer.cells

    def stopped(self: Writer, *rest: Any) -> None:
        write(self, *rest)
        raise KeyboardInterrupt

    monkeypatch.setattr(Writer, "cells", stopped)
    with pytest.raises(KeyboardInterrupt):
        bench(tmp_path / "again", tasks).run(tiny())
    monkeypatch.setattr(Writer, "cells", write)
    encoded.clear()
    bench(tmp_path / "again", tasks).run(tiny())
    assert encoded == []
    found = load.read_results(tmp_path / "again").cells
    assert [cell.metrics for cell in found] == [cell.metrics for cell in whole.writer.results.cells]


def test_one_task_alone_measures_what_it_does_among_others(
    data: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(bench_run, "open_source", two_sensors)
    some = RIDGE | {"split": FOLDS | {"only": {"sensor": "digit"}}}
    tasks = {"every": RIDGE | {"split": FOLDS}, "some": some}
    for name, chosen in (("both", tasks), ("alone", {"some": tasks["some"]})):
        bench(tmp_path / name, chosen).run(tiny())
    both, alone = (load.read_results(tmp_path / name).cells for name in ("both", "alone"))
    among = [cell.metrics["r2"] for cell in both if cell.task == "some"]
    assert among == pytest.approx([cell.metrics["r2"] for cell in alone], abs=1e-3)


def test_two_files_of_one_name_keep_predictions_of_their_own(data: Any, tmp_path: Path) -> None:
    runner = bench(tmp_path, {"force": FORCE}, seeds=1)
    for name in ("file:../good/a.safetensors", "file:good/a.safetensors"):
        runner.run(tiny(name))
    one, other = load.read_results(tmp_path).cells
    assert one.predictions != other.predictions
    assert (tmp_path / one.predictions).is_file()


def test_predictions_are_whole_or_absent(data: Any, tmp_path: Path) -> None:
    savez = np.savez_compressed

    def dies(target: Any, **arrays: Any) -> None:
        savez(target, **arrays)
        raise KeyboardInterrupt

    stopped = bench(tmp_path, {"force": FORCE}, seeds=1)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(np, "savez_compressed", dies)
        with pytest.raises(KeyboardInterrupt):
            stopped.run(tiny())
    assert list((tmp_path / "predictions").iterdir()) == []
    bench(tmp_path, {"force": FORCE}, seeds=1).run(tiny())
    (cell,) = load.read_results(tmp_path).cells
    assert [one.name for one in (tmp_path / "predictions").iterdir()] == [
        Path(cell.predictions).name
    ]


def test_one_class_and_absent_data_do_not_stop_the_rest(data: Any, tmp_path: Path) -> None:
    data(labels=(1,))
    bench(tmp_path, {"force": FORCE, "hard": HARD}).run(tiny())
    ((task, model, reason),) = not_run(tmp_path)
    assert (task, model) == ("hard", "")
    assert "needs two classes or more" in reason
    assert {cell.task for cell in load.read_results(tmp_path).cells} == {"force"}
    data(error=DataNotFoundError("cloth: no folder x. Download it from https://a.b, and give it"))
    bench(tmp_path / "gone", {"force": FORCE}).run(tiny())
    loaded = load.read_results(tmp_path / "gone")
    assert loaded.not_run[0].reason == "cloth: no folder x"
    assert loaded.not_run[0].fix == "Download it from https://a.b."
    assert loaded.cells == []


def test_an_overlap_stops_the_bench(data: Any, tmp_path: Path, monkeypatch: Any) -> None:
    twice = TaskSource(
        [recording(i, "digit", i % 2) for i in (0, 1, 2, 0)], ["train"] * 3 + ["val"], ClipSpec()
    )
    monkeypatch.setattr(bench_run, "open_source", lambda *_: twice)
    with pytest.raises(ConfigError, match="recording 'r0' is in"):
        bench(tmp_path, {"force": FORCE})


def test_a_metric_that_is_no_number(data: Any, tmp_path: Path, monkeypatch: Any) -> None:
    monkeypatch.setattr(bench_run.metrics.PerAxis, "compute", lambda _: torch.tensor(float("nan")))
    bench(tmp_path, {"force": FORCE, "hard": HARD}).run(tiny())
    ((task, model, reason),) = not_run(tmp_path)
    assert (task, model) == ("force", "tiny")
    assert "rmse_sum_axes is nan" in reason
    assert {cell.task for cell in load.read_results(tmp_path).cells} == {"hard"}


def test_a_model_that_cannot_be_opened(data: Any, tmp_path: Path) -> None:
    def broken() -> FrozenEncoder:
        raise TactileForgeError("training x-0 failed: out of memory")

    runner = bench(tmp_path, {"force": FORCE})
    runner.run(ModelEntry(name="x", title="X", open=[broken]))
    runner.run(tiny())
    assert not_run(tmp_path) == [("", "x", "training x-0 failed: out of memory")]
    assert {cell.model for cell in load.read_results(tmp_path).cells} == {"tiny"}


def test_options_of_probes(data: Any, tmp_path: Path) -> None:
    task = parse_task("t", FORCE)
    choice = choose_probe(task, {"epochs": 7, "lr": None})
    assert (choice.training.epochs, choice.training.lr) == (7, (1e-3,))
    assert choice.training.betas == (0.9, 0.99), "as published"
    with pytest.raises(ConfigError, match="did you mean 'epochs'"):
        choose_probe(replace(task, probe={"name": "force", "epoch": 1}), {})


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["model=[pixels]", "suite=simm"], "sim"),
        (["model=[pixels]", "task=[sim_forse]"], "did you mean 'sim_force'"),
        (["model=[anytouch3.base]", "task=[sim_force]"], "anytouch2"),
        (["task=[sim_force]"], "no model: give model="),
        (["model=[pixels]", "selection=best"], "validation or test"),
        (["model=[pixels]", 'jobz=["hydra/launcher=ray"]'], "did you mean 'jobs'"),
        (["model=[pixels]", "ablations=no_dif"], "did you mean 'no_diff'"),
        (["model=[mae]", "pretrain=miniature"], "mae is trained here, and named"),
    ],
)
def test_mistakes_on_the_command_line(
    words: list[str],
    said: str,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: Any,
    tmp_path: Path,
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(bench_run, "open_source", lambda *_: pytest.fail("data was opened"))
    assert cli.run(["bench", *words]) == 1
    err = capsys.readouterr().err
    assert err.startswith("error: ")
    assert said in err


@pytest.mark.parametrize("baselines", [[], ["pixels"]])
def test_a_model_that_is_named_twice_is_one(baselines: list[str]) -> None:
    from tactileforge_bench.verbs.bench import _beside

    assert _beside(["pixels", "hog", "pixels"], (), baselines)[:2] == ["pixels", "hog"]
    assert _beside(["pixels", "hog", "pixels"], (), baselines).count("pixels") == 1


def test_help_shows_every_key(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.run(["bench", "--help"]) == 0
    assert "selection: validation" in capsys.readouterr().out


@pytest.mark.slow
def test_on_simulated_touch(
    capsys: pytest.CaptureFixture[str], monkeypatch: Any, tmp_path: Path
) -> None:
    monkeypatch.chdir(tmp_path)
    words = [
        "suite=sim",
        "model=[untrained:anytouch2,pixels]",
        'untrained=["scale=demo","encoder.image_size=32"]',
        "task=[sim_force]",
        "sim_bench.data.scenes=3",
        "sim_bench.data.val=2",
        "sim_bench.data.size=32",
        "sim_bench.data.sensors=[digit]",
        "probe.epochs=2",
        "workers=0",
        "out=here",
        "cache=kept",
    ]
    assert cli.run(["bench", *words]) == 0
    out = capsys.readouterr().out
    assert "Force, rmse_sum_axes (mN)" in out
    loaded = load.read_results(tmp_path / "here")
    assert [(c.model, c.seed) for c in loaded.cells if c.setting["lr"] == 5e-4] == [
        (model, seed) for model in ("untrained:anytouch2", "pixels") for seed in range(3)
    ]
    assert json.loads((tmp_path / "here" / "results.json").read_text())["suite"] == "sim"
    assert (tmp_path / "here" / "report.html").stat().st_size > 10_000
    absent = ["suite=touchd", "model=[pixels]", "data_folder=nowhere", "out=absent"]
    assert cli.run(["bench", *absent]) == 3
    assert "BAAI/ToucHD-Force" in capsys.readouterr().out


def test_the_edge_of_the_rates_is_a_hint(data: Any, tmp_path: Path) -> None:
    from tactileforge_bench.output.write import write_all
    from tactileforge_bench.results.scores import collect_scores, edge_rates

    tried = {"f": FORCE | {"probe": {"name": "force", "epochs": 1, "lr": [1e-3, 1e-2, 1e-1]}}}
    bench(tmp_path, tried, seeds=1).run(tiny())
    found = load.read_results(tmp_path)

    def hints(best: float) -> list[str]:
        cells = sorted(found.cells, key=lambda cell: cell.setting["lr"] != best)
        return edge_rates(found, collect_scores(replace(found, cells=cells)))

    assert hints(1e-2) == []
    (hint,) = hints(1e-1)
    assert "rate, 0.1, is at the edge" in hint
    assert "task=[f] probe.lr=[0.001,0.01,0.1,0.4]" in hint
    assert "probe.lr=[0.00025,0.001,0.01,0.1]" in hints(1e-3)[0]
    write_all(tmp_path)
    shown = (tmp_path / "report.html").read_text()
    best = found.cells[0].setting["lr"]
    assert ("is at the edge of those tried" in shown) is (best != 1e-2)


def test_a_probe_without_gradients_does_not_train_the_encoder(data: Any, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="probe linear is not trained by gradients"):
        bench(tmp_path, {"t": HARD | {"probe": {"name": "linear", "finetune": 1e-5}}})


def test_a_label_that_no_recording_has_names_the_nearest(data: Any, tmp_path: Path) -> None:
    bench(tmp_path, {"t": HARD | {"target": "label:hardnes"}}).run(tiny())
    ((_, _, reason),) = not_run(tmp_path)
    assert "unknown label 'hardnes'; did you mean 'hardness'? Known: hardness" in reason


def test_a_suite_of_ones_own_sees_presets_of_its_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The preset is found: the error is about its missing data."""
    monkeypatch.chdir(tmp_path)
    for folder in ("suite", "data"):
        (tmp_path / "own" / folder).mkdir(parents=True)
    (tmp_path / "own/data/labset.yaml").write_text("name: recordings\nroot: nowhere\n")
    (tmp_path / "own/suite/mine.yaml").write_text(
        "# @package _global_\nsuites: {mine: Mine}\ntasks:\n  t:\n    title: T\n"
        "    data: {preset: labset}\n    target: object\n    probe: {name: ridge}\n"
        "    metrics: [accuracy]\n    split: {folds: 3}\n"
    )
    words = ["bench", "--config-dir", "own", "suite=mine", "model=[pixels]", "out=out"]
    assert cli.run(words) == 3
    (row,) = load.read_results(tmp_path / "out").not_run
    assert "nowhere" in row.reason
    assert "unknown data" not in row.reason
