"""Tables with a recording named by two columns together, such as object and take."""

from collections.abc import Callable, Sequence
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image

from tactileforge.contracts import Recording
from tactileforge.datasets import Recordings
from tactileforge.errors import DataError
from tactileforge.reading.guessing.layout import guess_layout

COUNT = 8
OBJECTS = ("mug", "bolt")
TAKES = (2, 3)
PAIRS = [(name, take) for name in OBJECTS for take in TAKES]


def level(name: str, take: int, n: int) -> int:
    return 40 + 90 * OBJECTS.index(name) + 40 * TAKES.index(take) + 4 * n


def force(name: str, take: int, n: int) -> list[float]:
    return [0.25 * OBJECTS.index(name), 0.5 * take, 0.125 * n]


def picture(grey: int) -> np.ndarray:
    return np.full((16, 24, 3), grey, np.uint8)


def folders(root: Path, named: Callable[[str, int], str], start: int = 0) -> None:
    for name, take in PAIRS:
        for n in range(COUNT):
            path = root / named(name, take) / f"{n + start:04d}.png"
            path.parent.mkdir(parents=True, exist_ok=True)
            Image.fromarray(picture(level(name, take, n))).save(path)


def film(path: Path, name: str, take: int) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"FFV1"), 30, (24, 16))
    for n in range(COUNT):
        writer.write(picture(level(name, take, n)))
    writer.release()


def table(path: Path, header: str, row: Callable[[str, int, int], Sequence[object]]) -> None:
    rows = [row(name, take, n) for n in range(COUNT) for name, take in PAIRS]
    path.write_text("\n".join([header, *(",".join(map(str, one)) for one in rows)]) + "\n")


def labels(path: Path, header: str, row: Callable[[str, int], Sequence[object]]) -> None:
    rows = [",".join(map(str, row(name, take))) for name, take in PAIRS]
    path.write_text("\n".join([header, *rows]) + "\n")


def read(root: Path) -> tuple[list[Recording], str]:
    guess = guess_layout(root)
    assert guess is not None
    data = Recordings(**guess.options)
    found = [one for split in ("train", "val") for one in data.recordings(split)]
    assert not data.skipped
    return found, "\n".join(guess.doubts)


