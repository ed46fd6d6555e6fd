"""Run folders: one run each, locked while written."""

from __future__ import annotations

import secrets
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from tactileforge.errors import ConfigError, DataError, DataNotFoundError
from tactileforge.util.files import (
    say_swept,
    sealed_yaml,
    sweep_parts,
    unsealed,
    unsealed_yaml,
    write_text,
)
from tactileforge.util.locks import is_locked, locked

#: File that is locked while a process writes into the folder.
LOCK = ".lock"
#: Resolved configuration of a run.
CONFIG = "config.yaml"
#: Origin of a run: command, packages, plugins, licences.
VERSIONS = "versions.json"
#: Checkpoint that a run resumes from.
LAST = Path("checkpoints") / "last.ckpt"
#: Options of an encoder that matter in training alone: its weights do not depend on them.
OF_TRAINING = ("mask_ratio", "unknown_sensor")
#: Word of ``init=`` for the weights of a network of photographs, used by a photo stream.
IMAGENET = "imagenet"
#: Checkpoint of the best weights, if ``trainer.keep_best`` is set.
BEST = Path("checkpoints") / "best.ckpt"


def with_photographs(init: str) -> tuple[str, bool]:
    """Splits ``init=`` into its model or run, and whether a photo stream is added to it.

    Example:
        >>> with_photographs("anytouch2.tiny+imagenet")
        ('anytouch2.tiny', True)
        >>> with_photographs("run:runs/mine")  # as other commands name it
        ('runs/mine', False)
    """
    return init.removeprefix("run:").removesuffix(f"+{IMAGENET}"), init.endswith(f"+{IMAGENET}")


def split_best(run: Path) -> tuple[Path, bool]:
    """The folder of ``RUN`` or ``RUN@best``, and whether its best weights are meant.

    Example:
        >>> split_best(Path("runs/mine@best"))[1]
        True
    """
    if run.name.endswith("@best") and not run.exists():
        return run.with_name(run.name.removesuffix("@best")), True
    return run, False


def is_run(init: str) -> bool:
    """Whether ``init=`` names a run or a checkpoint of one, not a model of the zoo or a file."""
    place = split_best(Path(init))[0]
    return not init.startswith("file:") and ("/" in init or place.exists())


def identity() -> str:
    """Draws a unique name for a new run: 16 hexadecimal digits."""
    return secrets.token_hex(8)


def anywhere(data: Mapping[str, Any]) -> dict[str, Any]:
    """Makes the folders in the options of a data set absolute, to be found from any folder.

    Args:
        data: Node of the data set; ``root`` and ``cache``, also of its sources, become absolute
            paths if they exist.
    """
    made = dict(data)
    for key, value in data.items():
        if isinstance(value, Mapping):
            made[key] = anywhere(value)
        elif key in ("root", "cache") and isinstance(value, str) and value and Path(value).exists():
            made[key] = str(Path(value).absolute())
    return made


def write_config(folder: Path, plain: Mapping[str, Any]) -> None:
    """Writes ``config.yaml``, with its checksum."""
    write_text(folder / CONFIG, sealed_yaml(plain))


def read_config(folder: Path) -> dict[str, Any]:
    """Reads the configuration of a run; nothing in it is interpolated.

    Raises:
        DataNotFoundError: The folder has no configuration.
        DataError: The file is damaged, or not a configuration.
    """
    path = folder / CONFIG
    if not path.is_file():
        raise DataNotFoundError(f"{folder}: no {CONFIG} there; {_meant(folder)}")
    try:
        found = unsealed_yaml(path.read_text("utf-8"))
        if not isinstance(found, dict):
            raise ValueError("no names and values")
    except (ValueError, OSError) as error:
        raise DataError(
            f"{path}: not the configuration of a run ({error}); put the right file back"
        ) from error
    return {str(key): value for key, value in found.items()}


def _meant(folder: Path) -> str:
    """Fix for a folder without a run: one of the runs in it, or ``@best``."""
    run, _, word = folder.name.rpartition("@")
    if run and (folder.with_name(run) / CONFIG).is_file():
        return f"@{word} names no weights of {folder.with_name(run)}: @best does, or nothing (last)"
    runs = sorted(path.parent for path in folder.glob(f"*/{CONFIG}"))
    if not runs:
        return "give the folder of a run"
    return f"give the folder of a run, such as {runs[0]} ({len(runs)} in {folder})"


def read_versions(folder: Path) -> dict[str, Any]:
    """Reads ``versions.json`` of a run; empty if the file is absent.

    Raises:
        DataError: The file is damaged.
    """
    path = folder / VERSIONS
    try:
        return unsealed(path.read_bytes()) if path.is_file() else {}
    except ValueError as error:
        raise DataError(f"{path}: damaged ({error}); remove it, or put it back") from error


def is_claimed(folder: Path) -> bool:
    """Whether a process writes into the folder of a run."""
    return is_locked(folder / LOCK)


@contextmanager
def claimed(folder: Path, resumes: bool) -> Iterator[None]:
    """Locks the folder of a run until the context is left or the process ends.

    Processes of one run share its folder: the first of them (rank 0) holds it.

    Args:
        folder: Folder of the run; it is created.
        resumes: Whether the run in the folder is resumed; else the folder must hold none.

    Raises:
        ConfigError: Another process writes into the folder, or it holds a run already.
    """
    # here: it takes a second, and light verbs read run folders, too
    from lightning.fabric.utilities import rank_zero

    if getattr(rank_zero.rank_zero_only, "rank", 0) != 0:
        yield
        return
    taken = f"{folder}: another run writes here (process {{holder}}); give another hydra.run.dir="
    with locked(folder / LOCK, taken):
        # after the lock: before, another process could still write its first checkpoint
        if not resumes and (folder / LAST).exists():
            raise ConfigError(
                f"{folder} holds a run: go on with it (resume={folder}), start from its weights "
                f"(init={folder}) with another hydra.run.dir=, or remove it"
            )
        places = (folder, (folder / LAST).parent)
        say_swept(folder, sum(sweep_parts(place, alone=True) for place in places))
        yield
