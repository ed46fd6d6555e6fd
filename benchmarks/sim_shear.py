"""Estimation of shear from simulated pictures without markers, on unseen indenters.

A small convolutional net is trained for some minutes on clips of four frames of slides and force
trials; the baseline is a ridge regression on 16 x 16 pixels of the difference. The result is R2 of
the forces over all clips in contact, over sliding ones (shear above 0.9 of friction times normal
force), and over sticking ones (below 0.6).

Run: python benchmarks/sim_shear.py --minutes 5
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator
from itertools import pairwise
from typing import Any

import numpy as np
import torch
import torch.nn.functional as F
from common import save
from numpy.typing import NDArray
from tactileforge_sim.dataset import Sim
from tactileforge_sim.geometry.shapes import INDENTERS
from torch import Tensor, nn

from tactileforge.specs import simulation

#: Pre-training indenters; every fifth is held out for the test.
NAMES = [name for name, known in INDENTERS.items() if known.split == "pretrain"]
UNSEEN = NAMES[::5]
SEEN = [name for name in NAMES if name not in UNSEEN]
MOTIONS = ("slide_left", "slide_right", "slide_up", "slide_down", "force_trial")
SIDE, FRAMES, SPACING = 64, 4, 1 / 15


def clips(args: argparse.Namespace, names: list[str], count: int, seed: int) -> Iterator[list[Any]]:
    """Yields clips as differences from the background, forces, and the used share of friction."""
    data = Sim(
        scenes=count,
        val=0,
        sensors=[args.sensor],
        indenters=names,
        motions=MOTIONS,
        size=SIDE,
        action_seconds=0.6,
        force=(1.0, 8.0),
        markers=False,
        randomise=args.randomise,
        seed=seed,
    )
    low, high = simulation(args.sensor).friction
    for recording in data.recordings("train"):
        frames = recording.frames.read(range(len(recording.frames)))
        still = frames[0].astype(np.int16)
        change = torch.from_numpy(frames - still).permute(0, 3, 1, 2).float()
        change = F.interpolate(change, (SIDE, SIDE), mode="area").to(torch.int8)
        assert recording.force is not None
        friction = low + float(recording.labels["grip"]) * (high - low)
        step = max(1, round(SPACING / float(np.diff(recording.times).mean())))
        force = recording.force
        used = np.hypot(force[:, 0], force[:, 1]) / np.maximum(friction * force[:, 2], 1e-6)
        for last in range((FRAMES - 1) * step, len(frames)):
            if force[last, 2] > 0.3:
                rows = [last - step * back for back in range(FRAMES - 1, -1, -1)]
                yield [change[rows], force[last], used[last]]


def stacked(found: Iterator[list[Any]]) -> tuple[Tensor, Tensor, NDArray[np.float64]]:
    """Clips (N, 12, H, W), forces (N, 3), and used friction (N,)."""
    pictures, force, used = zip(*found, strict=True)
    return (
        torch.stack(pictures).flatten(1, 2),
        torch.from_numpy(np.stack(force)),
        np.array(used),
    )


def net() -> nn.Module:
    """Five strided convolutions."""
    widths = (3 * FRAMES, 32, 48, 64, 96, 128)
    layers: list[nn.Module] = []
    for before, after in pairwise(widths):
        layers += [nn.Conv2d(before, after, 3, 2, 1), nn.BatchNorm2d(after), nn.ReLU()]
    return nn.Sequential(*layers, nn.Flatten(), nn.Linear(128 * 4, 64), nn.ReLU(), nn.Linear(64, 3))


def train(pictures: Tensor, force: Tensor, minutes: float) -> tuple[nn.Module, Tensor, Tensor, int]:
    """Trains for some minutes, with flips of pictures and forces, on squared normalised errors."""
    torch.manual_seed(0)
    model = net()
    middle, spread = force.mean(0), force.std(0)
    middle[:2] = 0
    optimiser = torch.optim.AdamW(model.parameters(), 2e-3, weight_decay=0.02)
    start, steps = time.perf_counter(), 0
    while (past := (time.perf_counter() - start) / (60 * minutes)) < 1:
        for group in optimiser.param_groups:
            group["lr"] = 2e-3 * min(1.0, 20 * past + 0.01) * (1 - past)
        rows = torch.randint(len(pictures), (64,))
        x, y = pictures[rows].float() / 20, (force[rows] - middle) / spread
        for axis, side in ((0, -1), (1, -2)):
            if torch.rand(()) < 0.5:
                x, y = x.flip(side), y * (1 - 2 * (torch.arange(3) == axis).float())
        loss = (model(x) - y).square().mean()
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        steps += 1
    return model.eval(), middle, spread, steps


def ridge(train_x: Tensor, train_y: Tensor, test_x: Tensor, penalty: float = 1e-2) -> Tensor:
    """Predictions of a ridge regression on 16 x 16 pixels of all frames."""

    def small(x: Tensor) -> Tensor:
        return F.adaptive_avg_pool2d(x.float(), 16).flatten(1)

    x, y = small(train_x), train_y
    mean, scale = x.mean(0), x.std()
    x = (x - mean) / scale
    gram = x.T @ x + penalty * len(x) * torch.eye(x.shape[1])
    weights = torch.linalg.solve(gram, x.T @ (y - y.mean(0)))
    out: Tensor = (small(test_x) - mean) / scale @ weights + y.mean(0)
    return out


def scores(guess: Tensor, truth: Tensor, used: NDArray[np.float64]) -> dict[str, Any]:
    """R2 of x, y and z over all clips, sliding ones and sticking ones."""
    out: dict[str, Any] = {}
    for name, rows in (
        ("all", used > -1),
        ("sliding", used > 0.9),
        ("sticking", used < 0.6),
    ):
        wrong = (guess[rows] - truth[rows]).square().mean(0)
        out[name] = [round(float(v), 3) for v in 1 - wrong / truth[rows].var(0, correction=0)]
        out[f"{name}, clips"] = int(rows.sum())
    return out


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--sensor", default="gelsight_mini")
    parser.add_argument("--randomise", default="unit")
    parser.add_argument("--scenes", type=int, default=240)
    parser.add_argument("--minutes", type=float, default=5.0)
    args = parser.parse_args()
    seen = stacked(clips(args, SEEN, args.scenes, 1))
    test = stacked(clips(args, UNSEEN, args.scenes // 4, 2))
    model, middle, spread, steps = train(seen[0], seen[1], args.minutes)
    with torch.no_grad():
        guess = torch.cat([model(part.float() / 20) for part in torch.split(test[0], 256)])
    found = {
        "net": scores(guess * spread + middle, test[1], test[2]),
        "ridge on 16 x 16 pixels": scores(ridge(seen[0], seen[1], test[0]), test[1], test[2]),
    }
    save(
        f"sim_shear_{args.sensor}_{args.randomise}",
        {
            "what": __doc__,
            "sensor": args.sensor,
            "randomise": args.randomise,
            "clips": [len(seen[0]), len(test[0])],
            "deviation of the forces, N": [round(float(v), 3) for v in test[1].std(0)],
            "minutes": args.minutes,
            "steps": steps,
            "R2 of x, y, z": found,
        },
    )


if __name__ == "__main__":
    main()
