"""Simulated pictures against numbers of real ones: fine detail, and the answer to shear."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from reality import measures, response
from tactileforge_sim.geometry.shapes import shape
from tactileforge_sim.play import play_scenes
from tactileforge_sim.randomise.draw import RandomDraw
from tactileforge_sim.randomise.table import TABLE
from tactileforge_sim.scene import draw_scene

#: Fine detail over contrast of real touches, see docs/simulator.md.
_LARGEST = 0.17
_EDGED = ("one_quarter_cylindrical", "square_prism")
#: Rows that change the object or the gel; those of camera and background have tests of their own.
_SURFACE = (
    "softness",
    "roughness",
    "grain",
    "worn",
    "warp",
    "print_lines",
    "stiffness",
    "contrast",
)


def _change(name: str, rows: list[str] | str, seed: int) -> NDArray[np.float32]:
    """Change of a Mini's picture at the deepest press, (H, W, 3)."""
    touch = draw_scene(
        seed, shape(name), "press", force=(3, 5), seconds=0.2, randomise=rows, reach="clip"
    )
    shots = play_scenes(touch, ["gelsight_mini"], measures.SIDE)
    pictures = np.concatenate([s.pictures for s in shots]).astype(np.float32)
    changes = pictures - pictures[0]
    return changes[int(np.argmax(np.abs(changes).mean(axis=(1, 2, 3))))]


@pytest.mark.parametrize("row", _SURFACE)
def test_no_row_draws_lines_or_grain_finer_than_real_ones(row: str) -> None:
    of = "" if TABLE[row].scope == "scene" else "gelsight_mini"
    seeds = [s for s in range(60) if RandomDraw([row], s, of)[row] != TABLE[row].neutral]
    # The strongest of some draws: of a soft object the yield is then a millimeter and more.
    seed = max(seeds[:20], key=lambda s: RandomDraw([row], s, of)[row])
    for name in _EDGED:
        assert 0.01 < measures.fine_share(_change(name, [row], seed)) < _LARGEST


@pytest.mark.slow
def test_all_rows_together_draw_no_finer_lines() -> None:
    shares = [measures.fine_share(_change(_EDGED[s % 2], "all", s)) for s in range(1, 5)]
    assert 0.03 < np.median(shares) < _LARGEST


def test_shear_of_the_whole_picture_is_found() -> None:
    rng = np.random.default_rng(0)
    force = np.stack([*rng.normal(0, 1, (2, 60)), rng.uniform(3, 4, 60)], axis=1)
    by_x, by_y = rng.normal(0, 1, (2, 8, 6, 3))
    shear = force[:, 0, None, None, None] * by_x + force[:, 1, None, None, None] * by_y
    changes = shear + force[:, 2, None, None, None] ** 2
    found = response.shear_everywhere(changes.astype(np.float32), force)
    assert found == pytest.approx([np.abs(by_x).mean(), np.abs(by_y).mean()], rel=1e-3)
