"""Names of the shipped models."""

from tactileforge.hub import cards

SHIPPED = sorted(
    name for name, _, weight in cards.list_cards() if weight and weight.kind == "shipped"
)
