"""Each class breaks one thing, and its check sees it."""

import numpy as np
import pytest

from tactileforge.contracts import ACTIONS, Recording
from tactileforge.data.frames.lazy import ArrayFrames
from tactileforge.errors import DataNotFoundError


class Presses:
    """A correct data set; the others break one thing."""

    provides = frozenset({"force", "action"})

    def __init__(self, root: str = "here") -> None:
        self.root = root
        self.skipped = []

    def make(self, i, **changes):
        values = np.full((5, 6, 8, 3), 10 * i, np.uint8)
        given = {
            "key": f"press-{i}",
            "sensor": "digit",
            "frames": ArrayFrames(values),
            "times": np.arange(5) / 30,
            "no_contact": None,
            "force": np.zeros((5, 3), np.float32),
            "action": np.zeros(5, np.int64),
        }
        return Recording(**{**given, **changes})

    def recordings(self, split):
        if self.root != "here":
            raise DataNotFoundError(f"{self.root}: no recordings; set data.root to their folder")
        yield from (self.make(i) for i in {"train": (0, 1), "val": (2,)}[split])

    def plot(self, recording):
        from matplotlib import pyplot

        figure, axes = pyplot.subplots()
        axes.imshow(recording.frames.read([0])[0])
        return figure


def test_good_dataset_passes(failed, statuses):
    assert not failed("dataset", Presses)
    status_by_name = statuses("dataset", Presses())
    assert "failed" not in status_by_name.values()
    assert status_by_name["missing data names the folder and the fix"] == "skipped"
    assert status_by_name["plot gives a figure"] == "ran"


def presses(**changes):
    """A data set with a changed second recording."""

    class Changed(Presses):
        def make(self, i, **more):
            return super().make(i, **(changes if i == 1 else {}))

    return Changed


class PromisesText(Presses):
    provides = frozenset({"force", "action", "text"})


class ForgetsForce(Presses):
    provides = frozenset({"action"})


class Whims(Presses):
    calls = 0

    def make(self, i, **changes):
        Whims.calls += 1
        return super().make(i, key=f"press-{i}-{Whims.calls}")


class Noise(Presses):
    calls = 0

    def make(self, i, **changes):
        Noise.calls += 1
        frames = ArrayFrames(np.full((5, 6, 8, 3), Noise.calls, np.uint8))
        return super().make(i, frames=frames)


class OpenFrames(ArrayFrames):
    def __init__(self, frames):
        super().__init__(frames)
        self.decode = lambda frame: frame


class HoldsFunctions(Presses):
    def make(self, i, **changes):
        return super().make(i, frames=OpenFrames(np.zeros((5, 6, 8, 3), np.uint8)))


class ForgetfulFrames(ArrayFrames):
    def __reduce__(self):
        return ForgetfulFrames, (np.zeros((5, 6, 8, 3), np.uint8),)


class LosesFrames(Presses):
    def make(self, i, **changes):
        return super().make(i, frames=ForgetfulFrames(np.ones((5, 6, 8, 3), np.uint8)))


class SharesFrames(Presses):
    cut = 4

    def recordings(self, split):
        whole = next(super().recordings("train"))
        yield whole.part(0, self.cut) if split == "train" else whole.part(3, 5)


class SharesOut(SharesFrames):
    cut = 3


class SilentlyEmpty(Presses):
    def recordings(self, split):
        return iter(()) if self.root != "here" else super().recordings(split)


class Terse(Presses):
    def recordings(self, split):
        if self.root != "here":
            raise DataNotFoundError("no data")
        return super().recordings(split)


class NoFix(Presses):
    def recordings(self, split):
        if self.root != "here":
            raise DataNotFoundError(f"nothing in {self.root}")
        return super().recordings(split)


class WrongError(Presses):
    def recordings(self, split):
        if self.root != "here":
            raise FileNotFoundError(self.root)
        return super().recordings(split)


class PlotsNothing(Presses):
    def plot(self, recording):
        from matplotlib.figure import Figure

        return Figure()


class PlotsAnArray(Presses):
    def plot(self, recording):
        return recording.frames.read([0])


MISSING = "missing data names the folder and the fix"


@pytest.mark.parametrize(
    ("plugin", "name", "detail"),
    [
        (PromisesText, "keys are what it provides", "no recording seen has ['text']"),
        (ForgetsForce, "keys are what it provides", "carry ['force']"),
        (presses(sensor="digti"), "recordings are whole", "did you mean 'digit'"),
        (presses(licence="apache"), "recordings are whole", "did you mean 'Apache-2.0'"),
        (presses(times=np.zeros(5)), "recordings are whole", "times do not strictly increase"),
        (presses(times=np.arange(4.0)), "recordings are whole", "'press-1': 5 frames"),
        (presses(force=np.zeros((5, 3))), "recordings are whole", "float64"),
        (presses(action=np.full(5, len(ACTIONS))), "recordings are whole", "outside -1..7"),
        (Whims, "same index same sample", "press-0-"),
        (Noise, "same index same sample", "other frames"),
        (HoldsFunctions, "recordings go to other processes", "cannot be pickled"),
        (LosesFrames, "recordings go to other processes", "other frames once pickled"),
        (SharesFrames, "splits are disjoint", "'press-0[0:4]' and 'press-0[3:5]' share frames"),
        (presses(key="press-0"), "splits are disjoint", "several recordings have the key"),
        (presses(key="press-2"), "splits are disjoint", "several recordings have the key"),
        (SilentlyEmpty, MISSING, "gives 0 recordings, and no error"),
        (Terse, MISSING, "does not name the folder"),
        (NoFix, MISSING, "does not say what to do"),
        (WrongError, MISSING, "FileNotFoundError"),
        (PlotsNothing, "plot gives a figure", "the figure is empty"),
        (PlotsAnArray, "plot gives a figure", "gives a ndarray"),
    ],
)
def test_broken_dataset(failed, plugin, name, detail):
    failures = failed("dataset", plugin)
    assert set(failures) == {name}
    assert detail in failures[name]


def test_parts_of_one_recording_may_be_shared_out(failed):
    assert not failed("dataset", SharesOut)


def test_a_dataset_whose_data_is_elsewhere_is_skipped(statuses):
    status_by_name = statuses("dataset", Presses, root="/nowhere")
    assert status_by_name["recordings are whole"] == "skipped"
    assert status_by_name[MISSING] == "ran"
