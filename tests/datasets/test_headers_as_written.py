"""Headers of forces, times and frames as labs write them: read, or asked for with a right hint."""

from pathlib import Path

import numpy as np
import pytest
import yaml
from PIL import Image

from tactileforge.contracts import Recording
from tactileforge.datasets.recordings import Recordings
from tactileforge.reading.guessing.layout import guess_layout

COUNT, FPS = 12, 30
FORCE = np.round(0.25 * np.arange(COUNT), 3)


def folder(root: Path, header: str, rows: list[str]) -> None:
    """Two recordings, each with a table."""
    for k in range(2):
        take = root / f"take_{k}"
        take.mkdir(parents=True)
        for n in range(COUNT):
            level = np.full((12, 16, 3), 90 + 3 * n + k, np.uint8)
            Image.fromarray(level).save(take / f"{n:04d}.png")
        (take / "log.csv").write_text("\n".join([header, *rows]) + "\n")


def read(root: Path, **more: object) -> tuple[list[Recording], list[str]]:
    """Recordings as guessed, with further keys of the layout, and the lines to be checked."""
    guess = guess_layout(root)
    assert guess is not None
    guess.options["layouts"]["guessed"] |= more
    data = Recordings(**guess.options)
    found = [one for split in ("train", "val") for one in data.recordings(split)]
    assert len(found) == 2
    assert not data.skipped
    return found, list(guess.doubts)


TIMES = {
    "ts": 1,
    "millis": 1e3,
    "Zeit in s": 1,
    "Time/s": 1,
    "usec": 1e6,
    "relative_time": 1,
    "elapsed": 1,
    "sys_time": 1,
    "cam_time (ms)": 1e3,
    "microseconds": 1e6,
    "timestamp_us": 1e6,
    "Zeitstempel": 1,
    "X_Value": 1,
    "stopwatch": 1e3,
    "T [ms]": 1e3,
}


@pytest.mark.parametrize(("header", "factor"), TIMES.items(), ids=TIMES)
def test_times_by_their_header_or_as_they_rise(header: str, factor: float, tmp_path: Path) -> None:
    # rows twice as often as frames
    moments = np.arange(2 * COUNT - 1) / FPS / 2
    rows = [f"{t * factor:.9g},{t * FPS / 4:.6g}" for t in moments]
    folder(tmp_path, f'"{header}",Fz', rows)
    found, doubts = read(tmp_path)
    for one in found:
        assert one.force is not None
        np.testing.assert_allclose(one.force[:, 2], FORCE, atol=1e-4)
    said = f"force: {header} of {{file}}/log.csv rises and lasts as long as the frames, so it is "
    assert any(line.startswith(said) for line in doubts) == (header == "stopwatch")


@pytest.mark.parametrize("header", ["depth", "z_pos", "travel (mm)"])
def test_a_position_that_rises_is_no_time(header: str, tmp_path: Path) -> None:
    rows = [f"{t:.9g},{t:.6g}" for t in np.arange(2 * COUNT - 1) / FPS / 2]
    folder(tmp_path, f"{header},Fz", rows)
    found, doubts = read(tmp_path)
    assert all(one.force is None for one in found)
    assert any(f"as no other column ({header}) tells the time, " in line for line in doubts)


@pytest.mark.parametrize(
    "header",
    ["frame_index", "Frame #", "frame_num", "Frame No.", "image_id", "img_idx", "idx", "i"],
)
def test_numbers_of_frames_by_their_header(header: str, tmp_path: Path) -> None:
    kept = [0, 1, 4, 5, 9, 11]
    folder(tmp_path, f"{header},Fz", [f"{n},{FORCE[n]}" for n in kept])
    found, doubts = read(tmp_path)
    for one in found:
        assert one.force is not None
        np.testing.assert_allclose(one.force[kept, 2], FORCE[kept], atol=1e-6)
        assert np.isnan(one.force[[2, 3, 6, 7, 8, 10], 2]).all()
    said = f"force: {header} of {{file}}/log.csv is taken for the number of a frame"
    assert (said in doubts) == (header in ("idx", "i"))


def test_rows_that_are_counted_are_no_frames(tmp_path: Path) -> None:
    folder(tmp_path, "i,Fz", [f"{n},{n}" for n in range(6)])
    assert all(one.force is None for one in read(tmp_path)[0])


@pytest.mark.parametrize(
    "header", ["F (N)", "Normalkraft [N]", "法向力 (N)", "F_n", "grams", "Force-Z", "$F_z$", "力"]
)
def test_the_only_force_is_the_normal_one(header: str, tmp_path: Path) -> None:
    folder(tmp_path, f"frame,{header}", [f"{n},{z}" for n, z in enumerate(FORCE)])
    found, _ = read(tmp_path)
    for one in found:
        assert one.force is not None
        factor = 9.80665e-3 if header == "grams" else 1
        np.testing.assert_allclose(one.force[:, 2], factor * FORCE, rtol=1e-6)
        assert np.isnan(one.force[:, :2]).all()


