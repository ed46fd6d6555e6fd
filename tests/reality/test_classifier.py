"""Equal patches cannot be told apart, and different ones can, by their difference."""

import cv2
import numpy as np
import pytest
import torch
from reality.classifier import VIEWS, PatchSplit, auc, told_apart
from reality.patches import PATCH, patch_colours, patch_spectra

from tactileforge.errors import ConfigError


def patches(seed: int, count: int = 120, blur: float = 0.0, red: float = 1.0) -> np.ndarray:
    """Patches of noise, blurred or not, with a stronger or weaker red."""
    noise = np.random.default_rng(seed).normal(0, 5, (count, PATCH, PATCH, 3)).astype(np.float32)
    if blur:
        noise = np.stack([5 * cv2.GaussianBlur(image, (0, 0), blur) for image in noise])
    return noise * np.array([red, 1, 1], np.float32)


def score(view: str, **how: float) -> float:
    train = PatchSplit(patches(0), patches(1, **how))
    test = PatchSplit(patches(2), patches(3, **how))
    result = told_apart(train, test, view, steps=60 if view == "pixels" else 150)
    assert result.patches == (120, 120)
    return result.auc


@pytest.mark.slow
@pytest.mark.parametrize("view", VIEWS)
def test_sets_that_are_alike_are_not_told_apart(view):
    assert score(view) == pytest.approx(0.5, abs=0.12)


@pytest.mark.slow
def test_what_differs_is_seen_by_what_looks_at_it():
    assert score("spectrum", blur=0.8) > 0.99
    assert score("colour", red=2.0) > 0.99
    assert score("pixels", blur=0.8) > 0.95


def test_classes_are_balanced_and_too_few_are_an_error():
    balanced = PatchSplit(patches(0, 100), patches(1, 20)).balanced()
    assert len(balanced.real) == len(balanced.simulated) == 20
    with pytest.raises(ConfigError, match=r"3 real and 20 simulated.*give more touches"):
        PatchSplit(patches(0, 3), patches(1, 20)).balanced()


def test_auc_counts_pairs():
    scores = torch.tensor([0.1, 0.4, 0.4, 0.9])
    assert auc(scores, torch.tensor([False, False, True, True])) == 0.875
    assert auc(scores, scores > 0.5) == 1.0


def test_features_are_those_of_noise():
    cut = patches(0, 40)
    # Mean of three channels of variance 25 has 25/3.
    bands = np.exp(patch_spectra(cut)).mean(axis=0)
    assert bands[1:] == pytest.approx(np.full(9, 25 / 3), rel=0.1), "the first loses the mean"
    told = patch_colours(cut)
    assert told.shape == (40, 9)
    assert np.exp(told[:, 3:6]).mean() == pytest.approx(5.0, rel=0.02)
    assert told[:, 6:].mean() == pytest.approx(0.0, abs=0.02)
