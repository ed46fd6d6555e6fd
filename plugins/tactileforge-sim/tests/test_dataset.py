import hashlib
import os
import subprocess
import time
from pathlib import Path

import numpy as np
import pytest
from tactileforge_sim import generate
from tactileforge_sim.dataset import Sim, make_room
from warm import Warm

from tactileforge.contracts import ACTIONS, Dataset, Recording
from tactileforge.data.labels.actions import label_actions
from tactileforge.datasets.shards import Shards
from tactileforge.errors import ConfigError, DataNotFoundError, TactileForgeError
from tactileforge.testing import check

SMALL = {"scenes": 3, "val": 1, "size": 32}


@pytest.fixture(scope="module")
def touches() -> list[Recording]:
    return list(Sim(scenes=7, val=0, size=48, randomise="unit").recordings("train"))


def digest(folder: Path) -> dict[str, str]:
    return {p.name: hashlib.sha256(p.read_bytes()).hexdigest() for p in folder.glob("*.tar")}


@pytest.mark.slow
def test_conformance() -> None:
    assert isinstance(Sim(), Dataset)
    results = check("dataset", Sim(**SMALL))
    assert [result for result in results if result.status == "failed"] == []


@pytest.mark.slow
def test_what_matching_needs_is_there(touches: list[Recording]) -> None:
    assert len({recording.key for recording in touches}) == 21
    for trio in zip(*[iter(touches)] * 3, strict=True):
        assert [recording.sensor for recording in trio] == ["digit", "gelsight", "gelsight_mini"]
        assert len({recording.object for recording in trio}) == 1
    assert len({recording.object for recording in touches}) == 7
    seen = {
        ACTIONS[i]
        for recording in touches
        if recording.action is not None
        for i in set(recording.action) - {-1}
    }
    assert {"press", "leave", "slide_right"} < seen


@pytest.mark.slow
def test_a_recording_has_everything(touches: list[Recording]) -> None:
    recording = touches[2]
    assert recording.sensor == "gelsight_mini"
    np.testing.assert_allclose(np.diff(recording.times), 1 / 18)
    assert recording.frames.shape == (48, 64)
    assert recording.force is not None
    assert recording.force.shape == (len(recording.times), 3) == (len(recording.frames), 3)
    assert recording.image is not None
    assert recording.image.read([0]).shape == (1, 48, 48, 3)
    assert recording.text is not None
    assert recording.text.startswith("{action} a ")
    assert recording.tier == 3
    assert recording.licence == "CC0-1.0"
    assert touches[0].frames.shape == (64, 48)


@pytest.mark.slow
def test_forces_obey_coulomb(touches: list[Recording]) -> None:
    for recording in touches:
        assert recording.force is not None
        shear, normal = np.linalg.norm(recording.force[:, :2], axis=1), recording.force[:, 2]
        assert (normal >= 0).all()
        assert (
            0.1 < normal.max() < 20
        )  # the range is of a nominal gel; units are up to twice as stiff
        assert (shear <= 1.4 * normal + 1e-5).all()
        assert normal[0] == normal[-1] == 0


@pytest.mark.slow
def test_actions_agree_with_those_read_from_the_force(touches: list[Recording]) -> None:
    same = both = 0
    for recording in touches:
        assert recording.force is not None
        assert recording.action is not None
        if any(i >= ACTIONS.index("rotate_cw") for i in recording.action):
            continue
        read = label_actions(recording.times, recording.force)
        known = (read >= 0) & (recording.action >= 0)
        both += int(known.sum())
        same += int((read == recording.action)[known].sum())
    assert both > 200
    assert same / both > 0.85


@pytest.mark.slow
def test_pictures_change_with_contact_and_only_then() -> None:
    for recording in Sim(scenes=2, val=0, size=48, randomise="none").recordings("train"):
        assert recording.force is not None
        pictures = recording.frames.read(range(len(recording.frames))).astype(int)
        change = np.abs(pictures - pictures[0]).mean((1, 2, 3))
        free = recording.force[:, 2] == 0
        assert change[free].max() < 3
        assert change[recording.force[:, 2].argmax()] > 1.1 * change[free].max()


