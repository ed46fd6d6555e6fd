"""Compares encoders: tasks by models."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tactileforge.cli import Command
from tactileforge.errors import ConfigError, check_names
from tactileforge.pages import Shown

if TYPE_CHECKING:
    from tactileforge_bench.results.write import Writer
    from tactileforge_bench.run import Bench

#: Exit status where something was not run; an error is 1.
NOT_RUN = 3


@dataclass(frozen=True, kw_only=True)
class _Probe:
    """Options of all probes; None leaves those of the task.

    Attributes:
        name: Name of the probe.
        epochs: Number of epochs.
        lr: Learning rate, or several: validation chooses.
        batch: Clips per step.
        finetune: Learning rate of the encoder, if it is trained too.
        template: Sentence of a class's name for zero_shot, with {} for the name.
        text_encoder: CLIP on the model hub, or its folder, with the text tower of zero_shot.
    """

    name: str | None = None
    epochs: int | None = None
    lr: float | list[float] | None = None
    batch: int | None = None
    finetune: float | None = None
    template: str | None = None
    text_encoder: str | None = None


@dataclass(frozen=True, kw_only=True)
class _Classes:
    r"""Options of ``suite=classes``.

    Attributes:
        root: Folder of your images: root/CLASS/IMAGE, or root/train/CLASS/IMAGE beside root/val or
            root/test (or both), of which the first trains and the last tests.
        sensor: Type of sensor of the images.
        background: ``none``, or {file: background.png} of the root, an image without contact.
        images: Patterns of the images, from the folder of the classes.
        group: Fact by which images stay together in a fold: recording, or a regular expression on
            their path, 're:session(\d+)'.
        folds: Number of folds; null for five, or for the folders train and val where they are.
    """

    root: str | None = None
    sensor: str | None = None
    background: str | dict[str, str] = "none"
    images: list[str] = field(
        default_factory=lambda: [
            f"*/*.{ending}" for ending in ("png", "jpg", "jpeg", "bmp", "tif", "tiff", "webp")
        ]
    )
    group: str = "recording"
    folds: int | None = None


@dataclass(frozen=True, kw_only=True)
class _Bench:
    """Keys of ``bench``.

    Attributes:
        model: Names of the zoo, file:PATH, run:FOLDER, timm:NETWORK or timm:NETWORK:FILE (with
            tactileforge-timm), untrained:WORD (random weights in the shape of one of these, of a
            recipe, or of a model that is trained here), or a baseline without encoder: pixels,
            statistics, motion, hog, background, chance.
        task: Names of tasks of the suites; None for all.
        seeds: Number of probes per cell; they take turns over the runs of a model trained several
            times.
        selection: Split on which the best epoch is chosen: validation, or test as in some papers
            (every table says so).
        probe: Options of all probes.
        classes: Your own folders of images, for suite=classes.
        untrained: Overrides with which a recipe is composed for untrained:RECIPE.
        ablations: Parts left out of the first model, one training each; ``all``, or some names.
        jobs: Words for Hydra, to run the trainings as its jobs, in two pairs of quotes:
            'jobs=["hydra/launcher=ray"]'; None trains one after another.
        out: Folder of the results; None for runs/bench/SUITE. A stopped bench resumes there.
        cache: Folder of the features; None for $TACTILEFORGE_CACHE, or the user's cache.
        batch: Clips encoded at once.
        workers: Number of processes reading clips.
        device: Torch device; ``auto`` for an accelerator, if there is one.
        baselines: Baselines measured beside every model, and compared with it as the release gate
            does (suites real and real_held_out).
        suites: Titles of the suites, by name; suite=NAME gives them.
        tasks: Tasks of the suites, by name; suite=NAME gives them.
        runner: Plugin of a package that runs the suite in place of probes; suite=NAME gives it,
            with options of its own.
    """

    model: list[str] | str = field(default_factory=list)
    task: list[str] | str | None = None
    seeds: int = 3
    selection: str = "validation"
    probe: _Probe = field(default_factory=_Probe)
    classes: _Classes = field(default_factory=_Classes)
    untrained: list[str] = field(default_factory=list)
    ablations: list[str] | str | None = None
    jobs: list[str] | None = None
    out: str | None = None
    cache: str | None = None
    batch: int = 32
    workers: int = 2
    device: str = "auto"
    baselines: list[str] = field(default_factory=list)
    suites: dict[str, str] = field(default_factory=dict)
    tasks: dict[str, Any] = field(default_factory=dict)
    runner: str | None = None


def _bench(_: _Bench, config: dict[str, Any]) -> int | Shown:
    """Compares encoders on the tasks of a suite (docs/bench.md)."""
    for key in ("model", "task"):
        config[key] = [config[key]] if isinstance(config[key], str) else config[key]
    if config["runner"]:
        return _run_by(config["runner"], config)
    from tactileforge_bench.fit import models, pretrain
    from tactileforge_bench.run import write_outputs

    trained = pretrain.read_models(config["pretrain"])
    if config["ablations"]:
        chosen = config["ablations"]
        words = chosen if isinstance(chosen, str) else ",".join(chosen)
        known_parts = (files("tactileforge.zoo") / "ablation").iterdir()
        parts = sorted(item.name.removesuffix(".yaml") for item in known_parts)
        trained = pretrain.ablations(words, parts, trained)
    if not config["model"] and not trained:
        raise ConfigError("no model: give model=[NAME,...]; tactileforge zoo list has names")
    suite = "+".join(config["suites"]) or "own"  # tasks given by hand have no title
    folder = Path(config["out"] or Path("runs") / "bench" / suite)
    words = config["pretrain"]["words"]
    runs = pretrain.jobs(Path(config["pretrain"]["folder"] or folder / "train"), words, trained)
    folders = {name: jobs[0].folder for name, jobs in runs.items()}
    device = _device(config["device"])
    # mistakes are reported before data is read, and overlaps before anything is trained
    beside = _beside(config["model"], trained, config["baselines"])
    known = [models.model_entry(word, config["untrained"], device, folders) for word in beside]
    bench = _opened(config, suite, folder, {"pretrain": " ".join(words)} if trained else {})
    pretrain.train_all([job for jobs in runs.values() for job in jobs], config["jobs"])
    for name, model in trained.items():
        if runs[name][0].finished:
            bench.writer.training(list(pretrain.curves(name, runs[name][0].folder)))
        bench.run(pretrain.pretrained_entry(name, model, runs[name], device))
    for entry in known:
        bench.run(entry)
    bench.writer.write()
    print(write_outputs(folder))
    return _report(bench.writer)


def _run_by(runner: str, config: dict[str, Any]) -> int:
    """Runs a suite with the runner of a package and returns the exit status."""
    from tactileforge.plugins import registry

    failed: list[str] = registry.load("runners", runner)(config)
    for line in failed:
        print(f"not run: {line}")
    return NOT_RUN if failed else 0


def _opened(config: dict[str, Any], suite: str, folder: Path, facts: dict[str, str]) -> Bench:
    """Opens the data of all tasks."""
    from tactileforge.plugins import cache_folder
    from tactileforge_bench.fit.features import FeatureStore
    from tactileforge_bench.fit.resolve import choose_probe, result_task
    from tactileforge_bench.results.write import Writer
    from tactileforge_bench.run import Bench, BenchOptions
    from tactileforge_bench.tasks.class_folders import class_task
    from tactileforge_bench.tasks.suite import parse_task

    tasks: dict[str, Any] = config["tasks"]
    wanted = config["task"] or list(tasks)
    check_names("task", wanted, tasks)
    if "classes" in config["suites"]:
        tasks["classes"] = class_task(tasks["classes"], config["classes"])
    elif given := config["classes"]["root"]:
        raise ConfigError(f"classes.root={given} goes with suite=classes: give that too")
    # a suite of the user's own drops a task by null
    chosen = [parse_task(name, tasks[name]) for name in wanted if tasks[name] is not None]
    options = BenchOptions(
        seeds=config["seeds"], selection=config["selection"], probe=config["probe"]
    )
    rows = [
        result_task(task, choose_probe(task, options.probe), options.selection) for task in chosen
    ]
    settings = {"seeds": options.seeds, "selection": options.selection, **facts}
    settings |= {f"probe.{k}": v for k, v in config["probe"].items() if v is not None}
    writer = Writer(folder, suite, settings, rows)
    store = FeatureStore(
        cache_folder(config["cache"]) / "features", config["workers"], config["batch"]
    )
    return Bench(chosen, store, writer, options)


def _device(device: str) -> str:
    import torch

    from tactileforge.hub import check_device

    if device != "auto":
        return str(check_device(device))
    return "cuda" if torch.cuda.is_available() else "cpu"


def _report(writer: Writer) -> Shown:
    from tactileforge_bench.results.scores import collect_scores, edge_rates, main_score

    print(f"report: {writer.folder / 'report.html'}")
    for head in sorted((writer.folder / "heads").glob("*")):
        print(f"head for model.classify: {head}")
    for note in writer.notes:
        print(f"note: {note}")
    for hint in edge_rates(writer.results, collect_scores(writer.results)):
        print(f"hint: {hint}")
    for row in writer.results.not_run:
        where = ", ".join(filter(None, (row.task, row.model)))
        print(f"not run: {where}: {row.reason} {row.fix}".rstrip())
    scores = collect_scores(writer.results)
    rows = []
    for task in writer.results.tasks:
        for model in writer.results.models:
            if score := main_score(scores, task, model):
                interval = score.interval()
                rows.append(
                    {
                        "task": task.name,
                        "model": model.name,
                        "metric": task.main,
                        "value": interval.mean if interval else float("nan"),
                    }
                )
    status = NOT_RUN if writer.results.not_run else 0
    return Shown(writer.folder, writer.folder / "report.html", rows, writer.results, status)


def _beside(named: Sequence[str], trained: Iterable[str], baselines: Sequence[str]) -> list[str]:
    """Models, each once, followed by the baselines and each model with random weights.

    Raises:
        ConfigError: A model trained here has the same name as another one.
    """
    words = list(named)
    if baselines:
        from tactileforge_bench.fit.baselines import BASELINES

        models = [word for word in (*trained, *named) if word not in BASELINES]
        random = [f"untrained:{word}" for word in models if not word.startswith("untrained:")]
        words += [*random, *baselines]
    if twice := sorted(set(trained) & set(words)):
        raise ConfigError(
            f"model {twice[0]} is trained here, and named in model= or baselines=: leave it out "
            "there, or rename it in pretrain.models"
        )
    return list(dict.fromkeys(words))


COMMANDS = {
    "": Command(
        run=_bench,
        keys=_Bench,
        groups={"suite": "sim", "pretrain": "none"},
        groups_last=True,
        open="runner",
        writes=lambda keys: keys.out or "runs/bench",
        into=True,
        cache=True,
    )
}
