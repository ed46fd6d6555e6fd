"""Names of the models that come with the package."""

from tactileforge.hub import cards

SHIPPED = sorted(
    name for name, _, weight in cards.list_cards() if weight and weight.kind == "shipped"
)
