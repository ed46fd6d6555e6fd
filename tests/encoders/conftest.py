"""Published layouts as tables of names and shapes, and numbers to fill them with."""

import sys
from collections.abc import Mapping
from types import ModuleType

import pytest
import torch
from torch import Tensor

Shapes = dict[str, tuple[int, ...]]


def noise(count: int, i: int) -> Tensor:
    """frac(sin(12.9898 j + 78.233 i) * 43758.5453) - 0.5 in float64."""
    j = torch.arange(count, dtype=torch.float64)
    x = torch.sin(12.9898 * j + 78.233 * i) * 43758.5453
    return x - x.floor() - 0.5


def fill(shapes: Mapping[str, tuple[int, ...]]) -> dict[str, Tensor]:
    """Weights of a plausible size, decided by names and shapes alone."""
    state = {}
    for i, (key, shape) in enumerate(sorted(shapes.items())):
        size = torch.Size(shape)
        r = noise(size.numel(), i)
        if key.endswith("weight") and len(shape) > 1 and not key.endswith("embedding.weight"):
            value = r * (12 / (size.numel() / shape[0])) ** 0.5
        elif len(shape) > 1:
            value = 0.1 * r
        else:
            value = 1 + 0.2 * r if key.endswith(("weight", "gamma")) else 0.1 * r
        state[key] = value.reshape(shape).float()
        if key.endswith("position_ids"):
            state[key] = torch.arange(size.numel())[None]
    return state


def linears(stack: str, sizes: Mapping[str, tuple[int, int]]) -> Shapes:
    weights = {f"{stack}.{name}.weight": size for name, size in sizes.items()}
    return weights | {f"{stack}.{name}.bias": size[:1] for name, size in sizes.items()}


def norms(width: int, *names: str) -> Shapes:
    return {f"{name}.{kind}": (width,) for name in names for kind in ("weight", "bias")}


def hf_tower(tower: str, width: int, depth: int, patch: tuple[int, ...], positions: int) -> Shapes:
    shapes: Shapes = {
        f"{tower}.embeddings.class_embedding": (width,),
        f"{tower}.embeddings.patch_embedding.weight": (width, *patch),
        f"{tower}.embeddings.position_embedding.weight": (positions, width),
    } | norms(width, f"{tower}.pre_layrnorm", f"{tower}.post_layernorm")
    for i in range(depth):
        layer = f"{tower}.encoder.layers.{i}"
        shapes |= norms(width, f"{layer}.layer_norm1", f"{layer}.layer_norm2")
        names = ("q_proj", "k_proj", "v_proj", "out_proj")
        shapes |= linears(f"{layer}.self_attn", dict.fromkeys(names, (width, width)))
        shapes |= linears(f"{layer}.mlp", {"fc1": (4 * width, width), "fc2": (width, 4 * width)})
    return shapes


def anytouch2(frames: int, width: int = 768, depth: int = 12) -> Shapes:
    positions = frames // 2 * 196 + 1
    return hf_tower("touch_model", width, depth, (3, 2, 16, 16), positions) | {
        "sensor_token": (20, 5, width),
        "new_position_ids": (1, positions),
        "touch_projection.weight": (512, width),
    }


def anytouch1(width: int = 1024, depth: int = 24) -> Shapes:
    """The encoder of its probe, with CLIP's patches of video."""
    return hf_tower("touch_model", width, depth, (3, 3, 14, 14), 257) | {
        "sensor_token": (10, 5, width),
        "touch_projection.weight": (768, width),
    }


def timm_blocks(stack: str, width: int, depth: int) -> Shapes:
    shapes: Shapes = {}
    for i in range(depth):
        block = f"{stack}.{i}"
        shapes |= norms(width, f"{block}.norm1", f"{block}.norm2")
        shapes |= linears(block, {"attn.qkv": (3 * width, width), "attn.proj": (width, width)})
        shapes |= linears(block, {"mlp.fc1": (4 * width, width), "mlp.fc2": (width, 4 * width)})
    return shapes


def sparsh(
    patch: tuple[int, ...] = (6, 16, 16), registers: int = 0, width: int = 768, depth: int = 12
) -> Shapes:
    shapes = timm_blocks("blocks", width, depth) | norms(width, "norm")
    shapes |= {"patch_embed.proj.weight": (width, *patch), "patch_embed.proj.bias": (width,)}
    shapes |= {f"blocks.{i}.ls{j}.gamma": (width,) for i in range(depth) for j in (1, 2)}
    return shapes | ({"register_tokens": (1, registers, width)} if registers else {})


