"""Each class breaks one thing, and its check sees it."""

import pytest
import torch
from torch import nn


class Mean(nn.Module):
    """A correct head; the others break one thing."""

    def __init__(self, encoder) -> None:
        super().__init__()
        self.linear = nn.Linear(encoder.width, 1)

    def forward(self, views, batch):
        return {"score": self.linear(views.full.tokens.mean(1))}


class FixedSize(Mean):
    def forward(self, views, batch):
        return views.full.tokens.reshape(-1, 14, 192)


class DividesByZero(Mean):
    def forward(self, views, batch):
        return super().forward(views, batch)["score"] / 0


class NoisyHead(Mean):
    def forward(self, views, batch):
        return super().forward(views, batch)["score"] + torch.rand(1)


class CentredHead(Mean):
    def forward(self, views, batch):
        score = super().forward(views, batch)["score"]
        return score - score.mean()


class BranchingHead(Mean):
    def forward(self, views, batch):
        score = super().forward(views, batch)["score"]
        return score if score.sum() > 0 else -score


class ForgetfulHead(Mean):
    def __init__(self, encoder) -> None:
        super().__init__(encoder)
        self.shift = torch.rand(1)

    def forward(self, views, batch):
        return super().forward(views, batch)["score"] + self.shift


@pytest.mark.slow
@pytest.mark.parametrize(
    ("plugin", "names"),
    [
        (Mean, set()),
        (FixedSize, {"sizes follow the encoder"}),
        (
            DividesByZero,
            {"sizes follow the encoder", "batch of one equals a row", "torch export matches"},
        ),
        (NoisyHead, {"eval is deterministic"}),
        (CentredHead, {"batch of one equals a row"}),
        (BranchingHead, {"torch export matches"}),
        (ForgetfulHead, {"save and load are bit equal"}),
    ],
)
def test_heads(failed, plugin, names):
    assert set(failed("head", plugin)) == names
