"""Nothing waits, nothing is lost unseen, and a cut-off part is in order."""

import threading
from concurrent.futures import ThreadPoolExecutor

import cv2
import numpy as np
import pytest
from tactileforge_live.record.frame_queue import FrameQueue, SampleBuffer

from tactileforge.contracts import Frame


def frame(time, value=7, raw=None):
    return Frame(array=np.full((8, 8, 3), value, np.uint8), time=time, raw=raw)


@pytest.fixture
def pool():
    with ThreadPoolExecutor(1, "encode") as found:
        yield found


def test_frames_are_kept_between_start_and_end_and_cut_in_order(pool):
    reel = FrameQueue(pool, ["png"], 95, queue=100, hold=100)
    reel.take(frame(0.5))
    reel.start(1.0, 2.0)
    for time in (0.9, 1.0, 1.2, 1.4, 1.6, 2.0):
        reel.take(frame(time, round(time * 100)))
    first, rest = reel.cut(1.4), reel.cut(9.0)
    assert [shot.time for shot in first] == [1.0, 1.2]
    assert [shot.time for shot in rest] == [1.4, 1.6]
    for shot in (*first, *rest):
        png = np.frombuffer(shot.encoded.result()["png"], np.uint8)
        assert (cv2.imdecode(png, cv2.IMREAD_COLOR) == round(shot.time * 100)).all()
    reel.stop()
    reel.take(frame(1.7))
    assert reel.cut(9.0) == []
    assert reel.dropped == 0


def test_a_queue_that_is_full_drops_and_counts(pool):
    gate = threading.Event()
    pool.submit(gate.wait)
    reel = FrameQueue(pool, ["jpg"], 95, queue=3, hold=100)
    reel.start(0.0, 10.0)
    for time in range(5):
        reel.take(frame(float(time)))
    assert (reel.waiting, reel.dropped) == (3, 2)
    gate.set()
    shots = reel.cut(10.0)
    assert [shot.time for shot in shots] == [0.0, 1.0, 2.0]
    assert all(shot.encoded.result()["jpg"][:2] == b"\xff\xd8" for shot in shots)
    reel.start(0.0, 10.0)
    assert reel.dropped == 0


def test_a_disk_that_does_not_follow_drops_and_counts(pool):
    reel = FrameQueue(pool, ["jpg"], 95, queue=100, hold=4)
    reel.start(0.0, 100.0)
    for time in range(6):
        reel.take(frame(float(time)))
    assert reel.dropped == 2
    reel.cut(3.0)
    reel.take(frame(6.0))
    assert reel.dropped == 2


def test_a_view_is_encoded_for_every_codec_in_use(pool):
    reel = FrameQueue(pool, ["jpg", "png"], 80, queue=9, hold=9)
    reel.start(0.0, 1.0)
    reel.take(frame(0.5))
    (shot,) = reel.cut(1.0)
    assert set(shot.encoded.result()) == {"jpg", "png"}


def test_samples_are_cut_and_held_back():
    samples = SampleBuffer(hold=5)
    samples.start(1.0, 2.0)
    for time in np.arange(0.5, 4.5, 0.5):
        samples.take(frame(time, raw=np.full(6, time, np.float32)))
    assert samples.dropped == 2  # 1.0 to 3.0 fill it
    times, values = samples.cut(2.0)
    assert times.tolist() == [1.0, 1.5]
    assert values[:, 3].tolist() == [1.0, 1.5]
    later, rest = samples.all()
    assert later.tolist() == [2.0, 2.5, 3.0]
    assert rest.shape == (3, 6)
    assert samples.cut(0.0)[1].shape == (0, 6)
