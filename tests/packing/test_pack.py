import dataclasses
import hashlib
import itertools
import json
import subprocess
import sys
import tarfile
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from tactileforge.contracts import ACTIONS, Recording
from tactileforge.data.frames.lazy import ArrayFrames
from tactileforge.data.shards import index, shards
from tactileforge.errors import ConfigError, DataError
from tactileforge.packing import PackOptions, pack, summary
from tactileforge.packing.statistics import PackStatistics
from tactileforge.util.strict import build

PNG = PackOptions(codec="png", shard_frames=30, processes=1)


def noise(key: str, count: int, **given: object) -> Recording:
    seed = int(hashlib.sha256(key.encode()).hexdigest()[:8], 16)
    pixels = np.random.default_rng(seed).integers(0, 256, (count, 8, 8, 3), np.uint8)
    plain = {"sensor": "digit", "times": np.arange(count) / 30, "no_contact": None, **given}
    return Recording(key=key, **{"frames": ArrayFrames(pixels), **plain})  # type: ignore[arg-type]


def tree(folder: Path) -> dict[str, bytes]:
    """Every file, by its path in the folder."""
    paths = [path for path in folder.rglob("*") if path.is_file()]
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in paths}


def test_nothing_is_lost(packable: ModuleType, tmp_path: Path) -> None:
    touches = packable.Touches()
    made = pack(touches, "touches", tmp_path, PNG)
    saved = index.parse_index((tmp_path / "index.json").read_bytes(), "x")
    assert (saved.name, saved.sorted, saved.made) == (made.name, True, made.made)
    assert saved.statistics == made.statistics
    assert saved.splits.keys() == made.splits.keys()
    for split in ("train", "val"):
        wanted = {recording.key: recording for recording in touches.recordings(split)}
        packed = [
            recording
            for path in sorted(tmp_path.glob(f"{split}-*.tar"))
            for recording in shards.read_shard(path)
        ]
        assert [recording.key for recording in packed] == [
            recording.key for recording in index.sort_recordings(wanted.values())
        ]
        for recording in packed:
            source = wanted[recording.key]
            for name in (field.name for field in dataclasses.fields(Recording)):
                here, there = getattr(source, name), getattr(recording, name)
                if name in ("frames", "no_contact", "image"):
                    here, there = (lazy.read(range(len(lazy))) for lazy in (here, there))
                np.testing.assert_array_equal(here, there, err_msg=name)


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
def test_other_tools_read_the_shards(packable: ModuleType, tmp_path: Path) -> None:
    import webdataset

    pack(packable.Touches(objects=1), "touches", tmp_path, PNG)
    shard = tmp_path / "train-000000.tar"
    with tarfile.open(shard) as tar:
        names = tar.getnames()
        keys = [json.load(tar.extractfile(name))["key"] for name in names if "json" in name]  # type: ignore[arg-type]
    assert len(names) == 2 * (1 + 12 + 2 + 3)
    samples = list(webdataset.WebDataset(str(shard), shardshuffle=False))
    assert [json.loads(sample["json"])["key"] for sample in samples] == keys
    assert {"0011.png", "background.0001.png", "image.0002.png"} <= set(samples[1])


def test_what_one_object_felt_is_in_one_shard(packable: ModuleType, tmp_path: Path) -> None:
    made = pack(packable.Touches(objects=9), "touches", tmp_path, PNG)
    where: dict[str, set[str]] = {}
    for path in tmp_path.glob("train-*.tar"):
        for recording in shards.read_shard(path):
            where.setdefault(str(recording.object), set()).add(path.name)
    assert len(where) == 9
    assert {len(files) for files in where.values()} == {1}
    entries = made.splits["train"]
    assert [entry.file for entry in entries] == [f"train-{i:06d}.tar" for i in range(9)]
    assert made.sorted
    assert all(before.last < other.first for before, other in itertools.pairwise(entries))


def test_shards_hold_as_many_frames_as_asked_for(packable: ModuleType, tmp_path: Path) -> None:
    small = [noise(f"small {i}", 10) for i in range(7)]
    large = [noise(f"large {i}", 20, object="large") for i in range(4)]
    made = pack(packable.Given(*small, *large, noise("long", 100)), "x", tmp_path, PNG)
    counts = [entry.summary.frames for entry in made.splits["train"]]
    assert sum(counts) == 70 + 80 + 100
    assert sorted(counts)[-1] == 100  # a recording is never cut
    assert all(count <= 30 for count in counts if count != 100)


@pytest.mark.slow
def test_processes_do_not_change_the_bytes(packable: ModuleType, tmp_path: Path) -> None:
    for folder, processes in (("one", 1), ("two", 2)):
        options = dataclasses.replace(PNG, processes=processes)
        pack(packable.Touches(), "touches", tmp_path / folder, options)
    assert tree(tmp_path / "one") == tree(tmp_path / "two")


