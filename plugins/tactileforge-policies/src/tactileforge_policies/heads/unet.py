"""The conditional 1-D U-Net of Diffusion Policy: noise in a chunk of commands."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import torch
from torch import Tensor, nn

from tactileforge.errors import ConfigError
from tactileforge_policies.heads.convolution import Convolution, Doubling, GroupNorm


class StepEmbedding(nn.Module):
    """Embeds the noise step: sines, then two layers.

    Args:
        width: Size of the embedding, even, 4 or more.
    """

    def __init__(self, width: int) -> None:
        super().__init__()
        self.sines = width // 2
        self.layers = nn.Sequential(
            nn.Linear(width, 4 * width), nn.Mish(), nn.Linear(4 * width, width)
        )

    def forward(self, steps: Tensor) -> Tensor:
        """Maps int64 (B,) to (B, width)."""
        place = torch.arange(self.sines, device=steps.device) / (self.sines - 1)
        angle = steps[:, None] * torch.exp(-math.log(10000) * place)
        out: Tensor = self.layers(torch.cat([angle.sin(), angle.cos()], dim=-1))
        return out


class ConvBlock(nn.Sequential):
    """A convolution of equal length, a group norm, Mish."""

    def __init__(self, before: int, after: int, kernel: int, groups: int) -> None:
        super().__init__(Convolution(before, after, kernel), GroupNorm(groups, after), nn.Mish())


class FilmBlock(nn.Module):
    """Two `ConvBlock` with a residual, and a scale and shift between them (FiLM).

    Source of FiLM: Perez et al. 2018.
    """

    def __init__(self, before: int, after: int, kernel: int, groups: int) -> None:
        super().__init__()
        self.conv1 = ConvBlock(before, after, kernel, groups)
        self.conv2 = ConvBlock(after, after, kernel, groups)
        self.residual = nn.Linear(before, after) if before != after else nn.Identity()
        self.width = after

    def forward(self, x: Tensor, film: Iterator[Tensor]) -> Tensor:
        """Maps (B, n, before) to (B, n, after); takes scale and shift, (B, 1, after) each."""
        scale, shift = next(film), next(film)
        out: Tensor = self.conv2(scale * self.conv1(x) + shift) + self.residual(x)
        return out


class UNet(nn.Module):
    """Predicts the noise in a chunk of commands, given the observation.

    Every stage but the last halves the length, and is joined to the one that doubles it again.
    Scales and shifts of all blocks are computed at once; the part of the observation is the same
    for all noise steps. Layout as published: Chi et al. 2023, Diffusion Policy.

    Args:
        size: Numbers of a command, A.
        condition: Size of the vector of the observation.
        channels: Channels of each stage.
        step_width: Size of the embedding of the noise step, even, 4 or more.
        kernel: Taps of the convolutions, odd.
        groups: Groups of the group norms, a divisor of the channels of each stage.

    Raises:
        ConfigError: The groups do not divide the channels, the kernel is even, or there are fewer
            than two stages.
    """

    def __init__(
        self,
        size: int,
        condition: int,
        channels: Sequence[int] = (128, 256, 512),
        step_width: int = 256,
        kernel: int = 5,
        groups: int = 8,
    ) -> None:
        super().__init__()
        if len(channels) < 2 or any(width % groups for width in channels) or kernel % 2 == 0:
            raise ConfigError(
                f"channels={list(channels)}, groups={groups}, kernel={kernel}: give two stages or "
                "more, groups that divide each, and an odd kernel"
            )

        def stage(before: int, after: int) -> nn.ModuleList:
            blocks = (FilmBlock(width, after, kernel, groups) for width in (before, after))
            return nn.ModuleList(blocks)

        self.step = StepEmbedding(step_width)
        pairs = list(zip((size, *channels), channels, strict=False))
        back = pairs[:0:-1]
        self.down = nn.ModuleList(stage(a, b) for a, b in pairs)
        self.shorten = nn.ModuleList(Convolution(b, b, 3, stride=2) for b in channels[:-1])
        self.middle = stage(channels[-1], channels[-1])
        self.up = nn.ModuleList(stage(2 * b, a) for a, b in back)
        self.lengthen = nn.ModuleList(Doubling(a) for a, _ in back)
        self.last = nn.Sequential(
            ConvBlock(channels[0], channels[0], kernel, groups), nn.Linear(channels[0], size)
        )
        order = [*self.down, self.middle, *self.up]
        self.widths = [block.width for part in order for block in part for _ in "ab"]
        self.film_of_step = nn.Linear(step_width, sum(self.widths), bias=False)
        self.film_of_condition = nn.Linear(condition, sum(self.widths))
        # Initialised like a single layer with both inputs, as in the original.
        for layer in (self.film_of_step, self.film_of_condition):
            bound = 1 / math.sqrt(step_width + condition)
            nn.init.uniform_(layer.weight, -bound, bound)
        self.mish = nn.Mish()

    def forward(self, actions: Tensor, steps: Tensor, condition: Tensor) -> Tensor:
        """Predicts the noise, (B, H, A), in noisy commands.

        Args:
            actions: Noisy commands, (B, H, A); H is halved at each stage but the last.
            steps: Noise step of each chunk, int64 (B,).
            condition: Vector of the observation, float (B, condition).
        """
        return self.denoise(actions, steps, self.perceive(condition))

    def perceive(self, condition: Tensor) -> Tensor:
        """Computes the observation's part of all scales and shifts, for `denoise`."""
        out: Tensor = self.film_of_condition(self.mish(condition))
        return out

    def denoise(self, actions: Tensor, steps: Tensor, perceived: Tensor) -> Tensor:
        """Predicts the noise like `forward`, from the output of `perceive`."""
        given = perceived + self.film_of_step(self.mish(self.step(steps)))
        film = iter(given[:, None].split(self.widths, dim=-1))
        x, joined = actions, []
        for number, stage in enumerate(self.down):
            x = _through(stage, x, film)
            joined.append(x)
            if number < len(self.shorten):
                x = self.shorten[number](x)
        x = _through(self.middle, x, film)
        for stage, longer in zip(self.up, self.lengthen, strict=True):
            x = longer(_through(stage, torch.cat([x, joined.pop()], dim=-1), film))
        out: Tensor = self.last(x)
        return out


def _through(stage: nn.Module, x: Tensor, film: Iterator[Tensor]) -> Tensor:
    assert isinstance(stage, nn.ModuleList)
    for block in stage:
        x = block(x, film)
    return x
