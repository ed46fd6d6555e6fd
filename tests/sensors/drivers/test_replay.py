import time
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image
from videos import greys, write_video

from tactileforge.contracts import Recording
from tactileforge.data.frames.lazy import ArrayFrames
from tactileforge.data.shards import shards
from tactileforge.errors import ConfigError, DataNotFoundError, TactileForgeError
from tactileforge.sensors.drivers.replay import Replay
from tactileforge.specs.published import spec
from tactileforge.testing import check
from tactileforge.testing.clock import FakeTime

FPS = 20


@pytest.fixture
def video(tmp_path):
    """Six frames of 48 x 64, the i-th of brightness 40 * i."""
    return str(write_video(tmp_path / "press.avi", greys(6, 40, (48, 64)), FPS))


@pytest.fixture
def images(tmp_path):
    """Eleven numbered images of 6 x 8 with their number as red, and a note beside them."""
    folder = tmp_path / "images"
    folder.mkdir()
    for i in range(11):
        Image.new("RGB", (8, 6), (i, 0, 0)).save(folder / f"frame{i}.png")
    (folder / "notes.txt").write_text("a ball")
    return str(folder)


def read_all(sensor, most=100):
    frames = []
    with sensor:
        try:
            while len(frames) < most:
                frames.append(sensor.read())
        except EOFError:
            pass
    return frames


def brightness(frames):
    return [round(float(frame.array.mean()) / 40) for frame in frames]


@pytest.mark.parametrize("realtime", [True, False])
def test_conformance(video, realtime):
    results = check("sensor", "replay", path=video, type="gelsight_mini", realtime=realtime)
    statuses = {result.name: result.status for result in results}
    # the path is found, so there is something attached
    assert statuses.pop("discover with nothing attached gives nothing") == "skipped"
    assert set(statuses.values()) == {"ran"}


def test_conformance_without_a_file():
    statuses = {r.name: r.status for r in check("sensor", "replay", type="gelsight_mini")}
    assert statuses["discover with nothing attached gives nothing"] == "ran"
    assert statuses["read before open raises"] == "ran"
    assert statuses["frames are as specified"] == "skipped"
    assert "failed" not in statuses.values()


def test_every_frame_comes_with_the_times_of_the_video(video):
    frames = read_all(Replay(video, type="gelsight_mini", realtime=False))
    assert brightness(frames) == [0, 1, 2, 3, 4, 5]
    assert np.diff([frame.time for frame in frames]) == pytest.approx([1 / FPS] * 5, abs=1e-3)


def test_without_real_time_it_does_not_wait(video, monkeypatch):
    monkeypatch.setattr(time, "sleep", lambda seconds: pytest.fail(f"slept {seconds} s"))
    frames = read_all(Replay(video, type="gelsight_mini", realtime=False, fps=0.1))
    assert frames[-1].time - frames[0].time == pytest.approx(50)


@pytest.fixture
def clock(monkeypatch):
    """The time of replays; it passes only in sleep."""
    made = FakeTime()
    monkeypatch.setattr("tactileforge.sensors.drivers.replay.time", made)
    return made


def test_real_time_waits_until_a_frame_is_due(video, clock):
    with Replay(video, type="gelsight_mini") as sensor:
        frames = []
        while not frames or frames[-1].array.mean() < 190:
            frames.append(sensor.read())
            assert frames[-1].time <= clock.monotonic() + 1e-9
    assert brightness(frames) == [0, 1, 2, 3, 4, 5]


def test_real_time_loses_what_nobody_read(video, clock):
    with Replay(video, type="gelsight_mini") as sensor:
        first = sensor.read()
        clock.sleep(2.6 / FPS)
        late = sensor.read()
    assert brightness([first]) == [0]
    assert brightness([late])[0] == 2
    assert late.time - first.time >= 2 / FPS - 1e-3


def test_a_frame_too_far_away_is_a_timeout(video):
    with Replay(video, type="gelsight_mini", fps=0.5) as sensor:
        sensor.read()
        with pytest.raises(TimeoutError, match=r"no frame within 0\.01 s"):
            sensor.read(timeout=0.01)


@pytest.mark.parametrize("realtime", [True, False])
def test_loop_goes_on_with_increasing_times(images, realtime):
    sensor = Replay(images, type="gelsight_mini", realtime=realtime, loop=True, fps=500)
    frames = read_all(sensor, most=30)
    assert len(frames) == 30
    assert {int(frame.array[0, 0, 0]) for frame in frames} <= set(range(11))
    steps = np.diff([frame.time for frame in frames]) * 500
    assert (steps > 0).all()
    assert steps == pytest.approx(np.round(steps), abs=1e-3)
    if not realtime:
        assert [int(frame.array[0, 0, 0]) for frame in frames] == [i % 11 for i in range(30)]


