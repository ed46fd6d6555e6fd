"""Packet sensors, against absent devices and bad lines."""

import itertools
import math
import random
import struct

import numpy as np
import pytest
from tactileforge_arrays import SerialArray
from tactileforge_sim.sensors.sim_wrench import SimWrench
from waiting import wait_until

from tactileforge.errors import ConfigError, SensorError, TactileForgeError
from tactileforge.sensors.checksums import CHECKSUMS
from tactileforge.sensors.drivers.force_torque import ForceTorque
from tactileforge.sensors.links import TcpLink, serial_ports
from tactileforge.sensors.stream import Stamper
from tactileforge.testing import check
from tactileforge.testing.emulators import (
    Faults,
    PtyDevice,
    TcpDevice,
    UdpDevice,
    chunks,
    read_until_silent,
)

CRC = CHECKSUMS["crc16_modbus"]


def wrench_packet(number):
    """A packet with its number as forces, and its negative hundredth as torques."""
    body = b"\x20\x4e" + struct.pack("<6h", *[number] * 3, *[-number] * 3)
    return body + CRC.of(body)


def wrench_sensor(**options):
    scale = [1, 1, 1, 0.01, 0.01, 0.01]
    return ForceTorque(
        payload="<6h", scale=scale, header="204e", checksum="crc16_modbus", **options
    )


def numbers(frames):
    return [round(float(frame.raw[0])) for frame in frames]


@pytest.fixture
def pty():
    with PtyDevice() as device:
        yield device


@pytest.mark.parametrize("faults", [Faults(), Faults(split=1), Faults(split=5, merge=3)])
def test_split_and_merged_packets_all_come(pty, faults):
    with wrench_sensor(port=pty.port) as sensor:
        pty.play(map(wrench_packet, range(200)), faults=faults)
        frames = read_until_silent(sensor, device=pty)
        assert numbers(frames) == list(range(200))
        assert frames[7].raw == pytest.approx([7, 7, 7, -0.07, -0.07, -0.07])
        assert frames[0].array.shape == (0, 0, 3)
        assert (sensor.parser.bad, sensor.parser.lost) == (0, 0)
    assert (np.diff([frame.time for frame in frames]) > 0).all()


def test_lost_bytes_and_garbage_cost_packets_and_never_give_wrong_ones(pty):
    faults = Faults(lose=0.01, garbage=0.2, split=7, seed=3)
    written = b"".join(itertools.chain(*chunks(map(wrench_packet, range(500)), faults)))
    whole = [i for i in range(500) if wrench_packet(i) in written]
    assert 400 < len(whole) < 450
    with wrench_sensor(port=pty.port) as sensor:
        pty.play(map(wrench_packet, range(500)), faults=faults)
        found = numbers(read_until_silent(sensor, device=pty))
        counts = sensor.parser
        assert found == whole
        assert counts.good == len(whole)
        assert counts.lost == len(written) - 16 * len(whole) - counts.waiting


def test_a_device_that_is_unplugged_is_an_error_and_works_again_when_it_is_back(pty):
    sensor = wrench_sensor(port=pty.port)
    with sensor:
        pty.play(map(wrench_packet, itertools.count()), fps=500)
        assert numbers([sensor.read()]) == [0]
        pty.disconnect()
        with pytest.raises(SensorError, match=r"unplugged .*plug it in again"):
            read_until_silent(sensor, device=pty)  # what has come already, and then
        sensor.close()
        with pytest.raises(SensorError, match="no such serial port"):
            sensor.open()
        pty.connect()
        sensor.open()
        pty.play(map(wrench_packet, range(50, 60)))
        assert numbers(read_until_silent(sensor, device=pty)) == list(range(50, 60))


def test_drops_are_counted_on_when_a_device_is_opened_again(pty):
    sensor = wrench_sensor(port=pty.port)
    for number in (1, 2):
        with sensor:
            body = bytearray(wrench_packet(5))
            body[4] ^= 1
            pty.write(bytes(body) + wrench_packet(6))
            assert numbers(read_until_silent(sensor)) == [6]
        assert sensor.drops == {"implausible": number, "jumped": 0}


def test_a_port_that_is_taken_is_an_error(pty):
    with wrench_sensor(port=pty.port) as first:
        assert first.address.startswith("/dev/pts/")
        with pytest.raises(SensorError, match="is another program using it"):
            wrench_sensor(port=pty.port).open()


