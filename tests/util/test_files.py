"""Parts of files left by killed processes, and unwritable places."""

import ast
import errno
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from tactileforge import cli
from tactileforge.cli import plugins
from tactileforge.errors import ConfigError, DataError, home_path
from tactileforge.util import files
from tactileforge.util.files import (
    check_cache,
    check_writable,
    new_part,
    part_name,
    sha256,
    sweep_parts,
    write_text,
)

KILLED = (
    "import os, sys; from pathlib import Path; from tactileforge.util.files import new_part\n"
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
        ("x" * 240, False, "File name too long"),
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


@pytest.mark.parametrize("is_link", [False, True])
def test_a_pipe_or_device_is_never_replaced_by_a_file(tmp_path: Path, is_link: bool) -> None:
    os.mkfifo(tmp_path / "pipe")
    place = tmp_path / "pipe"
    if is_link:
        place = tmp_path / "out.html"
        place.symlink_to(tmp_path / "pipe")
    before = sorted(tmp_path.iterdir())
    with pytest.raises(ConfigError, match=r"pipe or socket is there\); give another out="):
        check_writable(place)
    with pytest.raises(DataError, match="a device, pipe or socket, not a file"):
        write_text(place, "x")
    with pytest.raises(DataError, match="no regular file"):
        sha256(place)  # a shard of an index, which would be waited for without end
    assert sorted(tmp_path.iterdir()) == before
    assert (tmp_path / "pipe").is_fifo()


def test_the_home_of_nobody_is_named() -> None:
    with pytest.raises(ConfigError, match="~nobody-at-all/a: no user of that name has a home"):
        home_path("~nobody-at-all/a")


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


#: Functions and methods that write a file, and what a part or memory is called there.
WRITE_FUNCTIONS = {"save", "savez", "savez_compressed", "save_file", "dump"}
WRITE_METHODS = {"write_text", "write_bytes"}
OURS = {"part", "record", "content", "file", "whole"}
#: Others: locks, which hold nothing; and what is given a part, or a folder that is one.
ALLOWED = {
    ("packing/run.py", "(out / NOTES / 'lock')"),
    ("util/untrusted.py", "plain"),  # to text
    ("testing/modules.py", "state"),  # to bytes
    ("tactileforge_export/program.py", "path"),
    ("tactileforge_export/onnx_file.py", "path"),
    ("tactileforge_lerobot/touch.py", "(root / files[-1])"),
}


def written_places(tree: ast.AST) -> Iterator[str]:
    """Targets of the writing calls in a module, as source."""
    for node in ast.walk(tree):
        if not isinstance(node, ast.Call) or not isinstance(node.func, ast.Attribute | ast.Name):
            continue
        name = node.func.attr if isinstance(node.func, ast.Attribute) else node.func.id
        module = ast.unparse(node.func).rpartition(".")[0]
        if name in WRITE_METHODS and module:
            yield module
        elif name == "open" and any(
            isinstance(a, ast.Constant) and re.fullmatch("[wx]b?[+]?", str(a.value))
            for a in [*node.args, *(keyword.value for keyword in node.keywords)]
        ):
            yield module.removeprefix("tarfile") or ast.unparse(node.args[0])
        elif name in WRITE_FUNCTIONS and module in {"", "np", "torch", "onnx", "json", "yaml"}:
            places = [
                a for a in node.args if name not in {"save", "save_file"} or a is not node.args[0]
            ]
            if module == "np" or not places:
                places = node.args[:1]
            yield ast.unparse(places[0])


@pytest.mark.slow
def test_no_module_writes_a_file_in_its_place() -> None:
    """All goes into a part, or into memory: a killed command leaves no half of a file."""
    packages = (Path(__file__).parents[2] / "plugins").glob("tactileforge-*/src")
    found = set()
    for source in (Path(files.__file__).parents[1], *packages):
        for path in source.rglob("*.py"):
            name = str(path.relative_to(source))
            found |= {(name, place) for place in written_places(ast.parse(path.read_text("utf-8")))}
    assert len(found) > 10
    assert {(name, place) for name, place in found if place not in OURS} <= ALLOWED


def test_a_new_package_is_whole_or_absent(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["plugins", "new", "objective", "mine", f"out={tmp_path}"]
    kept, written = plugins.write_text, []

    def half(path: Path, text: str) -> None:
        if written:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(path))
        kept(path, text)
        written.append(path)

    monkeypatch.setattr(plugins, "write_text", half)
    assert cli.run(words) == 1
    assert "No space left on device); make room" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())
    monkeypatch.undo()
    assert cli.run(words) == 0
    assert [path.name for path in tmp_path.iterdir()] == ["tactileforge-mine"]
    assert "next: pip install" in capsys.readouterr().out


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
    (["calibrate", "depth", "data=sim", "ball_mm=4"], "out"),
    (["data", "embed", "data=sim", "model=anytouch2.tiny"], "out"),
    (["zoo", "pack", "run=nothing"], "out"),
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


@pytest.mark.parametrize("number", [errno.EACCES, errno.EROFS, errno.ENOSPC, errno.ENAMETOOLONG])
@pytest.mark.parametrize(("words", "key"), WRITERS, ids=[" ".join(row[0][:2]) for row in WRITERS])
def test_every_verb_names_a_place_that_refuses_it(
    words: list[str],
    key: str,
    number: int,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """A folder that is read-only for its user, such a disk, a full one, and a name too long."""
    monkeypatch.chdir(tmp_path)

    def refused(part: Path, content: bytes) -> int:
        raise OSError(number, os.strerror(number), str(part))

    monkeypatch.setattr(Path, "write_bytes", refused)
    assert cli.run([*words, f"{key}=a.yaml"]) == 1
    err = capsys.readouterr().err
    assert err == f"error: a.yaml: cannot be written ({os.strerror(number)}); give another out=\n"
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("words", [["zoo", "get", "touch.tiny"], ["bench", "model=[pixels]"]])
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
