import math
from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest
from omegaconf import OmegaConf

from tactileforge.checks.sample import changes
from tactileforge.contracts import Recording
from tactileforge.data.labels.align import Lag, estimate_lag, nearest
from tactileforge.datasets.recordings import Recordings
from tactileforge.errors import DataError

CONFIG = Path(str(files("tactileforge_datasets.conf") / "data/public_samples.yaml"))


def test_nearest_is_the_closest_and_of_two_the_earlier() -> None:
    times = np.array([0.0, 0.1, 0.2, 0.5])
    at = np.array([-1.0, 0.0, 0.04, 0.05, 0.06, 0.35, 0.36, 9.0])
    assert nearest(times, at).tolist() == [0, 0, 0, 0, 1, 2, 3, 3]
    assert nearest([3.0], [1.0, 9.0]).tolist() == [0, 0]
    assert nearest(times, []).tolist() == []
    with pytest.raises(DataError, match="no frames to pair with"):
        nearest([], [1.0])


def test_nearest_agrees_with_the_search_of_all_pairs() -> None:
    rng = np.random.default_rng(0)
    times, at = np.sort(rng.uniform(0, 5, 200)), rng.uniform(-1, 6, 500)
    want = np.abs(times[:, None] - at).argmin(axis=0)
    assert nearest(times, at).tolist() == want.tolist()


def pressing(times: np.ndarray) -> np.ndarray:
    """Normal force of three presses of different strength and length, N."""
    presses = ((0.8, 0.15, 4.0), (2.2, 0.3, 2.0), (3.4, 0.1, 3.0))
    return sum(top * np.exp(-(((times - at) / width) ** 2)) for at, width, top in presses)


def shifted(lag: float, fps: float, seconds: float = 5.0) -> tuple[np.ndarray, ...]:
    """Times, forces, and pictures of the force ``lag`` seconds before."""
    times = np.arange(0, seconds, 1 / fps)
    force = np.stack([0.3 * pressing(times), 0 * times, pressing(times)], axis=1)
    return times, force, 0.5 + 1.7 * pressing(times - lag)


@pytest.mark.parametrize("fps", [18.0, 30.0, 60.0])
@pytest.mark.parametrize("lag", [-0.21, -1 / 30, 0.0, 0.05, 0.2, 0.37])
def test_a_known_lag_is_found_to_a_fraction_of_a_frame(lag: float, fps: float) -> None:
    found = estimate_lag(*shifted(lag, fps))
    assert found.seconds == pytest.approx(lag, abs=0.15 / fps)
    assert found.correlation > 0.98
    assert found.prominence > 0.3


def test_noise_missing_labels_and_an_uneven_clock_do_not_hide_it() -> None:
    rng = np.random.default_rng(1)
    times = np.cumsum(rng.uniform(0.8, 1.2, 150)) / 30
    force = np.stack([0 * times, 0 * times, pressing(times)], axis=1)
    force += rng.normal(0, 0.1, force.shape)
    force[rng.choice(150, 30, replace=False)] = np.nan
    force[:6] = np.nan
    change = pressing(times - 0.1) + rng.normal(0, 0.2, 150)
    lag = estimate_lag(times, force, change)
    assert lag.seconds == pytest.approx(0.1, abs=0.02)
    assert lag.correlation > 0.9


def test_across_a_gap_nothing_is_correlated() -> None:
    times, force, change = shifted(0.1, 30)
    times[60:] += 1e6
    change[:60] = np.linspace(0, 50, 60)
    want = estimate_lag(times[60:], force[60:], change[60:])
    assert estimate_lag(times, force, change) == want
    assert want.seconds == pytest.approx(0.1, abs=0.005)


def test_the_sign_of_the_force_does_not_matter() -> None:
    times, force, change = shifted(0.1, 30)
    assert estimate_lag(times, -force, change) == estimate_lag(times, force, change)


def test_a_ramp_fits_at_every_lag() -> None:
    times = np.arange(0, 3, 1 / 30)
    ramp = np.stack([0 * times, 0 * times, times], axis=1)
    lag = estimate_lag(times, ramp, 2 * times - 0.2)
    assert lag.correlation == pytest.approx(1)
    assert lag.prominence == pytest.approx(0, abs=1e-9)


def test_a_lag_beyond_the_search_is_not_prominent() -> None:
    lag = estimate_lag(*shifted(0.45, 30), reach=0.2)
    assert abs(lag.seconds) <= 0.2
    assert lag.prominence < 0.01


@pytest.mark.parametrize("case", ["still force", "still picture", "no labels", "short", "no time"])
def test_nothing_that_moves_gives_nan(case: str) -> None:
    times, force, change = shifted(0.1, 30)
    if case == "still force":
        force[:] = 3.0
    elif case == "still picture":
        change[:] = 7.1
    elif case == "no labels":
        force[:] = np.nan
    elif case == "short":
        times, force, change = times[:7], force[:7], change[:7]
    else:
        times[50] = times[49]
    lag = estimate_lag(times, force, change)
    assert all(map(math.isnan, (lag.seconds, lag.correlation, lag.prominence)))


def test_lengths_have_to_agree() -> None:
    times, force, change = shifted(0.1, 30)
    with pytest.raises(DataError, match="150 times, 150 forces and 149 frames"):
        estimate_lag(times, force, change[1:])


def demo(realdata: Path, name: str, lag_s: float | None) -> tuple[Recording, Lag]:
    """A recording of ToucHD's demonstration, and its lag after a correction."""
    layout = OmegaConf.to_container(OmegaConf.load(CONFIG).data.layouts[name])
    layout["hold_out"] = "none"
    if lag_s is not None:
        layout["force"]["lag_s"] = lag_s
    (recording,) = Recordings(str(realdata), {name: layout}).recordings("train")
    assert recording.force is not None
    return recording, estimate_lag(
        recording.times, recording.force, changes(recording, range(len(recording.frames)))
    )


@pytest.mark.slow
@pytest.mark.realdata
@pytest.mark.parametrize(
    ("name", "frames"), [("touchd_force_gelsight_mini", 6), ("touchd_force_digit", 2)]
)
def test_the_lag_of_the_demonstrations(realdata: Path, name: str, frames: int) -> None:
    """6 and 2 video frames at 30 Hz, as their README has it; about none once corrected."""
    _, raw = demo(realdata, name, 0.0)
    assert raw.seconds * 30 == pytest.approx(frames, abs=0.7)
    assert raw.correlation > 0.85
    assert raw.prominence > 0.1
    _, corrected = demo(realdata, name, None)
    assert abs(corrected.seconds * 30) < 0.7
    assert corrected.correlation > 0.85
