"""Helpers of the checks of encoders, heads and objectives."""

from __future__ import annotations

from collections.abc import Mapping
from copy import deepcopy
from dataclasses import dataclass, fields, is_dataclass, replace
from functools import lru_cache
from typing import Any

import torch
from torch import Tensor, nn

from tactileforge.contracts import Batch, Features, MaskedFeatures, Views
from tactileforge.plugins import registry
from tactileforge.testing.results import require


def small_context(seed: int = 0, frames: int = 4, image: int = 32) -> dict[str, Any]:
    """A small touch encoder and small towers, under the names of the framework's context.

    They are drawn once and copied after, with the random generator as the drawing left it.
    """
    made, state = _drawn(seed, frames, image)
    torch.set_rng_state(state)
    return deepcopy(made)


@lru_cache(8)
def _drawn(seed: int, frames: int, image: int) -> tuple[dict[str, Any], Tensor]:
    torch.manual_seed(seed)
    touch = {"name": "tactile_vit", "size": "tiny", "frames": frames, "image_size": image}
    vit = {"name": "vit", "depth": 1}
    made = {
        "encoder": registry.build("encoders", {**touch, "depth": 2}),
        "text_encoder": registry.build("encoders", {"name": "byte", "depth": 1}),
        "image_encoder": registry.build("encoders", vit),
        "teacher": registry.build("encoders", {**vit, "frozen": True}),
    }
    return made, torch.get_rng_state()


_DECODER = {"width": 32, "depth": 1, "heads": 2}
#: Options of heads that feed what is checked, by name: whole, they would take most of the time.
SMALL_HEADS: dict[Any, dict[str, Any]] = {
    "pixel": _DECODER,
    "diff": _DECODER,
    "jepa": _DECODER,
    "dino": {"prototypes": 64, "hidden": 64, "bottleneck": 16},
}


@dataclass(frozen=True)
class FrozenViews:
    """Computed views, without gradients, with access to single samples."""

    patches: Tensor
    full: Features
    masked: MaskedFeatures
    source: Views

    @classmethod
    def of(cls, views: Views) -> FrozenViews:
        """Computes the views of a batch, without gradients."""
        with torch.no_grad():
            return cls(views.patches, views.full, views.masked, views)

    def other(self, batch: Batch, kept: Tensor | None = None) -> FrozenViews:
        """Views of another batch; see `contracts.Views.other`."""
        return FrozenViews.of(self.source.other(batch, kept))

    def rows(self, rows: slice) -> FrozenViews:
        """Selects samples of the batch."""
        return self.with_tensors({key: value[rows] for key, value in self.tensors().items()})

    def tensors(self) -> dict[str, Tensor]:
        """All tensors, each with one row per sample."""
        return {
            "patches": self.patches,
            "tokens": self.full.tokens,
            "cls": self.full.cls,
            "visible": self.masked.tokens,
            "summary": self.masked.cls,
            "kept": self.masked.kept,
            "masked": self.masked.masked,
        }

    def with_tensors(self, of: Mapping[str, Tensor]) -> FrozenViews:
        """The same views made of other tensors; see `tensors`."""
        full = replace(self.full, tokens=of["tokens"], cls=of["cls"])
        masked = replace(
            self.masked,
            tokens=of["visible"],
            cls=of["summary"],
            kept=of["kept"],
            masked=of["masked"],
        )
        return FrozenViews(of["patches"], full, masked, self.source)


def views_of(encoder: Any, batch: Batch) -> FrozenViews:
    """The views of a batch; the same for the same encoder and batch."""
    torch.manual_seed(0)
    return FrozenViews.of(encoder.views(batch))


def leaves(value: Any) -> list[Tensor]:
    """Tensors in a prediction of nested dataclasses, dicts, lists and tuples, in order."""
    if isinstance(value, Tensor):
        return [value]
    if is_dataclass(value):
        value = [getattr(value, field.name) for field in fields(value)]
    if isinstance(value, Mapping):
        value = list(value.values())
    if isinstance(value, list | tuple):
        return [leaf for item in value for leaf in leaves(item)]
    return []


def finite(values: list[Tensor]) -> bool:
    """Whether every number is finite."""
    return all(bool(torch.isfinite(value).all()) for value in values)


def require_equal(first: list[Tensor], second: list[Tensor], message: str) -> None:
    """Fails unless the tensors are the same, bit by bit."""
    same = len(first) == len(second) and all(map(torch.equal, first, second))
    require(bool(first) and same, message)


def require_close(first: list[Tensor], second: list[Tensor], message: str) -> None:
    """Fails unless shapes are the same and numbers agree within 1e-4, relative to the largest."""
    require(bool(first) and len(first) == len(second), f"{message}: other outputs")
    for a, b in zip(first, second, strict=True):
        require(a.shape == b.shape, f"{message}: {tuple(a.shape)}, not {tuple(b.shape)}")
        gap = float((a.double() - b.double()).abs().max()) if a.numel() else 0.0
        size = float(b.double().abs().max()) if b.numel() else 0.0
        # batches of other sizes and exported programs add up float32 in another order
        require(gap <= 1e-4 * max(1.0, size), f"{message}: they differ by {gap:.2g}")


def require_row(batched: list[Tensor], single: list[Tensor]) -> None:
    """Fails unless a batch of one gives the first row of a larger batch.

    Axes along which a prediction grows with the batch (pairs have two) are cut to their first
    entry.
    """
    message = "a batch of 1 and the same row in a batch of 4"
    require(bool(single) and len(batched) == len(single), f"{message}: other outputs")
    cut = [
        large[tuple(map(slice, small.shape))] if large.ndim == small.ndim else large
        for large, small in zip(batched, single, strict=True)
    ]
    require_close(single, cut, message)


def reloaded(source: nn.Module, target: nn.Module) -> None:
    """Saves one module as safetensors and loads it strictly into the other."""
    from safetensors.torch import load, save

    # safetensors takes contiguous tensors alone
    state = {key: value.contiguous() for key, value in source.state_dict().items()}
    target.load_state_dict(load(save(state)), strict=True)


def require_export(module: nn.Module, arguments: tuple[Any, ...]) -> None:
    """Fails unless ``torch.export`` accepts a module and its program gives the same numbers."""
    import warnings

    module.eval()
    with torch.no_grad(), warnings.catch_warnings():
        warnings.simplefilter("ignore")  # torch.export warns about its own internals
        program = torch.export.export(module, arguments)
        torch.manual_seed(0)  # a head may draw: both draw the same
        exported = leaves(program.module()(*arguments))
        torch.manual_seed(0)
        eager = leaves(module(*arguments))
    require_close(exported, eager, "the exported program and the module")
