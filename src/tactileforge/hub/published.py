"""Published weights, fetched from where their authors put them."""

from __future__ import annotations

import re
from pathlib import Path

from tactileforge.errors import ConfigError, DataNotFoundError, unknown
from tactileforge.hub import store
from tactileforge.hub.cards import Card, Weight
from tactileforge.util.licences import NO_LICENCE

#: Families of encoders under the names that their authors give them.
_SPARSH = ("mae", "dino", "dinov2", "ijepa", "vjepa")


def name_of(given: str) -> str:
    """The zoo's name of a model: ``sparsh/dino-base`` is ``dino.base``.

    Raises:
        ConfigError: Sparsh has no such encoder.
    """
    if not given.startswith("sparsh/"):
        return given
    family, _, size = given.removeprefix("sparsh/").partition("-")
    if family not in _SPARSH:
        raise ConfigError(unknown("encoder of Sparsh", family, _SPARSH))
    return f"{family}.{size}" if size else family


def fetch(card: Card, weight: Weight, accept: str | None) -> Path:
    """The one-file checkpoint of a model; published weights are fetched and imported if need be.

    Args:
        card: Card of the model.
        weight: Its file of weights.
        accept: The licence that the user accepts; None for none.

    Raises:
        ConfigError: The licence was not accepted, or is another; or huggingface_hub or the
            importer is not installed.
        DataNotFoundError: It cannot be fetched; says what to do.
        DataError: The file is not what was fetched first, or not what the card says.
    """
    if not weight.published or store.is_available(card, weight):
        return store.fetch_weights(card, weight)
    name = f"{card.name}.{weight.tag}"
    if accept is None:
        if weight.gated or weight.licence == NO_LICENCE:
            why = "state no licence" if weight.licence == NO_LICENCE else "ask for terms"
            what = f"its authors {why}"
        else:
            what = f"they are under {weight.licence}"
        raise ConfigError(
            f"the weights of {name} are not ours to ship, and {what}: read "
            f"{weight.source.partition(': ')[0]}, then "
            f'tactileforge.load("{name}", accept="{weight.licence}"), or: tactileforge zoo get '
            f"{name} accept={weight.licence}; or, with your download: tactileforge zoo get {name} "
            "--from FILE"
        )
    if accept != weight.licence:
        raise ConfigError(
            f'accept={accept!r}: the weights of {name} are under {weight.licence}: accept="'
            f'{weight.licence}"'
        )
    # here: the importer brings torch, and the licence is asked for first
    from tactileforge.plugins import registry

    imported = registry.load("importers", "published")
    try:
        source = fetch_published(weight.published)
    except DataNotFoundError as error:
        own = f"or, with your download: tactileforge zoo get {name} --from FILE"
        raise DataNotFoundError(f"{error}; {own}") from error
    return Path(imported(name, source))


def fetch_published(place: str) -> Path:
    """The published file or folder; see `Weight.published`."""
    from tactileforge.hub.remote import fetch_file, fetch_folder

    match = re.fullmatch(r"(datasets/)?([^/@]+/[^/@]+)/([^@]+)@([^@]+)", place)
    if not match:
        raise ConfigError(f"{place}: write OWNER/REPO/FILE@REVISION")
    kind = "dataset" if match[1] else "model"
    get = fetch_folder if match[3].endswith("/") else fetch_file
    return get(match[2], match[3], match[4], kind=kind)
