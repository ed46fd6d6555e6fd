"""The driver against a simulated board, byte by byte over a pseudo-terminal."""

import itertools
import random
import struct

import numpy as np
import pytest
from tactileforge_anyskin.sensor import AnySkin, ReSkin

from tactileforge.errors import ConfigError, SensorError
from tactileforge.testing import check
from tactileforge.testing.clock import FakeTime, TimedLink
from tactileforge.testing.emulators import Faults, PtyDevice, chunks, read_until_silent

#: One magnetometer at 25 degrees: x 1.5, y -2, z 100.25 microtesla.
VECTOR = bytes.fromhex("0000c841 0000c03f 000000c0 0080c842 0d0a")


def packet(number=0.0, z=100.25):
    """A packet of five magnetometers; the x of all is the packet's number."""
    return struct.pack("<20f", *[25.0, number, -2.0, z] * 5) + b"\r\n"


def noisy_packets(count, seed=0):
    """Packets of noisy fields; the x of the first magnetometer is the packet's number."""
    rng = random.Random(seed)
    values = [rng.uniform(-900, 900) for _ in range(20)]
    for number in range(count):
        walk = [min(max(value + rng.uniform(-90, 90), -900), 900) for value in values]
        values = [value if i % 4 else rng.uniform(20, 40) for i, value in enumerate(walk)]
        yield struct.pack("<20f", values[0], number, *values[2:]) + b"\r\n"


def numbers(frames):
    return [round(float(frame.raw[0, 1])) for frame in frames]


def timed(monkeypatch, packets, fps, delay=0.0):
    """An AnySkin with packet times of a simulated clock."""
    clock = FakeTime()
    for module in ("tactileforge.sensors.stream", "tactileforge_arrays.serial_array"):
        monkeypatch.setattr(f"{module}.time", clock)
    link = TimedLink(clock, packets, fps, delay)
    monkeypatch.setattr(AnySkin, "connect", lambda self: link)
    return clock


@pytest.fixture
def board():
    with PtyDevice() as device:
        yield device


def test_the_known_packet(board):
    with AnySkin(port=board.port, positions=[[0, 0]], shape=[1, 1], baseline=0) as sensor:
        board.write(VECTOR * 3)
        frame = sensor.read()
        assert frame.raw.tolist() == [[25.0, 1.5, -2.0, 100.25]]
        assert sensor.read().time > frame.time
        assert sensor.parser.lost == len(VECTOR)  # the first one has no footer before it


def test_a_packet_of_five_has_82_bytes():
    assert AnySkin().framing.payload + 2 == len(packet()) == 82


@pytest.fixture
def patient(monkeypatch):
    """Disables the limit of stale bytes: a busy machine must not change results."""
    monkeypatch.setattr("tactileforge_anyskin.sensor.STALE", 1_000_000)


@pytest.mark.parametrize("faults", [Faults(), Faults(split=1), Faults(split=31, merge=3)])
def test_split_and_merged_packets_all_come(board, patient, faults):
    with AnySkin(port=board.port, baseline=0) as sensor:
        board.play(noisy_packets(150), faults=faults)
        found = numbers(read_until_silent(sensor, 0.8, board))
    assert found == list(range(1, 150))


def test_a_start_in_the_middle_and_line_ends_inside_of_floats(board, patient):
    """The footer's two bytes occur in the z of all magnetometers, always at the same places."""
    false_end = struct.unpack("<f", b"\x0d\x0a\x48\x43")[0]
    z = pytest.approx(false_end)
    packets = [packet(number, z=false_end) for number in range(40)]
    assert packets[0].count(b"\r\n") == 6
    with AnySkin(port=board.port, baseline=0) as sensor:
        board.play([packets[0][7:], *packets[1:]])
        frames = read_until_silent(sensor, 0.8, board)
    assert numbers(frames) == list(range(1, 40))
    assert all(frame.raw[0].tolist() == [25.0, i, -2.0, z] for i, frame in enumerate(frames, 1))


def test_lost_bytes_and_garbage_cost_packets_and_never_give_wrong_ones(board, patient):
    faults = Faults(lose=0.001, garbage=0.05, split=33, seed=1)
    sent = list(noisy_packets(300))
    written = b"".join(itertools.chain(*chunks(sent, faults)))
    whole = [i for i in range(300) if sent[i] in written]
    with AnySkin(port=board.port, baseline=0) as sensor:
        board.play(sent, faults=faults)
        frames = read_until_silent(sensor, 0.8, board)
    true = {struct.unpack("<20f", one[:-2]) for one in sent}
    assert all(tuple(frame.raw.ravel().tolist()) in true for frame in frames)
    assert set(numbers(frames)) <= set(whole)
    assert len(frames) > 0.8 * len(whole)
    assert numbers(frames) == sorted(numbers(frames))


