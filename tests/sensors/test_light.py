"""A change of light is not a touch, and a touch is no change of light."""

import warnings
from functools import cache

import cv2
import numpy as np
import pytest
import torch
from tactileforge_depth.reader import DepthReader

import tactileforge
from tactileforge.cli._compose import option
from tactileforge.plugins.registry import build
from tactileforge.sensors.borders import (
    BORDER_FEATURES,
    amid_other_light,
    border_inputs,
    border_range,
    has_other_light,
)
from tactileforge.sensors.light import LightCheck, changed_light
from tactileforge.sensors.streaming.touch_stream import TouchStream

SIZES = {
    "digit": (320, 240),
    "gelsight_mini": (240, 320),
    "gelsight": (480, 640),
    "wide": (270, 480),
}
LIGHTS = {
    "brighter": lambda rest, x, y: rest + 6,
    "much brighter": lambda rest, x, y: rest + 30,
    "darker": lambda rest, x, y: rest - 10,
    "exposure 1.08": lambda rest, x, y: rest * 1.08,
    "exposure .85": lambda rest, x, y: rest * 0.85,
    "red dims": lambda rest, x, y: rest * np.stack([1 - 0.25 * (1 - x), 1 + 0 * x, 1 + 0 * x], -1),
    "one side dims": lambda rest, x, y: rest * (1 - 0.3 * np.exp(-(x**2) / 0.2))[..., None],
    "daylight at an edge": lambda rest, x, y: rest + 30 * np.exp(-x / 0.2)[..., None],
    "daylight at a corner": lambda rest, x, y: rest + 40 * np.exp(-(x**2 + y**2) / 0.15)[..., None],
    "narrow leak": lambda rest, x, y: rest + 40 * np.exp(-x / 0.06)[..., None],
    "leak of a straight edge": lambda rest, x, y: rest + 20 * (y > 0.9)[..., None],
    "leak through a hole": lambda rest, x, y: (
        rest + 60 * np.exp(-((1 - x) ** 2 / 0.005 + (y - 0.4) ** 2 / 0.05))[..., None]
    ),
    "leak that saturates": lambda rest, x, y: rest + 200 * np.clip(1 - y / 0.15, 0, 1)[..., None],
    "bluish leak": lambda rest, x, y: (
        rest + np.array([12, 20, 25]) * np.exp(-(1 - y) / 0.1)[..., None]
    ),
    "white balance": lambda rest, x, y: rest * np.array([1.1, 1, 0.9]),
}


def grid(size):
    return np.meshgrid(*(np.linspace(0, 1, n) for n in size[::-1]))


def resting(size):
    """A gel lit from three sides, darker at its rim."""
    x, y = grid(size)
    rim = 1 - 0.25 * ((x - 0.5) ** 2 + (y - 0.5) ** 2)
    return np.stack([90 + 20 * y, 105 - 24 * abs(x - 0.5), 110 - 20 * y], -1) * rim[..., None]


def shown(picture, seed=0):
    """As a camera sees it: noise of 1.5 grey levels, uint8."""
    noise = np.random.default_rng(seed).normal(0, 1.5, picture.shape)
    return np.clip(picture + noise, 0, 255).astype(np.uint8)


def pressed(size, radius=0.2, depth=30.0):
    """A ball on the gel: each colour brighter on one side of it and darker on the other."""
    x, y = grid(size)
    far = np.hypot((x - 0.5) * size[1] / min(size), (y - 0.5) * size[0] / min(size))
    inside = far < radius
    slopes = np.stack([x - 0.5, y - 0.5, 0.5 - x], -1) / radius
    return resting(size) + depth * slopes * inside[..., None]


@pytest.mark.parametrize("size", SIZES.values(), ids=SIZES)
@pytest.mark.parametrize("kind", LIGHTS)
def test_light_is_told(kind, size):
    rest = resting(size)
    assert LightCheck(shown(rest))(shown(LIGHTS[kind](rest, *grid(size)), 1))


@pytest.mark.parametrize("size", SIZES.values(), ids=SIZES)
@pytest.mark.parametrize("depth", [10.0, 30.0, 80.0])
def test_a_touch_is_not_light(depth, size):
    check = LightCheck(shown(resting(size)))
    assert not check(shown(resting(size), 1)), "at rest"
    assert not check(shown(pressed(size, depth=depth), 1))
    assert not check(shown(pressed(size, depth=depth) * 1.03, 1)), "in slightly other light"