def clip_text(width: int = 64) -> Shapes:
    return {
        "text_model.embeddings.token_embedding.weight": (99, width),
        "text_model.embeddings.position_ids": (1, 77),
        "text_projection.weight": (512, width),
        "logit_scale": (),
    }


def openclip(width: int, depth: int) -> Shapes:
    shapes: Shapes = {
        "visual.class_embedding": (width,),
        "visual.positional_embedding": (17, width),
        "visual.conv1.weight": (width, 3, 16, 16),
        "visual.proj": (width, 512),
    } | norms(width, "visual.ln_pre", "visual.ln_post")
    for i in range(depth):
        block = f"visual.transformer.resblocks.{i}"
        shapes |= norms(width, f"{block}.ln_1", f"{block}.ln_2")
        shapes |= {f"{block}.attn.in_proj_weight": (3 * width, width)}
        shapes |= {f"{block}.attn.in_proj_bias": (3 * width,)}
        shapes |= linears(
            block,
            {
                "attn.out_proj": (width, width),
                "mlp.c_fc": (4 * width, width),
                "mlp.c_proj": (width, 4 * width),
            },
        )
    text = {"positional_embedding": (77, 64), "text_projection": (64, 512), "logit_scale": ()}
    return shapes | text


def tvl(width: int, depth: int) -> Shapes:
    shapes = timm_blocks("blocks", width, depth) | norms(width, "fc_norm")
    shapes |= linears("", {"head": (768, width)})
    shapes |= {"cls_token": (1, 1, width), "pos_embed": (1, 17, width)}
    shapes |= {"patch_embed.proj.weight": (width, 3, 16, 16), "patch_embed.proj.bias": (width,)}
    named = {f"tactile_encoder.{key.removeprefix('.')}": size for key, size in shapes.items()}
    return named | {"logit_scale": ()}


def t3(depths: tuple[int, int], *stems: str) -> Shapes:
    shapes = timm_blocks("trunk.blocks", 768, depths[1]) | norms(768, "trunk.norm")
    for stem in stems:
        name = f"encoders.{stem}"
        shapes |= timm_blocks(f"{name}.blocks", 768, depths[0])
        shapes |= {f"{name}.cls_token": (1, 1, 768), f"{name}.pos_embed": (1, 197, 768)}
        shapes |= {f"{name}.patch_embed.proj.weight": (768, 3, 16, 16)}
        shapes |= {f"{name}.patch_embed.proj.bias": (768,)}
    return shapes


def unitouch(width: int, depth: int) -> Shapes:
    shapes: Shapes = {
        "modality_preprocessors.touch.cls_token": (1, 1, width),
        "modality_preprocessors.touch.rgbt_stem.proj.1.weight": (width, 3, 2, 14, 14),
        "modality_preprocessors.touch.pos_embedding_helper.pos_embed": (1, 17, width),
        "modality_heads.touch.2.weight": (1024, width),
        "modality_postprocessors.touch.1.log_logit_scale": (),
        "modality_preprocessors.vision.cls_token": (1, 1, 1280),
        "modality_trunks.text.blocks.0.norm_1.weight": (1024,),
    } | norms(width, "modality_heads.touch.0")
    for i in range(depth):
        block = f"modality_trunks.touch.blocks.{i}"
        shapes |= norms(width, f"{block}.norm_1", f"{block}.norm_2")
        shapes |= {f"{block}.attn.in_proj_weight": (3 * width, width)}
        shapes |= {f"{block}.attn.in_proj_bias": (3 * width,)}
        shapes |= {f"{block}.attn.bias_{x}": (1, 1, width) for x in "kv"}
        shapes |= linears(block, {"attn.out_proj": (width, width)})
        shapes |= linears(block, {"mlp.fc1": (4 * width, width), "mlp.fc2": (width, 4 * width)})
    return {f"model.{key}": size for key, size in shapes.items()}


def under(prefix: str, shapes: Shapes) -> Shapes:
    return {prefix + key: size for key, size in shapes.items()}


def bands(width: int, axes: int) -> Tensor:
    count = -(-width // (2 * axes))
    return 10000 ** -(torch.linspace(0, 1, count + 1)[:-1]).expand(axes, -1)


@pytest.fixture(scope="session")
def published() -> ModuleType:
    """The functions of this file."""
    return sys.modules[__name__]
