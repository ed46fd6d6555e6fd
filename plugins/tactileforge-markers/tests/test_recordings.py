"""Markers as tracks of recordings: packed, recorded, shown live, or refused."""

import json
from dataclasses import replace
from io import StringIO
from pathlib import Path

import numpy as np
import pytest
from dotted import SIZE, picture, places
from tactileforge_live.publish import JsonLines
from tactileforge_live.record.options import RecordOptions
from tactileforge_live.record.record import record
from tactileforge_live.session import LiveOptions, LiveSession, ShowBackground, run_session
from tactileforge_markers.tracks import marker_rest

from tactileforge.contracts import Frame, Recording, SensorSpec
from tactileforge.data.frames.lazy import ArrayFrames
from tactileforge.data.shards import shards
from tactileforge.errors import ConfigError, DataError
from tactileforge.packing import Filter, PackOptions, pack, summary
from tactileforge.sensors.background import Background

AT = places()
COUNT = 8


def right(pixels):
    return np.array([pixels, 0])


def touch(key="a", sensor="gelsight_mini", still=True):
    frames = np.stack(
        [picture(AT + np.array([step, 0]), noise=1, seed=step) for step in range(COUNT)]
    )
    rest = ArrayFrames(frames[:1])
    times = np.arange(COUNT) / 25
    lazy = ArrayFrames(frames)
    return Recording(
        key=key, sensor=sensor, frames=lazy, times=times, no_contact=rest if still else None
    )


class Touches:
    def __init__(self, *recordings):
        self.made, self.skipped = recordings, []

    def recordings(self, split):
        return self.made if split == "train" else []


def packed(out: Path, *recordings, **options):
    given = {"codec": "png", "processes": 1, "markers": ("gelsight_mini",)} | options
    index = pack(Touches(*recordings), "made", out, PackOptions(**given))
    return index, {one.key: one for one in shards.read_shard(out / "train-000000.tar")}


def check_tracks(recording, steps):
    rest, size = marker_rest(recording)
    assert size == SIZE
    assert np.abs(rest - AT).max() < 0.2
    moved = recording.tracks["markers"]
    assert moved.shape == (len(steps), 24, 2)
    wanted = np.stack([np.array(steps), np.zeros(len(steps))], -1)
    np.testing.assert_allclose(np.nanmean(moved, axis=1), wanted, atol=0.2)
    np.testing.assert_allclose(recording.tracks["marker_motion"][:, :2], wanted, atol=0.2)
    field = recording.tracks["marker_field"]
    assert field.shape == (len(steps), 12, 12, 2)
    np.testing.assert_allclose(field.mean((1, 2)), wanted * 100 / 120, atol=0.2)


def test_packing_adds_tracks(tmp_path):
    index, found = packed(tmp_path / "p", touch(), touch("b", "digit"))
    check_tracks(found["a"], range(COUNT))
    assert not found["b"].tracks
    assert index.statistics["train"]["unmarked"] == 0


def test_packing_again_copies_pictures_and_follows_what_the_filter_leaves(tmp_path):
    packed(tmp_path / "p", touch(), markers=())
    (again,) = shards.read_shard(tmp_path / "p" / "train-000000.tar")
    first = again.frames.encoded(0)
    _, found = packed(tmp_path / "q", again, filter=Filter(every=0.08))
    check_tracks(found["a"], range(0, COUNT, 2))
    assert found["a"].frames.encoded(0) == first
    _, small = packed(tmp_path / "r", again, size=60)
    check_tracks(small["a"], range(COUNT))
    assert small["a"].frames.shape == (60, 80)


def test_recordings_that_show_no_markers_are_packed_without_and_named(tmp_path):
    bare = replace(touch("bare"), no_contact=ArrayFrames(np.full((1, *SIZE, 3), 90, np.uint8)))
    other = replace(touch("other"), no_contact=ArrayFrames(np.full((1, 60, 80, 3), 90, np.uint8)))
    index, found = packed(tmp_path / "p", touch(), touch("lone", still=False), bare, other)
    assert {key for key, one in found.items() if one.tracks} == {"a"}
    assert len(found) == 4
    counts = index.statistics["train"]
    assert (counts["unmarked"], counts["damaged"]) == (3, 0)
    said = "\n".join(counts["skipped"])
    assert "lone: no frame without contact" in said
    assert "bare: no markers found" in said
    assert "other: frames of (120, 160) pixels" in said
    assert "recordings without markers: 3" in summary(index)


