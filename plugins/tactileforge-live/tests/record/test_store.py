"""Safe segments, joined into takes, in any state left by a killed run."""

import io
import json
import shutil
import tarfile
import zipfile

import numpy as np
import pytest
from tactileforge_live.record import store as module
from tactileforge_live.record.merge_segments import merge_segments
from tactileforge_live.record.raw import read_raw
from tactileforge_live.record.store import NOTES, TakeStore

from tactileforge.contracts import Recording
from tactileforge.data.frames.image_codecs import encode_image
from tactileforge.data.frames.lazy import ArrayFrames
from tactileforge.data.shards import index, shards
from tactileforge.datasets.shards import Shards
from tactileforge.errors import ConfigError, DataError

RATE = 10


def packed(number, device="left", frames=5, force=True, image=True, take=0):
    """The n-th segment of a sensor: its pictures go on from those before."""
    first = number * frames
    places = np.arange(first, first + frames)
    times = places / RATE
    about = Recording(
        key=f"here/{take:06d}/{device}/{number:04d}",
        sensor="digit",
        frames=ArrayFrames(np.zeros((1, 1, 1, 3), np.uint8)),
        times=times,
        no_contact=None,
        force=np.outer(times, [1, 2, 3]).astype(np.float32) if force else None,
        action=np.full(frames, 2),
        object="ball",
        image_times=times + 0.01 if image else None,
        labels={"take": 0, "segment": number, "dropped": number},
        tracks={"wrench": np.outer(times, np.ones(6)).astype(np.float32)},
    )
    pictures = [encode_image(np.full((6, 8, 3), place, np.uint8), "png") for place in places]
    views = [encode_image(np.full((4, 4, 3), 200 - place, np.uint8), "png") for place in places]
    background = [encode_image(np.full((6, 8, 3), 99, np.uint8), "png")]
    return shards.Packed(
        shards.describe_recording(about), "png", pictures, background, views if image else []
    )


def raw(number):
    times = np.arange(number * 50, number * 50 + 50) / 100
    return {"force": (times, np.outer(times, np.ones(6)).astype(np.float32))}


def write(store, take=0, segments=3):
    for number in range(segments):
        both = [packed(number, take=take), packed(number, "right", take=take)]
        store.write(take, number, both, raw(number))


def names(folder):
    return sorted(path.name for path in folder.glob("*.tar"))


def listed(folder):
    held = index.parse_index((folder / index.INDEX_FILE).read_bytes(), "index")
    return sorted(entry.file for rows in held.splits.values() for entry in rows)


def check_take(path):
    left, right = shards.read_shard(path)
    assert (left.key, right.key) == ("here/000000/left", "here/000000/right")
    for one in (left, right):
        assert one.times == pytest.approx(np.arange(15) / RATE)
        seen = one.frames.read(range(15))
        assert seen[:, 0, 0, 0].tolist() == list(range(15))
        assert one.image.read(range(15))[:, 0, 0, 0].tolist() == [200 - i for i in range(15)]
        assert one.image_times == pytest.approx(np.arange(15) / RATE + 0.01)
        assert one.force == pytest.approx(np.outer(one.times, [1, 2, 3]))
        assert one.action.tolist() == [2] * 15
        assert one.tracks["wrench"].shape == (15, 6)
        assert one.no_contact.read([0])[0, 0, 0, 0] == 99
        assert dict(one.labels) == {"take": 0, "dropped": 2}
    times, values = read_raw(path)["force"]
    assert times == pytest.approx(np.arange(150) / 100)
    assert values == pytest.approx(np.outer(times, np.ones(6)))


def test_a_segment_that_is_written_is_read_by_everything(tmp_path):
    with TakeStore(tmp_path, "train") as store:
        write(store, segments=2)
        found = list(Shards(str(tmp_path)).recordings("train"))
        assert [one.key for one in found] == [
            *("here/000000/left/0000", "here/000000/right/0000"),
            *("here/000000/left/0001", "here/000000/right/0001"),
        ]
        assert listed(tmp_path) == names(tmp_path)
        assert read_raw(tmp_path / "train-000000.0001.tar")["force"][0][0] == 0.5
    assert not list(tmp_path.rglob("*.part"))


