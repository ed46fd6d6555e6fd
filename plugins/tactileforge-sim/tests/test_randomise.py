from pathlib import Path

import numpy as np
import pytest
import torch
from tactileforge_sim.geometry.shapes import shape
from tactileforge_sim.mechanics.sensor_gels import sensor_gel
from tactileforge_sim.optics import sensor_instances
from tactileforge_sim.play import play_scenes
from tactileforge_sim.randomise.draw import CHOICES, RandomDraw, randomised_rows
from tactileforge_sim.randomise.table import TABLE
from tactileforge_sim.scene import draw_scene

from tactileforge.errors import ConfigError


def test_choices() -> None:
    assert randomised_rows("none") == frozenset()
    assert randomised_rows("all") == frozenset(TABLE)
    assert randomised_rows("unit") < randomised_rows("all")
    assert not any(TABLE[name].scope == "look" for name in randomised_rows("unit"))
    assert randomised_rows(["contrast", "sway"]) == {"contrast", "sway"}
    with pytest.raises(ConfigError, match="did you mean 'contrast'"):
        randomised_rows("contrst")


@pytest.mark.parametrize("name", TABLE)
def test_a_row_stays_in_its_range_and_is_neutral_unless_chosen(name: str) -> None:
    row = TABLE[name]
    values = np.array([row.draw(seed) for seed in range(200)])
    differs = values[values != row.neutral]
    assert ((row.low <= differs) & (differs <= row.high)).all()
    if row.high > row.low:
        assert np.ptp(differs) > 0.8 * (row.high - row.low)
        assert len(differs) / 200 == pytest.approx(row.share, abs=0.12)
    assert RandomDraw("none", 3)[name] == row.neutral
    assert RandomDraw(name, 3)[name] == RandomDraw("all", 3)[name]  # other rows do not matter


def test_rows_are_independent() -> None:
    drawn = np.array([[TABLE[name].draw(seed) for name in TABLE] for seed in range(300)])
    drawn = drawn[:, drawn.std(0) > 0]
    apart = np.corrcoef(drawn.T) - np.eye(drawn.shape[1])
    assert np.abs(apart).max() < 0.25


def test_no_randomisation_is_one_nominal_unit() -> None:
    first, other = (
        sensor_instances.draw_instance("digit", seed, (64, 48), randomise="none") for seed in (1, 2)
    )
    assert torch.equal(first.background, other.background)
    assert torch.equal(first.calibration.fine, other.calibration.fine)
    base = sensor_gel("gelsight_mini").gel
    assert sensor_instances.instance_gel(base, "gelsight_mini", 5, "none") == base
    assert sensor_instances.instance_gel(base, "gelsight_mini", 5, "unit") != base


def test_contrast_scales_the_change() -> None:
    how = sensor_instances.draw_instance("gelsight_mini", 3, (48, 64), randomise="none").calibration
    gain = RandomDraw("contrast", 3, "gelsight_mini")["contrast"]
    calibration = sensor_instances.draw_instance(
        "gelsight_mini", 3, (48, 64), randomise="contrast"
    ).calibration
    torch.testing.assert_close(calibration.fine, gain * how.fine)


def test_real_digits_are_as_bright_as_each_other() -> None:
    """Channel means of eight real units deviate by 3.7 to 4.8 grey levels."""
    means = torch.stack(
        [
            sensor_instances.draw_instance("digit", seed, (64, 48)).background.mean((1, 2))
            for seed in range(40)
        ]
    )
    assert 2.5 < float(means.std(0).mean()) < 6.5


@pytest.mark.parametrize("name", sorted(CHOICES["all"]))
def test_every_row_changes_what_is_seen_or_felt(name: str) -> None:
    """A touch on a marker gel, with the row of a seed at a value other than neutral."""
    only = set(TABLE[name].sensors) == {"digit"} and TABLE[name].low == TABLE[name].high
    sensor = "digit" if only or name == "specimen" else "gelsight_mini"
    of = "" if TABLE[name].scope == "scene" else sensor
    seed = next(s for s in range(50) if TABLE[name].draw(s, of) != TABLE[name].neutral)
    seen = []
    for choice in ("none", [name]):
        touch = draw_scene(seed, shape("hexagonal"), "slide_up", seconds=0.2, randomise=choice)
        shots = list(play_scenes(touch, [sensor], 120, markers=sensor != "digit"))
        pictures = np.concatenate([s.pictures for s in shots]).astype(int)
        force = np.concatenate([s.force for s in shots])
        seen.append((pictures, force))
    (plain, force), (other, other_force) = seen
    differs = plain.shape != other.shape or np.abs(plain - other).max() > 0
    assert differs or np.abs(force - other_force).max() > 0.01


def test_force_follows_shear_where_the_table_is_not_level() -> None:
    level = draw_scene(3, shape("cylindrical"), "slide_right", randomise="none")
    sloped = draw_scene(3, shape("cylindrical"), "slide_right", randomise="force_follows_shear")
    sway = sloped.path.sway
    assert level.path.sway is None
    assert sway is not None
    times = sloped.times(30)
    level_depth, depth = (s.path.pose(times)[:, 3] for s in (level, sloped))
    deep = level_depth > 0.99 * level_depth.max()
    moved = level.path.pose(times)[:, :2] - level.path.poses[0, :2]
    np.testing.assert_allclose((depth - level_depth)[deep], (moved @ sway.slope)[deep], atol=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize("motion", ["slide_left", "rotate_cw", "manipulation", "force_trial"])
def test_scenes_start_and_end_clear_of_the_gel(motion: str) -> None:
    for seed in range(8):
        touch = draw_scene(seed, shape("square_prism"), motion, seconds=0.2, randomise="all")
        force = np.concatenate([s.force for s in play_scenes(touch, ["digit"], 16)])
        assert not force[0].any()
        assert not force[-1].any()


def test_a_force_that_a_shape_does_not_reach_is_refused() -> None:
    with pytest.raises(ConfigError, match="small_sphere presses with"):
        draw_scene(0, shape("small_sphere"), "press", force=(50, 50))
    hard, most = (
        draw_scene(0, shape("small_sphere"), "press", force=force, reach="clip")
        for force in ((50, 50), (0.5, 50))
    )
    assert hard.path.poses[:, 3].max() == pytest.approx(1.5)
    assert most.path.poses[:, 3].max() < 1.5


@pytest.mark.slow
def test_scenes_together_are_scenes_alone() -> None:
    touches = [
        draw_scene(seed, shape(name), "slide_up", seconds=0.2, randomise="all")
        for seed, name in enumerate(("square_prism", "small_sphere", "ring_shaped"))
    ]
    sensors = ["digit", "gelsight_mini"]
    together = list(play_scenes(touches, sensors, 32))
    for number, touch in enumerate(touches):
        alone = list(play_scenes(touch, sensors, 32))
        for place in (0, 1):
            alone_images = np.concatenate([s.pictures for s in alone if s.sensor == place])
            other = np.concatenate(
                [s.pictures for s in together if (s.scene, s.sensor) == (number, place)]
            )
            np.testing.assert_array_equal(alone_images, other)


def test_the_page_has_every_row_with_its_range() -> None:
    page = (Path(__file__).parents[3] / "docs" / "simulator.md").read_text().splitlines()
    for name, row in TABLE.items():
        (line,) = (line for line in page if line.startswith(f"| `{name}` |"))
        assert row.what in line
        assert row.low == row.high or f"{row.low:g} to {row.high:g}" in line
