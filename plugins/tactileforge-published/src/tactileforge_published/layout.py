"""Published layouts of weights, and their complete conversion to ours."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from math import isqrt
from typing import Any, TypeAlias

import torch
from torch import Tensor

from tactileforge.encoders import VIT_SIZES
from tactileforge.errors import ConfigError

State: TypeAlias = Mapping[str, Tensor]
#: Sizes of a tensor; None for any size.
Shape: TypeAlias = tuple[int | None, ...]
#: Published name of each tensor of ours; several are concatenated along their first axis.
Keys: TypeAlias = dict[str, str | tuple[str, ...]]


@dataclass(frozen=True)
class ConversionPlan:
    """Plan of the conversion of one file to an encoder.

    Attributes:
        encoder: Name of the encoder plugin.
        options: Arguments of its constructor.
        keys: Published names of tensors, by our name.
        change: Functions applied to gathered tensors, by our name.
    """

    encoder: str
    options: dict[str, Any]
    keys: Keys
    change: dict[str, Callable[[Tensor], Tensor]] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class WeightLayout:
    """A published layout of a checkpoint.

    Attributes:
        name: Our name of the layout, e.g. ``anytouch2``.
        title: Name for readers, e.g. ``AnyTouch 2``.
        marks: Tensors that identify the layout, with their shapes; the first one finds the prefix.
        plan: Function from the tensors of a file, without the prefix, to a plan.
        prefixes: Possible prefixes of the encoder's tensors, the likeliest first.
        beside: Tensor of the training program that distinguishes it from a layout with the same
            marks; "" for none.
        unused: Reasons why tensors below the prefix are not needed, by pattern of their names.
        outside: Reason why tensors outside of the prefix are not needed.
        head: Function from the tensors of a file to the state dict of its force head, or to None;
            None for layouts without one.
    """

    name: str
    title: str
    marks: Mapping[str, Shape]
    plan: Callable[[State], ConversionPlan]
    prefixes: tuple[str, ...] = ("",)
    beside: str = ""
    unused: Mapping[str, str] = field(default_factory=dict)
    outside: str = "not part of the touch encoder"
    head: Callable[[State], dict[str, Tensor] | None] | None = None

    def locate(self, state: State) -> tuple[str, list[str]]:
        """Finds the prefix with the most marks, and the missing marks."""
        best = self.prefixes[0], [_mark(*mark) for mark in self.marks.items()]
        for prefix in self._prefixes(state):
            lost = [
                _mark(key, shape)
                for key, shape in self.marks.items()
                if not _fits(state.get(prefix + key), shape)
            ]
            if len(lost) < len(best[1]):
                best = prefix, lost
        if self.beside and not any(key.endswith(self.beside) for key in state):
            best[1].append(self.beside)
        return best

    def _prefixes(self, state: State) -> Iterator[str]:
        """The prefixes, and their longer forms in the file, such as ``model.PREFIX``."""
        yield from self.prefixes
        first = next(iter(self.marks))
        for prefix in filter(None, self.prefixes):
            for key in state:
                if key.endswith("." + prefix + first):
                    yield key.removesuffix(first)

    def why_unused(self, key: str) -> str | None:
        """Reason why a tensor below the prefix is not needed; None if it is needed."""
        return next((why for name, why in self.unused.items() if fnmatchcase(key, name)), None)


def _mark(key: str, shape: Shape) -> str:
    return f"{key} ({', '.join('any' if size is None else str(size) for size in shape)})"


def _fits(tensor: Tensor | None, shape: Shape) -> bool:
    return (
        tensor is not None
        and tensor.ndim == len(shape)
        and all(want in (None, size) for size, want in zip(tensor.shape, shape, strict=True))
    )


def gather_tensors(plan: ConversionPlan, state: State) -> dict[str, Tensor]:
    """Gathers our tensors: float32, contiguous, sharing no memory with the file's.

    Raises:
        ConfigError: Shapes in the file do not fit together; the message lists them.
    """
    made = {}
    for ours, theirs in plan.keys.items():
        names = [theirs] if isinstance(theirs, str) else theirs
        parts = [state[name] for name in names]
        try:
            tensor = torch.cat(parts) if len(parts) > 1 else parts[0]
            tensor = plan.change.get(ours, Tensor.contiguous)(tensor.float())
        except (RuntimeError, IndexError) as error:
            shapes = ", ".join(f"{name} {tuple(state[name].shape)}" for name in names)
            raise ConfigError(f"shapes that do not fit: {shapes}") from error
        made[ours] = tensor.clone(memory_format=torch.contiguous_format)
    return made


def source_keys(keys: Keys) -> list[str]:
    """Published names used by a key map."""
    return [
        name for value in keys.values() for name in ([value] if isinstance(value, str) else value)
    ]


def blocks(ours: str, theirs: str, depth: int, names: Mapping[str, str | tuple[str, ...]]) -> Keys:
    """Key map of a stack of blocks.

    Args:
        ours: Our name of the stack.
        theirs: Published name of the stack.
        depth: Number of blocks.
        names: Published names of the modules of a block, by our name. ``{}`` in a published name
            stands for ``weight`` or ``bias``; without it they are appended.
    """
    return {
        f"{ours}.{i}.{mine}.{kind}": _named(f"{theirs}.{i}", yours, kind)
        for i in range(depth)
        for mine, yours in names.items()
        for kind in ("weight", "bias")
    }


def _named(stack: str, names: str | tuple[str, ...], kind: str) -> str | tuple[str, ...]:
    if isinstance(names, tuple):
        return tuple(f"{stack}.{name}.{kind}" for name in names)
    return f"{stack}.{names.format(kind) if '{}' in names else f'{names}.{kind}'}"


def norms(names: Mapping[str, str]) -> Keys:
    """Key map of modules with weight and bias, from our names to the published ones."""
    return {f"{a}.{kind}": f"{b}.{kind}" for a, b in names.items() for kind in ("weight", "bias")}


def depth_of(state: State, stack: str) -> int:
    """Number of blocks in a stack ``stack.0``, ``stack.1``, ...

    Raises:
        ConfigError: There is no block.
    """
    start = f"{stack}."
    numbers = {key.removeprefix(start).split(".")[0] for key in state if key.startswith(start)}
    # by the last block, and not their number: a missing one is then an error of its own
    depth = 1 + max((int(number) for number in numbers if number.isdigit()), default=-1)
    if not depth:
        raise ConfigError(f"no blocks: missing {start}0, {start}1, ...")
    return depth


def size_of_width(width: int, what: str) -> str:
    """Name of the size with a width, since weights do not tell the number of heads.

    Raises:
        ConfigError: No size has this width.
    """
    for size, (known, _, _) in VIT_SIZES.items():
        if known == width:
            return size
    widths = ", ".join(str(known) for known, _, _ in VIT_SIZES.values())
    raise ConfigError(f"{what}: tokens are {width} wide; published models have {widths}")


def square(count: int, what: str) -> int:
    """The side of a square grid of ``count`` patches.

    Raises:
        ConfigError: ``count`` is not a square number.
    """
    side = isqrt(count)
    if side * side != count:
        raise ConfigError(f"{what}: {count} positions of patches are not a square grid")
    return side


def first_names(names: Sequence[str], most: int = 5) -> str:
    """The first names as text, with the total number if there are more."""
    more = f", ... ({len(names)} in all)" if len(names) > most else ""
    return ", ".join(names[:most]) + more
