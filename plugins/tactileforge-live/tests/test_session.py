"""Live readings: newest frame wins, contact, slip, and failures."""

import io
import json
import math
import re
import threading

import cv2
import numpy as np
import pytest
from tactileforge_live.publish import JsonLines
from tactileforge_live.sensor_stream import SensorStream, StreamOptions
from tactileforge_live.server import page_state
from tactileforge_live.session import LiveOptions, LiveSession, ShowBackground, run_session
from tactileforge_live.status_line import stream_status

from tactileforge.contracts import Frame
from tactileforge.data.frames.cut import clip_rows
from tactileforge.encoders.tactile_vit import TactileViT
from tactileforge.errors import ConfigError, SensorError
from tactileforge.heads.force import ForceHead
from tactileforge.hub.files import make_header
from tactileforge.hub.model import Model
from tactileforge.sensors.streaming.buffer import ClipBuffer
from tactileforge.sensors.streaming.contact import (
    BackgroundChange,
    ContactDetector,
    ContactOptions,
    SlipEstimator,
    SlipOptions,
)

NO_BACKGROUND = ShowBackground(seconds=0.0)


@pytest.fixture(scope="module")
def model():
    node = {"name": "tactile_vit", "size": "tiny", "frames": 4, "image_size": 32, "depth": 1}
    encoder = TactileViT("tiny", frames=4, image_size=32, depth=1)
    head = ForceHead(encoder)
    entry = {"node": {"name": "force"}, "scale": {"digit": [1.0, 2.0, 3.0]}}
    header = make_header(
        encoder, node, licence="MIT", spacing=1 / 25, recipe={"x": 1}, heads={"force": entry}
    )
    return Model(encoder, header, heads={"force": head})


def options(**given):
    return LiveOptions(**({"background": NO_BACKGROUND, "seconds": 20.0} | given))


def messages_of(view, stop=None):
    lines = io.StringIO()
    notes = []
    with view:
        run_session(view, [JsonLines(lines)], stop, notes.append)
    return [json.loads(line) for line in lines.getvalue().splitlines()], notes


# clips


def test_rows_are_those_of_training():
    assert clip_rows(np.arange(10) / 60, 4, 1 / 15) is None  # a clip spans 12 periods
    assert clip_rows(np.arange(20) / 60, 4, 1 / 15) == [7, 11, 15, 19]
    assert clip_rows(np.arange(5) / 10, 2, 0.0667) == [3, 4]
    assert clip_rows(np.array([1.0]), 1, 0.0) == [0]


def test_a_lost_frame_is_replaced_and_a_gap_makes_no_clip():
    times = np.delete(np.arange(12) / 30, 9)
    assert clip_rows(times, 4, 1 / 15) in ([5, 7, 8, 10], [5, 7, 9, 10])
    assert clip_rows(np.array([0.0, 0.1, 0.2, 5.0, 5.1]), 4, 0.1) is None


def test_the_buffer_stays_small_and_gives_the_newest():
    buffer = ClipBuffer(4, 1 / 15, lambda picture: picture[:1])
    for number in range(1000):
        picture = np.full((2, 2, 3), number % 256, np.uint8)
        buffer.push(Frame(array=picture, time=number / 30))
    assert len(buffer._items) < 40
    shot = buffer.newest()
    assert shot.number == 1000
    assert shot.clip[:, 0, 0, 0].tolist() == [(999 - k) % 256 for k in (6, 4, 2, 0)]
    assert shot.clip.shape == (4, 1, 2, 3)


# contact and slip


def test_the_difference_is_that_of_a_square_and_not_of_noise():
    rng = np.random.default_rng(0)
    still = rng.integers(90, 110, (120, 160, 3)).astype(np.uint8)
    noisy = rng.integers(90, 110, (120, 160, 3)).astype(np.uint8)
    difference = BackgroundChange(still)
    assert difference(still) == 0
    assert difference(noisy) < 4
    pressed = still.copy()
    pressed[40:72, 40:72, 1] += 30
    assert difference(pressed) == pytest.approx(30, abs=0.01)


def test_the_difference_of_an_array_is_that_of_a_taxel():
    still = np.full((12, 32, 3), 128, np.uint8)
    pressed = still.copy()
    pressed[5, 7] = 255
    assert BackgroundChange(still)(pressed) < 8
    assert BackgroundChange(still, camera=False)(pressed) == 127