def test_silence_says_what_came_instead(pty):
    with wrench_sensor(port=pty.port) as sensor:
        with pytest.raises(TimeoutError, match=r"within 0\.05 s; is it on"):
            sensor.read(0.05)
        pty.write(bytes(100))
        wait_until(lambda: sensor._link._port.in_waiting == 100)
        with pytest.raises(TimeoutError, match="99 bytes came that are not packets"):
            sensor.read(0.05)


def test_a_request_is_sent_and_a_farewell(pty):
    with wrench_sensor(port=pty.port, request="0102", farewell="03") as sensor:
        assert sensor.discover() == [pty.port]
        wait_until(lambda: pty.poll() == b"\x01\x02")
    wait_until(lambda: pty.poll() == b"\x01\x02\x03")


def test_a_wrench_over_udp():
    with UdpDevice() as device:
        port = f"{device.host}:{device.port}"
        options = {"link": "udp", "payload": ">3I6i", "scale": [1e-6] * 6, "request": "1234"}
        with ForceTorque(port=port, **options, farewell="00") as sensor:
            assert device.wait_for_driver() == b"\x12\x34"
            good = struct.pack(">3I6i", 1, 2, 0, *range(1_000_000, 7_000_000, 1_000_000))
            for datagram in (good, good[:-1], good):
                device.write(datagram)
            frames = [sensor.read(), sensor.read()]
            assert frames[1].raw == pytest.approx([1, 2, 3, 4, 5, 6])
            assert (sensor.parser.good, sensor.parser.bad) == (2, 1)
            assert sensor.drops == {"implausible": 1, "jumped": 0}
        assert device.wait_for_driver() == b"\x00"


def test_a_wrench_over_tcp_and_the_end_of_the_connection():
    with TcpDevice() as device:
        with wrench_sensor(port=f"{device.host}:{device.port}", link="tcp") as sensor:
            device.play(map(wrench_packet, range(30)), faults=Faults(split=11))
            assert numbers(read_until_silent(sensor, device=device)) == list(range(30))
            device.disconnect()
            with pytest.raises(SensorError, match="has ended the connection"):
                sensor.read()
        device.close()
        with pytest.raises(SensorError, match="does not answer"):
            TcpLink(device.host, device.port)


def taxel_packet(values):
    return b"\xaa\x55" + bytes(values)


def test_an_array_takes_its_baseline_and_shows_what_changes(pty):
    rest = [20, 30, 40, 50, 60, 70]
    pressed = [20, 30, 40, 50, 60, 170]
    options = {"shape": (2, 3), "payload": "6B", "span": 127, "fps": 200, "baseline": 15}
    packets = [taxel_packet(rest)] * 40 + [taxel_packet(pressed)] * 40 + [taxel_packet(rest)]
    pty.play(packets, fps=200)
    with SerialArray(port=pty.port, **options) as sensor:
        assert sensor.rest[:, 0].tolist() == rest
        frames = read_until_silent(sensor, device=pty)
    assert frames[0].array.dtype == np.uint8
    assert frames[0].raw.shape == (6, 1)
    assert (frames[0].array == 128).all()
    middle = next(frame for frame in frames if frame.raw[5, 0] == 170)
    assert middle.array[..., 2].tolist() == [[128, 128, 128], [128, 128, 228]]


def test_magnetometers_without_header_or_checksum_keep_all_their_values(pty):
    """Five chips of t, x, y, z as floats and a footer; what a stream of them looks like."""
    rng = random.Random(0)
    field = itertools.accumulate(rng.uniform(-90, 90) for _ in range(180))
    sent = [[25.0, *itertools.islice(field, 3)] * 5 for _ in range(60)]
    packets = [struct.pack("<20f", *values) + b"\r\n" for values in sent]
    options = {"payload": "<20f", "header": "", "footer": "0d0a", "values": 4, "baseline": 0}
    places = [[1, 1], [0, 1], [1, 0], [1, 2], [2, 1]]
    sensor = SerialArray(
        port=pty.port, shape=(3, 3), positions=places, channels=[1, 2, 3], span=900, **options
    )
    with sensor:
        pty.play([packets[0][30:], *packets[1:]], faults=Faults(split=50))
        frames = read_until_silent(sensor, device=pty)
    assert len(frames) >= 57
    assert frames[-1].raw == pytest.approx(np.reshape(sent[-1], (5, 4)), rel=1e-6)
    centre = np.round(128 + 127 / 900 * np.array(sent[-1][1:4])).clip(1, 255)
    assert frames[-1].array[1, 1].tolist() == centre.tolist()


