from collections import Counter
from collections.abc import Callable

import numpy as np
import pytest
from tactileforge_inspect.counters import (
    DURATIONS,
    Counters,
    Histogram,
    NameCounts,
    RecordingSample,
    SampledRecording,
    duration_of,
    source_rows,
)

from tactileforge.contracts import ACTIONS, Recording
from tactileforge.data.shards.summary import counted

Touch = Callable[..., Recording]


def test_a_histogram_that_grows_counts_as_one_that_was_wide_from_the_start() -> None:
    rng = np.random.default_rng(0)
    values = rng.normal(0, 1, 5000) * np.geomspace(0.1, 9, 5000)
    grown = Histogram()
    for part in np.array_split(values, 50):
        grown.add(part)
    grown.add(np.array([np.nan, np.inf]))
    wide = Histogram(grown.reach)
    wide.add(values)
    assert grown.counts.tolist() == wide.counts.tolist()
    assert grown.counts.sum() == 5000
    assert np.abs(values).max() < grown.reach <= 2 * np.abs(values).max()
    assert grown.over(4 * grown.reach).sum() == 5000
    assert (grown.edges == 0).sum() == 1, "positive and negative values are never in one bin"


def test_names_are_counted_exactly() -> None:
    rng = np.random.default_rng(0)
    drawn = [f"object {i}" for i in rng.zipf(1.5, 3000) % 500]
    names = NameCounts()
    for name in drawn:
        names.add("object", name)
    names.add("action", "press", 7)
    want = Counter(drawn)
    assert dict(names.top("object", 1000)) == want
    assert [n for _, n in names.top("object", 5)] == [n for _, n in want.most_common(5)]
    assert names.number("object") == (len(want), 3000)
    assert names.top("action", 3) == [("press", 7)]
    assert names.number("nothing") == (0, 0)


def offered(touch: Touch, counts: dict[str, int], limit: int) -> list[SampledRecording]:
    still = touch(count=1)
    sensors = [sensor for sensor, count in counts.items() for _ in range(count)]
    np.random.default_rng(1).shuffle(sensors)
    sample = RecordingSample(limit)
    for order, sensor in enumerate(sensors):
        recording = Recording(
            key=str(order), sensor=sensor, frames=still.frames, times=still.times, no_contact=None
        )
        sample.offer(SampledRecording(recording, "train", order))
    return sample.drawn()


def test_each_sensor_has_its_share_and_gives_the_rest_to_the_others(touch: Touch) -> None:
    drawn = offered(touch, {"digit": 900, "gelsight": 300, "dm": 4}, 101)
    assert Counter(sampled.recording.sensor for sampled in drawn) == {
        "dm": 4,
        "gelsight": 49,
        "digit": 48,
    }
    orders = [sampled.order for sampled in drawn]
    assert orders == sorted(orders)
    assert orders == [
        o.order for o in offered(touch, {"digit": 900, "gelsight": 300, "dm": 4}, 101)
    ]
    assert len(offered(touch, {"digit": 30}, 100)) == 30
    assert len(offered(touch, {"digit": 3, "gelsight": 3}, 1)) == 1


def test_a_sample_is_spread_evenly(touch: Touch) -> None:
    orders = np.array([sampled.order for sampled in offered(touch, {"digit": 4000}, 400)])
    counts = np.histogram(orders, bins=4, range=(0, 4000))[0]
    assert np.abs(counts - 100).max() < 35, "four standard deviations"


def test_a_tally_adds_up(touch: Touch) -> None:
    action = np.repeat([0, -1, 3], 30)
    tally = Counters()
    tally.add(touch(0, action=action, object="cup", text="a cup"), "train")
    tally.add(touch(1, object="cup", force=None), "train")
    axes = dict.fromkeys(("force.x", "force.y", "force.z"), 1)
    tally.add(touch(2, count=1, sensor="gelsight", no_contact=None), "val")
    digit, gelsight = tally.totals["train", "digit"], tally.totals["val", "gelsight"]
    assert (digit.recordings, digit.frames, digit.stills) == (2, 180, 0)
    assert digit.seconds == pytest.approx(6.0)
    assert digit.slowest == pytest.approx(30)
    labels = {"force": 1, "action": 1, "object": 2, "text": 1}
    assert digit.carrying == labels | axes | {"background": 2}
    assert (gelsight.recordings, gelsight.stills, gelsight.seconds) == (1, 1, 0)
    assert gelsight.carrying == {"force": 1} | axes
    assert dict(tally.names.top("action", 9)) == {"press": 30, "unknown": 30, ACTIONS[3]: 30}
    assert tally.names.top("object", 9) == [("cup", 2)]
    assert list(source_rows(tally.names, 9)) == [("made here", "CC0-1.0", "5", 3)]
    assert tally.stills == 1
    (place,) = np.flatnonzero(tally.durations)
    assert DURATIONS[place] <= 3.0 < DURATIONS[place + 1]
    assert tally.durations[place] == 2
    assert [histogram.counts.sum() for histogram in tally.forces["digit"]] == [90] * 3


def test_forces_are_counted_along_their_axes(touch: Touch) -> None:
    normal_only, whole, nothing = touch(0), touch(1), touch(2)
    normal_only.force[:, :2] = np.nan
    nothing.force[:] = np.nan
    tally = Counters()
    for recording in (normal_only, whole, nothing):
        tally.add(recording, "train")
    carrying = tally.totals["train", "digit"].carrying
    assert carrying["force"] == 2  # NaN throughout is not a label
    assert counted(carrying, "force") == "2 (x 1, y 1, z 2)"
    assert counted(carrying, "object") == "none"
    assert counted({"force": 3, "force.x": 3, "force.y": 3, "force.z": 3}, "force") == "3"


def test_durations(touch: Touch) -> None:
    assert duration_of(touch(count=1)) == 0
    assert duration_of(touch(count=30)) == pytest.approx(1.0)
    assert duration_of(touch(count=3, times=np.zeros(3))) == 0
