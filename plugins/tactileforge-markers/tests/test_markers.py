"""The head and objective of markers: conformance, targets, scores."""

import pytest
import torch
from tactileforge_markers.head import MarkersHead
from tactileforge_markers.objective import Markers, target

from tactileforge.testing import check


def labelled(field):
    return {
        "marker_field": field,
        "marker_field_valid": torch.ones(field.shape[:2], dtype=torch.bool),
    }


@pytest.mark.slow
def test_conformance():
    results = check("head", MarkersHead) + check("objective", Markers, head=MarkersHead)
    assert not [result for result in results if result.status in ("failed", "expected")], results


def test_a_field_is_taken_to_the_tokens():
    """A field growing evenly to the right has at a token the value of the token's middle."""
    x = (torch.arange(12) + 0.5) / 12
    field = torch.stack([x.expand(12, 12), torch.zeros(12, 12)], -1).expand(1, 2, -1, -1, -1)
    found = target(torch.zeros(1, 2, 2, 4, 4), labelled(field))
    middle = (torch.arange(4) + 0.5) / 4
    torch.testing.assert_close(found[0, 0, 0, 2, 1:3], middle[1:3])
    assert not found[:, :, 1].any()


def test_unlabelled_frames_change_nothing():
    field = torch.randn(2, 3, 4, 4, 2)
    prediction = torch.randn(2, 3, 2, 4, 4)
    batch = labelled(field)
    batch["marker_field_valid"][1] = False
    loss, _ = Markers()(prediction, batch)
    wanted = ((prediction[0] - field[0].permute(0, 3, 1, 2)) ** 2).mean()
    assert (round(loss.item(), 5), loss.count.item()) == (round(wanted.item(), 5), 3)


def test_scores():
    objective, batch = Markers(), labelled(torch.randn(2, 3, 4, 4, 2))
    exact = batch["marker_field"].permute(0, 1, 4, 2, 3)
    assert objective.scores(objective.sums(exact, batch)) == {"r2_x": 1.0, "r2_y": 1.0}
    nothing = objective.scores(objective.sums(0 * exact, batch))
    assert all(score < 0.05 for score in nothing.values())
    batch["marker_field_valid"][:] = False
    assert objective.scores(objective.sums(exact, batch)) == {}
