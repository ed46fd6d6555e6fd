"""Taps: features from one pass of an encoder."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Literal, get_args

from torch import Tensor, nn

from tactileforge.encoders.backbone import Backbone
from tactileforge.encoders.summary import encode_summary
from tactileforge.errors import ConfigError, unknown

Tap = Literal[
    "projected",
    "cls",
    "tokens",
    "hidden",
    "normed",
    "projected_tokens",
    "global",
    "patches",
    "summary",
]
TAPS: tuple[str, ...] = get_args(Tap)
#: Taps that the class token alone gives.
_CLASS = ("projected", "cls")


def check_tap(encoder: Any, tap: str) -> None:
    """Raises a ConfigError if an encoder lacks a tap; says which it has."""
    if tap not in TAPS:
        raise ConfigError(unknown("tap", tap, TAPS))
    if tap == "cls" and encoder.prefix == 0:
        raise ConfigError("the model has no class token: take tap=projected or tap=tokens")
    needs = {"hidden", "normed", "projected_tokens", "global"}
    if tap in needs and not isinstance(getattr(encoder, "norm_out", None), nn.LayerNorm):
        raise ConfigError(f"the encoder has no last norm: tap={tap} is for those that have one")


def is_plain(encoder: Any) -> bool:
    """Whether the encoder uses `Backbone.forward`; one with its own is called through it."""
    return getattr(encoder.forward, "__func__", None) is Backbone.forward


def read_tap(encoder: Any, tap: str, *inputs: Tensor) -> Tensor:
    """A pass of an encoder, read at a tap.

    Args:
        encoder: The touch encoder.
        tap: See `Model.features`.
        inputs: Frames, backgrounds and sensor rows, see `Backbone.forward`.
    """
    # the last block computes the class token alone, which is less work
    if tap in _CLASS and is_plain(encoder):
        first, projected = encoder.class_tokens(*inputs)
        out: Tensor = first if tap == "cls" else projected
        return out
    if tap == "summary":
        return encode_summary(encoder, *inputs)[2]
    tokens, projected, before = _pass(encoder, tap, *inputs)
    if tap in ("hidden", "normed", "projected_tokens", "global"):
        return _READ[tap](encoder, tokens if before is None else before)
    if tap == "patches":
        return tokens[:, encoder.prefix :].reshape(len(tokens), *encoder.grid, -1)
    return {"tokens": tokens, "cls": tokens[:, 0], "projected": projected}[tap]


def blocks_of(encoder: Any) -> list[nn.Module]:
    """Blocks of an encoder, in their order: of its transformer, or the stages of a network."""
    found = getattr(getattr(encoder, "transformer", None), "blocks", None)
    if found is None:
        # of the longest list of modules: a network's own name for its stages may be any
        lists = [x for x in encoder.modules() if isinstance(x, nn.ModuleList | nn.Sequential)]
        found = max(lists, key=len, default=())
    return list(found)


def read_layers(encoder: Any, layers: Sequence[int], *inputs: Tensor) -> list[Tensor]:
    """Outputs of some blocks, from one pass of an encoder.

    Args:
        encoder: The touch encoder.
        layers: Numbers of blocks; -1 is the last.
        inputs: Frames, backgrounds and sensor rows, see `Backbone.forward`.

    Raises:
        ConfigError: There is no such block, or its output is not a tensor.
    """
    blocks = blocks_of(encoder)
    count = len(blocks)
    wrong = [x for x in layers if type(x) is not int or not -count <= x < count]
    if wrong or not layers:
        known = f"{-count} to {count - 1}" if count else "none: its encoder has no blocks"
        raise ConfigError(f"layers={list(layers)!r}: give numbers of blocks, {known}")
    states: dict[int, Tensor] = {}
    hooks = []
    for row in {x % count for x in layers}:

        def keep(_module: Any, _given: Any, state: Any, row: int = row) -> None:
            states[row] = state

        hooks.append(blocks[row].register_forward_hook(keep))
    try:
        encoder(*inputs)
    finally:
        for hook in hooks:
            hook.remove()
    chosen = [states.get(x % count) for x in layers]
    if not all(isinstance(x, Tensor) for x in chosen):
        raise ConfigError("layers: a block of this encoder gives no tensor; take tap= instead")
    return [x for x in chosen if x is not None]


def _pass(encoder: Any, tap: str, *inputs: Tensor) -> tuple[Tensor, Tensor, Tensor | None]:
    """Tokens, projected class tokens, and the tokens before the norm if they are normed."""
    if not getattr(encoder, "norm_tokens", False) or tap in ("tokens", "patches", *_CLASS):
        return (*encoder(*inputs), None)
    before: list[Tensor] = []
    # the encoder norms its tokens itself: the hook keeps what it norms
    hook = encoder.norm_out.register_forward_pre_hook(lambda _, given: before.append(given[0]))
    try:
        tokens, projected = encoder(*inputs)
    finally:
        hook.remove()
    return tokens, projected, before[0]


#: From the last hidden state, (B, L, width), before the last norm.
_READ: dict[str, Callable[[Any, Tensor], Tensor]] = {
    "hidden": lambda encoder, hidden: hidden,
    "normed": lambda encoder, hidden: encoder.norm_out(hidden),
    "projected_tokens": lambda encoder, hidden: encoder.project(encoder.norm_out(hidden)),
    "global": lambda encoder, hidden: encoder.project(hidden[:, encoder.prefix :]).mean(1),
}
