"""The conditional 1-D U-Net of Diffusion Policy: noise in a chunk of commands."""

from __future__ import annotations

import math
from collections.abc import Sequence

import torch
from torch import Tensor, nn

from tactileforge.errors import ConfigError


class StepEmbedding(nn.Module):
    """Embeds the step of the noise: sines, then two layers.

    Args:
        width: Size of the embedding, even.
    """

    def __init__(self, width: int) -> None:
        super().__init__()
        self.half = width // 2
        self.layers = nn.Sequential(
            nn.Linear(width, 4 * width), nn.Mish(), nn.Linear(4 * width, width)
        )

    def forward(self, steps: Tensor) -> Tensor:
        """int64 (B,) to (B, width)."""
        place = torch.arange(self.half, device=steps.device) / (self.half - 1)
        angle = steps[:, None] * torch.exp(-math.log(10000) * place)
        out: Tensor = self.layers(torch.cat([angle.sin(), angle.cos()], dim=-1))
        return out


class ConvBlock(nn.Sequential):
    """A convolution that keeps the length, a group norm, Mish."""

    def __init__(self, before: int, after: int, kernel: int, groups: int) -> None:
        super().__init__(
            nn.Conv1d(before, after, kernel, padding=kernel // 2),
            nn.GroupNorm(groups, after),
            nn.Mish(),
        )


class FilmBlock(nn.Module):
    """Two `ConvBlock` with a residual; the condition scales and shifts what is between them.

    Source of FiLM: Perez et al. 2018.
    """

    def __init__(self, before: int, after: int, condition: int, kernel: int, groups: int) -> None:
        super().__init__()
        self.conv1 = ConvBlock(before, after, kernel, groups)
        self.conv2 = ConvBlock(after, after, kernel, groups)
        self.film = nn.Sequential(nn.Mish(), nn.Linear(condition, 2 * after))
        self.residual = nn.Conv1d(before, after, 1) if before != after else nn.Identity()

    def forward(self, x: Tensor, condition: Tensor) -> Tensor:
        """(B, before, n) and (B, condition) to (B, after, n)."""
        scale, shift = self.film(condition)[..., None].chunk(2, dim=1)
        out: Tensor = self.conv2(scale * self.conv1(x) + shift)
        return out + self.residual(x)


class UNet(nn.Module):
    """Predicts the noise in a chunk of commands, given what is perceived.

    Stages halve the length, and are joined to those that double it again; the last halves nothing.
    Layout as published: Chi et al. 2023, Diffusion Policy.

    Args:
        size: Numbers of a command, A.
        condition: Numbers of what is perceived.
        channels: Of each stage.
        step_width: Size of the embedding of the step.
        kernel: Of the convolutions, odd.
        groups: Of the norms; they divide the channels.

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
        self.step = StepEmbedding(step_width)
        given = condition + step_width

        def block(before: int, after: int) -> FilmBlock:
            return FilmBlock(before, after, given, kernel, groups)

        pairs = list(zip((size, *channels), channels, strict=False))
        self.down = nn.ModuleList(nn.ModuleList([block(a, b), block(b, b)]) for a, b in pairs)
        self.shorten = nn.ModuleList(nn.Conv1d(b, b, 3, 2, 1) for b in channels[:-1])
        self.middle = nn.ModuleList(block(channels[-1], channels[-1]) for _ in range(2))
        back = pairs[:0:-1]
        self.up = nn.ModuleList(nn.ModuleList([block(2 * b, a), block(a, a)]) for a, b in back)
        self.lengthen = nn.ModuleList(nn.ConvTranspose1d(a, a, 4, 2, 1) for a, _ in back)
        self.last = nn.Sequential(
            ConvBlock(channels[0], channels[0], kernel, groups), nn.Conv1d(channels[0], size, 1)
        )

    def forward(self, actions: Tensor, steps: Tensor, condition: Tensor) -> Tensor:
        """Noise, (B, H, A), in noisy commands (B, H, A).

        Args:
            actions: Their length divides by 2 for each stage but the last.
            steps: int64 (B,), how noisy they are.
            condition: float (B, condition).
        """
        given = torch.cat([self.step(steps), condition], dim=-1)
        x, joined = actions.movedim(1, 2), []
        for number, (one, two) in enumerate(self.down):  # type: ignore[misc]
            x = two(one(x, given), given)
            joined.append(x)
            if number < len(self.shorten):
                x = self.shorten[number](x)
        for block in self.middle:
            x = block(x, given)
        for (one, two), longer in zip(self.up, self.lengthen, strict=True):  # type: ignore[misc]
            x = two(one(torch.cat([x, joined.pop()], dim=1), given), given)
            x = longer(x)
        out: Tensor = self.last(x)
        return out.movedim(1, 2)
