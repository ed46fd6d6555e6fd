"""Weights of a model that a new run starts from."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from torch import Tensor

from tactileforge.hub import cards, store
from tactileforge.hub.files import open_model


def starting_weights(name: str) -> tuple[dict[str, Any], dict[str, Tensor]]:
    """Options of a model's encoder, and its weights under the names of a run's checkpoint.

    Args:
        name: ``NAME.TAG`` or ``NAME`` of the zoo, or ``file:PATH``.

    Returns:
        The plugin and constructor arguments of the encoder; tensors named ``encoder.*`` and, of the
        heads that the file has, ``heads.NAME.*``.

    Raises:
        TactileForgeError: See `loading.load`.
    """
    if name.startswith("file:"):
        path = Path(name.removeprefix("file:")).expanduser()
    else:
        path = store.fetch_weights(*cards.find_card(name))
    encoder, heads, header = open_model(path)
    modules = {"encoder": encoder, **{f"heads.{key}": head for key, head in heads.items()}}
    state = {
        f"{prefix}.{key}": tensor
        for prefix, module in modules.items()
        for key, tensor in module.state_dict().items()
    }
    return dict(header.encoder), state