@pytest.mark.parametrize("size", SIZES.values(), ids=SIZES)
@pytest.mark.parametrize("sigma", [0.08, 0.15, 0.22])
@pytest.mark.parametrize("colours", [(40, 8, -40), (30, 25, 20), (-20, -30, -25)])
def test_a_broad_smooth_imprint_is_not_light(colours, sigma, size):
    """It has no edges, but leaves the borders as they were; sigma in shares of the shorter side."""
    x, y = grid(size)
    far = np.hypot((x - 0.5) * size[1] / min(size), (y - 0.5) * size[0] / min(size))
    touched = resting(size) + np.array(colours) * np.exp(-((far / sigma) ** 2) / 2)[..., None]
    assert not LightCheck(shown(resting(size)))(shown(touched, 1))


@pytest.mark.parametrize("size", SIZES.values(), ids=SIZES)
@pytest.mark.parametrize("window", ["round", "frame"])
@pytest.mark.parametrize("gain", [1.3, 0.8])
def test_light_is_told_behind_a_window(gain, window, size):
    x, y = grid(size)
    away = {"round": np.hypot, "frame": np.maximum}[window]
    far = away(abs(x - 0.5), abs(y - 0.5))
    rest = resting(size) * (far < 0.4)[..., None]
    assert LightCheck(shown(rest))(shown(gain * rest, 1))


@pytest.mark.parametrize("size", SIZES.values(), ids=SIZES)
@pytest.mark.parametrize("quarter", range(4))
def test_a_touch_at_the_border_is_no_leak(quarter, size):
    """A long bar on the border: a slope bright in one colour, and dark in another."""
    x, y = grid(size)
    inwards = (x, y, 1 - x, 1 - y)[quarter]
    slope = np.exp(-(((inwards - 0.1) / 0.04) ** 2))
    for colours in ((30, -10, -30), (30, 2, -12), (-25, -25, -25)):
        touched = resting(size) + np.array(colours) * slope[..., None]
        assert not LightCheck(shown(resting(size)))(shown(touched, 1)), colours
    for place in (0.25, 0.5):
        bar = resting(size) + 25 * np.exp(-(((inwards - place) / 0.05) ** 2))[..., None]
        assert not LightCheck(shown(resting(size)))(shown(bar, 1)), "bright, from border to border"


ALL_OVER = {
    "brighter": lambda picture: picture + 8,
    "darker": lambda picture: picture - 8,
    "exposure 1.08": lambda picture: picture * 1.08,
    "exposure .9": lambda picture: picture * 0.9,
}


@pytest.mark.parametrize("size", SIZES.values(), ids=SIZES)
@pytest.mark.parametrize("change", ALL_OVER.values(), ids=ALL_OVER)
def test_light_that_changes_all_over_is_told_beside_a_touch(change, size):
    check = LightCheck(shown(resting(size)))
    for depth in (10.0, 30.0, 80.0):
        assert check(shown(change(pressed(size, depth=depth)), 1)), depth
    assert not check(shown(pressed(size, radius=0.45, depth=80.0), 1)), "a touch alone"


def test_one_colour_or_one_side_alone_may_be_a_touch():
    rest, check = resting((320, 240)), LightCheck(shown(resting((320, 240))))
    touched = pressed((320, 240))
    assert not check(shown(touched + np.array([20, 0, 0]), 1))
    assert not check(shown(touched + 10 * (np.indices((320, 240))[0] < 200)[..., None], 1))
    assert not check(shown(touched - 12 * (abs(touched - rest).sum(-1, keepdims=True) > 9), 1))


def test_a_slow_drift_is_told_before_it_is_read_as_force():
    rest, check = resting((320, 240)), LightCheck(shown(resting((320, 240))))
    found = [check(shown(rest + 0.1 * step, step)) for step in range(120)]
    assert not any(found[:30])
    assert all(found[70:])


def test_clips_are_looked_at_frame_by_frame():
    rest = resting((64, 64))
    frames = np.stack([shown(rest), shown(rest + 20), shown(pressed((64, 64)))])
    clips = torch.from_numpy(frames).permute(0, 3, 1, 2)[None]
    still = torch.from_numpy(shown(rest, 1)).permute(2, 0, 1)[None]
    assert changed_light(clips, still).tolist() == [[False, True, False]]
    assert not changed_light(clips[..., :8, :8], still[..., :8, :8]).any(), "too few pixels"