def test_statistics(packable: ModuleType, tmp_path: Path) -> None:
    touches = packable.Touches()
    statistics = pack(touches, "touches", tmp_path, PNG).statistics["train"]
    recordings = list(touches.recordings("train"))
    actions = np.concatenate([recording.action for recording in recordings])
    wanted = {name: int((actions == i).sum()) for i, name in enumerate(ACTIONS)}
    assert statistics["actions"] == {**wanted, "unknown": int((actions == -1).sum())}
    assert (statistics["recordings"], statistics["frames"], statistics["read"]) == (8, 96, 96)
    assert statistics["sensors"] == {"digit": 48, "gelsight": 48}
    assert statistics["objects"] == 4
    assert statistics["bytes"] == sum(p.stat().st_size for p in tmp_path.glob("train-*.tar"))
    force = np.concatenate([recording.force for recording in recordings])
    known = force[~np.isnan(force[:, 0])]
    edges = np.array(statistics["force"]["edges"])
    for axis, values in zip("xyz", known.T, strict=True):
        counts = np.array(statistics["force"][axis])
        assert counts.sum() == len(known) == 88
        inside = (values >= -1) & (values < 1)
        assert counts[(edges[:-1] >= -1) & (edges[1:] <= 1)].sum() == inside.sum()


def test_statistics_of_forces_along_one_axis() -> None:
    recording = noise("a", 12, force=np.full((12, 3), 2.0, np.float32))
    recording.force[:, :2] = np.nan
    statistics = PackStatistics()
    statistics.add(recording)
    assert statistics.force.sum(1).tolist() == [0, 0, 12]


def test_pictures_shrink_to_the_size_asked_for(packable: ModuleType, tmp_path: Path) -> None:
    pack(packable.Touches(objects=1), "touches", tmp_path, dataclasses.replace(PNG, size=12))
    (recording, _) = shards.read_shard(tmp_path / "train-000000.tar")
    assert recording.frames.shape == recording.no_contact.shape == recording.image.shape == (12, 16)  # type: ignore[union-attr]
    source = {r.key: r for r in packable.Touches(objects=1).recordings("train")}[recording.key]
    blocks = source.frames.read([0])[0].reshape(12, 2, 16, 2, 3).mean((1, 3))
    assert np.abs(recording.frames.read([0])[0] - blocks).max() <= 0.5


def test_small_pictures_stay_as_they_are(packable: ModuleType, tmp_path: Path) -> None:
    pack(packable.Touches(objects=1), "touches", tmp_path, dataclasses.replace(PNG, size=24))
    (recording, _) = shards.read_shard(tmp_path / "train-000000.tar")
    assert recording.frames.shape == (24, 32)


def test_shards_are_packed_again_without_loss(packable: ModuleType, tmp_path: Path) -> None:
    from tactileforge.datasets.shards import Shards

    jpg = PackOptions(shard_frames=30, processes=1)
    pack(packable.Touches(), "touches", tmp_path / "a", jpg)
    pack(Shards(str(tmp_path / "a")), "touches", tmp_path / "b", jpg)
    first, second = tree(tmp_path / "a"), tree(tmp_path / "b")
    assert {k: v for k, v in first.items() if ".tar" in k} == {
        k: v for k, v in second.items() if ".tar" in k
    }


def test_a_key_that_comes_twice_is_named(packable: ModuleType, tmp_path: Path) -> None:
    data = packable.Given(noise("a", 5), val=(noise("b", 5), noise("a", 7)))
    with pytest.raises(
        DataError,
        match=r"called 'a': number 0 of train \(digit, 5 frames\) and number 1 of val \(digit, 7 ",
    ):
        pack(data, "x", tmp_path, PNG)


def test_times_that_are_not_those_of_the_frames_are_an_error(
    packable: ModuleType, tmp_path: Path
) -> None:
    with pytest.raises(DataError, match="a: 5 frames and 4 times"):
        pack(packable.Given(noise("a", 5, times=np.arange(4) / 30)), "x", tmp_path, PNG)
    with pytest.raises(DataError, match="a: its times do not increase"):
        pack(packable.Given(noise("a", 3, times=np.array([0, 2, 1.0]))), "x", tmp_path, PNG)


def test_nothing_to_train_on_is_an_error(packable: ModuleType, tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r"all 1 recordings are held out for validation: give "):
        pack(packable.Given(val=(noise("a", 5),)), "x", tmp_path, PNG)


