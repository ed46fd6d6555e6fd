"""``tactileforge bench``."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tactileforge import settings
from tactileforge.errors import ConfigError, unknown

if TYPE_CHECKING:
    from tactileforge.bench.results.write import Writer
    from tactileforge.bench.run import Bench

#: Exit status where something was not run.
NOT_RUN = 3


def main(argv: Sequence[str]) -> int:
    """Runs the verb.

    Args:
        argv: The words after ``tactileforge bench``.

    Returns:
        0, or 3 where something could not be run; results.json and the tables say what and why.

    Raises:
        TactileForgeError: The configuration is wrong, or a split overlaps; says the fix.
    """
    if argv in (["--help"], ["-h"]):
        print(settings.text("bench"))
        return 0
    multirun = "-m" in argv or "--multirun" in argv
    hydra = [word for word in argv if word.startswith(("hydra/", "hydra.", "+hydra"))]
    ablation = [word.partition("=")[2] for word in argv if word.startswith("ablation=")]
    words = [
        word
        for word in argv
        if word not in (*hydra, "-m", "--multirun") and not word.startswith("ablation=")
    ]
    if hydra and not multirun:
        raise ConfigError(f"{hydra[0]}: only with -m, which trains models as jobs of Hydra")
    from tactileforge.compose import plain

    config = plain("bench", words)
    return _run(config, ablation[-1] if ablation else "", hydra if multirun else None)


def _run(config: dict[str, Any], ablation: str, hydra: Sequence[str] | None) -> int:
    from tactileforge.bench.fit import models, pretrain
    from tactileforge.bench.run import write_outputs

    trained = pretrain.read_models(config["pretrain"])
    if ablation:
        trained = pretrain.ablations(ablation, _ablations(), trained)
    if not config["model"] and not trained:
        raise ConfigError("no model: give model=[NAME,...]; tactileforge zoo list has names")
    suite = "+".join(config["suites"])
    folder = Path(config["out"] or Path("runs") / "bench" / suite)
    words = config["pretrain"]["words"]
    runs = pretrain.jobs(Path(config["pretrain"]["folder"] or folder / "train"), words, trained)
    folders = {name: jobs[0].folder for name, jobs in runs.items()}
    device = _device(config["device"])
    # mistakes are named before data is read, and overlaps before anything is trained
    beside = _beside(config["model"], trained, config["baselines"])
    known = [models.model_entry(word, config["untrained"], device, folders) for word in beside]
    bench = _bench(config, suite, folder, {"pretrain": " ".join(words)} if trained else {})
    pretrain.train_all([job for jobs in runs.values() for job in jobs], hydra)
    for name, model in trained.items():
        if runs[name][0].finished:
            bench.writer.training(list(pretrain.curves(name, runs[name][0].folder)))
        bench.run(pretrain.pretrained_entry(name, model, runs[name], device))
    for entry in known:
        bench.run(entry)
    bench.writer.write()
    print(write_outputs(folder))
    return _report(bench.writer)


def _bench(config: dict[str, Any], suite: str, folder: Path, facts: dict[str, str]) -> Bench:
    """Opens the data of all tasks."""
    from tactileforge.bench.fit.features import FeatureStore
    from tactileforge.bench.fit.resolve import choose_probe, result_task
    from tactileforge.bench.results.write import Writer
    from tactileforge.bench.run import Bench, BenchOptions
    from tactileforge.bench.tasks.suite import parse_task
    from tactileforge.files import cache_folder

    chosen = [parse_task(name, node) for name, node in _tasks(config).items()]
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

    if device != "auto":
        return device
    return "cuda" if torch.cuda.is_available() else "cpu"


def _report(writer: Writer) -> int:
    print(f"report: {writer.folder / 'report.html'}")
    for row in writer.results.not_run:
        where = ", ".join(filter(None, (row.task, row.model)))
        print(f"not run: {where}: {row.reason} {row.fix}".rstrip())
    return NOT_RUN if writer.results.not_run else 0


def _beside(named: Sequence[str], trained: Iterable[str], baselines: Sequence[str]) -> list[str]:
    """Models, followed by the baselines and each model with random weights."""
    if not baselines:
        return list(named)
    from tactileforge.bench.fit.baselines import BASELINES

    models = [word for word in (*trained, *named) if word not in BASELINES]
    random = [f"untrained:{word}" for word in models if not word.startswith("untrained:")]
    return list(dict.fromkeys([*named, *random, *baselines]))


def _tasks(config: dict[str, Any]) -> dict[str, Any]:
    tasks: dict[str, Any] = config["tasks"]
    wanted = config["task"] or list(tasks)
    for name in wanted:
        if name not in tasks:
            raise ConfigError(unknown("task", name, tasks))
    return {name: tasks[name] for name in wanted if tasks[name] is not None}


def _ablations() -> list[str]:
    folder = files("tactileforge.zoo") / "ablation"
    return sorted(item.name.removesuffix(".yaml") for item in folder.iterdir())