def corner(size, level):
    """A white lamp at the upper left corner, grey levels."""
    x, y = grid(size)
    return level * np.exp(-(x**2 + y**2) / 0.15)[..., None]


@pytest.mark.parametrize("size", SIZES.values(), ids=SIZES)
def test_a_lamp_beside_a_press_is_none_of_the_presses(size):
    rest = shown(resting(size), 9)
    presses = [
        shown(pressed(size, depth=depth), seed) for seed, depth in enumerate((0, 20, 40, 80))
    ]
    known = border_range(border_inputs(np.stack(presses), rest))
    assert np.abs(known).max() < 1  # noise
    frames = [
        pressed(size, depth=60),
        pressed(size, depth=60) + corner(size, 12),
        pressed(size, depth=60) + corner(size, -12),
        pressed(size, depth=60) + corner(size, 3),
        pressed(size, depth=60) + corner(size, 40) * np.array([1, 0, 0]),
    ]
    inputs = border_inputs(np.stack([shown(frame, 5) for frame in frames]), rest)
    assert has_other_light(inputs, known).tolist() == [False, True, True, False, True]
    assert not has_other_light(inputs, []).any(), "a calibration that does not know"
    known = border_range(border_inputs(np.stack([shown(frames[1])]), rest))
    assert has_other_light(inputs, known).tolist() == [False, False, True, False, True]


def test_changes_at_the_borders_have_these_values():
    rest = np.full((64, 96, 3), 100, np.uint8)
    frame = rest + np.array([8, 0, 0], np.uint8)
    frame[:12, :18] = np.random.default_rng(0).integers(0, 255, (12, 18, 3))  # a touch
    frame[-20:, -40:] -= 5
    inputs = border_inputs(np.stack([rest, frame]), rest)
    values = np.stack([inputs[name] for name in BORDER_FEATURES], -1).reshape(2, 8, 3)
    assert not values[0].any()
    assert values[1, 0].tolist() == [0, 0, 0], "the touched corner tells nothing"
    assert values[1, 1:7, 0].tolist() == pytest.approx([8] * 6, abs=0.5)
    assert values[1, 7].tolist() == pytest.approx([3, -5, -5], abs=0.1)
    assert not has_other_light(inputs, [[0.0] * 24, [0.0] * 24])[0]
    few = border_inputs(frame[None, :16, :16], rest[:16, :16])
    assert not any(value.any() for value in few.values()), "taxels, or too few pixels"
    least, most = border_range({name: value[1:] for name, value in inputs.items()})
    assert least[0] == most[0] == least[3] == 0.0, "no change is within the range"
    assert most[3] == pytest.approx(8, abs=0.5)


def test_brighter_here_and_darker_there_is_a_touch():
    inputs = {name: np.zeros(2) for name in BORDER_FEATURES}
    inputs["border0_red"][:] = 9
    inputs["border2_red"][1] = -9
    inputs["border5_blue"][:] = -9
    assert has_other_light(inputs, [[0.0] * 24] * 2).tolist() == [True, False]


def test_a_flicker_spoils_the_frames_among_it_and_a_lone_alarm_only_itself():
    times = np.arange(40) / 30
    lone = np.zeros(40, bool)
    lone[[4, 30]] = True
    assert amid_other_light(lone, times).tolist() == lone.tolist()
    flicker = np.zeros(40, bool)
    flicker[10:20:2] = True
    found = np.flatnonzero(amid_other_light(flicker, times))
    assert set(range(10, 17)) <= {*found.tolist()}
    assert found.min() >= 5, "at most a quarter of a second before"
    assert found.max() <= 25
    causal = np.flatnonzero(amid_other_light(flicker, times, ahead=False))
    assert [9 in causal, 13 in causal, 15 in causal] == [False, False, True]


@pytest.mark.parametrize(
    ("level", "parts", "told"), [(3.6, 1, True), (3.4, 4, False), (1.1, 5, True), (0.9, 8, False)]
)
def test_weaker_light_has_to_reach_more_parts(level, parts, told):
    for sign in (1, -1):
        inputs = dict.fromkeys(BORDER_FEATURES, np.full(1, 2.0))
        for part in range(parts):
            inputs[f"border{part}_green"] = np.full(1, 2 + sign * level)
        assert has_other_light(inputs, [[2.0] * 24] * 2).tolist() == [told]


