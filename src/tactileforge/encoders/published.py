"""Published weights under our names: a key map for each layout, and nothing left random."""

from __future__ import annotations

from collections.abc import Mapping

import torch
from torch import Tensor

#: Published name of AnyTouch 2 -> ours, outside the blocks.
_ANYTOUCH2 = {
    "sensor_token": "sensor_table",
    "touch_model.embeddings.class_embedding": "class_token",
    "touch_model.embeddings.position_embedding.weight": "position",
    "touch_model.pre_layrnorm.weight": "norm_in.weight",
    "touch_model.pre_layrnorm.bias": "norm_in.bias",
    "touch_model.post_layernorm.weight": "norm_out.weight",
    "touch_model.post_layernorm.bias": "norm_out.bias",
    "touch_projection.weight": "project.weight",
}
_BLOCK = {
    "layer_norm1": "norm1",
    "self_attn.out_proj": "attention.out",
    "layer_norm2": "norm2",
    "mlp.fc1": "mlp.0",
    "mlp.fc2": "mlp.2",
}


def anytouch2(published: Mapping[str, Tensor]) -> dict[str, Tensor]:
    """Renames AnyTouch 2's published touch encoder to a `TactileViT` state.

    Queries, keys and values are fused; the Conv3d of the patch embedding becomes a matrix;
    ``new_position_ids`` (always 0, 1, 2, ...) is dropped.

    Args:
        published: The file's tensors, without the ``touch_mae_model.`` prefix.

    Returns:
        A state that `TactileViT.load_state_dict` takes strictly.

    Raises:
        KeyError: A tensor is missing; names it.
    """
    state = {ours: published[theirs] for theirs, ours in _ANYTOUCH2.items()}
    state["embed.weight"] = published["touch_model.embeddings.patch_embedding.weight"].flatten(1)
    layers = "touch_model.encoder.layers."
    depth = 1 + max(int(k.split(".")[3]) for k in published if k.startswith(layers))
    for i in range(depth):
        source, target = f"{layers}{i}", f"transformer.blocks.{i}"
        for kind in ("weight", "bias"):
            for theirs, ours in _BLOCK.items():
                state[f"{target}.{ours}.{kind}"] = published[f"{source}.{theirs}.{kind}"]
            state[f"{target}.attention.qkv.{kind}"] = torch.cat(
                [published[f"{source}.self_attn.{x}_proj.{kind}"] for x in "qkv"]
            )
    return state
