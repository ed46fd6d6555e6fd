import pytest
import torch

from tactileforge.cpu import PackedLinear, for_cpu
from tactileforge.encoders.plain_vit import PlainViT
from tactileforge.encoders.tactile_vit import TactileViT
from tactileforge.errors import ConfigError

pytestmark = pytest.mark.skipif(
    not torch.backends.mkldnn.is_available(), reason="this torch has no oneDNN"
)


@pytest.mark.parametrize("kind", [TactileViT, PlainViT])
@pytest.mark.parametrize("batch", [1, 3])
def test_the_numbers_stay(kind: type[torch.nn.Module], batch: int) -> None:
    encoder = kind(size="tiny", frames=4, image_size=32)
    before = {key: value.clone() for key, value in encoder.state_dict().items()}
    linears = sum(isinstance(module, torch.nn.Linear) for module in encoder.modules())
    packed = for_cpu(encoder)
    frames = torch.randint(0, 256, (batch, 4, 3, 40, 50), dtype=torch.uint8)
    rows = encoder.rows(["digit"] * batch)
    with torch.inference_mode():
        expected = encoder.eval()(frames, frames[:, 0], rows)
        found = packed(frames, frames[:, 0], rows)
    for mine, theirs in zip(expected, found, strict=True):
        assert (mine - theirs).abs().max() < 1e-5
    assert sum(isinstance(module, PackedLinear) for module in packed.modules()) == linears
    assert not any(isinstance(module, torch.nn.Linear) for module in packed.modules())
    assert all(torch.equal(value, before[key]) for key, value in encoder.state_dict().items())


def test_the_encoder_can_still_be_trained() -> None:
    encoder = TactileViT("tiny", frames=2, image_size=32)
    packed = for_cpu(encoder)
    frames = torch.zeros(1, 2, 3, 32, 32, dtype=torch.uint8)
    encoder(frames, frames[:, 0], torch.tensor([0]))[1].sum().backward()
    assert encoder.project.weight.grad is not None
    assert encoder.training
    assert not packed.training


def test_other_types_are_an_error() -> None:
    with pytest.raises(ConfigError, match=r"torch.float16 on cpu: give it as encoder.float"):
        for_cpu(TactileViT("tiny", frames=2, image_size=32).half())
