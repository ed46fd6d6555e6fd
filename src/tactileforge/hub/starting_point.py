"""Weights of a model as the start of a new run."""

from __future__ import annotations

from collections.abc import Mapping
from inspect import signature
from typing import Any

import torch
from torch import Tensor

from tactileforge.encoders.efficientnet_lite import Lite0
from tactileforge.encoders.tactile_vit import TactileViT
from tactileforge.encoders.transformer import VIT_SIZES
from tactileforge.errors import ConfigError
from tactileforge.hub.loading import load

#: Options in which a network of pictures and one of frames have to agree.
_OF_PICTURES = ("size", "depth", "image_size", "patch", "projected", "activation", "norm_in")


def starting_weights(name: str) -> tuple[dict[str, Any], dict[str, Tensor]]:
    """Options of a model's encoder, and its weights under the names of a run's checkpoint.

    Args:
        name: ``NAME.TAG`` or ``NAME`` of the zoo, ``file:PATH``, or ``pixels``: no weights.

    Returns:
        The plugin and constructor arguments of the encoder; tensors named ``encoder.*`` and, of the
        heads that the file has, ``heads.NAME.*``.

    Raises:
        TactileForgeError: See `loading.load`.
    """
    if name == "pixels":
        return {"name": name}, {}
    model = load(name)
    modules = {"encoder": model.encoder}
    modules |= {f"heads.{key}": head for key, head in model.heads.items()}
    state = {
        f"{prefix}.{key}": tensor
        for prefix, module in modules.items()
        for key, tensor in module.state_dict().items()
    }
    return dict(model.header.encoder), state


def inflated(
    name: str,
    node: Mapping[str, Any],
    state: Mapping[str, Tensor],
    encoder: Mapping[str, Any],
) -> dict[str, Tensor]:
    """Weights of a `TactileViT` of single pictures, such as CLIP's, for one of several frames.

    A patch of several frames starts as the mean of them, as a picture's patch, and each slot in
    time with the positions of the picture. The table of sensors is not among them.

    Args:
        name: Name of the model, for errors.
        node: Its encoder, of one frame.
        state: Its weights, as `starting_weights` has them.
        encoder: Options of the encoder of several frames.

    Raises:
        ConfigError: The encoders differ in more than their frames; names the options.

    Source:
        Carreira and Zisserman, "Quo Vadis, Action Recognition?", CVPR 2017, section 2.2.
    """
    usual = {key: one.default for key, one in signature(TactileViT).parameters.items()}
    theirs, ours = usual | dict(node), usual | dict(encoder)
    for options in (theirs, ours):  # None is the depth of the size
        options["depth"] = options["depth"] or VIT_SIZES[options["size"]][1]
    other = {key: theirs[key] for key in _OF_PICTURES if theirs[key] != ours[key]}
    if other:
        fix = " ".join(f"encoder.{key}={value}" for key, value in other.items())
        raise ConfigError(
            f"init={name}: its pictures go into an encoder of its size; give {fix}, or init=null"
        )
    tube = int(ours["tube"])
    slots = int(ours["frames"]) // tube
    out = dict(state)
    embed = state["encoder.embed.weight"]
    pixels = embed.reshape(
        len(embed), 3, 1, -1
    )  # colour before time, as `Backbone.patchify` has it
    out["encoder.embed.weight"] = (pixels / tube).expand(-1, -1, tube, -1).flatten(1).contiguous()
    position = state["encoder.position"]
    out["encoder.position"] = torch.cat([position[:1], position[1:].repeat(slots, 1)])
    return out


def starting_heads(name: str) -> dict[str, Any]:
    """Plugin and constructor arguments of the heads in `starting_weights`, by name."""
    heads = {} if name == "pixels" else load(name).header.heads
    return {key: found["node"] for key, found in heads.items()}


def imagenet_weights(prefix: str) -> dict[str, Tensor]:
    """Weights of ImageNet for a network of photographs, as `starting_weights` has them.

    Args:
        prefix: Name of the network in a run, such as ``encoder.photo_stream.network``.

    Raises:
        PluginError: They are not installed; see `Lite0.load_published`.
    """
    network = Lite0()
    network.load_published()
    return {f"{prefix}.{key}": value for key, value in network.state_dict().items()}
