"""Packing: stopped, killed, out of room; and continued."""

import os
import signal
import subprocess
from collections.abc import Callable
from contextlib import nullcontext
from itertools import product
from pathlib import Path
from types import ModuleType

import cv2
import numpy as np
import pytest
from PIL import Image
from waiting import wait_until

from tactileforge.contracts import Recording
from tactileforge.data.frames.lazy import ArrayFrames
from tactileforge.datasets.mixture import Mixture
from tactileforge.datasets.recordings import Recordings
from tactileforge.errors import ConfigError, TactileForgeError
from tactileforge.packing import PackOptions, pack
from tactileforge.packing.plan import plan_pack
from tactileforge.util.strict import build

Command = Callable[..., "subprocess.Popen[str]"]
GIVEN = {"codec": "png", "shard_frames": 24, "processes": 2}
OPTIONS = build(PackOptions, "pack", GIVEN)


def tree(folder: Path) -> dict[str, bytes]:
    paths = [path for path in folder.rglob("*") if path.is_file()]
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in paths}


@pytest.fixture
def whole(packable: ModuleType, tmp_path: Path) -> dict[str, bytes]:
    """Files of an undisturbed run."""
    pack(
        packable.Touches(),
        "touches",
        tmp_path / "whole",
        build(PackOptions, "pack", GIVEN | {"processes": 1}),
    )
    return tree(tmp_path / "whole")


def children(pid: int) -> list[int]:
    return [int(n) for n in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]


def is_alive(pid: int) -> bool:
    status = Path(f"/proc/{pid}/status")
    return status.exists() and "State:\tZ" not in status.read_text()


@pytest.mark.slow
@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGTERM, signal.SIGINT])
def test_a_run_that_is_stopped_goes_on(
    how: signal.Signals,
    packable: ModuleType,
    command: Command,
    whole: dict[str, bytes],
    tmp_path: Path,
) -> None:
    out = tmp_path / "out"
    process = command(out, GIVEN, delay=0.2)
    wait_until(lambda: len(list((out / ".pack").glob("train-*.json"))) >= 2, 60)
    wait_until(lambda: list(out.glob("*.part")), 60)
    workers = children(process.pid)
    assert len(workers) >= 2
    process.send_signal(how)
    process.communicate(timeout=30)
    assert process.returncode != 0
    assert not (out / "index.json").exists()
    wait_until(lambda: not any(map(is_alive, workers)), 60)
    noted = {path.stem for path in (out / ".pack").glob("train-*.json")}
    made = {name: (out / f"{name}.tar").stat().st_mtime_ns for name in noted}
    pack(packable.Touches(), "touches", out, OPTIONS)
    assert tree(out) == whole
    assert {name: (out / f"{name}.tar").stat().st_mtime_ns for name in noted} == made


@pytest.mark.slow
def test_shards_that_are_not_whole_are_made_anew(
    packable: ModuleType, whole: dict[str, bytes], tmp_path: Path
) -> None:
    out = tmp_path / "whole"
    (out / "train-000001.tar").write_bytes(b"cut off")
    (out / "train-000002.tar").unlink()
    (out / ".pack" / "train-000003.json").write_text('{"digest": ')
    (out / "train-000000.tar.77.part").write_bytes(b"half")
    kept = (out / "train-000000.tar").stat().st_mtime_ns
    pack(packable.Touches(), "touches", out, OPTIONS)
    assert tree(out) == whole
    assert (out / "train-000000.tar").stat().st_mtime_ns == kept


@pytest.mark.slow
def test_a_process_that_dies_once_costs_nothing(
    packable: ModuleType, whole: dict[str, bytes], tmp_path: Path
) -> None:
    (tmp_path / "deaths").mkdir()
    touches = packable.Touches(deadly=str(tmp_path / "deaths"))
    pack(touches, "touches", tmp_path / "out", OPTIONS)
    assert len(list((tmp_path / "deaths").iterdir())) == 1
    assert tree(tmp_path / "out") == whole


