"""Each class breaks one thing, and its checks see it."""

from dataclasses import replace

import numpy as np
import pytest
from opened import Opened

from tactileforge.contracts import Frame, Sensor, SensorSpec
from tactileforge.errors import TactileForgeError


class Good(Opened):
    """A correct sensor; the others break one thing."""

    spec = SensorSpec(
        name="good", height=6, width=8, fps=30, area_mm=None, force_scale=(1.0, 1.0, 1.0)
    )
    shape = (6, 8, 3)
    dtype = np.uint8

    def __init__(self, gain: float = 1.0) -> None:
        self.is_open = False
        self.count = 0

    def discover(self):
        return []

    def open(self):
        self.is_open = True

    def read(self, timeout=1.0):
        if not self.is_open:
            raise TactileForgeError("not open")
        self.count += 1
        return Frame(array=np.zeros(self.shape, self.dtype), time=self.time())

    def time(self):
        return float(self.count)

    def close(self):
        self.is_open = False


def test_good_sensor_passes(statuses):
    status_by_name = statuses("sensor", Good)
    assert set(status_by_name.values()) == {"ran", "skipped"}
    skipped = {name for name, status in status_by_name.items() if status == "skipped"}
    assert skipped == {"name is snake case", "module imports no vendor sdk"}


class Bare(Sensor):
    """No constructor, and no methods of a context manager of its own."""

    spec = Good.spec
    count = -1

    def discover(self):
        return []

    def open(self):
        self.count = 0

    def read(self, timeout=1.0):
        if self.count < 0:
            raise TactileForgeError("not open")
        self.count += 1
        return Frame(array=np.zeros(Good.shape, Good.dtype), time=float(self.count))

    def close(self):
        self.count = -1


def test_a_sensor_that_inherits_the_contract_needs_no_more(statuses):
    assert statuses("sensor", Bare) == statuses("sensor", Good)
    with Bare() as sensor:
        assert sensor.count == 0
    assert sensor.count == -1


class NoSpec(Good):
    spec = "good"


class DiscoverFails(Good):
    def discover(self):
        raise OSError("no bus")


class DiscoverGivesNone(Good):
    def discover(self):
        return None


class ReadsUnopened(Good):
    def __init__(self) -> None:
        super().__init__()
        self.is_open = True


class RaisesAnything(Good):
    def read(self, timeout=1.0):
        if not self.is_open:
            raise AttributeError("'NoneType' object has no attribute 'read'")
        return super().read()


class ClosesOnce(Good):
    def close(self):
        self.handle = None
        del self.handle
        if self.count:
            self.count = None
        elif self.count is None:
            raise OSError("closed already")


class WrongType(Good):
    dtype = np.float32


class WrongShape(Good):
    shape = (8, 6, 3)


class TimeStands(Good):
    def time(self):
        return 1.0


class StaysOpen(Good):
    def close(self):
        pass


class StaysOpenOnException(Good):
    def __exit__(self, *error):
        pass


class Swallows(Good):
    def __exit__(self, *error):
        self.close()
        return True


class GoodArray(Good):
    spec = replace(Good.spec, kind="array")
    raw = np.zeros((48, 1), np.float32)

    def read(self, timeout=1.0):
        return replace(super().read(), raw=self.raw)


class GoodWrench(GoodArray):
    spec = replace(Good.spec, kind="wrench", height=0, width=0)
    shape = (0, 0, 3)
    raw = np.zeros(6, np.float32)


@pytest.mark.parametrize("plugin", [GoodArray, GoodWrench])
def test_good_sensors_of_other_kinds_pass(statuses, plugin):
    assert set(statuses("sensor", plugin).values()) == {"ran", "skipped"}


class ImageWithRaw(GoodArray):
    spec = Good.spec


class ArrayWithoutRaw(Good):
    spec = GoodArray.spec


class FlatArray(GoodArray):
    raw = np.zeros(48, np.float32)


class DoubleArray(GoodArray):
    raw = np.zeros((48, 1))


class WrenchOfNaN(GoodWrench):
    raw = np.full(6, np.nan, np.float32)


class WrenchOfThree(GoodWrench):
    raw = np.zeros(3, np.float32)


class WrenchWithPicture(GoodWrench):
    spec = replace(Good.spec, kind="wrench")
    shape = (6, 8, 3)


@pytest.mark.parametrize(
    ("plugin", "message"),
    [
        (ImageWithRaw, "its kind is image, and its frames have raw values"),
        (ArrayWithoutRaw, "its kind is array, and its frames have no raw values"),
        (FlatArray, "raw values are (48,): give (taxels, values of each)"),
        (DoubleArray, "raw values are float64, not float32"),
        (WrenchOfNaN, "raw values are not finite"),
        (WrenchOfThree, "raw values are (3,): give (6,), in N and N m"),
        (WrenchWithPicture, "a wrench sensor has height and width 0"),
    ],
)
def test_frames_that_are_not_of_their_kind(failed, plugin, message):
    failures = failed("sensor", plugin)
    assert set(failures) == {"frames are as specified"}
    assert message in failures["frames are as specified"]


@pytest.mark.parametrize(
    ("plugin", "names"),
    [
        (NoSpec, {"spec is a sensor spec", "frames are as specified"}),
        (DiscoverFails, {"discover with nothing attached gives nothing"}),
        (DiscoverGivesNone, {"discover with nothing attached gives nothing"}),
        (ReadsUnopened, {"read before open raises"}),
        (RaisesAnything, {"read before open raises", "closes for good", "closes on exception"}),
        (ClosesOnce, {"closes for good", "closes on exception"}),
        (WrongType, {"frames are as specified"}),
        (WrongShape, {"frames are as specified"}),
        (TimeStands, {"time strictly increases"}),
        (StaysOpen, {"closes for good", "closes on exception"}),
        (StaysOpenOnException, {"closes on exception"}),
        (Swallows, {"closes on exception"}),
    ],
)
def test_broken_sensor(failed, plugin, names):
    assert set(failed("sensor", plugin)) == names


class NeedsHardware(Good):
    def open(self):
        raise OSError("no device /dev/video7")


class Attached(NeedsHardware):
    def discover(self):
        return ["/dev/video7"]


def test_without_hardware_the_rest_is_still_checked(statuses):
    status_by_name = statuses("sensor", NeedsHardware)
    assert status_by_name["read before open raises"] == "ran"
    assert status_by_name["frames are as specified"] == "skipped"
    assert "failed" not in status_by_name.values()


def test_a_device_that_is_attached_has_to_open(failed):
    assert "no device /dev/video7" in failed("sensor", Attached)["frames are as specified"]
