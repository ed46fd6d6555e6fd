"""Impossible values, and jumps of one packet, are dropped and counted; true jumps are kept."""

import struct
from typing import Any

import numpy as np
import pytest
from tactileforge_arrays import SerialArray

from tactileforge.errors import ConfigError
from tactileforge.sensors.drivers.force_torque import ForceTorque
from tactileforge.sensors.framing import CHECKSUMS
from tactileforge.sensors.stream import StreamSensor
from tactileforge.testing.clock import FakeTime


def given(sensor: StreamSensor, packets: list[bytes]) -> list[np.ndarray[Any, Any]]:
    """Raw values of all packets, one after the other."""
    parser = sensor.new_parser()
    sensor.parser = parser
    for packet in packets:
        sensor.take(parser, packet)
    return [np.ravel(frame.raw) for frame in sensor._frames]


def pad(*values: float) -> list[bytes]:
    """Packets of four taxels of one value each, and the header of one more."""
    return [b"\xaa\x55" + struct.pack("<4f", *[value] * 4) for value in values] + [b"\xaa\x55"]


def array(**options: Any) -> SerialArray:
    return SerialArray(shape=(2, 2), payload="<4f", span=100.0, fps=50.0, **options)


def firsts(found: list[np.ndarray[Any, Any]]) -> list[float]:
    return [float(values[0]) for values in found]


def test_a_packet_that_jumps_and_comes_back_is_dropped_and_counted() -> None:
    sensor = array()
    assert firsts(given(sensor, pad(1, 2, 500, 3, 4))) == [1, 2, 3, 4]
    assert sensor.drops == {"implausible": 0, "jumped": 1}


def test_a_true_jump_loses_nothing() -> None:
    sensor = array()
    assert firsts(given(sensor, pad(1, 2, 500, 510, 2, 1))) == [1, 2, 500, 510, 2, 1]
    assert sensor.drops["jumped"] == 0


def test_one_packet_alone_is_not_believed() -> None:
    assert given(array(), pad(500)) == []
    assert firsts(given(array(), pad(500, 501))) == [500, 501]


def test_the_rate_of_change_is_an_option_and_grows_with_time(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    clock = FakeTime()
    monkeypatch.setattr("tactileforge.sensors.stream.time", clock)
    slow, free = array(rate=50.0), array(rate=0)  # 1 a packet at 50 a second
    assert firsts(given(slow, pad(1, 2, 3.5, 3))) == [1, 2, 3]
    assert firsts(given(free, pad(1, 2, 3.5, 900))) == [1, 2, 3.5, 900]
    late = array(rate=50.0)
    parser = late.new_parser()
    late.take(parser, b"".join(pad(1, 2)))
    clock.sleep(0.2)
    late.take(parser, b"".join(pad(9))[2:])  # 7 in at least 0.2 s: less than 50 a second
    assert firsts([np.ravel(frame.raw) for frame in late._frames]) == [1, 2, 9]


def test_values_out_of_limits_are_dropped_and_counted() -> None:
    sensor = array(limits=[0, 60])
    assert firsts(given(sensor, pad(1, 2, 61, -1, float("nan"), 3))) == [1, 2, 3]
    assert sensor.drops == {"implausible": 3, "jumped": 0}


@pytest.mark.parametrize("value", [1e-8, 1e9, 1e-40, float("inf")])
def test_without_limits_sizes_agree_with_the_span(value: float) -> None:
    sensor = array(rate=0)
    assert firsts(given(sensor, pad(0, value, 5))) == [0, 5]
    assert sensor.drops["implausible"] == 1


def test_a_checksum_is_believed() -> None:
    bodies = [b"\xaa\x55" + struct.pack("<4f", *[value] * 4) for value in (1.0, 900.0, 2.0)]
    sensor = array(checksum="crc8")
    packets = [body + CHECKSUMS["crc8"].of(body) for body in bodies]
    assert firsts(given(sensor, packets)) == [1, 900, 2]


def wrenches(*newtons: float) -> list[bytes]:
    packets = [b"\xaa\x55" + struct.pack("<6f", n, 0, -n, 0, 0.5, 0) for n in newtons]
    return [*packets, b"\xaa\x55"]


def test_a_wrench_that_jumps_or_cannot_be_is_dropped_and_counted() -> None:
    sensor = ForceTorque(most=(500.0, 20.0))
    found = given(sensor, wrenches(1, 2, 60, 3, 501, 4, 1e-30, 70, 75))
    assert firsts(found) == [1, 2, 3, 4, 70, 75]
    assert sensor.drops == {"implausible": 2, "jumped": 1}


def test_limits_that_cannot_be() -> None:
    for limits in ([1], [2, 1], [0, 0]):
        with pytest.raises(ConfigError, match="give the lowest and the highest"):
            array(limits=limits)
    for most in ([1], [0, 5]):
        with pytest.raises(ConfigError, match="give a force"):
            ForceTorque(most=most)
