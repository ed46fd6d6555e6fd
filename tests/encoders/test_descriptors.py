"""Descriptors of pictures against what the pictures were made of."""

import torch

from tactileforge.encoders.descriptors import Descriptors, gradient_histograms


def picture(seed: int = 0, size: int = 128) -> torch.Tensor:
    """(2, 3, size, size) about 127.5."""
    generator = torch.Generator().manual_seed(seed)
    return 127.5 + 20 * torch.randn(2, 3, size, size, generator=generator)


def test_maps_have_the_means_of_each_cell() -> None:
    means, histograms, roughness = Descriptors().maps(picture())
    assert means.shape == (2, 48, 8, 8)
    assert histograms.shape == (2, 9, 8, 8)
    assert roughness.shape == (2, 3, 8, 8)
    cell = (picture()[:, 1, 16:32, 32:48] - 127.5) / 255
    wanted = cell.reshape(2, 4, 4, 4, 4).mean((2, 4)).flatten(1)
    torch.testing.assert_close(means[:, 16:32, 1, 2], wanted)


def test_a_mirrored_picture_has_mirrored_cells() -> None:
    tower = Descriptors()
    _, _, rough = tower.maps(picture())
    _, _, mirrored = tower.maps(picture().flip(3))
    torch.testing.assert_close(mirrored, rough.flip(3))
    small, flipped = (tower(x)[:, :192].view(2, 3, 8, 8) for x in (picture(), picture().flip(3)))
    torch.testing.assert_close(flipped, small.flip(3))


def test_a_stronger_touch_has_larger_descriptors() -> None:
    tower, x = Descriptors(), picture()
    _, edges, rough = tower.maps(x)
    _, more_edges, rougher = tower.maps(127.5 + 2 * (x - 127.5))
    assert (more_edges > edges).all()
    assert (rougher > rough).all()


def test_gradients_are_in_the_bin_of_their_direction() -> None:
    ramp = torch.arange(128.0).expand(1, 3, 128, 128)
    for x, wanted in ((ramp, 0), (ramp.mT, 4)):
        inner = gradient_histograms(x)[0, :, 1:-1, 1:-1]
        assert (inner.argmax(0) == wanted).all()
        # differences over two pixels, one grey level each
        torch.testing.assert_close(inner.sum(0), torch.full((6, 6), 2.0))


def test_a_picture_without_touch_and_any_size_will_do() -> None:
    tower = Descriptors()
    for size in (32, 128, 200):
        x = torch.full((1, 3, size, size), 127.5)
        assert tower(x).shape == (1, tower.width)
        assert all(part.isfinite().all() for part in (tower(x), *tower.maps(x)))
