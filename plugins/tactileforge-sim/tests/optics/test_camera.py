import numpy as np
import pytest
import torch
from tactileforge_sim.optics.camera import CameraModel, Codec, Lens


def test_blur_of_a_wave_is_known() -> None:
    """A Gaussian of deviation s shrinks a wave of w rad/pixel by exp(-s^2 w^2 / 2)."""
    x = torch.arange(128)
    wave = 2 * np.pi / 12
    picture = (100 * torch.cos(wave * x)).expand(1, 3, 64, 128)
    out = Lens(1.5, 1)(picture)
    wanted = picture * np.exp(-0.5 * (1.5 * wave) ** 2)
    torch.testing.assert_close(out[..., 20:-20], wanted[..., 20:-20], rtol=0, atol=0.5)


def test_a_sharp_lens_changes_nothing_and_a_shrunk_picture_is_a_mean() -> None:
    picture = torch.rand(2, 3, 12, 18, generator=torch.Generator().manual_seed(0))
    assert torch.equal(Lens(0.0, 1)(picture), picture)
    shrunk = Lens(0.0, 3)(picture)
    torch.testing.assert_close(shrunk, torch.nn.functional.avg_pool2d(picture, 3))
    even = Lens(1.2, 2)(torch.full((1, 3, 20, 30), 7.0))
    torch.testing.assert_close(even, torch.full((1, 3, 10, 15), 7.0))


def test_distortion_is_undone() -> None:
    camera = CameraModel(distortion=0.06)
    places = camera.places(60, 80, 0.2)
    still = CameraModel().places(60, 80, 0.2)
    assert float((places - still).abs().max()) == pytest.approx(0.06 * 79 / 2 * 0.2, rel=0.05)
    back = camera.seen(places, 60, 80, 0.2)
    torch.testing.assert_close(back, still, rtol=0, atol=0.005)


def test_tone() -> None:
    light = torch.tensor([51.0, 127.5, 255.0])
    torch.testing.assert_close(CameraModel().tone(light.clone()), light)
    torch.testing.assert_close(CameraModel(exposure=2.0).tone(light.clone()), 2 * light)
    wanted = 255 * (light / 255) ** 1.2
    torch.testing.assert_close(CameraModel(gamma=1.2).tone(light.clone()), wanted)


@pytest.mark.parametrize("camera", [CameraModel(jpeg=20), CameraModel(mpeg=40)])
def test_codecs_lose_what_is_fine_and_little_else(camera: CameraModel) -> None:
    chance = np.random.default_rng(0)
    ramp = np.linspace(40, 200, 64)[:, None, None] + np.zeros((64, 80, 3))
    film = np.stack([ramp + i + chance.normal(0, 3, ramp.shape) for i in range(6)])
    pictures = film.clip(0, 255).astype(np.uint8)
    out = Codec(camera)(pictures)
    assert out.shape == pictures.shape
    assert 0.2 < np.abs(out.astype(int) - pictures).mean() < 4
    # What is decoded follows the film: errors of the change do not add up.
    assert np.abs(out[-1].astype(float).mean() - pictures[-1].mean()) < 1


def test_a_codec_goes_on_where_it_was() -> None:
    chance = np.random.default_rng(1)
    pictures = chance.integers(0, 255, (6, 16, 24, 3)).astype(np.uint8)
    whole = Codec(CameraModel(mpeg=30))(pictures)
    parts = Codec(CameraModel(mpeg=30))
    np.testing.assert_array_equal(np.concatenate([parts(pictures[:2]), parts(pictures[2:])]), whole)
    assert np.array_equal(Codec(CameraModel())(pictures), pictures)