def test_images_come_in_the_order_of_their_numbers_at_the_rate_of_the_type(images):
    frames = read_all(Replay(images, type="gelsight_mini", realtime=False))
    assert [int(frame.array[0, 0, 0]) for frame in frames] == list(range(11))
    assert np.diff([frame.time for frame in frames]) == pytest.approx([1 / 18] * 10)


def test_spec_is_that_of_the_type_and_once_open_of_the_size_of_the_frames(video):
    sensor = Replay(video, type="gelsight_mini")
    assert sensor.spec == spec("gelsight_mini")
    with sensor:
        assert sensor.spec == replace(spec("gelsight_mini"), height=48, width=64)


def test_it_starts_again_when_it_is_opened_again(video):
    sensor = Replay(video, type="gelsight_mini", realtime=False)
    assert len(read_all(sensor)) == 6
    assert len(read_all(sensor)) == 6


def test_discover_gives_the_path_if_it_exists(video, tmp_path):
    assert Replay(type="gelsight_mini").discover() == []
    assert Replay(str(tmp_path / "none.mp4"), type="gelsight_mini").discover() == []
    assert Replay(video, type="gelsight_mini").discover() == [video]


@pytest.fixture
def shard(tmp_path):
    """Two recordings of four frames of a DIGIT, in steps of 0.04 s, of brightness 20 and 120 on."""
    made = []
    for number, first in enumerate((20, 120)):
        about = Recording(
            key=f"touch{number}",
            sensor="digit",
            frames=ArrayFrames(np.zeros((1, 1, 1, 3), np.uint8)),
            times=1.5 + 0.04 * np.arange(4),
            no_contact=None,
        )
        pictures = [
            shards.encode_image(np.full((8, 6, 3), first + 20 * i, np.uint8), "png")
            for i in range(4)
        ]
        made.append(shards.Packed(shards.describe_recording(about), "png", pictures, [], []))
    shards.write_shard(tmp_path / "train-000000.tar", made)
    return str(tmp_path / "train-000000.tar")


@pytest.mark.parametrize(("key", "first"), [("", 20), ("touch0", 20), ("touch1", 120)])
def test_a_recording_of_a_shard_is_played_with_its_own_times_and_type(shard, key, first):
    sensor = Replay(shard, key=key, realtime=False)
    start = time.monotonic()
    frames = read_all(sensor)
    assert [int(frame.array.mean()) for frame in frames] == [first + 20 * i for i in range(4)]
    assert np.diff([frame.time for frame in frames]) == pytest.approx([0.04] * 3)
    assert start <= frames[0].time <= time.monotonic()
    assert sensor.spec == replace(spec("digit"), height=8, width=6)


def test_conformance_of_a_shard(shard):
    statuses = {r.name: r.status for r in check("sensor", "replay", path=shard)}
    assert statuses.pop("discover with nothing attached gives nothing") == "skipped"
    assert set(statuses.values()) == {"ran"}


def test_a_recording_that_is_not_there(shard):
    with pytest.raises(ConfigError, match="'touch2'; did you mean 'touch1'"):
        Replay(shard, key="touch2").open()


def test_a_video_needs_a_type(video):
    with pytest.raises(ConfigError, match=r"set sensor\.replay\.type="):
        Replay(video).open()


def test_what_cannot_be_opened(tmp_path):
    with pytest.raises(ConfigError, match=r"set sensor\.replay\.path="):
        Replay(type="digit").open()
    with pytest.raises(DataNotFoundError, match=r"none\.mp4: no such file or folder"):
        Replay(str(tmp_path / "none.mp4"), type="digit").open()
    with pytest.raises(DataNotFoundError, match="no image in this folder"):
        Replay(str(tmp_path), type="digit").open()
    with pytest.raises(ConfigError, match=r"'digti'; did you mean 'digit'"):
        Replay(type="digti")


def test_read_needs_an_open_sensor(video):
    sensor = Replay(video, type="gelsight_mini")
    with pytest.raises(TactileForgeError, match="not open"):
        sensor.read()
    with sensor:
        sensor.read()
    with pytest.raises(TactileForgeError, match="not open"):
        sensor.read()
