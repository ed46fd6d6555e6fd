"""Writing of a model, as it is now, to a file, a folder or the model hub."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, Literal

import yaml

from tactileforge.errors import ConfigError
from tactileforge.hub.file_checks import NO_FIT, check_arguments, own_head
from tactileforge.hub.files import save_checkpoint, without_folders
from tactileforge.hub.header import Header
from tactileforge.hub.parts import Parts
from tactileforge.hub.store import CARD, WEIGHTS
from tactileforge.plugins import local, registry
from tactileforge.util.files import write_text
from tactileforge.util.licences import NO_LICENCE, check_licence

if TYPE_CHECKING:
    from torch import nn


def save_model(
    model: Parts,
    path: str | Path,
    *,
    name: str = "",
    licence: str = "",
    dtype: Literal["float32", "float16"] = "float32",
) -> Path:
    """Writes a model as a one-file checkpoint; see `Model.save`."""
    target = Path(path)
    header = described(model, name, licence)
    save_checkpoint(target, model.encoder, header, dtype, dict(model.heads))
    return target


def save_folder(model: Parts, folder: str | Path, place: str = "FOLDER", **options: Any) -> Path:
    """Writes weights and card of a model into a folder; see `Model.save_pretrained`."""
    target = Path(folder)
    target.mkdir(parents=True, exist_ok=True)
    # a model without a name has that of its folder, or of its place on the hub
    known = options.get("name") or model.header.name
    options["name"] = known or place.rpartition("/")[2].replace("FOLDER", target.absolute().name)
    save_model(model, target / WEIGHTS, **options)
    header = described(model, options["name"], options.get("licence", ""))
    write_text(target / CARD, card_text(model, header, place))
    return target


def add_head(
    model: Parts, name: str, head: str | type[nn.Module], options: Mapping[str, Any]
) -> nn.Module:
    """Puts a new head beside the encoder of a model; see `Model.add_head`."""
    if name in model.heads:
        raise ConfigError(f"the model has a head {name!r}: take another name, or del model.heads")
    if not name.isidentifier():
        raise ConfigError(f"{name!r} is no name of a head: use letters, digits and underscores")
    word = (head or name) if isinstance(head, str) else local.name_of(head)
    if local.is_local(word):
        registry.adopt("heads", word)
    elif not any((one.kind, one.name) == ("heads", word) for one in registry.list_plugins()):
        word = local.name_of(registry.get("heads", word))  # registered in this process alone
    if local.is_local(word) and not own_head(name, word):
        raise ConfigError(f"head {name!r}: {word} is {NO_FIT}")
    node = {"name": word, **options}
    check_arguments(f"head {name!r}", node)
    built: nn.Module = registry.build("heads", node, encoder=model.encoder).to(model.device).eval()
    model.heads[name] = built
    kept = {**node, "name": without_folders(word)}
    heads = {**model.header.heads, name: {"node": kept}}
    model.header = replace(model.header, heads=heads)
    return built


def push(
    model: Parts, repo: str, *, private: bool = False, message: str = "", **options: Any
) -> str:
    """Puts a model into a repository of the model hub; see `Model.push_to_hub`."""
    from tactileforge.hub.remote import upload

    with TemporaryDirectory() as folder:
        save_folder(model, folder, f"hf:{repo.removeprefix('hf:')}", **options)
        return upload(Path(folder), repo, private=private, message=message or "Weights and card")


def described(model: Parts, name: str = "", licence: str = "") -> Header:
    """The header of a model as it is now: with its lineage, if its weights have changed.

    Raises:
        ConfigError: The weights were rounded, or the licence is unknown, or is not that of the
            weights from which these come.
    """
    if model.is_rounded:
        raise ConfigError(
            "the weights of this model were rounded when it was loaded (dtype=): load it in float32"
        )
    old = model.header
    if strange := sorted(set(model.heads) - set(old.heads)):
        raise ConfigError(
            f"head {strange[0]} is not one of the model's file, which names the class of each: put "
            f"it in by model.add_head({strange[0]!r}, Class, option=...), which keeps these"
        )
    if licence:
        check_licence("licence", licence)
    if licence and licence != old.licence and not (old.recipe and old.licence == NO_LICENCE):
        raise ConfigError(
            f"licence={licence}: its weights come from weights under {old.licence}, which holds "
            "for these too; leave licence out"
        )
    # one whose class was not given is not here
    heads = {key: entry for key, entry in old.heads.items() if key in model.heads}
    header = replace(old, name=name or old.name, licence=licence or old.licence, heads=heads)
    now = model.part_hashes()
    changed = sorted(key for key, value in now.items() if model.loaded.get(key) != value)
    if not changed:
        return header
    lineage = {
        "base": old.name or old.encoder["name"],
        "base_hashes": dict(model.loaded),
        "hashes": now,
        "changed": changed,
    }
    if before := old.source.get("lineage"):
        lineage["before"] = before
    # a layout stands for the published weights themselves, and these are others
    source = {key: value for key, value in old.source.items() if key not in ("layout", "lineage")}
    return replace(header, source={**source, "lineage": lineage})


def card_text(model: Parts, header: Header, place: str) -> str:
    """The card of a model: front matter as the model hub reads it, then what the header says."""
    lineage = header.source.get("lineage", {})
    known = header.licence != NO_LICENCE
    front: dict[str, Any] = {
        "license": header.licence.lower() if known else "unknown",
        "library_name": "tactileforge",
        "tags": ["tactile", "touch", *header.sensors],
    }
    rows = {
        "encoder": header.encoder["name"],
        "clip": f"{model.frames} frames, {header.spacing:.3g} s apart",
        "sensors": ", ".join(header.sensors) or "any",
        "data": header.data.get("name", "") or "not stated",
        "heads": ", ".join(header.titles_of_heads) or "none",
        "licence": header.licence,
        "fingerprint": model.fingerprint,
    }
    if lineage:
        rows["trained from"] = f"{lineage['base']} ({lineage['base_hashes']['encoder']})"
        rows["changed"] = ", ".join(lineage["changed"])
    table = "\n".join(f"| {key} | {_cell(str(value))} |" for key, value in rows.items())
    title = _cell(header.name or "A touch encoder")
    return (
        f"---\n{yaml.safe_dump(front, sort_keys=False)}---\n\n# {title}\n\n"
        f"An encoder of optical touch, written by tactileforge.\n\n| | |\n|---|---|\n{table}\n\n"
        f"```python\nimport tactileforge\n\nmodel = tactileforge.load({json.dumps(place)})\n```\n"
    )


def _cell(text: str) -> str:
    """Text for a cell of a table."""
    return " ".join(text.replace("|", "\\|").split())
