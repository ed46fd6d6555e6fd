"""Files of predictions, made."""

from pathlib import Path
from typing import Any

import numpy as np


def predictions(folder: Path, name: str, **arrays: Any) -> Path:
    path = folder / "predictions" / f"{name}.npz"
    path.parent.mkdir(exist_ok=True)
    np.savez(path, **arrays)
    return path


def classes(folder: Path, name: str, right: float, seed: int, groups: int = 60) -> Path:
    """Three clips a group, of two classes; a share is right."""
    rng = np.random.default_rng(seed)
    truth = np.random.default_rng(0).integers(2, size=3 * groups)
    wrong = np.repeat(rng.random(groups) > right, 3)
    units = np.repeat([f"r{i}" for i in range(groups)], 3)
    predicted = np.where(wrong, 1 - truth, truth)
    return predictions(
        folder, name, truth=truth, predicted=predicted, names=np.array(["a", "b"]), units=units
    )
