"""Import of published touch encoders: reads the user's download, recognises and converts it.

Each tensor of a file is used or known to be unneeded, and each tensor of the encoder is filled;
otherwise an error lists the exceptions::

    converted = convert(read("checkpoint-4frames.pth"))
    encoder = converted.build()
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from tactileforge.encoders import Backbone, PlainViT, TactileViT
from tactileforge.errors import ConfigError, check_names
from tactileforge.plugins import registry
from tactileforge_published import (
    anytouch,
    clip,
    feelanyforce,
    sparsh,
    sparsh_x,
    t3,
    tvl,
    unit,
    unitouch,
    univtac,
)
from tactileforge_published.anytouch import class_head, force_head
from tactileforge_published.files import read_tensors
from tactileforge_published.layout import (
    ConversionPlan,
    State,
    WeightLayout,
    first_names,
    gather_tensors,
    source_keys,
)
from tactileforge_published.refused import REFUSED
from tactileforge_published.resnet import ResNet18
from tactileforge_published.vqgan import VqganEncoder

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

#: Layouts that can be imported. The first match is taken, so AnyTouch comes before CLIP: its files
#: also hold a CLIP.
LAYOUTS: tuple[WeightLayout, ...] = (
    *anytouch.LAYOUTS,
    *sparsh.LAYOUTS,
    sparsh_x.LAYOUT,
    feelanyforce.LAYOUT,
    t3.LAYOUT,
    unitouch.LAYOUT,
    tvl.LAYOUT,
    univtac.LAYOUT,
    unit.LAYOUT,
    *clip.LAYOUTS,
)
#: Tensor of the temperature of alignment.
_SCALE = "logit_scale"
#: Tensors of a head for classes.
_CLASS_HEADS = {"head.weight", "head.probe.0.weight"}
_CLASSES: dict[str, type[Backbone]] = {
    "tactile_vit": TactileViT,
    "plain_vit": PlainViT,
    "resnet18": ResNet18,
    "vqgan": VqganEncoder,
}


@dataclass(frozen=True)
class Converted:
    """A published encoder under our names.

    Attributes:
        name: Name of the layout, e.g. ``anytouch2``.
        encoder_config: ``name`` of the encoder plugin, and arguments of its constructor.
        state: State dict of the encoder, to load strictly.
        unused: Names of unneeded tensors of the file, by reason.
        head: State dict of the published force head, to load strictly into
            ``tactileforge.heads.force.ForceDecoder(width, 1, 16)``, or for FeelAnyForce into
            ``tactileforge_published.heads.regressor_decoder(width)``; None without one.
        probe: State dict of the published head for classes, see `class_head`; None without one.
        temperature: Temperature of its alignment with other modalities; None where the file keeps
            none.
    """

    name: str
    encoder_config: dict[str, Any]
    state: dict[str, Tensor]
    unused: dict[str, list[str]]
    head: dict[str, Tensor] | None = None
    probe: dict[str, Tensor] | None = None
    temperature: float | None = None

    @property
    def report(self) -> str:
        """Summary in words of the used and unused tensors."""
        count = sum(tensor.numel() for tensor in self.state.values()) / 1e6
        options = self.encoder_config
        shape = f"{options['size']}, {options['depth']} blocks" if "size" in options else ""
        what = f"{shape or options['name']}, {options['frames']} frames"
        lines = [f"{self.name}: {what}; {len(self.state)} tensors, {count:.1f} M numbers"]
        if self.head is not None:
            lines.append(f"force head: {len(self.head)} tensors")
        lines += [f"not needed, {why}: {first_names(names)}" for why, names in self.unused.items()]
        return "\n".join(lines)

    def build(self) -> Backbone:
        """Builds the encoder with its weights, in evaluation mode."""
        options = {key: value for key, value in self.encoder_config.items() if key != "name"}
        encoder = _CLASSES[self.encoder_config["name"]](**options)
        encoder.load_state_dict(self.state, strict=True)
        return encoder.eval()


def recognise(state: State) -> WeightLayout:
    """Recognises the published layout of a file by names and shapes of its tensors.

    Args:
        state: Tensors of the file, see `read_tensors`.

    Raises:
        ConfigError: No layout matches; says what the file is if it is known (`refused`), else lists
            the nearest layouts and their missing tensors.
    """
    candidates = [(layout, *layout.locate(state)) for layout in LAYOUTS]
    for layout, _, lost in candidates:
        if not lost:
            return layout
    # after the layouts: a file that is refused looks like one of them
    for known in REFUSED:
        if known.fits(state):
            raise ConfigError(known.reason)
    candidates.sort(key=lambda row: len(row[2]) / len(row[0].marks))
    near = "; ".join(f"{x.title} lacks {first_names(lost, 3)}" for x, _, lost in candidates[:3])
    raise ConfigError(
        f"not a published touch encoder that can be imported: it has {first_names(sorted(state))}. "
        f"Nearest: {near}"
    )


def convert(state: State, options: Mapping[str, Any] | None = None) -> Converted:
    """Converts a published file to one of our encoders.

    Args:
        state: Tensors of the file, see `read_tensors`.
        options: Constructor arguments of the encoder, in place of inferred ones, e.g.
            ``{"activation": "quick_gelu"}`` for OpenAI's CLIP weights.

    Raises:
        ConfigError: The layout is unknown, or tensors are missing, left over, of the wrong shape or
            not finite; the message lists them.
    """
    layout = recognise(state)
    prefix, _ = layout.locate(state)
    inner = {k.removeprefix(prefix): v for k, v in state.items() if k.startswith(prefix)}
    plan = _plan(layout, inner)
    known = registry.parameters(_CLASSES[plan.encoder])
    check_names(f"option of encoder {plan.encoder!r}", options or {}, known)
    plan.options.update(options or {})
    used = set(source_keys(plan.keys))
    unused: dict[str | None, list[str]] = defaultdict(list)
    for key in sorted(state.keys() - {prefix + key for key in used}):
        inside = key.startswith(prefix)
        why = layout.why_unused(key.removeprefix(prefix)) if inside else layout.outside
        unused[why].append(key)
    unexpected = unused.pop(None, [])
    missing = [prefix + key for key in used - inner.keys()]
    # whole numbers and complex ones would be cast to float without a word
    kinds = {prefix + key: inner[key].dtype for key in used & inner.keys()}
    if strange := [f"{key} ({x})" for key, x in kinds.items() if not x.is_floating_point]:
        names = first_names(sorted(strange))
        raise ConfigError(f"not a {layout.title} file: weights are real numbers, not {names}")
    # all faults of a file in one error: what is absent cannot be gathered, or have a shape
    made = {} if missing else gather_tensors(plan, inner)
    _refuse(layout, missing, unexpected, [] if missing else _wrong(plan, made))
    head = layout.head(state) if layout.head else None
    is_anytouch = layout.name.startswith("anytouch")
    has_probe = is_anytouch and head is None and bool(_CLASS_HEADS & state.keys())
    return Converted(
        layout.name,
        {"name": plan.encoder, **plan.options},
        made,
        {why: names for why, names in unused.items() if why},
        head,
        class_head(state) if has_probe else None,
        _temperature(state),
    )


def _temperature(state: State) -> float | None:
    """Temperature of training: CLIP and those after it keep the logarithm of its inverse."""
    kept = state.get(_SCALE)
    if kept is None or kept.numel() != 1:
        return None
    temperature = float(torch.exp(-kept.double()))
    return temperature if 0 < temperature < math.inf else None


def _plan(layout: WeightLayout, state: State) -> ConversionPlan:
    try:
        return layout.plan(state)
    except (IndexError, KeyError, RuntimeError, TypeError, ValueError) as error:
        raise ConfigError(
            f"not a whole {layout.title} file; its tensors do not go together ({error!r})"
        ) from error


def _shapes(encoder: str, options: Mapping[str, Any]) -> dict[str, torch.Size]:
    with torch.device("meta"):
        state = _CLASSES[encoder](**options).state_dict()
    return {key: tensor.shape for key, tensor in state.items()}


def _wrong(plan: ConversionPlan, made: dict[str, Tensor]) -> list[str]:
    """Describes missing or unknown tensors, mismatched shapes, and non-finite numbers."""
    expected = _shapes(plan.encoder, plan.options)
    wrong = [f"{key} is not filled" for key in expected.keys() - made.keys()]
    for key, tensor in made.items():
        if key not in expected:
            wrong.append(f"{key} is not in the encoder")
        elif tensor.shape != expected[key]:
            theirs = plan.keys[key]
            wrong.append(f"{theirs} gives {tuple(tensor.shape)}, not {tuple(expected[key])}")
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
