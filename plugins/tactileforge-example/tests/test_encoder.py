import torch
from tactileforge_example.encoder import SmallCnn

from tactileforge.testing import batch, check


def test_conformance():
    results = check("encoder", "small_cnn")
    assert not [result for result in results if result.status == "failed"], results


def test_what_is_hidden_changes_nothing():
    encoder = SmallCnn(width=16, image_size=32).eval()
    patches = torch.randn(2, 2, 16, 384)
    kept = torch.tensor([[0, 3, 5]] * 2)
    sensor = encoder.sensor_ids(["digit", "gelsight"])
    seen = encoder.encode(patches, sensor, kept)
    assert seen.shape == (2, 6, 16)
    patches[:, :, 1] += 9
    assert torch.equal(encoder.encode(patches, sensor, kept), seen)
    patches[:, :, 3] += 9
    assert not torch.equal(encoder.encode(patches, sensor, kept), seen)


def test_a_press_changes_the_vector():
    made = batch(size=2)
    encoder = SmallCnn(width=16, image_size=32).eval()
    still = made | {"frames": made["background"][:, None].expand(-1, 4, -1, -1, -1)}
    assert not torch.equal(encoder.views(made).full.cls, encoder.views(still).full.cls)
