"""Recordings end to end: shards hold the frames of the sensors, through all failures."""

import io
import itertools
import json
import os
import re
import signal
import struct
import subprocess
import sys
import threading
import time
from dataclasses import replace
from functools import partial
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

import cv2
import numpy as np
import pytest
from tactileforge_arrays import SerialArray
from tactileforge_live.record import rig, store
from tactileforge_live.record.options import RecordOptions
from tactileforge_live.record.raw import read_raw
from tactileforge_live.record.record import record
from tactileforge_live.record.status import RecordStatus
from tactileforge_sim.sensors.sim import SimSensor
from tactileforge_sim.sensors.sim_wrench import SimWrench
from waiting import wait_until

from tactileforge.data.shards import shards
from tactileforge.datasets.shards import Shards
from tactileforge.errors import ConfigError, SensorError, TactileForgeError
from tactileforge.sensors import opening
from tactileforge.sensors.background import Background
from tactileforge.sensors.calibration import file as calibration
from tactileforge.sensors.capture import Capture
from tactileforge.sensors.status import of_drops
from tactileforge.testing.emulators import PtyDevice
from tactileforge.util.strict import build

SCRIPT = Path(__file__).parent / "recordable.py"


def quiet(line):
    pass


def only(options, split="train"):
    return {one.labels["device"]: one for one in Shards(options.out).recordings(split)}


def number_of(sensor, picture):
    """Frame number of an image of a scripted sensor."""
    return next(n for n in range(sensor.count) if np.array_equal(sensor.picture(n), picture))


