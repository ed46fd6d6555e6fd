"""AnyTouch 2 and AnyTouch 1: Hugging Face's CLIP with sensor tokens and tubes of frames."""

from __future__ import annotations

from typing import Any

from torch import Tensor

from tactileforge.encoders import ANYTOUCH2, IMAGENET_MEAN, IMAGENET_STD, PUBLISHED_SENSORS
from tactileforge.errors import ConfigError
from tactileforge_published.clip import HF_BLOCK
from tactileforge_published.layout import (
    ConversionPlan,
    Keys,
    State,
    WeightLayout,
    blocks,
    depth_of,
    first_names,
    gather_tensors,
    norms,
    size_of_width,
    source_keys,
)

_IMAGE = 224  # pixels; the files do not hold it
#: Trained rows of the sensor table. Row 5 is reserved for DM-Tac, unused in AnyTouch 2's training.
_SENSORS = {name: row for name, row in PUBLISHED_SENSORS.items() if row < 5}
#: Seconds between frames at 30 Hz: every second frame, every sixth, every frame.
_SPACING = {4: 2 / 30, 2: 6 / 30, 3: 1 / 30}
_IMAGENET: dict[str, Any] = {
    "offset": None,
    "fit": "squash",
    "filter": "bilinear",
    "mean": IMAGENET_MEAN,
    "std": IMAGENET_STD,
}
_PATCH = "touch_model.embeddings.patch_embedding.weight"
_VIDEO = "video_patch_embedding.weight"
_POSITION = "touch_model.embeddings.position_embedding.weight"
_LAYERS = "touch_model.encoder.layers"
_REST: Keys = {
    "sensor_table": "sensor_token",
    "class_token": "touch_model.embeddings.class_embedding",
    "position": _POSITION,
    "project.weight": "touch_projection.weight",
}
_REST |= norms({"norm_in": "touch_model.pre_layrnorm", "norm_out": "touch_model.post_layernorm"})


def _plan(
    state: State, patch: str, frames: int, tube: int, pixels: dict[str, Any]
) -> ConversionPlan:
    depth = depth_of(state, _LAYERS)
    projected, width = state["touch_projection.weight"].shape
    rows, tokens, _ = state["sensor_token"].shape
    options = {
        "size": size_of_width(width, "AnyTouch"),
        "depth": depth,
        "frames": frames,
        "spacing": _SPACING[frames],
        "image_size": _IMAGE,
        "patch": state[patch].shape[-1],
        "tube": tube,
        "projected": projected,
        "sensor_tokens": tokens,
        "sensor_rows": rows,
        "sensors": dict(_SENSORS),
        "pixels": dict(pixels),
    }
    keys = _REST | {"embed.weight": patch}
    keys |= blocks("transformer.blocks", _LAYERS, depth, HF_BLOCK)
    return ConversionPlan("tactile_vit", options, keys)


