"""Training by Lightning; a run with an early end raises an error with its fix."""

from __future__ import annotations

import re
import shlex
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import lightning as L
import torch.distributed as dist
from lightning.fabric.utilities.exceptions import MisconfigurationException

from tactileforge.data.batches.datamodule import TouchData
from tactileforge.errors import ConfigError, TactileForgeError
from tactileforge.runs import folder as run_folder
from tactileforge.runs.checkpoint_file import read_checkpoint
from tactileforge.training.callbacks import check_monitored
from tactileforge.training.checkpoints import Checkpoints
from tactileforge.training.finite import NotFiniteError
from tactileforge.training.loggers import CannotLogError
from tactileforge.training.module import TouchModule
from tactileforge.util.files import unwritable

#: Errors of torch after the loss of a process of the group; of gloo it raises plain
#: RuntimeErrors, with nothing but the words of the system.
_OF_GROUP = (dist.DistBackendError, dist.DistNetworkError, dist.DistStoreError)
_OF_GLOO = re.compile(r"closed by peer|reset by peer|Connection refused|Broken pipe", re.I)

#: Warnings of Lightning about intended behaviour.
_EXPECTED = (
    r".*isinstance\(treespec, LeafSpec\).*",
    r"Found \d+ module\(s\) in eval mode at the start of training.*",  # frozen towers, EMA copies
    r"The number of training batches .* is smaller than the logging interval.*",
    r"The '\w+_dataloader' does not have many workers.*",
    r"Total length of `list` across ranks is zero.*",  # nothing is held out: the run itself says so
    r"It is recommended to use `self.log\('val/.*",  # values are those of all processes already
    r"Checkpoint directory .* exists and is not empty.*",  # a resumed run
    r"You're using the WeightAveraging callback with a model that overrides.*",  # to shard
)


def fit(
    trainer: L.Trainer,
    module: TouchModule,
    data: TouchData,
    saver: Checkpoints,
    folder: Path,
    resume: Path | None,
    step: int,
) -> None:
    """Trains to the end of the run.

    Args:
        trainer: Lightning's trainer.
        module: Module to train.
        data: Data of the run.
        saver: Callback of ``trainer`` that saves checkpoints.
        folder: Folder of the run.
        resume: Checkpoint to resume from; None for a new run.
        step: Optimiser steps taken before; 0 for a new run.

    Raises:
        NotFiniteError: A number is not finite; states the way back.
        TactileForgeError: Another process of the run has died, or a logger or the disk cannot be
            written.
        ConfigError: The checkpoint does not fit the run, an interval its length, or a callback
            monitors what is not logged.
        KeyboardInterrupt: The run was stopped, and saved if a step was done.
    """
    with warnings.catch_warnings():
        for message in _EXPECTED:
            warnings.filterwarnings("ignore", message)
        try:
            with _resumed_from(resume, saver):
                trainer.fit(module, data, ckpt_path=resume, weights_only=True)
        except NotFiniteError as error:
            way = _way_back(folder, trainer.precision, trainer.global_step == 0)
            raise NotFiniteError(f"{error}. {way}") from error
        except OSError as error:
            check_cannot_write(error, folder)
            raise
        except MisconfigurationException as error:
            check_monitored(trainer, error)
            raise
        except RuntimeError as error:
            check_monitored(trainer, error)
            if trainer.world_size == 1 or not _is_of_group(error):
                raise
            first = str(error).splitlines()[0][:120]
            raise TactileForgeError(
                f"another process of the run has died ({first}). {_kept(folder)}"
            ) from error
        except SystemExit as stop:  # Lightning turns Ctrl-C into it
            done = trainer.global_step
            when = f"in the step after {done}" if done > step else "before the first step"
            raise KeyboardInterrupt(f"{stop.__context__ or 'stopped'} {when}") from stop
        except ValueError as error:
            # the interval is longer than an epoch: Lightning learns the epoch's length only here
            interval, batches = trainer.val_check_interval, trainer.num_training_batches
            if saver.started or not isinstance(interval, int) or interval <= batches:
                raise
            raise ConfigError(
                f"trainer.val_check_interval={interval}: an epoch has {batches} batches; give at "
                "most so many, or trainer.check_val_every_n_epoch=null to count over epochs"
            ) from error
    if saver.interrupted:
        raise KeyboardInterrupt(f"stopped at step {trainer.global_step}")


def _is_of_group(error: RuntimeError) -> bool:
    """Whether an error says that another process of the group is gone."""
    return isinstance(error, _OF_GROUP) or _OF_GLOO.search(str(error)) is not None


def check_cannot_write(error: OSError, folder: Path) -> None:
    """Raises an error about a logger or a disk again, with the way on.

    Raises:
        TactileForgeError: A logger cannot write, or the disk is full or read-only.
    """
    why = str(error) if isinstance(error, CannotLogError) else unwritable(error)
    if why:
        raise TactileForgeError(f"{why}. {_kept(folder)}") from error


def _kept(folder: Path) -> str:
    """Advice on how to continue an interrupted run."""
    if not (folder / run_folder.LAST).is_file():
        return "Nothing was saved before: give the same command again"
    return f"Go on from its checkpoint: tactileforge train resume={shlex.quote(str(folder))}"


def _way_back(folder: Path, numbers: str, at_once: bool) -> str:
    """Advice on the last checkpoint of a run with non-finite numbers, with its commands.

    Args:
        folder: Folder of the run.
        numbers: Precision of the run.
        at_once: Whether no step was done, so that no learning rate is the cause.
    """
    exact = "" if numbers.startswith("32") else " trainer.precision=32"
    if at_once and numbers.startswith("32"):
        return (
            "No step was done, so no learning rate is the cause: encoder, objective or data give "
            "such numbers by themselves; tactileforge plugins check NAME looks at a plugin, "
            "tactileforge data check at the data"
        )
    if not (folder / run_folder.LAST).is_file():
        also = f" or{exact}" if exact else ""
        return f"Nothing was saved before: start again with a smaller optim.lr={also}"
    step = read_checkpoint(folder)["global_step"]
    name = shlex.quote(str(folder))
    return (
        f"The checkpoint of step {step} stays: go back to it with tactileforge train resume={name}"
        f"{exact}, or start from it with init={name} and a smaller optim.lr="
    )


@contextmanager
def _resumed_from(resume: Path | None, saver: Checkpoints) -> Iterator[None]:
    """Names the checkpoint in errors about its content, before the first resumed step."""
    try:
        yield
    except (KeyError, TypeError, ValueError, AttributeError, IndexError, RuntimeError) as error:
        if resume is None or saver.started:
            raise
        raise ConfigError(
            f"{resume}: the run cannot go on with it ({error!r}): it is whole, but was changed or "
            "is of another program; start a new run from its weights with init="
        ) from error
