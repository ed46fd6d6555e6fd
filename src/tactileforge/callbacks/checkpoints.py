"""Crash-safe checkpoints: written under another name and renamed, read without executing code."""

from __future__ import annotations

import hashlib
import os
import shutil
import signal
from collections.abc import Mapping
from pathlib import Path
from types import FrameType
from typing import IO, Any

import lightning as L
import torch
from lightning.pytorch.callbacks import Callback, ModelCheckpoint
from lightning.pytorch.plugins.io import TorchCheckpointIO
from torch import nn

from tactileforge.errors import ConfigError, DataNotFoundError, TactileForgeError

#: Where a run keeps the checkpoint that it resumes from.
LAST = Path("checkpoints") / "last.ckpt"
#: Where a run keeps its best weights, if it is asked to.
BEST = Path("checkpoints") / "best.ckpt"

#: A checkpoint is a zip file; its comment is this and the SHA-256 of all that comes before.
_SEAL = b"tactileforge sha256 "
_SEALED = len(_SEAL) + 64
#: What a zip file ends with where it has no comment: a record of 22 bytes.
_END, _END_BYTES = b"PK\x05\x06", 22


class AtomicCheckpointIO(TorchCheckpointIO):
    """Writes to ``.part`` beside the file, then renames: a killed run keeps its last checkpoint.

    Args:
        run: Identity of the run, which its checkpoints carry; see `run_folder.identity`.
    """

    def __init__(self, run: str | None = None) -> None:
        self.run = run

    def save_checkpoint(
        self, checkpoint: dict[str, Any], path: str | Path, storage_options: Any = None
    ) -> None:
        """Saves; see the class.

        Raises:
            TactileForgeError: The disk is full, or cannot be written; the last checkpoint stays.
        """
        path = Path(path)
        path.parent.mkdir(parents=True, exist_ok=True)
        part = path.with_name(path.name + ".part")
        try:
            with part.open("w+b") as file:
                torch.save({**checkpoint, "run": self.run}, file)
                seal(file)
                os.fsync(file.fileno())
            part.replace(path)
        except (OSError, RuntimeError) as error:  # torch: a RuntimeError
            raise TactileForgeError(
                f"{path}: the checkpoint cannot be written ({error}); the one before it stays. "
                "Make room, then go on with resume="
            ) from error
        finally:
            part.unlink(missing_ok=True)

    def load_checkpoint(
        self, path: str | Path, map_location: Any = None, weights_only: bool | None = None
    ) -> dict[str, Any]:
        """Reads a checkpoint of this run; see `read_own`."""
        return read_own(path, self.run)


