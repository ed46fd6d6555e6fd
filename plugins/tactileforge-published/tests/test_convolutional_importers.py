"""UniVTAC and UniT: each against another implementation of the publication."""

from types import ModuleType

import pytest
import torch
from tactileforge_published import convert
from tactileforge_published.resnet import FixedNorm, ResNet18
from torch import Tensor
from torch.nn import functional as F

from tactileforge.encoders.backbone import Backbone
from tactileforge.errors import ConfigError

State = dict[str, Tensor]


def run(encoder: Backbone, pixels: Tensor) -> tuple[Tensor, Tensor]:
    """Tokens and vector of preprocessed frames (B, T, 3, H, W)."""
    zeros = torch.zeros(len(pixels), dtype=torch.int64)
    tokens = encoder.encode(encoder.patchify(pixels), zeros)
    return tokens, encoder.pool_tokens(tokens)


def test_univtac_is_a_resnet_with_the_statistics_of_its_file(published: ModuleType) -> None:
    """Written out with torch's batch norm and pooling, as torchvision publishes ResNet-18."""
    state = published.fill(published.univtac())
    p = {k.removeprefix("backbone."): v for k, v in state.items() if k.startswith("backbone.")}
    counts = {f"backbone.layer{i}.0.bn1.num_batches_tracked": torch.tensor(7) for i in range(1, 5)}
    encoder = convert(state | counts).build()

    def normed(x: Tensor, conv: str, norm: str, stride: int, pad: int) -> Tensor:
        own = [p[f"{norm}.{x}"] for x in ("running_mean", "running_var", "weight", "bias")]
        return F.batch_norm(F.conv2d(x, p[f"{conv}.weight"], None, stride, pad), *own)

    image = published.noise(2 * 3 * 256 * 256, 1000).view(2, 3, 256, 256).float() + 0.5
    x = F.max_pool2d(F.relu(normed(image, "conv1", "bn1", 2, 3)), 3, 2, 1)
    for stage in range(1, 5):
        for number in range(2):
            name, stride = f"layer{stage}.{number}", 2 if stage > 1 and not number else 1
            y = F.relu(normed(x, f"{name}.conv1", f"{name}.bn1", stride, 1))
            y = normed(y, f"{name}.conv2", f"{name}.bn2", 1, 1)
            skip = f"{name}.downsample"
            x = F.relu(y + (normed(x, f"{skip}.0", f"{skip}.1", 2, 0) if stride == 2 else x))
    want = F.linear(F.adaptive_avg_pool2d(x, 1).flatten(1), p["fc.weight"], p["fc.bias"])
    with torch.no_grad():
        tokens, vector = run(encoder, image[:, None])
    torch.testing.assert_close(tokens, x.flatten(2).mT, atol=2e-4, rtol=1e-4)
    torch.testing.assert_close(vector, want, atol=2e-4, rtol=1e-4)
    assert vector.std() > 0.01


def test_hidden_patches_do_not_reach_a_resnet() -> None:
    encoder = ResNet18(2, (64, 96)).eval()
    patches = torch.randn(2, 2, 6, 3 * 32 * 32)
    kept = torch.tensor([[0, 4], [2, 3]])
    other = torch.randn_like(patches)
    for row, places in enumerate(kept):
        other[row, :, places] = patches[row, :, places]
    zeros = torch.zeros(2, dtype=torch.int64)
    with torch.no_grad():
        first, second = (encoder.encode(x, zeros, kept) for x in (patches, other))
        assert first.shape == (2, 4, 512)
        assert torch.equal(first, second)
        assert not torch.equal(encoder.encode(patches, zeros), encoder.encode(other, zeros))


def test_training_leaves_the_statistics_of_a_fixed_norm() -> None:
    norm = FixedNorm(3).train()
    norm.running_mean += 2
    x = torch.randn(4, 3, 5, 5)
    torch.testing.assert_close(norm(x), (x - 2) / (1 + 1e-5) ** 0.5)
    assert norm.running_mean.tolist() == [2, 2, 2]
    assert len(list(norm.parameters())) == 2


