"""Published touch encoders as ours: read the user's own download, recognise it, convert it.

Nothing is left random and nothing is left over: each tensor of a file is used or named as not
needed, each tensor of the encoder is filled, or there is an error that lists what is wrong::

    converted = convert(read("checkpoint-4frames.pth"))
    encoder = converted.build()
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from tactileforge import registry
from tactileforge.encoders.backbone import Backbone
from tactileforge.encoders.plain_vit import PlainViT
from tactileforge.encoders.published import anytouch, clip, sparsh, t3, tvl, unitouch
from tactileforge.encoders.published.anytouch import class_head, force_head
from tactileforge.encoders.published.files import read_tensors
from tactileforge.encoders.published.layout import (
    ConversionPlan,
    State,
    WeightLayout,
    first_names,
    gather_tensors,
    source_keys,
)
from tactileforge.encoders.tactile_vit import TactileViT
from tactileforge.errors import ConfigError, unknown

__all__ = [
    "LAYOUTS",
    "Converted",
    "WeightLayout",
    "class_head",
    "convert",
    "force_head",
    "read_tensors",
    "recognise",
]

#: Every layout that can be imported. The first that fits is taken: AnyTouch's files hold a CLIP.
LAYOUTS: tuple[WeightLayout, ...] = (
    *anytouch.LAYOUTS,
    *sparsh.LAYOUTS,
    t3.LAYOUT,
    unitouch.LAYOUT,
    tvl.LAYOUT,
    *clip.LAYOUTS,
)
#: Tensors that tell a head for classes.
_CLASS_HEADS = {"head.weight", "head.probe.0.weight"}
_CLASSES: dict[str, type[Backbone]] = {"tactile_vit": TactileViT, "plain_vit": PlainViT}


@dataclass(frozen=True)
class Converted:
    """A published encoder under our names.

    Attributes:
        name: Name of its layout, e.g. ``anytouch2``.
        encoder_config: ``name`` of the encoder plugin, and its constructor's arguments.
        state: What it loads, strictly.
        unused: Why tensors of the file are not needed -> their names.
        head: The published force head, if the file has one: what
            ``tactileforge.heads.force.ForceDecoder(width, 1, 16)`` loads, strictly.
        probe: The published head for classes, if it has one, see `class_head`.
    """

    name: str
    encoder_config: dict[str, Any]
    state: dict[str, Tensor]
    unused: dict[str, list[str]]
    head: dict[str, Tensor] | None = None
    probe: dict[str, Tensor] | None = None

    @property
    def report(self) -> str:
        """Tensors that were taken and those that were not, in words."""
        count = sum(tensor.numel() for tensor in self.state.values()) / 1e6
        options = self.encoder_config
        what = f"{options['size']}, {options['depth']} blocks, {options['frames']} frames"
        lines = [f"{self.name}: {what}; {len(self.state)} tensors, {count:.1f} M numbers"]
        if self.head is not None:
            lines.append(f"force head: {len(self.head)} tensors")
        lines += [f"not needed, {why}: {first_names(names)}" for why, names in self.unused.items()]
        return "\n".join(lines)

    def build(self) -> Backbone:
        """The encoder with its weights, in evaluation mode."""
        options = {key: value for key, value in self.encoder_config.items() if key != "name"}
        encoder = _CLASSES[self.encoder_config["name"]](**options)
        encoder.load_state_dict(self.state, strict=True)
        return encoder.eval()


def recognise(state: State) -> WeightLayout:
    """Recognises the published layout of a file by names and shapes of its tensors.

    Args:
        state: See `read_tensors`.

    Raises:
        ConfigError: None; lists the nearest layouts and what they lack.
    """
    candidates = [(layout, *layout.locate(state)) for layout in LAYOUTS]
    for layout, _, lost in candidates:
        if not lost:
            return layout
    if any("head.pooler.query_tokens" in key for key in state):
        raise ConfigError(
            "this file holds a force head of AnyTouch 2 but no encoder: import "
            "checkpoint-4frames.pth, and read the head with published.force_head"
        )
    candidates.sort(key=lambda row: len(row[2]) / len(row[0].marks))
    near = "; ".join(f"{x.title} lacks {first_names(lost, 3)}" for x, _, lost in candidates[:3])
    raise ConfigError(
        f"not a published touch encoder that can be imported: it has {first_names(sorted(state))}. "
        f"Nearest: {near}"
    )


def convert(state: State, options: Mapping[str, Any] | None = None) -> Converted:
    """A published file as one of our encoders.

    Args:
        state: See `read_tensors`.
        options: Constructor arguments of the encoder that replace those inferred, e.g.
            ``{"activation": "quick_gelu"}`` for OpenAI's CLIP weights.

    Raises:
        ConfigError: The layout is not known; or tensors are missing, left over, of the wrong shape
            or not finite: the message lists them.
    """
    layout = recognise(state)
    prefix, _ = layout.locate(state)
    inner = {k.removeprefix(prefix): v for k, v in state.items() if k.startswith(prefix)}
    plan = _plan(layout, inner)
    known = registry.parameters(_CLASSES[plan.encoder])
    for key in options or {}:
        if key not in known:
            raise ConfigError(unknown(f"option of encoder {plan.encoder!r}", key, known))
    plan.options.update(options or {})
    used = set(source_keys(plan.keys))
    unused: dict[str | None, list[str]] = defaultdict(list)
    for key in sorted(state.keys() - {prefix + key for key in used}):
        inside = key.startswith(prefix)
        why = layout.why_unused(key.removeprefix(prefix)) if inside else layout.outside
        unused[why].append(key)
    unexpected = unused.pop(None, [])
    missing = [prefix + key for key in used - inner.keys()]
    _refuse_other_numbers(layout, {prefix + key: inner[key] for key in used & inner.keys()})
    made = {} if missing else gather_tensors(plan, inner)
    _refuse(layout, missing, unexpected, [] if missing else _wrong(plan, made))
    is_anytouch = layout.name.startswith("anytouch")
    has_head = is_anytouch and {"head.pooler.query_tokens", "head.probe.2.weight"} <= state.keys()
    has_probe = is_anytouch and not has_head and bool(_CLASS_HEADS & state.keys())
    return Converted(
        layout.name,
        {"name": plan.encoder, **plan.options},
        made,
        {why: names for why, names in unused.items() if why},
        force_head(state) if has_head else None,
        class_head(state) if has_probe else None,
    )


def _plan(layout: WeightLayout, state: State) -> ConversionPlan:
    try:
        return layout.plan(state)
    except (IndexError, KeyError, RuntimeError, TypeError, ValueError) as error:
        raise ConfigError(
            f"not a whole {layout.title} file; its tensors do not go together ({error!r})"
        ) from error


def _refuse_other_numbers(layout: WeightLayout, state: State) -> None:
    """Raises a ConfigError where weights are whole or complex numbers."""
    strange = [f"{key} ({x.dtype})" for key, x in state.items() if not x.is_floating_point()]
    if strange:
        names = first_names(sorted(strange))
        raise ConfigError(f"not a {layout.title} file: weights are real numbers, not {names}")


def _wrong(plan: ConversionPlan, made: dict[str, Tensor]) -> list[str]:
    """Tensors that the encoder lacks or has in another shape, and numbers that are none."""
    with torch.device("meta"):
        expected = _CLASSES[plan.encoder](**plan.options).state_dict()
    wrong = [f"{key} is not filled" for key in expected.keys() - made.keys()]
    for key, tensor in made.items():
        if key not in expected:
            wrong.append(f"{key} is not in the encoder")
        elif tensor.shape != expected[key].shape:
            theirs = plan.keys[key]
            wrong.append(f"{theirs} gives {tuple(tensor.shape)}, not {tuple(expected[key].shape)}")
        elif not torch.isfinite(tensor).all():
            wrong.append(f"{plan.keys[key]} is not finite")
    return wrong


def _refuse(
    layout: WeightLayout, missing: list[str], unexpected: list[str], wrong: list[str]
) -> None:
    lists = {"missing": missing, "unexpected": unexpected, "shapes": wrong}
    if problems := [
        f"{what}: {first_names(sorted(names))}" for what, names in lists.items() if names
    ]:
        raise ConfigError(f"not a whole {layout.title} file; {'; '.join(problems)}")