def test_two_sensors_forces_and_a_camera_on_one_clock(scripted, options):
    left, right = scripted(fps=60), scripted(fps=25, type="gelsight_mini")
    camera, force = scripted(fps=20, type="camera"), SimWrench(fps=200, period=0.5, rest=0)
    given = options(object="ball", text="{action} a ball", action="press", labels={"who": "ana"})
    found = record(given, {"left": left, "right": right}, force, camera, say=quiet)
    taken = only(given)
    assert (found.takes, set(found.dropped.values())) == (1, {0})
    zeros = []
    for name, sensor in (("left", left), ("right", right)):
        one = taken[name]
        count = len(one.frames)
        assert count == pytest.approx(0.6 * sensor.spec.fps, abs=2)
        first = number_of(sensor, one.frames.read([0])[0])
        true = np.array(sensor.times[first : first + count])
        assert one.times - one.times[0] == pytest.approx(true - true[0], abs=1e-6)
        assert one.labels["clock"] == pytest.approx(true[0] - one.times[0], abs=1e-6)
        zeros.append(one.labels["clock"])
        for i in (1, count // 2, count - 1):
            assert number_of(sensor, one.frames.read([i])[0]) == first + i
        assert found.frames[name] == count
        assert (one.sensor, one.object, one.text) == (sensor.spec.name, "ball", "{action} a ball")
        assert one.action.tolist() == [0] * count
        assert (one.tier, one.labels["who"]) == (1, "ana")
        assert len(one.image) == len(one.image_times) == pytest.approx(12, abs=2)
        known = np.isfinite(one.force).all(1)
        assert known[1:-1].all()  # also where one segment ends and the next begins
    assert zeros[0] == zeros[1]
    times, wrenches = read_raw(Path(given.out) / "train-000000.tar")["force"]
    assert np.diff(times) == pytest.approx(1 / 200, abs=1e-9)
    assert wrenches.shape == (len(times), 6)
    for one in taken.values():
        # the sample after the last one kept may have told the force of the last frame
        inside = np.isfinite(one.force[:, 2]) & (one.times <= times[-1])
        want = np.interp(one.times[inside], times, wrenches[:, 2])
        assert one.force[inside, 2] == pytest.approx(want, abs=1e-5)
        assert one.tracks["wrench"][inside, 0] == pytest.approx(one.force[inside, 0])


@pytest.mark.slow
def test_forces_of_a_slow_sensor_are_kept(scripted, options):
    given = options(seconds=1.5)
    record(given, {"a": scripted(fps=30)}, scripted(fps=5, kind="wrench"), say=quiet)
    assert np.isfinite(only(given)["a"].force).all(1).mean() > 0.5


def test_sensors_share_one_zero_of_time(scripted, options):
    """Two sensors see one clock: pictures of it agree with the times of both."""
    sensors = {"a": scripted(fps=50), "b": scripted(fps=30)}
    for sensor in sensors.values():
        sensor.kind = sensor.spec = replace(sensor.spec, kind="array")
        sensor.raw = lambda number, due: np.array([[due % 1000.0]], np.float32)
    given = options()
    record(given, sensors, say=quiet)
    raw = read_raw(Path(given.out) / "train-000000.tar")
    zero = {name: values[:, 0, 0] - times for name, (times, values) in raw.items()}
    assert np.ptp(np.concatenate(list(zero.values()))) < 1e-3  # float32 of up to a thousand seconds
    for name, one in only(given).items():
        assert one.times == pytest.approx(raw[name][0])
        assert one.frames.codec == "png"


@pytest.mark.slow
def test_the_wrench_is_tared_and_turned(scripted, options):
    force = SimWrench(fps=300, newton=0.0, bias=2.5, rest=0)
    axes = {"a": ["x", "-y", "-z"]}
    given = options(background=Background(seconds=0.3), axes=axes)
    record(given, {"a": scripted()}, force, say=quiet)
    one = only(given)["a"]
    assert np.nanmax(np.abs(one.force)) < 1e-5
    assert len(one.no_contact) == 5
    wrenches = read_raw(Path(given.out) / "train-000000.tar")["force"][1]
    assert wrenches[:, :3] == pytest.approx(2.5)  # raw stays raw
    plain = options(background=Background(seconds=0.3), axes=axes, tare=False)
    record(plain, {"a": scripted()}, SimWrench(fps=300, newton=0.0, bias=2.5, rest=0), say=quiet)
    last = list(Shards(given.out).recordings("train"))[-1]
    assert np.nanmedian(last.force, axis=0) == pytest.approx([2.5, -2.5, -2.5])


@pytest.mark.slow
def test_a_background_is_taken_before_every_take(scripted, options):
    given = options(takes=2, seconds=0.3, background=Background(seconds=0.2, frames=3))
    sensor = scripted(fps=60)
    found = record(given, {"a": sensor}, say=quiet)
    first, second = Shards(given.out).recordings("train")
    assert found.takes == 2
    for one in (first, second):
        held = one.no_contact.read(range(3))
        numbers = [number_of(sensor, picture) for picture in held]
        assert numbers == sorted(set(numbers))
    assert not np.array_equal(first.no_contact.read([0]), second.no_contact.read([0]))


def test_between_takes_a_finger_that_is_lifted_late_is_waited_for(scripted, options, monkeypatch):
    take_background, calls, said = rig.Rig.take_background, [], []

    def late(opened):
        calls.append(opened)
        if len(calls) in (2, 3):
            raise SensorError("a: something touches it")
        take_background(opened)

    monkeypatch.setattr(rig.Rig, "take_background", late)
    given = options(takes=2, seconds=0.2, background=Background(seconds=0.1, frames=3))
    assert record(given, {"a": scripted(fps=60)}, say=said.append).takes == 2
    assert len(calls) == 4
    assert said.count("a: something touches it; trying again") == 2


def test_a_calibration_goes_along_with_its_sensor(scripted, options, tmp_path):
    one = calibration.Calibration(sensor="digit", mm_per_pixel=0.05, size=[48, 64])
    one.save(tmp_path / "left.yaml")
    given = options(seconds=0.3, calibration={"left": str(tmp_path / "left.yaml")})
    record(given, {"left": scripted(fps=30), "right": scripted(fps=30)}, say=quiet)
    taken = only(given)
    assert calibration.calibration_of(taken["left"]) == one
    assert calibration.calibration_of(taken["right"]) is None
    strange = options(seconds=0.3, calibration={"lft": str(tmp_path / "left.yaml")})
    with pytest.raises(ConfigError, match="did you mean 'left'"):
        record(strange, {"left": scripted(fps=30)}, say=quiet)


def test_a_sensor_that_is_touched_stops_the_recording_before_it_begins(scripted, options):
    given = options(background=Background(seconds=0.3))
    with pytest.raises(SensorError, match="b: something touches it"):
        record(given, {"a": scripted(), "b": scripted(moves=True)}, say=quiet)
    assert not list(Path(given.out).glob("*.tar"))


def test_frames_are_dropped_and_counted_when_encoding_cannot_follow(scripted, options, monkeypatch):
    from tactileforge_live.record.frame_queue import FrameQueue

    encode = FrameQueue.encode
    monkeypatch.setattr(
        FrameQueue, "encode", lambda self, picture: time.sleep(0.05) or encode(self, picture)
    )
    given = options(queue=2, workers=1)
    sensor = scripted(fps=100)
    found = record(given, {"a": sensor}, say=quiet)
    one = only(given)["a"]
    assert found.dropped["a"] > 20
    assert found.frames["a"] == len(one.frames) <= 16
    assert len(one.frames) + found.dropped["a"] == pytest.approx(60, abs=3)
    assert 20 < one.labels["dropped"] <= found.dropped["a"]
    numbers = [number_of(sensor, picture) for picture in one.frames.read(range(len(one.frames)))]
    true = np.array(sensor.times)[numbers]  # each is still at its own time
    assert one.times - one.times[0] == pytest.approx(true - true[0], abs=1e-6)


@pytest.mark.slow
def test_a_sensor_that_is_lost_ends_it_and_keeps_what_came(scripted, options):
    lost = scripted(fps=50, events={20: SensorError("unplugged")})
    given = options(seconds=5.0, reconnect=0.2)
    with pytest.raises(SensorError, match=r"b: unplugged \(it has not come back within 0.2 s\)"):
        record(given, {"a": scripted(), "b": _once(lost)}, say=quiet)
    taken = only(given)
    assert len(taken["b"].frames) >= 12
    assert len(taken["a"].frames) > len(taken["b"].frames)


def _once(sensor):
    """A sensor for a single opening."""
    plain = sensor.open

    def open_once():
        if sensor.opened:
            raise SensorError("no such port")
        plain()

    sensor.open = open_once
    return sensor


@pytest.mark.slow
def test_a_sensor_that_comes_back_goes_on(scripted, options):
    given = options(seconds=1.5)
    sensor = scripted(fps=50, events={20: SensorError("unplugged")})
    record(given, {"a": sensor}, say=quiet)
    one = only(given)["a"]
    assert one.labels["reopened"] == 1
    assert np.diff(one.times).max() > 0.3
    assert one.times[-1] > 1.2


def test_it_ends_when_the_sources_are_over(scripted, options):
    given = options(seconds=None, takes=None)
    found = record(
        given, {"a": scripted(fps=100, limit=50), "b": scripted(fps=100, limit=70)}, say=quiet
    )
    assert found.takes == 1
    assert sorted(found.frames.values()) == pytest.approx([48, 68], abs=8)


@pytest.mark.slow
def test_it_ends_when_it_is_told_to(scripted, options):
    stop = threading.Event()
    threading.Timer(1.0, stop.set).start()
    given = options(seconds=None, takes=None)
    found = record(given, {"a": scripted()}, stop=stop, say=quiet)
    assert found.takes == 1
    assert 0.1 < found.seconds < 5
    assert [path.name for path in Path(given.out).glob("*.tar")] == ["train-000000.tar"]


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda s: ({}, None, None), "no sensor: choose some"),
        (lambda s: ({"f": s(kind="wrench")}, None, None), "choose it with force=f"),
        (lambda s: ({"a": s()}, s(), None), "force=digit is not a wrench sensor"),
        (lambda s: ({"a": s()}, None, s(kind="wrench")), "is not a camera"),
        (lambda s: ({"a": s(type="digti")}, None, None), "'digti'; did you mean 'digit'"),
        (
            lambda s: ({"force": s()}, None, None),
            "no sensor can be called force",
        ),
        (
            lambda s: ({"a": s(address="/dev/video0"), "b": s(address="/dev/video0")}, None, None),
            "a and b are one device, /dev/video0",
        ),
    ],
)
def test_rigs_that_cannot_be(scripted, options, make, message):
    sensors, force, camera = make(scripted)
    with pytest.raises(TactileForgeError, match=message):
        record(options(), sensors, force, camera, say=quiet)
    assert not any(sensor.is_open for sensor in sensors.values())


