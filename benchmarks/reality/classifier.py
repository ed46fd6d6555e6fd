"""A classifier of real against simulated patches, as a measure of the gap between them.

It is trained on one real source and tested on another, so that it cannot learn the unit, and on
other simulated scenes. 0.5 is chance: the inputs of the classifier do not separate the two.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
import torch.nn.functional as F
from torch import Tensor, nn

from reality.measures import Array
from reality.patches import patch_colours, patch_spectra
from tactileforge.errors import ConfigError

#: Least number of patches of a class.
_LEAST = 16
#: Variance added in the normalisation of contrast, so that noise is not amplified.
_QUIET = 4.0
#: Batch size, learning rate and weight decay of training.
_BATCH, _RATE, _DECAY = 64, 2e-3, 1e-2


@dataclass(frozen=True)
class ClassifierScore:
    """Accuracy and AUC of the classifier on held-out patches.

    Attributes:
        accuracy: Accuracy on equal numbers of real and simulated patches, 0 to 1.
        auc: Probability of a higher score for a real patch than for a simulated one.
        seen: Accuracy on the training patches.
        patches: Number of patches of each class, for training and for testing.
    """

    accuracy: float
    auc: float
    seen: float
    patches: tuple[int, int]


@dataclass(frozen=True)
class PatchSplit:
    """Patches (N, 48, 48, 3) of change images, see `patches.patches`.

    Attributes:
        real: Patches of a real source.
        simulated: Patches of simulated scenes.
    """

    real: Array
    simulated: Array

    def balanced(self) -> PatchSplit:
        """A subsample of equal numbers of real and simulated patches, evenly spread.

        Raises:
            ConfigError: A class has fewer than 16 patches.
        """
        count = min(len(self.real), len(self.simulated))
        if count < _LEAST:
            raise ConfigError(
                f"{len(self.real)} real and {len(self.simulated)} simulated patches in contact; a "
                f"classifier needs {_LEAST} of each: give more touches or more scenes"
            )
        rows = (
            np.linspace(0, len(patches) - 1, count).round().astype(int)
            for patches in (self.real, self.simulated)
        )
        first, second = rows
        return PatchSplit(self.real[first], self.simulated[second])


def _pixels(cut: Array) -> Array:
    """Change images for a network, (N, 3, 48, 48), each of mean 0 and deviation 1.

    The strength of contrast differs between sources, and would dominate everything else.
    """
    away = cut - cut.mean(axis=(1, 2), keepdims=True)
    deviation = np.sqrt(np.square(away).mean(axis=(1, 2, 3), keepdims=True) + _QUIET)
    return np.ascontiguousarray((away / deviation).transpose(0, 3, 1, 2), np.float32)


def perceptron(inputs: int) -> nn.Module:
    """A network with one hidden layer of 32, for numbers."""
    return nn.Sequential(nn.Linear(inputs, 32), nn.ReLU(), nn.Linear(32, 1))


def _convolutions(inputs: int) -> nn.Module:
    """Three layers, 48 to 6 pixels, and the mean over the places."""
    layers: list[nn.Module] = []
    for before, after in ((inputs, 16), (16, 32), (32, 32)):
        layers += [nn.Conv2d(before, after, 5, 2, 2), nn.ReLU()]
    return nn.Sequential(*layers, nn.AdaptiveAvgPool2d(1), nn.Flatten(), nn.Linear(32, 1))


#: Inputs of each classifier, and its network.
VIEWS: dict[str, tuple[Callable[[Array], Array], Callable[[int], nn.Module]]] = {
    "colour": (patch_colours, perceptron),
    "spectrum": (patch_spectra, perceptron),
    "pixels": (_pixels, _convolutions),
}


def told_apart(
    train: PatchSplit, test: PatchSplit, view: str, seed: int = 0, steps: int = 300
) -> ClassifierScore:
    """Trains a classifier and tests it on patches of another source.

    Args:
        train: One real source, and simulated scenes.
        test: Another real source, and other simulated scenes.
        view: One of `VIEWS`.
        seed: Seed of its weights and batches.
        steps: Number of training steps.

    Raises:
        ConfigError: Too few patches.
    """
    shown, network = VIEWS[view]
    (x, y), (other, truth) = (_labelled(split.balanced(), shown) for split in (train, test))
    if x.ndim == 2:
        mean, spread = x.mean(0), x.std(0) + 1e-6
        x, other = (x - mean) / spread, (other - mean) / spread
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        net = network(x.shape[1])
        fit(net, x, y, steps)
    with torch.no_grad():
        seen, scores = net(x)[:, 0], net(other)[:, 0]
    right = float(((scores > 0) == (truth > 0)).float().mean())
    fitted = float(((seen > 0) == (y > 0)).float().mean())
    return ClassifierScore(right, auc(scores, truth > 0), fitted, (len(y) // 2, len(truth) // 2))


def _labelled(split: PatchSplit, shown: Callable[[Array], Array]) -> tuple[Tensor, Tensor]:
    """Inputs, and labels: 1 for real, 0 for simulated."""
    inputs = np.concatenate([shown(split.real), shown(split.simulated)])
    labels = torch.cat([torch.ones(len(split.real)), torch.zeros(len(split.simulated))])
    return torch.from_numpy(inputs), labels


def fit(net: nn.Module, x: Tensor, y: Tensor, steps: int, size: int = _BATCH) -> None:
    """Trains by AdamW with a cosine schedule; mirrors patches, as lights differ between units."""
    optimiser = torch.optim.AdamW(net.parameters(), _RATE, weight_decay=_DECAY)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimiser, steps)
    for step in range(steps):
        rows = torch.randint(len(x), (size,))
        batch = x[rows]
        if batch.ndim == 4:
            batch = batch.flip([axis for axis in (2, 3) if step >> (axis - 2) & 1])
        loss = F.binary_cross_entropy_with_logits(net(batch)[:, 0], y[rows])
        optimiser.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]
        optimiser.step()
        schedule.step()


def auc(scores: Tensor, positive: Tensor) -> float:
    """Probability of a larger score for a positive than for a negative; ties count half.

    Example:
        >>> auc(torch.tensor([0.1, 0.4, 0.4, 0.9]), torch.tensor([False, False, True, True]))
        0.875
    """
    yes, no = scores[positive], scores[~positive]
    above = (yes[:, None] > no).double() + 0.5 * (yes[:, None] == no).double()
    return float(above.mean())
