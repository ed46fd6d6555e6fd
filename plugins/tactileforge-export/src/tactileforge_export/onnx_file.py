"""Encoders as ONNX graphs: exact resizing, no local paths, int8 weights on request."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import onnxruntime
import torch
from onnxruntime.quantization import QuantType, quantize_dynamic
from onnxscript import opset18 as op
from torch import Tensor
from torch.export import ExportedProgram
from torch.nn import functional as F

from tactileforge.errors import ConfigError
from tactileforge_export.facts import KEY
from tactileforge_export.program import INPUTS, Outputs, Run, no_stack_traces
from tactileforge_export.squash import Squash

#: Largest size of an ONNX file, bytes: the limit of protobuf.
_LARGEST = 2**31 - 1


class OnnxFile:
    """A graph as an ONNX file.

    Args:
        program: Graph made by `program.trace`.
        outputs: Names of its outputs.

    Raises:
        ConfigError: The weights are too large for ONNX, or ONNX cannot express the graph.
    """

    def __init__(self, program: ExportedProgram, outputs: Sequence[str]) -> None:
        self.outputs = tuple(outputs)
        size = sum(value.nbytes for value in program.state_dict.values())
        if size > _LARGEST:
            raise ConfigError(f"ONNX holds 2 GB, the weights are {size / 1e9:.1f}: torch_export")
        resize = torch.ops.aten
        table: dict[Callable[..., Any], Callable[..., Any]] = {
            resize._upsample_bilinear2d_aa.default: _resize("bilinear"),
            resize._upsample_bicubic2d_aa.default: _resize("bicubic"),
        }
        try:
            with no_stack_traces():
                exported = torch.onnx.export(
                    program,
                    input_names=INPUTS,
                    output_names=self.outputs,
                    dynamo=True,
                    verbose=False,
                    custom_translation_table=table,
                )
        except torch.onnx.errors.OnnxExporterError as error:
            raise ConfigError(
                "ONNX has no graph of the model for frames of any size: give it, size=[H,W]; or "
                "give format=torch_export"
            ) from error
        assert exported is not None
        self.model = exported.model_proto
        #: Nodes of resizing, whose matrices are not weights and are not quantised.
        # told by their metadata, so before `_clean` drops it
        marks = ("upsample_", f"{Squash.__module__}.{Squash.__qualname__}")
        self._fixed = [
            node.name
            for node in self.model.graph.node
            if any(mark in entry.value for entry in node.metadata_props for mark in marks)
        ]
        _clean(self.model)

    def quantise(self, path: Path) -> None:
        """Quantises the weights of linear layers to int8, one scale per column, in place.

        Activations are quantised to 8 bits at run time, one scale per tensor.
        """
        # unsigned weights: the kernel of signed ones saturates on CPUs without VNNI (AVX2 alone,
        # onnxruntime's quantisation page), which cost half as much accuracy again
        quantize_dynamic(
            self.model,
            path,
            op_types_to_quantize=["MatMul", "Gemm"],
            per_channel=True,
            weight_type=QuantType.QUInt8,
            nodes_to_exclude=self._fixed,
        )
        self.model = onnx.load(path)

    def save(self, path: Path, text: str = "") -> None:
        """Writes the file with its metadata text."""
        onnx.helper.set_model_props(self.model, {KEY: text})
        onnx.save(self.model, path)

    def load(self, path: Path) -> Run:
        """Loads the file as a function, by onnxruntime on the CPU."""
        session = onnxruntime.InferenceSession(path, providers=["CPUExecutionProvider"])

        def run(*inputs: Tensor) -> Outputs:
            feed = {name: x.numpy() for name, x in zip(INPUTS, inputs, strict=True)}
            return tuple(map(torch.from_numpy, session.run(self.outputs, feed)))

        return run


def _clean(model: Any) -> None:
    """Names the dynamic axes, and drops metadata of the exporter with local paths."""
    graph = model.graph
    for thing in (graph, *graph.node, *graph.input, *graph.output, *graph.initializer):
        del thing.metadata_props[:]
    del graph.value_info[:]
    axes = graph.input[0].type.tensor_type.shape.dim
    names = {axes[i].dim_param: name for i, name in ((0, "batch"), (3, "height"), (4, "width"))}
    for value in (*graph.input, *graph.output):
        for axis in value.type.tensor_type.shape.dim:
            if axis.dim_param:
                axis.dim_param = names[axis.dim_param]


def _resize(mode: str) -> Callable[..., Any]:
    """Translates anti-aliased resizing to a product with one matrix per side.

    The operator Resize of onnxruntime rounds its weights differently from torch: pixels differ by
    2e-5, and tokens of a base model by 2e-4.
    """

    def translate(
        self: Any,
        output_size: Any,
        align_corners: bool,
        scales_h: float | None = None,
        scales_w: float | None = None,
    ) -> Any:
        sides = []
        for axis, wanted in zip((-2, -1), output_size, strict=True):
            size = self.shape[axis]
            if isinstance(size, int):
                # torch's own weights: what it makes of the unit matrix
                unit, shape = torch.eye(size)[None, None], (int(wanted), size)
                weights = F.interpolate(unit, shape, mode=mode, antialias=True)
                matrix = _constant(weights[0, 0].numpy())
            elif mode == "bilinear":
                start = self.shape.rank() + axis
                matrix = _any_weights(op.Shape(self, start=start, end=start + 1), int(wanted))
            else:
                raise NotImplementedError("bicubic for any size; give size=[H,W]")
            sides.append(matrix)
        rows, columns = sides
        return op.MatMul(rows, op.MatMul(self, op.Transpose(columns, perm=[1, 0])))

    return translate


def _any_weights(size: Any, wanted: int) -> Any:
    """Bilinear weights for a size (int64, one number) known only at run time.

    Weights are a triangle at each centre, as wide as a pixel of the result, but at least as wide as
    a pixel of the frame. Each step is rounded to float32 in the same order as in torch.
    """
    unit = _constant(np.float32(1))
    half = _constant(np.float32(0.5))
    scale = op.Div(op.Cast(size, to=onnx.TensorProto.FLOAT), _constant(np.float32(wanted)))
    centre = op.Mul(scale, _constant(np.arange(wanted, dtype=np.float32)[:, None] + 0.5))
    zero, step = _constant(np.int64(0)), _constant(np.int64(1))
    pixels = op.Range(zero, op.Squeeze(size), step)
    away = op.Add(op.Sub(op.Cast(pixels, to=onnx.TensorProto.FLOAT), centre), half)
    away = op.Mul(away, op.Div(unit, op.Max(scale, unit)))
    weights = op.Relu(op.Sub(unit, op.Abs(away)))
    return op.Div(weights, op.ReduceSum(weights, _constant(np.array([1])), keepdims=1))


def _constant(value: Any) -> Any:
    return op.Constant(value=onnx.numpy_helper.from_array(np.asarray(value)))
