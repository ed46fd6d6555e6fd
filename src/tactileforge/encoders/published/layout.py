"""Published layouts of weights, and their conversion to ours: all tensors, or an error."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from math import isqrt
from typing import Any, TypeAlias

import torch
from torch import Tensor

from tactileforge.encoders.transformer import SIZES
from tactileforge.errors import ConfigError

State: TypeAlias = Mapping[str, Tensor]
#: Sizes of a tensor; None is any.
Shape: TypeAlias = tuple[int | None, ...]
#: Our name -> theirs, or several of theirs, which are joined along their first axis.
Keys: TypeAlias = dict[str, str | tuple[str, ...]]


@dataclass(frozen=True)
class ConversionPlan:
    """Plan by which one file becomes an encoder.

    Attributes:
        encoder: Name of the encoder plugin.
        options: Its constructor's arguments.
        keys: Which of their tensors makes which of ours.
        change: What is done to a tensor of ours after it is gathered, by our name.
    """

    encoder: str
    options: dict[str, Any]
    keys: Keys
    change: dict[str, Callable[[Tensor], Tensor]] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class WeightLayout:
    """A published layout of a checkpoint.

    Attributes:
        name: Ours, e.g. ``anytouch2``.
        title: As people know it.
        marks: Tensors that tell it, with their shapes; the first one finds the prefix.
        plan: Makes the plan of a file, given its tensors without the prefix.
        prefixes: What the encoder's tensors may be called before their name, the likeliest first.
        beside: A tensor of the training program that tells it from a layout with the same marks.
        unused: Pattern of a name below the prefix -> why it is not needed.
        outside: Why what is not below the prefix is not needed.
    """

    name: str
    title: str
    marks: Mapping[str, Shape]
    plan: Callable[[State], ConversionPlan]
    prefixes: tuple[str, ...] = ("",)
    beside: str = ""
    unused: Mapping[str, str] = field(default_factory=dict)
    outside: str = "not part of the touch encoder"

    def locate(self, state: State) -> tuple[str, list[str]]:
        """The prefix under which most marks are found, and the marks that are not."""
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
        """Each prefix as it stands in the file, where something may come before it."""
        yield from self.prefixes
        first = next(iter(self.marks))
        for prefix in filter(None, self.prefixes):
            for key in state:
                if key.endswith("." + prefix + first):
                    yield key.removesuffix(first)

    def why_unused(self, key: str) -> str | None:
        """The reason for which a tensor below the prefix is not needed; None if it is."""
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
    """Our tensors: float32, contiguous, sharing no memory with theirs.

    Raises:
        ConfigError: Shapes of theirs that do not go together; names them.
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
    """Their names that a key map uses."""
    return [
        name for value in keys.values() for name in ([value] if isinstance(value, str) else value)
    ]


def blocks(ours: str, theirs: str, depth: int, names: Mapping[str, str | tuple[str, ...]]) -> Keys:
    """The key map of a stack of blocks.

    Args:
        ours: Our name of the stack.
        theirs: Theirs.
        depth: Number of blocks.
        names: Our module in a block -> theirs. ``{}`` in theirs stands for ``weight`` and
            ``bias``, and is the name's end if it is not written.
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
    """The key map of modules with weight and bias: our name -> theirs."""
    return {f"{a}.{kind}": f"{b}.{kind}" for a, b in names.items() for kind in ("weight", "bias")}


def depth_of(state: State, stack: str) -> int:
    """Number of blocks in a stack ``stack.0``, ``stack.1``, ...

    Raises:
        ConfigError: There is none.
    """
    start = f"{stack}."
    numbers = {key.removeprefix(start).split(".")[0] for key in state if key.startswith(start)}
    depth = 1 + max((int(number) for number in numbers if number.isdigit()), default=-1)
    if not depth:
        raise ConfigError(f"no blocks: missing {start}0, {start}1, ...")
    return depth


def size_of_width(width: int, what: str) -> str:
    """The size with a width: the number of heads is known for these alone.

    Raises:
        ConfigError: Another width.
    """
    for size, (known, _, _) in SIZES.items():
        if known == width:
            return size
    widths = ", ".join(str(known) for known, _, _ in SIZES.values())
    raise ConfigError(f"{what}: tokens are {width} wide; published models have {widths}")


def square(count: int, what: str) -> int:
    """The side of a square grid of ``count`` patches.

    Raises:
        ConfigError: It is not square.
    """
    side = isqrt(count)
    if side * side != count:
        raise ConfigError(f"{what}: {count} positions of patches are not a square grid")
    return side


def first_names(names: Sequence[str], most: int = 5) -> str:
    """The first names, and how many there are."""
    more = f", ... ({len(names)} in all)" if len(names) > most else ""
    return ", ".join(names[:most]) + more