def test_joining_makes_one_recording_a_sensor_and_keeps_everything(tmp_path):
    with TakeStore(tmp_path, "train") as store:
        write(store)
        entry = store.join(0)
        assert names(tmp_path) == listed(tmp_path) == ["train-000000.tar"]
        assert entry.summary.recordings == 2
        assert store.new_take() == 1
    check_take(tmp_path / "train-000000.tar")


def test_takes_are_added_to_those_of_both_splits(tmp_path):
    for take, split in enumerate(("train", "val", "train")):
        with TakeStore(tmp_path, split) as store:
            assert store.new_take() == take
            write(store, take, 1)
            store.join(take)
    assert names(tmp_path) == ["train-000000.tar", "train-000002.tar", "val-000001.tar"]
    held = index.parse_index((tmp_path / index.INDEX_FILE).read_bytes(), "index")
    assert [len(held.splits[split]) for split in ("train", "val")] == [2, 1]


@pytest.mark.parametrize("at", ["segments", "joined", "indexed", "removing"])
def test_whenever_it_is_killed_the_take_is_whole_and_there_once(tmp_path, at):
    """Copies of the folder at each moment of a join, opened again."""
    moments = {}

    class Watched(TakeStore):
        def _save(self):
            moments["joined"] = shutil.copytree(tmp_path / "out", tmp_path / "joined")
            super()._save()
            moments["indexed"] = shutil.copytree(tmp_path / "out", tmp_path / "indexed")
            moments["removing"] = shutil.copytree(tmp_path / "out", tmp_path / "removing")

    with TakeStore(tmp_path / "out", "train") as store:
        write(store)
    with TakeStore(tmp_path / "out", "train"):
        pass
    assert names(tmp_path / "out") == ["train-000000.tar"]  # a killed take is joined when reopened
    shutil.rmtree(tmp_path / "out")
    with TakeStore(tmp_path / "out", "train") as store:
        write(store)
        moments["segments"] = shutil.copytree(tmp_path / "out", tmp_path / "segments")
        store.__class__ = Watched
        store.join(0)
    folder = moments[at]
    (folder / NOTES / "train-000000.tar.77.part").write_bytes(b"half")
    if at == "removing":
        (folder / "train-000000.0001.tar").unlink()
    readable = [one for one in listed(folder) if (folder / one).exists()]
    assert sum(len(r.frames) for r in Shards(str(folder)).recordings("train")) == 30
    assert readable == listed(folder)
    with TakeStore(folder, "train") as store:
        assert names(folder) == listed(folder) == ["train-000000.tar"]
        assert store.new_take() == 1
    check_take(folder / "train-000000.tar")
    assert not list(folder.rglob("*.part"))


def test_without_its_index_everything_whole_is_found_again(tmp_path):
    with TakeStore(tmp_path, "train") as store:
        write(store)
        store.join(0)
        write(store, 1, 2)
    (tmp_path / index.INDEX_FILE).unlink()
    (tmp_path / "train-000001.0002.tar").write_bytes(b"cut off")
    with TakeStore(tmp_path, "train") as store:
        assert any("train-000001.0002.tar is left out" in line for line in store.notes)
    assert listed(tmp_path) == ["train-000000.tar", "train-000001.tar"]


def test_a_segment_that_cannot_be_written_leaves_the_others(tmp_path, monkeypatch):
    with TakeStore(tmp_path, "train") as store:
        write(store, segments=2)
        before = (tmp_path / index.INDEX_FILE).read_bytes()

        def full(path):
            raise OSError(28, "No space left on device")

        with monkeypatch.context() as patch:
            patch.setattr(module, "_sync", full)
            with pytest.raises(OSError, match="No space"):
                store.write(0, 2, [packed(2), packed(2, "right")], raw(2))
        assert (tmp_path / index.INDEX_FILE).read_bytes() == before
        assert len(names(tmp_path)) == 2
        assert not list((tmp_path / NOTES).glob("*.tar*"))
        store.write(0, 2, [packed(2), packed(2, "right")], raw(2))
        store.join(0)
    check_take(tmp_path / "train-000000.tar")


