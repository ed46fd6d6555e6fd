"""Checkpoint files: sealed with a checksum, read without executing code."""

from __future__ import annotations

import hashlib
import os
from collections import OrderedDict
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import IO, Any

import torch
from torch import nn

from tactileforge.errors import ConfigError, DataNotFoundError
from tactileforge.runs.folder import BEST, LAST, split_best
from tactileforge.util.pointers import check_pointer

#: A checkpoint is a zip file; its comment is this word and the SHA-256 of all bytes before. Without
#: it, torch.load took 298 of 300 files of 2 MB with one flipped bit (`mmap=True`, torch 2.13); in a
#: file beside, it would be another moment to be killed at, and readers of torch find the comment no
#: obstacle.
_SEAL = b"tactileforge sha256 "
_SEALED = len(_SEAL) + 64
#: Keys read from a checkpoint, and their types; all but ``state_dict`` may be absent.
_KINDS: dict[str, type] = {
    **dict.fromkeys(("state_dict", "loops", "callbacks", "scores", "skipped", "labels"), dict),
    **dict.fromkeys(("optimizer_states", "lr_schedulers"), list),
    **dict.fromkeys(("global_step", "epoch", "processes"), int),
}
_ORDERED: dict[type, type] = {dict: OrderedDict}
#: Keys that a resumed run needs.
RESUMED = (
    *("global_step", "epoch", "loops", "callbacks", "optimizer_states", "lr_schedulers"),
    *("total", "epoch_steps", "processes", "skipped", "labels"),
)
#: Signature and size, in bytes, of the last record of a zip file without a comment.
_END, _END_BYTES = b"PK\x05\x06", 22


def find_checkpoint(path: str | Path) -> Path:
    """Finds the checkpoint of a run folder, ``RUN`` or ``RUN@best``, or returns the file itself.

    Raises:
        DataNotFoundError: No checkpoint is there; states the fix.
    """
    path, best = split_best(Path(path))
    file = path / LAST if path.is_dir() else path
    if best and path.is_dir():
        file = path / BEST
        if not file.is_file():
            raise DataNotFoundError(
                f"{file}: the run kept no best weights; train with "
                "trainer.keep_best=val/loss, or another logged number"
            )
    if not file.is_file():
        raise DataNotFoundError(f"no checkpoint at {file}; give the folder of a run, or its file")
    return file


def seal(file: IO[bytes]) -> None:
    """Appends a checksum to a file of ``torch.save``, as the comment of its zip format.

    Raises:
        ValueError: The file is not one of ``torch.save``, or is sealed already.
    """
    file.seek(-_END_BYTES, os.SEEK_END)
    end = file.read()
    if not end.startswith(_END) or end[-2:] != b"\0\0":
        raise ValueError("no file of torch.save, or one that has a checksum")
    # the length of the comment comes before it, and is part of the hashed bytes: so it is written
    # first (APPNOTE of PKWARE, section 4.3.16)
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
        raise ValueError("its checksum does not match: bytes of it have changed")


def read_own(path: str | Path, run: str | None, needs: Sequence[str] = ()) -> dict[str, Any]:
    """Reads a checkpoint of a given run.

    Args:
        path: Folder of the run, or the checkpoint itself; see `find_checkpoint`.
        run: Identity of the run.
        needs: Keys that the checkpoint must have; `RESUMED` to resume the run.

    Raises:
        DataNotFoundError: No checkpoint is there.
        ConfigError: The file cannot be read (see `read_checkpoint`), belongs to another run, or
            lacks a key.
    """
    found = read_checkpoint(path)
    if found.get("run") != run:
        raise ConfigError(
            f"{find_checkpoint(path)} is a checkpoint of run {found.get('run')}, but config.yaml "
            f"beside it is of run {run}: one of the two was copied or overwritten. Start a new "
            "run from the weights with init=, or put the right file back"
        )
    if lacks := [key for key in needs if key not in found]:
        raise ConfigError(
            f"{find_checkpoint(path)} has no {lacks[0]}: it holds only weights, or is another "
            "program's; start a new run from its weights with init="
        )
    return found


def read_checkpoint(path: str | Path) -> dict[str, Any]:
    """Reads a checkpoint on the CPU; tensors and plain data only, no code.

    Raises:
        DataNotFoundError: No checkpoint is there.
        ConfigError: The file is not a checkpoint, or its checksum does not match.
    """
    file = find_checkpoint(path)
    check_pointer(file)
    try:
        # the checksum before torch.load, which may crash, not fail, on damaged bytes
        _check_seal(file)
        checkpoint: dict[str, Any] = torch.load(
            file, map_location="cpu", weights_only=True, mmap=True
        )
        _check_structure(checkpoint)
    # torch.load raises many types for foreign bytes, none of them its own
    except Exception as error:
        raise ConfigError(
            f"{file} is not a checkpoint that can be read ({error}); nothing in it was executed"
        ) from error
    return checkpoint


