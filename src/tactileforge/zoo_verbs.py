"""``tactileforge zoo list | show | get | pack | gate``."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from tactileforge.errors import ConfigError, unknown
from tactileforge.files import sha256
from tactileforge.hub import cards, gates, store
from tactileforge.hub.table import align_columns, describe_clip, gate_rows, zoo_page

#: What ``zoo pack`` takes as ``key=value``.
_PACK = ("out", "dtype", "name", "licence", "encoder", "gate")


def main(argv: Sequence[str]) -> int:
    """Runs the verb.

    Args:
        argv: The words after ``tactileforge zoo``.

    Returns:
        The exit code.

    Raises:
        TactileForgeError: A name, file or option is wrong; says the fix.
    """
    words = _parser().parse_args(argv)
    if words.action == "list":
        return _list(words.pattern, words.markdown)
    if words.action == "show":
        return _show(words.model)
    if words.action == "get":
        return _get(words.model, words.source)
    if words.action == "gate":
        return _gate(words.model, words.benches)
    return _pack(words.run, words.settings)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser("tactileforge zoo", description="Models by name.")
    actions = parser.add_subparsers(dest="action", required=True)
    listing = actions.add_parser("list", help="the models; 'NAME*' for some of them")
    listing.add_argument("pattern", nargs="?", default="*")
    listing.add_argument("--markdown", action="store_true", help="the page docs/zoo.md")
    show = actions.add_parser("show", help="the card of a model")
    show.add_argument("model", metavar="NAME[.TAG]")
    get = actions.add_parser("get", help="fetch the weights of a model, or import your download")
    get.add_argument("model", metavar="NAME[.TAG]")
    get.add_argument(
        "--from", dest="source", type=Path, metavar="FILE", help="as its authors publish it"
    )
    pack = actions.add_parser("pack", help="a run's encoder as one file")
    pack.add_argument("run", type=Path, metavar="RUN")
    pack.add_argument("settings", nargs="*", metavar="key=value", help=", ".join(_PACK))
    gate = actions.add_parser("gate", help="write what the release gate measured into the card")
    gate.add_argument("model", metavar="NAME.TAG")
    gate.add_argument("benches", nargs="+", type=Path, metavar="BENCH")
    return parser


def _list(pattern: str, markdown: bool) -> int:
    if markdown:
        print(zoo_page(), end="")
        return 0
    rows = [("name", "title", "licence", "weights")]
    for name, card, weight in cards.list_cards(pattern):
        licence = weight.licence if weight else card.licence
        rows.append((name, card.title, licence, _state(card, weight)))
    if len(rows) == 1:
        raise ConfigError(f"no model matches {pattern!r}; see them all: tactileforge zoo list")
    print(align_columns(rows))
    return 0


def _state(card: cards.Card, weight: cards.Weight | None) -> str:
    if weight is None:
        return "none"
    here = weight.kind != "shipped" and store.is_available(card, weight)
    return f"{weight.kind}{' (here)' * here}"


def _show(model: str) -> int:
    name, _, tag = model.partition(".")
    card = cards.read_card(name)
    weights = [card.weight(tag)] if tag else card.weights
    facts = [
        ("licence", card.licence),
        ("paper", card.paper),
        ("code", card.code or "none"),
        ("sensors", ", ".join(card.sensors) or "none"),
        ("data", ", ".join(card.data)),
        ("clip", describe_clip(card, weights[0] if weights else None)),
        ("recipe", f"tactileforge train recipe={name}" if card.recipe else "none: importer only"),
    ]
    print(f"{card.title} ({name})\n\n{align_columns(facts)}\n")
    rows = [("weights", "kind", "licence", "MB", "from")]
    for weight in weights:
        size = f"{weight.bytes / 1e6:.1f}" if weight.bytes else "-"
        origin = weight.file or weight.url or weight.source + " (gated)" * weight.gated
        rows.append((weight.tag, _state(card, weight), weight.licence, size, origin))
    print(align_columns(rows) if weights else "No weights.")
    results = [r for r in card.results if not tag or r.model == tag]
    if results:
        table = [("model", "task", "metric", "value", "source")]
        table += [(r.model, r.task, r.metric, f"{r.value:g} {r.unit}", r.source) for r in results]
        print(f"\n{align_columns(table)}")
    for weight in weights:
        if gate := gate_rows(card, weight):
            print(f"\n{weight.tag}, release gate: {gates.gate_verdict(card.gate(weight))}")
            print(align_columns(gate))
    print(f"\n{card.text}")
    return 0


def _get(model: str, source: Path | None) -> int:
    if source is None:
        path = store.fetch_weights(*cards.find_card(model))
    else:
        from tactileforge.hub.pack import import_published

        path = import_published(model, source)
    print(f'{path}\nload it: tactileforge.load("{model}")')
    return 0


def _pack(run: Path, settings: Sequence[str]) -> int:
    given: dict[str, Any] = dict(word.partition("=")[::2] for word in settings)
    for key in given:
        if key not in _PACK:
            raise ConfigError(unknown("option of zoo pack", key, _PACK))
    from tactileforge.hub.pack import pack_run

    benches = [Path(word) for word in given.pop("gate", "").split(",") if word]
    path = pack_run(run, **given)
    if benches:
        model = str(given.get("name", ""))
        _put(model, benches, [f"run:{run}", f"file:{path}"])
        gates.stamp_card(_card(model), model.partition(".")[2], sha256(path), path.stat().st_size)
    print(f"{path}: {path.stat().st_size / 1e6:.1f} MB, sha256 {sha256(path)}")
    print(f'load it: tactileforge.load("file:{path}")')
    return 0


def _gate(model: str, benches: Sequence[Path]) -> int:
    card, weight = cards.find_card(model)
    words = [f"{card.name}.{weight.tag}", f"file:{cards.zoo_folder() / weight.file}"]
    _put(words[0], benches, words, weight.sha256)
    return 0


def _put(model: str, benches: Sequence[Path], words: Sequence[str], sha256: str = "") -> None:
    """Writes the gate of a model into its card."""
    card, weight = cards.find_card(model)
    path = _card(card.name)
    rows = [row for bench in benches for row in gates.read_gates(bench, weight.tag, words, sha256)]
    gates.write_gates(path, rows)
    print(f"{path}: {gates.gate_verdict(rows)}")


def _card(model: str) -> Path:
    return Path(str(cards.zoo_folder() / "recipe" / f"{model.partition('.')[0]}.md"))
