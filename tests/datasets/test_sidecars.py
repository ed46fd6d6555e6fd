"""Labels beside recordings as labs keep them: read with no key typed, to the right values."""

import json
from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pytest
from made_files import press
from PIL import Image
from videos import write_video

from tactileforge.contracts import Guess, Recording
from tactileforge.datasets.recognition import recognise
from tactileforge.datasets.recordings import Recordings
from tactileforge.errors import ConfigError, DataError, DataNotFoundError
from tactileforge.reading import records
from tactileforge.reading.guessing.layout import guess_layout
from tactileforge.reading.records import conversion

RNG = np.random.default_rng(0)
SIZE = (12, 16, 3)


def image(path: Path, value: int | None = None, size: tuple[int, int, int] = SIZE) -> None:
    """A picture of one level, or one unlike its neighbours."""
    path.parent.mkdir(parents=True, exist_ok=True)
    pixels = RNG.integers(60, 200, size) if value is None else np.full(size, value)
    Image.fromarray(pixels.astype(np.uint8)).save(path)


def table(path: Path, header: str, rows: Iterable[str]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("\n".join([header, *rows]) + "\n")


def read(root: Path) -> tuple[dict[str, Recording], Guess]:
    """Recordings by key, as guessed."""
    guess = guess_layout(root)
    assert guess is not None
    data = Recordings(**guess.options)
    found = {one.key: one for split in ("train", "val") for one in data.recordings(split)}
    assert not data.skipped
    return found, guess


def layout_of(guess: Guess) -> dict[str, object]:
    (layout,) = guess.options["layouts"].values()
    return layout


def test_forces_times_and_names_beside_the_folders_of_a_trial(tmp_path: Path) -> None:
    for trial in range(3):
        start = 1.7e9 + 100 * trial
        for side in ("left", "right"):
            for n in range(30):
                image(tmp_path / f"trial_{trial:03d}/{side}/{n:06d}.png", 90 + n)
        folder = tmp_path / f"trial_{trial:03d}"
        rows = (f"{start + n / 100:.3f},0,0,{n / 50 + trial}" for n in range(100))
        table(folder / "forces.csv", "timestamp,Fx,Fy,Fz", rows)
        rows = (f"{n},{start + n / 25:.6f}" for n in range(30))
        table(folder / "frame_times.csv", "frame,timestamp", rows)
        (folder / "meta.json").write_text(json.dumps({"object": f"mug {trial}", "sensor": "digit"}))
    found, guess = read(tmp_path)
    assert len(found) == 6
    for key, one in found.items():
        trial = int(key.split("/")[1][-3:])
        assert (one.sensor, one.object) == ("digit", f"mug {trial}")
        np.testing.assert_allclose(one.times, np.arange(30) / 25, atol=1e-5)
        known = one.times < 0.98
        wanted = 2 * one.times[known] + trial
        np.testing.assert_allclose(one.force[known, 2], wanted, atol=1e-4)
    assert not any("left out" in line or line.startswith("fps:") for line in guess.doubts)
    (tmp_path / "trial_001" / "forces.csv").unlink()
    found, guess = read(tmp_path)
    assert {key for key, one in found.items() if one.force is None} == {
        f"guessed/trial_001/{side}" for side in ("left", "right")
    }
    line = "force: trial_001/left and 1 more without {folder}/forces.csv get no force"
    assert line in guess.doubts


def test_a_table_of_forces_inside_the_folder_of_pictures(tmp_path: Path) -> None:
    for n in range(20):
        image(tmp_path / f"{n:04d}.png", 90 + n)
    table(tmp_path / "force.csv", "frame,fx,fy,fz", (f"{n},0,0,{n / 10}" for n in range(20)))
    (one,) = read(tmp_path)[0].values()
    np.testing.assert_allclose(one.force[:, 2], np.arange(20) / 10, atol=1e-6)


def test_a_wrench_as_rostopic_exports_it(tmp_path: Path) -> None:
    for run in range(2):
        start = 1_700_000_000_000_000_000 + run * 10**11
        for n in range(20):
            image(tmp_path / f"run{run}/image_raw/{start + n * 33_000_000}.png", 90 + n)
        header = "%time,field.header.seq,field.header.stamp,field.header.frame_id"
        header += "".join(f",field.wrench.force.{axis}" for axis in "xyz")
        stamps = ((n, start + n * 10_000_000) for n in range(64))
        # received half a second after it was measured
        rows = (f"{t + 500_000_000},{n},{t},ft,0,0,{n / 50}" for n, t in stamps)
        table(tmp_path / f"run{run}/ft_wrench.csv", header, rows)
    found, guess = read(tmp_path)
    assert layout_of(guess)["force"]["times"] == "field.header.stamp"
    for one in found.values():
        np.testing.assert_allclose(one.force[:, 2], 2 * one.times, atol=1e-4)


def test_videos_of_a_trial_share_a_table_in_milliseconds(tmp_path: Path) -> None:
    for trial in range(2):
        folder = tmp_path / f"trial_{trial}"
        folder.mkdir()
        for side in ("left", "right"):
            write_video(folder / f"{side}.avi", press(trial, 24), 20)
        rows = (f"{n * 10},0,0,{n / 100 + trial}" for n in range(120))
        table(folder / "forces.csv", "time_ms,Fx (N),Fy (N),Fz (N)", rows)
        table(folder / "info.csv", "object,sensor", [f"o{trial},digit"])
    found, guess = read(tmp_path)
    assert layout_of(guess)["force"]["times"]["unit"] == "ms"
    assert {(one.object, one.sensor) for one in found.values()} == {
        ("o0", "digit"),
        ("o1", "digit"),
    }
    for one in found.values():
        wanted = one.times + int(one.object[1])
        np.testing.assert_allclose(one.force[:, 2], wanted, atol=1e-3)


def test_one_table_of_all_recordings_with_images_in_a_subfolder(tmp_path: Path) -> None:
    rows = []
    for trial, item in enumerate(("mug", "bolt")):
        for n in range(30):
            name = f"{item}_{1_700_000_000 + 100 * trial + n / 30:.6f}.png"
            image(tmp_path / "images" / name, 90 + n)
            rows.append(f"{name},{item},0,0,{n / 10 + trial}")
    table(tmp_path / "labels.csv", "filename,object,fx,fy,fz", rows)
    found, guess = read(tmp_path)
    assert {key: one.object for key, one in found.items()} == {
        "guessed/images/mug": "mug",
        "guessed/images/bolt": "bolt",
    }
    assert "recording" not in layout_of(guess)  # series of one folder are told apart anyway
    both = Recordings(**guess.options)
    assert len([*both.recordings("train"), *both.recordings("val")]) == 2
    assert "2 recordings of 2 trials" in " ".join(both.held_out), "two objects"
    for trial, item in enumerate(("mug", "bolt")):
        one = found[f"guessed/images/{item}"]
        np.testing.assert_allclose(one.times, np.arange(30) / 30, atol=1e-5)
        np.testing.assert_allclose(one.force[:, 2], np.arange(30) / 10 + trial, atol=1e-5)
    by_label = layout_of(guess) | {"recording": "{object}"}
    again = Recordings(str(tmp_path), {"guessed": by_label}, val=0).recordings("train")
    assert {one.key for one in again} == set(found)
    # a layout of one of them passes by the rows of the other
    mugs = layout_of(guess) | {"images": "images/mug_*.png", "recording": None}
    (one,) = Recordings(str(tmp_path), {"guessed": mugs}, val=0).recordings("train")
    assert one.object == "mug"


def test_recordings_are_told_apart_by_what_is_there(tmp_path: Path) -> None:
    layout = {"images": "*.png", "each": "touch", "recording": "{a}", "sensor": "digit"}
    layout["background"] = "none"
    with pytest.raises(ConfigError, match=r"recording is '\{a\}'; give what tells"):
        Recordings(str(tmp_path), {"mine": layout})
    layout |= {"each": "sequence", "fps": 30, "labels": {"file": "l.csv"}}
    for n in range(4):
        image(tmp_path / f"{n}.png", n)
    table(tmp_path / "l.csv", "file,a", ["0.png,x", "1.png,x", "2.png,y", "3.png,"])
    with pytest.raises(DataError, match=r"row 5: no value for recording: '{a}'; fill it in"):
        list(Recordings(str(tmp_path), {"mine": layout}, val=0).recordings("train"))
    layout["recording"] = "{b}"
    with pytest.raises(ConfigError, match="unknown column 'b'"):
        list(Recordings(str(tmp_path), {"mine": layout}, val=0).recordings("train"))


@pytest.mark.parametrize("ending", ["csv", "jsonl"])
def test_folders_of_images_as_hugging_face_has_them(tmp_path: Path, ending: str) -> None:
    for split, count in (("train", 8), ("test", 4)):
        rows = []
        for n in range(count):
            image(tmp_path / split / f"{n:04d}.png")
            name, kind, force = f"{n:04d}.png", "mug" if n % 2 else "bolt", n + count
            row = {"file_name": name, "label": kind, "caption": f"a {kind}", "fz": force}
            rows.append(json.dumps(row) if ending == "jsonl" else f"{name},{kind},a {kind},{force}")
        header = [] if ending == "jsonl" else ["file_name,label,caption,fz"]
        (tmp_path / split / f"metadata.{ending}").write_text("\n".join([*header, *rows]) + "\n")
    guess = guess_layout(tmp_path)
    data = Recordings(**guess.options)
    train, val = (list(data.recordings(split)) for split in ("train", "val"))
    assert (len(train), len(val)) == (8, 4)
    assert sorted(float(one.force[0, 2]) for one in val) == [4, 5, 6, 7]
    assert {(one.object, one.text) for one in train} == {("mug", "a mug"), ("bolt", "a bolt")}


def test_folders_named_by_sensors_have_their_own_background(tmp_path: Path) -> None:
    sizes = {"digit": (16, 12, 3), "gelsight": (16, 12, 3), "gelslim": SIZE}
    for sensor, size in sizes.items():
        for n in range(6):
            image(tmp_path / sensor / f"{n:04d}.png", None, size)
    image(tmp_path / "digit_background.png", 120, sizes["digit"])
    image(tmp_path / "gelslim" / "no_contact.png", 90, sizes["gelslim"])
    found, guess = read(tmp_path)
    assert len(found) == 18
    rest = {key.partition("/")[0]: one for key, one in found.items()}
    assert {name: one.sensor for name, one in rest.items()} == {name: name for name in sizes}
    assert rest["digit"].background()[0, 0, 0] == 120
    assert rest["gelslim"].background()[0, 0, 0] == 90
    assert rest["gelsight"].no_contact is None
    assert {one.object for one in found.values()} == {None}
    assert "digit: sensor: digit, by the name of the folder" in guess.doubts


def test_sensors_below_objects(tmp_path: Path) -> None:
    for name in ("mug", "bolt"):
        for sensor, level in (("digit", 120), ("gelsight_mini", 100)):
            for n in range(4):
                image(tmp_path / name / sensor / f"{n}.png")
            image(tmp_path / name / sensor / "background.png", level)
    found, _ = read(tmp_path)
    assert len(found) == 16
    for key, one in found.items():
        assert (one.sensor, one.object) == (key.split("/")[2], key.split("/")[1])
        assert one.background()[0, 0, 0] == (120 if one.sensor == "digit" else 100)


def test_a_json_beside_each_picture_of_a_recording(tmp_path: Path) -> None:
    for n in range(20):
        image(tmp_path / f"mug/{n}.png", 90 + n)
        row = {"force": [0, 0.5, n / 10], "object": "mug", "timestamp": 1.7e9 + n / 25}
        (tmp_path / f"mug/{n}.json").write_text(json.dumps(row))
    (tmp_path / "mug/meta.json").write_text('{"operator": "x"}')
    (one,) = read(tmp_path)[0].values()
    assert one.object == "mug"
    np.testing.assert_allclose(one.times, np.arange(20) / 25, atol=1e-5)
    wanted = [[0, 0.5, n / 10] for n in range(20)]
    np.testing.assert_allclose(one.force, wanted, atol=1e-6)


@pytest.mark.parametrize("ending", ["json", "yaml"])
def test_a_sidecar_beside_each_touch(tmp_path: Path, ending: str) -> None:
    for name in ("mug", "bolt"):
        for n in range(5):
            image(tmp_path / f"{name}/{n:04d}.png")
            row = {"name": name, "sensor": "digit", "force": {"x": 0.1, "y": 0, "z": n / 10}}
            (tmp_path / f"{name}/{n:04d}.{ending}").write_text(json.dumps(row))
    found, _ = read(tmp_path)
    for key, one in found.items():
        assert (one.object, one.sensor) == (key.split("/")[1], "digit")
        np.testing.assert_allclose(one.force[0], [0.1, 0, int(key[-8:-4]) / 10], atol=1e-6)


def test_rows_in_one_json_of_a_recording(tmp_path: Path) -> None:
    rows = [{"image": f"{n:04d}.jpg", "t": n / 60, "fz": n / 10} for n in range(20)]
    columns = {"t": [n / 60 for n in range(20)], "fz": [n / 10 for n in range(20)]}
    contents = (
        {"sensor": "digit", "frames": rows},
        rows,
        {one.pop("image"): one for one in json.loads(json.dumps(rows))},
        {"sensor": "digit", **columns},
    )
    for number, content in enumerate(contents):
        root = tmp_path / str(number)
        for n in range(20):
            image(root / f"take/{n:04d}.jpg", 90 + n)
        (root / "take/labels.json").write_text(json.dumps(content))
        (one,) = read(root)[0].values()
        np.testing.assert_allclose(one.times, np.arange(20) / 60, atol=1e-6)
        np.testing.assert_allclose(one.force[:, 2], np.arange(20) / 10, atol=1e-6)


def test_what_one_file_says_of_all_recordings(tmp_path: Path) -> None:
    for side in ("left", "right"):
        for n in range(20):
            image(tmp_path / f"{side}/{n:04d}.png", 90 + n)
    about = {"sensor": "digit", "object": "{mug}", "fps": 50, "lens": {"f": 2}}
    (tmp_path / "meta.json").write_text(json.dumps(about))
    table(tmp_path / "forces.csv", "t,fz", (f"{n / 100},{n / 50}" for n in range(40)))
    found, guess = read(tmp_path)
    assert len(found) == 2
    for one in found.values():
        assert (one.sensor, one.object) == ("digit", "{mug}")
        np.testing.assert_allclose(one.times, np.arange(20) / 50, atol=1e-6)
        np.testing.assert_allclose(one.force[:, 2], 2 * one.times, atol=1e-6)
    assert "fps: 50.0, by meta.json" in guess.doubts


@pytest.mark.parametrize(
    ("about", "factor"),
    [
        ({"force_unit": "mN"}, 1e-3),
        ({"units": {"force": "gram", "time": "s"}}, 9.80665e-3),
        ({"unit": "N"}, 1),
        ({"unit": "mm"}, 1),
        ({"force_unit": "V"}, None),
    ],
)
def test_a_file_says_the_unit_of_forces(
    about: dict[str, object], factor: float | None, tmp_path: Path
) -> None:
    for k in range(2):
        for n in range(20):
            image(tmp_path / f"take_{k}/{n:04d}.png", 90 + n)
        table(tmp_path / f"take_{k}/ft.csv", "frame,fz", (f"{n},{n / 10}" for n in range(20)))
    (tmp_path / "meta.json").write_text(json.dumps(about))
    found, guess = read(tmp_path)
    for one in found.values():
        if factor is None:
            assert one.force is None
            assert "force: ft.csv has it in v, left out" in guess.doubts
            continue
        np.testing.assert_allclose(one.force[:, 2], factor * np.arange(20) / 10, rtol=1e-6)
        is_said = any("by units.force of meta.json" in line for line in guess.doubts)
        assert is_said == ("units" in about)


@pytest.mark.parametrize("rate", [20, 30])
def test_two_rates_of_a_film_are_told(rate: int, tmp_path: Path) -> None:
    for k in range(2):
        write_video(tmp_path / f"{k}.avi", press(k, 24), 30)
    (tmp_path / "meta.json").write_text(json.dumps({"camera": {"fps": rate}}))
    found, guess = read(tmp_path)
    for one in found.values():
        np.testing.assert_allclose(one.times, np.arange(24) / 30, atol=1e-6)
    told = [line for line in guess.doubts if "meta.json" in line]
    if rate == 30:
        assert told == []
        return
    (line,) = told
    assert "films say 30 frames a second, which is taken, and camera.fps of meta.json" in line
    layout = layout_of(guess) | {"fps": int(line.rpartition("fps: ")[2])}
    data = Recordings(str(tmp_path), layouts={"guessed": layout}, val=0)
    for one in data.recordings("train"):
        np.testing.assert_allclose(one.times, np.arange(24) / 20, atol=1e-6)
    assert len(list(data.recordings("train"))) == 2


def test_arrays_beside_each_other(tmp_path: Path) -> None:
    pixels = RNG.integers(0, 256, (20, *SIZE), np.uint8)
    forces = np.stack([np.zeros(20), np.ones(20), np.arange(20) / 10], 1)
    for root, name in (("a", "trial_{}/{}.npy"), ("b", "trial_{}_{}.npy")):
        for trial in range(2):
            places = [tmp_path / root / name.format(trial, x) for x in ("frames", "ft", "times")]
            places[0].parent.mkdir(parents=True, exist_ok=True)
            np.save(places[0], pixels + np.uint8(trial))
            np.save(places[1], forces + trial)
            np.save(places[2], 1.7e9 + np.arange(20) / 25)
        found, _ = read(tmp_path / root)
        for trial, one in enumerate(found.values()):
            np.testing.assert_array_equal(one.frames.read([7])[0], pixels[7] + np.uint8(trial))
            np.testing.assert_allclose(one.force, forces + trial, atol=1e-6)
            np.testing.assert_allclose(one.times, np.arange(20) / 25, atol=1e-5)


def test_pages_of_a_tiff_are_a_recording(tmp_path: Path) -> None:
    for trial in range(3):
        pages = [Image.fromarray(np.full(SIZE, 60 + 3 * n + trial, np.uint8)) for n in range(40)]
        pages[0].save(tmp_path / f"t{trial}.tif", save_all=True, append_images=pages[1:])
        rows = (f"{n / 50},{n / 10}" for n in range(40))
        table(tmp_path / f"t{trial}.csv", "t,fz", rows)
    found, _ = read(tmp_path)
    assert [len(one.frames) for one in found.values()] == [40] * 3
    for trial in range(3):
        one = found[f"guessed/t{trial}.tif"]
        assert one.frames.read([39])[0, 0, 0, 0] == 60 + 3 * 39 + trial
        np.testing.assert_allclose(one.force[:, 2], np.arange(40) / 10, atol=1e-6)
        assert one.times[-1] == pytest.approx(39 / 50)
    layout = {"videos": "*.tif", "sensor": "digit", "background": "none"}
    with pytest.raises(ConfigError, match=r"a stack has no times; give layout 'mine' .*fps: 30"):
        list(Recordings(str(tmp_path), {"mine": layout}, val=0).recordings("train"))
    Image.fromarray(np.full(SIZE, 7, np.uint8)).save(tmp_path / "rest.tif")
    layout |= {"fps": 30, "background": {"file": "rest.tif"}}
    found = list(Recordings(str(tmp_path), {"mine": layout}, val=0).recordings("train"))
    assert [one.background()[0, 0, 0] for one in found] == [7] * 3


def test_labels_that_have_to_be_converted_are_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(records, "find_spec", lambda name: None)
    monkeypatch.setattr(records, "names", lambda kind: [])  # no packages
    for n in range(4):
        image(tmp_path / "set" / f"{n}.png")
    (tmp_path / "set" / "labels.xlsx").write_bytes(b"PK\3\4")
    (tmp_path / "set" / "a.mat").write_bytes(b"MATLAB 7.3 MAT-file")
    doubts = "\n".join(guess_layout(tmp_path / "set").doubts)
    assert "labels.xlsx is left out: a spreadsheet: libreoffice --headless" in doubts
    assert "a.mat is left out: MATLAB 7.3, an HDF5: python -c" in doubts
    layout = {"images": "*.png", "each": "touch", "sensor": "digit", "background": "none"}
    layout["labels"] = {"file": "labels.xlsx"}
    with pytest.raises(DataError, match=r"labels.xlsx: not a CSV but a spreadsheet: libreoffice"):
        list(Recordings(str(tmp_path / "set"), {"mine": layout}).recordings("train"))
    (tmp_path / "old").mkdir()
    (tmp_path / "old" / "touch.mat").write_bytes(b"MATLAB 5.0 MAT-file")
    assert conversion(tmp_path / "old" / "touch.mat").startswith("MATLAB: python -c ")
    with pytest.raises(DataNotFoundError, match=r"touch.mat"):
        recognise(tmp_path / "old")
    assert "runs code" in conversion(Path("a.pkl"))
    assert conversion(Path("a.csv")) == ""


@pytest.mark.parametrize(
    ("name", "content", "wanted"),
    [
        ("a.json", "{", "not JSON"),
        ("a.json", "[" * 5000, "nested too deep"),
        ("a.json", "[1, 2]", "int where a row of named values is wanted"),
        ("a.jsonl", '{"a": 1}\n{', "row 2: not JSON"),
        ("a.yaml", "a: 1\na: 2", "not YAML .*'a' comes twice"),
        ("a.npy", "text", "no readable array"),
    ],
)
def test_damaged_sidecars_are_named(tmp_path: Path, name: str, content: str, wanted: str) -> None:
    image(tmp_path / "0.png")
    (tmp_path / name).write_text(content)
    layout = {"images": "*.png", "each": "touch", "sensor": "digit", "background": "none"}
    layout |= {"labels": {"file": name}, "object": "{a}"}
    with pytest.raises(DataError, match=f"{name}.*{wanted}") as error:
        list(Recordings(str(tmp_path), {"mine": layout}, val=0).recordings("train"))
    assert "\n" not in str(error.value)
    guess_layout(tmp_path)


def test_rows_that_count_from_1_beside_images_that_count_from_0(tmp_path: Path) -> None:
    for trial in range(2):
        for n in range(12):
            image(tmp_path / f"t{trial}/frame_{n:05d}.png", 90 + n)
        rows = (f"{n + 1},0,0,{n / 4 + trial}" for n in range(12))
        table(tmp_path / f"t{trial}.csv", "frame,fx,fy,fz", rows)
    found, guess = read(tmp_path)
    for trial in range(2):
        force = found[f"guessed/t{trial}"].force
        assert force is not None
        np.testing.assert_allclose(force[:, 2], np.arange(12) / 4 + trial)
    assert any("frame counts from 1, so each row is of a frame in turn" in d for d in guess.doubts)


def test_a_video_called_as_its_sensor_has_its_labels(tmp_path: Path) -> None:
    for trial in range(3):
        folder = tmp_path / f"trial_{trial}"
        folder.mkdir()
        write_video(folder / "digit.avi", [np.full(SIZE, 90 + n, np.uint8) for n in range(12)])
        (folder / "meta.json").write_text(json.dumps({"sensor": "digit", "object": f"o{trial}"}))
    found, _ = read(tmp_path)
    assert {(one.sensor, one.object) for one in found.values()} == {
        ("digit", f"o{trial}") for trial in range(3)
    }


def test_a_stray_picture_does_not_put_the_other_split_into_training(tmp_path: Path) -> None:
    for split in ("train", "val"):
        for name in ("bolt", "nut"):
            for n in range(4):
                image(tmp_path / f"{split}/{name}/{n}.png")
    image(tmp_path / "train/readme.png")
    found, guess = read(tmp_path)
    assert sorted(guess.options["layouts"]) == ["train", "val"]
    assert len(found) == 17
    data = Recordings(**guess.options)
    assert all("val/" in one.key for one in data.recordings("val"))
    assert not any("val/" in one.key for one in data.recordings("train"))


def test_arrays_of_forces_are_no_films(tmp_path: Path) -> None:
    for n in range(3):
        np.save(tmp_path / f"s{n}.npy", press(n, 20))
        np.save(tmp_path / f"s{n}_force.npy", np.full((20, 3), n + 1.0))
    found, _ = read(tmp_path)
    assert len(found) == 3
    forces = sorted(float(np.asarray(one.force)[0, 2]) for one in found.values())
    assert forces == [1, 2, 3]