@pytest.mark.slow
def test_an_outage_of_all_sensors_loses_neither_forces_nor_what_comes_after(scripted, options):
    """Nothing comes for two segments; then everything goes on."""
    sensor = scripted(fps=50, events={10: SensorError("unplugged")})
    given = options(seconds=1.6, segment=0.2)
    record(given, {"a": sensor}, SimWrench(fps=200, rest=0), say=quiet)
    one = only(given)["a"]
    assert np.diff(one.times).max() > 0.45
    assert one.times[-1] > 1.4
    times, _ = read_raw(Path(given.out) / "train-000000.tar")["force"]
    assert np.diff(times) == pytest.approx(1 / 200, abs=1e-9)


def test_the_status_says_how_each_sensor_does_and_warns_once(scripted, options):
    dark = scripted(fps=50)
    dark.picture = lambda number: np.full((32, 24, 3), number % 3, np.uint8)
    said = io.StringIO()
    given = options()
    record(
        given, {"a": scripted(), "b": dark}, SimWrench(rest=0), say=quiet, status=RecordStatus(said)
    )
    text = said.getvalue()
    assert text.count("warning: b: TF602 pictures are black: is its light on") == 1
    assert "warning: a" not in text
    assert re.search(r"take 0 .* \| a [\d.]+ fps queue \d+ dropped 0 \| b .* \| force .* fps", text)
    assert re.search(r"saved \d+ s, [\d.]+ MB \| disk \d+ GB", text)