@cache
def tiny():
    return tactileforge.load("anytouch2.tiny")


def clip_of(picture):
    return np.stack([shown(picture, seed) for seed in range(4)])


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:surface. an estimate")
@pytest.mark.parametrize("sensor", ["digit", "gelsight_mini"])
@pytest.mark.parametrize("kind", LIGHTS)
def test_light_is_no_force(kind, sensor):
    rest = resting(SIZES[sensor])
    still, clip = shown(rest, 9), clip_of(LIGHTS[kind](rest, *grid(SIZES[sensor])))
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        force = tiny().force(clip, still, sensor)
    assert any("3 of 3 frames have none (NaN): the light" in str(one.message) for one in said)
    assert force.isnan().all()
    with pytest.warns(UserWarning, match=r"surface: 4 of 4 frames have none \(NaN\): the light"):
        assert tiny().surface(clip, still, sensor).isnan().all()
    with pytest.warns(UserWarning, match="in 4 of 4 frames the light has changed"):
        vector = tiny().encode(clip, still, sensor)
    assert vector.isfinite().all()


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:surface. an estimate")
def test_a_touch_in_a_batch_keeps_force_and_surface_to_the_bit():
    rest, size = resting(SIZES["digit"]), SIZES["digit"]
    still, touch, light = shown(rest, 9), clip_of(pressed(size)), clip_of(rest + 10)
    both = np.stack([touch, light])
    plain = tiny().readings(both, still, "digit", check=False).force
    checked = tiny().readings(both, still, "digit").force
    assert torch.equal(checked[0], plain[0])
    assert checked[1].isnan().all()
    with pytest.warns(UserWarning, match="surface: 4 of 8 frames"):
        surface = tiny().surface(both, still, "digit")
    assert surface[0].isfinite().all()
    assert surface[1].isnan().all()


@pytest.mark.slow
def test_all_that_reads_clips_says_that_the_light_has_changed():
    rest, size = resting(SIZES["digit"]), SIZES["digit"]
    still = shown(rest, 9)
    both = np.stack([clip_of(pressed(size)), clip_of(rest + 10)])
    asked = (both, still, "digit")
    with pytest.warns(UserWarning, match="clips: in 4 of 8 frames the light has changed") as said:
        tiny().features(*asked, tap="cls")
    assert said[0].filename == __file__
    with pytest.warns(UserWarning, match="clips: in 4 of 8 frames the light has changed") as said:
        tiny().groups(*asked, names=["difference"])
    assert said[0].filename == __file__
    for groups in (None, ["difference"]):
        with pytest.warns(UserWarning, match="clips: in 4 of 8 frames the light") as said:
            tiny().encode(*asked, groups=groups)
        assert said[0].filename == __file__
    with pytest.warns(UserWarning, match="head force: in 4 of 8 frames the light has") as said:
        tiny().read_head("force", *asked)
    assert said[0].filename == __file__
    with pytest.warns(UserWarning, match=r"force_inputs: 3 of 6 frames have none \(NaN\)"):
        inputs = tiny().force_inputs(*asked)
    assert {"x", "y", "z", "hidden0"} <= inputs.keys()
    for values in inputs.values():
        assert values[0].isfinite().all()
        assert values[1].isnan().all()
    with pytest.warns(UserWarning, match="of 4 frames the light has changed"):
        tiny().encode_video(both[1], still, "digit", times=np.arange(4) / 15)
    with warnings.catch_warnings():  # touch alone, or nothing to compare with
        warnings.simplefilter("error")
        tiny().encode(both[:1], still, "digit")
        tiny().read_head("force", both[:1], still, "digit")
        assert tiny().force_inputs(both[:1], still, "digit")["z"].isfinite().all()
        tiny().encode(both, "none", "digit")


@pytest.mark.slow
def test_a_force_beyond_the_scale_is_not_given():
    from tactileforge.hub.forces import within_scale

    scale = torch.tensor([[[5.0, 10.0, 14.0]]])
    read = {"x": torch.tensor([[1.0, 6.0]]), "y": torch.zeros(1, 2), "z": torch.tensor([[14.5, 3]])}
    force = within_scale(torch.ones(1, 2, 3), read, scale)
    assert force.isnan().all()
    read = {name: torch.zeros(1, 2) for name in "xyz"}
    assert within_scale(torch.ones(1, 2, 3), read, scale).eq(1).all()