def _check_structure(checkpoint: Any) -> None:
    """Checks the entries of a checkpoint.

    Raises:
        ValueError: An entry has the wrong type or value, or there is no ``state_dict``.
    """
    if not isinstance(checkpoint, dict) or "state_dict" not in checkpoint:
        raise ValueError("no state_dict in it")
    for key, kind in _KINDS.items():
        # type(), not isinstance: True is an int, and a subclass of dict may act in its own way
        if key in checkpoint and type(checkpoint[key]) not in (kind, _ORDERED.get(kind)):
            raise ValueError(f"{key} is {str(checkpoint[key])[:60]!r}, not of type {kind.__name__}")
    for name, value in checkpoint["state_dict"].items():
        if not isinstance(name, str) or not isinstance(value, torch.Tensor):
            raise ValueError(f"{str(name)[:60]!r} of its state_dict is not a tensor")
    if not 0 <= checkpoint.get("global_step", 0) < 1 << 48:
        raise ValueError(f"global_step is {checkpoint['global_step']}")


def initialise(
    module: nn.Module, state: Mapping[str, torch.Tensor], new: tuple[str, ...] = ()
) -> str:
    """Initialises a module from the weights of another run; the whole encoder must match.

    Tensors of heads and objectives are taken if name and shape match, because the new run may have
    other ones. The state of the balance is not taken.

    Args:
        module: Module of the new run.
        state: Tensors of the other run, by name.
        new: Prefixes of the encoder tensors that may be missing. Where these double the width of
            the encoder, the layers that read the whole width start from those that read half of it.

    Returns:
        A line that names the tensors taken, new, and not used.

    Raises:
        ConfigError: Encoder tensors are missing, left over, or of another shape; names them.
    """
    # a balance follows the losses of its own run
    current, state = (
        {key: value for key, value in states.items() if not key.startswith("balance.")}
        for states in (module.state_dict(), state)
    )
    if new:
        state = {k: _widened(v, current[k]) if k in current else v for k, v in state.items()}
    fits = {k: v for k, v in state.items() if k in current and current[k].shape == v.shape}
    wrong = [
        f"{key} ({tuple(state[key].shape) if key in state else 'missing'} in the checkpoint, "
        f"{tuple(current[key].shape) if key in current else 'absent'} here)"
        for key in sorted(current.keys() | state.keys())
        if key.startswith("encoder.") and key not in fits
        if key in state or not key.startswith(new)
    ]
    if wrong:
        some = "; ".join(wrong[:5])
        raise ConfigError(f"init: the encoder does not fit: {some} ({len(wrong)} in all)")
    # not strict: heads and objectives may differ, and the encoder is checked above
    module.load_state_dict(fits, strict=False)
    # by part of the module, such as heads.align: a run has hundreds of tensors
    fresh, left = (
        ", ".join(sorted({".".join(key.split(".")[:-1][:2]) for key in keys - fits.keys()}))
        or "none"
        for keys in (current.keys(), state.keys())
    )
    return f"init: {len(fits)} tensors taken; new: {fresh}; not used: {left}"


def left_out(
    module: nn.Module, state: Mapping[str, torch.Tensor], new: tuple[str, ...] = ()
) -> list[str]:
    """Parts of heads and objectives not taken by `initialise`, such as ``heads.align``.

    Args:
        module: Module of the new run.
        state: Tensors of the other run, by name.
        new: Prefixes of new tensors, as of `initialise`.
    """
    current = module.state_dict()

    def taken(key: str) -> bool:
        wanted = current.get(key)
        value = state[key] if wanted is None or not new else _widened(state[key], wanted)
        return wanted is not None and value.shape == wanted.shape

    kept = (key for key in state if key.startswith(("heads.", "objectives.")))
    return sorted({".".join(key.split(".")[:2]) for key in kept if not taken(key)})


def _widened(value: torch.Tensor, wanted: torch.Tensor) -> torch.Tensor:
    """Doubles the last axis of a tensor, if the wanted shape asks for it.

    The new half of a matrix is 0, so that a linear layer ignores its new inputs; the new half of a
    vector is that of ``wanted``.
    """
    if not value.ndim or wanted.shape != (*value.shape[:-1], 2 * value.shape[-1]):
        return value
    rest = wanted[..., value.shape[-1] :]
    return torch.cat([value, rest if value.ndim == 1 else torch.zeros_like(rest)], dim=-1)
