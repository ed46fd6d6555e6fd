"""State and actions of a robot, recorded with touch, for training a policy."""

import socket
import struct
from pathlib import Path

import numpy as np
import pytest
from tactileforge_live.record.raw import read_raw
from tactileforge_live.record.record import record
from tactileforge_live.record.samples import robot_tracks
from tactileforge_sim.sensors.sim_robot import SimRobot
from tactileforge_sim.sensors.sim_wrench import SimWrench

from tactileforge.datasets.shards import Shards
from tactileforge.errors import ConfigError
from tactileforge.sensors.drivers.serial_robot import SerialRobot
from tactileforge.testing import check
from tactileforge.testing.emulators import Faults, PtyDevice


def quiet(line):
    pass


def test_the_state_is_that_before_the_command():
    """Samples at 10 Hz: state t and -t, command 100 t; frames in between, before and after."""
    times = np.arange(5) / 10
    values = np.stack([times, -times, 100 * times], 1).astype(np.float32)
    frames = np.array([-0.05, 0.0, 0.05, 0.1, 0.33, 0.4, 0.45])
    tracks = robot_tracks(frames, (times, values), 2, 0.1)
    inside = slice(1, 6)
    want = np.stack([frames, -frames], 1)
    np.testing.assert_allclose(tracks["state"][inside], want[inside], atol=1e-6)
    assert np.isnan(tracks["state"]).all(1).tolist() == [True, *[False] * 5, True]
    # the first command at or after a frame; before the first sample it answers what is shown, too
    want = [0.0, 0.0, 10.0, 10.0, 40.0, 40.0]
    np.testing.assert_allclose(tracks["robot_action"][:6, 0], want, atol=1e-5)
    assert np.isnan(tracks["robot_action"][6]).all()
    assert list(robot_tracks(frames, (times, values), 3, 0.1)) == ["state"]


def test_a_gap_of_the_robot_is_not_filled():
    times = np.array([0.0, 0.02, 0.9, 0.92])
    values = np.ones((4, 3), np.float32)
    tracks = robot_tracks(np.array([0.01, 0.5, 0.91]), (times, values), 2, 0.02)
    for track in tracks.values():
        assert np.isnan(track).all(1).tolist() == [False, True, False]
    none = robot_tracks(np.array([0.01]), (times[:0], values[:0]), 2, 0.02)
    assert np.isnan(none["state"]).all()
    assert none["robot_action"].shape == (1, 1)


def test_every_recording_of_a_take_carries_state_and_action(scripted, options):
    left, right = scripted(fps=60), scripted(fps=25, type="gelsight_mini")
    robot = SimRobot(joints=3, fps=100, period=0.7)
    given = options(text="wipe the board")
    record(given, {"left": left, "right": right}, SimWrench(fps=200), robot=robot, say=quiet)
    taken = {one.labels["device"]: one for one in Shards(given.out).recordings("train")}
    times, values = read_raw(Path(given.out) / "train-000000.tar")["robot"]
    assert values.shape == (len(times), 6)
    assert np.diff(times) == pytest.approx(1 / 100, abs=1e-9)
    for name, one in taken.items():
        episode = f"{Path(given.out).name}_00000"
        assert (one.labels["episode"], one.labels["finger"]) == (episode, name)
        assert one.tracks["state"].shape == one.tracks["robot_action"].shape == (len(one.times), 3)
        inside = (one.times >= times[0]) & (one.times <= times[-1])
        assert inside[1:-1].all()
        for joint in range(3):
            want = np.interp(one.times[inside], times, values[:, joint])
            assert one.tracks["state"][inside, joint] == pytest.approx(want, abs=1e-5)
            after = np.searchsorted(times, one.times[inside])
            want = values[after, 3 + joint]
            assert one.tracks["robot_action"][inside, joint] == pytest.approx(want, abs=1e-6)
        assert np.isfinite(one.force[1:-1]).all()


def test_commands_lead_the_state_of_the_simulated_robot():
    with SimRobot(joints=2, fps=200) as robot:
        raws = np.stack([robot.read().raw for _ in range(5)])
    np.testing.assert_allclose(raws[:-1, 2:], raws[1:, :2], atol=1e-6)


def packet(state, action):
    body = b"\xaa\x55" + struct.pack("<5f", *state, *action)
    return body + bytes([sum(body) & 0xFF])


def test_a_serial_arm_is_read_through_the_faults_of_a_line():
    sent = [([n * 0.1, 1.0, -1.0], [n, 0.5]) for n in range(60)]
    with PtyDevice() as device:
        arm = SerialRobot(device.port, payload="<5f", states=3, checksum="sum8", scale=[2.0])
        assert (arm.spec.kind, arm.spec.states, arm.spec.actions) == ("robot", 3, 2)
        with arm:
            packets = [packet(*one) for one in sent]
            device.play(packets, faults=Faults(split=3, garbage=0.3))
            raws = np.stack([arm.read().raw for _ in sent])
    want = 2 * np.array([[*state, *action] for state, action in sent])
    np.testing.assert_allclose(raws, want, rtol=1e-6)


def test_a_program_sends_datagrams_to_this_machine():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    arm = SerialRobot(f":{port}", link="udp", payload="<3d", states=2)
    with arm, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        for n in range(4):
            sender.sendto(struct.pack("<3d", n, -n, 10 * n), ("127.0.0.1", port))
        raws = np.stack([arm.read().raw for _ in range(3)])
    np.testing.assert_allclose(raws, [[n, -n, 10 * n] for n in range(3)])


def test_a_state_that_cannot_be_is_dropped_and_a_command_may_jump():
    arm = SerialRobot(payload="<2f", states=1, limits=[-10, 10], fps=5.0)
    sent = [(0.0, 0.0), (0.1, 9.0), (0.2, -9.0), (8.0, 0.0), (0.4, 0.0), (99.0, 0.0), (0.6, 0.0)]
    sent.append((0.7, 0.0))  # a packet counts when the header of the next has come
    with PtyDevice() as device:
        arm.port = device.port
        with arm:
            device.play([b"\xaa\x55" + struct.pack("<2f", *one) for one in sent])
            states = [float(arm.read().raw[0]) for _ in range(5)]
            drops = arm.drops
    assert states == pytest.approx([0.0, 0.1, 0.2, 0.4, 0.6])
    assert drops == {"implausible": 1, "jumped": 1}


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"states": 0}, "a robot has a state"),
        ({"payload": "<2f", "states": 3}, "carries 2 values: a robot has 3"),
        ({"scale": [1.0, 2.0]}, "give one, or 14"),
        ({"limits": [1, 1]}, "least and the largest"),
        ({"link": "usb"}, "give serial, udp, tcp"),
    ],
)
def test_options_of_an_arm_that_cannot_be(given, message):
    with pytest.raises(ConfigError, match=message):
        SerialRobot(**given)


@pytest.mark.parametrize(
    ("sensors", "robot", "message"),
    [
        ({"r": SimRobot()}, None, "r is a robot: choose it with robot=r"),
        ({"a": None}, SimWrench(), "robot=sim_wrench is no robot"),
        ({"robot": None}, SimRobot(), "no sensor can be called robot"),
    ],
)
def test_what_is_no_robot_is_named(scripted, options, sensors, robot, message):
    sensors = {name: sensor or scripted() for name, sensor in sensors.items()}
    with pytest.raises(ConfigError, match=message):
        record(options(), sensors, robot=robot, say=quiet)


@pytest.mark.parametrize("name", ["sim_robot", "serial_robot"])
def test_it_conforms(name):
    assert not [one for one in check("sensor", name) if one.status == "failed"]
