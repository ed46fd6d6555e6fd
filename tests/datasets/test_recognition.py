"""Formats recognised in folders, layouts guessed from files, and the command to keep them."""

import json
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
from tactileforge.errors import ConfigError, DataNotFoundError
from tactileforge.packing import PackOptions, pack
from tactileforge.plugins import registry
from tactileforge.reading.guessed_layout import guess_layout
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
    doubts = guess_layout(tmp_path).doubts
    (line,) = [doubt for doubt in doubts if "left out" in doubt]
    assert line.startswith("labels: forces.csv and 1 more are left out, since no force and no name")


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


def test_a_path_is_not_guessed_where_that_is_said(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"data\.guess=false, and a path, which is guessed: give"):
        inspect(["inspect", str(tmp_path), "data.guess=false"])