def test_unreadable_frames_are_left_out_and_listed(packable: ModuleType, tmp_path: Path) -> None:
    broken = packable.Noise(3, 40, unreadable={7, 30})
    data = packable.Given(
        noise("a", 40, frames=broken, times=np.arange(40) / 30, action=np.arange(40) % 8),
        *(noise(f"fine {i}", 3) for i in range(5)),
    )
    packed = pack(data, "x", tmp_path, PNG)
    (recording,) = (
        r for p in tmp_path.glob("train*.tar") for r in shards.read_shard(p) if r.key == "a"
    )
    rows = [i for i in range(40) if i not in (7, 30)]
    np.testing.assert_array_equal(recording.times, np.array(rows) / 30)
    np.testing.assert_array_equal(recording.action, np.array(rows) % 8)  # type: ignore[arg-type]
    np.testing.assert_array_equal(recording.frames.read(range(38)), broken.read(rows))
    statistics = packed.statistics["train"]
    assert statistics["damaged"] == 1
    assert statistics["skipped"] == [
        "a, frame 7: frame 7 of noise 3 is broken",
        "a, frame 30: frame 30 of noise 3 is broken",
    ]
    assert summary(packed).splitlines() == [
        "train: 6 recordings, 53 frames (digit 53), 0 objects, 2 shards, 0.1 MB",
        "val: 0 recordings, 0 frames (none), 0 objects, 0 shards, 0.0 MB",
        "damaged recordings: 1, index.json lists them",
    ]


def test_a_recording_of_many_unreadable_frames_is_left_out(
    packable: ModuleType, tmp_path: Path
) -> None:
    broken = packable.Noise(3, 40, unreadable=range(20, 40))
    data = packable.Given(noise("a", 40, frames=broken), *(noise(f"fine {i}", 3) for i in range(5)))
    counts = pack(data, "x", tmp_path, PNG).statistics["train"]
    assert (counts["recordings"], counts["damaged"], len(counts["skipped"])) == (5, 1, 9)


def test_too_many_damaged_recordings_are_an_error_that_lists_them(
    packable: ModuleType, tmp_path: Path
) -> None:
    def data() -> object:
        broken = [noise(k, 3, frames=packable.Noise(i, 3, {1})) for i, k in enumerate("abc")]
        fine = [noise(f"fine {i}", 3, object="fine") for i in range(17)]
        given = packable.Given(*broken, *fine)
        given.skipped = ["of an earlier run"]
        return given

    one_each = dataclasses.replace(PNG, shard_frames=3)
    with pytest.raises(DataError, match=r"2 of 20 recordings .* allows 1; .*\n  \w, frame 1: .*\n"):
        pack(data(), "x", tmp_path, one_each)
    whole = {path.name: path.stat().st_mtime_ns for path in tmp_path.glob("*.tar")}
    packed = pack(data(), "x", tmp_path, dataclasses.replace(one_each, max_bad=0.15))
    assert packed.statistics["train"]["damaged"] == 3
    assert {name: (tmp_path / name).stat().st_mtime_ns for name in whole} == whole


def test_what_the_reader_left_out_counts(packable: ModuleType, tmp_path: Path) -> None:
    fine = (noise(str(i), 3) for i in range(5))
    data = packable.Given(*fine, missing=["gone.mp4: no such file"] * 2)
    with pytest.raises(DataError, match=r"2 of 7 recordings are damaged(.|\n)*gone\.mp4"):
        pack(data, "x", tmp_path, PNG)


def test_processes_import_no_torch() -> None:
    code = "import sys, tactileforge.packing.work; sys.exit('torch' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code]).returncode == 0


def test_options_that_cannot_be_are_named() -> None:
    for given, words in (
        ({"codec": "jpeg"}, "unknown pack.codec 'jpeg'; did you mean 'jpg'"),
        ({"executor": "slurm"}, "unknown pack.executor 'slurm'"),
        ({"codec": "png", "quality": 90}, "quality=90: only jpg has a quality"),
        ({"quality": 0}, "quality=0: only jpg has a quality, from 1 to 100"),
        ({"size": 0}, "pack.size is 0; give 1 or more"),
        ({"shard_frames": 0}, "pack.shard_frames is 0"),
        ({"processes": -1}, "pack.processes is -1"),
        ({"max_bad": 2}, "pack.max_bad is 2.0; give a share"),
        ({"max_bad": "all"}, "pack.max_bad is 'all', which is not of type float"),
        ({"sizes": 3}, "unknown key of pack 'sizes'; did you mean 'size'"),
        ({"filter": {"laplac": 3}}, "unknown key of pack.filter 'laplac'; did you mean 'laplacian"),
        ({"filter": {"laplacian": 0}}, "laplacian is 0.0; give more than 0, or null"),
        ({"filter": {"laplacian": {"digit": -1}}}, "laplacian digit is -1"),
        ({"filter": {"every": -1}}, "every is -1"),
    ):
        with pytest.raises(ConfigError, match=words):
            build(PackOptions, "pack", given)


def test_doubts_about_labels_are_said_once(
    packable: ModuleType, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    force = np.zeros((20, 3), np.float32)
    force[:, 2] = np.linspace(0, 800, 20)
    touches = [noise(f"t{i}", 20, sensor="digit", force=force) for i in range(3)]
    pack(packable.Given(*touches), "touches", tmp_path / "out", PNG)
    notes = [line for line in capsys.readouterr().err.split("\n") if line.startswith("note: ")]
    assert len(notes) == 1
    assert notes[0].startswith(
        "note: TF201 force out of range in 3 of 3 recordings (t0: 800 N along"
    )
