"""The head ``markers``: displacement of the gel below each patch token."""

from __future__ import annotations

from torch import Tensor, nn

from tactileforge.contracts import Batch, Encoder, Views


class MarkersHead(nn.Module):
    """One linear layer from each patch token to the displacement of the markers below the patch.

    As the head is linear, the tokens have to carry the displacement in a form usable by any other
    linear layer.

    Args:
        encoder: The touch encoder (given by the framework).
    """

    def __init__(self, encoder: Encoder) -> None:
        super().__init__()
        self.grid, self.prefix, self.tube = encoder.grid, encoder.prefix, encoder.tube
        self.linear = nn.Linear(encoder.width, 2 * self.tube)
        nn.init.normal_(self.linear.weight, std=0.01)
        nn.init.zeros_(self.linear.bias)

    def forward(self, views: Views, batch: Batch) -> Tensor:
        """Predicts displacements to the right and down, float (B, T, 2, rows, columns).

        They are in percent of the picture's shorter side.
        """
        slots, rows, columns = self.grid
        x: Tensor = self.linear(views.full.tokens[:, self.prefix :])
        x = x.view(-1, slots, rows, columns, self.tube, 2).permute(0, 1, 4, 5, 2, 3)
        return x.reshape(len(x), slots * self.tube, 2, rows, columns)
