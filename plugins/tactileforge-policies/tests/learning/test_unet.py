"""The U-Net against the published formulas, written with torch's own convolutions."""

import math

import pytest
import torch
from tactileforge_policies.heads.convolution import Convolution, Doubling
from tactileforge_policies.heads.unet import FilmBlock, UNet
from torch import Tensor
from torch.nn import functional as F

from tactileforge.errors import ConfigError

GROUPS, KERNEL = 8, 5


def conv_block(block: torch.nn.Sequential, x: Tensor) -> Tensor:
    """(B, C, n): Conv1d of kernel 5 and padding 2, GroupNorm of 8 groups, Mish."""
    conv, norm, _ = block
    weight = conv.weight.permute(2, 1, 0)  # Conv1d: (out, in, taps)
    x = F.conv1d(x, weight, conv.bias, padding=KERNEL // 2)
    groups = x.reshape(len(x), GROUPS, -1)
    mean, var = groups.mean(-1, keepdim=True), groups.var(-1, unbiased=False, keepdim=True)
    x = ((groups - mean) / torch.sqrt(var + 1e-5)).reshape(x.shape)
    x = x * norm.weight[:, None] + norm.bias[:, None]
    return x * torch.tanh(torch.log1p(torch.exp(x)))


def film_block(block: FilmBlock, x: Tensor, film: Tensor) -> Tensor:
    scale, shift = film.chunk(2, dim=1)
    out = conv_block(block.conv1, x) * scale[..., None] + shift[..., None]
    out = conv_block(block.conv2, out)
    if isinstance(block.residual, torch.nn.Linear):
        x = F.conv1d(x, block.residual.weight[..., None], block.residual.bias)
    return out + x


def reference(net: UNet, actions: Tensor, steps: Tensor, condition: Tensor) -> Tensor:
    """The published forward pass, with one FiLM layer on (step, condition) for each block."""
    half = net.step.layers[0].in_features // 2
    rate = torch.tensor([math.exp(-math.log(10000) * i / (half - 1)) for i in range(half)])
    angle = steps.float()[:, None] * rate
    embedded = net.step.layers(torch.cat([angle.sin(), angle.cos()], -1))
    weight = torch.cat([net.film_of_step.weight, net.film_of_condition.weight], dim=1)
    given = F.mish(torch.cat([embedded, condition], -1))
    place = 0

    def film(width: int) -> Tensor:
        nonlocal place
        rows = slice(place, place + 2 * width)
        place += 2 * width
        return F.linear(given, weight[rows], net.film_of_condition.bias[rows])

    def both(stage: torch.nn.ModuleList, x: Tensor) -> Tensor:
        for block in stage:
            x = film_block(block, x, film(block.width))
        return x

    x, joined = actions.transpose(1, 2), []
    for number, stage in enumerate(net.down):
        x = both(stage, x)
        joined.append(x)
        if number < len(net.down) - 1:
            down = net.shorten[number]
            x = F.conv1d(x, down.weight.permute(2, 1, 0), down.bias, stride=2, padding=1)
    x = both(net.middle, x)
    for stage, up in zip(net.up, net.lengthen, strict=True):
        x = both(stage, torch.cat([x, joined.pop()], dim=1))
        # ConvTranspose1d: (in, out, taps)
        x = F.conv_transpose1d(x, up.weight.permute(1, 2, 0), up.bias, stride=2, padding=1)
    x = conv_block(net.last[0], x)
    x = F.conv1d(x, net.last[1].weight[..., None], net.last[1].bias)
    return x.transpose(1, 2)


@pytest.mark.parametrize("horizon", [4, 8, 16])
def test_the_unet_is_the_published_one(horizon: int) -> None:
    """Layout of ``diffusion_pusht``, with narrower stages: kernel 5, 8 groups, two commands."""
    net = UNet(2, 20, (16, 32, 64), step_width=16, kernel=KERNEL, groups=GROUPS)
    for number, parameter in enumerate(net.parameters()):  # no 0 or 1, as in new norms
        place = torch.arange(parameter.numel(), dtype=torch.float32)
        fan = parameter[0].numel() if parameter.ndim > 1 else 4
        values = torch.sin(1.7 * place + number) / math.sqrt(fan)
        parameter.data = values.view(parameter.shape) + (0.5 if parameter.ndim == 1 else 0)
    actions, condition = torch.randn(3, horizon, 2), torch.randn(3, 20)
    steps = torch.tensor([0, 7, 99])
    found = net(actions, steps, condition)
    assert found.abs().max() > 0.1
    torch.testing.assert_close(
        found, reference(net, actions, steps, condition), rtol=1e-4, atol=1e-5
    )
    assert not torch.allclose(found, net(actions, steps + 1, condition), atol=1e-3)


def test_the_papers_layout_has_its_weights() -> None:
    """Closed form of the parameters of (128, 256, 512) with 25,344 condition values: 182 M FiLM."""
    channels, given = (128, 256, 512), 30 * 768 + 2048 + 256
    with torch.device("meta"):
        net = UNet(7, given - 256, channels, 256)
    blocks = [(7, 128), (128, 128), (128, 256), (256, 256), (256, 512), (512, 512)]
    blocks += [(512, 512)] * 2 + [(1024, 256), (256, 256), (512, 128), (128, 128)]
    film = sum(2 * after * (given + 1) for _, after in blocks)
    assert film == 7168 * 25_345 == 181_672_960
    convolutions = sum(
        5 * (a * b + b * b) + 6 * b + (a * b + b if a != b else 0) for a, b in blocks
    )
    ends = sum(3 * c * c + c for c in channels[:-1]) + sum(4 * c * c + c for c in (256, 128))
    last = 5 * 128 * 128 + 3 * 128 + 128 * 7 + 7
    step = 256 * 1024 + 1024 + 1024 * 256 + 256
    assert sum(p.numel() for p in net.parameters()) == film + convolutions + ends + last + step


@pytest.mark.parametrize("length", [1, 2, 3, 8])
def test_convolutions_are_torchs(length: int) -> None:
    x = torch.randn(2, length, 6)
    for stride, kernel in ((1, 5), (1, 3), (1, 1), (2, 3)):
        ours = Convolution(6, 4, kernel, stride)
        weight = ours.weight.permute(2, 1, 0)
        true = F.conv1d(x.transpose(1, 2), weight, ours.bias, stride, kernel // 2)
        torch.testing.assert_close(ours(x), true.transpose(1, 2))
    doubling = Doubling(6)
    weight = doubling.weight.permute(1, 2, 0)
    true = F.conv_transpose1d(x.transpose(1, 2), weight, doubling.bias, 2, 1)
    torch.testing.assert_close(doubling(x), true.transpose(1, 2))


def test_sizes_that_do_not_fit_are_named() -> None:
    for wrong in ({"groups": 7}, {"kernel": 4}, {"channels": (64,)}):
        with pytest.raises(ConfigError, match="groups that divide each, and an odd kernel"):
            UNet(2, 4, **wrong)
