"""Red and blue the other way round than in the background are said, once, at every door."""

import warnings
from functools import cache

import numpy as np
import pytest
from tactileforge_depth.reader import DepthReader

import tactileforge
from tactileforge.cli._compose import option
from tactileforge.plugins.registry import build
from tactileforge.sensors.streaming.touch_stream import TouchStream
from tactileforge.sensors.swapped_colours import are_swapped

Y, X = np.mgrid[:240, :320]
NOISE = np.random.default_rng(0).normal(0, 1.5, (5, 240, 320, 3))
REST = np.stack([120 + Y / 12, 105 - abs(X - 160) / 16, 80 - Y / 12], -1)
BALL = np.hypot(X - 160, Y - 120)[..., None] < 70
SLOPES = np.stack([X - 160, Y - 120, 160 - X], -1) / 70
STILL, *CLIP = np.clip(REST + NOISE + 40 * SLOPES * BALL * [[[[i > 0]]] for i in range(5)], 0, 255)
STILL, CLIP = STILL.astype(np.uint8), np.array(CLIP).astype(np.uint8)
BGR = np.ascontiguousarray(CLIP[..., ::-1])
SAID = r"have the colours of their background with red and blue swapped.*\[\.\.\., ::-1\]"


@cache
def tiny():
    return tactileforge.load("anytouch2.tiny")


def swapped_said(call):
    """Warnings of swapped colours by a call."""
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        call()
    return [str(one.message) for one in said if "red and blue" in str(one.message)]


def test_frames_are_told_and_their_background_may_be_the_one_that_is_swapped():
    assert not are_swapped(CLIP, STILL).any()
    assert are_swapped(BGR, STILL).all()
    assert are_swapped(CLIP, STILL[..., ::-1]).all()
    assert not are_swapped(BGR, STILL[..., ::-1]).any(), "both alike cannot be told"


def test_batches_have_a_background_each():
    pictures, stills = np.stack([CLIP[0], BGR[0], CLIP[0]]), np.stack([STILL, STILL, STILL])
    stills[2] = STILL[..., ::-1]
    assert are_swapped(pictures, stills).tolist() == [False, True, True]


@pytest.mark.parametrize(
    "light", [lambda x: x + 30, lambda x: x * 1.2, lambda x: x * [0.9, 1, 1.1]]
)
def test_other_light_is_not_another_order(light):
    assert not are_swapped(np.clip(light(CLIP), 0, 255).astype(np.uint8), STILL).any()


def test_grey_and_pale_gels_have_no_order():
    grey = np.repeat(CLIP[..., :1], 3, -1)
    pale = (grey + np.array([4, 2, 0])).clip(0, 255).astype(np.uint8)
    assert not are_swapped(pale[1:, ..., ::-1], pale[0]).any()


@pytest.mark.slow
@pytest.mark.parametrize("door", ["encode", "features", "force", "surface"])
def test_a_model_says_it_once_a_call(door):
    read = getattr(tiny(), door)

    def told(*given):
        said = swapped_said(lambda: read(*given, "gelsight_mini"))
        return [one for one in said if not one.startswith("TF306")]  # of the drawn background

    assert told(CLIP, STILL) == []
    assert told(BGR, "first") == []
    assert len(told(BGR, STILL)) == 1
    (said,) = told(np.stack([CLIP, BGR, BGR]), STILL)
    assert said.startswith("clips: 2 of 3 have the colours of their background with red and blue")


def test_depth_says_it():
    reader = DepthReader("gelsight_mini")
    assert swapped_said(lambda: reader.read(CLIP, STILL)) == []
    with pytest.warns(UserWarning, match=SAID):
        reader.read(BGR[0], STILL)


@pytest.mark.parametrize("has_model", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_a_stream_says_it_once(has_model):
    stream = TouchStream(tiny() if has_model else None, "gelsight_mini", background=STILL)

    def run():
        for number in range(12):
            stream.push(BGR[number % 4], number / 15)

    (said,) = swapped_said(run)
    assert said.startswith("gelsight_mini: 1 of 1 have the colours of their background")


@pytest.mark.realdata
@pytest.mark.slow
def test_public_recordings_are_told_only_where_they_are_swapped(realdata):
    """Some frames of every fourth recording with a background: as they are, and swapped."""
    false, told, looked = [], 0, 0
    for preset in ("public_samples", "gsmini_slip"):
        data = build("datasets", option("data", [f"data={preset}", f"data.root={realdata}"]))
        for number, recording in enumerate(data.recordings("train")):
            if number % 4 or (background := recording.background()) is None:
                continue
            rows = np.unique(np.linspace(0, len(recording.frames) - 1, 6).astype(int)).tolist()
            frames = recording.frames.read(rows)
            looked += len(frames)
            told += np.count_nonzero(are_swapped(frames[..., ::-1], background))
            false += [recording.key] * np.count_nonzero(are_swapped(frames, background))
    assert looked > 300
    assert false == []
    assert told > 0.98 * looked
