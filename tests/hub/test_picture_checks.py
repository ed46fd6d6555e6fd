"""Warnings of pictures that lie on their side, are mirrored, or have other colours, once each."""

import warnings

import numpy as np
import pytest
import torch

from tactileforge.checks.made import resting
from tactileforge.hub.picture_checks import PictureChecks

STILL = resting().astype(np.uint8)


@pytest.mark.parametrize(
    ("code", "picture"),
    [
        ("TF308", STILL[:, ::-1]),
        ("TF307", np.rot90(STILL)),
        ("TF306", STILL[..., ::-1]),
        ("TF308", torch.from_numpy(STILL[:, ::-1].copy()).movedim(-1, 0)),
        ("TF308", np.stack([STILL[:, ::-1]] * 2)),
    ],
)
def test_an_odd_background_is_told_once(code: str, picture: np.ndarray) -> None:
    checks = PictureChecks()
    with pytest.warns(UserWarning, match=rf"{code} .* for a digit.*checks=False"):
        checks(picture, "digit")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        checks(picture, "digit")


@pytest.mark.parametrize(
    ("picture", "sensor"),
    [
        (STILL, "digit"),
        (STILL[:, ::-1], "gelslim"),  # its colours are not known
        (STILL[:, ::-1], None),
        ("first", "digit"),
        (None, "digit"),
        (np.full((80, 60, 3), 110, np.uint8), "digit"),
    ],
)
def test_what_cannot_be_told_is_passed_in_silence(picture: object, sensor: str | None) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        PictureChecks()(picture, sensor)