@pytest.mark.parametrize("header", ["F_total", "F1", "|F|", "contact force #2"])
def test_a_hint_about_a_force_is_right_as_it_is_pasted(header: str, tmp_path: Path) -> None:
    folder(tmp_path, f'millis,"{header}",F_res', [f"{n / 0.03},{z},0" for n, z in enumerate(FORCE)])
    found, doubts = read(tmp_path)
    assert all(one.force is None for one in found)
    (line,) = (line for line in doubts if "say no axis" in line)
    hint = yaml.safe_load(line.partition("name those along x, y and z): ")[2])
    assert hint["force"]["columns"] == [None, None, header]
    for one in read(tmp_path, **hint)[0]:
        assert one.force is not None
        np.testing.assert_allclose(one.force[:, 2], FORCE, atol=1e-3)


def test_numbers_of_a_camera_are_no_force(tmp_path: Path) -> None:
    folder(tmp_path, "fx,fy,cx,cy", ["600.1,600.2,320,240"])
    found, doubts = read(tmp_path)
    assert all(one.force is None for one in found)
    assert not any(line.startswith("force") for line in doubts)


def test_several_forces_are_asked_for_with_a_right_hint(tmp_path: Path) -> None:
    folder(tmp_path, "frame,fz_a,fz_b", [f"{n},{z},0" for n, z in enumerate(FORCE)])
    found, doubts = read(tmp_path)
    assert all(one.force is None for one in found)
    (line,) = (line for line in doubts if line.startswith("force: fz_a, fz_b"))
    hint = yaml.safe_load(line.partition("if they act on the gel: ")[2])
    for one in read(tmp_path, **hint)[0]:
        assert one.force is not None
        np.testing.assert_allclose(one.force[:, 2], FORCE, atol=1e-6)


@pytest.mark.parametrize("header", ["frame,fn,Fz", "frame,fn,note"])
def test_a_name_of_a_file_is_no_force(header: str, tmp_path: Path) -> None:
    folder(tmp_path, header, [f"{n},shot{n}.png,{z}" for n, z in enumerate(FORCE)])
    found, doubts = read(tmp_path)
    for one in found:
        if "Fz" in header:
            assert one.force is not None
            np.testing.assert_allclose(one.force[:, 2], FORCE, atol=1e-6)
        else:
            assert one.force is None
    assert not any(line.startswith("force: fn") for line in doubts)


def test_columns_of_0_and_1_are_tracks(tmp_path: Path) -> None:
    slip = [int(n > 8) for n in range(COUNT)]
    rows = [f"{n},{int(n > 2)},{slip[n]},{n % 3}" for n in range(COUNT)]
    folder(tmp_path, "frame,contact,slip,phase", rows)
    found, doubts = read(tmp_path)
    assert "tracks: contact, slip of each frame by {file}/log.csv" in doubts
    for one in found:
        assert one.tracks.keys() == {"contact", "slip"}
        np.testing.assert_array_equal(one.tracks["slip"], slip)


def test_messages_without_names_of_columns_are_asked_for(tmp_path: Path) -> None:
    start = 1_715_600_000
    for k in range(3):
        images = tmp_path / f"trial_{k}/gelsight"
        images.mkdir(parents=True)
        rows = []
        for i in range(30):
            now = (start + 100 * k) * 10**9 + 70_000_000 * i
            picture = np.full((48, 64, 3), 60 + i, np.uint8)
            Image.fromarray(picture).save(images / f"{now}.png")
            force = f"{0.01 * i},{-0.02 * i},{0.1 * (k + 1) * i}"
            rows.append(f"{now // 10**9},{now % 10**9},ft_link,{force},0,0,0")
        (tmp_path / f"trial_{k}/wrench.csv").write_text("\n".join(rows) + "\n")
    guess = Recordings.recognise(tmp_path)
    assert guess is not None
    (line,) = (line for line in guess.doubts if line.startswith("force:"))
    assert "0 and 1 look like seconds and nanoseconds (0: 1715600000 to 1715600002, 1: 0 to" in line
    assert "2: 'ft_link', 3: 0 to 0.29, 4: -0.58 to 0, 5: 0 to 2.9, 6: 0 to 0" in line
    ((name, layout),) = guess.options["layouts"].items()
    assert "force" not in layout
    force = yaml.safe_load(line.partition("if 3, 4, 5 are forces: ")[2])
    data = Recordings(str(tmp_path), layouts={name: {**layout, **force}})
    found = [one for split in ("train", "val") for one in data.recordings(split)]
    assert len(found) == 3
    for one in found:
        k, n = int(one.key.split("/")[1][-1]), np.arange(30)
        assert one.force is not None
        wanted = np.stack([0.01 * n, -0.02 * n, 0.1 * (k + 1) * n], 1)
        np.testing.assert_allclose(one.force, wanted, atol=1e-5)