def test_a_recording_without_markers_says_how_to_get_them():
    with pytest.raises(DataError, match=r"a: no markers; record with markers=\[SENSOR\]"):
        marker_rest(touch())
    damaged = replace(touch(), labels={"marker_rest": "120x160 1,2 3"})
    with pytest.raises(DataError, match="the label marker_rest is damaged"):
        marker_rest(damaged)


class Dots:
    """A sensor with dots at rest, then to the right and back, or without dots."""

    def __init__(self, bare=False, rest=40):
        self.spec = SensorSpec(
            name="gelsight_mini",
            height=SIZE[0],
            width=SIZE[1],
            fps=25.0,
            area_mm=None,
            force_scale=(1.0, 1.0, 1.0),
        )
        steps = [0.0] * 6 + [*range(7)] + [*range(6, 0, -1)]
        at = AT[:0] if bare else AT
        self.pictures = [picture(at + right(s), noise=1, seed=n) for n, s in enumerate(steps)]
        self.rest = rest

    def discover(self):
        return []

    def open(self):
        import time

        self.start, self.number = time.monotonic(), 0

    def read(self, timeout=1.0):
        import time

        due = self.start + self.number / self.spec.fps
        time.sleep(max(0.0, due - time.monotonic()))
        late = self.number - self.rest
        self.number += 1
        shown = self.pictures[self.number % 6 if late < 0 else 6 + late % 13]
        return Frame(array=shown, time=due)

    def close(self):
        pass

    def __enter__(self):
        self.open()
        return self

    def __exit__(self, *error):
        pass


def options(out, **given):
    background = Background(seconds=0.5)
    return RecordOptions(out=str(out), seconds=2.0, background=background, codec="png", **given)


@pytest.mark.slow
def test_recording_keeps_tracks_of_markers(tmp_path):
    given = options(tmp_path / "o", markers=["left"], segment=0.7)
    record(given, {"left": Dots()}, say=lambda line: None)
    (one,) = shards.read_shard(tmp_path / "o" / "train-000000.tar")
    moved = one.tracks["markers"]
    assert moved.shape == (len(one.frames), 24, 2)
    assert marker_rest(one)[1] == SIZE
    for row in (0, len(one.frames) // 2, len(one.frames) - 1):
        shown = one.frames.read([row])[0]
        sums = [np.abs(shown - made.astype(int)).sum() for made in Dots().pictures]
        step = ([0] * 6 + [*range(7)] + [*range(6, 0, -1)])[int(np.argmin(sums))]
        assert np.nanmean(moved[row, :, 0]) == pytest.approx(step, abs=0.25)


@pytest.mark.slow
def test_a_bare_gel_is_refused_before_a_take_and_before_a_session(tmp_path):
    with pytest.raises(DataError, match="the background of left: no markers found"):
        record(options(tmp_path / "o", markers=["left"]), {"left": Dots(bare=True)}, say=str)
    shown = LiveOptions(markers=["left"], background=ShowBackground(seconds=0.0), frames=3)
    with (
        LiveSession({"left": Dots(bare=True)}, None, shown) as view,
        pytest.raises(DataError, match="the background of left: no markers found"),
    ):
        run_session(view, say=str)


@pytest.mark.slow
def test_a_session_says_shear_and_torsion():
    from tactileforge_live.server import page_state

    shown = LiveOptions(
        markers=["left"], background=ShowBackground(seconds=0.0), frames=20, seconds=20.0
    )
    lines = StringIO()
    with LiveSession({"left": Dots(rest=8)}, None, shown) as view:
        run_session(view, [JsonLines(lines)], say=str)
        state = page_state(view, {})["sensors"]["left"]
    messages = [json.loads(line) for line in lines.getvalue().splitlines()]
    readings = [message for message in messages if "frame" in message]
    assert max(message["shear_px"][0] for message in readings) > 2
    assert all(abs(message["torsion_deg"]) < 0.3 for message in readings)
    assert all(message["markers_seen"] > 0.8 for message in readings)
    assert state["markers"]
    assert state["readings"][-1][6]["shear_px"] == readings[-1]["shear_px"]


def test_options_are_checked(tmp_path):
    with pytest.raises(ConfigError, match="lefft"):
        record(options(tmp_path / "o", markers=["lefft"]), {"left": Dots()}, say=str)
    with pytest.raises(ConfigError, match="markers need a background"):
        RecordOptions(out="x", markers=["left"], background=Background(seconds=0.0))
    array = Dots()
    array.spec = replace(array.spec, kind="array")
    with pytest.raises(ConfigError, match=r"left .array. is not a camera"):
        LiveSession({"left": array}, None, LiveOptions(markers=["left"])).__enter__()
