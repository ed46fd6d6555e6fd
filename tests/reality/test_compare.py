"""Sets of touches against each other, and the verb from end to end."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from reality.compare import CompareOptions, by_source, compare_reality
from reality.profiles import DISTANCES, distances, profile, ratio
from reality.touches import strongest_touches
from sim_compare import main

from tactileforge.contracts import Recording
from tactileforge.data.frames.lazy import ArrayFrames
from tactileforge.errors import ConfigError, DataError

SIM = ["data=sim", "data.scenes=3", "data.val=0", "data.size=64", "data.sensors=[digit]"]
FEW = ["scenes=2", "trials=0", "indenters=[small_sphere,ring_shaped]", "newton=[3,6]"]


def recording(
    seed: int, gain: float = 1.0, frames: int = 12, source: str = "a", **fields: Any
) -> Recording:
    """Presses of a soft disc, brighter and darker by colour; 30 Hz, 120 x 160."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[:120, :160]
    at_x, at_y, radius = rng.uniform(50, 110), rng.uniform(40, 80), rng.uniform(12, 20)
    far = np.hypot(y - at_y, x - at_x)
    bump = 1 / (1 + np.exp(far - radius))
    level = np.concatenate([np.zeros(4), np.linspace(0, 1, frames)])
    change = level[:, None, None, None] * bump[..., None] * np.array([30.0, -20, 10]) * gain
    shown = 110 + change + 1.2 * rng.standard_normal(change.shape, np.float32)
    array = np.clip(np.round(shown), 0, 255).astype(np.uint8)
    given = {
        "key": f"{source}/{seed}",
        "sensor": "digit",
        "frames": ArrayFrames(array),
        "times": np.arange(len(array)) / 30,
        "no_contact": ArrayFrames(array[:4]),
    }
    return Recording(**(given | fields))


class Listed:
    """A data set in memory."""

    provides: frozenset[str] = frozenset()

    def __init__(self, *held: Recording) -> None:
        self.held, self.skipped = held, []

    def recordings(self, split: str) -> Iterator[Recording]:
        yield from self.held if split == "train" else ()

    def plot(self, recording: Recording) -> None:
        raise NotImplementedError


@pytest.mark.slow
def test_a_recording_is_a_touch_for_each_part_of_it():
    assert len(strongest_touches(recording(0))) == 1
    assert len(strongest_touches(recording(0, frames=196))) == 3
    assert len(strongest_touches(recording(0, frames=196), most=2)) == 2
    (seen,) = strongest_touches(recording(0))
    assert seen.picture.shape == (120, 160, 3)
    assert seen.noise == pytest.approx((1.2**2 + 1 / 12) ** 0.5, rel=0.02)
    assert 0.02 < seen.touched.mean() < 0.1
    assert strongest_touches(recording(0, no_contact=None)) == []
    small = ArrayFrames(np.zeros((1, 60, 80, 3), np.uint8))
    with pytest.raises(
        DataError, match=r"a/0: the background has 80x60 pixels, the frames 160x120"
    ):
        strongest_touches(recording(0, no_contact=small))


@pytest.mark.slow
def test_equal_sets_are_not_apart_and_others_by_what_differs():
    first = profile("a", "digit", [recording(seed) for seed in range(12)])
    assert (len(first.looks), first.faint, first.stored, len(first.shown)) == (12, 0, [], 3)
    same = distances(first, profile("b", "digit", [recording(seed) for seed in range(12)]))
    assert {name: value for name, value in same.items() if value != 0} == pytest.approx(
        {"spectrum": np.nan, "normal force": np.nan, "shear": np.nan}, nan_ok=True
    ), "120 rows do not reach all bands, and there is no force"
    other = profile("c", "digit", [recording(seed, gain=2.0) for seed in range(12)])
    apart = distances(first, other)
    assert set(apart) == set(DISTANCES)
    assert apart["contrast"] == pytest.approx(np.log10(2), abs=0.02)
    assert apart["noise"] < 0.01
    assert apart["background colour"] < 0.05
    assert apart["channel correlation"] < 0.15, "noise weighs less in a stronger change"
    faint = profile("d", "digit", [recording(0, gain=0.05)])
    assert (len(faint.looks), faint.faint) == (0, 1)


def test_ratio_is_that_of_medians():
    assert ratio([4.0, 2.0, float("nan")], [1.0, 3.0, 2.0]) == 1.5
    assert np.isnan(ratio([1.0], []))


def test_sources_are_folders_or_what_is_given_where_these_are_many():
    few = [recording(i, source=f"s{i % 3}") for i in range(6)]
    assert {name: len(held) for name, held in by_source(few).items()} == {"s0": 2, "s1": 2, "s2": 2}
    many = [recording(i, source=f"s{i}") for i in range(9)]
    assert list(by_source(many)) == ["source not given"]


@pytest.mark.slow
def test_sides_are_compared(tmp_path):
    held = [recording(seed, source="ab"[seed % 2]) for seed in range(4)]
    how = CompareOptions(scenes=1, trials=0, indenters=("small_sphere",), newton=(4.0, 6.0))
    (side,) = compare_reality(Listed(*held), how, progress=False).values()
    assert [source.name for source in side.real] == ["a", "b"]
    assert set(side.apart) == {"a", "b"}
    assert set(side.among) == {("a", "b")}
    assert side.ratio("contrast") == pytest.approx(
        np.median([side.apart[name]["contrast"] for name in "ab"])
        / side.among["a", "b"]["contrast"]
    )


@pytest.mark.parametrize(
    ("held", "how", "said"),
    [
        ([], {}, r"none of the data's sensors \(none\), only gelsight, .*; give recordings of one"),
        ([recording(0, sensor="paxini")], {}, r"none of the data's sensors \(paxini\)"),
        (
            [recording(0)],
            {"sensors": ("gelsight",)},
            r"sensors=gelsight: the data has no recording of this sensor, only of digit; leave it",
        ),
        ([recording(0, gain=0.0)], {}, r"digit: not one of 1 recordings shows a touch"),
    ],
)
def test_what_cannot_be_compared_is_told(held, how, said):
    with pytest.raises((ConfigError, DataError), match=said):
        compare_reality(Listed(*held), CompareOptions(**how), progress=False)


def test_options_that_are_none_are_told():
    with pytest.raises(ConfigError, match="did you mean 'digit'"):
        CompareOptions(sensors=("digitt",))
    with pytest.raises(ConfigError, match="recordings=0, scenes=30, trials=3: give 1 or more"):
        CompareOptions(recordings=0)


@pytest.mark.slow
def test_the_page_is_written(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "page.html"
    assert main([*SIM, *FEW, f"out={out}"]) == 0
    page, said = out.read_text(), capsys.readouterr().out
    assert "Simulated touch beside sim" in page
    assert page.count('alt="sim/') >= 9, "three pictures of two simulated and of real touches"
    assert "What codec, camera and objects confound" in page
    assert "digit: 2 simulated touches" in said
    assert f"page: {out}" in said


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["out=x"], "give data=NAME"),
        ([*SIM, "sensors=[gelsihgt]"], "did you mean 'gelsight'"),
        ([*SIM, "scenes=0"], "give 1 or more"),
        ([*SIM, "scens=1"], "scens"),
    ],
)
def test_mistakes_are_named(words, said, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main([*words]) == 1
    assert said in capsys.readouterr().err


def test_help_lists_the_keys(capsys):
    assert main(["--help"]) == 0
    assert "trials: 3" in capsys.readouterr().out
