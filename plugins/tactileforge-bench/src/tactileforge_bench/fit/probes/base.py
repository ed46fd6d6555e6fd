"""The interface of a probe."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, TypeAlias

import torch
from torch import Tensor, nn
from torch.nn import functional as F

from tactileforge_bench.tasks.targets import TargetPart

#: Predictions or truth of each part, by its name.
Values: TypeAlias = dict[str, Tensor]


@dataclass(frozen=True, kw_only=True)
class ProbeTraining:
    """Training options of a probe.

    Attributes:
        epochs: Passes over the training clips.
        batch: Clips of a batch.
        lr: Learning rates; each is a setting of its own.
        optimiser: ``adamw`` or ``adam``.
        betas: Decay rates of the optimiser's two running means.
        weight_decay: Weight decay of all parameters; ``adamw`` shrinks weights by it, ``adam`` adds
            it to the gradient (L2), which weakens it where gradients are large.
        schedule: ``cosine`` to 0, a step at a time, or ``constant``.
    """

    epochs: int = 50
    batch: int = 64
    lr: tuple[float, ...] = (2e-4,)
    optimiser: str = "adamw"
    betas: tuple[float, float] = (0.9, 0.99)
    weight_decay: float = 0.05
    schedule: str = "constant"


#: Training of Sparsh's probes, as published for its tasks T1 to T3.
SPARSH = ProbeTraining(
    epochs=51, batch=100, lr=(1e-4,), optimiser="adam", betas=(0.9, 0.999), weight_decay=0.0
)


class Probe(nn.Module):
    """Maps features to predictions; a subclass builds its layers and sets its training.

    It is trained in a batch with others of its kind (``torch.func.vmap``), so its forward may not
    depend on values of its input, and has no buffers.

    Args:
        width: Size of a feature: of a token, or of the projected class token.
        parts: Parts of the target.

    Attributes:
        tap: Features it reads, see `FrozenEncoder.features`: ``tokens`` (B, L, width), or others
            (B, width).
        readings: Taps that it reads in turn, each a setting of its own; none takes ``tap`` alone.
        published: Training options, as published where they are.
        trained: Whether it is trained by gradients.
        fitted: Whether it needs training clips at all.
    """

    tap: ClassVar[str] = "tokens"
    readings: ClassVar[tuple[str, ...]] = ()
    published: ClassVar[ProbeTraining] = ProbeTraining()
    trained: ClassVar[bool] = True
    fitted: ClassVar[bool] = True
    #: Error below which the loss of vectors is quadratic, in normalised units: that of AnyTouch 2.
    beta: ClassVar[float] = 0.02

    def __init__(self, width: int, parts: Mapping[str, TargetPart]) -> None:
        super().__init__()
        self.parts = dict(parts)

    def forward(self, features: Tensor) -> Values:
        """(B, outputs) of each part."""
        raise NotImplementedError

    def loss(self, out: Values, truth: Values) -> Tensor:
        """A scalar: cross-entropy of classes and smooth L1 of vectors, summed over the parts.

        Args:
            out: Output of `forward`.
            truth: (B, columns), class indices or normalised vectors.
        """
        losses = [self.loss_of(part, out[name], truth[name]) for name, part in self.parts.items()]
        return torch.stack(losses).sum()

    def loss_of(self, part: TargetPart, out: Tensor, truth: Tensor) -> Tensor:
        """The loss of one part."""
        if part.kind != "classes":
            return F.smooth_l1_loss(out, truth, beta=self.beta)
        return F.cross_entropy(class_scores(part, out).flatten(0, 1), truth.flatten().long())

    def decode(self, out: Values) -> Values:
        """Class indices, or normalised vectors, (B, columns)."""
        return {
            name: class_scores(part, out[name]).argmax(2).float()
            if part.kind == "classes"
            else out[name]
            for name, part in self.parts.items()
        }

    def probabilities(self, out: Values) -> Values:
        """Probabilities of the classes of each part of classes, (B, columns, classes)."""
        return {
            name: class_scores(part, out[name]).softmax(2)
            for name, part in self.parts.items()
            if part.kind == "classes"
        }


def class_scores(part: TargetPart, out: Tensor) -> Tensor:
    """Logits of classes, (B, columns, classes)."""
    return out.reshape(len(out), -1, len(part.names))
