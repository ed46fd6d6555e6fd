"""Formats recognised in folders, layouts guessed from files, and the command to keep them."""

import json
import shlex
import subprocess
import sys
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from made_files import make_files, press
from PIL import Image
from tactileforge_sim.dataset import Sim

from tactileforge.cli import dispatch
from tactileforge.contracts import Guess
from tactileforge.datasets.recognition import recognise
from tactileforge.datasets.recordings import Recordings
from tactileforge.errors import ConfigError, DataError, DataNotFoundError
from tactileforge.packing import PackOptions, pack
from tactileforge.plugin import build
from tactileforge.plugins import registry
from tactileforge.reading.guessing.layout import guess_layout
from tactileforge.util.untrusted import load_yaml

inspect = partial(dispatch, "data")


@pytest.fixture
def videos(tmp_path: Path) -> Path:
    make_files("DIR", tmp_path)
    (tmp_path / "DIR" / "tactileforge.yaml").unlink()
    return tmp_path / "DIR"


def read(root: Path, guess: Guess | None):
    assert guess is not None
    data = Recordings(**guess.options)
    found = [touch for split in ("train", "val") for touch in data.recordings(split)]
    assert not data.skipped
    return found


def test_videos_with_tables_of_forces_and_objects(videos: Path) -> None:
    guess = guess_layout(videos)
    found = read(videos, guess)
    assert len(found) == 24
    assert {touch.object for touch in found} == {f"o{number}" for number in range(8)}
    first = next(touch for touch in found if "t3." in touch.key)
    np.testing.assert_allclose(first.force[:, 1], 0.3)
    assert first.force[:, 2].max() == pytest.approx(5, abs=0.1)
    assert any(doubt.startswith("force: taken for newton") for doubt in guess.doubts)


def test_folders_of_classes_are_touches(tmp_path: Path) -> None:
    make_files("photos", tmp_path)
    found = read(tmp_path / "photos", guess_layout(tmp_path / "photos"))
    assert len(found) == 16
    assert {touch.object for touch in found} == {"bolt", "nut"}


@pytest.mark.parametrize("mark", [",", ";"])
def test_a_table_of_taxels_says_the_command_to_read_it(
    mark: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "labels.csv").write_text("file_1,file_2,file_3,file_4\n1,2,3,4\n")
    for k in range(2):
        rows = [["time", *(f"taxel_{i}" for i in range(16)), "force_z"]]
        rows += [[n / 20, *(n + i for i in range(16)), 0.1 * (k + 1) * n] for n in range(20)]
        lines = [mark.join(map(str, row)) for row in rows]
        (tmp_path / f"press_{k}.csv").write_text("\n".join(lines) + "\n")
    with pytest.raises(DataNotFoundError, match=r"press_0.csv is a table of 16 taxels, .* 1 more"):
        recognise(tmp_path)
    with pytest.raises(DataNotFoundError) as error:
        recognise(tmp_path / "press_1.csv")
    command = str(error.value).partition("in its folder: ")[2]
    monkeypatch.chdir(tmp_path)
    (tmp_path / "labels.csv").unlink()
    subprocess.run([sys.executable, *shlex.split(command)[1:]], check=True)
    recognise.cache_clear()
    (name, guess), *_ = recognise(tmp_path)
    data = build("datasets", {"name": name, **guess.options})
    found = [one for split in ("train", "val") for one in data.recordings(split)]
    assert len(found) == 2
    for one in found:
        k = int(one.key.split("/")[0][-1])
        assert one.frames.shape == (4, 4)
        np.testing.assert_allclose(one.force[:, 2], 0.1 * (k + 1) * np.arange(20), atol=1e-6)
        np.testing.assert_allclose(one.times, np.arange(20) / 20)


