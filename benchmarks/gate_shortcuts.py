"""Two labels of the gate told by one number or the mean colour, without any encoder.

The diameter of a ball: nearest neighbour of each press among the others, by the mean colour of
the frame, and by that of the frame less the background. Contact with a cable: a threshold on the
mean absolute change of the frame, chosen on the other folds. Balanced accuracies, as shares.

Run: TACTILEFORGE_REALDATA=DIR python benchmarks/gate_shortcuts.py
"""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
import torch
from common import save
from numpy.typing import NDArray
from omegaconf import OmegaConf
from tactileforge_bench.tasks.metrics import MeanRecall
from tactileforge_bench.tasks.source import TaskSource, open_source
from tactileforge_bench.tasks.splits import build_splits
from tactileforge_bench.tasks.suite import Task, parse_task
from tactileforge_bench.tasks.targets import Target, build_target

SUITE = Path(str(files("tactileforge_bench.conf") / "suite/real_held_out.yaml"))

Values = NDArray[np.float64]


def opened(name: str) -> tuple[Task, TaskSource, Target]:
    """A task of the held-out suite, its clips and its target."""
    config: Any = OmegaConf.to_container(OmegaConf.load(SUITE), resolve=True)
    task = parse_task(name, config["tasks"][name])
    source = open_source(task.data, task.sides, task.clip)
    return task, source, build_target(task, source)


def mean_colors(source: TaskSource, target: Target) -> dict[str, Values]:
    """Mean colours of the last frames of the clips of a target, (n, 3), by kind of picture."""
    rows = []
    stills = {}
    for number, last in source.index[target.clips].tolist():
        recording = source.recordings[number]
        if number not in stills:
            rest = recording.background()
            assert rest is not None
            stills[number] = rest.astype(float)
        frame, still = recording.frames.read([last])[0].astype(float), stills[number]
        pictures = (frame, frame - still, np.abs(frame - still))
        rows.append([picture.mean((0, 1)) for picture in pictures])
    names = ("frame", "frame less background", "absolute change")
    return dict(zip(names, np.moveaxis(np.array(rows), 1, 0), strict=True))


def balanced(predicted: NDArray[Any], truth: NDArray[Any]) -> float:
    """Mean recall of the classes."""
    recall = MeanRecall(int(truth.max()) + 1)
    return float(recall(*(torch.as_tensor(row, dtype=torch.long) for row in (predicted, truth))))


def nearest(colors: Values, truth: NDArray[Any]) -> dict[str, float]:
    """Accuracies of the nearest other press by colour, (n, 3)."""
    distance = np.linalg.norm(colors[:, None] - colors[None], axis=2)
    np.fill_diagonal(distance, np.inf)
    predicted = truth[distance.argmin(1)]
    accuracy = float((predicted == truth).mean())
    return {
        "accuracy": round(accuracy, 4),
        "balanced_accuracy": round(balanced(predicted, truth), 4),
    }


def threshold(task: Task, source: TaskSource, target: Target, change: Values) -> float:
    """Balanced accuracy of a threshold on one number, chosen on the other folds."""
    truth = target.names
    assert truth is not None
    predicted = np.zeros_like(truth)
    for split in build_splits(task, source, target):
        known = split.known
        bounds = np.unique(change[known])
        best = max(bounds, key=lambda bound: balanced(change[known] > bound, truth[known]))
        predicted[split.test] = change[split.test] > best
    return round(balanced(predicted, truth), 4)


def main() -> None:
    _, source, target = opened("held_ball_size")
    truth = target.names
    assert truth is not None
    ball = {what: nearest(colors, truth) for what, colors in mean_colors(source, target).items()}
    task, source, target = opened("held_cable_contact")
    change = mean_colors(source, target)["absolute change"].mean(1)
    cable = {"threshold on the absolute change": threshold(task, source, target, change)}
    save("gate_shortcuts", {"held_ball_size": ball, "held_cable_contact": cable})


if __name__ == "__main__":
    main()
