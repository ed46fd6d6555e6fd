"""The Lightning trainer of a run, and checks of its options."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from importlib.util import find_spec
from inspect import signature
from pathlib import Path
from typing import Any

import lightning as L
import torch
from lightning.fabric.utilities.exceptions import MisconfigurationException
from lightning.pytorch.callbacks import Callback, ModelCheckpoint, Timer

from tactileforge.errors import ConfigError, check_names, unknown
from tactileforge.plugins import registry
from tactileforge.runs.folder import BEST
from tactileforge.training import checkpoints, curriculum
from tactileforge.training.assemble import check_blocks
from tactileforge.training.callbacks import TOTAL, build_callbacks
from tactileforge.training.loggers import build_loggers, own_logger
from tactileforge.training.optim import check_optim, parse_optim
from tactileforge.training.parts import check_arguments, check_values
from tactileforge.training.probe import Probe
from tactileforge.training.progress import Progress
from tactileforge.training.speed import Speed
from tactileforge.training.strategies import check_started, choose_strategy
from tactileforge.training.validation import LastValidation
from tactileforge.util.distributed import count_processes
from tactileforge.util.origin import install_extra

#: Packages of each logger; it needs one of them.
_LOGGERS = {"csv": (), "tensorboard": ("tensorboard", "tensorboardX"), "wandb": ("wandb",)}
_LOGGERS |= {"mlflow": ("mlflow",)}

#: Arguments of Lightning's trainer that a run sets itself, and what to give instead.
_ELSEWHERE = {
    "barebones": "a run logs and saves",
    "callbacks": "give callbacks=[early_stopping,my_module:Callback]",
    "default_root_dir": "give hydra.run.dir=",
    "enable_checkpointing": "every trainer.save_every= steps are saved, and the best by keep_best=",
    "enable_progress_bar": "`2>/dev/null` hides it",
    "fast_dev_run": "give debug=steps",
    "gradient_clip_val": "give optim.clip=",
    "limit_predict_batches": "a run predicts nothing",
    "limit_test_batches": "a run tests nothing; trainer.limit_val_batches= is of its validation",
    "logger": "give logger=",
    "overfit_batches": "give debug=overfit",
    "plugins": "checkpoints are sealed by one of our own",
    "reload_dataloaders_every_n_epochs": "a batch is a function of its number",
    "use_distributed_sampler": "the stream of batches gives each process its rows",
}

#: Keys of ``trainer``.
_TRAINER = frozenset({*signature(L.Trainer).parameters, "save_every", "keep_best"})
#: Smallest value of the trainer's whole-number options, by the start of their names.
_LEAST = {"max_": -1, "min_": 0, "save_": 1, "log_every": 1, "accumulate": 1, "num_nodes": 1}
_LEAST |= {"check_val": 1}


def check_keys(config: Mapping[str, Any]) -> None:
    """Checks the keys of a run's own blocks, but no values.

    Args:
        config: Finished configuration; values may be missing, or interpolations.

    Raises:
        ConfigError: Nothing reads a key; names the nearest.
        PluginError: An encoder, data set or optimiser is not installed.
    """
    check_names("key of trainer", config["trainer"], _TRAINER)
    check_blocks(config["batch"], config.get("augment") or {})
    check_names("key in curriculum", config["curriculum"], curriculum.KEYS)
    registry.chosen("encoders", config["encoder"])
    data = {key: value for key, value in config["data"].items() if key != "max_bad"}
    registry.chosen("datasets", data)
    check_optim(config["optim"])


def check_options(config: Mapping[str, Any]) -> None:
    """Checks ``optim``, ``trainer``, ``logger`` and encoder before data is made or read.

    Args:
        config: Finished configuration; see `compose.finish`.

    Raises:
        ConfigError: A key or value is invalid, or the package of the logger is not installed.
    """
    parse_optim(config["optim"])
    check_arguments(config)
    check_values(config)
    check_started(config["trainer"]["devices"])
    for key in _ELSEWHERE.keys() & config["trainer"].keys():
        raise ConfigError(f"trainer.{key} is set by the run: {_ELSEWHERE[key]}")
    check_names("key of trainer", config["trainer"], _TRAINER)
    _timer(config["trainer"].get("max_time"))
    callbacks = build_callbacks(config.get("callbacks"))
    for key, value in config["trainer"].items():
        _check_whole(key, value)
    interval = config["trainer"].get("val_check_interval")
    if isinstance(interval, int | float) and not interval > 0:
        raise ConfigError(
            f"trainer.val_check_interval={interval}: give steps, 1 or more, or a share of the "
            "epoch, up to 1.0; the end is always validated, but for trainer.limit_val_batches=0"
        )
    _check_length(config["trainer"])
    _check_monitors(config, callbacks)
    name = config["logger"]["name"]
    if name not in _LOGGERS:
        own_logger(config["logger"])
    elif _LOGGERS[name] and not any(find_spec(package) for package in _LOGGERS[name]):
        raise ConfigError(f"logger={name} is not installed: {install_extra(name)}")


class JobTimer(Timer):
    """Time of a run over all its jobs; ends a job after ``trainer.max_time``.

    Lightning's counts earlier jobs towards the limit: a run resumed by the next job of a cluster
    would end at once.
    """

    def load_state_dict(self, state_dict: dict[str, Any]) -> None:
        """Restores the time of earlier jobs, and gives this one the whole limit."""
        super().load_state_dict(state_dict)
        if self._duration is not None:
            self._duration += self.time_elapsed()


def is_time_over(trainer: L.Trainer) -> bool:
    """Whether ``trainer.max_time`` has ended this job."""
    timers = [one for one in trainer.callbacks if isinstance(one, JobTimer)]  # type: ignore[attr-defined]
    left = [one.time_remaining() for one in timers]
    return any(one is not None and one <= 0 for one in left)


def _timer(longest: Any) -> JobTimer:
    """The timer of a run; the report reads it too."""
    try:
        return JobTimer(longest)
    except (TypeError, ValueError, MisconfigurationException) as error:
        raise ConfigError(
            f"trainer.max_time={longest}: give days, hours, minutes and seconds, as in "
            "trainer.max_time='00:23:30:00'"
        ) from error


def _check_whole(key: str, value: Any) -> None:
    least = next((low for start, low in _LEAST.items() if key.startswith(start)), None)
    optional = key not in ("save_every", "accumulate_grad_batches", "num_nodes", "max_steps")
    if least is None or key == "max_time" or key == "min_time" or (value is None and optional):
        return
    if not isinstance(value, int) or isinstance(value, bool) or value < least:
        said = "-1 for any" if least < 0 else f"{least} or more"
        raise ConfigError(f"trainer.{key}={value}: give a whole number, {said}")


def _check_length(options: Mapping[str, Any]) -> None:
    if options.get("max_steps", -1) == -1 and options.get("max_epochs") == -1:
        raise ConfigError(
            "trainer.max_steps=-1 trainer.max_epochs=-1: the curriculum and the learning rate need "
            "the length of the run; give one of the two"
        )
    limit, steps = options.get("limit_train_batches"), options.get("accumulate_grad_batches", 1)
    if isinstance(limit, int) and limit % steps:
        raise ConfigError(
            f"trainer.limit_train_batches={limit} trainer.accumulate_grad_batches={steps}: the "
            "last step of an epoch would have fewer batches, and a resumed run could not tell; "
            f"give a multiple of {steps}"
        )


def _check_monitors(config: Mapping[str, Any], callbacks: Mapping[str, Callback]) -> None:
    """Refuses to keep, minimise or monitor an unlogged number."""
    ours = ("tactileforge.", "lightning.")
    if not all(type(one).__module__.startswith(ours) for one in callbacks.values()):
        return  # a callback of the user's own may log any name
    validated = [TOTAL, *(f"val/{key}" for key in config["objective"])]
    validated += [f"val/probe_{one.target}" for one in callbacks.values() if isinstance(one, Probe)]
    trained = [f"train/{key}" for key in (*config["objective"], "loss")]
    _check_metric("trainer.keep_best", config["trainer"].get("keep_best"), validated)
    _check_metric("optimized_metric", config.get("optimized_metric"), [*validated, *trained])
    also = [f"{of}/{key}" for of in ("weight", "gradient") for key in config["objective"]]
    also += ["universal", "lr", "epoch", "step", "speed/clips_per_s", "speed/waiting"]
    for key, one in callbacks.items():
        monitor = getattr(one, "monitor", None)
        if monitor not in also and "." not in str(monitor):  # a dot: changed by the curriculum
            _check_metric(f"callbacks.{key}.monitor", monitor, [*validated, *trained])


def _check_metric(key: str, metric: Any, known: Sequence[str]) -> None:
    """Refuses a metric not logged by any run.

    Args:
        key: Option with the name of the metric.
        metric: Name of the metric, or None.
        known: Valid names, and valid starts before a further slash.
    """
    if metric is not None and "/".join(str(metric).split("/")[:2]) not in known:
        raise ConfigError(unknown(key, str(metric), known))


def build_trainer(
    config: Mapping[str, Any],
    folder: Path,
    callbacks: Sequence[Callback] = (),
    step: int = 0,
    static: bool = False,
) -> tuple[L.Trainer, checkpoints.Checkpoints]:
    """Builds the Lightning trainer of a run, and the callback of its checkpoints.

    Args:
        config: Finished configuration.
        folder: Folder of the run.
        callbacks: Further callbacks.
        step: Optimiser steps taken before; 0 for a new run.
        static: Whether the encoder uses the same parameters for every batch.
    """
    options = dict(config["trainer"])
    saver = checkpoints.Checkpoints(folder, options.pop("save_every"))
    best = checkpoints.best_checkpoint(folder, options.pop("keep_best", None))
    kept = [*best, *callbacks, *build_callbacks(config.get("callbacks")).values()]
    timer = _timer(options.pop("max_time", None))
    keepers = [one for one in kept if isinstance(one, ModelCheckpoint)]
    for one in keepers:  # Lightning's own place for it is below the first logger's file
        one.dirpath = one.dirpath or str(folder / BEST.parent)
    options["limit_train_batches"] = 1.0  # the data applies it, see `assemble.limit_of`
    options["strategy"] = choose_strategy(
        options["strategy"],
        count_processes(options),
        static and options["accumulate_grad_batches"] == 1,  # torch cannot combine the two
        (config.get("balance") or {}).get("name"),
    )
    own: dict[str, Any] = dict(
        default_root_dir=folder,
        logger=build_loggers(config["logger"], folder, config.get("run"), step),
        callbacks=[
            saver,
            Speed(config["batch"]["workers"]),
            Progress(),
            timer,
            LastValidation(),
            *kept,
        ],
        plugins=[checkpoints.AtomicCheckpointIO(config.get("run"))],
        gradient_clip_val=config["optim"].get("clip"),
        # the stream of batches gives each process its own rows
        use_distributed_sampler=False,
        enable_checkpointing=bool(keepers),
        # `Progress` has a bar for terminals and lines for files
        enable_progress_bar=False,
    )
    usual: dict[str, Any] = dict(
        enable_model_summary=False,
        num_sanity_val_steps=0,
        # on a GPU some kernels have no deterministic version
        deterministic=True if not torch.cuda.is_available() else "warn",
    )
    try:
        return L.Trainer(**{**usual, **options, **own}), saver
    except (TypeError, ValueError, MisconfigurationException) as error:
        raise ConfigError(f"trainer: {error}") from error
