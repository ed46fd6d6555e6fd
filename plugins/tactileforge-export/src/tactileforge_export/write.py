"""Export of a model to a file, followed by a comparison of its outputs with the module's."""

from __future__ import annotations

import copy
import logging
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Literal

from torch import Tensor, nn

from tactileforge import __version__, load
from tactileforge.errors import ConfigError, TactileForgeError, unknown
from tactileforge.hub import (
    ClassHead,
    Model,
    describe_input,
    encoder_hash,
    fingerprint,
    fitted_layer,
    read_class_head,
)
from tactileforge.plugins import Bar, new_part, sync
from tactileforge_export.facts import AXES_OF_FORCE, BACKGROUND, OUTPUTS, Exported, need_onnx
from tactileforge_export.graph_module import GraphModule, check_float32
from tactileforge_export.program import BATCHES, ProgramFile, compare_outputs, sizes_of, trace

FORMATS = ("onnx", "torch_export")


def export(
    model: str | Path | Model | nn.Module,
    path: str | Path,
    *,
    format: Literal["onnx", "torch_export"] = "onnx",
    size: Sequence[int] | None = None,
    int8: bool = False,
    tolerance: float = 1e-4,
    head: str | Path | ClassHead | None = None,
    force_unit: str | None = None,
    progress: bool = False,
) -> Exported:
    """Writes a model as one file, from uint8 frames to tokens, class tokens, forces and classes.

    Preprocessing is in the graph, and the number of clips is free. The file is run on batches of 1
    and 3 and compared with the module before it gets its name.

    Args:
        model: Name or file for `tactileforge.load`, a loaded model, or a touch encoder.
        path: Path of the file; an existing one is replaced.
        format: Format of the file: ``onnx``, or ``torch_export`` for ``torch.export.load``.
        size: Height and width of the frames, pixels; None for any (``torch_export``: any above the
            encoder's own).
        int8: Whether to quantise the weights of linear layers to int8; ``onnx`` only.
        tolerance: Largest accepted difference of outputs; not applied to int8 weights.
        head: A head of classes that the benchmark fitted to this model, ``heads/TASK.MODEL``; its
            names are in the metadata.
        force_unit: The ``unit`` of `Model.force`: None for shares of the force scale, or newtons of
            a model of your own recordings; ``uncalibrated`` for estimated newtons.
        progress: Whether to draw a bar on stderr.

    Raises:
        DataError: The head is not one.
        ConfigError: The head belongs to another model; or the format or model is unknown, a package
            is missing, or the graph cannot take the size.
        TactileForgeError: The file's outputs differ from the module's; it is not kept.

    Example:
        >>> export("anytouch2", "anytouch2.onnx", size=(240, 320)).error  # doctest: +SKIP
        1.05e-05
    """
    path = Path(path)
    _check(path, format, size, int8, tolerance)
    taken = None if size is None else (size[0], size[1])
    module, facts = _open(model, head, force_unit)
    sizes = sizes_of(module, taken, small=format == "onnx")
    # the graph, its batches, and with int8 the weights and the batches again
    steps = (1 + len(sizes) * len(BATCHES)) * (1 + int8)
    bar = Bar(total=steps, desc="export", unit="step", disable=not progress)
    with bar, _quiet(), new_part(path) as part:
        program = trace(module, taken)
        file = _file(format, program, module.outputs)
        file.save(part)
        bar.update()
        error = compare_outputs(file.load(part), module, sizes, bar.update).largest
        if not error <= tolerance:
            raise TactileForgeError(
                f"{path}: the file's outputs differ from the module's by {error:.2g}, more than "
                f"tolerance={tolerance:g}; nothing was kept. Give a higher tolerance if that is "
                "good enough for you"
            )
        loss = {}
        # after the comparison: the float graph is held to the tolerance, int8 weights are not
        if int8:
            file.quantise(part)
            bar.update()
            gap = compare_outputs(file.load(part), module, sizes, bar.update)
            loss = {"relative": gap.relative, "cosine": gap.cosine}
        done = Exported(
            path=str(path),
            format=format,
            size=list(size or ()),
            error=error,
            int8=loss,
            **facts,
        )
        # again, now with metadata: they hold the measured error
        file.save(part, done.text())
        sync(part)
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


def _open(
    model: str | Path | Model | nn.Module,
    classes: str | Path | ClassHead | None,
    force_unit: str | None,
) -> tuple[GraphModule, dict[str, Any]]:
    """Opens the module of the graph, on the CPU in eval mode, and collects its metadata."""
    opened: Any = load(model) if isinstance(model, str | Path) else model
    known = {"model": "", "licence": "", "spacing": float(getattr(opened, "spacing", 0.0))}
    head, scale, unit, squashed = None, {}, "", None
    encoder = opened.encoder if isinstance(opened, Model) else opened
    if isinstance(opened, Model):
        known |= {"model": opened.header.name, "licence": opened.header.licence}
        squashed = opened.squashed
        if "force" in opened.heads:
            head, scale = opened.heads["force"], opened.header.heads["force"].get("scale", {})
            unit = opened.force_unit(unit=force_unit)
    check_float32(encoder)
    layer, about = _classes(classes, encoder, str(known["model"]) or "this model")
    force: dict[str, Any] = {}
    # copied together: a head may share modules with its encoder. Hooks stay off the user's model
    factor = dict.fromkeys(scale, (1.0, 1.0, 1.0)) if unit == "relative" else scale
    module = GraphModule(*copy.deepcopy((encoder, head)), factor, squashed, layer)
    module = module.cpu().eval().requires_grad_(False)
    if head is not None:
        known_scale = {k: list(scale[k]) for k in module.sensors if k in scale}
        force = {"unit": unit, "axes": AXES_OF_FORCE, "scale": known_scale}
    return module, {
        **known,
        "sensors": module.sensors,
        "frames": encoder.frames,
        "version": __version__,
        "weights": fingerprint([encoder] if head is None else [encoder, head]),
        "preprocessing": describe_input(encoder)
        | ({} if squashed is None else {"squashed": list(squashed)}),
        "outputs": {name: OUTPUTS[name] for name in module.outputs},
        "force": force,
        "classes": about,
    }


def _classes(
    head: str | Path | ClassHead | None, encoder: Any, model: str
) -> tuple[tuple[Tensor, Tensor] | None, dict[str, Any]]:
    """Layer and metadata of a head of classes."""
    if head is None:
        return None, {}
    fitted = head if isinstance(head, ClassHead) else read_class_head(head)
    # what it was fitted to with is told in the metadata, as a file takes any background
    subtracts = bool(fitted.facts.background)
    weight, bias, names = fitted_layer(fitted, encoder_hash(encoder), model, subtracts, ())
    given = {None: "any: it is not used", True: BACKGROUND.partition(";")[0]}
    return (weight, bias), {
        "names": list(names),
        "sensors": fitted.facts.sensors,
        "background": given.get(fitted.facts.background, "130 everywhere: it was fitted without"),
    }


def _file(format: str, program: Any, outputs: Sequence[str]) -> Any:
    if format == "torch_export":
        return ProgramFile(program)
    from tactileforge_export.onnx_file import OnnxFile

    return OnnxFile(program, outputs)


@contextmanager
def _quiet() -> Iterator[None]:
    """Silences warnings of exporters, since wrong outputs are found by comparison."""
    before = logging.root.manager.disable
    logging.disable(logging.ERROR)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    finally:
        logging.disable(before)
