"""``tactileforge.load``: loads a model by name or file."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import TYPE_CHECKING

from tactileforge.hub import cards, store

if TYPE_CHECKING:
    import torch

    from tactileforge.hub.model import Model


def load(
    name_or_file: str | Path,
    *,
    device: str | torch.device = "cpu",
    frames: int | None = None,
) -> Model:
    """Loads a model of the zoo, or a one-file checkpoint.

    A model of the zoo is verified on every load: the sha256 of its file is compared with the one on
    its card, or with the one that was recorded when it was imported. Nothing in a file is executed:
    it names plugins, and only installed ones are built.

    Args:
        name_or_file: ``NAME.TAG``, ``NAME`` for the default weights, ``file:PATH``, or a `Path`.
        device: Where the model computes.
        frames: Another number of frames a clip than it was trained on, where its positions can be
            interpolated.

    Raises:
        ConfigError: Unknown name, a card without weights, or frames the encoder cannot take.
        DataNotFoundError: The file is not there and cannot be had; says how to get it.
        DataError: The file is not what it should be.
        PluginError: A plugin is missing; says what to install.

    Example:
        >>> load("file:model.safetensors").encode(frames, background, "digit")  # doctest: +SKIP
    """
    card = None
    if isinstance(name_or_file, Path):
        path = name_or_file
    elif name_or_file.startswith("file:"):
        path = Path(name_or_file.removeprefix("file:")).expanduser()
    else:
        card, weight = cards.find_card(name_or_file)
        path = store.fetch_weights(card, weight)

    from tactileforge.hub.files import open_model
    from tactileforge.hub.model import Model

    encoder, heads, header = open_model(path, frames)
    if frames is not None and frames != header.input.get("frames", frames):
        warnings.warn(
            f"{name_or_file} was trained on {header.input['frames']} frames; its positions were "
            f"interpolated to {frames}: measure it on your task",
            stacklevel=2,
        )
    return Model(encoder, header, card, device, heads)


def list_models(pattern: str = "*", *, weights: bool = False) -> list[str]:
    """Names of the models of the zoo, ``NAME.TAG``, sorted by card.

    Args:
        pattern: What names must match; ``*`` stands for anything.
        weights: Only those that `load` gives: shipped, remote, or imported already.

    Example:
        >>> "anytouch2.base" in list_models("*touch*")
        True
    """
    return [
        name
        for name, card, weight in cards.list_cards(pattern)
        if not weights or (weight and (weight.kind == "remote" or store.is_available(card, weight)))
    ]
