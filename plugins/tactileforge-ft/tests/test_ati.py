"""The driver against a simulated Net F/T: its page over HTTP, its records over UDP."""

import itertools
import random
import struct
import threading
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, HTTPServer

import pytest
from tactileforge_ft import ati
from tactileforge_ft.ati import AtiNetFT, request, settings

from tactileforge.errors import SensorError
from tactileforge.testing import check
from tactileforge.testing.emulators import UdpDevice

PAGE = (
    "<netft><prodname>Net F/T</prodname><cfgcpf>1000000</cfgcpf><cfgcpt>2000000</cfgcpt>"
    "<scfgfu>N</scfgfu><scfgtu>N-m</scfgtu><comrdtrate>500</comrdtrate></netft>"
)


def record(number, status=0, newton=1.0):
    """A record, big-endian: two sequence numbers, a status, six counts."""
    counts = [round(newton * 1_000_000 * i) for i in (1, -2, 3)] + [2_000_000, 0, -1_000_000]
    return struct.pack(">3I6i", number, 7 * number % 2**32, status, *counts)


@contextmanager
def website(page):
    class Handler(BaseHTTPRequestHandler):
        def do_GET(self):
            self.send_response(200 if self.path == "/netftapi2.xml" else 404)
            self.end_headers()
            self.wfile.write(page.encode())

        def log_message(self, *words):
            pass

    server = HTTPServer(("127.0.0.1", 0), Handler)
    thread = threading.Thread(target=server.serve_forever, args=(0.02,), daemon=True)
    thread.start()
    try:
        yield server.server_port
    finally:
        server.shutdown()
        server.server_close()
        thread.join()


@pytest.fixture
def device():
    with UdpDevice() as made:
        yield made


@pytest.fixture
def options(device):
    with website(PAGE) as http_port:
        yield {"host": device.host, "port": device.port, "http_port": http_port}


def test_requests_are_eight_bytes():
    assert request(ati.START) == bytes.fromhex("1234 0002 00000000")
    assert request(ati.STOP) == bytes.fromhex("1234 0000 00000000")
    assert request(ati.BIAS, 1) == bytes.fromhex("1234 0042 00000001")


def test_records_are_forces_and_torques(device, options):
    with AtiNetFT(**options) as sensor:
        assert device.wait_for_driver() == request(ati.START)
        assert len(record(1)) == 36
        device.write(record(1, newton=2.5))
        frame = sensor.read()
        assert frame.raw.tolist() == [2.5, -5.0, 7.5, 1.0, 0.0, -0.5]
        assert (frame.array.shape, sensor.spec.fps) == ((0, 0, 3), 500)
    assert device.wait_for_driver() == request(ati.STOP)


def test_bias_is_asked_for_first(device, options):
    with AtiNetFT(**options, bias=True):
        assert device.wait_for_driver() == request(ati.BIAS)
        assert device.wait_for_driver() == request(ati.START)


def test_after_a_loss_its_zero_stays(device, options):
    with AtiNetFT(**options, bias=True) as sensor:
        assert device.wait_for_driver() == request(ati.BIAS)
        assert device.wait_for_driver() == request(ati.START)
        sensor.close()
        assert device.wait_for_driver() == request(ati.STOP)
        sensor.reopen()
        assert device.wait_for_driver() == request(ati.START)


def test_lost_doubled_late_and_damaged_records(device, options):
    with AtiNetFT(**options) as sensor:
        device.wait_for_driver()
        for number in (1, 2, 5, 5, 4, 6):
            device.write(record(number, newton=number))
        device.write(record(7)[:-1])
        device.write(record(8) + b"\0")
        device.write(b"noise")
        device.write(record(9, newton=9))
        forces = [float(sensor.read().raw[0]) for _ in range(5)]
        assert forces == [1, 2, 5, 6, 9]
        assert sensor.missed == 2 + 2
        assert (sensor.parser.good, sensor.parser.bad) == (5, 5)


def test_a_record_far_ahead_does_not_hide_the_true_ones():
    sensor = AtiNetFT()
    sensor.scale[:] = 1e-6
    parser = sensor.parser = sensor.new_parser()
    for number in [1, 2, 1000, *range(3, 503), 2**31, 503]:
        sensor.take(parser, record(number))
    assert len(sensor._frames) == 503
    assert sensor.drops == {"implausible": 0, "jumped": 2}
    assert sensor.missed == 0


def test_a_long_gap_is_believed_when_the_next_record_goes_on(device, options):
    with AtiNetFT(**options) as sensor:
        device.wait_for_driver()
        for number in (1, 2, 1000, 1001, 1, 2):
            device.write(record(number, newton=number / 100))
        forces = [float(sensor.read().raw[0]) for _ in range(6)]
        assert forces == pytest.approx([0.01, 0.02, 10, 10.01, 0.01, 0.02])
        assert (sensor.missed, sensor.drops["jumped"]) == (997, 0)


def test_a_record_whose_force_cannot_be_or_jumps_is_dropped(device, options):
    with AtiNetFT(**options, most=(500.0, 20.0)) as sensor:
        device.wait_for_driver()
        for number, newton in enumerate((1, 2, 300, 40, 3, 4), 1):
            device.write(record(number, newton=newton))
        forces = [float(sensor.read().raw[0]) for _ in range(4)]
        assert forces == [1, 2, 3, 4]
        assert sensor.drops == {"implausible": 1, "jumped": 1}


