"""Records sensors, forces, a camera and a robot on one clock, straight to shards."""

from __future__ import annotations

import errno
import threading
from collections.abc import Callable, Mapping
from pathlib import Path

from tactileforge.contracts import Sensor
from tactileforge.errors import ConfigError, TactileForgeError, too_many_files, unknown
from tactileforge.sensors import calibration_labels, low_latency_threads, unit_of
from tactileforge_live.record.options import RecordOptions
from tactileforge_live.record.rig import Rig
from tactileforge_live.record.status import RecordStatus, RecordSummary
from tactileforge_live.record.store import TakeStore
from tactileforge_live.record.take import Take
from tactileforge_live.record.wrench import axes_matrix


def record(
    options: RecordOptions,
    sensors: Mapping[str, Sensor],
    force: Sensor | None = None,
    camera: Sensor | None = None,
    stop: threading.Event | None = None,
    say: Callable[[str], None] = print,
    status: RecordStatus | None = None,
    robot: Sensor | None = None,
) -> RecordSummary:
    """Records takes until their number is reached, the sources end, or ``stop`` is set.

    Args:
        options: Options of the recording.
        sensors: Cameras and arrays by name, not open; names become part of the recordings' keys.
        force: Wrench sensor; None for none.
        camera: Camera for views of the scene; None for none.
        stop: Event to end the recording; all data until then is written.
        say: Function for messages to the user, one line each.
        status: Status line; None for none.
        robot: Robot, for its state and actions as tracks of every recording; None for none.

    Raises:
        SensorError: A sensor cannot be opened, is lost, or is touched while the background is
            taken. Earlier data is kept.
        ConfigError: The folder holds something else, or the sensors or a calibration do not fit.
        DataNotFoundError: There is no such file of a calibration.
        TactileForgeError: The disk is full; says how much is safe.
    """
    stop = stop or threading.Event()
    summary = RecordSummary(0, 0.0, dict.fromkeys(sensors, 0), {}, 0)
    # before any device is opened, so that a wrong option is found first
    axes = (
        options.axes if isinstance(options.axes, Mapping) else dict.fromkeys(sensors, options.axes)
    )
    matrices = {name: axes_matrix(axes.get(name, ("x", "y", "z"))) for name in sensors}
    try:
        with (
            low_latency_threads(),
            TakeStore(Path(options.out), options.split) as store,
            Rig(sensors, force, camera, options, robot) as rig,
        ):
            for line in store.notes:
                say(line)
            # once the sensors are open: only then are their units known
            devices = {device.name: device.sensor for device in rig.devices}
            if strange := sorted(set(options.calibration) - set(devices)):
                raise ConfigError(unknown("sensor of calibration", strange[0], devices))
            known = {}
            for name, path in options.calibration.items():
                kind, unit = devices[name].spec.name, unit_of(devices[name])
                known[name] = calibration_labels(path, kind, unit)
            count = 0
            while not stop.is_set() and not rig.is_over and count != options.takes:
                if count and stop.wait(options.pause):
                    break
                Take(rig, store, matrices, known, summary, say, status).run(stop)
                count += 1
    except BrokenPipeError:  # of standard output, not of the disk
        raise
    except OSError as error:
        if error.errno in (errno.EMFILE, errno.ENFILE):
            raise TactileForgeError(too_many_files()) from error
        raise TactileForgeError(
            f"{options.out}: cannot be written ({error.strerror or error}). {summary.seconds:.1f} "
            "s of touch are safe; make room, and record again into the same folder"
        ) from error
    return summary