def test_without_room_for_the_join_the_segments_stay(tmp_path, monkeypatch):
    with TakeStore(tmp_path, "train") as store:
        write(store)
        usage = shutil.disk_usage(tmp_path)
        monkeypatch.setattr(module.shutil, "disk_usage", lambda path: usage._replace(free=100))
        assert store.join(0) is None
    assert len(names(tmp_path)) == 3


def test_one_program_at_a_time(tmp_path):
    with TakeStore(tmp_path, "train"), pytest.raises(ConfigError, match="another program records"):
        TakeStore(tmp_path, "train").__enter__()
    with TakeStore(tmp_path, "train"):
        pass


@pytest.mark.parametrize("has_index", [True, False])
def test_shards_of_others_are_left_alone(tmp_path, has_index):
    shards.write_shard(tmp_path / "train-here-0.tar", [packed(0)])
    if has_index:
        index.Index("sim", {"train": []}).save(tmp_path)
    with pytest.raises(ConfigError, match="give another out="):
        TakeStore(tmp_path, "train").__enter__()
    assert (
        json.loads((tmp_path / index.INDEX_FILE).read_text())["name"] == "sim"
        if has_index
        else True
    )


def test_a_damaged_index_is_made_anew_and_a_damaged_take_stays_in_segments(tmp_path):
    with TakeStore(tmp_path, "train") as store:
        write(store)
    path = tmp_path / "train-000000.0001.tar"
    content = bytearray(path.read_bytes())
    content[content.rfind(b"IHDR")] ^= 1  # in a picture, which is only read when it is joined
    path.write_bytes(content)
    (tmp_path / index.INDEX_FILE).write_text('{"version":')
    with TakeStore(tmp_path, "train") as store:
        said = " ".join(store.notes)
    assert "the index is made anew" in said
    assert "train-000000.tar stays in segments" in said
    assert len(listed(tmp_path)) == 3


def test_segments_without_views_or_frames_of_one_sensor_are_joined(tmp_path):
    paths = [tmp_path / f"{i}.tar" for i in range(3)]
    shards.write_shard(paths[0], [packed(0, image=False)])
    shards.write_shard(paths[1], [packed(1), packed(1, "right")])
    shards.write_shard(paths[2], [packed(2)])
    left, right = merge_segments(paths)
    assert (len(left.frames), len(left.image), len(right.frames)) == (15, 10, 5)
    assert list(left.frames) == [left.frames[i] for i in range(15)] == list(left.frames[0:15])


def npz(shape, bytes_each=0, compression=zipfile.ZIP_STORED):
    """Times and values with a shape in their header, and as many zeros."""
    out = io.BytesIO()
    head = f"{{'descr': '<f8', 'fortran_order': False, 'shape': {shape}, }}".ljust(117) + "\n"
    with zipfile.ZipFile(out, "w", compression) as archive:
        for name in ("times", "values"):
            start = b"\x93NUMPY\x01\x00" + len(head).to_bytes(2, "little") + head.encode()
            archive.writestr(f"{name}.npy", start + bytes(bytes_each))
    return out.getvalue()


@pytest.mark.parametrize(
    "content",
    [
        npz(f"({10**12},)"),
        npz(f"({10**22},)"),
        npz("(-1,)"),
        npz("(1000000,)", 8_000_000, zipfile.ZIP_DEFLATED),
        npz("(9,)", 72)[:-9],
    ],
    ids=["memory", "overflow", "negative", "a bomb", "cut off"],
)
def test_raw_values_that_lie_about_their_size_are_an_error(tmp_path, content):
    path = tmp_path / "a.tar"
    with tarfile.open(path, "w", format=tarfile.USTAR_FORMAT) as tar:
        info = tarfile.TarInfo("raw.force.npz")
        info.size = len(content)
        tar.addfile(info, io.BytesIO(content))
    with pytest.raises(DataError, match=r"a\.tar: raw\.force\.npz is damaged"):
        read_raw(path)


def test_files_of_others_stay(tmp_path):
    (tmp_path / "thesis.zip.part").write_text("mine")
    with TakeStore(tmp_path, "train"):
        pass
    assert (tmp_path / "thesis.zip.part").read_text() == "mine"
