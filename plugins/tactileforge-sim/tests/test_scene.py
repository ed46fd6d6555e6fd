from dataclasses import replace

import numpy as np
import pytest
from tactileforge_depth import contact
from tactileforge_sim.geometry.indenter_geometry import Shape
from tactileforge_sim.geometry.shapes import shape
from tactileforge_sim.play import play_scenes
from tactileforge_sim.scene import Scene, draw_scene

from tactileforge.data.labels import displacement
from tactileforge.errors import ConfigError

SIZE = 48


def film(touch: Scene, *sensors: str, **options: object) -> list[tuple[np.ndarray, np.ndarray]]:
    """Pictures and forces on each sensor."""
    shots = list(play_scenes(touch, sensors, SIZE, **options))  # type: ignore[arg-type]
    return [
        (
            np.concatenate([s.pictures for s in shots if s.sensor == i]),
            np.concatenate([s.force for s in shots if s.sensor == i]),
        )
        for i in range(len(sensors))
    ]


@pytest.fixture(scope="module")
def touch() -> Scene:
    return draw_scene(3, shape("pentagram"), "slide_right", force=(3, 3), seconds=0.3)


@pytest.mark.slow
def test_a_seed_draws_one_touch(touch: Scene) -> None:
    again = draw_scene(3, shape("pentagram"), "slide_right", force=(3, 3), seconds=0.3)
    np.testing.assert_array_equal(again.path.poses, touch.path.poses)
    first, second = film(touch, "digit")[0], film(again, "digit")[0]
    np.testing.assert_array_equal(first[0], second[0])
    np.testing.assert_array_equal(first[1], second[1])
    other = draw_scene(4, shape("pentagram"), "slide_right", force=(3, 3), seconds=0.3)
    assert not np.array_equal(other.path.poses[:, :3], touch.path.poses[:, :3])


@pytest.mark.parametrize("name", ["small_sphere", "cylindrical", "small_square_array"])
def test_the_depth_gives_the_force_asked_for(name: str) -> None:
    wanted = 3.0
    pressed = draw_scene(
        1, shape(name), "press", force=(wanted, wanted), seconds=0.3, randomise="none"
    )
    ((_, force),) = film(pressed, "gelsight")
    assert float(force[:, 2].max()) == pytest.approx(wanted, rel=0.1)


@pytest.mark.slow
def test_sensors_together_are_sensors_alone(touch: Scene) -> None:
    sensors = ("digit", "gelsight", "gelsight_mini", "duragel")
    for sensor, (pictures, force) in zip(sensors, film(touch, *sensors), strict=True):
        ((alone, force_alone),) = film(touch, sensor)
        np.testing.assert_array_equal(force, force_alone)
        np.testing.assert_array_equal(pictures, alone)


def test_each_sensor_has_its_size_and_its_rate(touch: Scene) -> None:
    digit, mini = film(touch, "digit", "gelsight_mini")
    assert digit[0].shape[1:] == (64, 48, 3)
    assert mini[0].shape[1:] == (48, 64, 3)
    assert (len(digit[0]), len(mini[0])) == tuple(
        int(touch.path.seconds * fps) + 1 for fps in (30, 18)
    )


def test_no_contact_is_the_background(touch: Scene) -> None:
    for pictures, force in film(touch, "digit", "gelsight_mini"):
        free = force[:, 2] == 0
        assert free.any()
        background = np.median(pictures[free], 0)
        apart = np.abs(pictures - background).mean((1, 2, 3))
        assert apart[free].max() < 2
        assert apart[~free].max() > 1.5 * apart[free].max()


def test_a_mirrored_scene_has_the_mirrored_force(touch: Scene) -> None:
    there = touch.shape
    mirrored = Shape("mirrored", lambda x, y: there.height(-x, y), there.radius)
    mirror = replace(touch, shape=mirrored, path=touch.path.mirrored())
    ((_, force),), ((_, other),) = film(touch, "digit"), film(mirror, "digit")
    np.testing.assert_allclose(other, force * (-1, 1, 1), rtol=0.02, atol=0.03)


def test_markers_are_a_choice(touch: Scene) -> None:
    ((plain, _),), ((dotted, _),) = (
        film(touch, "gelsight_mini", markers=markers) for markers in (False, True)
    )
    assert dotted[0].astype(int).sum() < 0.97 * plain[0].astype(int).sum()


def test_mistakes_are_named(touch: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(ConfigError, match="unknown motion 'slide'"):
        draw_scene(0, shape("pentagram"), "slide")
    with pytest.raises(ConfigError, match="must be greater than 0"):
        draw_scene(0, shape("pentagram"), "press", force=(2, 1))
    with pytest.raises(
        ConfigError, match="unknown simulated sensor 'gelsigth'; did you mean 'gelsight'"
    ):
        film(touch, "gelsigth")
    with pytest.raises(ConfigError, match=r"is 0\.3 mm wide"):
        film(replace(touch, shape=Shape("hair", touch.shape.height, 0.15)), "digit")
    monkeypatch.setattr(contact, "_STEPS", 1)
    with pytest.raises(contact.NotConverged, match="touch of seed 3, frame"):
        film(touch, "digit")


def test_the_surface_is_the_dent_of_the_object() -> None:
    """A flat punch dents the gel as deep as it goes, and drags it along as it slides."""
    slid = draw_scene(
        5, shape("square_prism"), "slide_right", force=(4, 4), seconds=0.3, randomise="none"
    )
    shots = list(play_scenes(slid, ["gelsight"], 64, surface=True))
    plain = list(play_scenes(slid, ["gelsight"], 64))
    for asked, other in zip(shots, plain, strict=True):
        np.testing.assert_array_equal(asked.pictures, other.pictures)
        assert other.surface is None
    moved = displacement.decode_displacement(
        np.concatenate([s.surface for s in shots if s.surface is not None])
    )
    force = np.concatenate([s.force for s in shots])
    assert moved.shape[1:] == (32, 42, 3)
    deep = moved[..., 2].max((1, 2))
    depth = slid.poses(30.0)[:, 3]
    pressed = force[:, 2] > 2
    np.testing.assert_allclose(deep[pressed], depth[pressed], atol=0.06)
    assert (moved[force[:, 2] == 0] == 0).all()
    last = int(force[:, 0].argmax())
    under = moved[last][moved[last, ..., 2] > 0.5 * deep[last]]
    assert under[:, 0].mean() > 0.03 > abs(under[:, 1].mean())