def test_an_array_without_packets_says_so_when_it_is_opened(pty, monkeypatch):
    monkeypatch.setattr("tactileforge_arrays.serial_array._PATIENCE", 0.1)
    with pytest.raises(SensorError, match="needs 30 packets, 0 came"):
        SerialArray(port=pty.port).open()


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"payload": "<15H"}, "15 values, but 16 taxels of 1 are 16"),
        ({"payload": "16Z"}, "payload='16Z'"),
        ({"channels": [1]}, "a taxel has 1 values: 0 to 0"),
        ({"header": "xy"}, "header='xy' is not hexadecimal"),
        ({"type": "arry"}, "unknown sensor 'arry'"),
    ],
)
def test_arrays_that_cannot_be(given, message):
    with pytest.raises(ConfigError, match=message):
        SerialArray(**given)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"link": "can"}, "link='can': give serial, udp, tcp"),
        ({"scale": [1.0]}, "scale has 1 numbers"),
        ({"payload": "<5f"}, "carries 5 values: a wrench has six"),
        ({"request": "0"}, "request='0' is not hexadecimal"),
    ],
)
def test_wrench_sensors_that_cannot_be(given, message):
    with pytest.raises(ConfigError, match=message):
        ForceTorque(**given)


def test_addresses_that_are_none():
    with pytest.raises(ConfigError, match="has no port"):
        ForceTorque().open()
    with pytest.raises(ConfigError, match="give HOST:PORT"):
        ForceTorque(link="udp", port="192.168.1.1").open()
    with pytest.raises(SensorError, match=r"no serial_array \(dead:beef\) is attached"):
        SerialArray(usb="dead:beef").open()
    assert serial_ports(usb="dead:beef") == []


def test_reading_a_closed_sensor_is_an_error():
    with pytest.raises(TactileForgeError, match="not open"):
        SerialArray().read()


@pytest.mark.parametrize("name", ["serial_array", "force_torque"])
def test_conformance_without_a_device(name):
    statuses = {result.name: result.status for result in check("sensor", name)}
    assert statuses["frames are as specified"] == "skipped"
    assert statuses["read before open raises"] == "ran"
    assert "failed" not in statuses.values()


@pytest.mark.slow
def test_conformance_of_a_live_array(pty):
    packets = itertools.repeat(taxel_packet(range(6)))
    options = {"shape": (2, 3), "payload": "6B", "baseline": 3}
    pty.play(packets, fps=300)
    results = check("sensor", "serial_array", port=pty.port, **options)
    statuses = {result.name: result.status for result in results}
    assert statuses.pop("discover with nothing attached gives nothing") == "skipped"
    assert set(statuses.values()) == {"ran"}


def test_conformance_of_the_simulated_wrench():
    statuses = {result.name: result.status for result in check("sensor", "sim_wrench")}
    assert statuses.pop("discover with nothing attached gives nothing") == "skipped"
    assert set(statuses.values()) == {"ran"}


def test_the_simulated_wrench_is_a_press_at_its_rate():
    with SimWrench(fps=200, newton=4.0, period=1.0, bias=0.5, rest=0) as sensor:
        frames = [sensor.read() for _ in range(21)]
        start = sensor.start
    assert np.diff([frame.time for frame in frames]) == pytest.approx([1 / 200] * 20)
    for frame in frames:
        phase = frame.time - start
        assert frame.raw[2] == pytest.approx(
            0.5 + 2 * (1 - math.cos(2 * math.pi * phase)), abs=1e-5
        )
    with pytest.raises(ConfigError, match="above 0"):
        SimWrench(period=0)


def test_packets_that_arrive_together_are_a_period_apart():
    stamper = Stamper(0.001)
    assert stamper.stamp(3, 10.0) == pytest.approx([9.998, 9.999, 10.0])
    later = stamper.stamp(4, 10.001)  # more than fit: still one after the other
    assert (np.diff([10.0, *later]) > 0).all()
    assert later[-1] == pytest.approx(10.001)
    assert stamper.stamp(0, 11.0) == []
