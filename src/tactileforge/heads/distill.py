"""The head for distillation of a pretrained image model, the teacher."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, ClassVar

import torch
from torch import Tensor, nn
from torch.nn import functional as F

from tactileforge.contracts import Batch, Encoder, TrainingClips, Views
from tactileforge.encoders.preprocess import DIFFERENCE_GAIN, difference_picture

#: Number of clips for the statistics of the teacher's features before training, and per batch.
_MEASURED, _AT_ONCE = 256, 32
#: Smallest standard deviation of a feature of the teacher, against division by 0.
_LEAST = 1e-3


@dataclass(frozen=True)
class Taught:
    """Features of the teacher, and their predictions from the encoder's tokens.

    Features have mean 0 and standard deviation 1 over the training data.

    Attributes:
        predicted: Predicted maps, float (B, C, h, w) each, then features of the whole picture,
            float (B, n).
        target: True features, of the same shapes; without gradient.
    """

    predicted: tuple[Tensor, ...]
    target: tuple[Tensor, ...]


class DistillHead(nn.Module):
    """Linear layers from the tokens to the features of a frozen image model, the teacher.

    The input of the teacher is the difference of the last frame to the one without contact,
    amplified by ``gain``, around mid-grey. Its maps are predicted position by position from the
    tokens of the last slot, and mean and deviation of every map from the mean of all tokens. The
    layers are linear, so the tokens have to carry the features in a form usable by any other linear
    layer. Source: Theia (Shang et al. 2024) distils vision models for robots in this way, and
    scales features by their deviation too.

    Args:
        encoder: The touch encoder (given by the framework).
        teacher: A frozen image tower (given by the framework: ``image_encoder``). A tower with
            ``maps`` gives features of positions; any other only its vector.
        gain: Amplification of the difference to the frame without contact, in the teacher's input.
    """

    reads: ClassVar[frozenset[str]] = frozenset({"full"})

    mean: Tensor
    deviation: Tensor

    def __init__(self, encoder: Encoder, teacher: nn.Module, gain: float = DIFFERENCE_GAIN) -> None:
        super().__init__()
        self.teacher: Any = teacher.requires_grad_(False)
        self.gain = gain
        self.grid, self.prefix = encoder.grid, encoder.prefix
        # asked of a small picture: numbers of channels do not depend on its size
        self.sizes = [len(one[0]) for one in self._features(torch.zeros(1, 3, 32, 32))]
        *maps, whole = self.sizes
        self.places = nn.ModuleList(nn.Linear(encoder.width, size) for size in maps)
        self.whole = nn.Linear(encoder.width, whole)
        for layer in (*self.places, self.whole):
            # starts near 0, the mean of the normalised features
            nn.init.normal_(layer.weight, std=0.01)
            nn.init.zeros_(layer.bias)
        self.register_buffer("mean", torch.zeros(sum(self.sizes)))
        self.register_buffer("deviation", torch.ones(sum(self.sizes)))

    def train(self, mode: bool = True) -> DistillHead:
        """Sets the mode; the teacher stays in evaluation mode."""
        super().train(mode)
        self.teacher.eval()
        return self

    def prepare(self, clips: TrainingClips) -> None:
        """Measures mean and deviation of the teacher's features; see `contracts.Prepared`."""
        batches = zip(*map(self._features, self._pictures(clips)), strict=True)
        parts = [torch.cat(found).movedim(1, 0).flatten(1).double() for found in batches]
        self.mean.copy_(torch.cat([one.mean(1) for one in parts]))
        deviation = torch.cat([one.std(1, correction=0) for one in parts])
        self.deviation.copy_(deviation.clamp(min=_LEAST))

    def _pictures(self, clips: TrainingClips) -> Iterator[Tensor]:
        # spread evenly: a random draw would change those of the run
        chosen = torch.linspace(0, len(clips) - 1, min(_MEASURED, len(clips))).long().tolist()
        for start in range(0, len(chosen), _AT_ONCE):
            rows: list[dict[str, Any]] = [clips[i] for i in chosen[start : start + _AT_ONCE]]
            last = torch.stack([row["frames"][-1] for row in rows]).to(self.mean.device)
            still = torch.stack([row["background"] for row in rows]).to(self.mean.device)
            yield difference_picture(last, still, self.gain)

    def _features(self, pictures: Tensor) -> list[Tensor]:
        """Teacher's maps (B, C, h, w), and features of the whole picture (B, n), in float32."""
        with torch.no_grad(), torch.autocast(pictures.device.type, enabled=False):
            if not hasattr(self.teacher, "maps"):
                return [self.teacher(pictures)]
            maps: list[Tensor] = self.teacher.maps(pictures)
            flat = [one.flatten(2) for one in maps]
            whole = [part for x in flat for part in (x.mean(2), x.std(2, correction=0))]
            _, rows, columns = self.grid
            kept = [
                F.adaptive_avg_pool2d(x, (min(x.shape[2], rows), min(x.shape[3], columns)))
                for x in maps
            ]
            return [*kept, torch.cat(whole, 1)]

    def forward(self, views: Views, batch: Batch) -> Taught:
        """Predicts the teacher's features of the last frame of each clip."""
        picture = difference_picture(batch["frames"][:, -1], batch["background"], self.gain)
        found = self._features(picture)
        scales = zip(
            *(torch.split(x, self.sizes) for x in (self.mean, self.deviation)), strict=True
        )
        target = [
            ((x.movedim(1, -1) - mean) / deviation).movedim(-1, 1)
            for x, (mean, deviation) in zip(found, scales, strict=True)
        ]
        tokens = views.full.tokens[:, self.prefix :]
        tokens = tokens.reshape(len(tokens), *self.grid, -1)
        last = tokens[:, -1].permute(0, 3, 1, 2)
        predicted = [
            layer(F.adaptive_avg_pool2d(last, x.shape[2:]).movedim(1, -1)).movedim(-1, 1)
            for layer, x in zip(self.places, target[:-1], strict=True)
        ]
        return Taught((*predicted, self.whole(tokens.mean((1, 2, 3)))), tuple(target))
