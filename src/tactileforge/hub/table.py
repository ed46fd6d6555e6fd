"""Cards as tables: aligned columns for the terminal, and the page of the documentation."""

from __future__ import annotations

from collections.abc import Sequence

from tactileforge.hub import cards

_INTRO = """\
# The zoo

This page is made from the cards in `zoo/recipe/`. Write it again with
`tactileforge zoo list --markdown > docs/zoo.md`. See also [Load a model](load-a-model.md).

`shipped` weights come with the package, and `remote` ones are downloaded when they are first
loaded. `import` means that you download what the authors publish, and import it with
`tactileforge zoo get NAME --from FILE`. Licences are SPDX identifiers of the weights; `NOASSERTION`
means that we know of none: ask the authors.
"""


def columns(rows: Sequence[Sequence[str]]) -> str:
    """Rows of words as aligned columns."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return "\n".join("  ".join(map(str.ljust, row, widths)).rstrip() for row in rows)


def markdown(rows: Sequence[Sequence[str]]) -> str:
    """Rows of words as a Markdown table; the first is its head."""
    head, *body = (f"| {' | '.join(row)} |" for row in rows)
    return "\n".join([head, "|---" * len(rows[0]) + "|", *body])


def clip(card: cards.Card, weight: cards.Weight | None) -> str:
    """What a clip is, in words."""
    frames, spacing = card.clip(weight)
    return f"{frames} frames, {spacing:.3g} s apart" if spacing else "1 frame"


def page() -> str:
    """The page ``docs/zoo.md``."""
    models = [("name", "model", "sensors", "clip", "licence", "weights")]
    for name, card, weight in cards.models():
        models.append(
            (
                f"`{name}`",
                f"[{card.title}]({card.code})" if card.code else card.title,
                ", ".join(card.sensors) or "none",
                clip(card, weight),
                weight.licence if weight else card.licence,
                weight.kind if weight else "none",
            )
        )
    parts = [_INTRO, "## Models\n", markdown(models), "\n## Recipes\n"]
    for card in map(cards.read, cards.names()):
        how = f"`tactileforge train recipe={card.name}`" if card.recipe else "importer only"
        parts.append(f"- **{card.title}**: {how}. {card.paper}.")
    parts.append("\n## Results\n")
    parts.append("Numbers of the source that is named, not ours.\n")
    results = [("model", "task", "metric", "value", "source")]
    for card in map(cards.read, cards.names()):
        for r in card.results:
            name = f"`{card.name}.{r.model}`"
            results.append((name, r.task, r.metric, f"{r.value:g} {r.unit}".strip(), r.source))
    return "\n".join([*parts, markdown(results), ""])