def unit_map(x: Tensor, p: State, levels: int) -> Tensor:
    """Map of UniT before its code book, as the VQGAN of taming transformers is published."""

    def conv(x: Tensor, name: str, stride: int = 1, pad: int = 1) -> Tensor:
        return F.conv2d(x, p[f"{name}.weight"], p[f"{name}.bias"], stride, pad)

    def normed(x: Tensor, name: str) -> Tensor:
        return F.group_norm(x, 32, p[f"{name}.weight"], p[f"{name}.bias"], 1e-6)

    def residual(x: Tensor, name: str) -> Tensor:
        y = normed(x, f"{name}.norm1")
        y = normed(conv(y * y.sigmoid(), f"{name}.conv1"), f"{name}.norm2")
        y = conv(y * y.sigmoid(), f"{name}.conv2")
        shortcut = f"{name}.nin_shortcut"
        return y + (conv(x, shortcut, pad=0) if f"{shortcut}.bias" in p else x)

    def attended(x: Tensor, name: str) -> Tensor:
        y = normed(x, f"{name}.norm")
        query, key, value = (conv(y, f"{name}.{k}", pad=0).flatten(2).double() for k in "qkv")
        scores = torch.einsum("bci,bcj->bij", query, key) / x.shape[1] ** 0.5
        seen = torch.einsum("bij,bcj->bci", scores.softmax(2), value).float().view_as(x)
        return x + conv(seen, f"{name}.proj_out", pad=0)

    x = conv(x, "encoder.conv_in")
    for level in range(levels):
        for number in range(2):
            x = residual(x, f"encoder.down.{level}.block.{number}")
            if f"encoder.down.{level}.attn.{number}.q.bias" in p:
                x = attended(x, f"encoder.down.{level}.attn.{number}")
        if level < levels - 1:
            x = conv(F.pad(x, (0, 1, 0, 1)), f"encoder.down.{level}.downsample.conv", 2, 0)
    x = residual(x, "encoder.mid.block_1")
    x = residual(attended(x, "encoder.mid.attn_1"), "encoder.mid.block_2")
    x = normed(x, "encoder.norm_out")
    return conv(conv(x * x.sigmoid(), "encoder.conv_out"), "quant_conv", pad=0)


@pytest.mark.parametrize(
    ("channels", "attends"),
    [
        ((32, 32, 64), (2,)),
        pytest.param((128, 128, 256, 512), (3,), marks=pytest.mark.slow),  # as published
    ],
)
def test_unit_is_the_encoder_of_a_vqgan(
    published: ModuleType, channels: tuple[int, ...], attends: tuple[int, ...]
) -> None:
    """Blue, green, red, from 0 to 1; the map is what its heads read."""
    state = published.fill(published.unit(channels, attends))
    converted = convert(state)
    options = converted.encoder_config
    assert (options["channels"], options["attention"]) == (list(channels), list(attends))
    blue_first = published.noise(2 * 3 * 128 * 160, 1000).view(2, 3, 128, 160).float() + 0.5
    with torch.no_grad():
        want = unit_map(blue_first, state, len(channels))
        tokens, vector = run(converted.build(), blue_first.flip(1)[:, None])
    assert want.shape == (2, 3, *(size >> (len(channels) - 1) for size in (128, 160)))
    assert want.std() > 0.05
    torch.testing.assert_close(tokens, want.flatten(2).mT, atol=2e-5, rtol=1e-4)
    torch.testing.assert_close(vector, want.mean((2, 3)), atol=2e-5, rtol=1e-4)


def test_another_vqgan_is_refused_by_name(published: ModuleType) -> None:
    state = published.fill(published.unit()) | {"quantize.embedding.weight": torch.zeros(512, 3)}
    with pytest.raises(ConfigError, match=r"a VQGAN, but not UniT's, .* the encoder vqgan"):
        convert(state)
