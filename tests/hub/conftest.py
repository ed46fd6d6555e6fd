from hub_fixtures import add_card, card_text, checkpoint, header, vit, weight  # noqa: F401
