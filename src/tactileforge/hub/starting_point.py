"""Weights of a model as the start of a new run."""

from __future__ import annotations

from typing import Any

from torch import Tensor

from tactileforge.encoders.efficientnet_lite import Lite0
from tactileforge.hub.loading import load


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
