"""The Lightning trainer of a run, and mistakes in what it is given."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from importlib.util import find_spec
from inspect import signature
from pathlib import Path
from typing import Any

import lightning as L
import torch
from lightning.pytorch.callbacks import Callback, Timer

from tactileforge import strict
from tactileforge.callbacks import checkpoints
from tactileforge.callbacks.progress import Progress
from tactileforge.callbacks.speed import Speed
from tactileforge.distributed import count_processes
from tactileforge.errors import ConfigError, unknown
from tactileforge.loggers import build_loggers
from tactileforge.optim import OptimOptions
from tactileforge.parts import check_size
from tactileforge.strategies import check_started, choose_strategy

#: Packages that a logger needs one of.
_LOGGERS = {"csv": (), "tensorboard": ("tensorboard", "tensorboardX"), "wandb": ("wandb",)}
_LOGGERS |= {"mlflow": ("mlflow",)}


def check_options(config: Mapping[str, Any]) -> None:
    """Names a mistake in ``optim``, ``trainer`` or ``logger`` before data is made or read.

    Args:
        config: Finished; see `compose.finish`.

    Raises:
        ConfigError: See there.
    """
    strict.build(OptimOptions, "optim", config["optim"])
    check_size(config["encoder"])
    check_started(config["trainer"]["devices"])
    known = {*signature(L.Trainer).parameters, "save_every", "keep_best"}
    for key, value in config["trainer"].items():
        if key not in known:
            raise ConfigError(unknown("key of trainer", key, known))
        whole = key.startswith(("max_", "save_", "log_every", "accumulate", "num_nodes"))
        if whole and not (value is None or isinstance(value, int)):
            raise ConfigError(f"trainer.{key}={value}: give a whole number")
    name = config["logger"]["name"]
    if name not in _LOGGERS:
        raise ConfigError(f"unknown logger {name!r}: csv, tensorboard, wandb or mlflow")
    if _LOGGERS[name] and not any(find_spec(package) for package in _LOGGERS[name]):
        raise ConfigError(f"logger={name} is not installed: pip install 'tactileforge[{name}]'")


def build_trainer(
    config: Mapping[str, Any],
    folder: Path,
    callbacks: Sequence[Callback] = (),
    step: int = 0,
    static: bool = False,
) -> tuple[L.Trainer, checkpoints.Checkpoints]:
    """The Lightning trainer of a run, with further callbacks; and that of its checkpoints.

    Args:
        config: Finished.
        folder: Folder of the run.
        callbacks: In addition.
        step: Step from which the run goes on.
        static: Whether the encoder uses the same parameters for every batch.
    """
    options = dict(config["trainer"])
    saver = checkpoints.Checkpoints(folder, options.pop("save_every"))
    best = checkpoints.best_checkpoint(folder, options.pop("keep_best", None))
    kept = [*best, *callbacks]
    options["strategy"] = choose_strategy(
        options["strategy"],
        count_processes(options),
        static and options["accumulate_grad_batches"] == 1,  # torch cannot have both
        (config.get("balance") or {}).get("name"),
    )
    own: dict[str, Any] = dict(
        default_root_dir=folder,
        logger=build_loggers(config["logger"], folder, config.get("run"), step),
        # the timer is for the report: how long it took
        callbacks=[saver, Speed(config["batch"]["workers"]), Progress(), Timer(), *kept],
        plugins=[checkpoints.AtomicCheckpointIO(config.get("run"))],
        gradient_clip_val=config["optim"].get("clip"),
        use_distributed_sampler=False,
        enable_checkpointing=bool(best),
        enable_model_summary=False,
        enable_progress_bar=False,
        num_sanity_val_steps=0,
        deterministic=True if not torch.cuda.is_available() else "warn",
    )
    try:
        return L.Trainer(**options, **own), saver
    except (TypeError, ValueError) as error:  # also what Lightning itself raises for them
        raise ConfigError(f"trainer: {error}") from error
