"""The head of self-distillation (DINO)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import torch
from torch import Tensor, nn
from torch.nn import functional as F

from tactileforge.contracts import Batch, Encoder, Views
from tactileforge.encoders.transformer import init_weights
from tactileforge.heads.ema import EMA
from tactileforge.util.distributed import gather_rows


@dataclass(frozen=True)
class Distilled:
    """Cosines of each clip with every prototype.

    Attributes:
        student: float (B, K), cosines of the masked view.
        teacher: float (B, K), cosines of the whole clip by the EMA copies, minus the centre;
            without gradient.
    """

    student: Tensor
    teacher: Tensor


class Prototypes(nn.Module):
    """Three layers to a unit vector, and its cosines with learned prototypes."""

    def __init__(self, width: int, hidden: int, bottleneck: int, prototypes: int) -> None:
        super().__init__()
        self.layers = nn.Sequential(
            nn.Linear(width, hidden),
            nn.GELU(),
            nn.Linear(hidden, hidden),
            nn.GELU(),
            nn.Linear(hidden, bottleneck),
        )
        self.prototypes = nn.Parameter(torch.randn(prototypes, bottleneck))
        self.apply(init_weights)

    def forward(self, x: Tensor) -> Tensor:
        """Computes cosines: (B, width) to float32 (B, prototypes)."""
        x = F.normalize(self.layers(x).float(), dim=-1)
        with torch.autocast(x.device.type, enabled=False):  # a low temperature magnifies rounding
            return x @ F.normalize(self.prototypes, dim=-1).T


class DinoHead(nn.Module):
    """Prototypes on the pooled masked view, and EMA copies of encoder and prototypes.

    Source: DINO (Caron et al. 2021), with masks as views like Sparsh: the student sees the visible
    patches, the teacher the whole clip. Sparsh compares ten masks of each clip with two; here it is
    one with one. The centre is a moving average of the teacher's output over batches.

    Args:
        encoder: The touch encoder (given by the framework).
        prototypes: Number of prototypes, K.
        hidden: Width of the two hidden layers.
        bottleneck: Width of the space of the prototypes.
        momentum: Momentum of the EMA copies at the start; it rises linearly to 1.
        centring: Momentum of the centre, per step.
    """

    reads: ClassVar[frozenset[str]] = frozenset({"masked"})

    def __init__(
        self,
        encoder: Encoder,
        # hidden, bottleneck and centring as in DINO, which has 65536 prototypes for ImageNet
        prototypes: int = 4096,
        hidden: int = 2048,
        bottleneck: int = 256,
        momentum: float = 0.998,
        centring: float = 0.9,
    ) -> None:
        super().__init__()
        self.student = Prototypes(encoder.projected, hidden, bottleneck, prototypes)
        self.teacher = EMA(self.student, momentum)
        self.target = EMA(encoder, momentum)
        self.centring = centring
        self.register_buffer("centre", torch.zeros(prototypes))
        # not in checkpoints: they are written after a step, when it is in the centre already
        self.register_buffer("seen", torch.zeros(prototypes), persistent=False)
        self.centre: Tensor
        self.seen: Tensor

    def after_step(self, encoder: Encoder, step: int, total: int) -> None:
        """Moves the centre towards the last batch; see `contracts.AfterStep`."""
        # Caron et al., equation 4: c <- m c + (1 - m) mean(teacher), over all ranks
        self.centre.lerp_(self.seen, 1 - self.centring)
        self.teacher.after_step(self.student, step, total)
        self.target.after_step(encoder, step, total)

    def forward(self, views: Views, batch: Batch) -> Distilled:
        """Computes the outputs of student and teacher on a batch."""
        student = self.student(views.masked.cls)
        with torch.no_grad():
            teacher = self.teacher.network(self.target.network.views(batch).full.cls)
            centred = teacher - self.centre
            # validation must not move the centre: a resumed run would differ from an undisturbed
            # one
            if self.training:
                self.seen.copy_(gather_rows(teacher.mean(0, keepdim=True)).mean(0))
        return Distilled(student, centred)
