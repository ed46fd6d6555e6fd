from collections.abc import Iterator, Mapping
from typing import Any

import pytest
import tactileforge_published
import torch
from hub_fixtures import add_card, card_text, checkpoint, header, vit, weight  # noqa: F401
from published_weights import published  # noqa: F401
from shared_fixtures import *  # noqa: F403


@pytest.fixture(autouse=True, scope="session")
def _encoders_of_the_same_options_are_built_once() -> Iterator[None]:
    """To know the shapes of its tensors takes longer than to convert a small file."""
    found = tactileforge_published._shapes
    known: dict[str, dict[str, torch.Size]] = {}

    def shapes(encoder: str, options: Mapping[str, Any]) -> dict[str, torch.Size]:
        asked = f"{encoder} {sorted(options.items())!r}"
        if asked not in known:
            known[asked] = found(encoder, options)
        return known[asked]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(tactileforge_published, "_shapes", shapes)
        yield
