"""Views of touches with known tokens: a finished pass, or tokens computed in advance."""

from __future__ import annotations

from collections.abc import Set as AbstractSet
from dataclasses import dataclass
from typing import Any

from torch import Tensor

from tactileforge.contracts import Batch, Features, Views
from tactileforge.encoders.backbone import TactileViews
from tactileforge.errors import TactileForgeError


@dataclass(frozen=True)
class ComputedViews:
    """The full view of touches with known tokens. There are no pixels to mask.

    Attributes:
        features: Features with every patch visible; None for a batch without touch.
    """

    features: Features | None

    @classmethod
    def of(cls, encoder: Any, tokens: Tensor, projected: Tensor) -> ComputedViews:
        """Views of the outputs of an encoder's pass.

        Args:
            encoder: The touch encoder.
            tokens: Float (B, L, width).
            projected: Float (B, projected).
        """
        return cls(Features(tokens, projected, encoder.prefix, encoder.grid))

    @property
    def full(self) -> Features:
        """Features with every patch visible, one row per touch."""
        if self.features is None:
            raise TactileForgeError("the batch has neither frames nor tokens of touch")
        return self.features

    @property
    def patches(self) -> Tensor:
        """Raises a TactileForgeError: there are no pixels."""
        raise TactileForgeError("the encoder's tokens were computed once: there are no pixels")

    @property
    def masked(self) -> Any:
        """Raises a TactileForgeError: there are no pixels."""
        return self.patches

    def other(self, batch: Batch, kept: Tensor | None = None) -> Any:
        """Raises a TactileForgeError: there are no pixels."""
        return self.patches


def views_of(
    encoder: Any, batch: Batch, universal: float = 0.0, reads: AbstractSet[str] = frozenset()
) -> Views:
    """Views of a batch, from its frames or else from its tokens.

    Args:
        encoder: Touch encoder.
        batch: Batch, see `tactileforge.contracts`; ``tokens`` are float (B, F, L, width), of F
            touches per sample. A batch without touch has neither frames nor tokens.
        universal: Chance of the universal sensor tokens for a sample, 0 to 1.
        reads: Views that are known to be read, ``full`` or ``masked``: both are computed at once.
    """
    if "frames" in batch:
        views: Views = encoder.views(batch, universal)
        if isinstance(views, TactileViews) and reads >= {"full", "masked"}:
            views.compute_both()
        return views
    if "tokens" not in batch:
        return ComputedViews(None)
    # kept as float16; the touches of a sample are rows, as they are for an encoder
    tokens = batch["tokens"].flatten(0, 1).float()
    return ComputedViews.of(encoder, tokens, encoder.pool_tokens(tokens))
