"""Writes a model as one file to run elsewhere: ONNX or torch.export."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tactileforge.cli import Command

#: What the forces of a file are, by their unit.
UNITS = {
    "N": "N",
    "relative": "shares of the force scale (force_unit=uncalibrated: estimated newtons)",
    "uncalibrated": "estimated newtons: no calibration of a unit is in the file",
}
#: Endings of the files of each format.
_SUFFIXES = {"onnx": ".onnx", "torch_export": ".pt2"}


@dataclass(frozen=True, kw_only=True)
class _Export:
    """A model as one file.

    Attributes:
        model: A name of ``tactileforge zoo list``, file:PATH, or run:FOLDER.
        format: ``onnx``, or ``torch_export`` for torch.export.load.
        head: A head of classes that bench fitted to this model (heads/TASK.MODEL.safetensors), for
            the output ``probability``; its names are in the file.
        out: The file; None for the model's name in this folder.
        size: Height and width of the frames, for example [240,320]; None for any.
        int8: Whether weights of linear layers become int8 (onnx only); the error is printed and
            kept in the file.
        tolerance: Largest difference between the outputs of the file and of the module.
        force_unit: ``uncalibrated`` for estimated newtons; None for shares of the model's force
            scale, or newtons of a model of your own recordings. The file says which.
    """

    model: str
    format: str = "onnx"
    head: str | None = None
    out: str | None = None
    size: int | list[int] | None = None
    int8: bool = False
    tolerance: float = 1e-4
    force_unit: str | None = None


def _export(keys: _Export, _: dict[str, Any]) -> None:
    """Writes a model as one file, preprocessing inside (docs/export.md)."""
    from tactileforge_export.write import export

    done = export(
        keys.model,
        _file(keys),
        format=keys.format,  # type: ignore[arg-type]
        size=[keys.size] if isinstance(keys.size, int) else keys.size,
        int8=keys.int8,
        tolerance=keys.tolerance,
        head=keys.head,
        force_unit=keys.force_unit,
        progress=True,
    )
    megabytes = Path(done.path).stat().st_size / 1e6
    print(f"{done.path}: {megabytes:.1f} MB, differs from the module by {done.error:.2g} at most")
    if done.force:
        print(f"force: {UNITS[done.force['unit']]}")
    if done.classes:
        print(f"probability: {', '.join(done.classes['names'])}")
    if done.int8:
        print(
            f"int8: cls differs by {done.int8['relative']:.2%} of its length, cosine at least "
            f"{done.int8['cosine']:.5f}"
        )


def _file(keys: _Export) -> str:
    """Path of the written file."""
    model = keys.model
    kind, colon, path = model.partition(":")
    stem = {"file:": Path(path).stem, "run:": Path(path).name}.get(kind + colon, model)
    return keys.out or f"{stem}{_SUFFIXES.get(keys.format, '')}"


COMMANDS = {"": Command(run=_export, keys=_Export, writes=_file)}