@pytest.mark.slow
def test_a_process_that_dies_twice_is_an_error_that_names_the_shard(
    packable: ModuleType, tmp_path: Path
) -> None:
    (tmp_path / "deaths").mkdir()
    touches = packable.Touches(deadly=str(tmp_path / "deaths"), deaths=9)
    with pytest.raises(TactileForgeError, match=r"train-\d{6}\.tar: .*twice.* train/2/\w+ and 1 "):
        pack(touches, "touches", tmp_path / "out", OPTIONS)
    assert len(list((tmp_path / "deaths").iterdir())) == 2
    assert not list((tmp_path / "out").glob("*.part"))


@pytest.mark.slow
def test_a_full_disk_leaves_whole_shards_and_says_so(
    packable: ModuleType, command: Command, tmp_path: Path
) -> None:
    pack(packable.Touches(frames=40), "touches", tmp_path / "whole", OPTIONS)
    sizes = {path.name: path.stat().st_size for path in (tmp_path / "whole").glob("*.tar")}
    out = tmp_path / "out"
    given = GIVEN | {"processes": 1}
    process = command(out, given, frames=40, file_limit=min(sizes.values()) - 1)
    _, said = process.communicate(timeout=60)
    assert process.returncode == 1
    assert "cannot be written (File too large). 0 of 10 shards are whole and stay" in said
    assert not list(out.rglob("*.part"))
    assert not (out / "index.json").exists()
    pack(packable.Touches(frames=40), "touches", out, OPTIONS)
    assert tree(out) == tree(tmp_path / "whole")