@pytest.mark.parametrize("bad", [float("nan"), float("inf"), -21.0, 101.0])
def test_values_that_cannot_be(bad):
    good = struct.pack("<20f", *[25.0, 0.0, 2.0, -3.0] * 5)
    assert AnySkin().plausible(good)
    for field in (2e5, 1e-20):
        assert not AnySkin().plausible(good[:-4] + struct.pack("<f", field))
    assert not AnySkin().plausible(struct.pack("<f", bad) + good[4:])


def test_a_million_random_bytes_give_no_frame():
    sensor = AnySkin()
    parser = sensor.new_parser()
    rng = random.Random(0)
    found = [p for _ in range(1000) for p in parser.feed(rng.randbytes(1000))]
    assert found == []
    assert parser.lost + parser.waiting == 1_000_000


def test_what_has_waited_too_long_is_thrown_away(board):
    with AnySkin(port=board.port, baseline=0) as sensor:
        board.write(b"".join(noisy_packets(49)))  # 4018 bytes
        while sensor._link._port.in_waiting < 4018:
            pass  # bytes take a while from one end of the line to the other
        with pytest.raises(TimeoutError):
            sensor.read(0.05)
        assert sensor._link.stale >= 4000
        board.play([packet(500 + i) for i in range(5)], fps=200)
        assert numbers(read_until_silent(sensor, 0.8, board))[-1] == 504


def test_baseline_picture_and_rate(monkeypatch):
    """The first magnetometer is drawn in the middle; x, y and z are red, green and blue."""
    timed(monkeypatch, itertools.chain([packet()] * 60, itertools.repeat(packet(250.0))), fps=40)
    with AnySkin(baseline=20, span=500.0) as sensor:
        assert sensor.rest[0].tolist() == [25.0, 0.0, -2.0, 100.25]
        assert sensor.spec.fps == pytest.approx(40)  # 100 unless measured
        first = sensor.read()
        assert (first.array == 128).all()
        while (last := sensor.read()).raw[0, 1] == 0:
            pass
    assert last.array.shape == (3, 3, 3)
    assert last.array[1, 1].tolist() == [round(128 + 127 / 2), 128, 128]


def test_unplugged_and_back(board):
    sensor = AnySkin(port=board.port, baseline=5)
    board.play(itertools.repeat(packet()), fps=300)
    with sensor:
        sensor.read()
        board.disconnect()
        with pytest.raises(SensorError, match="unplugged"):
            read_until_silent(sensor, 0.8)
        with pytest.raises(SensorError, match="no such serial port"):
            sensor.open()
        board.connect()
        board.play(map(packet, itertools.count()), fps=300)
        sensor.open()
        assert sensor.read().raw[0, 1] >= 5


def test_a_board_that_is_silent(board, monkeypatch):
    monkeypatch.setattr("tactileforge_arrays.serial_array._PATIENCE", 0.1)
    with pytest.raises(SensorError, match="needs 30 packets, 0 came"):
        AnySkin(port=board.port).open()


def test_options_that_cannot_be():
    with pytest.raises(ConfigError, match="lies outside the picture"):
        AnySkin(positions=[[3, 0]])
    with pytest.raises(ConfigError, match="has no port"):
        AnySkin().open()
    with pytest.raises(SensorError, match=r"no reskin \(dead:beef\) is attached"):
        ReSkin(usb="dead:beef").open()


@pytest.mark.parametrize("name", ["anyskin", "reskin"])
def test_conformance(board, name):
    board.play(noisy_packets(100_000), fps=300)
    results = {result.name: result for result in check("sensor", name, port=board.port, baseline=5)}
    assert results.pop("discover with nothing attached gives nothing").status == "skipped"
    assert {result.status for result in results.values()} == {"ran"}, results


def test_conformance_with_nothing_attached():
    statuses = {result.name: result.status for result in check("sensor", "anyskin")}
    assert statuses["discover with nothing attached gives nothing"] == "ran"
    assert statuses["frames are as specified"] == "skipped"
    assert "failed" not in statuses.values()


def test_the_types_have_their_own_names():
    assert (AnySkin().spec.name, ReSkin().spec.name) == ("anyskin", "reskin")
    assert np.shape(ReSkin().rest) == (5, 4)


def test_after_a_loss_the_baseline_stays(board):
    def play(z):
        board.play((packet(z=z + 0.01 * (i % 7)) for i in itertools.count()), fps=400)

    play(100.0)
    with AnySkin(port=board.port) as sensor:
        rest = sensor.rest.copy()
        board.halt()
        play(400.0)
        sensor.reopen()
        assert sensor.rest.tolist() == rest.tolist()
        sensor.open()  # opened again on purpose: takes a new zero
        assert sensor.rest[0, 3] == pytest.approx(400.0, abs=0.1)


def test_the_rate_is_that_of_the_packets_and_not_of_a_board_that_boots(monkeypatch):
    packets = (packet(z=0.01 * (i % 7)) for i in itertools.count())
    timed(monkeypatch, packets, fps=200, delay=1.0)
    with AnySkin() as sensor:
        assert sensor.spec.fps == pytest.approx(200)
