"""Import of a published file as a model of the zoo."""

from __future__ import annotations

from collections.abc import Mapping
from importlib.metadata import version
from pathlib import Path
from typing import Any

from tactileforge.errors import ConfigError, DataError, DataNotFoundError
from tactileforge.hub import (
    Card,
    Weight,
    fill_weights,
    find_card,
    keep_import,
    list_cards,
    make_header,
    save_checkpoint,
    weights_folder,
)
from tactileforge.plugins import commit, disk_errors_named, new_part, registry, sha256
from tactileforge_published import convert, read_tensors
from tactileforge_published.published_heads import published_heads


def import_published(model: str, source: str | Path, sensor: str = "") -> Path:
    """Imports a published file of the user's own into the cache, as a model of the zoo.

    Args:
        model: ``NAME.TAG``, or ``NAME``.
        source: The file as its authors publish it; its heads are imported with the encoder.
        sensor: Sensor of its force head's training, where the name of the file does not say.

    Returns:
        The one-file checkpoint; `tactileforge.load` finds it by its name from now on.

    Raises:
        ConfigError: The model is not one that is imported, or the sensor of its forces is not
            known.
        DataError: The file is not what the model's authors publish; says what it is.
        DataNotFoundError: There is no such file.
    """
    card, weight = find_card(model)
    full = f"{card.name}.{weight.tag}"
    if not weight.layout:
        raise ConfigError(f"{full} is {weight.kind}, not imported: tactileforge.load({full!r})")
    source = Path(source)
    if not source.exists():
        raise DataNotFoundError(f"{source}: no such file; download it from {weight.source}")
    try:
        converted = convert(read_tensors(source))
    except ConfigError as error:
        raise DataError(f"{source}: {error}") from error
    node = dict(converted.encoder_config)
    # before the encoder is built: that of another variant would be built in vain
    _check_variant(card, weight, converted.name, node, source)
    encoder = registry.build("encoders", node)
    fill_weights(encoder, converted.state, str(source))
    heads, entries = published_heads(converted, encoder, source, sensor)
    # T3 is a folder, and its files have no hash in common
    digest = sha256(source) if source.is_file() else ""
    kept = {} if converted.temperature is None else {"temperature": converted.temperature}
    header = make_header(
        encoder,
        node,
        licence=weight.licence,
        spacing=encoder.spacing,
        name=full,
        commit=commit(),
        versions={"tactileforge": version("tactileforge")},
        data={"name": ", ".join(card.data), "licences": []},
        source={"file": source.name, "sha256": digest, "layout": converted.name, **kept},
        heads=entries,
    )
    target = weights_folder() / f"{full}.safetensors"
    with disk_errors_named(target), new_part(target) as part:
        save_checkpoint(part, encoder, header, heads=heads)
        return keep_import(card, weight, part, source.name, digest)


def _check_variant(
    card: Card, weight: Weight, layout: str, node: Mapping[str, Any], source: Path
) -> None:
    """Raises a DataError if the file belongs to another model or variant."""
    wanted = _variant(card, weight)
    variant = {"layout": layout, **{key: node.get(key) for key in wanted if key != "layout"}}
    if variant == wanted:
        return
    other = {**node, "layout": layout}
    fits = [
        name
        for name, of, row in list_cards()
        if row and all(other.get(key) == value for key, value in _variant(of, row).items())
    ]
    hint = f"; it fits {' or '.join(fits)}" if fits else ""
    raise DataError(f"{source} is {variant}, but {card.name}.{weight.tag} is {wanted}{hint}")


def _variant(card: Card, weight: Weight) -> dict[str, Any]:
    """Configuration of these weights, for an importer to detect."""
    return {"layout": weight.layout, "frames": card.clip(weight)[0], **weight.encoder}
