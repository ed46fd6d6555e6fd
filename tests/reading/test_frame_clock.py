"""Layouts: times, order and forces of frames, from names and CSVs."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from videos import write_video

from tactileforge.contracts import Recording
from tactileforge.datasets.recordings import Recordings
from tactileforge.errors import ConfigError, DataError

MakeFile = Callable[..., Path]
VIDEO = {"videos": "*.avi", "sensor": "digit", "background": "none"}
SEQUENCE = {
    "images": "*/*.png",
    "each": "sequence",
    "fps": 10,
    "sensor": "digit",
    "background": "none",
}
FORCE = {"file": "{stem}.csv", "times": "t", "columns": ["fx", "fy", "fz"]}
DATE = 1763000000


def read(root: Path, **layout: Any) -> tuple[list[Recording], list[str]]:
    data = Recordings(str(root), {"a": layout}, val=0)
    return list(data.recordings("train")), data.notes


def ramp(factor: float = 1.0, zero: float = 0.0, seconds: float = 2.0) -> str:
    """Forces at 100 Hz: fz is the time in seconds."""
    times = np.arange(0, seconds + 0.005, 0.01).tolist()
    return "t,fx,fy,fz\n" + "".join(f"{(t + zero) * factor:.16g},0,0,{t:.2f}\n" for t in times)


@pytest.mark.parametrize(("unit", "factor"), [("ms", 1e3), ("us", 1e6), ("ns", 1e9)])
def test_force_times_in_another_unit(
    tmp_path: Path, make_video: MakeFile, write: MakeFile, unit: str, factor: float
) -> None:
    make_video("0.avi", count=60)
    write("0.csv", ramp(factor))
    with pytest.raises(DataError, match=rf"0\.csv: the column 't' ends at .*unit: {unit}\}}$"):
        read(tmp_path, **VIDEO, force=FORCE)
    (recording,), notes = read(
        tmp_path, **VIDEO, force=FORCE | {"times": {"column": "t", "unit": unit}}
    )
    assert recording.force is not None
    np.testing.assert_allclose(recording.force[:, 2], recording.times, atol=1e-5)
    assert notes == []


def test_force_times_of_another_epoch_or_rate(
    tmp_path: Path, make_video: MakeFile, write: MakeFile
) -> None:
    make_video("0.avi", count=60)
    write("0.csv", ramp(zero=1.7e9))
    with pytest.raises(
        DataError, match=r"1700000000 to .* not overlap .*start: first_row, start: contact"
    ):
        read(tmp_path, **VIDEO, force=FORCE)
    write("0.csv", ramp(2))
    with pytest.raises(DataError, match=r"2 times as long.*102 rows a second.*partial: true"):
        read(tmp_path, **VIDEO, force=FORCE)
    assert read(tmp_path, **VIDEO, force=FORCE | {"partial": True})[1] == []


def test_few_forces_are_a_note(tmp_path: Path, make_video: MakeFile, write: MakeFile) -> None:
    for name in "01":
        make_video(f"{name}.avi", count=60)
        write(f"{name}.csv", "\n".join([*ramp().split("\n")[:1], *ramp().split("\n")[150:]]))
    recordings, (note,) = read(tmp_path, **VIDEO, force=FORCE)
    assert len(recordings) == 2
    assert "get a label" in note
    assert note.endswith("(and 1 more)")


def test_names_give_times_and_meet_forces_of_the_same_epoch(
    tmp_path: Path, make_image: MakeFile, write: MakeFile
) -> None:
    seconds = np.array([0, 1, 2, 3, 12, 13, 14, 20]) / 10
    for i, t in enumerate(seconds.tolist()):
        make_image(f"take/{DATE * 10**9 + round(t * 1e9)}.png", i)
    write("take.csv", ramp())
    layout = SEQUENCE | {"force": FORCE}
    for file, more in (
        (ramp(), {}),
        (ramp(zero=DATE), {}),
        (ramp(1e3, DATE), {}),
        (ramp(1e3), {"times": {"column": "t", "unit": "ms"}}),
    ):
        write("take.csv", file)
        (recording,), notes = read(tmp_path, **layout | {"force": FORCE | more})
        np.testing.assert_allclose(recording.times, seconds, atol=1e-6)
        assert recording.force is not None
        np.testing.assert_allclose(recording.force[:, 2], seconds, atol=1e-3)
        assert notes == []
    (even,), _ = read(tmp_path, **SEQUENCE, times="even")
    np.testing.assert_allclose(even.times, np.arange(8) / 10)


def test_times_of_a_csv(tmp_path: Path, make_image: MakeFile, write: MakeFile) -> None:
    for i in range(4):
        make_image(f"x/{'dacb'[i]}.png", i)
    rows = [("d", 0.7), ("a", 0.0), ("c", 0.3), ("b", 0.1)]
    layout = {k: v for k, v in SEQUENCE.items() if k != "fps"}
    keyed = {"file": "{stem}.csv", "key": "image", "column": "t"}
    write("x.csv", "image,t\n" + "".join(f"{name}.png,{DATE + t}\n" for name, t in rows))
    with pytest.raises(
        DataError,
        match=r"frame 1, 1763000000, is not after that of .* 1763000001",
    ):
        read(tmp_path, **layout, times=keyed | {"key": None})
    write("x.csv", "image,t\n" + "".join(f"{name}.png,{t * 1000}\n" for name, t in rows))
    with pytest.raises(DataError, match=r"every 200 s: is it another unit\? .*unit: ms"):
        read(tmp_path, **layout, times=keyed)
    (recording,), _ = read(tmp_path, **layout, times=keyed | {"unit": "ms"})
    np.testing.assert_allclose(recording.times, [0, 0.1, 0.3, 0.7])
    write("x.csv", "image,t\n" + "".join(f"{name}.png,{t}\n" for name, t in rows[1:]))
    with pytest.raises(DataError, match=r"x\.csv: no row of .*d\.png"):
        read(tmp_path, **layout, times=keyed)


def test_times_of_a_video_from_a_csv(tmp_path: Path, make_video: MakeFile, write: MakeFile) -> None:
    make_video("0.avi", count=3)
    write("0.csv", "t\n1\n1.5\n2.5\n")
    times = {"file": "{stem}.csv", "column": "t"}
    np.testing.assert_allclose(read(tmp_path, **VIDEO, times=times)[0][0].times, [0, 0.5, 1.5])
    write("0.csv", "t\n1\n1.5\n")
    with pytest.raises(DataError, match=r"0\.csv: 2 times for 3 frames"):
        read(tmp_path, **VIDEO, times=times)


def test_order(tmp_path: Path, make_image: MakeFile, write: MakeFile) -> None:
    for i, name in enumerate(("gp_8.5_f1", "gp_8.27_f2", "gp_8.05_f3")):
        make_image(f"x/{name}.png", i)

    def levels(**more: Any) -> tuple[list[int], list[str]]:
        (recording,), notes = read(tmp_path, **SEQUENCE | more)
        shown = recording.frames.read(range(3)).mean(axis=(1, 2, 3)) / 7
        return shown.round().astype(int).tolist(), notes

    shown, (note,) = levels()
    assert shown == [2, 1, 0]
    assert note.startswith("a/x: two orders are possible")
    assert levels(order="f{number}") == ([0, 1, 2], [])
    write("o.csv", "image,n\nx/gp_8.5_f1.png,2\nx/gp_8.27_f2.png,3\nx/gp_8.05_f3.png,1\n")
    assert levels(order={"file": "o.csv", "key": "image", "column": "n"}) == ([2, 0, 1], [])


@pytest.mark.parametrize(
    ("layout", "words"),
    [
        (VIDEO | {"times": "names"}, "a video has no names of images"),
        (SEQUENCE | {"times": "name"}, "unknown times 'name'"),
        (SEQUENCE | {"times": {"unit": "sec"}}, "unknown unit 'sec'"),
        (SEQUENCE | {"times": {"file": "t.csv"}}, "give the column of the times"),
        (SEQUENCE | {"order": "f"}, r"needs \{number\} once"),
        (VIDEO | {"order": "f{number}"}, "order: is for images of each: sequence"),
        (SEQUENCE | {"order": {"file": "o.csv"}}, "give a pattern"),
        (VIDEO | {"force": FORCE | {"unit": "ms"}}, "ms is one of time; give times: .column"),
        (
            SEQUENCE | {"force": FORCE | {"times": {"column": "t", "unit": "hour"}}},
            "unknown unit 'hour'",
        ),
        (SEQUENCE | {"force": FORCE | {"frame": "f"}}, "give one of frame and times"),
        (
            VIDEO | {"force": {"file": "f.csv", "key": "a", "columns": ["x", "y", "z"]}},
            "are videos",
        ),
    ],
)
def test_keys_that_make_no_sense(tmp_path: Path, layout: dict[str, Any], words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        read(tmp_path, **layout)


def test_names_that_give_no_times(tmp_path: Path, make_image: MakeFile) -> None:
    for i in range(3):
        make_image(f"x/{i}.png", i)
    layout = {k: v for k, v in SEQUENCE.items() if k != "fps"}
    with pytest.raises(ConfigError, match=r"names such as '0' and '1' give no times; give .* fps:"):
        read(tmp_path, **layout, times="names")


@pytest.mark.parametrize(
    ("seconds", "part", "count"),
    [
        ("secs", "nsecs", 10**9),
        ("stamp.sec", "stamp.nanosec", 10**9),
        ("Sec", "Nanosec", 10**9),
        ("tv_sec", "tv_usec", 10**6),
        ("header.stamp.secs", "header.stamp.nsecs", 10**9),
        ("seconds", "milliseconds", 10**3),
    ],
)
def test_times_in_two_columns(
    tmp_path: Path, make_video: MakeFile, write: MakeFile, seconds: str, part: str, count: int
) -> None:
    """Frames at 12.5 a second across two whole seconds, and forces at 100 Hz."""
    make_video("0.avi", count=25)
    frames = [DATE * 1000 + 700 + 80 * i for i in range(25)]
    rows = [f"{ms // 1000},{ms % 1000 * count // 1000}\n" for ms in frames]
    write("0_times.csv", f"{seconds},{part}\n" + "".join(rows))
    times = {"file": "{stem}_times.csv", "column": seconds}
    forces = [DATE * 1000 + 700 + 10 * i for i in range(200)]
    rows = [
        f"{ms // 1000},{ms % 1000 * count // 1000},0,0,{(ms - forces[0]) / 1000}\n" for ms in forces
    ]
    write("0.csv", f"{seconds},{part},fx,fy,fz\n" + "".join(rows))
    (one,), notes = read(tmp_path, **VIDEO, times=times, force={**FORCE, "times": seconds})
    np.testing.assert_allclose(one.times, np.arange(25) * 0.08, atol=1e-6)
    assert one.force is not None
    np.testing.assert_allclose(one.force[:, 2], np.arange(25) * 0.08, atol=1e-5)
    assert notes == []


def test_seconds_beside_whole_nanoseconds_are_refused(
    tmp_path: Path, make_video: MakeFile, write: MakeFile
) -> None:
    make_video("0.avi", count=10)
    write("0.csv", "sec,nsec\n" + "".join(f"{DATE},{DATE}{i * 10**8:09d}\n" for i in range(10)))
    with pytest.raises(DataError, match="is not after that of the frame before"):
        read(tmp_path, **VIDEO, times={"file": "{stem}.csv", "column": "sec"})


def pressing(tmp_path: Path, write: MakeFile, name: str, late: float, zero: float = 0.0) -> None:
    """A video of 75 frames that brightens with a push, and its forces of 4 s that began earlier."""
    frames = np.full((75, 32, 48, 3), 60, np.uint8)
    push = np.exp(-(((np.arange(75) / 25) - 1.5) ** 2) / 0.05)
    frames[:, 8:24, 10:30] += (120 * push).astype(np.uint8)[:, None, None, None]
    write_video(tmp_path / f"{name}.avi", frames, 25)
    times = np.arange(400) / 100
    felt = 5 * np.exp(-((times - 1.5 - late) ** 2) / 0.05)
    rows = (f"{(t + zero) * 1000:.0f},0,0,{f:.3f}\n" for t, f in zip(times, felt, strict=True))
    write(f"{name}.csv", "stamp,fx,fy,fz\n" + "".join(rows))


STAMPED = FORCE | {"times": "stamp"}
PRESSED = VIDEO | {"background": {"first": 3}}


@pytest.mark.parametrize("start", ["first_row", DATE * 1000])
def test_a_layout_says_where_two_clocks_meet(
    tmp_path: Path, write: MakeFile, start: str | float
) -> None:
    pressing(tmp_path, write, "0", late=0.0, zero=DATE)
    (one,), notes = read(tmp_path, **PRESSED, force=STAMPED | {"start": start})
    assert one.force is not None
    np.testing.assert_allclose(one.times[np.argmax(one.force[:, 2])], 1.5, atol=0.05)
    assert notes == []


def test_the_start_of_each_recording_is_a_column(tmp_path: Path, write: MakeFile) -> None:
    for name, late in (("0", 0.0), ("1", 0.6)):
        pressing(tmp_path, write, name, late, DATE)
    write("labels.csv", f"file,began\n0.avi,{DATE}000\n1.avi,{DATE}600\n")
    layout = PRESSED | {"labels": {"file": "labels.csv"}}
    found, _ = read(tmp_path, **layout, force=STAMPED | {"start": "{began}"})
    for one in found:
        assert one.force is not None
        np.testing.assert_allclose(one.times[np.argmax(one.force[:, 2])], 1.5, atol=0.05)
    write("labels.csv", f"file,began\n0.avi,{DATE}000\n1.avi,noon\n")
    with pytest.raises(DataError, match=r"labels.csv, row 3: start: '\{began\}' .* is 'noon'"):
        read(tmp_path, **layout, force=STAMPED | {"start": "{began}"})


@pytest.mark.parametrize("late", [0.7, -0.9])
def test_clocks_are_aligned_by_contact(tmp_path: Path, write: MakeFile, late: float) -> None:
    pressing(tmp_path, write, "0", late, DATE)
    (one,), (note,) = read(tmp_path, **PRESSED, force=STAMPED | {"start": "contact"})
    assert one.force is not None
    peak = one.times[np.nanargmax(one.force[:, 2])]
    assert peak == pytest.approx(1.5, abs=0.05)
    assert f"puts the first row at {-late:+.1f}" in note
    assert "correlate by 0.9" in note or "correlate by 1.0" in note


def test_nothing_tells_a_contact(tmp_path: Path, write: MakeFile, make_video: MakeFile) -> None:
    write_video(tmp_path / "0.avi", np.full((75, 32, 48, 3), 60, np.uint8), 25)
    times = np.arange(300) / 100
    write("0.csv", "stamp,fx,fy,fz\n" + "".join(f"{DATE + t:.2f},0,0,{t}\n" for t in times))
    with pytest.raises(DataError, match=r"0\.csv: .*start: contact: .* start: first_row"):
        read(tmp_path, **PRESSED, force=STAMPED | {"start": "contact"})


def test_one_without_a_contact_is_skipped_and_counted(tmp_path: Path, write: MakeFile) -> None:
    for name in ("0", "2"):
        pressing(tmp_path, write, name, 0.7, DATE)
    for name in ("1", "3"):
        pressing(tmp_path, write, name, 0.0, DATE)
        rows = "".join(f"{(DATE + t / 100) * 1000:.0f},0,0,0\n" for t in range(400))
        write(f"{name}.csv", "stamp,fx,fy,fz\n" + rows)
    data = Recordings(str(tmp_path), {"a": PRESSED | {"force": STAMPED | {"start": "contact"}}})
    found = [one.key for split in ("train", "val") for one in data.recordings(split)]
    assert sorted(found) == ["a/0.avi", "a/2.avi"]
    assert [line.partition(": the column")[0][-5:] for line in sorted(data.skipped)] == [
        "1.csv",
        "3.csv",
    ]


@pytest.mark.parametrize(
    ("force", "words"),
    [({"start": "firstrow"}, "did you mean 'first_row'"), ({"start": 3, "times": None}, "times:")],
)
def test_wrong_starts_are_named(tmp_path: Path, force: dict[str, Any], words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        read(tmp_path, **VIDEO, force=STAMPED | force)


def test_frames_and_forces_with_stamps_of_their_own(tmp_path: Path, write: MakeFile) -> None:
    pressing(tmp_path, write, "0", 0.6, DATE)
    frames = "".join(f"{(DATE + 0.6 + i / 25) * 1000:.0f}\n" for i in range(75))
    write("0_frames.csv", "t_ms\n" + frames)
    times = {"file": "{stem}_frames.csv", "column": "t_ms"}
    (one,), notes = read(tmp_path, **PRESSED, times=times, force=STAMPED)
    assert one.force is not None
    assert one.times[np.argmax(one.force[:, 2])] == pytest.approx(1.5, abs=0.05)
    assert notes == []