@pytest.mark.slow
def test_a_stream_names_the_light_and_gives_no_force():
    rest = resting((320, 240))
    stream = TouchStream(tiny(), "digit", background=shown(rest, 9))
    readings = []
    for number in range(60):
        light = rest if number < 30 else rest + 12
        readings.append(stream.push(shown(light, number), number / 15))
    before, after = readings[10], readings[-1]
    assert (before.trouble, before.contact) == ("", False)
    assert abs(np.array(before.force)).max() < 0.5
    assert (after.trouble, after.contact, after.force, after.slip) == ("light", None, None, None)
    assert np.isfinite(after.embedding).all()


def test_contact_without_a_model_names_it_too():
    rest = resting((240, 320))
    stream = TouchStream(None, background=shown(rest, 9))
    assert stream.push(shown(rest, 1), 0.0).contact is False
    assert stream.push(shown(rest + 20, 2), 0.1).trouble == "light"
    assert stream.push(shown(pressed((240, 320)), 3), 0.2).contact is True


@pytest.mark.parametrize("sensor", ["digit", "gelsight_mini"])
def test_light_is_no_depth(sensor):
    rest = resting(SIZES[sensor])
    reader, still = DepthReader(sensor), shown(rest, 9)
    for more in (6, 12, -10):
        with pytest.warns(UserWarning, match="the light has changed since the background"):
            assert float(reader.read(shown(rest + more), still).depth.abs().max()) < 0.02
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert float(reader.read(shown(pressed(SIZES[sensor])), still).depth.max()) > 0.015


@pytest.mark.realdata
@pytest.mark.slow
def test_no_public_touch_is_taken_for_light(realdata):
    """Every recording with a background: some frames of each."""
    alarms, looked = [], 0
    for preset in ("public_samples", "gsmini_slip"):
        data = build("datasets", option("data", [f"data={preset}", f"data.root={realdata}"]))
        for number, recording in enumerate(data.recordings("train")):
            if number % 4 or (background := recording.background()) is None:
                continue
            check = LightCheck(background)
            rows = np.unique(np.linspace(0, len(recording.frames) - 1, 6).astype(int)).tolist()
            for frame in recording.frames.read(rows):
                looked += 1
                if check(frame):
                    alarms.append(recording.key)
    assert looked > 300
    assert alarms == []


@pytest.mark.realdata
@pytest.mark.slow
def test_light_beside_public_touches_is_told(realdata):
    """Of presses of ToucHD's DIGIT and GelSight Mini, nearly all."""
    data = build("datasets", option("data", ["data=public_samples", f"data.root={realdata}"]))
    told, count = dict.fromkeys(ALL_OVER, 0), 0
    for recording in data.recordings("train"):
        if not recording.key.startswith("touchd_force_") or recording.background() is None:
            continue
        rest = recording.background()
        frames = recording.frames.read([len(recording.frames) // 2])
        check, picture = LightCheck(rest), frames[0].astype(float)
        if check(frames[0]) or np.abs(picture - rest).max(-1).mean() < 2:
            continue
        count += 1
        for name, change in ALL_OVER.items():
            told[name] += check(shown(change(picture), 1))
    assert count >= 6
    assert min(told.values()) >= 0.8 * count, (told, count)


@pytest.mark.realdata
@pytest.mark.parametrize("name", ["digit_D00011", "digit_D00024", "digit_tvl", "gelslim3_ref"])
@pytest.mark.parametrize("kind", LIGHTS)
def test_light_on_real_backgrounds(realdata, name, kind):
    (path,) = (realdata / "sensor_backgrounds").glob(f"{name}.*")
    rest = cv2.cvtColor(cv2.imread(str(path)), cv2.COLOR_BGR2RGB).astype(float)
    if name.startswith("gelslim") and kind in ("darker", "exposure .85", "daylight at an edge"):
        pytest.skip("its black surround cannot get darker, so that the rim of the gel is an edge")
    assert LightCheck(shown(rest))(shown(LIGHTS[kind](rest, *grid(rest.shape[:2])), 1))
