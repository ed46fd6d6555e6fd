"""Each detector fires on the recording with its fault, alone, and not on a good one."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from tactileforge_inspect.findings import InspectionFindings, Suspect
from tactileforge_inspect.frame_stats import frame_stats
from tactileforge_inspect.reasons import OF_FRAMES, OF_LABELS, REASONS

from tactileforge.checks.doubts import Suspicion, check_labels
from tactileforge.checks.lag import LAG, check_lag, is_sure, lag_of
from tactileforge.checks.run import CheckRun
from tactileforge.contracts import Recording
from tactileforge.data.frames.lazy import ArrayFrames
from tactileforge.data.labels.align import Lag, estimate_lag

Touch = Callable[..., Recording]


def flags(recording: Recording) -> dict[str, Suspicion]:
    """All findings, by reason."""
    run = CheckRun([*OF_LABELS, *OF_FRAMES])
    raised = [Suspicion(one.name, one.value, one.words) for one in run.look(recording)]
    assert run.unreadable == []
    lag = lag_of(recording)
    raised += check_lag(recording, lag) if lag else []
    assert len({flag.reason for flag in raised}) == len(raised)
    assert {flag.reason for flag in raised} <= set(REASONS)
    return {flag.reason: flag for flag in raised}


def without(array: Any, rows: slice) -> None:
    """Repeats the frame before some rows, bit by bit."""
    array[rows] = array[rows.start - 1]


def overexposed(array: Any, share: float = 0.12) -> None:
    array[36:44, : int(share * array.shape[1])] = 255


def scaled(factor: float, axis: int = 2) -> dict[str, Any]:
    force = np.zeros((90, 3), np.float32)
    force[:, 2] = np.linspace(0, 9, 90)
    force[:, axis] = np.linspace(0, factor, 90)
    return {"force": force}


def late(row: int) -> dict[str, Any]:
    force = np.zeros((90, 3), np.float32)
    force[:, 2] = np.linspace(0, 9, 90)
    force[:row] = np.nan
    force[-1] = 0  # nothing touches in the last frame
    return {"force": force}


def sparse(every: int) -> dict[str, Any]:
    force = np.full((90, 3), np.nan, np.float32)
    force[::every] = 0
    force[::every, 2] = np.linspace(0, 9, 90)[::every]
    return {"force": force}


def exchanged() -> dict[str, Any]:
    force = np.zeros((90, 3), np.float32)
    force[:, 0] = np.linspace(0, 6, 90)
    force[:, 2] = 0.25 * force[:, 0]
    return {"force": force}


def stuck(row: int) -> dict[str, Any]:
    force = np.random.default_rng(0).normal(2, 0.1, (90, 3)).astype(np.float32)
    force[0] = 0  # nothing touches in the first frame
    force[row:] = force[row]
    return {"force": force}


def gapped(step: float) -> dict[str, Any]:
    times = np.arange(90) / 30.0
    times[50:] += step - 1 / 30
    return {"times": times, "force": None}


@pytest.mark.parametrize("seed", range(5))
def test_a_good_recording_raises_no_flag(touch: Touch, seed: int) -> None:
    assert flags(touch(seed)) == {}


def test_a_good_still_raises_no_flag(touch: Touch) -> None:
    assert flags(touch(count=1)) == {}


def tiny(count: int) -> ArrayFrames:
    """Flat pictures of 4 x 4 pixels, each of another level than the one before."""
    levels = 90 + 40 * (np.arange(count) % 3)
    return ArrayFrames(np.repeat(levels, 48).reshape(count, 4, 4, 3).astype(np.uint8))


FAULTS: dict[str, tuple[dict[str, Any], float, str]] = {
    "never_in_contact": ({"height": 0.0}, 0.6, "grey levels"),
    "background_changed": ({"edit": lambda a: np.add(a, 25, out=a, casting="unsafe")}, 25, "25 "),
    "saturated": ({"edit": overexposed}, 5 / 48, "10 % of the pixels"),
    "frozen": ({"edit": lambda a: without(a, slice(31, 75))}, 1.33, "the same image for 1."),
    "lag": ({"lag": 0.2}, 0.2, "images come 0.2 s after forces"),
    "gaps_in_time": (gapped(0.5), 15, "1 gap, up to 0.5 s (usual 0.0333 s)"),
    "force_out_of_range": (scaled(60), 60 / 14.14, "60 N along z, 4.2 times the scale"),
    "pulling_force": (scaled(-2), 2, "down to -2 N along z"),
    "stuck_force": (stuck(40), 1.63, "s of one and the same force"),
    "forces_apart": (late(40), 40 / 30, "1.33 s until the first force"),
    "forces_between": (sparse(3), 0.66, "30 of 88 frames from the first force to the last have"),
    "axes_exchanged": (exchanged(), 4, "largest along x, with one sign, 4 times z"),
    "untared_force": (
        {"force": np.full((90, 3), 1.4, np.float32) + np.arange(90)[:, None] * np.float32(1e-3)},
        1.4 / 5.25,
        "(1.4, 1.4, 1.4) N where nothing touches",
    ),
    "no_background": ({"no_contact": None}, 0, "no frame without contact"),
    "tiny_pictures": (
        {"frames": tiny(90), "no_contact": tiny(1), "force": None},
        4,
        "4 x 4 pixels",
    ),
    "views_elsewhere": (
        {"image": tiny(3), "image_times": np.arange(3) + 60.0},
        57.03,
        "57 s from the nearest frame",
    ),
}


@pytest.mark.parametrize("reason", FAULTS)
def test_each_fault_is_found_alone_and_measured(touch: Touch, reason: str) -> None:
    fields, value, words = FAULTS[reason]
    raised = flags(touch(3, **fields))
    assert set(raised) == {reason}
    assert raised[reason].value == pytest.approx(value, rel=0.25)
    assert words in raised[reason].words


def test_every_reason_has_a_fault() -> None:
    of_a_set = {"colours_swapped", "on_its_side", "mirrored", "grey_pictures"}  # see test_resting
    # tests/checks has those that came with the checks
    newer = {"zero_force", "odd_first_frames", "paired_times", "repeated_frames"}
    assert set(FAULTS) == set(REASONS) - of_a_set - newer


@pytest.mark.parametrize(
    "fields",
    [
        {"height": 12.0},
        {"edit": lambda a: np.add(a, 3, out=a, casting="unsafe")},
        {"edit": lambda a: overexposed(a, 0.04)},
        {"edit": lambda a: without(a, slice(31, 46))},
        {"lag": 0.04},
        gapped(2 / 30),
        scaled(20),
        scaled(5.25 * 1.4, axis=0),
        scaled(-0.3),
    ],
    ids=["faint", "light", "glint", "half a second", "lag", "one frame", "z", "x", "tare"],
)
def test_just_below_the_threshold_nothing_is_flagged(touch: Touch, fields: Any) -> None:
    assert flags(touch(3, **fields)) == {}


def test_just_above_its_threshold_another_background_is_flagged(touch: Touch) -> None:
    raised = flags(touch(3, edit=lambda a: np.add(a, 8, out=a, casting="unsafe")))
    assert set(raised) == {"background_changed"}


def test_pictures_before_forces_are_a_lag_too(touch: Touch) -> None:
    assert "0.2 s before forces" in flags(touch(3, lag=-0.2))["lag"].words


def test_a_lag_needs_frames_and_forces_that_move(touch: Touch) -> None:
    assert lag_of(touch(force=None)) is None
    assert lag_of(touch(count=29)) is None
    assert lag_of(touch(force=np.full((90, 3), np.nan, np.float32))) is None
    still = lag_of(touch(force=np.ones((90, 3), np.float32)))
    assert still is not None
    assert not is_sure(still)
    assert not list(check_lag(touch(), still))
    assert not is_sure(Lag(0.3, 0.95, 0.01, 0.94)), "a ramp"


def test_only_the_stretch_around_the_largest_force_is_read(touch: Touch) -> None:
    base = touch()
    count = 3000
    read: list[int] = []

    class Spy:
        shape = base.frames.shape

        def __len__(self) -> int:
            return count

        def read(self, indices: Any) -> Any:
            read.extend(indices)
            return base.frames.read([min(i, 89) for i in indices])

    force = np.zeros((count, 3), np.float32)
    force[2800, 2] = 5
    lag_of(touch(frames=Spy(), times=np.arange(count) / 30, force=force))
    assert read == list(range(2000, 3000))


@pytest.mark.parametrize("times", [[0.0, 0.1, 0.1, 0.2], [0.0, 0.1, np.nan, 0.2], [0.0, 0.1]])
def test_times_that_stand_still_or_are_missing(touch: Touch, times: list[float]) -> None:
    (flag,) = check_labels(touch(count=4, times=np.array(times), force=None))
    assert flag.reason == "gaps_in_time"
    assert flag.value == np.inf


def test_a_sensor_that_is_not_installed_has_no_range(touch: Touch) -> None:
    assert list(check_labels(touch(sensor="new", **scaled(500)))) == []


def test_missing_labels_are_no_fault(touch: Touch) -> None:
    force = np.full((90, 3), np.nan, np.float32)
    assert list(check_labels(touch(force=force))) == []
    force[40] = [0, 0, 3]
    assert list(check_labels(touch(force=force))) == []


def test_a_force_along_one_axis_is_no_fault(touch: Touch) -> None:
    recording = touch(0)
    recording.force[:, :2] = np.nan
    assert flags(recording) == {}
    recording.force[:, 2] *= -1
    assert set(flags(recording)) == {"pulling_force"}


def test_without_a_background_contact_cannot_be_told(touch: Touch) -> None:
    assert set(flags(touch(no_contact=None, height=0.0, force=None))) == {"no_background"}


def test_other_sizes_are_errors_that_name_the_recording(touch: Touch) -> None:
    small = ArrayFrames(np.zeros((1, 24, 64, 3), np.uint8))
    with pytest.raises(Exception, match=r"made/0: the background has 64x24 pixels.*64x48"):
        frame_stats(touch(no_contact=small))
    with pytest.raises(Exception, match="made/0: 3 times for 90 frames"):
        frame_stats(touch(times=np.arange(3.0)))


def test_shear_that_grows_the_imprint_and_a_short_ramp_are_no_lag(touch: Touch) -> None:
    """A drag after the press makes the picture change more, later: the force is not late."""
    times = np.arange(90) / 30
    press = np.clip(np.sin((times - 0.3) / 2.4 * np.pi), 0, None)
    force = np.stack([0 * press, 0 * press, 4 * press], 1)
    found = estimate_lag(times, force, press * (1 + 0.3 * times))
    assert found.seconds > LAG
    assert is_sure(found)
    assert not list(check_lag(touch(), found))
    ramp = slice(0, 36)
    found = estimate_lag(times[ramp], force[ramp], press[ramp] ** 2)
    assert not list(check_lag(touch(), found))
    late = estimate_lag(times, force, np.interp(times - 0.2, times, press * (1 + 0.3 * times)))
    assert [flag.reason for flag in check_lag(touch(), late)] == ["lag"]


def test_light_that_drifts_is_no_lag(touch: Touch) -> None:
    """It brightens every pixel by about as much, for longer than the touch lasts."""
    recording = touch()
    still = lag_of(recording)
    frames = recording.frames.read(range(90)).astype(np.int16)
    drift = np.linspace(0, 30, 90).astype(np.int16)[:, None, None, None]
    bright = np.minimum(frames + drift, 255).astype(np.uint8)
    found = lag_of(replace(recording, frames=ArrayFrames(bright)))
    assert still is not None
    assert found is not None
    assert found.seconds == pytest.approx(still.seconds, abs=0.02)
    assert not list(check_lag(recording, found))


def test_the_summary_names_the_worst_and_what_cannot_be_read() -> None:
    worst = Suspect("lag", 0.2, "images come 0.2 s after forces", "a/1", "train", "digit", 0)
    found = InspectionFindings(
        totals={},
        looked=2,
        counts={"lag": 2, "frozen": 0},
        worst={"lag": [worst]},
        duplicates=[("a", "b")],
        similar=[],
        repeated=[],
        unreadable=["a/2: 3.png is not a picture"],
    )
    assert str(found).splitlines()[1:] == [
        "2 lag, the worst a/1: images come 0.2 s after forces",
        "1 recording cannot be read",
        "1 group of recordings with the same pixels",
        "  a/2: 3.png is not a picture",
    ]
