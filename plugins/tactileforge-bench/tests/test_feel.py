"""Grasp stability is predicted from the moment of the grasp, never from the lift."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from tactileforge_bench.results.load import read_results

from tactileforge import cli

OBJECTS, GRASPS = 10, 4


def write(root: Path, moment: str) -> None:
    """Grasps of objects: at one moment a spot to the right tells a stable grasp."""
    rng = np.random.default_rng(0)
    rows = []
    for number in range(OBJECTS):
        for grasp in range(GRASPS):
            stays = bool(rng.integers(2))
            rows.append(f"thing{number},{grasp},{int(stays)}")
            for when in ("before", "during", "after"):
                for finger in "AB":
                    pixels = rng.normal(100, 3, (32, 32, 3))
                    if when == moment:
                        pixels[8:24, 20 if stays else 4 :][:, :8] += 80
                    path = root / "feel" / f"thing{number}" / f"touch_{when}"
                    path.mkdir(parents=True, exist_ok=True)
                    grey = pixels.clip(0, 255).astype(np.uint8)
                    Image.fromarray(grey).save(path / f"{grasp}_{finger}.png")
    (root / "feel" / "feel.csv").write_text("\n".join(rows) + "\n")


@pytest.mark.slow
@pytest.mark.parametrize(("moment", "least", "most"), [("during", 95, 100), ("after", 20, 75)])
def test_a_lift_is_told_from_the_grasp_alone(
    tmp_path: Path, moment: str, least: float, most: float
) -> None:
    write(tmp_path, moment)
    words = ["suite=feel", f"data_folder={tmp_path}", "model=[pixels]", f"out={tmp_path}/out"]
    assert cli.run(["bench", *words, f"cache={tmp_path}/cache", "workers=0", "seeds=1"]) == 0
    cells = read_results(tmp_path / "out").cells
    accuracy = np.mean([cell.metrics["accuracy"] for cell in cells])
    assert least <= accuracy <= most