def test_room_that_ends_in_the_middle(
    packable: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from tactileforge.data.shards import shards

    write = shards.write_shard
    calls = []

    def full(*given: object) -> None:
        calls.append(given)
        if len(calls) == 3:
            raise OSError(28, "No space left on device")
        write(*given)  # type: ignore[arg-type]

    monkeypatch.setattr(shards, "write_shard", full)
    alone = build(PackOptions, "pack", GIVEN | {"processes": 1})
    with pytest.raises(TactileForgeError, match=r"No space left on device\). 2 of 5 shards"):
        pack(packable.Touches(), "touches", tmp_path, alone)
    pack(packable.Touches(), "touches", tmp_path, alone)
    assert len(calls) == 3 + 3


@pytest.mark.parametrize(
    ("touches", "options", "words"),
    [
        ({}, {"codec": "jpg"}, r"pack\.codec was 'png', is 'jpg'\. Give another out="),
        ({}, {"filter": {"every": 0.1}}, r"pack\.filter\.every was None, is 0\.1"),
        ({"objects": 5}, {}, "recordings was 10, is 12; frames was 120, is 144"),
        ({"tier": 3}, {}, "its recordings have changed"),
    ],
)
def test_a_folder_holds_one_kind_of_shards(
    touches: dict[str, int],
    options: dict[str, object],
    words: str,
    packable: ModuleType,
    whole: dict[str, bytes],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    if tier := touches.pop("tier", None):
        from dataclasses import replace

        plain = packable.Touches.touch
        change = lambda *given: replace(plain(*given), tier=tier)  # noqa: E731
        monkeypatch.setattr(packable.Touches, "touch", change)
    changed = build(PackOptions, "pack", {"codec": "png", "shard_frames": 24, **options})
    for _ in range(2):  # also where only the index is left to tell
        with pytest.raises(ConfigError, match=words):
            pack(packable.Touches(**touches), "touches", tmp_path / "whole", changed)
        (tmp_path / "whole" / ".pack" / "made.json").unlink(missing_ok=True)


def test_pictures_that_have_changed_are_packed_anew(tmp_path: Path) -> None:
    layout = {"images": "*/*.png", "each": "sequence", "fps": 30, "sensor": "digit"}
    layout["crops"] = {"left": {"box": [0, 0, 32, 32]}}

    def fill(level: int) -> None:
        for i in range(12):
            path = tmp_path / "touches" / "a" / f"{i}.png"
            path.parent.mkdir(parents=True, exist_ok=True)
            picture = Image.fromarray(np.full((32, 48, 3), level + i, np.uint8))
            picture.save(path, compress_level=0)  # of one size, whatever they show

    def packed(**changes: object) -> Path:
        layouts = {"a": layout | {"background": {"first": 3}} | changes}
        data = Recordings(str(tmp_path / "touches"), layouts, val=0)
        pack(data, "recordings", tmp_path / "out", build(PackOptions, "pack", {"processes": 1}))
        return tmp_path / "out"

    fill(10)
    packed()
    packed()
    changes: list[dict[str, object]] = [
        {"background": {"last": 3}},
        {"crops": {"left": {"box": [16, 0, 32, 32]}}},
    ]
    for change in changes:
        with pytest.raises(ConfigError, match="its recordings have changed"):
            packed(**change)
    fill(90)
    with pytest.raises(ConfigError, match="its recordings have changed"):
        packed()


def test_shards_of_others_are_not_written_over(packable: ModuleType, tmp_path: Path) -> None:
    (tmp_path / "train-000000.tar").write_bytes(b"of somebody else")
    with pytest.raises(ConfigError, match="were not packed here; give another out="):
        pack(packable.Touches(), "touches", tmp_path, OPTIONS)
    assert os.listdir(tmp_path) == ["train-000000.tar"]


def test_what_does_not_change_the_shards_may_change(
    packable: ModuleType, whole: dict[str, bytes], tmp_path: Path
) -> None:
    pack(
        packable.Touches(),
        "touches",
        tmp_path / "whole",
        build(PackOptions, "pack", GIVEN | {"max_bad": 0.5}),
    )
    assert tree(tmp_path / "whole") == whole


@pytest.mark.slow
def test_other_data_are_not_mixed_with_what_is_there(packable: ModuleType, tmp_path: Path) -> None:
    """A crop of one size at another place gives recordings of the same look from outside."""
    crop = {"name": "recordings", "layouts": {"a": {"box": [0, 0, 8, 8]}}}
    moved = {**crop, "layouts": {"a": {"box": [8, 0, 8, 8]}}}
    pack(packable.Touches(), "touches", tmp_path, OPTIONS, crop | {"root": "here"})
    pack(packable.Touches(), "touches", tmp_path, OPTIONS, crop | {"root": "there", "processes": 4})
    with pytest.raises(
        ConfigError, match=r"options\.layouts\.a\.box was \[0, 0, 8, 8\], is \[8, 0"
    ):
        pack(packable.Touches(), "touches", tmp_path, OPTIONS, moved)


def test_pictures_of_another_size_are_other_recordings(
    packable: ModuleType, tmp_path: Path
) -> None:
    for side, fails in ((8, nullcontext()), (9, pytest.raises(ConfigError, match="have changed"))):
        pixels = ArrayFrames(np.zeros((2, side, side, 3), np.uint8))
        touch = Recording(
            key="a", sensor="digit", frames=pixels, times=np.arange(2.0), no_contact=None
        )
        with fails:
            pack(packable.Given(touch), "given", tmp_path, OPTIONS)


def test_lines_of_several_data_sets_belong_to_their_split(tmp_path: Path) -> None:
    for source, split, number in product("ab", ("train", "val"), range(3)):
        path = tmp_path / source / split / f"{number}.png"
        path.parent.mkdir(parents=True, exist_ok=True)
        cv2.imwrite(str(path), np.zeros((8, 8, 3), np.uint8))
        if number == 1:
            path.write_bytes(b"damaged")
    layout = {"images": "*.png", "each": "touch", "sensor": "digit", "background": "none"}
    sides = {"train": "none", "val": "all"}
    layouts = {side: {"path": side, "hold_out": sides[side], **layout} for side in sides}
    node = {"name": "recordings", "layouts": layouts}
    data = Mixture({source: {**node, "root": str(tmp_path / source)} for source in "ab"})
    planned = plan_pack(data, tmp_path / "out", OPTIONS)
    for split, lines in planned.skipped.items():
        places = [Path(line.partition(":")[0]).relative_to(tmp_path).as_posix() for line in lines]
        assert places == [f"{source}/{split}/1.png" for source in "ab"]
