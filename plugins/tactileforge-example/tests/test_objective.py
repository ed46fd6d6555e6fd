import pytest
import torch
from tactileforge_example.objective import ContactArea, contact_area

from tactileforge.testing import batch, check


@pytest.mark.parametrize("kind", ["head", "objective"])
def test_conformance(kind):
    results = check(kind, "contact_area")
    assert not [result for result in results if result.status == "failed"], results


def test_area_is_the_share_of_changed_pixels():
    background = torch.full((1, 3, 8, 8), 100, dtype=torch.uint8)
    frames = background[:, None].repeat(1, 2, 1, 1, 1)
    frames[0, 1, :, :4, :4] = 60
    assert contact_area(frames, background, threshold=10).tolist() == [[0.0, 0.25]]


def test_samples_without_background_change_nothing():
    made = batch(size=4)
    prediction = torch.rand(4, 2)
    half = {key: value[:2] for key, value in made.items()}
    made["background"][2:] = 130
    objective = ContactArea()
    (some, _), (all_of, _) = objective(prediction, made), objective(prediction[:2], half)
    assert (some.item(), some.count) == (all_of.item(), 2)