class Checkpoints(Callback):
    """Saves ``last.ckpt`` every so many steps, at the end, and when the run is asked to stop.

    The first Ctrl-C (or SIGTERM) lets the step finish, saves and ends the run in order; the second
    ends it at once.

    Args:
        folder: Folder of the run.
        every: Steps between two saves.
    """

    def __init__(self, folder: Path, every: int) -> None:
        self.path = folder / LAST
        self.every = every
        self.interrupted = False
        self._handlers: dict[int, Any] = {}

    def on_train_start(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        """Listens for signals."""
        for number in (signal.SIGINT, signal.SIGTERM):
            self._handlers[number] = signal.signal(number, self._stop)

    def on_train_batch_start(
        self, trainer: L.Trainer, pl_module: L.LightningModule, batch: Any, batch_idx: int
    ) -> None:
        """Looks for room before a step that ends with a save: else the step would be lost.

        Raises:
            TactileForgeError: There is none; the last checkpoint stays.
        """
        if trainer.is_global_zero and (trainer.global_step + 1) % self.every == 0:
            check_room(self.path, _size(trainer))

    def _stop(self, number: int, frame: FrameType | None) -> None:
        self.interrupted = True
        signal.signal(number, self._handlers[number])
        print("\nstopping after this step (once more to stop at once)", flush=True)

    def on_train_batch_end(
        self,
        trainer: L.Trainer,
        pl_module: L.LightningModule,
        outputs: Any,
        batch: Any,
        batch_idx: int,
    ) -> None:
        """Saves every so many steps."""
        stepped = (trainer.fit_loop.total_batch_idx + 1) % trainer.accumulate_grad_batches == 0
        stop = trainer.strategy.reduce_boolean_decision(self.interrupted, all=False)
        if stepped and (stop or trainer.global_step % self.every == 0):
            trainer.save_checkpoint(self.path)
        if stepped and stop:
            self.interrupted = trainer.should_stop = True

    def on_train_end(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        """Saves at the end of the run, and stops listening."""
        if not self.interrupted:
            trainer.save_checkpoint(self.path)
        self._release()

    def on_exception(
        self, trainer: L.Trainer, pl_module: L.LightningModule, exception: BaseException
    ) -> None:
        """Stops listening."""
        self._release()

    def _release(self) -> None:
        for number, handler in self._handlers.items():
            signal.signal(number, handler)
        self._handlers.clear()


def best_checkpoint(folder: Path, metric: str | None) -> list[Callback]:
    """Builds the callback that keeps the weights with the smallest value of a metric in `BEST`.

    Args:
        folder: Folder of the run.
        metric: Such as ``val/denoise``; None keeps none.
    """
    if metric is None:
        return []
    keeper = ModelCheckpoint(
        dirpath=folder / BEST.parent,
        filename=BEST.stem,
        monitor=metric,
        save_weights_only=True,
        enable_version_counter=False,
        save_on_train_epoch_end=False,
    )
    return [keeper]


def check_room(path: Path, size: int) -> None:
    """Checks that a checkpoint can be written beside the one before it.

    Raises:
        TactileForgeError: The disk has less room than it takes, bytes.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    free = shutil.disk_usage(path.parent).free
    if free < size:
        raise TactileForgeError(
            f"{path}: the disk is full: {free / 1e6:,.1f} MB are left, and a checkpoint takes "
            f"{size / 1e6:,.1f} MB. The one before it stays: make room, then go on with resume="
        )


def _size(trainer: L.Trainer) -> int:
    """About how large the next checkpoint is, bytes: weights, and what the optimiser keeps."""
    state = trainer.lightning_module.state_dict().values()
    kept = [x for optim in trainer.optimizers for one in optim.state.values() for x in one.values()]
    return sum(x.nbytes for x in [*state, *kept] if isinstance(x, torch.Tensor))


def find_checkpoint(path: str | Path) -> Path:
    """Finds the checkpoint of a run folder, or returns the file itself.

    Raises:
        DataNotFoundError: There is none; says what to give.
    """
    path = Path(path)
    file = path / LAST if path.is_dir() else path
    if not file.is_file():
        raise DataNotFoundError(f"no checkpoint at {file}; give the folder of a run, or its file")
    return file


def seal(file: IO[bytes]) -> None:
    """Appends the checksum of a file of ``torch.save``, as the comment of the zip file it is.

    Raises:
        ValueError: The file is no such file, or is sealed.
    """
    file.seek(-_END_BYTES, os.SEEK_END)
    end = file.read()
    if not end.startswith(_END) or end[-2:] != b"\0\0":
        raise ValueError("no file of torch.save, or one that has a checksum")
    file.seek(-2, os.SEEK_END)
    file.write(_SEALED.to_bytes(2, "little"))
    file.seek(0)
    digest = hashlib.file_digest(file, "sha256").hexdigest()  # type: ignore[arg-type]
    file.seek(0, os.SEEK_END)
    file.write(_SEAL + digest.encode())
    file.flush()


def _check_seal(path: Path) -> None:
    size = path.stat().st_size
    with path.open("rb") as file:
        file.seek(max(0, size - _SEALED))
        comment = file.read()
        if not comment.startswith(_SEAL):
            raise ValueError("it has no checksum at its end: cut off, or of another program")
        file.seek(0)
        digest, left = hashlib.sha256(), size - _SEALED
        while left and (chunk := file.read(min(left, 1 << 20))):
            digest.update(chunk)
            left -= len(chunk)
    if comment != _SEAL + digest.hexdigest().encode():
        raise ValueError("its checksum is another: bytes of it have changed")


def read_own(path: str | Path, run: str | None) -> dict[str, Any]:
    """Reads a checkpoint, which must be of one run.

    Args:
        path: See `find_checkpoint`.
        run: Identity of the run.

    Raises:
        DataNotFoundError: See `find_checkpoint`.
        ConfigError: See `read_checkpoint`; or it is another run's.
    """
    found = read_checkpoint(path)
    if found.get("run") != run:
        raise ConfigError(
            f"{find_checkpoint(path)} is a checkpoint of run {found.get('run')}, but config.yaml "
            f"beside it is of run {run}: one of the two was copied or overwritten. Start a new "
            "run from the weights with init=, or put the right file back"
        )
    return found


def read_checkpoint(path: str | Path) -> dict[str, Any]:
    """Reads a checkpoint on the CPU; tensors and plain data only, no code.

    Raises:
        DataNotFoundError: See `find_checkpoint`.
        ConfigError: The file is not a checkpoint, or its checksum is another.
    """
    file = find_checkpoint(path)
    try:
        _check_seal(file)
        checkpoint: dict[str, Any] = torch.load(
            file, map_location="cpu", weights_only=True, mmap=True
        )
        if not isinstance(checkpoint, dict) or "state_dict" not in checkpoint:
            raise ValueError("no state_dict in it")
    except Exception as error:
        raise ConfigError(
            f"{file} is not a checkpoint that can be read ({error}); nothing in it was executed"
        ) from error
    return checkpoint


def initialise(module: nn.Module, state: Mapping[str, torch.Tensor]) -> str:
    """Initialises a module from the weights of another run; the whole encoder must match.

    Heads and objectives are taken where name and shape agree, because the new run may have others;
    how they were balanced is not.

    Returns:
        A line that says what was taken and what was not.

    Raises:
        ConfigError: Encoder tensors are missing, left over, or of another shape; names them.
    """
    current, state = (
        {key: value for key, value in states.items() if not key.startswith("balance.")}
        for states in (module.state_dict(), state)
    )
    fits = {k: v for k, v in state.items() if k in current and current[k].shape == v.shape}
    wrong = [
        f"{key} ({tuple(state[key].shape) if key in state else 'missing'} in the checkpoint, "
        f"{tuple(current[key].shape) if key in current else 'absent'} here)"
        for key in sorted(current.keys() | state.keys())
        if key.startswith("encoder.") and key not in fits
    ]
    if wrong:
        some = "; ".join(wrong[:5])
        raise ConfigError(f"init: the encoder does not fit: {some} ({len(wrong)} in all)")
    module.load_state_dict(fits, strict=False)
    fresh = sorted({key.rsplit(".", 1)[0] for key in current.keys() - fits.keys()})
    left = sorted({key.rsplit(".", 1)[0] for key in state.keys() - fits.keys()})
    return f"init: {len(fits)} tensors taken; new: {fresh or 'none'}; not used: {left or 'none'}"
