"""Parts of files that killed processes left, and places that cannot be written."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tactileforge import cli, files
from tactileforge.errors import ConfigError
from tactileforge.files import check_cache, check_writable, new_part, part_name, sweep_parts

KILLED = (
    "import os, sys; from pathlib import Path; from tactileforge.files import new_part\n"
    "with new_part(Path(sys.argv[1])) as part:\n"
    "    part.write_bytes(b'half'); os.kill(os.getpid(), 9)"
)


def test_a_part_of_a_killed_process_goes_with_the_next_write(tmp_path: Path) -> None:
    target = tmp_path / "a.tar"
    subprocess.run([sys.executable, "-c", KILLED, str(target)], check=False)
    assert len(list(tmp_path.iterdir())) == 1
    with new_part(target) as part:
        assert list(tmp_path.iterdir()) == []
        part.write_bytes(b"whole")
        part.replace(target)
    assert [path.name for path in tmp_path.iterdir()] == ["a.tar"]


def test_parts_of_others_that_run_stay(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    mine, folder = part_name(tmp_path / "a"), part_name(tmp_path / "set")
    mine.touch()
    folder.mkdir()
    monkeypatch.setattr(files, "_node", lambda: "elsewhere")
    other = part_name(tmp_path / "b")
    other.touch()
    (tmp_path / "kept.partial").touch()
    assert sweep_parts(tmp_path) == 0, "nobody knows whether they run, and they are young"
    for path in (mine, other):
        os.utime(path, (0, 0))
    assert sweep_parts(tmp_path, ".a.") == 1
    assert sweep_parts(tmp_path) == 1
    (tmp_path / "train-000000.tar.77.part").touch()
    (tmp_path / ".00001.x.part.mp4").touch()
    assert sweep_parts(tmp_path, alone=True) == 3
    assert [path.name for path in tmp_path.iterdir()] == ["kept.partial"]
    assert sweep_parts(tmp_path / "nowhere") == 0


def test_a_place_that_can_be_written_is_left_as_it_is(tmp_path: Path) -> None:
    check_writable(tmp_path / "a" / "b.html")
    check_writable(tmp_path / "a", folder=True)
    check_writable(tmp_path, folder=True)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("place", "folder", "why"),
    [
        ("/proc/1/nothing/a.html", False, "cannot be written"),
        ("file/a.html", False, "is a file, not a folder"),
        ("file", True, "is a file, not a folder"),
        ("folder", False, "a folder is there"),
        ("x" * 300 + "/a", False, "cannot be written"),
    ],
)
def test_a_place_that_cannot_be_written_is_named(
    place: str, folder: bool, why: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("file").touch()
    Path("folder").mkdir()
    with pytest.raises(ConfigError, match=f"{why}.*give another out="):
        check_writable(Path(place), folder=folder)


def test_a_disk_that_is_full_is_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"No space left on device\); give another out="):
        _full(tmp_path)


def _full(tmp_path: Path) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(files, "part_name", lambda target, suffix="": Path("/dev/full"))
        patch.setattr(files, "_remove", lambda part: None)
        check_writable(tmp_path / "a.html")


def test_a_cache_that_cannot_be_written_names_its_variable(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "home").touch()
    monkeypatch.delenv("TACTILEFORGE_CACHE")
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    with pytest.raises(ConfigError, match="set TACTILEFORGE_CACHE= to a folder"):
        check_cache()


#: Every command that writes, with what it is given beside its place.
WRITERS = [
    (["export", "model=anytouch2.tiny"], "out"),
    (["data", "inspect", "data=sim"], "out"),
    (["data", "filter", "data=sim"], "out"),
    (["data", "pack", "data=sim"], "out"),
    (["sim"], "out"),
    (["bench", "suite=sim", "model=[pixels]"], "out"),
    (["record", "sensor=sim"], "out"),
    (["calibrate", "data=sim"], "out"),
    (["plugins", "new", "objective", "mine"], "out"),
]


@pytest.mark.parametrize(("words", "key"), WRITERS, ids=[" ".join(row[0][:2]) for row in WRITERS])
def test_every_verb_looks_at_its_place_before_it_works(
    words: list[str],
    key: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("file").touch()
    assert cli.run([*words, f"{key}=file/a.yaml"]) == 1
    err = capsys.readouterr().err
    assert err.count("\n") == 1
    assert "is a file, not a folder); give another out=" in err
    assert [path.name for path in tmp_path.rglob("*")] == ["file"]


@pytest.mark.parametrize("words", [["zoo", "get", "mae.tiny"], ["bench", "model=[pixels]"]])
def test_verbs_that_use_the_cache_look_at_it_before_they_work(
    words: list[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("file").touch()
    monkeypatch.setenv("TACTILEFORGE_CACHE", str(tmp_path / "file" / "cache"))
    assert cli.run(words) == 1
    assert "set TACTILEFORGE_CACHE= to a folder" in capsys.readouterr().err
    shutil.rmtree("runs", ignore_errors=True)