def test_the_number_of_a_record_begins_anew_after_32_bits(device, options):
    with AtiNetFT(**options) as sensor:
        device.wait_for_driver()
        for number in (2**32 - 2, 2**32 - 1, 0, 2):
            device.write(record(number))
        for _ in range(4):  # the first waits for the second: a stream begins with 1
            sensor.read()
        assert sensor.missed == 1


def test_records_with_an_error_do_not_count(device, options):
    """Out of range is 0xC0000000 in the manual; the busy bit by itself is not an error."""
    with AtiNetFT(**options) as sensor:
        device.wait_for_driver()
        device.write(record(1, status=0xC0000000))
        with pytest.raises(TimeoutError, match="status 0xc0000000, an error"):
            sensor.read(0.1)
        device.write(record(2, status=0x00000008, newton=2))
        assert sensor.read().raw[0] == 2
        assert (sensor.parser.bad, sensor.missed) == (1, 0)


def test_silence_without_an_error(device, options):
    with AtiNetFT(**options) as sensor, pytest.raises(TimeoutError, match="no packet within"):
        sensor.read(0.05)


def test_gone_and_back(device, options):
    sensor = AtiNetFT(**options)
    with sensor:
        device.wait_for_driver()
        device.write(record(1))
        sensor.read()
        with pytest.raises(TimeoutError):
            sensor.read(0.05)
        sensor.open()
        while device.wait_for_driver() != request(ati.START):
            pass
        device.write(record(1, newton=3))
        assert sensor.read().raw[0] == 3
        assert sensor.missed == 0


def test_a_device_that_is_switched_off(device, options):
    with AtiNetFT(**options) as sensor:
        device.wait_for_driver()
        device.write(record(1))
        sensor.read()
        device.close()
        sensor._link.send(request(ati.START))  # the device is off: nobody receives it
        with pytest.raises(SensorError, match="gone"):
            sensor.read()


def test_a_device_without_a_page():
    with website(PAGE) as port:
        closed = AtiNetFT("127.0.0.1", http_port=port)
    with pytest.raises(SensorError, match=r"netftapi2\.xml: does not answer .*is host= right"):
        closed.open()


@pytest.mark.parametrize(
    ("unit", "newton"),
    [("N", 1.0), ("lbf", 4.44822), ("kN", 1000), ("kgf", 9.80665), ("klbf", 4448.22)],
)
def test_units_of_force(unit, newton):
    assert settings(PAGE.replace(">N<", f">{unit}<")).force == pytest.approx(newton / 1e6, rel=1e-5)


@pytest.mark.parametrize(
    ("unit", "metre"),
    [("N-m", 1), ("Nm", 1), ("N-mm", 0.001), ("lbf-in", 0.112985), ("lbf-ft", 1.355818)],
)
def test_units_of_torque(unit, metre):
    found = settings(PAGE.replace("N-m", unit)).torque
    assert found == pytest.approx(metre / 2e6, rel=1e-5)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (">N<", ">stone<", "scfgfu is 'stone'; set it to one of n, kn"),
        ("<cfgcpf>1000000</cfgcpf>", "", "cfgcpf is '', not a number"),
        ("1000000", "0", "cfgcpf is '0', not a number"),
    ],
)
def test_a_page_that_is_wrong(old, new, message):
    with pytest.raises(SensorError, match=message):
        settings(PAGE.replace(old, new, 1))


def test_a_million_random_bytes_are_no_record():
    """Datagrams of random size and content; also of the right size, and between true records."""
    sensor = AtiNetFT()
    sensor.scale[:] = 1e-6
    parser = sensor.new_parser()
    rng = random.Random(0)
    for size in (1, 8, 35, 37, 72, 1472):
        assert parser.feed(rng.randbytes(size)) == []
    for _ in range(28_000):
        sensor.take(parser, rng.randbytes(36))
    assert not sensor._frames
    for number in range(1, 1001):
        sensor.take(parser, record(number))
        sensor.take(parser, rng.randbytes(36))
    assert len(sensor._frames) == 1000


def serve(device, over):
    """Serves one driver after the other, at 500 records a second."""
    streams, numbers = False, itertools.count(1)
    while not over.is_set():
        try:
            said = device.wait_for_driver(0.002)
            streams, numbers = said == request(ati.START), itertools.count(1)
        except TimeoutError:
            if streams:
                device.write(record(next(numbers)))


def test_conformance(device, options):
    over = threading.Event()
    thread = threading.Thread(target=serve, args=(device, over), daemon=True)
    thread.start()
    results = check("sensor", "ati_netft", **options)
    over.set()
    thread.join()
    assert {result.status for result in results} == {"ran"}, results


def test_conformance_with_nothing_attached(monkeypatch):
    def refuse(page, timeout=3.0):
        raise SensorError("does not answer")

    monkeypatch.setattr(ati, "fetch", refuse)
    statuses = {result.name: result.status for result in check("sensor", "ati_netft")}
    assert statuses["frames are as specified"] == "skipped"
    assert "failed" not in statuses.values()
