"""``tactileforge.load``: loads a model by name, file or run."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tactileforge.errors import ConfigError, home_path, unknown
from tactileforge.hub import cards, published, store
from tactileforge.plugins import registry
from tactileforge.runs.folder import CONFIG

#: Where the weights of a model are.
_STATES = ("shipped", "cached", "downloadable", "by hand", "recipe")

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
    accept: str | None = None,
    classes: Mapping[str, Any] | None = None,
) -> Model:
    """Loads a model of the zoo, a one-file checkpoint, or the last checkpoint of a run.

    A model of the zoo is verified on every load: the sha256 of its file is compared with the one on
    its card, or with the one that was recorded when it was imported. Nothing in a file is executed:
    it names plugins, and only installed ones are built.

    Args:
        name_or_file: ``NAME.TAG``, ``NAME`` for the default weights, ``hf:OWNER/NAME`` or
            ``hf:OWNER/NAME@REVISION`` of the model hub, ``file:PATH``, ``run:FOLDER`` or
            ``run:FOLDER@best``, or the path of a file, of a folder of `Model.save_pretrained`, or
            of a run's folder.
        device: Device of the computation, e.g. ``cpu``.
        dtype: In which type it does: ``float32``, ``bfloat16``, ``int8`` or ``auto``, see
            `precision.set_precision`.
        frames: Another number of frames a clip than it was trained on, where its positions can be
            interpolated.
        image_size: Another height and width, or one number for both, likewise.
        accept: Licence of published weights that are not fetched yet, as their card states it:
            they are fetched from where their authors put them.
        classes: Classes of one's own by the name in the file, such as ``my_module:Tiny``: what a
            file names is never imported.

    Raises:
        ConfigError: Unknown name, type or device, a card without weights, frames or a size that
            the encoder cannot take, or a licence that was not accepted.
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
    place = _find(name_or_file, accept)
    path = place.path

    # here: an unknown name is an error before torch is imported, which takes seconds
    from tactileforge.hub.files import open_model
    from tactileforge.hub.model import Model
    from tactileforge.hub.precision import set_precision
    from tactileforge.hub.runs import open_run

    encoder, heads, header = (open_run if place.is_run else open_model)(path, frames, image_size)
    _warn(str(name_or_file), header.input, encoder)
    model = Model(encoder, header, place.card, device, heads)
    set_precision(model, dtype)
    return model


@dataclass(frozen=True)
class _Place:
    """Where a model lies: a file, or the folder of a run; and its card."""

    path: Path
    is_run: bool = False
    card: cards.Card | None = None


def _find(given: str | Path, accept: str | None) -> _Place:
    """The file or run that is meant, fetched if need be."""
    if isinstance(given, str):
        kind, colon, rest = given.partition(":")
        kind = kind if colon else ""  # a folder may be called run
        if kind == "run":
            return _Place(home_path(rest), is_run=True)
        if kind == "file":
            return _Place(home_path(rest))
        if kind == "hf":
            from tactileforge.hub.remote import fetch_model

            return _Place(fetch_model(rest))
        path = home_path(given)
        if given.partition(".")[0] in cards.card_names() or not path.exists():
            card, weight = cards.find_card(published.name_of(given))
            return _Place(published.fetch(card, weight, accept), card=card)
        given = path
    if (given / store.WEIGHTS).is_file() and not (given / CONFIG).is_file():
        return _Place(given / store.WEIGHTS)
    return _Place(given, is_run=given.is_dir() or given.name.endswith("@best"))


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


def list_models(
    pattern: str = "*",
    *,
    weights: bool = False,
    sensor: str | None = None,
    licence: str | None = None,
    reads: str | None = None,
    available: str | None = None,
) -> list[str]:
    """Names of the models of the zoo, ``NAME.TAG``, sorted by card.

    Args:
        pattern: Pattern of the names; ``*`` stands for anything.
        weights: Only those that `load` gives: shipped, remote, or imported already.
        sensor: Only those that were trained on this type of sensor.
        licence: Only those whose weights are under this licence; ``*`` stands for anything.
        reads: Only those that read this: ``force`` or ``surface``, by a head, or ``words``.
        available: Only ``shipped``, ``cached`` (fetched or imported before), ``downloadable``,
            ``by hand`` (published elsewhere than on the model hub) or ``recipe`` (no weights:
            train it).

    Raises:
        ConfigError: No such word for ``reads`` or ``available``, or no model knows the sensor.

    Example:
        >>> "anytouch2.base" in list_models("*touch*")
        True
        >>> list_models(available="shipped", reads="force")
        ['anytouch2.tiny']
    """
    for key, value, known in (("reads", reads, cards.READS), ("available", available, _STATES)):
        if value is not None and value not in known:
            raise ConfigError(unknown(key, value, known))
    every = cards.list_cards("*")
    trained_on = {one for _, card, weight in every for one in card.trained_on(weight)[0]}
    if sensor is not None and sensor not in trained_on:
        raise ConfigError(unknown("sensor of the models", sensor, trained_on))
    return [
        name
        for name, card, weight in cards.list_cards(pattern)
        if (
            not weights
            or (weight and (weight.kind == "remote" or store.is_available(card, weight)))
        )
        and (sensor is None or sensor in card.trained_on(weight)[0])
        and (licence is None or fnmatchcase(weight.licence if weight else card.licence, licence))
        and (reads is None or (weight is not None and reads in weight.what_it_reads))
        and (available is None or available == _state(card, weight))
    ]


def _state(card: cards.Card, weight: cards.Weight | None) -> str:
    if weight is None:
        return "recipe"
    if weight.file:
        return "shipped"
    if store.is_available(card, weight):
        return "cached"
    return "downloadable" if weight.url or weight.published else "by hand"
