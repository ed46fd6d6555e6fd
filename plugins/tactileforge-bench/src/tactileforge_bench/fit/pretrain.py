"""Pretraining for a benchmark: each run in its own process, skipped once finished."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

from omegaconf import DictConfig

from tactileforge.errors import ConfigError, TactileForgeError, check_names, command
from tactileforge.plugins import run_program, strict, write_text
from tactileforge.runs import LAST
from tactileforge_bench.fit.frozen_encoder import FrozenEncoder
from tactileforge_bench.fit.models import ModelEntry, encoder_of_run
from tactileforge_bench.results.results import LossCurve

#: Written before a run starts: what it is trained with.
_WORDS = "bench.json"
#: Written where a run failed: why.
_FAILED = "failed.txt"


@dataclass(frozen=True, kw_only=True)
class PretrainModel:
    """A model to train.

    Attributes:
        title: Name in print.
        recipe: Name of a recipe of the zoo.
        words: Overrides of ``tactileforge train``.
        seeds: Seeds, one run each.
        group: ``model`` or ``ablation``.
    """

    title: str
    recipe: str = "anytouch2"
    words: list[str] = field(default_factory=list)
    seeds: list[int] = field(default_factory=lambda: [0])
    group: str = "model"


@dataclass(frozen=True)
class PretrainJob:
    """One run of ``tactileforge train``.

    Attributes:
        name: Model and seed.
        folder: Folder of the run.
        words: Overrides of ``tactileforge train``.
    """

    name: str
    folder: Path
    words: Sequence[str]

    @property
    def finished(self) -> bool:
        """Whether training is complete; the report is written last."""
        return (self.folder / "report.html").is_file() and self.has_checkpoint

    @property
    def has_checkpoint(self) -> bool:
        """Whether it can be resumed."""
        return (self.folder / LAST).is_file()

    @property
    def failed(self) -> str:
        """The error of a failed run; "" if it did not fail."""
        path = self.folder / _FAILED
        return path.read_text("utf-8") if path.is_file() else ""


def read_models(config: Mapping[str, Any]) -> dict[str, PretrainModel]:
    """The models of a configuration; its ``seeds`` are those of models that name none.

    Raises:
        ConfigError: A key is unknown or of another type.
    """
    seeds = {"seeds": config["seeds"]} if "seeds" in config else {}
    models = {}
    for name, node in (config.get("models") or {}).items():
        if node is not None:
            where = f"pretrain.models.{name}"
            given = seeds | strict.mapping(where, node)
            models[name] = strict.build(PretrainModel, where, given)
    return models


def ablations(
    wanted: str, known: Sequence[str], models: Mapping[str, PretrainModel]
) -> dict[str, PretrainModel]:
    """The first model, and one for each ablation of it.

    Args:
        wanted: ``all``, or names with commas between them.
        known: Names in zoo/ablation.
        models: Models listed so far; if empty, ``anytouch2`` is trained.

    Raises:
        ConfigError: An unknown ablation.
    """
    name, base = next(iter(models.items()), ("anytouch2", PretrainModel(title="AnyTouch 2")))
    chosen = (
        [ablation for ablation in known if ablation != "none"]
        if wanted == "all"
        else wanted.split(",")
    )
    check_names("ablation", chosen, known)
    return {name: base, **models} | {
        # one that the configuration spells out wins
        ablation: models.get(ablation)
        or PretrainModel(
            title=ablation.replace("_", " "),
            recipe=base.recipe,
            words=[*base.words, f"ablation={ablation}"],
            seeds=base.seeds,
            group="ablation",
        )
        for ablation in chosen
    }


def jobs(
    folder: Path, words: Sequence[str], models: Mapping[str, PretrainModel]
) -> dict[str, list[PretrainJob]]:
    """The runs of each model."""
    return {
        name: [
            PretrainJob(
                f"{name}-{seed}",
                folder / f"{name}-{seed}",
                [f"recipe={model.recipe}", *words, *model.words, f"seed={seed}"],
            )
            for seed in model.seeds
        ]
        for name, model in models.items()
    }


def pretrain(job: PretrainJob) -> None:
    """Trains a run to its end; skips a finished run and resumes an interrupted one.

    A run that fails leaves its last words in its folder, see `PretrainJob.failed`.

    Raises:
        ConfigError: The folder holds a run of other settings.
        KeyboardInterrupt: It was stopped; the same call goes on with it.
    """
    # first: a finished run of other settings is not taken for this one
    _claim(job)
    if job.finished:
        return
    # what failed before is tried again, from its last checkpoint if there is one
    (job.folder / _FAILED).unlink(missing_ok=True)
    words = [f"resume={job.folder}"]
    if not job.has_checkpoint:
        words = [*job.words, f"hydra.run.dir={job.folder}"]
    print(command("train", *words), flush=True)
    status, output = run_program([sys.executable, "-m", "tactileforge", "train", *words])
    # 128 + SIGINT: stopped by the user, which is no failure to be noted
    if status == 130:
        raise KeyboardInterrupt(f"stopped in {job.folder}")
    if status:
        # what the command line prints last, before it ends
        reason = output.strip().rpartition("error: ")[2] or f"exit status {status}"
        write_text(job.folder / _FAILED, " ".join(reason.split()))


def _claim(job: PretrainJob) -> None:
    path = job.folder / _WORDS
    if not path.is_file():
        write_text(path, json.dumps({"words": list(job.words)}, indent=2))
        return
    before = json.loads(path.read_text("utf-8"))["words"]
    if before != list(job.words):
        raise ConfigError(
            f"{job.folder} holds a run of other settings ({' '.join(before)}); remove it, or give "
            "another folder (out=, pretrain.folder=)"
        )


def train_all(runs: Sequence[PretrainJob], hydra: Sequence[str] | None) -> None:
    """Trains runs one after another, or as jobs of Hydra.

    Args:
        runs: Runs to train.
        hydra: Words for Hydra, e.g. ``hydra/launcher=ray``, whose launcher then spreads the jobs
            and has to see their folders; None without it.
    """
    for job in runs if hydra is None else ():
        pretrain(job)
    if hydra is not None and runs:
        _launch(runs[0].folder.parent, runs, hydra)


def _launch(folder: Path, runs: Sequence[PretrainJob], words: Sequence[str]) -> None:
    import hydra
    from hydra.core.global_hydra import GlobalHydra

    GlobalHydra.instance().clear()  # the bench itself may be composed by it
    listed = folder / "jobs.json"
    rows = {job.name: [str(job.folder.resolve()), list(job.words)] for job in runs}
    write_text(listed, json.dumps(rows, indent=2))
    command = sys.argv
    names = ",".join(rows)
    # hydra.main takes its words from sys.argv alone
    sys.argv = ["tactileforge", "-m", f"job={names}", f"jobs={listed.resolve()}", *words]
    sys.argv.append(f"hydra.sweep.dir={folder.resolve()}/hydra")
    try:
        hydra.main(version_base="1.3", config_path="pkg://tactileforge.conf", config_name="job")(
            run_job
        )()
    finally:
        sys.argv = command


def run_job(config: DictConfig) -> None:
    """Trains one run of the list, as a job of Hydra."""
    rows = json.loads(Path(config.jobs).read_text("utf-8"))
    folder, words = rows[config.job]
    pretrain(PretrainJob(config.job, Path(folder), words))


def pretrained_entry(
    name: str, model: PretrainModel, runs: Sequence[PretrainJob], device: str
) -> ModelEntry:
    """A trained model as a row of the tables; opening it reports a failed run."""
    return ModelEntry(
        name=name,
        title=model.title,
        open=[partial(_open, name, job, device) for job in runs],
        group=model.group,
        recipe=model.recipe,
        folders=[job.folder for job in runs],
    )


def _open(name: str, job: PretrainJob, device: str) -> FrozenEncoder:
    if not job.finished:
        raise TactileForgeError(f"training {job.name} failed: {job.failed or f'see {job.folder}'}")
    return encoder_of_run(name, job.folder, device)


def curves(name: str, folder: Path) -> Iterator[LossCurve]:
    """Loss curves of a run, one for each objective."""
    from tactileforge.pages import read_metrics

    metrics = read_metrics(folder)
    for key, curve in metrics.items():
        kind, _, objective = key.partition("/")
        # further scalars of an objective have a second slash
        if kind != "train" or "/" in objective:
            continue
        thin = curve.thinned()
        held_out = metrics.get(f"val/{objective}")
        points = dict(zip(thin.steps.tolist(), thin.values.tolist(), strict=True))
        others = {}
        if held_out is not None:
            others = dict(zip(held_out.steps.tolist(), held_out.values.tolist(), strict=True))
        steps = sorted({*points, *others})
        nan = float("nan")
        yield LossCurve(
            model=name,
            objective=objective,
            step=[float(step) for step in steps],
            train=[points.get(step, nan) for step in steps],
            validation=[others.get(step, nan) for step in steps] if others else [],
        )
