"""The graph of an encoder, by ``torch.export``, and its comparison on synthetic clips."""

from __future__ import annotations

import io
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

import torch
import torch.fx.config
from torch import Tensor
from torch.export import Dim, ExportedProgram
from torch.nn import functional as F

from tactileforge.errors import ConfigError
from tactileforge_export.facts import KEY

Clips: TypeAlias = tuple[Tensor, Tensor, Tensor]
Outputs: TypeAlias = tuple[Tensor, ...]
Run: TypeAlias = Callable[[Tensor, Tensor, Tensor], Outputs]

INPUTS = ("frames", "background", "sensor")
#: Sizes of the batches for the comparison.
BATCHES = (1, 3)


@dataclass(frozen=True)
class Gap:
    """Deviation of the outputs of a graph from those of the module.

    Attributes:
        largest: Largest absolute difference of any output value.
        relative: Length of the difference of ``cls`` over the length of ``cls``, of the worst
            batch.
        cosine: Cosine between both ``cls``, of the worst clip.
    """

    largest: float
    relative: float
    cosine: float


def sizes_of(
    encoder: Any, size: tuple[int, int] | None, small: bool = False
) -> list[tuple[int, int]]:
    """Frame sizes for the comparison of a graph with its module.

    Args:
        encoder: Touch encoder.
        size: Height and width of frames of the graph, pixels; None if it takes any.
        small: Whether to include the encoder's own size and a smaller one, for a graph of any size.
    """
    if size is not None:
        return [size]
    height, width = encoder.image_size
    # other aspects and odd numbers, where a resizing that is slightly off shows
    larger = [(height + 24, width + 56), (2 * height + 9, width + 5)]
    return larger + ([(height, width), (height - 3, width // 2)] if small else [])


def synthetic_clips(encoder: Any, batch: int, size: tuple[int, int]) -> Clips:
    """Deterministic synthetic clips: a smooth background, a smooth growing change, and noise.

    Args:
        encoder: Touch encoder, for the number of frames and the sensors.
        batch: Number of clips, B.
        size: Height H and width W, pixels.

    Returns:
        Frames uint8 (B, T, 3, H, W), background uint8 (B, 3, H, W), and sensors int64 (B,), which
        cycle through all known rows.
    """
    rng = torch.Generator().manual_seed(batch)

    def smooth(*shape: int) -> Tensor:
        coarse = torch.randn(*shape, 6, 6, generator=rng).flatten(0, -4)
        return F.interpolate(coarse, size, mode="bicubic").view(*shape, *size)

    # smooth as a gel is lit, with the noise of a camera
    still = 128 + 30 * smooth(batch, 3)
    growth = (torch.arange(encoder.frames) + 1).view(-1, 1, 1, 1) / encoder.frames
    noise = 8 * torch.randn(batch, encoder.frames, 3, *size, generator=rng)
    frames = still[:, None] + 40 * growth * smooth(batch, 1, 3) + noise
    rows = sorted(set(encoder.sensors.values())) or [0]
    sensor = torch.tensor([rows[i % len(rows)] for i in range(batch)])
    return frames.clamp(0, 255).byte(), still.clamp(0, 255).byte(), sensor


def compare_outputs(
    run: Run,
    encoder: Any,
    sizes: Sequence[tuple[int, int]],
    done: Callable[[], object] = lambda: None,
) -> Gap:
    """Compares a graph with the module on batches of several sizes; calls ``done`` after each."""
    largest, relative, cosine = 0.0, 0.0, 1.0
    for inputs in _batches(encoder, sizes):
        with torch.no_grad():
            expected, outputs = encoder(*inputs), run(*inputs)
        # forces are NaN for a sensor without a scale: they must be NaN in the graph too
        for mine, theirs in zip(expected, outputs, strict=True):
            strange = theirs.isfinite() != mine.isfinite() if mine.shape == theirs.shape else None
            if strange is None or strange.any():
                return Gap(float("inf"), float("inf"), -1.0)
            largest = max(largest, float((mine - theirs).nan_to_num().abs().max()))
        change = (expected[1] - outputs[1]).norm() / expected[1].norm()
        relative = max(relative, float(change))
        cosine = min(cosine, float(F.cosine_similarity(expected[1], outputs[1]).min()))
        done()
    return Gap(largest, relative, cosine)


def _batches(encoder: Any, sizes: Sequence[tuple[int, int]]) -> Iterator[Clips]:
    for size in sizes:
        for batch in BATCHES:
            yield synthetic_clips(encoder, batch, size)


@contextmanager
def no_stack_traces() -> Iterator[None]:
    """Traces graphs without a line of code per node, in a fifth of the time."""
    config = torch.fx.config
    before = getattr(config, "do_not_emit_stack_traces", False)  # torch 2.6 has no such option
    config.do_not_emit_stack_traces = True
    try:
        yield
    finally:
        config.do_not_emit_stack_traces = before


def trace(encoder: Any, size: tuple[int, int] | None) -> ExportedProgram:
    """Traces the graph for any number of clips, and for one or any image size.

    Args:
        encoder: Touch encoder in eval mode.
        size: Height and width of the frames, pixels; None for any above the encoder's own.

    Raises:
        ConfigError: The graph cannot be made, or depends on the size of frames; says why.
    """
    sizes = sizes_of(encoder, size)
    batch, height, width = Dim("batch"), None, None
    if size is None:
        native = encoder.image_size
        # above the encoder's own size: at it the graph has no resizing
        height, width = Dim("height", min=native[0] + 1), Dim("width", min=native[1] + 1)
    shapes = ({0: batch, 3: height, 4: width}, {0: batch, 2: height, 3: width}, {0: batch})
    try:
        # strict=True, or `len` of a tensor would fix the number of clips
        # two clips: torch.export takes a size of 0 or 1 for a constant
        with no_stack_traces():
            program = torch.export.export(
                encoder, synthetic_clips(encoder, 2, sizes[0]), dynamic_shapes=shapes, strict=True
            )
        if size is None:
            run = program.module()
            for inputs in _batches(encoder, sizes):
                run(*inputs)
    except (AssertionError, RuntimeError, ValueError) as error:
        if size is None:
            text = "the model's graph depends on the size of the frames: give it, size=[H,W]"
        else:
            reason = str(error).strip().splitlines()[0]
            text = f"no graph of the model takes frames of {size[0]} x {size[1]}: {reason}"
        raise ConfigError(text) from error
    for node in program.graph.nodes:
        node.meta.pop("stack_trace", None)  # it holds paths of this machine
    return program


class ProgramFile:
    """A graph as a file of ``torch.export``.

    Args:
        program: Graph made by `trace`.
    """

    def __init__(self, program: ExportedProgram) -> None:
        self.program = program

    def save(self, path: Path, text: str = "") -> None:
        """Writes the file with its metadata text."""
        whole = io.BytesIO()  # in memory: torch ends the process if writing a file fails
        torch.export.save(self.program, whole, extra_files={KEY: text})
        path.write_bytes(whole.getbuffer())

    def load(self, path: Path) -> Run:
        """Loads the file as a function."""
        run: Run = torch.export.load(io.BytesIO(path.read_bytes())).module()
        return run