@pytest.mark.parametrize("stamped", [False, True])
def test_images_that_follow_each_other_are_recordings(tmp_path: Path, stamped: bool) -> None:
    for number in range(3):
        folder = tmp_path / "digit_set" / f"take_{number}"
        folder.mkdir(parents=True)
        for row, frame in enumerate(press(number, 24)):
            name = 1763000000000 + 33 * row if stamped else row
            Image.fromarray(frame).save(folder / f"{name}.png")
        rows = "".join(f"{row / 30},0,0,{row / 10}\n" for row in range(24))
        (folder / f"take_{number}.csv").write_text("t,fx [N],fy [N],fz [N]\n" + rows)
    guess = guess_layout(tmp_path / "digit_set")
    layout = guess.options["layouts"]["guessed"]
    of_table = {"file": "{file}/{stem}.csv", "column": "t"}
    assert layout["times"] == ("names" if stamped else of_table)
    assert "fps" not in layout
    assert layout["sensor"] == "digit", "by the name of the folder"
    assert layout["force"]["file"] == "{file}/{stem}.csv"
    found = read(tmp_path, guess)
    assert [len(touch.frames) for touch in found] == [24] * 3
    assert found[0].force[20, 2] == pytest.approx(2, abs=0.1)


def test_a_table_of_forces_of_single_images_and_a_background(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    rows = ["image,fz"]
    for number in range(6):
        image = rng.integers(0, 256, (32, 24, 3), np.uint8)
        Image.fromarray(image).save(tmp_path / f"{number}.png")
        rows.append(f"{number}.png,{number}")
    Image.fromarray(np.full((32, 24, 3), 90, np.uint8)).save(tmp_path / "background.png")
    (tmp_path / "forces.csv").write_text("\n".join(rows) + "\n")
    guess = guess_layout(tmp_path)
    assert not [doubt for doubt in guess.doubts if "left out" in doubt]
    found = read(tmp_path, guess)
    assert sorted(float(touch.force[0, 2]) for touch in found) == list(range(6))
    assert found[0].background()[0, 0, 0] == 90

    (tmp_path / "forces.csv").write_text("\n".join(rows).replace(",", ";") + "\n")
    (tmp_path / "notes.csv").write_text("day,weather\n1,rain\n")
    guess = guess_layout(tmp_path)
    (line,) = [doubt for doubt in guess.doubts if "left out" in doubt]
    assert line.startswith("labels: notes.csv is left out, since no force of a known")
    assert sorted(touch.force[0, 2] for touch in read(tmp_path, guess)) == list(range(6))


@pytest.mark.slow
def test_the_command_reads_keeps_and_says_what_is_doubtful(
    videos: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    page = tmp_path / "page.html"
    assert inspect(["inspect", str(videos), f"out={page}", "data.val=0.5"]) == 0
    told = capsys.readouterr().out
    assert "a folder of videos, read by data=recordings" in told
    assert "to be checked: sensor: no name tells the type" in told
    assert "24 recordings" in told
    assert "To be checked: sensor: no name tells the type" in page.read_text()
    kept = load_yaml(page.with_suffix(".yaml").read_text())
    (videos / "tactileforge.yaml").write_text(page.with_suffix(".yaml").read_text())
    assert kept["layouts"]["guessed"]["object"] == "{object}"
    assert recognise.__wrapped__(videos)[0][1].score == 1, "the kept layout is the format now"


def test_shards_are_recognised_and_their_options_kept(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    packed = tmp_path / "it's packed"
    pack(Sim(scenes=2, val=1, size=32), "sim", packed, PackOptions(processes=1))
    assert recognise(packed)[0][0] == "shards"
    page = tmp_path / "page.html"
    assert inspect(["inspect", str(packed), f"out={page}"]) == 0
    assert "read by data=shards" in capsys.readouterr().out
    kept = load_yaml(page.with_suffix(".yaml").read_text())
    assert (kept["name"], kept["root"]) == ("shards", str(packed))
    (packed / "index.json").write_text(json.dumps({"foreign": 1}))
    assert recognise.__wrapped__(packed)[0][0] == "shards", "by its tar files"


def test_what_nobody_recognises(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog) -> None:
    with pytest.raises(DataNotFoundError, match="no such folder"):
        inspect(["inspect", str(tmp_path / "gone")])
    with pytest.raises(DataNotFoundError, match="no videos or images"):
        inspect(["inspect", str(tmp_path)])
    with pytest.raises(ConfigError, match="leave the path out, or data=sim"):
        inspect(["inspect", str(tmp_path), "data=sim"])

    class Broken:
        @staticmethod
        def recognise(root: Path) -> Guess | None:
            raise ZeroDivisionError("of nothing")

    real = registry.get
    monkeypatch.setattr(
        registry, "get", lambda kind, name: Broken if name == "visgel" else real(kind, name)
    )
    make_files("photos", tmp_path)
    assert recognise(tmp_path / "photos")[0][0] == "recordings"
    assert "data set visgel cannot look at" in caplog.text


@pytest.mark.parametrize(
    ("column", "unit"),
    [("timestamp", 1e3), ("timestamp_ms", 1e3), ("time_ms", 1e3), ("t_ns", 1e9), ("stamp", 1.0)],
)
def test_forces_with_dates_beside_videos_without(
    tmp_path: Path, make_video, column: str, unit: float
) -> None:
    make_video("0.avi", count=30)
    rows = (f"{round((1.763e9 + i / 100) * unit, 2):.16g},0,0,{i / 20}\n" for i in range(100))
    (tmp_path / "0.csv").write_text(f"{column},fx,fy,fz\n" + "".join(rows))
    guess = guess_layout(tmp_path)
    assert guess is not None
    (layout,) = guess.options["layouts"].values()
    assert layout["force"] == {
        "file": "{stem}.csv",
        "columns": ["fx", "fy", "fz"],
        "times": column,
        "start": "contact",
    }
    assert any("start: first_row" in doubt for doubt in guess.doubts)
    layout["force"]["start"] = "first_row"
    (one,) = read(tmp_path, guess)
    assert one.force is not None
    np.testing.assert_allclose(one.force[:, 2], one.times * 5, atol=0.01)


def test_a_guess_that_fails_is_kept_to_be_corrected(
    tmp_path: Path, make_video, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    make_video("touches/0.avi", count=30)
    # no force: nothing tells where the clocks meet
    rows = (f"{1763000000000 + 10 * i},0,0,0\n" for i in range(100))
    (tmp_path / "touches/0.csv").write_text("timestamp_ms,fx,fy,fz\n" + "".join(rows))
    monkeypatch.chdir(tmp_path)
    with pytest.raises(DataError, match="start: contact"):
        inspect(["inspect", "touches"])
    assert "layout: inspect.yaml; correct it" in capsys.readouterr().out
    (layout,) = load_yaml(Path("inspect.yaml").read_text())["layouts"].values()
    assert layout["force"]["start"] == "contact"


def test_a_film_that_is_not_read_is_named_with_its_conversion(tmp_path: Path) -> None:
    Image.new("RGB", (8, 8)).save(tmp_path / "a demo.gif")
    with pytest.raises(
        DataNotFoundError, match=r"is a GIF, of 256 colours: ffmpeg -i 'a demo.gif'"
    ):
        recognise(tmp_path)


def test_a_path_is_not_guessed_where_that_is_said(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"data\.guess=false, and a path, which is guessed: give"):
        inspect(["inspect", str(tmp_path), "data.guess=false"])


def test_arrays_of_one_picture_each_are_named_with_the_fix(tmp_path: Path) -> None:
    for number in range(3):
        np.save(tmp_path / f"{number:04d}.npy", np.zeros((40, 60, 3), np.uint8))
    with pytest.raises(DataNotFoundError, match=r"one picture of \(40, 60, 3\).*np\.stack"):
        recognise(tmp_path)


@pytest.mark.parametrize(
    ("name", "says"),
    [
        ("trial 0.h264", "a film without times: ffmpeg -framerate 30 -i 'trial 0.h264' -c copy "),
        ("a.wmv", "a film: ffmpeg -i a.wmv -c:v ffv1 a.mkv"),
    ],
)
def test_films_of_other_kinds_are_named_with_their_conversion(
    name: str, says: str, tmp_path: Path
) -> None:
    (tmp_path / name).write_bytes(b"0")
    with pytest.raises(DataNotFoundError, match=f"is {says}"):
        recognise(tmp_path)
