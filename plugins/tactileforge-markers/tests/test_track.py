"""Markers are found at rest and followed to a fraction of a pixel; formulas of their motion."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from dotted import SIZE, picture, places
from marker_truth import simulated
from tactileforge_markers.find import find_markers
from tactileforge_markers.motion import displacement_field, draw_arrows, marker_motion
from tactileforge_markers.track import MarkerTracker

from tactileforge.errors import DataError

AT = places()


def rms(errors):
    return float(np.sqrt(np.nanmean(np.sum(errors**2, axis=-1))))


@pytest.mark.parametrize("ink", [25, 240])
def test_markers_are_found_row_by_row(ink):
    grid = find_markers(picture(AT, gel=130, ink=ink))
    assert (len(grid.places), grid.bright) == (24, ink > 130)
    assert np.abs(grid.places - AT).max() < 0.1
    assert grid.radius == pytest.approx(4, abs=0.5)
    assert grid.pitch == pytest.approx(24, abs=0.1)


def test_a_picture_without_markers_is_refused_with_the_fix():
    rng = np.random.default_rng(0)
    for bare in (
        np.full((*SIZE, 3), 120, np.uint8),
        rng.integers(100, 150, (*SIZE, 3)).astype(np.uint8),
        cv2.circle(np.full((*SIZE, 3), 120, np.uint8), (80, 60), 8, (20, 20, 20), -1),
    ):
        with pytest.raises(DataError, match=r"no markers found .*dark: .*bright: .*Give a frame"):
            find_markers(bare)


def test_a_frame_of_another_form_is_refused():
    tracker = MarkerTracker(picture(AT), "left")
    with pytest.raises(DataError, match=r"left: a frame of \(60, 80\) pixels.*\(120, 160\)"):
        tracker.read(np.zeros((60, 80, 3), np.uint8))
    with pytest.raises(DataError, match="give RGB"):
        tracker.read(np.zeros(SIZE, np.uint8))
    with pytest.raises(DataError, match="give RGB"):
        MarkerTracker(np.zeros((*SIZE, 3), np.float32))


def test_markers_are_followed_to_a_fraction_of_a_pixel():
    tracker = MarkerTracker(picture(AT, noise=2, seed=1))
    turn = np.array([[0.0, -1], [1, 0]])
    center = AT.mean(0)
    for step in range(1, 9):
        moved = [0.7 * step, -0.4 * step] + 0.008 * step * (AT - center) @ turn.T
        found = tracker.read(picture(AT + moved, noise=2, seed=step + 1))
        assert np.isfinite(found).all()
        assert rms(found - moved) < 0.12


def test_a_hidden_marker_keeps_its_row_and_comes_back():
    tracker = MarkerTracker(picture(AT))
    for step in range(9):
        here = AT + np.array([1.5 * step, 0.5 * step])
        shown = here if step in (0, 8) else np.delete(here, [8, 9], axis=0)
        found = tracker.read(picture(shown))
        lost = np.flatnonzero(~np.isfinite(found[:, 0])).tolist()
        assert lost == ([] if step in (0, 8) else [8, 9])
    assert rms(found - [12, 4]) < 0.15


def test_markers_that_leave_the_picture_are_lost_alone():
    tracker = MarkerTracker(picture(AT))
    for step in range(0, 22, 3):
        found = tracker.read(picture(AT + np.array([step, 0])))
    out = AT[:, 0] + 21 > SIZE[1] - 1 - 4
    assert out.any()
    assert (np.isfinite(found[:, 0]) == ~out).all()
    assert rms(found - [21, 0]) < 0.15
    for step in range(21, -1, -3):
        found = tracker.read(picture(AT + np.array([step, 0])))
    assert np.isfinite(found).all()


@pytest.mark.parametrize("what", [0, 255])
def test_nothing_is_guessed_in_a_black_or_white_picture(what):
    tracker = MarkerTracker(picture(AT))
    assert np.isnan(tracker.read(np.full((*SIZE, 3), what, np.uint8))).all()
    assert np.isfinite(tracker.read(picture(AT))).all()


def test_shear_torsion_and_divergence_are_those_of_a_known_motion():
    angle = np.deg2rad(7)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    p = AT - AT.mean(0)
    moved = 1.1 * p @ turn.T - p + [3, -2]
    motion = marker_motion(AT, moved)
    assert motion.shear == pytest.approx((3, -2))
    assert motion.torsion == pytest.approx(7)  # clockwise, as y points down
    assert motion.divergence == pytest.approx(100 * 2 * (1.1 * np.cos(angle) - 1))
    moved[:10] = np.nan
    part = marker_motion(AT, moved)
    assert (part.torsion, part.seen) == (pytest.approx(7), 14 / 24)
    moved[:20] = np.nan
    assert np.isnan([*marker_motion(AT, moved).shear, marker_motion(AT, moved).torsion]).all()


def test_a_field_has_the_displacement_around_each_cell():
    even = displacement_field(AT, np.full((24, 2), [1.2, -2.4]), SIZE, 24)
    np.testing.assert_allclose(even, np.broadcast_to([1.0, -2.0], (12, 12, 2)), rtol=1e-6)
    lone = np.zeros((24, 2))
    lone[0] = 10
    field = displacement_field(AT, lone, SIZE, 24)[..., 0]
    near, far = field[2, 1], field[6:, 6:]  # the cell of the marker, and those of others
    assert 0.7 * 10 / 1.2 < near < 10 / 1.2
    assert np.abs(far).max() < 1e-3
    assert np.isnan(displacement_field(AT, np.full((24, 2), np.nan), SIZE, 24)).all()


def test_arrows_point_where_markers_went():
    drawn = draw_arrows(np.zeros((*SIZE, 3), np.uint8), AT[:1], np.array([[5.0, 0]]), scale=4)
    y, x, _ = np.nonzero(drawn)
    assert x.max() == pytest.approx(AT[0, 0] + 20, abs=2)
    assert abs(y.mean() - AT[0, 1]) < 1


@pytest.mark.slow
@pytest.mark.parametrize(("sensor", "seed"), [("gelsight_mini", 1), ("gelsight", 1)])
def test_the_error_against_the_simulator_is_below_a_fifth_of_a_pixel(sensor, seed):
    frames, true = simulated(sensor, seed)
    tracker = MarkerTracker(frames[0])
    rest = tracker.grid.places
    which = np.hypot(*(rest[:, None] - true[0]).transpose(2, 0, 1)).argmin(1)
    found = np.stack([tracker.read(frame) for frame in frames])
    wanted = (true - true[0])[:, which]
    touched = np.hypot(*wanted.transpose(2, 0, 1)) > 1
    assert touched.sum() > 100
    assert np.isfinite(found).mean() > 0.95
    assert rms(found - wanted) < 0.2
    assert rms((found - wanted)[touched]) < 0.2


@pytest.mark.realdata
@pytest.mark.slow
def test_markers_of_a_real_mini_are_followed_through_a_touch(realdata: Path):
    video = cv2.VideoCapture(str(realdata / "gelsight_mini_marker_video" / "mini_example.avi"))
    frames = []
    while (read := video.read())[0]:
        frames.append(cv2.cvtColor(read[1], cv2.COLOR_BGR2RGB))
    tracker = MarkerTracker(np.median(frames[:3], axis=0).astype(np.uint8))
    found = np.stack([tracker.read(frame) for frame in frames])
    assert found.shape == (219, 70, 2)
    assert np.isfinite(found).mean() > 0.97
    assert np.nanmax(np.abs(found)) > 5
    assert rms(found[-1]) < 0.7  # the finger has left, and the dots are where they were
