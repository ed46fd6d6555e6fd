"""The probe ``linear_adamw``: a linear layer, trained as published for Touch and Go."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

from torch import Tensor, nn
from torch.nn import functional as F

from tactileforge_bench.fit.probes.base import Probe, ProbeTraining, Values
from tactileforge_bench.tasks.targets import TargetPart


class LinearAdamW(Probe):
    """One linear layer per part; two classes have one logit and binary cross-entropy.

    Fifty epochs at a fixed rate end before small sets have converged; ``linear`` is fitted until it
    has. Source: AnyTouch 2's published probe of Touch and Go.

    Args:
        width: Size of the projected class token.
        parts: Parts of the target.
    """

    tap: ClassVar[str] = "projected"
    published: ClassVar[ProbeTraining] = ProbeTraining(schedule="cosine")

    def __init__(self, width: int, parts: Mapping[str, TargetPart]) -> None:
        super().__init__(width, parts)
        self.head = nn.ModuleDict(
            {k: nn.Linear(width, 1 if _is_binary(p) else p.outputs) for k, p in parts.items()}
        )

    def forward(self, features: Tensor) -> Values:
        """(B, width) to (B, outputs) of each part."""
        out = {name: head(features) for name, head in self.head.items()}
        return {
            # the first class has the logit 0, so softmax is the sigmoid of the second
            name: F.pad(x, (1, 0)) if _is_binary(self.parts[name]) else x
            for name, x in out.items()
        }


def _is_binary(part: TargetPart) -> bool:
    """Whether the part has two classes: one logit against 0, so cross-entropy is the binary one."""
    return part.kind == "classes" and part.outputs == 2
