"""Reads published checkpoints: tensors only, without running any code in the file."""

from __future__ import annotations

import pickle
import zipfile
from collections import OrderedDict
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError
from safetensors.torch import load_file
from torch import Tensor

from tactileforge.errors import DataError, DataNotFoundError
from tactileforge.plugins import check_pointer

#: Keys of the weights inside a checkpoint of a training program.
_CONTAINERS = ("state_dict", "model", "model_state_dict")
#: Modules of objects left in checkpoints by training programs, beside the weights: command lines,
#: schedules, optimisers. A `_Leftover` replaces each; a file with objects of other modules is
#: refused.
_PROGRAMS = (
    "argparse.",
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
#: Types of plain values, replaced by a `_Leftover` too.
_PLAIN: tuple[str, ...] = (
    "bool",
    "bytes",
    "complex",
    "dict",
    "float",
    "frozenset",
    "int",
    "list",
    "object",
)
_PLAIN += ("set", "str", "tuple", "long", "unicode")
#: Functions that make tensors and nothing else, also allowed by torch with ``weights_only``.
_TENSORS: dict[str, Any] = {
    "collections.OrderedDict": OrderedDict,
    "torch.Size": torch.Size,
    "torch.device": torch.device,
    "torch._utils._rebuild_tensor_v2": torch._utils._rebuild_tensor_v2,
    "torch._utils._rebuild_parameter": torch._utils._rebuild_parameter,
}


class _Leftover(dict[Any, Any]):
    """An inert stand-in for an object of a training program: accepts anything, does nothing."""

    def __init__(self, *arguments: Any) -> None:
        super().__init__()

    def __setstate__(self, state: Any) -> None:
        pass

    def __call__(self, *arguments: Any) -> _Leftover:
        return _Leftover()

    def append(self, item: Any) -> None:
        """Ignores an item; for stand-ins of lists and sets."""

    add = extend = append
    __hash__ = object.__hash__  # type: ignore[assignment]


class _Unpickler(pickle.Unpickler):
    """Makes tensors, plain values and leftovers; any other name in a file raises an error."""

    def find_class(self, module: str, name: str) -> Any:
        """Resolves a name of a file to a maker of tensors or an inert stand-in."""
        full = f"{module}.{name}"
        if full in _TENSORS:
            return _TENSORS[full]
        value = getattr(torch, name, None) if module == "torch" else None
        if isinstance(value, torch.dtype | torch.layout):
            return value
        is_plain = module in ("builtins", "__builtin__") and name in _PLAIN
        is_plain |= full in ("copyreg._reconstructor", "copy_reg._reconstructor", "_codecs.encode")
        if is_plain or full.startswith(_PROGRAMS):
            return _Leftover
        raise pickle.UnpicklingError(f"GLOBAL {full} is not a tensor")


class _Pickles:
    """A stand-in for the module ``pickle``, with the interface needed by `torch.load`."""

    __name__ = "tactileforge"
    Unpickler = _Unpickler
    UnpicklingError = pickle.UnpicklingError

    @staticmethod
    def load(file: Any, **options: Any) -> Any:
        """Reads one pickle."""
        return _Unpickler(file, **options).load()


def read_tensors(path: str | Path) -> dict[str, Tensor]:
    """Reads the tensors of a checkpoint: safetensors, or a file of ``torch.save``.

    T3 publishes several files for one model: give the folder with ``trunk.pth`` and ``encoders/``.
    Their tensors are then named ``trunk.*`` and ``encoders.NAME.*``.

    Raises:
        DataNotFoundError: There is no such file.
        DataError: The file is damaged, holds no tensors, or would run code; no code is run.
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
    check_pointer(path)
    if _is_safetensors(path):
        try:
            return load_file(path)
        except (SafetensorError, ValueError, OSError, MemoryError) as error:
            raise DataError(f"{path} is not a whole safetensors file: {error}") from error
    # files of torch.save before 1.6 are not zip: they have no checksums, and cannot be mapped
    zipped = zipfile.is_zipfile(path)
    if zipped:
        _check_sums(path)
    # weights_only=True would refuse the leftovers of training programs; `_Unpickler` makes nothing
    # but tensors and inert stand-ins, so no code of the file is run without it either
    try:
        return torch.load(
            path, map_location="cpu", pickle_module=_Pickles, weights_only=False, mmap=zipped
        )
    except Exception as error:
        # torch's message has many lines: the one that names what it does not take, or the first
        lines = [line.strip() for line in str(error).splitlines() if line.strip()]
        named = next((line for line in lines if "Unsupported" in line or "GLOBAL" in line), None)
        reason = (named or (lines or ["no reason given"])[0])[:200]
        raise DataError(
            f"{path} cannot be read as tensors ({type(error).__name__}: {reason}). Expected a file "
            "of torch.save with tensors and plain data, or safetensors. Nothing in it was run; if "
            "the download is whole and you trust it, save its state dict as safetensors yourself"
        ) from error


def _is_safetensors(path: Path) -> bool:
    """Whether a file is safetensors, by its suffix or by its content.

    The content begins with the length of a header, below the size of the file, followed by JSON.
    """
    with path.open("rb") as file:
        start = file.read(9)
    length = int.from_bytes(start[:8], "little")
    return path.suffix == ".safetensors" or (
        start[8:] == b"{" and 2 <= length <= path.stat().st_size - 8
    )


def _check_sums(path: Path) -> None:
    """Compares each part of a file of ``torch.save`` with its checksum."""
    try:
        with zipfile.ZipFile(path) as archive:
            names, bad = archive.namelist(), archive.testzip()
    except (zipfile.BadZipFile, OSError, EOFError, ValueError, RuntimeError) as error:
        raise DataError(f"{path} is damaged ({error}); download it again") from error
    if bad is not None:
        raise DataError(
            f"{path} is damaged: {bad} is not what its checksum says; download it again"
        )
    if any(name.endswith("constants.pkl") for name in names):
        raise DataError(
            f"{path} cannot be read as tensors: it is a program of TorchScript. Nothing in it was "
            "run; give the file of the weights"
        )


def _tensors(path: Path, content: Any) -> dict[str, Tensor]:
    while isinstance(content, Mapping):
        inner = next((k for k in _CONTAINERS if isinstance(content.get(k), Mapping)), None)
        if inner is None:
            break
        content = content[inner]
    if isinstance(content, Mapping):
        tensors = {str(k): v for k, v in content.items() if isinstance(v, Tensor)}
        # added by torch's DataParallel and DDP
        if tensors and all(key.startswith("module.") for key in tensors):
            tensors = {key.removeprefix("module."): v for key, v in tensors.items()}
        if tensors:
            return tensors
    kind = type(content).__name__
    if isinstance(content, Mapping):
        kind = f"a dict of {', '.join(sorted(map(str, content))[:5]) or 'nothing'}"
    raise DataError(f"{path} holds {kind}: expected a dict of tensors, a state dict")
