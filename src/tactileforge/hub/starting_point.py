"""Weights of a model that a new run starts from."""

from __future__ import annotations

from typing import Any

from torch import Tensor

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
