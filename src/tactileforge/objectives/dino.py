"""Self-distillation (DINO): the student on a masked clip matches the teacher on the whole."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

import torch
from torch import Tensor, nn
from torch.nn import functional as F

from tactileforge.contracts import Batch, Encoder
from tactileforge.heads.dino import Distilled


class Dino(nn.Module):
    """Divergence of the student's prototypes from the teacher's.

    ``sum_k p_k log(p_k / q_k)`` with ``p = softmax(teacher / its temperature)`` and ``q =
    softmax(student / temperature)``, averaged over clips: DINO's cross-entropy minus the teacher's
    own entropy, which has no gradient. The teacher's cosines are centred. The centre keeps one
    prototype from taking all clips, and the low temperature of the teacher keeps clips from being
    spread evenly over all prototypes. It logs the information (nats) of the teacher's prototype
    about the clip, the entropy of the mean minus the mean of the entropies: near 0 the teacher has
    collapsed in one of these two ways. Source: DINO (Caron et al. 2021, section 3.1); temperatures
    are Sparsh's.

    Args:
        temperature: Temperature of the student.
        teacher_temperature: Temperatures of the teacher, at the first step and after its warm-up.
        warmup: Share of the run for the rise of the teacher's temperature, 0 to 1.
    """

    head: ClassVar[str] = "dino"
    needs: ClassVar[frozenset[str]] = frozenset()

    def __init__(
        self,
        # both temperatures as in DINO (Caron et al. 2021)
        temperature: float = 0.1,
        teacher_temperature: Sequence[float] = (0.04, 0.07),
        warmup: float = 0.15,
    ) -> None:
        super().__init__()
        self.temperature = temperature
        self.low, self.high = teacher_temperature
        self.warmup = warmup
        self.register_buffer("teacher_temperature", torch.tensor(self.low))
        self.teacher_temperature: Tensor

    def after_step(self, encoder: Encoder, step: int, total: int) -> None:
        """Raises the teacher's temperature; see `contracts.AfterStep`."""
        share = min(1.0, step / max(1.0, self.warmup * total))
        self.teacher_temperature.fill_(self.low + share * (self.high - self.low))

    def forward(self, prediction: Distilled, batch: Batch) -> tuple[Tensor, dict[str, Tensor]]:
        """Computes the loss, averaged over clips."""
        teacher = F.log_softmax(prediction.teacher / self.teacher_temperature, dim=-1)
        student = F.log_softmax(prediction.student / self.temperature, dim=-1)
        loss = F.kl_div(student, teacher, reduction="batchmean", log_target=True)
        share = teacher.exp()
        # H(mean p) - mean H(p): 0 if all clips take one prototype, or spread over all alike
        entropy = torch.special.entr(torch.cat([share, share.mean(0, keepdim=True)])).sum(-1)
        return loss, {"information": entropy[-1] - entropy[:-1].mean()}
