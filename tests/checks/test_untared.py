"""Forces with an offset, told by pictures without contact."""

from dataclasses import replace

import numpy as np
import pytest

from tactileforge.checks.log_doubts import log_doubts
from tactileforge.checks.pixels import check_pixels
from tactileforge.checks.sample import sample_of
from tactileforge.checks.untared import untared
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


def test_training_says_it(caplog: pytest.LogCaptureFixture) -> None:
    log_doubts(object(), [press((0, 0, 2)), press((0, 0, 3))], [press()], 0.04, 4)
    (line,) = [line for line in caplog.messages if "untared" in line]
    assert line.startswith("data: TF205 untared force in 2 of 3 recordings (a/0: (0, 0, 3) N where")