def test_contact_has_two_thresholds():
    contact = ContactDetector(ContactOptions(begin=8.0, end=5.0))
    assert [contact.update(x) for x in (4, 7, 8, 6, 5, 4.9, 6)] == [
        False, False, True, True, True, False, False,
    ]  # fmt: skip
    with pytest.raises(ConfigError, match="give 0 < end <= begin"):
        ContactOptions(begin=3.0, end=4.0)


def test_slip_begins_at_the_friction_cone():
    slip = SlipEstimator(SlipOptions(friction=0.5, least=0.3))
    messages = [slip.update(0.2 * i, np.array([0.6 * r, 0.8 * r, 1.0]), True)
             for i, r in enumerate((0.3, 0.45, 0.5, 0.45, 0.41, 0.39))]  # fmt: skip
    assert messages == [False, False, True, True, True, False]
    assert not slip.update(2.0, np.array([9.0, 0.0, 0.2]), True)
    assert not slip.update(2.1, np.array([9.0, 0.0, 9.0]), False)


def test_shear_that_lets_go_is_slip_only_where_the_normal_force_stays():
    pressed, gone = np.array([0.4, 0.0, 1.0]), np.array([0.2, 0.0, 1.0])
    slip = SlipEstimator(SlipOptions())
    assert [slip.update(0.0, pressed, True), slip.update(0.05, gone, True)] == [False, True]
    assert not slip.update(0.5, gone, True)
    lifted = SlipEstimator(SlipOptions())
    lifted.update(0.0, pressed, True)
    assert not lifted.update(0.05, gone / 2, True)


# the whole


def test_frames_become_forces(scripted, model):
    sensor = scripted(fps=50.0, limit=60)
    messages, _ = messages_of(
        LiveSession({"left": sensor}, model, options(frames=5, embedding=True))
    )
    assert len(messages) == 5
    for message in messages:
        assert message["sensor"] == "left"
        assert len(message["embedding"]) == model.vector_size
        assert message["contact"] is False
        assert message["slip"] is False
        assert math.isfinite(sum(message["force"]))
        assert message["force_unit"] == "relative"
        assert 0 < message["latency_ms"] < 10_000
    times = [message["time"] for message in messages]
    assert times == sorted(set(times))


def touch(number):
    """A square going from left to right."""
    frame = np.full((32, 24, 3), 120, np.uint8)
    frame[10:18, number % 16 : number % 16 + 8] = 180
    return frame


@pytest.mark.filterwarnings("ignore:force. an estimate")
@pytest.mark.parametrize(
    ("unit", "given", "words"),
    [("relative", None, "of its scale"), ("uncalibrated", "uncalibrated", r"N \(uncalibrated\)")],
)
def test_the_force_is_the_models_own(scripted, model, unit, given, words):
    """And the status line, the page and messages do not call shares newtons."""
    sensor = scripted(fps=50.0)
    sensor.picture = touch
    view = LiveSession({"left": sensor}, model, options(frames=1, force_unit=given))
    with view:
        view.take_background()
        finger = view.fingers["left"]
        shots = []
        newest = finger.stream.buffer.newest
        finger.stream.buffer.newest = lambda: shots.append(newest()) or shots[-1]
        reading = next(r for r in view.readings() if r is not None)
        page = page_state(view, {})["sensors"]["left"]
    still = finger.stream.prepare(finger.stream.background)
    expected = model.force(shots[-1].clip, still, "digit", unit=given)[-1]
    assert reading.force == pytest.approx(expected.tolist(), abs=1e-6)
    assert (reading.force_unit, reading.message()["force_unit"], page["unit"]) == (unit,) * 3
    assert re.search(rf"force( [+-]\d\.\d\d){{3}} {words} ", stream_status(finger))
    assert expected.isfinite().all()
    assert shots[-1].clip.shape == (4, 32, 32, 3)