def test_a_driver_that_cannot_open_is_named(scripted, options):
    sensor = scripted()
    sensor.refuse.append(OSError(16, "Device or resource busy"))
    with pytest.raises(SensorError, match=r"b: cannot be opened: .*busy"):
        record(options(), {"a": scripted(), "b": sensor}, say=quiet)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"action": "pres"}, "did you mean 'press'"),
        ({"split": "test"}, "unknown split 'test'"),
        ({"codec": "jpeg"}, "unknown codec"),
        ({"seconds": 0}, "seconds=0"),
        ({"tier": 6}, "tier=6"),
        ({"quality": 0}, "quality=0"),
        ({"background": {"second": 1}}, "did you mean 'seconds'"),
    ],
)
def test_options_that_cannot_be(given, message):
    with pytest.raises(ConfigError, match=message):
        build(RecordOptions, "", {"out": "x", **given})


def test_no_room_ends_it_before_the_disk_is_full(scripted, options):
    given = options(seconds=30.0, min_free_gb=1e9)
    with pytest.raises(TactileForgeError, match="GB are left on the disk"):
        record(given, {"a": scripted()}, say=quiet)
    assert len(only(given)["a"].frames) >= 9


@pytest.mark.slow
@pytest.mark.realdata
def test_real_touch_is_recorded_as_it_was(realdata, options):
    """A real video played by OpenCV, recorded with forces: frames equal those of the file."""
    from tactileforge.sensors.drivers.camera import Camera

    path = str(realdata / "touchd_force_demo" / "digit_tactile_320x240.mp4")
    given = options(seconds=2.0, segment=0.5)
    camera = Camera(path, type="digit", rotation=90)  # the video lies on its side
    record(given, {"digit": camera}, SimWrench(fps=200, rest=0), say=quiet)
    one = only(given)["digit"]
    capture, true = cv2.VideoCapture(path), []
    while len(true) < 90:
        true.append(cv2.rotate(capture.read()[1], cv2.ROTATE_90_COUNTERCLOCKWISE)[..., ::-1])
    capture.release()
    first = next(i for i, f in enumerate(true) if np.array_equal(f, one.frames.read([0])[0]))
    for i in range(0, len(one.frames), 5):
        number = first + round((one.times[i] - one.times[0]) * 30)
        assert np.array_equal(one.frames.read([i])[0], true[number])
    assert len(one.frames) >= 8  # a machine that is busy gets fewer of the 60


