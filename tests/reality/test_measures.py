"""Each measurement on pictures with a known answer."""

from itertools import pairwise

import cv2
import numpy as np
import pytest
from reality import measures
from reality.measures import BANDS, LOW, RINGS, SIDE

SIZE = (240, 320, 3)


def white(seed: int, deviation: float = 1.0) -> np.ndarray:
    """White noise, the same in all channels."""
    noise = np.random.default_rng(seed).normal(0, deviation, (*SIZE[:2], 1))
    return np.repeat(noise, 3, axis=2).astype(np.float32)


def disc(level: tuple[float, float, float], radius: float = 40.0) -> np.ndarray:
    """A round change of a level for each channel."""
    y, x = np.mgrid[: SIZE[0], : SIZE[1]]
    inside = np.hypot(y - 120, x - 160) < radius
    return (inside[..., None] * np.array(level)).astype(np.float32)


def test_white_noise_has_a_flat_spectrum_of_its_variance():
    power = np.mean([measures.radial(white(seed, 3.0)) for seed in range(8)], axis=0)
    assert power[2:] == pytest.approx(np.full(38, 9.0), rel=0.15)
    assert power[2:].mean() == pytest.approx(9.0, rel=0.02)
    bands = np.mean([measures.bands(white(seed)) for seed in range(8)], axis=0)
    assert bands == pytest.approx(np.zeros(4), abs=0.06), "its mean is taken out of the low"


def test_noise_that_channels_do_not_share_is_averaged_by_three():
    change = np.random.default_rng(0).normal(0, 3, SIZE).astype(np.float32)
    assert measures.radial(change)[2:].mean() == pytest.approx(3.0, rel=0.02)


@pytest.mark.parametrize("blur", [0.8, 1.5])
def test_a_blur_takes_away_what_its_transform_says(blur):
    before = np.mean([measures.radial(white(seed)) for seed in range(4)], axis=0)
    blurred = (cv2.GaussianBlur(white(seed), (0, 0), blur) for seed in range(4))
    after = np.mean([measures.radial(image) for image in blurred], axis=0)
    wanted = -((2 * np.pi * blur * RINGS) ** 2) / np.log(10)
    seen = (wanted > -2) & (RINGS > LOW)  # below, the cut-off tails of the kernel show
    assert seen.sum() > 14
    assert np.log10(after / before)[seen] == pytest.approx(wanted[seen], abs=0.1)


def test_a_wave_is_in_the_band_of_its_frequency():
    x = np.arange(SIZE[1]) / SIZE[1]
    for number, (start, stop) in enumerate(pairwise(BANDS)):
        wave = np.sin(2 * np.pi * 320 * (start + stop) / 2 * x) + np.sin(2 * np.pi * 3 * x)
        change = np.broadcast_to(wave[None, :, None], SIZE) * 5
        assert measures.bands(change).argmax() == number


def test_frequencies_are_those_of_240_rows():
    half = white(0)[:120, :160]
    bands = measures.bands(half)
    assert np.isfinite(bands[:2]).all()
    assert np.isnan(bands[2:]).all(), "120 rows reach 0.25 cycles per pixel of 240"
    assert np.isnan(measures.radial(half)[-8:]).all()


def test_pictures_are_averaged_down_and_never_enlarged():
    large = np.arange(480 * 640 * 3, dtype=np.float32).reshape(480, 640, 3)
    small = measures.sized(large)
    assert small.shape == (SIDE, 320, 3)
    assert small[0, 0] == pytest.approx(large[:2, :2].mean(axis=(0, 1)))
    assert measures.sized(small[:100]).shape == (100, 320, 3)


@pytest.mark.parametrize("deviation", [0.5, 1.65])
def test_noise_of_a_known_deviation_is_found(deviation):
    rng = np.random.default_rng(1)
    ground = rng.uniform(60, 180, SIZE)
    light = rng.normal(0, 2, 9)  # flicker of the whole picture is not noise of a pixel
    frames = [ground + rng.normal(0, deviation, SIZE) + level for level in light]
    assert measures.noise(frames) == pytest.approx(deviation, rel=0.01)
    frames[4] = frames[4] + disc((60, 60, 60))  # something moves in two pairs of eight
    assert measures.noise(frames) == pytest.approx(deviation, rel=0.02)
    rounded = [np.round(frame) for frame in frames]
    assert measures.noise(rounded) == pytest.approx((deviation**2 + 1 / 12) ** 0.5, rel=0.02)
    assert np.isnan(measures.noise(frames[:1]))


def test_contact_contrast_and_covariance_of_a_disc():
    change = disc((30.0, -20.0, 10.0)) + white(2, 0.5)
    touched = measures.contact(change)
    # The blurred edge counts from a third of the change on: a little more than the disc.
    assert touched.mean() == pytest.approx(np.pi * 41.5**2 / (240 * 320), rel=0.03)
    core = np.abs(disc((1.0, 1.0, 1.0), 36.0)).max(axis=-1) > 0
    assert measures.contrast(change, core) == pytest.approx(20.0, abs=0.05)
    assert not measures.contact(white(3, 1.0)).any(), "noise is not a touch"


def test_covariance_is_that_of_the_channels():
    mixing = np.array([[3.0, 0, 0], [2.0, 1, 0], [-1.0, 0.5, 2]])
    change = np.random.default_rng(4).normal(size=SIZE) @ mixing.T
    matrix = measures.covariance(change.astype(np.float32), np.ones(SIZE[:2], bool))
    assert matrix == pytest.approx(mixing @ mixing.T, abs=0.2)


def test_detail_is_told_apart_inside_and_outside():
    touched = disc((1.0, 1.0, 1.0), 60.0)[..., 0] > 0
    change = disc((50.0, 50.0, 50.0), 60.0) * 0
    change += white(5, 4.0) * touched[..., None] + white(6, 1.0) * ~touched[..., None]
    inside, outside = measures.detail(change, touched)
    # White noise less its blur: 1 - 2 / (8 pi s^2) ... of the variance is left, s = 2 pixels.
    left = (1 - 2 / (2 * np.pi * 4) + 1 / (4 * np.pi * 4)) ** 0.5
    assert inside == pytest.approx(4.0 * left, rel=0.03)
    assert outside == pytest.approx(1.0 * left, rel=0.02)
    assert np.isnan(measures.detail(change, np.ones_like(touched))[1])


def test_distance_of_equal_samples_is_none_and_of_shifted_ones_the_shift():
    sample = np.random.default_rng(7).normal(size=200)
    assert measures.distance(sample, sample) == 0
    assert measures.distance(sample, sample + 0.3) == pytest.approx(0.3)
    assert measures.distance(sample[:50], np.repeat(sample[:50], 3)) == pytest.approx(0)
    assert measures.distance(np.array([0.0, 1.0]), np.array([0.0])) == pytest.approx(0.5)
    assert measures.distance(np.array([np.nan, 2.0]), np.array([1.0])) == pytest.approx(1.0)
    assert np.isnan(measures.distance(np.array([np.nan]), sample))


def test_distance_is_that_between_quantile_functions():
    rng = np.random.default_rng(8)
    a, b = rng.normal(size=37), rng.exponential(size=53)
    at = (np.arange(37 * 53) + 0.5) / (37 * 53)
    wanted = np.abs(np.sort(a)[(at * 37).astype(int)] - np.sort(b)[(at * 53).astype(int)]).mean()
    assert measures.distance(a, b) == pytest.approx(wanted)
