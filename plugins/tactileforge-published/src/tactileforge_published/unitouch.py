"""UniTouch: a trunk in the manner of ImageBind, aligned with its images."""

from __future__ import annotations

from tactileforge_published.clip import single_frame
from tactileforge_published.layout import (
    ConversionPlan,
    Keys,
    State,
    WeightLayout,
    blocks,
    depth_of,
    norms,
)

_INPUT = "modality_preprocessors.touch"
_EMBED = f"{_INPUT}.rgbt_stem.proj.1.weight"
_POSITION = f"{_INPUT}.pos_embedding_helper.pos_embed"
_TRUNK = "modality_trunks.touch.blocks"
_HEAD = "modality_heads.touch"
_SCALE = "modality_postprocessors.touch.1.log_logit_scale"
_BLOCK: dict[str, str | tuple[str, ...]] = {
    "norm1": "norm_1",
    "attention.qkv": "attn.in_proj_{}",
    "attention.out": "attn.out_proj",
    "norm2": "norm_2",
    "mlp.0": "mlp.fc1",
    "mlp.2": "mlp.fc2",
}


def _plan(state: State) -> ConversionPlan:
    depth = depth_of(state, _TRUNK)
    projected, width = state[f"{_HEAD}.2.weight"].shape
    positions = state[_POSITION].shape[1]
    options = single_frame(width, depth, positions, state[_EMBED].shape[-1], "UniTouch")
    options |= {"projected": projected, "norm_in": False, "eps": 1e-6, "bias_kv": True}
    # Vectors are normalised and multiplied by this; the published program uses 5 for a file
    # without it.
    options["length"] = (
        round(float(state[_SCALE].float().exp().clamp(max=100)), 4) if _SCALE in state else 5.0
    )
    keys: Keys = {
        "class_token": f"{_INPUT}.cls_token",
        "position": _POSITION,
        "embed.weight": _EMBED,
        "project.weight": f"{_HEAD}.2.weight",
    }
    keys |= norms({"norm_out": f"{_HEAD}.0"}) | blocks("transformer.blocks", _TRUNK, depth, _BLOCK)
    change = {
        "class_token": lambda x: x.flatten(),
        "position": lambda x: x[0],
        # UniTouch repeats its one frame to fill a tube of two, so the weights of both add up
        "embed.weight": lambda x: x.sum(2).flatten(1),
    }
    for i in range(depth):
        name = f"transformer.blocks.{i}.attention.bias_kv"
        keys[name] = (f"{_TRUNK}.{i}.attn.bias_k", f"{_TRUNK}.{i}.attn.bias_v")
        change[name] = lambda x: x.flatten(1)
    return ConversionPlan("tactile_vit", options, keys, change)


LAYOUT = WeightLayout(
    name="unitouch",
    title="UniTouch",
    marks={
        _EMBED: (None, 3, 2, None, None),
        _POSITION: (1, None, None),
        f"{_TRUNK}.0.attn.bias_k": (1, 1, None),
        f"{_HEAD}.2.weight": (None, None),
    },
    plan=_plan,
    prefixes=("model.", ""),
    unused={_SCALE: "kept as the length of its vectors"}
    | {
        f"modality_*.{other}.*": "other modalities"
        for other in ("vision", "text", "audio", "depth", "thermal", "imu")
    },
)
