"""Forces with an offset, told by pictures without contact."""

from dataclasses import replace

import numpy as np
import pytest

from tactileforge.checks.log_doubts import log_doubts
from tactileforge.checks.made import made_touch
from tactileforge.checks.pixels import check_pixels
from tactileforge.checks.sample import sample_of
from tactileforge.checks.untared import drifted, untared
from tactileforge.contracts import FrameSubset, Recording
from tactileforge.data.frames.lazy import ArrayFrames

COUNT = 30


def press(offset: tuple[float, float, float] = (0, 0, 0), held: bool = False) -> Recording:
    """Three frames without contact, then a press of 8 N on a noisy picture."""
    rng = np.random.default_rng(0)
    depth = np.clip(np.sin(np.linspace(-0.4, 3, COUNT)), 0, None)
    depth[:3] = 0
    depth = np.full(COUNT, 0.5) if held else depth
    frames = rng.normal(110, 1.2, (COUNT, 48, 64, 3))
    frames[:, 16:30, 20:40] += 60 * depth[:, None, None, None]
    frames = ArrayFrames(frames.clip(0, 255).astype(np.uint8))
    force = np.zeros((COUNT, 3), np.float32)
    force[:, 2] = 8 * depth
    rest = FrameSubset(frames, [0, 1, 2])
    times = np.arange(COUNT) / 30
    given = {"key": "a/0", "sensor": "digit", "frames": frames, "times": times}
    return Recording(**given, no_contact=rest, force=force + np.float32(offset))


@pytest.mark.parametrize("offset", [(0, 0, 2), (0, 0, -2), (1.5, 0, 0), (0, -1.5, 0), (1, 1, 1)])
def test_an_offset_is_told(offset: tuple[float, float, float]) -> None:
    found = untared(press(offset))
    assert found is not None
    values = ", ".join(f"{axis:.2g}" for axis in offset)
    assert found.words == f"({values}) N where nothing touches"
    touch = press(offset)
    assert found in list(check_pixels(touch, sample_of(touch))), "and so says inspect"


def test_what_is_tared_is_not_told() -> None:
    assert untared(press()) is None
    assert untared(press((0, 0, 0.5))) is None, "faint touches do not show in pictures"
    away = press((0, 0, 2))
    assert untared(replace(away, no_contact=None)) is None, "nothing tells"
    film = replace(away, no_contact=FrameSubset(away.frames, [0, 10, 20, 29]))
    assert untared(film) is None, "a median over the film may be of a touch"
    apart = press(held=True)
    assert untared(replace(apart, no_contact=press().no_contact)) is None, "it touches all along"
    late = press()
    assert late.force is not None
    late.force[:8] = np.nan
    assert untared(late) is None


def twice(added: np.ndarray, depth: np.ndarray | None = None) -> Recording:
    """Rest, a touch and rest, or none; with an added force."""
    one = made_touch(depth=depth)
    assert one.force is not None
    return replace(one, force=(one.force + added).astype(np.float32))


RISE = np.linspace(0, 1.5, 90)[:, None]


@pytest.mark.parametrize(
    ("added", "words"),
    [
        (RISE * (0, 0, 1), "z is "),
        (RISE * (0, 0, -1), "z is "),
        (RISE * (-1, 0, 0.1), "x is "),
        (np.where(np.arange(90) > 45, 1.2, 0)[:, None] * (0, 1, 0), "y is "),
    ],
)
@pytest.mark.parametrize("depth", [None, np.zeros(90)])
def test_a_zero_that_drifts_is_told(
    added: np.ndarray, words: str, depth: np.ndarray | None
) -> None:
    touch = twice(added, depth)
    found = drifted(touch, sample_of(touch))
    assert found is not None
    assert found.words.startswith(words)
    axis = "xyz".index(words[0])
    first, last = (float(word.split(" N")[0].split()[-1]) for word in found.words.split("rest")[:2])
    assert abs(first - added[:20, axis].mean()) < 0.3
    assert abs(last - added[-20:, axis].mean()) < 0.3


def test_a_zero_that_stays_is_not_told() -> None:
    for added in (np.zeros((90, 3)), np.full((90, 3), 2.0), RISE * 0.1):
        assert drifted(twice(added), sample_of(twice(added))) is None
    deep = np.linspace(0, 1, 90)  # pressed deeper and deeper, and no rest at the end
    touch = twice(np.zeros(3), deep)
    assert drifted(touch, sample_of(touch)) is None
    away = twice(RISE * 1000)
    assert drifted(away, sample_of(away)) is None, "of another unit"
    late = twice(RISE)
    assert late.force is not None
    late.force[50:] = np.nan
    assert drifted(late, sample_of(late)) is None, "no force at rest is there late"


def test_training_says_it(caplog: pytest.LogCaptureFixture) -> None:
    log_doubts(object(), [press((0, 0, 2)), press((0, 0, 3))], [press()], 0.04, 4)
    (line,) = [line for line in caplog.messages if "untared" in line]
    assert line.startswith("data: TF205 untared force in 2 of 3 recordings (a/0: (0, 0, 3) N where")
