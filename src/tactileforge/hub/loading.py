"""``tactileforge.load``: loads a model by name, file or run."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tactileforge.errors import home_path
from tactileforge.hub import cards, store
from tactileforge.plugins import registry

if TYPE_CHECKING:
    import torch

    from tactileforge.hub.model import Model
    from tactileforge.hub.precision import Precision


def load(
    name_or_file: str | Path,
    *,
    device: str | torch.device = "cpu",
    dtype: Precision = "float32",
    frames: int | None = None,
    image_size: int | tuple[int, int] | None = None,
    classes: Mapping[str, Any] | None = None,
) -> Model:
    """Loads a model of the zoo, a one-file checkpoint, or the last checkpoint of a run.

    A model of the zoo is verified on every load: the sha256 of its file is compared with the one on
    its card, or with the one that was recorded when it was imported. Nothing in a file is executed:
    it names plugins, and only installed ones are built.

    Args:
        name_or_file: ``NAME.TAG``, ``NAME`` for the default weights, ``file:PATH``, ``run:FOLDER``,
            or the `Path` of a file or of a run's folder.
        device: Device of the computation, e.g. ``cpu``.
        dtype: In which type it does: ``float32``, ``bfloat16``, ``int8`` or ``auto``, see
            `precision.set_precision`.
        frames: Another number of frames a clip than it was trained on, where its positions can be
            interpolated.
        image_size: Another height and width, or one number for both, likewise.
        classes: Classes of one's own by the name in the file, such as ``my_module:Tiny``: what a
            file names is never imported.

    Raises:
        ConfigError: Unknown name, type or device, a card without weights, or frames or a size that
            the encoder cannot take.
        DataNotFoundError: The file or run is not there and cannot be had; says how to get it.
        DataError: The file is not what it should be, or the run has no usable checkpoint.
        PluginError: A plugin is missing; says what to install.

    Example:
        >>> import numpy as np
        >>> rest = np.full((240, 320, 3), 110, np.uint8)
        >>> load("anytouch2.tiny").encode(np.stack([rest] * 4), rest, "digit").shape
        torch.Size([3840])
    """
    for own, given in (classes or {}).items():
        registry.give(own, given)
    card = None
    if isinstance(name_or_file, Path):
        path = name_or_file
    elif name_or_file.startswith(("file:", "run:")):
        path = home_path(name_or_file.partition(":")[2])
    else:
        card, weight = cards.find_card(name_or_file)
        path = store.fetch_weights(card, weight)

    # here: an unknown name is an error before torch is imported, which takes seconds
    from tactileforge.hub.files import open_model
    from tactileforge.hub.model import Model
    from tactileforge.hub.precision import set_precision
    from tactileforge.hub.runs import open_run

    # a Path has no word before it: a folder can only be a run
    is_path = isinstance(name_or_file, Path)
    is_run = path.is_dir() if is_path else str(name_or_file).startswith("run:")
    encoder, heads, header = (open_run if is_run else open_model)(path, frames, image_size)
    _warn(str(name_or_file), header.input, encoder)
    model = Model(encoder, header, card, device, heads)
    set_precision(model, dtype)
    return model


def _warn(name: str, trained: Mapping[str, Any], encoder: Any) -> None:
    """Warns of interpolated positions."""
    for what, before, after in (
        ("frames", trained.get("frames"), encoder.frames),
        ("pixels a side", trained.get("size"), list(encoder.image_size)),
    ):
        if before is not None and before != after:
            warnings.warn(
                f"{name} was trained on {before} {what}; its positions were interpolated to "
                f"{after}: measure it on your task",
                stacklevel=3,
            )


def list_models(pattern: str = "*", *, weights: bool = False) -> list[str]:
    """Names of the models of the zoo, ``NAME.TAG``, sorted by card.

    Args:
        pattern: Pattern of the names; ``*`` stands for anything.
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