@pytest.mark.slow
def test_the_same_numbers_give_the_same_bytes_however_they_are_made(tmp_path: Path) -> None:
    config = {"scenes": 4, "val": 0, "size": 32, "sensors": ["digit"]}
    alone, together = tmp_path / "alone", tmp_path / "together"
    folders = []
    for cache, processes in ((alone, 1), (together, 2)):
        data = Sim(**config, cache=str(cache), processes=processes)
        assert len(list(data.recordings("train"))) == 4
        folders.append(data.folder)
    assert digest(folders[0]) == digest(folders[1])
    assert len(digest(folders[0])) == 4
    other = Sim(**config, cache=str(alone), seed=1)
    assert other.folder != folders[0]


@pytest.mark.slow
def test_pictures_may_come_late(tmp_path: Path) -> None:
    config = {"scenes": 1, "val": 0, "size": 16, "sensors": ["digit"], "cache": str(tmp_path)}
    (now,), (late,) = (list(Sim(**config, lag=lag).recordings("train")) for lag in (0.0, 0.1))
    assert now.force is not None
    assert late.force is not None
    np.testing.assert_array_equal(late.force[:-3], now.force[3:])
    np.testing.assert_array_equal(late.frames.read([20]), now.frames.read([20]))


@pytest.mark.slow
def test_a_killed_run_goes_on_where_it_was(tmp_path: Path) -> None:
    data = Sim(scenes=2, val=0, size=32, sensors=["digit"], cache=str(tmp_path))
    list(data.recordings("train"))
    whole = digest(data.folder)
    kept = data.folder / "train-000000.tar"
    before = kept.stat().st_mtime_ns
    (data.folder / "train-000001.tar").rename(data.folder / "train-000001.tar.part")
    assert len(list(data.recordings("train"))) == 2
    assert digest(data.folder) == whole
    assert kept.stat().st_mtime_ns == before


def test_a_second_run_simulates_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    words = {"scenes": 1, "val": 0, "size": 16, "sensors": ["digit"], "cache": str(tmp_path)}
    (first,) = Sim(**words).recordings("train")
    monkeypatch.setattr(generate, "play_scenes", None)  # a call would raise a TypeError
    (again,) = Sim(**words).recordings("train")
    np.testing.assert_array_equal(first.frames.read([30]), again.frames.read([30]))


def test_the_cache_is_bounded_and_keeps_what_is_in_use(tmp_path: Path) -> None:
    def made(name: str, days: float, size: int = 1000) -> Path:
        (tmp_path / name).mkdir()
        shard = tmp_path / name / "train-000000.tar"
        shard.write_bytes(bytes(size))
        for path in (shard, shard.parent):
            os.utime(path, 2 * (time.time() - 86400 * days,))
        return shard

    now, older, oldest = made(16 * "a", 9), made(16 * "b", 5), made(16 * "c", 7)
    busy, own, empty = made(16 * "d", 1), made("mine", 99), tmp_path / (16 * "e")
    empty.mkdir()
    make_room(now.parent, 4000)
    assert all(shard.exists() for shard in (now, older, oldest, busy, own))
    make_room(now.parent, 3500)
    assert [shard.exists() for shard in (now, older, oldest, busy, own)] == [1, 1, 0, 1, 1]
    make_room(now.parent, 1)
    assert [shard.exists() for shard in (now, older, busy, own)] == [1, 0, 1, 1]
    assert not older.parent.exists()


def test_validation_does_not_depend_on_the_number_of_scenes() -> None:
    few, many = (next(iter(Sim(scenes=n, val=1, size=32).recordings("val"))) for n in (1, 30))
    assert few.key == many.key


@pytest.mark.slow
def test_bench_holds_out_the_papers_indenters() -> None:
    config = Sim(indenters="bench").config
    train = {config.scene(i).shape.index for i in range(14)}
    held_out = {config.scene(generate.FIRST_VAL + i).shape.index for i in range(6)}
    assert train == {62, 65, 66, 67, 68, 70, 71}
    assert held_out == {63, 64, 69}


