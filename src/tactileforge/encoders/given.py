"""Views of a batch with tokens computed in advance by a frozen encoder."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from torch import Tensor

from tactileforge.contracts import Batch, Features, Views
from tactileforge.errors import TactileForgeError


@dataclass(frozen=True)
class GivenViews:
    """The full view of touches with known tokens. There are no pixels to mask.

    Attributes:
        encoder: Encoder of the tokens.
        tokens: float (B, F, L, width), tokens of F touches per sample; None for a batch without
            touch.
    """

    encoder: Any
    tokens: Tensor | None

    @property
    def full(self) -> Features:
        """Features with every patch visible, one row per touch."""
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
    """Views of a batch, from its frames or else from its tokens.

    Args:
        encoder: Touch encoder.
        batch: Batch, see `tactileforge.contracts`; a batch without touch has neither frames nor
            tokens.
        universal: Chance of the universal sensor tokens for a sample, 0 to 1.
    """
    if "frames" in batch:
        views: Views = encoder.views(batch, universal)
        return views
    return GivenViews(encoder, batch.get("tokens"))
