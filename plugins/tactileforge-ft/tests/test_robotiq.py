"""The driver against a simulated FT 300, over a pseudo-terminal."""

import random
import struct
import threading
import time

import numpy as np
import pytest
from tactileforge_ft import modbus, robotiq
from tactileforge_ft.robotiq import Robotiq

from tactileforge.errors import ConfigError, SensorError
from tactileforge.sensors.checksums import CHECKSUMS
from tactileforge.testing import check
from tactileforge.testing.emulators import Faults, PtyDevice, chunks, read_until_silent

START = bytes.fromhex("0910 019a 0001 02 0200")
ACCEPTED = bytes.fromhex("0910 019a 0001")


def checked(body):
    return body + CHECKSUMS["crc16_modbus"].of(body)


def packet(number):
    """A packet of forces in hundredths of a newton, torques in thousandths of a newton metre."""
    return checked(b"\x20\x4e" + struct.pack("<6h", number, -number, 7, number, -number, 11))


class Ft300(PtyDevice):
    """A simulated FT 300: streams on request, until fifty 0xFF end it.

    Args:
        streams: Whether it streams at first, as left on by another program.
        answer: Answer to a request, without checksum; b"" for no answer.
        faults: Faults of its packets.
        packets: Number of packets to send; then it is silent.
    """

    def __init__(self, streams=False, answer=ACCEPTED, faults=None, packets=10**9):
        super().__init__()
        self.streams, self.answer, self.left = streams, answer, packets
        self.faults = faults or Faults()
        self._sent = False
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self._thread.start()

    def _serve(self):
        taken = 0
        stream = chunks(map(packet, range(self.left)), self.faults)
        while not self._over.wait(0.002):
            taken += self._obey(self.poll()[taken:])
            if self.streams:
                writes = next(stream, None)
                self._sent = writes is None
                for data in writes or ():
                    self.write(data)

    def _obey(self, said):
        request = checked(START)
        if said.startswith(request):
            self.streams = bool(self.answer) and not self.answer[1] & 0x80
            self.write(checked(self.answer) if self.answer else b"")
            return len(request)
        interrupts = len(said) - len(said.lstrip(b"\xff"))
        if interrupts >= 50:
            self.streams = False
        return interrupts if interrupts >= 50 or interrupts < len(said) else 0

    @property
    def is_playing(self):
        return not self._sent

    def disconnect(self):
        self._over.set()
        if threading.current_thread() is not self._thread:
            self._thread.join(60)
        super().disconnect()


@pytest.fixture(autouse=True)
def _quick(monkeypatch):
    monkeypatch.setattr(robotiq, "PAUSE", 0.0005)


def numbers(frames):
    return [round(float(frame.raw[0]) * 100) for frame in frames]


def test_modbus_messages_are_those_of_the_manuals():
    """Messages from the manuals of the same maker's grippers; those print whole messages."""
    request = modbus.write_request(9, 0x03E8, [0x0100, 0, 0])
    assert request == bytes.fromhex("0910 03e8 0003 06 0100 0000 0000 72e1")
    assert modbus.write_reply(9, 0x03E8, 3) == bytes.fromhex("0910 03e8 0003 0130")
    assert modbus.write_request(9, 410, [0x0200]) == checked(START)


def test_a_stream_is_asked_for_and_ended():
    with Ft300() as device:
        with Robotiq(port=device.port) as sensor:
            frame = sensor.read()
            assert device.streams
            assert frame.array.shape == (0, 0, 3)
            assert frame.raw.dtype == np.float32
            assert frame.raw[[2, 5]] == pytest.approx([0.07, 0.011])
            later = sensor.read()
            number = numbers([later])[0]
            assert later.raw / number == pytest.approx(
                [0.01, -0.01, 0.07 / number, 0.001, -0.001, 0.011 / number]
            )
        end = time.monotonic() + 60
        while device.streams and time.monotonic() < end:
            time.sleep(0.01)
        assert bytes(device.received) == b"\xff" * 50 + checked(START) + b"\xff" * 50


def test_a_stream_that_another_program_left_is_ended_first():
    with Ft300(streams=True) as device, Robotiq(port=device.port) as sensor:
        found = numbers([sensor.read() for _ in range(20)])
        assert found == list(range(found[0], found[0] + 20))


@pytest.mark.parametrize("faults", [Faults(split=1), Faults(split=5, merge=3)])
def test_split_and_merged_packets_all_come(faults):
    with Ft300(faults=faults, packets=60) as device, Robotiq(port=device.port) as sensor:
        frames = read_until_silent(sensor, 0.8, device)
        assert numbers(frames) == list(range(60))
        assert sensor.parser.bad == 0
    assert (np.diff([frame.time for frame in frames]) > 0).all()


def test_lost_bytes_and_garbage_cost_packets_and_never_give_wrong_ones():
    faults = Faults(lose=0.01, garbage=0.2, split=7, seed=3)
    written = b"".join(
        data for writes in chunks(map(packet, range(200)), faults) for data in writes
    )
    whole = [i for i in range(200) if packet(i) in written]
    assert 150 < len(whole) < 190
    with Ft300(faults=faults, packets=200) as device, Robotiq(port=device.port) as sensor:
        assert numbers(read_until_silent(sensor, 0.8, device)) == whole


def test_random_bytes_give_hardly_any_packet():
    """The header and the checksum of 16 bits agree once in 2^32 places."""
    parser = Robotiq().new_parser()
    rng = random.Random(0)
    assert [p for _ in range(1000) for p in parser.feed(rng.randbytes(1000))] == []
    assert parser.bad > 5
    assert parser.lost + parser.waiting == 1_000_000


def test_unplugged_and_back():
    with Ft300() as device:
        sensor = Robotiq(port=device.port)
        with sensor:
            sensor.read()
            device.disconnect()
            with pytest.raises(SensorError, match="unplugged"):
                read_until_silent(sensor, 0.8)
            with pytest.raises(SensorError, match="no such serial port"):
                sensor.open()
    with Ft300() as again:
        sensor.port = again.port
        with sensor:
            assert sensor.read().raw.shape == (6,)


def test_no_answer(monkeypatch):
    monkeypatch.setattr(robotiq, "TIMEOUT", 0.1)
    with Ft300(answer=b"") as device, pytest.raises(SensorError, match="has the sensor power"):
        Robotiq(port=device.port).open()


def test_an_answer_that_refuses():
    answer = bytes.fromhex("0990 02")
    with Ft300(answer=answer) as device, pytest.raises(SensorError, match="Modbus exception 2"):
        Robotiq(port=device.port).open()


def test_without_a_port():
    with pytest.raises(ConfigError, match="has no port"):
        Robotiq().open()


def test_conformance():
    with Ft300() as device:
        results = check("sensor", "robotiq", port=device.port)
    statuses = {result.name: result.status for result in results}
    assert statuses.pop("discover with nothing attached gives nothing") == "skipped"
    assert set(statuses.values()) == {"ran"}, results


def test_conformance_with_nothing_attached():
    statuses = {result.name: result.status for result in check("sensor", "robotiq")}
    assert statuses["discover with nothing attached gives nothing"] == "ran"
    assert "failed" not in statuses.values()
