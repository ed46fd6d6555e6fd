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
    x = torch.arange(count, dtype=torch.float64)  # in place: the largest file has 3e8 numbers
    x.mul_(12.9898).add_(78.233 * i).sin_().mul_(43758.5453)
    return x.sub_(x.floor()).sub_(0.5)


def fill(shapes: Mapping[str, tuple[int, ...]]) -> dict[str, Tensor]:
    """Weights of a plausible size, decided by names and shapes alone."""
    state = {}
    for i, (key, shape) in enumerate(sorted(shapes.items())):
        size = torch.Size(shape)
        r = noise(size.numel(), i)
        if key.endswith("weight_g"):
            value = 1 + 0.2 * r
        elif key.endswith("weight") and len(shape) > 1 and not key.endswith("embedding.weight"):
            value = r * (12 / (size.numel() / shape[0])) ** 0.5
        elif len(shape) > 1:
            value = 0.1 * r
        else:
            near_one = ("weight", "gamma", "running_var")
            value = 1 + 0.2 * r if key.endswith(near_one) else 0.1 * r
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


def dinov2(width: int, depth: int, side: int) -> Shapes:
    """The transformer refined by FeelAnyForce, with positions of a larger picture."""
    shapes = timm_blocks("blocks", width, depth) | norms(width, "norm")
    shapes |= {f"blocks.{i}.ls{j}.gamma": (width,) for i in range(depth) for j in (1, 2)}
    shapes |= {"cls_token": (1, 1, width), "pos_embed": (1, side * side + 1, width)}
    shapes |= {"patch_embed.proj.weight": (width, 3, 14, 14), "patch_embed.proj.bias": (width,)}
    return shapes | {"mask_token": (1, width)}


def feelanyforce(width: int = 192, depth: int = 2, side: int = 37) -> Shapes:
    """A whole file: the encoder, the head by its two sets of names, the decoder of depth."""
    sizes = {0: (512, width), 3: (256, 512), 6: (128, 256), 9: (64, 128), 12: (3, 64)}
    names = dict(
        zip(sizes, ("bottleneck1", "bottleneck2", "bottleneck3", "bottleneck4"), strict=False)
    )
    head: Shapes = {}
    for place, size in sizes.items():
        for name in (f"regressor.{place}", names.get(place, "linear")):
            head |= {f"{name}.bias": size[:1], f"{name}.weight_g": (size[0], 1)}
            head |= {f"{name}.weight_v": size}
        head |= {} if place == 12 else norms(size[0], f"regressor.{place + 1}")
    decoder = {"decoder.fc.weight": (8, width), "decoder.deconvs.0.weight": (2, 2, 5, 5)}
    touch = under("tactile_backbone.", dinov2(width, depth, side))
    return touch | under("regressor.", head) | decoder


def sparsh_x(width: int = 192, own: int = 2, shared: int = 1) -> Shapes:
    """The image model: blocks of the image, then those shared by all senses."""
    shapes = {}
    for key, size in timm_blocks("blocks", width, own).items():
        _, number, rest = key.split(".", 2)
        shapes[f"blocks.{number}.img.{rest}"] = size
    shapes |= timm_blocks("fusion_blocks", width, shared) | norms(width, "norm")
    names = [f"blocks.{i}.img" for i in range(own)] + [f"fusion_blocks.{i}" for i in range(shared)]
    shapes |= {f"{name}.ls{j}.gamma": (width,) for name in names for j in (1, 2)}
    shapes |= {"patch_embed.img.proj.weight": (width, 6, 16, 16)}
    shapes |= {"patch_embed.img.proj.bias": (width,), "register_tokens": (1, 1, width)}
    return shapes


def sparsh_x_numbers(width: int = 192) -> dict[str, Tensor]:
    """Its buffers: the published mean and deviation of both frames, and frequencies."""
    mean, deviation = (0.09562227, 0.26593734, 0.32464101), (0.08179263, 0.17255498, 0.18509875)
    numbers = {"img_avg": mean, "img_div": deviation}
    buffers = {key: torch.tensor([*row, *row]).view(6, 1, 1) for key, row in numbers.items()}
    return buffers | {"pos_embeds.img.frequency_bands": bands(width, 2)}


def univtac() -> Shapes:
    """A whole file: torchvision's ResNet-18 with 512 outputs, and decoders."""

    def norm(name: str, channels: int) -> Shapes:
        kinds = ("weight", "bias", "running_mean", "running_var")
        return {f"{name}.{kind}": (channels,) for kind in kinds}

    shapes: Shapes = {"conv1.weight": (64, 3, 7, 7)} | norm("bn1", 64)
    given = 64
    for stage, out in enumerate((64, 128, 256, 512), 1):
        for number in range(2):
            block = f"layer{stage}.{number}"
            shapes |= {f"{block}.conv1.weight": (out, given, 3, 3)} | norm(f"{block}.bn1", out)
            shapes |= {f"{block}.conv2.weight": (out, out, 3, 3)} | norm(f"{block}.bn2", out)
            if given != out:
                shapes |= {f"{block}.downsample.0.weight": (out, given, 1, 1)}
                shapes |= norm(f"{block}.downsample.1", out)
            given = out
    shapes |= {"fc.weight": (512, 512), "fc.bias": (512,)}
    decoders: Shapes = {"decoders.marker.ffn.2.weight": (126, 256), "decoders.rgb.fc.bias": (8,)}
    return under("backbone.", shapes) | decoders


def unit(channels: tuple[int, ...] = (32, 32, 64), attends: tuple[int, ...] = (2,)) -> Shapes:
    """A whole file: the encoder of a VQGAN, its code book, decoder and losses."""

    def conv(name: str, given: int, out: int, kernel: int) -> Shapes:
        return {f"{name}.weight": (out, given, kernel, kernel), f"{name}.bias": (out,)}

    def residual(name: str, given: int, out: int) -> Shapes:
        shapes = norms(given, f"{name}.norm1") | norms(out, f"{name}.norm2")
        shapes |= conv(f"{name}.conv1", given, out, 3) | conv(f"{name}.conv2", out, out, 3)
        return shapes | (conv(f"{name}.nin_shortcut", given, out, 1) if given != out else {})

    def attention(name: str, width: int) -> Shapes:
        shapes = norms(width, f"{name}.norm")
        for layer in ("q", "k", "v", "proj_out"):
            shapes |= conv(f"{name}.{layer}", width, width, 1)
        return shapes

    given, top = channels[0], channels[-1]
    shapes = conv("conv_in", 3, given, 3)
    for level, out in enumerate(channels):
        for number in range(2):
            shapes |= residual(f"down.{level}.block.{number}", given, out)
            shapes |= attention(f"down.{level}.attn.{number}", out) if level in attends else {}
            given = out
        if level < len(channels) - 1:
            shapes |= conv(f"down.{level}.downsample.conv", out, out, 3)
    shapes |= residual("mid.block_1", top, top) | residual("mid.block_2", top, top)
    shapes |= attention("mid.attn_1", top) | norms(top, "norm_out") | conv("conv_out", top, 3, 3)
    rest: Shapes = {"quantize.embedding.weight": (1024, 3), "loss.discriminator.main.0.bias": (4,)}
    rest |= {"decoder.conv_in.bias": (8,)} | conv("post_quant_conv", 3, 3, 1)
    return under("encoder.", shapes) | conv("quant_conv", 3, 3, 1) | rest


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