@pytest.mark.slow
def test_by_default_every_shape_of_validation_is_one_of_training() -> None:
    config = Sim().config
    train = {config.scene(i).shape.name for i in range(40)}
    assert len(train) == 12
    assert {config.scene(generate.FIRST_VAL + i).shape.name for i in range(8)} <= train


@pytest.mark.slow
def test_pretraining_never_sees_the_bench() -> None:
    config = Sim(indenters="pretrain").config
    shapes = [config.scene(i).shape for i in range(61)]
    assert len({shape.index for shape in shapes}) == 61
    assert not {shape.index for shape in shapes} & set(range(62, 72))


def test_mistakes_are_named() -> None:
    with pytest.raises(ConfigError, match="scenes=0 and val=8"):
        Sim(scenes=0)
    with pytest.raises(ConfigError, match="cache_gb=0"):
        Sim(cache_gb=0)
    with pytest.raises(ConfigError, match="unknown split 'test'"):
        next(Sim().recordings("test"))
    for wrong, said in (
        ({"sensors": ["digitt"]}, "did you mean 'digit'"),
        ({"sensors": []}, "sensors="),
        ({"indenters": "hexagonall"}, "did you mean 'hexagonal'"),
        ({"motions": "slide"}, "unknown motion 'slide'"),
        ({"size": 2}, "size is 2 pixels"),
        ({"force": (3, 1)}, "force="),
    ):
        with pytest.raises(ConfigError, match=said):
            next(Sim(**wrong, scenes=1).recordings("train"))


@pytest.mark.slow
def test_an_error_of_a_process_reaches_the_caller(tmp_path: Path) -> None:
    data = Sim(scenes=5, val=0, size=4, cache=str(tmp_path), processes=2)
    with pytest.raises(TactileForgeError, match="size is 4 pixels"):
        next(data.recordings("train"))


def tactileforge(warm: Warm, *words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [warm.bin / "tactileforge", *words],
        capture_output=True,
        text=True,
        check=False,
        env=os.environ | {"OMP_NUM_THREADS": "1"},
    )


@pytest.mark.slow
def test_the_verb_writes_what_shards_reads(tmp_path: Path, warm: Warm) -> None:
    words = [f"out={tmp_path}/touch", "sensors=[digit,gelsight_mini]", "indenters=bench"]
    words += ["seconds=6", "size=32", "val=0.4", "codec=png"]
    done = tactileforge(warm, "sim", *words)
    assert done.returncode == 0, done.stderr
    assert f"data.root={tmp_path}/touch" in done.stdout
    data = Shards(f"{tmp_path}/touch")
    both = [list(data.recordings(split)) for split in ("train", "val")]
    assert all(both)
    for sensor in ("digit", "gelsight_mini"):
        assert sum(t.times[-1] for split in both for t in split if t.sensor == sensor) > 5.5
    before = digest(tmp_path / "touch")
    again = tactileforge(warm, "sim", *words)
    assert again.returncode == 0
    assert digest(tmp_path / "touch") == before
    other = tactileforge(warm, "sim", *words, "seed=3")
    assert other.returncode == 1
    assert "other seed" in other.stderr


@pytest.mark.slow
def test_shards_that_are_damaged_or_missing(tmp_path: Path) -> None:
    with pytest.raises(DataNotFoundError, match=r"neither index\.json nor train-\*\.tar"):
        list(Shards(str(tmp_path)).recordings("train"))
    data = Sim(scenes=2, val=0, size=32, sensors=["digit"], cache=str(tmp_path))
    list(data.recordings("train"))
    (data.folder / "train-000000.tar").write_bytes(b"x" * 2000)
    there = Shards(str(data.folder))
    assert len(list(there.recordings("train"))) == 1
    (line,) = there.skipped
    assert "train-000000.tar: no tar at byte 0" in line
