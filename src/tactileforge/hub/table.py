"""Cards as tables: aligned columns for the terminal, and the page of the documentation."""

from __future__ import annotations

from tactileforge.hub import cards
from tactileforge.pages.text_tables import markdown_table

_INTRO = """\
# The zoo

This page is made from the cards in `zoo/recipe/`. Write it again with
`tactileforge zoo list --markdown > docs/zoo.md`. See also [Load a model](load-a-model.md).

`shipped` weights come with the package, and `remote` ones are downloaded when they are first
loaded. `import` means that you download what the authors publish, and import it with
`tactileforge zoo get NAME --from FILE`. Licences are SPDX identifiers of the weights; `NOASSERTION`
means that we know of none: ask the authors.
"""


_GATE = """\
Of the weights that ship. [The page of the gate](reports/gate.md) says what passes, and has every
value; `tactileforge zoo show NAME all=true` has those of one model."""


def describe_clip(card: cards.Card, weight: cards.Weight | None) -> str:
    """Describes the clip of a model in words."""
    frames, spacing = card.clip(weight)
    return f"{frames} frames, {spacing:.3g} s apart" if spacing else "1 frame"


def measured_rows(card: cards.Card, weight: cards.Weight) -> list[tuple[str, ...]]:
    """Numbers of ours for some weights, with a header row; empty if not measured."""
    measured = card.measurements(weight)
    names = list(dict.fromkeys(name for row in measured for name in row.above))
    rows = [
        (
            f"{row.task} ({row.suite})",
            row.tokens,
            row.metric,
            f"{row.value:.3f}",
            f"{row.chance:.3f}",
            *(_lead(row.above.get(name)) for name in names),
            "" if row.counted else "not counted",
        )
        for row in measured
    ]
    head = ("task", "tokens", "metric", "value", "chance", *(f"above {name}" for name in names), "")
    return [head, *rows] if rows else []


def _lead(above: list[float] | None) -> str:
    return f"{above[0]:+.3f} (> {above[1]:+.3f})" if above else ""


def zoo_page() -> str:
    """The page ``docs/zoo.md``."""
    models: dict[tuple[str, ...], list[str]] = {}
    for name, card, weight in cards.list_cards():
        sensors, data = card.trained_on(weight)
        row = (
            f"[{card.title}]({card.code})" if card.code else card.title,
            ", ".join(sensors) or "none",
            ", ".join(data) or "none",
            describe_clip(card, weight),
            weight.licence if weight else card.licence,
            (weight.kind + ", demonstration" * weight.demonstration) if weight else "none",
        )
        models.setdefault(row, []).append(f"`{name}`")
    head = ("name", "model", "sensors", "data", "clip", "licence", "weights")
    table = markdown_table([head, *((", ".join(names), *row) for row, names in models.items())])
    parts = [_INTRO, "## Models\n", table, "\n## Recipes\n"]
    for card in map(cards.read_card, cards.card_names()):
        how = f"`tactileforge train recipe={card.name}`" if card.recipe else "importer only"
        parts.append(f"- **{card.title}**: {how}. {card.paper}.")
    parts += ["\n## Release gate\n", _GATE]
    for name, card, weight in cards.list_cards():
        if weight and card.measurements(weight):
            kept = " Kept as a demonstration." if weight.demonstration else ""
            parts.append(f"\n`{name}` {weight.gate}.{kept}")
    parts.append("\n## Results\n")
    parts.append("Numbers of the source that is named, not ours.\n")
    results: dict[tuple[str, str, str], list[str]] = {}
    for card in map(cards.read_card, cards.card_names()):
        for r in card.results:
            metric = f"{r.metric}, {r.unit}" if r.unit else r.metric
            value = f"`{card.name}.{r.model}` {r.value:g}"
            results.setdefault((r.task, metric, r.source), []).append(value)
    rows = [(task, metric, ", ".join(all_), of) for (task, metric, of), all_ in results.items()]
    table = markdown_table([("task", "metric", "models", "source"), *rows])
    return "\n".join([*parts, table, ""])