def at(grey: int) -> tuple[str, int, int]:
    rest = grey - 40
    return OBJECTS[rest // 90], TAKES[rest % 90 // 40], round(rest % 90 % 40 / 4)


def check_forces(found: Sequence[Recording]) -> None:
    seen = 0
    for one in found:
        greys = one.frames.read(range(len(one.frames)))[:, 0, 0, 0].astype(int)
        assert one.force is not None
        wanted = np.array([force(*at(grey)) for grey in greys], np.float32)
        np.testing.assert_array_equal(one.force, wanted)
        seen += len(greys)
    assert seen == COUNT * len(PAIRS)


NAMED: dict[str, tuple[str, Callable[[str, int], str], Callable[[str, int], Sequence[object]]]] = {
    "folders": ("object,take", lambda o, t: f"{o}/{t:02d}", lambda o, t: [o, t]),
    "one folder": ("object,take", lambda o, t: f"{o}_{t:02d}", lambda o, t: [o, t]),
    "a word": ("item,trial", lambda o, t: f"data/{o}/take{t}", lambda o, t: [o, f"take{t}"]),
    "words apart": ("a,b", lambda o, t: f"{o}-trial_{t:03d}", lambda o, t: [o, t]),
    "turned": ("take,object", lambda o, t: f"2024-05-01_{o}_{t}", lambda o, t: [t, o]),
    "capitals": ("object,rep", lambda o, t: f"{o.title()}/rep_{t}", lambda o, t: [o, t]),
    "as floats": ("object,take", lambda o, t: f"{o}/{t:02d}", lambda o, t: [o, f"{t}.0"]),
    "below": ("object,take", lambda o, t: f"{o}/{t:02d}/tactile", lambda o, t: [o, t]),
}


@pytest.mark.parametrize("case", NAMED)
def test_forces_by_two_columns_and_frame(case: str, tmp_path: Path) -> None:
    header, folder, cells = NAMED[case]
    folders(tmp_path, folder)
    table(
        tmp_path / "forces.csv",
        f"{header},frame,fx,fy,fz",
        lambda o, t, n: [*cells(o, t), n, *force(o, t, n)],
    )
    found, doubts = read(tmp_path)
    check_forces(found)
    assert "forces.csv are of the recording that " in doubts
    assert (
        " and ".join(header.split(",")) in doubts or " and ".join(header.split(",")[::-1]) in doubts
    )


@pytest.mark.parametrize("named", ["{o}-{t}.avi", "{o}/{t:02d}.avi", "{o}/{t:02d}/touch.avi"])
def test_films_and_their_labels_by_two_columns(named: str, tmp_path: Path) -> None:
    for o, t in PAIRS:
        film(tmp_path / named.format(o=o, t=t), o, t)
    table(
        tmp_path / "ft.csv",
        "object,take,frame,fx,fy,fz",
        lambda o, t, n: [o, t, n, *force(o, t, n)],
    )
    labels(tmp_path / "labels.csv", "object,take,hardness", lambda o, t: [o, t, 10 * t + len(o)])
    found, doubts = read(tmp_path)
    check_forces(found)
    for one in found:
        o, t, _ = at(int(one.frames.read([0])[0, 0, 0, 0]))
        assert (one.object, one.labels["hardness"]) == (o, 10 * t + len(o))
    assert "labels.csv are of the recording that object and take name together" in doubts


@pytest.mark.parametrize("named", ["{o}_{t:02d}_{s}.avi", "{s}/{o}_{t}.avi", "{o}/{t}/{s}.avi"])
def test_both_sensors_have_the_row_of_their_take(named: str, tmp_path: Path) -> None:
    for o, t in PAIRS:
        for side in ("left", "right"):
            film(tmp_path / named.format(o=o, t=t, s=side), o, t)
    labels(tmp_path / "labels.csv", "object,take,hardness", lambda o, t: [o, t, 10 * t + len(o)])
    found, _ = read(tmp_path)
    assert len(found) == 2 * len(PAIRS)
    for one in found:
        o, t, _ = at(int(one.frames.read([0])[0, 0, 0, 0]))
        assert (one.object, one.labels["hardness"]) == (o, 10 * t + len(o))


def test_images_that_three_columns_name(tmp_path: Path) -> None:
    folders(tmp_path, lambda o, t: f"{o}/{t:02d}", start=5)
    table(
        tmp_path / "forces.csv",
        "object,take,image,fx,fy,fz",
        lambda o, t, n: [o, t, f"{n + 5:04d}.png", *force(o, t, n)],
    )
    check_forces(read(tmp_path)[0])


def test_a_row_of_nothing_is_named(tmp_path: Path) -> None:
    folders(tmp_path, lambda o, t: f"{o}/{t:02d}")
    labels(tmp_path / "labels.csv", "object,take,hardness", lambda o, t: [o, t, 1])
    with (tmp_path / "labels.csv").open("a") as file:
        file.write("cup,2,1\n")
    with pytest.raises(DataError, match=r"labels.csv, row 6: 'cup/2' names no file"):
        read(tmp_path)
    table(
        tmp_path / "labels.csv",
        "object,take,frame,fx,fy,fz",
        lambda o, t, n: [o if (o, n) != ("mug", 4) else "mgu", t, n, *force(o, t, n)],
    )
    with pytest.raises(DataError, match=r"labels.csv, row \d+: .*'mgu/2' names no recording"):
        read(tmp_path)


def test_a_row_of_several_is_named(tmp_path: Path) -> None:
    folders(tmp_path, lambda o, t: f"{o}/{t:02d}")
    (tmp_path / "bolt/03").rename(tmp_path / "bolt/2")  # bolt/02 and bolt/2
    layout = {"images": "*/*/*.png", "each": "sequence", "fps": 30, "sensor": "digit"}
    layout |= {"background": "none", "labels": {"file": "l.csv", "key": "{object}/{take}"}}
    (tmp_path / "l.csv").write_text("object,take\nmug,02\nbolt,002\n")
    with pytest.raises(DataError, match=r"l.csv, row 3: 'bolt/002' names no file"):
        list(Recordings(str(tmp_path), {"x": layout}).recordings("train"))
    (tmp_path / "l.csv").write_text("object,take\nmug,02\nbolt,\n")
    with pytest.raises(DataError, match=r"l.csv, row 3: {object}/{take} name a file together"):
        list(Recordings(str(tmp_path), {"x": layout}).recordings("train"))


def test_numbers_in_either_order_are_not_guessed(tmp_path: Path) -> None:
    for a, b in ((1, 2), (2, 1), (1, 1), (2, 2)):
        film(tmp_path / f"{a}/{b}.avi", "mug", 2)
    rows = [f"{a},{b},{a + b}" for a, b in ((1, 2), (2, 1), (1, 1), (2, 2))]
    (tmp_path / "labels.csv").write_text("\n".join(["x,y,hardness", *rows]) + "\n")
    found, doubts = read(tmp_path)
    assert all("hardness" not in one.labels for one in found)
    assert "labels.csv is left out" in doubts


def test_a_row_of_a_recording_each_comes_before_one_of_its_trial(tmp_path: Path) -> None:
    for name, take in PAIRS:
        film(tmp_path / f"clip{take}_{'left' if name == 'mug' else 'right'}.avi", name, take)
    labels(
        tmp_path / "labels.csv",
        "video,side,hardness",
        lambda o, t: [f"clip{t}", "left" if o == "mug" else "right", 10 * t + len(o)],
    )
    found, _ = read(tmp_path)
    assert len(found) == len(PAIRS)
    for one in found:
        o, t, _ = at(int(one.frames.read([0])[0, 0, 0, 0]))
        assert one.labels["hardness"] == 10 * t + len(o)
        assert set(one.labels) == {"video", "side", "hardness"}


def test_a_date_and_a_time_name_a_recording(tmp_path: Path) -> None:
    days, times = ("2024-05-01", "2024-05-02"), ("10-00-00", "11-30-00")
    names = {pair: (days[i // 2], times[i % 2]) for i, pair in enumerate(PAIRS)}
    for (o, t), (day, time) in names.items():
        film(tmp_path / f"{day}_{time}.avi", o, t)
    labels(
        tmp_path / "log.csv",
        "date,time,object",
        lambda o, t: [names[o, t][0], names[o, t][1].replace("-", ":"), o],
    )
    found, _ = read(tmp_path)
    assert len(found) == len(PAIRS)
    for one in found:
        assert one.object == at(int(one.frames.read([0])[0, 0, 0, 0]))[0]


def test_a_german_table_of_all_trials_with_decimal_commas(tmp_path: Path) -> None:
    for o, t in PAIRS:
        film(tmp_path / f"{o}_{t:02d}.avi", o, t)
    rows = ["Objekt;Versuch;Zeit [s];Fx [N];Fy [N];Fz [N]"]
    for o, t in PAIRS:
        for n in range(COUNT):
            cells = ";".join(
                f"{value:.4f}".replace(".", ",") for value in (n / 30, *force(o, t, n))
            )
            rows.append(f"{o};{t};{cells}")
    (tmp_path / "kraefte.csv").write_text("\n".join(rows) + "\n")
    found, _ = read(tmp_path)
    for one in found:
        o, t, _ = at(int(one.frames.read([0])[0, 0, 0, 0]))
        assert one.force is not None
        wanted = [force(o, t, n) for n in range(COUNT)]
        np.testing.assert_allclose(one.force, wanted, atol=2e-4)
    assert len(found) == len(PAIRS)


def test_times_with_their_unit_in_names_and_in_the_header(tmp_path: Path) -> None:
    for name, take in PAIRS:
        for n in range(COUNT):
            path = tmp_path / f"{name}{take}" / f"{n * 40:06d}ms.png"
            path.parent.mkdir(parents=True, exist_ok=True)
            Image.fromarray(picture(level(name, take, n))).save(path)
        rows = [f"{10 * i},{i / 40}" for i in range(4 * COUNT)]
        (tmp_path / f"{name}{take}.csv").write_text("\n".join(["ms,Fz", *rows]) + "\n")
    found, _ = read(tmp_path)
    assert len(found) == len(PAIRS)
    for one in found:
        np.testing.assert_allclose(one.times, np.arange(COUNT) / 25)
        assert one.force is not None
        np.testing.assert_allclose(one.force[:, 2], np.arange(COUNT) / 10, atol=1e-6)


def test_normal_and_shear_are_forces(tmp_path: Path) -> None:
    for o, t in PAIRS:
        film(tmp_path / f"{o}{t}.avi", o, t)
        rows = [f"{n},{x},{y},{-z}" for n in range(COUNT) for x, y, z in [force(o, t, n)]]
        text = "\n".join(["frame,shear_x,shear_y,normal", *rows])
        (tmp_path / f"{o}{t}.csv").write_text(text + "\n")
    found, doubts = read(tmp_path)
    check_forces(found)
    assert "normal is negative where it is large, so z is turned" in doubts


def test_paths_of_another_machine_and_another_folder_are_not_guessed(tmp_path: Path) -> None:
    folders(tmp_path, lambda o, t: "unit")
    rows = [f"/home/ann/frames/{n:04d}.png,{n}" for n in range(COUNT)]
    (tmp_path / "unit/marks.csv").write_text("\n".join(["img_name,radius", *rows]) + "\n")
    found, doubts = read(tmp_path)
    assert sum(len(one.frames) for one in found) == COUNT
    assert "labels: unit/marks.csv is left out" in doubts
    (tmp_path / "unit/marks.csv").write_text(
        "\n".join(["img_name,radius", *rows]).replace("/frames/", "/unit/") + "\n"
    )
    assert "radius by unit/marks.csv" in read(tmp_path)[1]


@pytest.mark.parametrize("mark", ["_", "-"])
def test_arrays_named_by_folder_and_recording(mark: str, tmp_path: Path) -> None:
    folders(tmp_path, lambda o, t: f"img/{o}/{t:02d}")
    (tmp_path / "forces").mkdir()
    for o, t in PAIRS:
        rows = np.array([force(o, t, n) for n in range(COUNT)], np.float32)
        np.save(tmp_path / f"forces/{o}{mark}{t:02d}.npy", rows)
    check_forces(read(tmp_path)[0])


def test_rows_of_folders_of_objects_name_the_object(tmp_path: Path) -> None:
    for o, t in PAIRS:
        film(tmp_path / o / f"{t}.avi", o, t)
    (tmp_path / "materials.csv").write_text("object,young_kpa\nmug,20\nbolt,40\n")
    found, doubts = read(tmp_path)
    for one in found:
        o, _, _ = at(int(one.frames.read([0])[0, 0, 0, 0]))
        assert (one.object, one.labels["young_kpa"]) == (o, 20 * (1 + OBJECTS.index(o)))
    assert "labels: object by materials.csv" in doubts


def test_a_table_is_of_the_sensor_whose_folder_its_rows_name(tmp_path: Path) -> None:
    folders(tmp_path, lambda o, t: "digit" if o == "mug" else "gelslim")
    for sensor in ("digit", "gelslim"):
        rows = [f"{sensor}/{n:04d}.png,{n + len(sensor)}" for n in range(COUNT)]
        text = "\n".join(["img_name,radius", *rows])
        (tmp_path / f"{sensor}_annotations.csv").write_text(text + "\n")
    found, doubts = read(tmp_path)
    assert {one.sensor for one in found} == {"digit", "gelslim"}
    assert "digit: labels: radius by digit_annotations.csv" in doubts
    assert "gelslim: labels: radius by gelslim_annotations.csv" in doubts
