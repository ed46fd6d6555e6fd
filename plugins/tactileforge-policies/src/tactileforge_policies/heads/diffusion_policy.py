"""The head ``diffusion_policy``: commands denoised from noise, given the observation."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Literal

import torch
from torch import Tensor, nn

from tactileforge.contracts import Batch, Encoder, Views
from tactileforge.errors import ConfigError
from tactileforge.heads import EMA
from tactileforge.training import rand_rows
from tactileforge_policies.heads.base import ChunkPrediction, PolicyHead
from tactileforge_policies.heads.observation import POOLER, Observation, flat
from tactileforge_policies.heads.unet import UNet

if TYPE_CHECKING:
    from tactileforge_policies.data.samples import EpisodeClips

#: Rows of fixed random numbers, used in turn in evaluation.
_FIXED = 64


class PowerEMA(EMA):
    """EMA with a growing decay: ``keep = 1 - step ** -power``, up to a limit.

    It follows the network closely at first. Source: Diffusion Policy, and
    ``diffusers.training_utils.EMAModel``.

    Args:
        network: The averaged network.
        power: Exponent of the decay; a larger one reaches the limit sooner.
        most: Largest ``keep``.
    """

    def __init__(self, network: Any, power: float, most: float) -> None:
        super().__init__(network, most)
        self.power = power

    def keep(self, step: int, total: int) -> float:
        """Decay of the average at a step; 0 at steps 0 and 1, so the EMA equals the network."""
        return min(1 - step**-self.power, self.momentum) if step else 0.0


class DiffusionPolicy(PolicyHead):
    """Diffusion policy: a chunk of commands is denoised step by step.

    It is trained to predict the added noise. In evaluation, steps and noise are fixed, so that
    validation losses can be compared, and the EMA is used. Sources: AnyTouch 2, appendix
    Real-world task setup (sizes); Chi et al. 2023 and its code (the rest, see `docs/policies.md`).

    Args:
        encoder: The touch encoder (passed by the framework).
        facts: Metadata of the demonstrations (passed by the framework), see `robot.Robot`.
        channels: Channels of each stage of the U-Net.
        step_width: Size of the embedding of the noise step.
        kernel: Taps of the convolutions, odd.
        groups: Groups of the group norms.
        scheduler: Sampler of diffusers, ``ddim`` or ``ddpm``.
        train_steps: Number of noise steps in training.
        steps: Number of denoising steps of a chunk.
        betas: Name of the noise schedule in diffusers.
        ema: Largest decay of the EMA of the weights; None for no EMA.
        power: Exponent of the growth of the decay; see `PowerEMA`.
        execute: Commands carried out of a chunk; see `base.PolicyHead`.
        pooler: Options of the pooling of touch; see `observation.PoolerSize`.

    Raises:
        ConfigError: The chunk cannot be halved at each stage; or see `UNet` and `PolicyHead`.
    """

    kept: Tensor
    fixed: Tensor

    def __init__(
        self,
        encoder: Encoder,
        facts: Mapping[str, Any],
        channels: Sequence[int] = (128, 256, 512),
        step_width: int = 256,
        kernel: int = 5,
        groups: int = 8,
        scheduler: Literal["ddim", "ddpm"] = "ddim",
        train_steps: int = 100,
        steps: int = 10,
        betas: str = "squaredcos_cap_v2",
        ema: float | None = 0.9999,
        power: float = 0.75,
        execute: int = 2,
        pooler: Mapping[str, Any] = POOLER,
    ) -> None:
        super().__init__(encoder, facts, execute, pooler)
        horizon, size = self.robot.horizon, self.robot.action_size
        if horizon % 2 ** (len(channels) - 1):
            raise ConfigError(
                f"data.horizon={horizon} cannot be halved {len(channels) - 1} times; give a "
                f"multiple of {2 ** (len(channels) - 1)}, or fewer channels"
            )
        self.scheduler = _scheduler(scheduler, train_steps, betas)
        self.steps = steps
        self.register_buffer("kept", self.scheduler.alphas_cumprod.clone(), persistent=False)
        draw = torch.Generator().manual_seed(0)
        fixed = torch.rand(_FIXED, 1 + horizon * size, generator=draw)
        # Multiples of the golden ratio: any number of rows covers the noise steps evenly.
        fixed[:, 0] = (torch.arange(_FIXED) * (math.sqrt(5) - 1) / 2) % 1
        self.register_buffer("fixed", fixed, persistent=False)
        self.unet = UNet(size, self.observe.flat, channels, step_width, kernel, groups)
        self.slow = PowerEMA(nn.ModuleList(self._trained()), power, ema) if ema else None

    def prepare(self, clips: EpisodeClips) -> None:
        """Measures the ranges, also for the EMA; see `contracts.Prepared`."""
        super().prepare(clips)
        self.after_step(None, 0, 1)

    def after_step(self, encoder: Encoder | None, step: int, total: int) -> None:
        """Updates the EMA; see `contracts.AfterStep`."""
        if self.slow is not None:
            self.slow.after_step(nn.ModuleList(self._trained()), step, total)

    def forward(self, views: Views, batch: Batch) -> ChunkPrediction:
        """Predicted and added noise, at a random step in training, a fixed one in evaluation."""
        clean = self.action(batch["action_chunk"])
        observe, unet = self._trained() if self.training else self._acting()
        if self.training:
            drawn = rand_rows(len(clean), self.fixed.shape[1], device=clean.device)
        else:
            drawn = self.fixed[torch.arange(len(clean), device=clean.device) % _FIXED]
        steps = (drawn[:, 0] * len(self.kept)).long()
        noise = _normal(drawn[:, 1:]).view_as(clean)
        kept = self.kept[steps][:, None, None]
        noisy = kept.sqrt() * clean + (1 - kept).sqrt() * noise
        return ChunkPrediction(unet(noisy, steps, flat(observe(views, batch))), noise)

    def chunk(self, views: Views, batch: Batch, generator: torch.Generator) -> Tensor:
        """Denoises commands from -1 to 1 with the scheduler of diffusers."""
        observe, unet = self._acting()
        # Once, outside of the loop: the observation is the same for all denoising steps.
        perceived = unet.perceive(flat(observe(views, batch)))
        shape = (len(perceived), self.robot.horizon, self.robot.action_size)
        x = torch.randn(shape, generator=generator).to(perceived.device)
        self.scheduler.set_timesteps(self.steps)
        for step in self.scheduler.timesteps:
            noise = unet.denoise(x, step.expand(len(x)).to(x.device), perceived)
            x = self.scheduler.step(noise, step, x, generator=generator).prev_sample
        return x

    def _trained(self) -> tuple[Observation, UNet]:
        return self.observe, self.unet

    def _acting(self) -> tuple[Observation, UNet]:
        """Observation and U-Net for evaluation: the EMA, or the trained ones without it."""
        return self._trained() if self.slow is None else tuple(self.slow.network)


def _scheduler(name: str, train_steps: int, betas: str) -> Any:
    from diffusers.schedulers import scheduling_ddim, scheduling_ddpm  # takes seconds to import

    kinds = {"ddim": scheduling_ddim.DDIMScheduler, "ddpm": scheduling_ddpm.DDPMScheduler}
    return kinds[name](
        num_train_timesteps=train_steps,
        beta_schedule=betas,
        prediction_type="epsilon",
        clip_sample=True,
    )


def _normal(uniform: Tensor) -> Tensor:
    """Maps uniform numbers in 0..1 to normal ones; all are finite."""
    return math.sqrt(2) * torch.erfinv((2 * uniform - 1).clamp(-1 + 1e-7, 1 - 1e-7))
