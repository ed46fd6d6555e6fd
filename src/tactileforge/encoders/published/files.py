"""Reads checkpoints as published: tensors only, and never a line of code that is in the file."""

from __future__ import annotations

import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError
from safetensors.torch import load_file
from torch import Tensor

from tactileforge.errors import DataError, DataNotFoundError

#: Where training programs keep the weights inside a checkpoint.
_CONTAINERS = ("state_dict", "model", "model_state_dict")
#: Modules whose objects training programs leave in checkpoints beside the weights: command lines,
#: schedules, optimisers. A `_Leftover` stands in for each; a file with any other is refused.
_PROGRAMS = (
    "argparse.",
    "builtins.dict",
    "builtins.list",
    "builtins.set",
    "collections.",
    "lightning.",
    "lightning_fabric.",
    "numpy.",
    "omegaconf.",
    "pathlib.",
    "pytorch_lightning.",
    "tactile_ssl.",
    "torch.optim.",
    "typing.",
)


class _Leftover(dict[Any, Any]):
    """In place of an object of a training program: it takes what it is given and does nothing."""

    def __init__(self, *arguments: Any) -> None:
        super().__init__()

    def __setstate__(self, state: Any) -> None:
        pass


def read_tensors(path: str | Path) -> dict[str, Tensor]:
    """The tensors of a checkpoint: safetensors, or a file of ``torch.save``.

    T3 publishes several files for one model: give the folder that holds ``trunk.pth`` and
    ``encoders/``. Their tensors are then named ``trunk.*`` and ``encoders.NAME.*``.

    Raises:
        DataNotFoundError: No such file.
        DataError: It is damaged, holds no tensors, or would run code. It is not run.
    """
    path = Path(path)
    if path.is_dir():
        return _read_folder(path)
    if not path.is_file():
        raise DataNotFoundError(f"no checkpoint at {path}; give the file as you downloaded it")
    return _tensors(path, _load(path))


def _read_folder(folder: Path) -> dict[str, Tensor]:
    encoders = sorted((folder / "encoders").glob("*.pth"))
    if not (folder / "trunk.pth").is_file() or not encoders:
        raise DataNotFoundError(
            f"{folder} is a folder without trunk.pth and encoders/*.pth, as T3 has them; give the "
            "file of the checkpoint"
        )
    parts = {"trunk": folder / "trunk.pth"} | {f"encoders.{file.stem}": file for file in encoders}
    return {
        f"{name}.{key}": tensor
        for name, file in parts.items()
        for key, tensor in read_tensors(file).items()
    }


def _load(path: Path) -> Any:
    if path.suffix == ".safetensors":
        try:
            return load_file(path)
        except (SafetensorError, ValueError) as error:
            raise DataError(f"{path} is not a whole safetensors file: {error}") from error
    try:
        zipped = zipfile.is_zipfile(path)
        strange = torch.serialization.get_unsafe_globals_in_checkpoint(path) if zipped else []
        inert: list[Any] = [(_Leftover, name) for name in strange if name.startswith(_PROGRAMS)]
        with torch.serialization.safe_globals(inert):
            return torch.load(path, map_location="cpu", weights_only=True, mmap=zipped)
    except Exception as error:
        raise DataError(
            f"{path} cannot be read as tensors ({_short(error)}). Expected a file of torch.save "
            "with tensors and plain data, or safetensors. Nothing in it was run; if the download "
            "is whole and you trust it, save its state dict as safetensors yourself"
        ) from error


def _short(error: Exception) -> str:
    """The line of torch's long messages that says what is wrong."""
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    reason = next((line for line in lines if "Unsupported" in line or "GLOBAL" in line), None)
    return f"{type(error).__name__}: {(reason or (lines or ['no reason given'])[0])[:200]}"


def _tensors(path: Path, content: Any) -> dict[str, Tensor]:
    while isinstance(content, Mapping):
        inner = next((k for k in _CONTAINERS if isinstance(content.get(k), Mapping)), None)
        if inner is None:
            break
        content = content[inner]
    if isinstance(content, Mapping):
        tensors = {str(k): v for k, v in content.items() if isinstance(v, Tensor)}
        if tensors and all(key.startswith("module.") for key in tensors):
            tensors = {key.removeprefix("module."): v for key, v in tensors.items()}
        if tensors:
            return tensors
    kind = type(content).__name__
    if isinstance(content, Mapping):
        kind = f"a dict of {', '.join(sorted(map(str, content))[:5]) or 'nothing'}"
    raise DataError(f"{path} holds {kind}: expected a dict of tensors, a state dict")
