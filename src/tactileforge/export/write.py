"""Exports a model to a file, then runs it and compares its outputs."""

from __future__ import annotations

import copy
import logging
import os
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Literal

from torch import nn

from tactileforge.errors import ConfigError, TactileForgeError, unknown
from tactileforge.export.facts import Exported, need_onnx
from tactileforge.export.program import ProgramFile, compare_outputs, sizes_of, trace
from tactileforge.files import new_part
from tactileforge.hub.loading import load
from tactileforge.hub.model import Model

FORMATS = ("onnx", "torch_export")


def export(
    model: str | Path | Model | nn.Module,
    path: str | Path,
    *,
    format: Literal["onnx", "torch_export"] = "onnx",
    size: Sequence[int] | None = None,
    int8: bool = False,
    tolerance: float = 1e-4,
) -> Exported:
    """Writes a model as one file: uint8 frames in, tokens and class tokens out.

    Preprocessing is in the graph, and the number of clips is free. The file is run on batches of 1
    and 3 and compared with the module before it gets its name.

    Args:
        model: What `tactileforge.load` takes, what it gives, or a touch encoder.
        path: The file; one that is there is replaced.
        format: ``onnx``, or ``torch_export`` for ``torch.export.load``.
        size: H and W of the frames; None for any: in ``torch_export``, any above the encoder's own.
        int8: Whether the weights of linear layers become int8; ``onnx`` only.
        tolerance: Largest difference that is accepted; int8 weights are not held to it.

    Raises:
        ConfigError: Unknown format or model, a package is missing, or a size that the graph cannot
            take.
        TactileForgeError: The file computes something else than the module; it is not kept.

    Example:
        >>> export("anytouch2", "anytouch2.onnx", size=(240, 320)).error  # doctest: +SKIP
        1.05e-05
    """
    path = Path(path)
    _check(path, format, size, int8, tolerance)
    taken = None if size is None else (size[0], size[1])
    encoder, facts = _open(model)
    with _quiet(), new_part(path) as part:
        program = trace(encoder, taken)
        file = _file(format, program)
        file.save(part)
        sizes = sizes_of(encoder, taken, small=format == "onnx")
        error = compare_outputs(file.load(part), encoder, sizes).largest
        if not error <= tolerance:
            raise TactileForgeError(
                f"{path}: the file's outputs differ from the module's by {error:.2g}, more than "
                f"tolerance={tolerance:g}; nothing was kept. Give a higher tolerance if that is "
                "good enough for you"
            )
        loss = {}
        if int8:
            file.quantise(part)
            gap = compare_outputs(file.load(part), encoder, sizes)
            loss = {"relative": gap.relative, "cosine": gap.cosine}
        done = Exported(
            path=str(path),
            format=format,
            size=list(size or ()),
            error=error,
            int8=loss,
            **facts,
        )
        file.save(part, done.text())
        with part.open("rb+") as written:
            os.fsync(written.fileno())
        part.replace(path)
    return done


def _check(path: Path, format: str, size: Any, int8: Any, tolerance: Any) -> None:
    if format not in FORMATS:
        raise ConfigError(unknown("format", format, FORMATS))
    if size is not None and (len(size) != 2 or not all(isinstance(n, int) and n > 0 for n in size)):
        raise ConfigError(f"size={list(size)}: give height and width of the frames, in pixels")
    if not isinstance(int8, bool):
        raise ConfigError(f"int8={int8}: give true or false")
    if not isinstance(tolerance, int | float) or not tolerance >= 0:
        raise ConfigError(f"tolerance={tolerance}: give a number, 0 or more")
    if path.is_dir():
        raise ConfigError(f"{path} is a folder: give the name of a file")
    if format == "onnx":
        need_onnx()
    elif int8:
        raise ConfigError("int8=true needs format=onnx")


def _open(model: str | Path | Model | nn.Module) -> tuple[Any, dict[str, Any]]:
    """The encoder, on the CPU in eval mode, and its facts."""
    opened = load(model) if isinstance(model, str | Path) else model
    if isinstance(opened, Model):
        encoder: Any = opened.encoder
        known = {
            "model": opened.header.name,
            "licence": opened.header.licence,
            "spacing": opened.spacing,
        }
    else:
        encoder = opened
        known = {"model": "", "licence": "", "spacing": float(getattr(encoder, "spacing", 0.0))}
    encoder = copy.deepcopy(encoder).cpu().eval().requires_grad_(False)
    universal = getattr(encoder, "universal", None)
    sensors = dict(encoder.sensors) | ({} if universal is None else {"universal": universal})
    return encoder, known | {"sensors": sensors, "frames": encoder.frames}


def _file(format: str, program: Any) -> Any:
    if format == "torch_export":
        return ProgramFile(program)
    from tactileforge.export.onnx_file import OnnxFile

    return OnnxFile(program)


@contextmanager
def _quiet() -> Iterator[None]:
    """Silences exporters: outputs are compared, and deviations raised."""
    before = logging.root.manager.disable
    logging.disable(logging.ERROR)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    finally:
        logging.disable(before)
