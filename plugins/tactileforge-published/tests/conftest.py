from hub_fixtures import add_card, card_text, checkpoint, header, vit, weight  # noqa: F401
from published_weights import published  # noqa: F401
from shared_fixtures import *  # noqa: F403
