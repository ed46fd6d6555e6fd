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
Real touches that nobody trained on here, ridge probes in closed form ([how](reports/gate.md)): the
value, and what it is above random weights of the same architecture, 16 x 16 pixels, picture
statistics, and photographs with all that is free, with the lower end of the 95 % interval. A model
passes with the features recommended for it if the mean of each suite is above all four beyond the
interval, in value without any one task too, and no task that counts is below random weights beyond
it. Single tasks are shown with these features; [the page of the
gate](reports/gate.md#the-weights-that-ship) has all."""


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
    models = [("name", "model", "sensors", "data", "clip", "licence", "weights")]
    for name, card, weight in cards.list_cards():
        sensors, data = card.trained_on(weight)
        models.append(
            (
                f"`{name}`",
                f"[{card.title}]({card.code})" if card.code else card.title,
                ", ".join(sensors) or "none",
                ", ".join(data) or "none",
                describe_clip(card, weight),
                weight.licence if weight else card.licence,
                (weight.kind + ", demonstration" * weight.demonstration) if weight else "none",
            )
        )
    parts = [_INTRO, "## Models\n", markdown_table(models), "\n## Recipes\n"]
    for card in map(cards.read_card, cards.card_names()):
        how = f"`tactileforge train recipe={card.name}`" if card.recipe else "importer only"
        parts.append(f"- **{card.title}**: {how}. {card.paper}.")
    parts += ["\n## Release gate\n", _GATE]
    for name, card, weight in cards.list_cards():
        if weight and (rows := measured_rows(card, weight)):
            kept = " Kept as a demonstration." if weight.demonstration else ""
            parts += [f"\n`{name}` {weight.gate}.{kept}\n", markdown_table(rows)]
    parts.append("\n## Results\n")
    parts.append("Numbers of the source that is named, not ours.\n")
    results = [("model", "task", "metric", "value", "source")]
    for card in map(cards.read_card, cards.card_names()):
        for r in card.results:
            name = f"`{card.name}.{r.model}`"
            results.append((name, r.task, r.metric, f"{r.value:g} {r.unit}".strip(), r.source))
    return "\n".join([*parts, markdown_table(results), ""])
