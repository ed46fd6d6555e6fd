"""The driver against a simulated pad, byte by byte over a pseudo-terminal."""

import itertools
import random

import numpy as np
import pytest
from tactileforge_flexitac.sensor import FlexiTac

from tactileforge.errors import ConfigError, SensorError
from tactileforge.testing import check
from tactileforge.testing.clock import FakeTime, TimedLink
from tactileforge.testing.emulators import Faults, PtyDevice, chunks, read_until_silent

#: Two rows of three taxels: 20, 21, 22, 23, 200 and 255.
VECTOR = bytes.fromhex("aa55 1415 1617 c8ff")
SMALL = {"rows": 2, "columns": 3, "baseline": 0}


def packet(number):
    """A packet with its number in the first two taxels, and no header among its bytes."""
    return b"\xaa\x55" + divmod(number, 100)[0].to_bytes() + bytes([number % 100] * 383)


def numbers(frames):
    return [int(frame.raw[0, 0] * 100 + frame.raw[1, 0]) for frame in frames]


@pytest.fixture
def pad():
    with PtyDevice() as device:
        yield device


def test_the_known_packet(pad):
    with FlexiTac(port=pad.port, **SMALL) as sensor:
        pad.write(VECTOR * 3 + VECTOR[:2])
        frame = sensor.read()
        assert sensor.baudrate == 2_000_000
    assert frame.raw.ravel().tolist() == [20, 21, 22, 23, 200, 255]
    assert frame.array[..., 2].tolist() == [[153, 155, 156], [157, 255, 255]]
    assert (frame.array[..., :2] == 128).all()


def test_a_pad_has_packets_of_386_bytes():
    assert FlexiTac().framing.payload + 2 == len(packet(0)) == 386
    assert (FlexiTac().spec.height, FlexiTac().spec.width) == (12, 32)


@pytest.mark.parametrize("faults", [Faults(), Faults(split=1), Faults(split=97, merge=3)])
def test_split_and_merged_packets_all_come(pad, faults):
    with FlexiTac(port=pad.port, baseline=0) as sensor:
        pad.play(map(packet, range(101)), faults=faults)
        frames = read_until_silent(sensor, 0.8, pad)
        assert numbers(frames) == list(range(100))  # the last one is not followed by a header yet
        assert (sensor.parser.bad, sensor.parser.lost) == (0, 0)
    assert (np.diff([frame.time for frame in frames]) > 0).all()


def test_a_header_among_the_taxels(pad):
    """The stream begins in the middle of a packet, and half of the taxels are a header."""
    packets = [bytes.fromhex("aa55 aa55 01 02") + bytes([i % 7]) + VECTOR[-1:] for i in range(60)]
    packets[:30] = [one.replace(b"\xaa\x55\x01", b"\xaa\x54\x01") for one in packets[:30]]
    with FlexiTac(port=pad.port, **SMALL) as sensor:
        pad.play([packets[0][3:], *packets[1:]])
        frames = read_until_silent(sensor, 0.8, pad)
    assert [int(frame.raw[4, 0]) for frame in frames] == [i % 7 for i in range(1, 59)]
    assert frames[-1].raw.ravel().tolist() == [0xAA, 0x55, 1, 2, 58 % 7, 255]


def test_nothing_is_taken_for_a_packet_while_two_places_fit():
    parser = FlexiTac(**SMALL).new_parser()
    two = bytes.fromhex("aa55 01 aa55 020304")
    assert parser.feed(two * 20) == []
    assert parser.bad == 17
    one = bytes.fromhex("aa55 01 aa56 020304")
    assert parser.feed(one * 6)[-5:] == [one[2:]] * 5


def test_lost_bytes_and_garbage_cost_packets_and_never_give_wrong_ones(pad):
    faults = Faults(lose=0.0002, garbage=0.05, split=100, seed=2)
    sent = list(map(packet, range(300)))
    written = b"".join(itertools.chain(*chunks(sent, faults)))
    followed = [i for i in range(300) if sent[i] + b"\xaa\x55" in written]
    with FlexiTac(port=pad.port, baseline=0) as sensor:
        pad.play(sent, faults=faults)
        frames = read_until_silent(sensor, 0.8, pad)
        counts = sensor.parser
        assert counts.lost == len(written) - 386 * counts.good - counts.waiting
    assert 200 < len(followed) < 290
    assert set(numbers(frames)) <= set(followed)
    assert len(frames) > 0.9 * len(followed)
    assert all((frame.raw[1:] == frame.raw[1]).all() for frame in frames)


def test_random_bytes_are_hardly_ever_a_packet():
    """Three headers at this distance occur by chance once in 2^48 places."""
    parser = FlexiTac().new_parser()
    rng = random.Random(0)
    found = [p for _ in range(1000) for p in parser.feed(rng.randbytes(1000))]
    assert found == []
    assert parser.lost + parser.waiting == 1_000_000


def test_baseline_and_rate(monkeypatch):
    clock = FakeTime()
    for module in ("tactileforge.sensors.stream", "tactileforge_arrays.serial_array"):
        monkeypatch.setattr(f"{module}.time", clock)
    packets = itertools.chain([packet(20)] * 60, itertools.repeat(packet(70)))
    link = TimedLink(clock, packets, fps=40)
    monkeypatch.setattr(FlexiTac, "connect", lambda self: link)
    with FlexiTac(baseline=20, span=100.0) as sensor:
        assert set(sensor.rest.ravel()) == {0, 20}
        assert sensor.spec.fps == pytest.approx(40, rel=0.1)  # 90 unless measured
        assert (sensor.read().array == 128).all()
        while (last := sensor.read()).raw[1, 0] == 20:
            pass
    assert last.array[0, 1].tolist() == [128, 128, round(128 + 127 / 2)]


def test_unplugged_and_back(pad):
    sensor = FlexiTac(port=pad.port, baseline=5)
    pad.play(itertools.repeat(packet(1)), fps=200)
    with sensor:
        sensor.read()
        pad.disconnect()
        with pytest.raises(SensorError, match="unplugged"):
            read_until_silent(sensor, 0.8, pad)
        with pytest.raises(SensorError, match="no such serial port"):
            sensor.open()
        pad.connect()
        pad.play(itertools.repeat(packet(2)), fps=200)
        sensor.open()
        assert numbers([sensor.read()]) == [2]


def test_options_that_cannot_be():
    with pytest.raises(ConfigError, match="rows=0 columns=32"):
        FlexiTac(rows=0)
    with pytest.raises(ConfigError, match="has no port"):
        FlexiTac().open()
    with pytest.raises(SensorError, match=r"no flexitac \(dead:beef\) is attached"):
        FlexiTac(usb="dead:beef").open()


def test_conformance(pad):
    pad.play(itertools.repeat(packet(7)), fps=300)
    results = check("sensor", "flexitac", port=pad.port, baseline=5)
    statuses = {result.name: result.status for result in results}
    assert statuses.pop("discover with nothing attached gives nothing") == "skipped"
    assert set(statuses.values()) == {"ran"}


def test_conformance_with_nothing_attached():
    statuses = {result.name: result.status for result in check("sensor", "flexitac")}
    assert statuses["discover with nothing attached gives nothing"] == "ran"
    assert statuses["frames are as specified"] == "skipped"
    assert "failed" not in statuses.values()
