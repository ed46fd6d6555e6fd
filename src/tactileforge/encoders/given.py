"""Views of a batch whose tokens are given: those of a frozen encoder, computed once."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from torch import Tensor

from tactileforge.contracts import Batch, Features, Views
from tactileforge.errors import TactileForgeError


@dataclass(frozen=True)
class GivenViews:
    """The full view of touches whose tokens are known; there are no pixels to mask.

    Attributes:
        encoder: Whose tokens they are.
        tokens: float (B, F, L, width), of F touches a sample.
    """

    encoder: Any
    tokens: Tensor | None

    @property
    def full(self) -> Features:
        """Every patch is seen; a row a touch."""
        if self.tokens is None:
            raise TactileForgeError("the batch has neither frames nor tokens of touch")
        tokens = self.tokens.flatten(0, 1).float()
        cls = self.encoder.pool_tokens(tokens)
        return Features(tokens, cls, self.encoder.prefix, self.encoder.grid)

    @property
    def patches(self) -> Tensor:
        """Raises a TactileForgeError: there are no pixels."""
        raise TactileForgeError("the encoder's tokens were computed once: there are no pixels")

    @property
    def masked(self) -> Any:
        """Raises a TactileForgeError: there are no pixels."""
        return self.patches


def views_of(encoder: Any, batch: Batch, universal: float = 0.0) -> Views:
    """The views of a batch: of its tokens where it has them, else of its frames.

    Args:
        encoder: The touch encoder.
        batch: See `tactileforge.contracts`; one without touch has neither.
        universal: Chance that a sample is given the universal sensor tokens.
    """
    if "frames" in batch:
        views: Views = encoder.views(batch, universal)
        return views
    return GivenViews(encoder, batch.get("tokens"))
