"""Lists, shows, fetches and packs models, by name."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tactileforge.cli._command import Command
from tactileforge.errors import ConfigError
from tactileforge.hub import cards, published, store
from tactileforge.hub.header import read_header
from tactileforge.hub.table import describe_clip, measured_rows, zoo_page
from tactileforge.pages.text_tables import align_columns
from tactileforge.plugins import local
from tactileforge.runs.folder import split_best
from tactileforge.util.files import sha256
from tactileforge.util.licences import NO_LICENCE


@dataclass(frozen=True, kw_only=True)
class _List:
    """Keys of ``zoo list``.

    Attributes:
        pattern: Shell pattern of names, for example NAME*.
        markdown: Whether to print the page docs/zoo.md.
    """

    pattern: str = "*"
    markdown: bool = False


@dataclass(frozen=True, kw_only=True)
class _Show:
    """Keys of ``zoo show``.

    Attributes:
        model: Name of a model, NAME or NAME.TAG, or file:PATH for a file of yours.
        details: Whether to add published results, the gate task by task and the whole card.
    """

    model: str
    details: bool = False


@dataclass(frozen=True, kw_only=True)
class _Get:
    """Keys of ``zoo get``.

    Attributes:
        model: Name of a model, NAME or NAME.TAG.
        file: Your download, as published by its authors (``--from FILE``); None fetches it.
        accept: Licence of published weights, once you have read it; as ``zoo list`` states it.
        sensor: Sensor on which the force head was trained; needed only if the name of the file
            does not tell.
    """

    model: str
    file: str | None = None
    accept: str | None = None
    sensor: str = ""


@dataclass(frozen=True, kw_only=True)
class _Pack:
    """A run's encoder as one file.

    Attributes:
        run: Folder of the run; RUN@best for its best weights.
        out: The file; None for model.safetensors in the run.
        dtype: Type of the stored weights: float32 or float16.
        name: Name of the model.
        licence: SPDX identifier of the weights; LicenseRef-NAME for a licence without one.
        encoder: ``trained`` for the trained weights or ``slow`` for their EMA; None for the EMA if
            the run has one.
    """

    run: str
    out: str | None = None
    dtype: str = "float32"
    name: str = ""
    licence: str = NO_LICENCE
    encoder: str | None = None


def _list(keys: _List, _: dict[str, Any]) -> None:
    """Lists the models and the availability of their weights."""
    if keys.markdown:
        print(zoo_page(), end="")
        return
    rows = [("name", "title", "licence", "weights")]
    for name, card, weight in cards.list_cards(keys.pattern):
        licence = weight.licence if weight else card.licence
        rows.append((name, card.title, licence, _state(card, weight)))
    if len(rows) == 1:
        raise ConfigError(f"no model matches {keys.pattern!r}; see them all: tactileforge zoo list")
    print(align_columns(rows))


def _state(card: cards.Card, weight: cards.Weight | None) -> str:
    if weight is None:
        return "none"
    here = weight.kind != "shipped" and store.is_available(card, weight)
    return f"{weight.kind}{' (here)' * here}"


def _show(keys: _Show, _: dict[str, Any]) -> None:
    """Shows purpose, loading, licence and gate of a model; details=true prints its card."""
    if keys.model.startswith("file:"):
        _show_file(Path(keys.model.removeprefix("file:")))
        return
    name, dot, tag = keys.model.partition(".")
    card = cards.read_card(name)
    weights = [card.weight(tag)] if dot else card.weights
    first = weights[0] if weights else None
    full = f"{name}.{first.tag}" if first else name
    sensors, data = card.trained_on(first)
    print(f"{full}: {card.purpose(first)}")
    print(_how_to_load(card, first))
    print(f"release gate: {(first and first.gate) or 'not measured'}\n")
    facts = [
        ("title", card.title),
        ("sensors", ", ".join(sensors) or "none"),
        ("data", ", ".join(data)),
        ("clip", describe_clip(card, first)),
        ("paper", card.paper),
        ("code", f"{card.code or 'none'} (licence {card.licence})"),
        ("recipe", f"tactileforge train recipe={name}" if card.recipe else "none: importer only"),
    ]
    print(f"{align_columns(facts)}\n")
    rows = [("weights", "kind", "licence", "MB", "from")]
    for weight in weights:
        size = f"{weight.bytes / 1e6:.1f}" if weight.bytes else "-"
        origin = weight.file or weight.url or weight.source + " (gated)" * weight.gated
        rows.append((weight.tag, _state(card, weight), weight.licence, size, origin))
    print(align_columns(rows) if weights else "No weights.")
    if keys.details:
        _details(card, weights, tag)
    else:
        print(f"\nresults, gate and card: tactileforge zoo show {keys.model} details=true")


def _show_file(path: Path) -> None:
    """Prints the header of a file: loading, licence, plugin, sensors, clips and heads."""
    header = read_header(path)
    height, width = header.input["size"]
    load = json.dumps(f"file:{path}", ensure_ascii=False)
    frames = header.input["frames"]
    apart = f", {header.spacing:.3g} s apart" if frames > 1 else ""
    print(f"{header.name or path.name}: {header.encoder['name']} of {header.package}")
    print(f"load it: tactileforge.load({load}); licence of the weights: {header.licence}\n")
    facts = [
        ("sensors", ", ".join(sorted(header.sensors)) or "none"),
        ("data", str(header.data.get("name", "not stated"))),
        ("clip", f"{frames} frames{apart}, {height} x {width}"),
        ("heads", ", ".join(header.titles_of_heads) or "none"),
        ("size", f"{path.stat().st_size / 1e6:.1f} MB, {header.dtype}"),
        ("source", ", ".join(f"{key} {value}" for key, value in header.source.items())),
        ("versions", ", ".join(f"{key} {value}" for key, value in header.versions.items())),
    ]
    print(align_columns([row for row in facts if row[1]]))


def _how_to_load(card: cards.Card, weight: cards.Weight | None) -> str:
    """One line with the call to load the weights, any step before it, and their licence."""
    if weight is None:
        how = f"tactileforge train recipe={card.name}" if card.recipe else "choose another model"
        return f"no weights: {how}"
    full = f"{card.name}.{weight.tag}"
    load = f'tactileforge.load("{full}")'
    if weight.kind == "import" and not store.is_available(card, weight):
        fetched = "--from FILE"
        if weight.published and not weight.gated:
            fetched = f"accept={weight.licence}"
        load = f"tactileforge zoo get {full} {fetched}, then {load}"
    kept = "; a demonstration" * weight.demonstration
    return f"load it: {load}; licence of the weights: {weight.licence}{kept}"


def _details(card: cards.Card, weights: Sequence[cards.Weight], tag: str) -> None:
    """Prints published results, the release gate task by task, and the page of the card."""
    results = [r for r in card.results if not tag or r.model == tag]
    if results:
        table = [("model", "task", "metric", "value", "source")]
        table += [(r.model, r.task, r.metric, f"{r.value:g} {r.unit}", r.source) for r in results]
        print(f"\n{align_columns(table)}")
    for weight in weights:
        if rows := measured_rows(card, weight):
            print(f"\n{weight.tag}, release gate: {weight.gate or 'not measured'}")
            print(align_columns(rows))
    print(f"\n{card.text}")


def _get(keys: _Get, _: dict[str, Any]) -> None:
    """Fetches the weights of a model, or imports your download."""
    if keys.file is None:
        path = published.fetch(*cards.find_card(keys.model), keys.accept)
    else:
        from tactileforge.plugins import registry  # imports numpy, which other actions do without

        path = registry.load("importers", "published")(keys.model, Path(keys.file), keys.sensor)
    print(f"{path}\nload it: tactileforge.load({json.dumps(keys.model)})")


def _pack(keys: _Pack, _: dict[str, Any]) -> None:
    """Packs the encoder of a run into one file."""
    from tactileforge.hub.pack import pack_run

    given: dict[str, Any] = {**vars(keys)}
    path = pack_run(Path(given.pop("run").removeprefix("run:")), **given)
    print(f"{path}: {path.stat().st_size / 1e6:.1f} MB, sha256 {sha256(path)}")
    print(f"load it: tactileforge.load({json.dumps(f'file:{path}', ensure_ascii=False)})")
    header = read_header(path)
    # a head of the user's own whose class was not given has its own warning
    chosen = [
        key
        for key, node in header.recipe.get("head", {}).items()
        if key in header.recipe["objective"]
        and (header.source["encoder"] == "slow" or not local.is_local(node["name"]))
    ]
    if left := sorted({*chosen} - header.heads.keys()):
        print(
            f"not in the file: head {', '.join(left)}, which no function of a model reads; the run "
            "keeps it, for resume= and init="
        )


def _packed(keys: _Pack) -> Path | str | None:
    """Path of the written file; None if the folder of the run does not exist."""
    folder = split_best(Path(keys.run.removeprefix("run:")))[0]
    return keys.out or (folder / "model.safetensors" if folder.is_dir() else None)


COMMANDS = {
    "list": Command(run=_list, keys=_List, bare=("pattern",)),
    "show": Command(run=_show, keys=_Show, bare=("model",)),
    "get": Command(run=_get, keys=_Get, bare=("model",), also={"from": "file"}, cache=True),
    "pack": Command(run=_pack, keys=_Pack, bare=("run",), writes=_packed),
}
