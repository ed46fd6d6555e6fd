"""Classifiers of real against simulated whole pictures, trained on some sources, tested on others.

Patches of contact (`classifier`) have equal contrast, and no border, lamp, frame or place. Whole
pictures have all of that: raw, and as changes from the background.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn

from reality.classifier import auc, fit, perceptron
from reality.measures import Array
from reality.patches import patch_colours
from reality.touches import strongest_touches
from tactileforge.contracts import Recording

#: Shorter and longer side of a picture, pixels.
SIDES = (48, 64)
#: Blurs between which the power of detail is measured, pixels; share of a side that is border.
_BLURS = (0.0, 1.0, 2.0, 4.0, 8.0, 16.0)
_BORDER = 4
#: Batch size of training.
_BATCH = 32
#: Grey levels of a unit of the network's inputs.
_UNIT = {"raw": (100.0, 50.0), "change": (0.0, 20.0)}


@dataclass(frozen=True)
class WholePictures:
    """Pictures of touches of one source, float32 (N, 48, 64, 3), grey levels.

    Attributes:
        raw: Pictures as the camera gives them.
        change: Pictures less their backgrounds.
    """

    raw: NDArray[np.float32]
    change: NDArray[np.float32]

    def __getitem__(self, part: slice) -> WholePictures:
        return WholePictures(self.raw[part], self.change[part])

    def __len__(self) -> int:
        return len(self.raw)


def whole_pictures(recordings: Iterable[Recording], most: int = 8) -> WholePictures:
    """The strongest touches of recordings, lying on their longer sides; faint ones are left out.

    Args:
        recordings: Recordings of one source.
        most: Largest number of touches per recording.

    Raises:
        DataError: A recording cannot be read.
    """
    found = [
        (_sized(touch.picture), _sized(touch.change))
        for recording in recordings
        for touch in strongest_touches(recording, most)
        if touch.touched.any()
    ]
    raw, change = (np.stack([pair[which] for pair in found]) for which in (0, 1))
    return WholePictures(raw, change)


def _sized(picture: Array) -> NDArray[np.float32]:
    lying = np.rot90(picture) if picture.shape[0] > picture.shape[1] else picture
    out = cv2.resize(np.ascontiguousarray(lying), SIDES[::-1], interpolation=cv2.INTER_AREA)
    return np.asarray(out, np.float32)


def told_apart(
    train: tuple[Sequence[WholePictures], WholePictures],
    test: tuple[WholePictures, WholePictures],
    shown: str,
    view: str,
    seeds: int = 1,
    steps: int = 120,
) -> float:
    """AUC of classifiers on pictures of other sources and scenes than they were trained on.

    Args:
        train: Real sources, each seen as often as the others, and simulated pictures.
        test: Another real source, and other simulated pictures.
        shown: ``raw`` or ``change``.
        view: One of `VIEWS`.
        seeds: Number of classifiers, each with a seed of its own; the result is their mean.
        steps: Number of training steps.
    """
    features, network = VIEWS[view]
    middle, unit = _UNIT[shown]
    real, (simulated, *both) = (
        [getattr(one, shown) for one in train[0]],
        [getattr(one, shown) for one in (train[1], *test)],
    )
    # Smaller sources are repeated up to the size of the largest, and so is the smaller class.
    most = max(len(simulated), *(len(one) * len(real) for one in real))
    even = [one[np.arange(most // len(real)) % len(one)] for one in real]
    even.append(simulated[np.arange(most) % len(simulated)])
    x, yes, no = (
        torch.from_numpy(features((pictures - middle) / unit))
        for pictures in (np.concatenate(even), *both)
    )
    y = torch.zeros(len(x))
    y[: -most or None] = 1
    if x.ndim == 2:
        mean, spread = x.mean(0), x.std(0) + 1e-6
        x, yes, no = ((part - mean) / spread for part in (x, yes, no))
    found = []
    for seed in range(seeds):
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)
            net = network(x.shape[1])
            fit(net, x, y, steps, _BATCH)
        with torch.no_grad():
            scores = net(torch.cat([yes, no]))[:, 0]
        found.append(auc(scores, torch.arange(len(scores)) < len(yes)))
    return float(np.mean(found))


def statistics(pictures: Array) -> NDArray[np.float32]:
    """Colours, detail at five scales, and the border of pictures (N, H, W, 3): (N, 27)."""
    deep = pictures.astype(np.float32)
    blurred = [
        np.stack([cv2.GaussianBlur(one, (0, 0), blur) if blur else one for one in deep])
        for blur in _BLURS
    ]
    detail = [(fine - coarse).std(axis=(1, 2)).mean(axis=1) for fine, coarse in pairwise(blurred)]
    rim, inner = _BORDER, slice(_BORDER, -_BORDER)
    middle = deep[:, inner, inner].mean(axis=(1, 2))
    sides = [deep[:, :rim], deep[:, -rim:], deep[:, :, :rim], deep[:, :, -rim:]]
    border = np.stack([side.mean(axis=(1, 2)) - middle for side in sides], axis=1)
    darkest = np.stack([border.min(axis=1), border.max(axis=1), border.mean(axis=1)], axis=1)
    kurtosis = ((deep - deep.mean(axis=(1, 2), keepdims=True)) ** 4).mean(axis=(1, 2))
    peaked = np.log(kurtosis / (deep.var(axis=(1, 2)) ** 2 + 1e-9))
    return np.concatenate(
        [
            patch_colours(deep),
            np.log(np.stack(detail, axis=1) + 1e-3),
            darkest.reshape(len(deep), -1),
            peaked,
        ],
        axis=1,
    ).astype(np.float32)


def _pixels(pictures: Array) -> NDArray[np.float32]:
    return np.ascontiguousarray(pictures.transpose(0, 3, 1, 2), np.float32)


def _convolutions(inputs: int) -> nn.Module:
    """Four layers of 6,049 weights, 48 x 64 to 3 x 4 pixels, and the mean over the places."""
    layers: list[nn.Module] = []
    for before, after in ((inputs, 8), (8, 16), (16, 16), (16, 16)):
        layers += [nn.Conv2d(before, after, 3, 2, 1), nn.ReLU()]
    return nn.Sequential(*layers, nn.AdaptiveAvgPool2d(1), nn.Flatten(), nn.Linear(16, 1))


#: Inputs of each classifier, and its network.
VIEWS: dict[str, tuple[Callable[[Array], Array], Callable[[int], nn.Module]]] = {
    "statistics": (statistics, perceptron),
    "CNN": (_pixels, _convolutions),
}