def test_a_slow_model_reads_the_newest_frame_and_skips_the_others(scripted, model):
    sensor = scripted(fps=50.0)
    wake = threading.Condition()
    finger = SensorStream("left", sensor, model, wake, StreamOptions())
    for number in range(10):
        finger.sink(Frame(array=sensor.picture(number), time=number / 50))
    finger.take_background(NO_BACKGROUND, None)
    assert finger.stream.is_fresh
    assert finger.read().number == 10
    assert finger.read() is None
    for number in range(10, 500):
        finger.sink(Frame(array=sensor.picture(number), time=number / 50))
    reading = finger.read()
    assert (reading.number, reading.time) == (500, pytest.approx(499 / 50))
    assert (finger.stream.done, finger.stream.skipped) == (2, 489)
    assert not finger.stream.is_fresh


@pytest.mark.slow
def test_contact_without_a_model(scripted):
    def press(frame):
        touched = frame.array.copy()
        touched[:, : touched.shape[1] // 2] = 200
        touched[:, : touched.shape[1] // 4] = 20  # all over, or brighter inwards alone, is light
        return Frame(array=touched, time=frame.time)

    sensor = scripted(fps=50.0, limit=80, events=dict.fromkeys(range(40, 80), press))
    messages, _ = messages_of(LiveSession({"left": sensor}, None, options()))
    contacts = [message["contact"] for message in messages]
    assert not contacts[0]
    assert contacts[-1]
    assert contacts == sorted(contacts)
    assert {message["force"] for message in messages} == {None}


# bad input


@pytest.mark.slow
def test_black_frames_are_no_reading_of_force(scripted, model):
    def black(frame):
        return Frame(array=np.zeros_like(frame.array), time=frame.time)

    sensor = scripted(fps=50.0, limit=120, events=dict.fromkeys(range(30, 60), black))
    messages, notes = messages_of(LiveSession({"left": sensor}, model, options()))
    dark = [message for message in messages if message.get("trouble") == "black"]
    assert dark
    assert all(m["force"] is m["contact"] is m["slip"] is None for m in dark)
    events = [message["event"] for message in messages if "event" in message]
    assert events == ["black", "good"]
    assert "left: TF602 pictures are black: is its light on, is exposure= too low?" in notes
    assert [m["code"] for m in messages if m.get("event") == "black"] == ["TF602"]


@pytest.mark.slow
def test_pictures_that_turn_are_said_once_with_the_code(scripted):
    slope = np.linspace(40, 200, 24)[None, :, None] * np.array([1.0, 0.5, 0.1]) + 20

    def picture(number):
        noise = np.random.default_rng(number).normal(0, 1, (32, 24, 3))
        shown = (slope + noise).clip(0, 255).astype(np.uint8)
        return np.ascontiguousarray(shown[:, ::-1]) if number >= 60 else shown

    sensor = scripted(fps=50.0, limit=100)
    sensor.picture = picture
    messages, notes = messages_of(LiveSession({"left": sensor}, None, options()))
    assert sum(note.startswith("left: TF603 its pictures are turned") for note in notes) == 1
    assert [m["event"] for m in messages if m.get("code") == "TF603"] == ["turned"]


@pytest.mark.slow
def test_an_unplugged_sensor_comes_back_and_it_is_said(scripted, model):
    sensor = scripted(fps=50.0, limit=80, events={40: SensorError("gone")})
    messages, notes = messages_of(LiveSession({"left": sensor}, model, options()))
    assert [m["event"] for m in messages if "event" in m] == ["lost", "good"]
    assert notes == ["left: lost", "left: all is well again"]
    assert sensor.opened == 2


@pytest.mark.slow
def test_a_sensor_that_stays_away_is_an_error(scripted, model):
    sensor = scripted(fps=50.0, events={20: SensorError("gone")})
    view = LiveSession({"left": sensor}, model, options(reconnect=0.6))
    with view:
        sensor.refuse.extend([SensorError("absent")] * 100)
        with pytest.raises(SensorError, match=r"left: gone .it has not come back"):
            run_session(view, say=lambda line: None)


@pytest.mark.slow
def test_frozen_frames_are_said(scripted, model):
    def freeze(frame):
        return Frame(array=sensor.picture(20), time=frame.time)

    sensor = scripted(fps=50.0, limit=130, events=dict.fromkeys(range(20, 110), freeze))
    messages, _ = messages_of(LiveSession({"left": sensor}, model, options()))
    assert [m["event"] for m in messages if "event" in m] == ["frozen", "good"]


def test_a_sensor_that_the_model_does_not_know(scripted, model):
    with pytest.raises(ConfigError, match=r"unknown sensor of the model 'tactip'.*universal"):
        LiveSession({"left": scripted(type="tactip")}, model, options()).__enter__()
    chosen = options(unknown_sensor="universal", frames=1)
    (messages,), _ = messages_of(LiveSession({"left": scripted(type="tactip")}, model, chosen))
    assert messages["force"] is None


def test_two_sensors_with_one_id(scripted, model):
    pair = {name: scripted(address="/dev/video0") for name in ("left", "right")}
    with pytest.raises(SensorError, match="left and right are one device, /dev/video0"):
        LiveSession(pair, model, options()).__enter__()
    assert not any(sensor.is_open for sensor in pair.values())


def test_two_sensors_are_both_read(scripted, model):
    pair = {name: scripted(address=name) for name in ("left", "right")}
    messages, _ = messages_of(LiveSession(pair, model, options(frames=12)))
    assert {message["sensor"] for message in messages} == {"left", "right"}


def test_what_cannot_be_shown(scripted):
    with pytest.raises(ConfigError, match="no sensor: choose some"):
        LiveSession({})
    with pytest.raises(ConfigError, match=r"left \(wrench\) has no images to show"):
        LiveSession({"left": scripted(kind="wrench")})


def test_touch_while_the_background_is_taken(scripted):
    given = options(background=ShowBackground(seconds=0.5))
    view = LiveSession({"left": scripted(moves=True)}, None, given)
    with view, pytest.raises(SensorError, match="something touches it"):
        view.take_background()


def test_the_background_is_the_median_or_a_file(scripted, tmp_path):
    view = LiveSession({"left": scripted()}, None, options(background=ShowBackground(seconds=0.3)))
    with view:
        view.take_background()
        assert abs(view.fingers["left"].stream.background.astype(float) - 121).max() <= 1
    picture = np.arange(32 * 24 * 3, dtype=np.uint8).reshape(32, 24, 3)
    cv2.imwrite(str(tmp_path / "still.png"), cv2.cvtColor(picture, cv2.COLOR_RGB2BGR))
    still = options(background=ShowBackground(image=str(tmp_path / "still.png")))
    with LiveSession({"left": scripted()}, None, still) as view:
        view.take_background()
        assert np.array_equal(view.fingers["left"].stream.background, picture)
    cv2.imwrite(str(tmp_path / "small.png"), picture[:5])
    small = options(background=ShowBackground(image=str(tmp_path / "small.png")))
    view = LiveSession({"left": scripted()}, None, small)
    with view, pytest.raises(ConfigError, match=r"the background has \(5, 24\) pixels"):
        view.take_background()


@pytest.mark.slow
def test_it_ends_when_stopped(scripted, model):
    stop = threading.Event()
    threading.Timer(3.0, stop.set).start()
    messages, _ = messages_of(LiveSession({"left": scripted()}, model, options(seconds=None)), stop)
    assert messages


def test_numbers_that_are_none_are_null():
    lines = io.StringIO()
    JsonLines(lines).send({"sensor": "a", "force": [math.nan, 1.0], "difference": -math.inf})
    assert lines.getvalue() == '{"sensor": "a", "force": [null, 1.0], "difference": null}\n'


@pytest.mark.parametrize("error", [RuntimeError("no SDK"), ValueError("x"), KeyError("y")])
def test_a_driver_that_cannot_open_with_any_error_is_one_line(scripted, error):
    sensor = scripted()
    sensor.refuse.append(error)
    message = rf"^left: cannot be opened: {type(error).__name__}: "
    with pytest.raises(SensorError, match=message):
        LiveSession({"left": sensor}, None, options()).__enter__()


def test_odd_first_frames_are_no_part_of_the_background(scripted):
    """As those of a DIGIT, often green."""

    def green(frame):
        return Frame(array=frame.array * np.array([0, 1, 0], np.uint8), time=frame.time)

    sensor = scripted(fps=50.0, events=dict.fromkeys(range(4), green))
    view = LiveSession({"left": sensor}, None, options(background=ShowBackground(seconds=0.5)))
    with view:
        view.take_background()
        assert view.fingers["left"].stream.background.min() >= 120