def _anytouch2(state: State) -> ConversionPlan:
    positions = len(state[_POSITION]) - 1
    slots, rest = divmod(positions, (_IMAGE // state[_PATCH].shape[-1]) ** 2)
    if rest or 2 * slots not in (2, 4):
        raise ConfigError(
            f"AnyTouch 2 has 196 positions a slot, and 1 or 2 slots; this file has {positions}"
        )
    plan = _plan(state, _PATCH, 2 * slots, 2, ANYTOUCH2)
    plan.change["embed.weight"] = lambda x: x.flatten(1)
    return plan


def _anytouch1(state: State) -> ConversionPlan:
    plan = _plan(state, _VIDEO if _VIDEO in state else _PATCH, 3, 3, _IMAGENET)
    # Its convolution takes time for its input channels and runs over colours.
    plan.change["embed.weight"] = lambda x: x.transpose(1, 2).flatten(1)
    return plan


_QUERIES = "head.pooler.query_tokens"
_HEAD = {
    "pooler.norm1": "head.pooler.cross_attention_block.norm1",
    "pooler.q": "head.pooler.cross_attention_block.xattn.q",
    "pooler.kv": "head.pooler.cross_attention_block.xattn.kv",
    "pooler.out": "head.pooler.cross_attention_block.xattn.proj",
    "pooler.norm2": "head.pooler.cross_attention_block.norm2",
    "pooler.mlp.0": "head.pooler.cross_attention_block.mlp.fc1",
    "pooler.mlp.2": "head.pooler.cross_attention_block.mlp.fc2",
    "probe.0": "head.probe.0",
    "probe.2": "head.probe.2",
}


def force_head(state: State) -> dict[str, Tensor]:
    """Force head of an AnyTouch 2 checkpoint, as a state dict of `heads.force.ForceDecoder`.

    It has one query and 16 attention heads.

    Args:
        state: Tensors of the file; those below ``head.`` are read.

    Raises:
        ConfigError: Tensors of the head are missing or left over; the message lists them.
    """
    keys: Keys = {"pooler.queries": _QUERIES, **norms(_HEAD)}
    return _head(keys, state, "the force head of AnyTouch 2")


def _found_head(state: State) -> dict[str, Tensor] | None:
    # a head for classes may have a pooler too, but only the force head has a second layer of probe
    has_head = {_QUERIES, "head.probe.2.weight"} <= state.keys()
    return force_head(state) if has_head else None


def _head(keys: Keys, state: State, what: str) -> dict[str, Tensor]:
    theirs = {key: tensor for key, tensor in state.items() if key.startswith("head.")}
    missing = sorted(set(source_keys(keys)) - theirs.keys())
    unexpected = sorted(theirs.keys() - set(source_keys(keys)))
    if missing or unexpected:
        raise ConfigError(
            f"not {what}; missing: {first_names(missing) or 'nothing'}; unexpected: "
            f"{first_names(unexpected) or 'nothing'}"
        )
    return gather_tensors(ConversionPlan("", {}, keys), theirs)


def class_head(state: State) -> dict[str, Tensor]:
    """Head for classes of an AnyTouch 2 checkpoint, under our names.

    `heads.published.PublishedProbe` loads a head with a pooler (Cloth), and
    `heads.classify.ClassifyHead` a linear one on the projected class token (Touch and Go).

    Args:
        state: Tensors of the file; those below ``head.`` are read.

    Raises:
        ConfigError: Tensors of the head are missing or left over; the message lists them.
    """
    keys: Keys = norms({"linear": "head"})
    if _QUERIES in state:
        names = {key: value for key, value in _HEAD.items() if not key.startswith("probe")}
        keys = {"pooler.queries": _QUERIES, **norms({**names, "linear": "head.probe.0"})}
    return _head(keys, state, "the head of AnyTouch 2 for classes")


_MARKS = {"sensor_token": (None, None, None), "touch_projection.weight": (None, None)}
_PREFIXES = ("touch_mae_model.", "tactile_model.", "")
_UNUSED = {
    "*decoder*": "decoders of pre-training",
    "*mask_token*": "decoders of pre-training",
    "*position_ids": "0, 1, 2, ...",
    "head.*": "head of a downstream task",
}
_OUTSIDE = "other parts of the multi-modal model"

LAYOUTS = (
    WeightLayout(
        name="anytouch2",
        title="AnyTouch 2",
        marks={_PATCH: (None, 3, 2, None, None), **_MARKS, _POSITION: (None, None)},
        plan=_anytouch2,
        prefixes=_PREFIXES,
        unused=_UNUSED,
        outside=_OUTSIDE,
        head=_found_head,
    ),
    WeightLayout(
        name="anytouch1",
        title="AnyTouch 1",
        marks={_VIDEO: (None, 3, 3, None, None), **_MARKS, _POSITION: (None, None)},
        plan=_anytouch1,
        prefixes=_PREFIXES,
        unused=_UNUSED
        | {
            _PATCH: "CLIP's patches; those of video take their place",
            "video_position_embedding.weight": "made, but not used by AnyTouch 1",
        },
        outside=_OUTSIDE,
        head=_found_head,
    ),
    WeightLayout(
        name="anytouch1",
        title="AnyTouch 1 (its probe's encoder)",
        marks={_PATCH: (None, 3, 3, None, None), **_MARKS, _POSITION: (None, None)},
        plan=_anytouch1,
        prefixes=_PREFIXES,
        unused=_UNUSED,
        outside=_OUTSIDE,
        head=_found_head,
    ),
)