# --- processes that are killed or run out of room ---


@pytest.fixture
def command():
    started = []

    def start(out, **given):
        words = [sys.executable, str(SCRIPT), str(out), json.dumps(given)]
        env = os.environ | {"OMP_NUM_THREADS": "1"}
        process = subprocess.Popen(
            words, env=env, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        )
        started.append(process)
        return process

    yield start
    for process in started:
        process.kill()
        process.communicate()


def check_numbers(one, seed):
    """Its frames are those of the sensor, each at its time, none twice."""
    spec = spec_from_file_location("recordable", SCRIPT)
    made = module_from_spec(spec)
    spec.loader.exec_module(made)
    seen = one.frames.read(range(len(one.frames)))
    first = next(n for n in range(400) if np.array_equal(made.picture(seed, n), seen[0]))
    for picture, after in zip(seen, one.times - one.times[0], strict=True):
        assert np.array_equal(picture, made.picture(seed, first + round(after * 30)))


@pytest.mark.slow
def test_what_was_acknowledged_before_sigkill_is_whole(command, tmp_path):
    out = tmp_path / "out"
    process = command(out, segment=0.3)
    wait_until(lambda: len(list(out.glob("*.tar"))) >= 3, 60)
    process.send_signal(signal.SIGKILL)
    process.communicate()
    listed = [e["file"] for e in json.loads((out / "index.json").read_text())["splits"]["train"]]
    assert len(listed) >= 2
    before = list(Shards(str(out)).recordings("train"))
    assert [one.labels["segment"] for one in before] == [i // 2 for i in range(len(before))]
    again = command(out, segment=0.3, seconds=0.5)
    _, errors = again.communicate(timeout=60)
    assert again.returncode == 0, errors
    assert sorted(path.name for path in out.glob("*.tar")) == [
        "train-000000.tar",
        "train-000001.tar",
    ]
    for one in Shards(str(out)).recordings("train"):
        check_numbers(one, {"left": 1, "right": 2}[one.labels["device"]])
    killed = next(shards.read_shard(out / "train-000000.tar"))
    assert len(killed.frames) >= sum(len(o.frames) for o in before if o.labels["device"] == "left")


@pytest.mark.slow
@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGTERM])
def test_the_command_ends_well_when_it_is_stopped(how, tmp_path):
    words = ["sensor=sim", "sensor.sim.size=32", f"out={tmp_path}/out", "segment=0.5"]
    tool = [sys.executable, "-m", "tactileforge", "record", *words, "background.seconds=0"]
    env = os.environ | {"OMP_NUM_THREADS": "1"}
    process = subprocess.Popen(
        tool, env=env, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    wait_until(lambda: list((tmp_path / "out").glob("*.tar")), 60)
    process.send_signal(how)
    said, errors = process.communicate(timeout=30)
    assert process.returncode == 0, errors
    assert re.search(r"1 take, [\d.]+ s, [\d.]+ MB; frames: sim \d+; dropped: none", said)
    assert "recording until Ctrl-C" in said
    assert re.search(r"take 0 +[\d.]+ s \| sim [\d.]+ fps queue \d+ dropped 0 \| saved", errors)
    assert [p.name for p in (tmp_path / "out").glob("*.tar")] == ["train-000000.tar"]


@pytest.mark.slow
def test_a_full_disk_keeps_what_was_acknowledged_and_says_so(command, tmp_path):
    """Segments of 24 frames of 10 kB fit under the limit, and the whole take does not."""
    out = tmp_path / "out"
    process = command(out, segment=0.4, seconds=2.0, file_limit=400_000)
    _, errors = process.communicate(timeout=60)
    assert process.returncode == 1
    assert re.search(r"cannot be written \(File too large\)\. 2\.0 s of touch are safe", errors)
    held = list(Shards(str(out)).recordings("train"))
    assert sum(len(one.frames) for one in held) == pytest.approx(120, abs=4)
    for one in held:
        check_numbers(one, {"left": 1, "right": 2}[one.labels["device"]])
    assert not list(out.rglob("*.part"))
    again = command(out, segment=0.4, seconds=0.3)
    assert again.wait(60) == 0
    assert len(list(out.glob("*.tar"))) == 2


@pytest.mark.slow
def test_a_disk_that_is_full_from_the_start(command, tmp_path):
    process = command(tmp_path / "out", segment=0.4, seconds=9.0, file_limit=50_000)
    _, errors = process.communicate(timeout=60)
    assert process.returncode == 1
    assert "(File too large). 0.0 s of touch are safe; make room" in errors
    assert not list((tmp_path / "out").rglob("*.tar*"))


def test_a_disk_that_fills_up_in_the_middle(scripted, options, monkeypatch):
    write, calls = store.write_shard, []

    def full(*given):
        calls.append(given)
        if len(calls) == 3:
            raise OSError(28, "No space left on device")
        write(*given)

    monkeypatch.setattr(store, "write_shard", full)
    given = options(seconds=5.0)
    with pytest.raises(TactileForgeError, match=r"\(No space left on device\)\. 0\.4 s of touch"):
        record(given, {"a": scripted(fps=50)}, say=quiet)
    held = list(Shards(given.out).recordings("train"))
    assert [one.labels["segment"] for one in held] == [0, 1]
    assert sum(len(one.frames) for one in held) == pytest.approx(20, abs=1)


@pytest.mark.slow
def test_simulated_touch_is_recorded_and_inspected(tmp_path, capsys):
    from tactileforge.cli import run

    out = f"out={tmp_path}/out"
    words = ["sensor=[sim]", "+sensor@sensor.second=sim", "sensor.second.type=digit"]
    sizes = [
        "sensor.sim.size=32",
        "sensor.second.size=32",
        "sensor.sim.rest=1",
        "sensor.second.rest=1",
    ]
    more = [
        "force=sim_wrench",
        "force.rest=0",
        "seconds=1",
        "segment=0.5",
        "background.seconds=0.3",
        "object=ball",
    ]
    assert run(["record", *words, *sizes, out, *more]) == 0
    said = capsys.readouterr().out
    assert "background: nothing may touch the sensors" in said
    assert "frames: sim " in said
    data = ["data=shards", f"data.root={tmp_path}/out"]
    assert run(["data", "inspect", *data, f"out={tmp_path}/page"]) == 0
    assert "2 recordings" in capsys.readouterr().out


def test_help_shows_every_key(capsys):
    from tactileforge.cli import run

    assert run(["record", "--help"]) == 0
    text = capsys.readouterr().out
    from dataclasses import fields

    assert all(f"\n{one.name}:" in text for one in fields(RecordOptions))


def test_what_the_command_refuses(capsys, tmp_path):
    from tactileforge.cli import run

    for words, message in (
        (["sensor=[digitt]", f"out={tmp_path}"], "unknown sensor 'digitt'"),
        ([f"out={tmp_path}"], "give sensor=NAME"),
        (["sensor=sim"], "give out=..."),
        (["sensor=sim_wrench", f"out={tmp_path}"], "choose it with force=sim_wrench"),
    ):
        assert run(["record", *words]) == 1
        assert message in capsys.readouterr().err


@pytest.mark.slow
def test_a_simulated_finger_that_rests_has_a_background(options):
    sensor = SimSensor("digit", size=32, rest=1.5)
    given = options(background=Background(seconds=0.4), seconds=0.4)
    record(given, {"sim": sensor}, say=quiet)
    one = only(given)["sim"]
    assert len(one.no_contact) == 5
    assert one.sensor == "digit"


@pytest.mark.slow
@pytest.mark.parametrize("fault", ["blocks", "exits", "untimed", "backwards"])
def test_a_sensor_that_dies_in_silence_ends_the_recording(scripted, options, monkeypatch, fault):
    release = threading.Event()

    def leave(frame):
        raise SystemExit(0)

    changes = {
        "blocks": lambda frame: release.wait(60) and frame,
        "exits": leave,
        "untimed": lambda frame: replace(frame, time=float("nan")),
        "backwards": lambda frame: replace(frame, time=frame.time - 5),
    }
    monkeypatch.setattr(rig, "Capture", partial(Capture, silence=0.2))
    events = dict.fromkeys(range(60, 10_000), changes[fault])
    given = options(seconds=30, reconnect=0.2)
    sensor = scripted(fps=60, events=events)
    with pytest.raises(SensorError, match=r"^a: "):
        record(given, {"a": sensor}, say=quiet)
    release.set()
    assert 5 < len(only(given)["a"].frames) <= 60  # all that came after the take began
    if fault in ("untimed", "backwards"):
        assert only(given)["a"].labels[fault] > 0


def test_a_sensor_that_is_lost_at_the_end_is_an_error(scripted, options):
    given = options(seconds=0.6)

    class Gone(scripted):
        def open(self):
            if self.opened:
                raise SensorError("not there")
            super().open()

    gone = Gone(fps=60, events={20: SensorError("unplugged")})
    with pytest.raises(SensorError, match="a: it was lost, and had not come back at the end"):
        record(given, {"a": gone, "b": scripted(fps=60)}, say=quiet)
    taken = only(given)
    assert 5 < len(taken["a"].frames) <= 20 < len(taken["b"].frames)


def test_dropped_frames_are_told_by_reason(scripted, options):
    back = {9: lambda f: replace(f, time=f.time - 0.05), 12: lambda f: replace(f, time=np.nan)}
    given = options()
    found = record(given, {"a": scripted(fps=60, events=back)}, say=quiet)
    assert found.reasons["a"] == {"late": 0, "backwards": 1, "untimed": 1, "frozen": 0}
    assert of_drops(found.reasons) == "a 2 (backwards 1, untimed 1)"
    labels = only(given)["a"].labels
    assert (labels["backwards"], labels["untimed"], labels["frozen"]) == (1, 1, 0)


@pytest.mark.slow
def test_packets_that_cannot_be_are_told_by_reason(options):
    """Two of five false packets are out of range, one jumps alone, two jump apart."""
    false = {40: 65_000, 50: 65_000, 60: 50_000, 70: 50_000, 71: 20_000}
    levels = (false.get(number, 100 + number % 5) for number in itertools.count())
    given = options(seconds=1.5)
    with PtyDevice() as device:
        packets = (b"\xaa\x55" + struct.pack("<16H", *[level] * 16) for level in levels)
        device.play(packets, fps=100)
        sensor = SerialArray(port=device.port, limits=[0, 60_000], baseline=5)
        found = record(given, {"pad": sensor}, say=quiet)
    assert {key: found.reasons["pad"][key] for key in ("implausible", "jumped")} == {
        "implausible": 2,
        "jumped": 3,
    }
    pad = only(given)["pad"]
    assert (pad.labels["implausible"], pad.labels["jumped"]) == (2, 3)
    ((_, values),) = read_raw(next(Path(given.out).glob("*.tar"))).values()
    assert set(np.unique(values)) == {100, 101, 102, 103, 104}


def test_sensors_that_hang_while_they_open_or_close_are_left_behind(scripted, options, monkeypatch):
    monkeypatch.setattr(opening, "_OPEN", 0.2)
    monkeypatch.setattr(opening, "_CLOSE", 0.2)
    release = threading.Event()

    def hang():
        release.wait(60)

    one, other = scripted(fps=60), scripted(fps=60)
    one.open = hang
    with pytest.raises(SensorError, match=r"a: open\(\) of its driver has not returned within 0.2"):
        record(options(), {"a": one}, say=quiet)
    other.close = hang
    given = options(seconds=0.3)
    with pytest.raises(SensorError, match=r"b: close\(\) of its driver has not returned"):
        record(given, {"b": other}, say=quiet)
    assert len(only(given)["b"].frames) > 5  # kept
    release.set()


@pytest.mark.slow
def test_what_is_odd_about_frames_is_said_and_kept(scripted, options):
    """Red and blue swap in the middle, and a clock is late from the start."""
    sensor, late = scripted(fps=60, limit=240), scripted(fps=60)  # however long they take
    slope = np.linspace(40, 200, 24)[None, :, None] * np.array([1.0, 0.5, 0.1]) + 20

    def picture(number):
        noise = np.random.default_rng(number).normal(0, 1, (32, 24, 3))
        shown = (slope + noise).clip(0, 255).astype(np.uint8)
        return np.ascontiguousarray(shown[..., ::-1]) if number >= 120 else shown

    sensor.picture = picture
    given = options(seconds=None, segment=1.0)
    late.events = {n: lambda f: replace(f, time=f.time - 3) for n in range(10_000)}
    found = record(given, {"a": sensor}, None, late, say=quiet)
    assert set(found.findings) == {"a", "view"}
    (recoloured,), (late,) = found.findings["a"], found.findings["view"]
    assert str(recoloured).startswith("a: TF603 its pictures have other colours than at first")
    assert str(late).startswith("view: TF604 its times are 3.")
    labels = only(given)["a"].labels
    assert 0 < labels["recoloured"] <= 120
    assert labels["checks"] == "TF603"


@pytest.mark.parametrize(("ignore", "codes"), [((), ["TF602"]), (("TF602",), [])])
def test_a_check_of_a_stream_can_be_left_out(scripted, options, ignore, codes):
    sensor = scripted(fps=60, limit=30)
    sensor.picture = lambda n: np.random.default_rng(n).integers(0, 4, (32, 24, 3), np.uint8)
    given = options(seconds=None, background=Background(seconds=0), ignore=ignore)
    found = record(given, {"a": sensor}, say=quiet)
    assert [finding.code for finding in found.findings.get("a", [])] == codes


def test_a_wrench_sensor_that_dies_is_counted_and_an_error(scripted, options, monkeypatch):
    monkeypatch.setattr(rig, "Capture", partial(Capture, silence=0.3))
    dead = {n: lambda f: replace(f, raw=np.full(6, np.nan, np.float32)) for n in range(20, 10_000)}
    force = scripted(fps=100, kind="wrench", events=dead)
    given = options(seconds=20, reconnect=0.3)
    with pytest.raises(SensorError, match="force: its values are not numbers"):
        record(given, {"a": scripted(fps=30)}, force, say=quiet)
    assert only(given)["a"].labels["dropped"] == 0


def test_a_process_that_was_stopped_goes_on(scripted, options, monkeypatch):
    """As with Ctrl-Z and fg: a minute passes without anybody waiting for a driver."""
    from tactileforge.sensors import capture, opening
    from tactileforge.sensors.awake import AwakeClock

    jump = [0.0]
    own = AwakeClock(lambda: time.monotonic() + jump[0])
    for module in (capture, opening, rig):
        monkeypatch.setattr(module, "AWAKE_CLOCK", own)
    watched = Capture.watch

    def watch(self):
        if self.counts.frames >= 10 and not jump[0]:
            jump[0] = 60.0
        watched(self)

    monkeypatch.setattr(Capture, "watch", watch)
    found = record(options(seconds=1.5), {"a": scripted(fps=50)}, say=quiet)
    assert jump[0] == 60.0
    assert found.frames["a"] > 20
    assert not found.findings
