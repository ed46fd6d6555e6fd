import json
import re
from collections.abc import Sequence
from dataclasses import replace
from multiprocessing import get_start_method
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch

from tactileforge.contracts import Recording
from tactileforge.data.batches.allocate import allocate
from tactileforge.data.batches.clips import Clips
from tactileforge.data.batches.datamodule import TouchData
from tactileforge.data.batches.loader import Loader
from tactileforge.data.batches.source_samplers import FullSource, WindowedSource, WorkerId
from tactileforge.data.batches.sources import Bad, InMemory, Source
from tactileforge.data.batches.stream import BatchIndexSampler, Stream
from tactileforge.data.frames.lazy import ArrayFrames
from tactileforge.data.shards import index, shards
from tactileforge.data.shards.index import Index, IndexEntry, sort_recordings
from tactileforge.data.shards.summary import Summary
from tactileforge.datasets.mixture import Mixture
from tactileforge.datasets.shards import Shards
from tactileforge.errors import ConfigError, DataError
from tactileforge.util.files import sealed, unsealed

SENSORS = ("digit", "gelsight")


def recording(number: int, **options: Any) -> Recording:
    """Two thirds of a second; every frame shows the number of the recording."""
    frames = np.full((20, 8, 8, 3), number % 256, np.uint8)
    values = {
        "key": f"r{number}",
        "sensor": SENSORS[number % 2],
        "frames": ArrayFrames(frames),
        "times": np.arange(20) / 30,
        "no_contact": None,
        "object": f"o{number // 2}",
        "action": np.full(20, number % 3),
    }
    return Recording(**(values | options))


class Memory:
    """A data set in memory."""

    provides = frozenset({"force", "action", "object"})

    def __init__(self, count: int, val: int = 4, **options: Any) -> None:
        self.content = {
            "train": [recording(i, **options) for i in range(count)],
            "val": [recording(1000 + i, **options) for i in range(val)],
        }
        self.skipped: list[str] = []

    def recordings(self, split: str) -> list[Recording]:
        return self.content[split]


def pack(dataset: Memory, folder: Path, size: int, codec: str = "png") -> Path:
    """Shards of ``size`` recordings, in the order of `index.sort_key`."""
    splits: dict[str, list[IndexEntry]] = {}
    for split, content in dataset.content.items():
        ordered = sort_recordings(content)
        splits[split] = []
        for number, start in enumerate(range(0, len(ordered), size)):
            path = folder / f"{split}-{number:06d}.tar"
            shards.write_shard(
                path, [packed(recording, codec) for recording in ordered[start : start + size]]
            )
            splits[split].append(IndexEntry.of(path))
    Index("memory", splits, sorted=True).save(folder)
    return folder


def packed(recording: Recording, codec: str) -> shards.Packed:
    def encoded(frames: Any) -> list[bytes]:
        every = frames.read(range(len(frames))) if frames is not None else []
        return [shards.encode_image(picture, codec) for picture in every]

    pictures = (
        encoded(frames) for frames in (recording.frames, recording.no_contact, recording.image)
    )
    return shards.Packed(shards.describe_recording(recording), codec, *pictures)


def touch(dataset: Any, **options: Any) -> TouchData:
    given = {"frames": 4, "size": (8, 8), "batch_size": 8, "workers": 0, "match": 0.0}
    data = TouchData(dataset, **(given | options))
    data.setup()
    return data


def same(first: dict[str, Any], other: dict[str, Any]) -> bool:
    return first.keys() == other.keys() and all(
        torch.equal(value, other[key]) if isinstance(value, torch.Tensor) else value == other[key]
        for key, value in first.items()
    )


# a source that is sampled as a whole


def clips_of(count: int) -> Clips:
    recordings = [recording(i) for i in range(count)]
    return Clips(recordings, frames=4, spacing=1 / 15, hop=0.5, size=(8, 8))


def rows(track: FullSource, number: int, reader: WorkerId | None = None) -> list[int]:
    return track.draw(number, reader or WorkerId(), lambda line, count: None).rows.tolist()


def test_an_epoch_shows_every_clip_once() -> None:
    track = FullSource(clips_of(40), 8, [3])
    assert len(track.clips) == 40
    assert sorted(row for n in range(5) for row in rows(track, n)) == list(range(40))


def test_a_batch_may_lie_across_two_passes() -> None:
    track = FullSource(clips_of(10), 4, [3])
    drawn = [row for n in range(5) for row in rows(track, n)]
    assert sorted(drawn[:10]) == sorted(drawn[10:]) == list(range(10))
    assert drawn[:10] != drawn[10:]


def test_batches_are_a_function_of_their_number_and_the_seed() -> None:
    track = FullSource(clips_of(40), 8, [3])
    again = FullSource(clips_of(40), 8, [3])
    assert rows(track, 7) == rows(again, 7)
    assert rows(track, 7) != rows(track, 2)
    assert rows(track, 7) != rows(FullSource(clips_of(40), 8, [4]), 7)


def test_ranks_share_an_epoch_and_workers_change_nothing() -> None:
    whole, half = FullSource(clips_of(40), 8, [3]), FullSource(clips_of(40), 4, [3])
    for number in range(5):
        ranks = [rows(half, number, WorkerId(rank, 2, workers=3)) for rank in range(2)]
        assert ranks[0] + ranks[1] == rows(whole, number)


def test_a_fixed_share_of_each_batch_is_drawn_in_pairs() -> None:
    stream = touch(Memory(12), match=0.5).stream()
    for number in range(10):
        (items,) = stream.items(number)
        assert [group for _, group in items] == [0, 0, 1, 1, -1, -1, -1, -1]
        for group in range(2):
            batch = stream[number]
            (a, b) = (i for i, g in enumerate(batch["group"].tolist()) if g == group)
            same_object = batch["object"][a] == batch["object"][b]
            of_object = same_object and batch["sensor"][a] != batch["sensor"][b]
            assert of_object or batch["action"][a] == batch["action"][b]


def test_an_iteration_goes_on_where_the_run_stands() -> None:
    assert list(BatchIndexSampler(5, lambda: 7)) == [7, 8, 9]
    assert list(BatchIndexSampler(5, lambda: 10)) == [10, 11, 12, 13, 14]


def test_the_length_of_an_epoch_is_a_multiple_of_the_accumulated_batches() -> None:
    data = touch(Memory(21), hop=1.0)
    assert len(data.stream().tracks) == 1
    assert len(data.stream()) == 2
    assert len(touch(Memory(24), hop=1.0).stream(accumulate=2)) == 2


# a source of which readers hold windows


class Part:
    """A part with a counter of openings."""

    seconds = 0.0

    def __init__(self, content: Sequence[Recording]) -> None:
        self.content = content
        self.opened = 0

    @property
    def recordings(self) -> int:
        return len(self.content)

    def open(self, bad: Bad) -> Sequence[Recording]:
        self.opened += 1
        return self.content


def windows(parts: int, each: int, count: int, window: int) -> tuple[WindowedSource, list[Part]]:
    made = [Part([recording(each * p + i) for i in range(each)]) for p in range(parts)]
    summary = Summary.of(one for part in made for one in part.content)

    def cut(recordings: Sequence[Recording]) -> Clips:
        return Clips(recordings, frames=4, spacing=1 / 15, hop=2.0, size=(8, 8))

    return WindowedSource(Source("w", made, summary), cut, count, [5], window, hop=2.0), made


def drawn(track: WindowedSource, number: int, reader: WorkerId) -> list[str]:
    draw = track.draw(number, reader, lambda line, count: None)
    return [draw.clips.recordings[row].key for row in draw.rows]


@pytest.mark.parametrize(("world", "workers"), [(1, 1), (2, 1), (1, 2), (2, 2)])
def test_a_pass_shows_every_recording_once_over_all_readers(world: int, workers: int) -> None:
    seen = []
    batches = 8 // world  # 8 parts of 4 recordings in batches of 4
    for rank in range(world):
        reader = WorkerId(rank, world, workers)
        track, _ = windows(8, 4, 4, window=8)
        seen += [key for n in range(batches) for key in drawn(track, n, reader)]
    assert sorted(seen) == sorted(f"r{i}" for i in range(32))


def test_batches_of_windows_are_a_function_of_their_number() -> None:
    reader = WorkerId(rank=1, world=2, workers=3)
    track, _ = windows(24, 4, 3, window=8)
    whole = [drawn(track, number, reader) for number in range(60)]
    assert len({tuple(batch) for batch in whole}) > 50
    for number in (59, 3, 30):
        fresh, _ = windows(24, 4, 3, window=8)
        assert drawn(fresh, number, reader) == whole[number]


def test_a_window_is_opened_once_and_only_when_it_is_needed() -> None:
    track, parts = windows(8, 4, 4, window=8)
    for number in range(8):
        drawn(track, number, WorkerId())
        assert sum(part.opened for part in parts) == 2 * (number // 2 + 1)
    assert [part.opened for part in parts] == [1] * 8


def test_a_window_mixes_its_parts() -> None:
    track, _ = windows(8, 8, 8, window=16)
    first = drawn(track, 0, WorkerId())
    assert len({int(key[1:]) // 8 for key in first}) == 2


def test_fewer_parts_than_readers_are_shared() -> None:
    readers = [WorkerId(rank, 4, 1) for rank in range(4)]
    seen = [drawn(windows(2, 8, 4, window=4)[0], 0, reader) for reader in readers]
    assert all(seen)
    assert len({tuple(keys) for keys in seen}) == 4


# what a batch is made of


def test_portions_are_the_same_in_every_batch() -> None:
    labels = frozenset({"force"})
    sources = [("a", 6.0, frozenset()), ("b", 3.0, labels), ("c", 1.0, frozenset())]
    assert allocate(20, sources, {}) == [12, 6, 2]
    assert allocate(20, sources, {"force": 0.5}) == [6, 13, 1]
    assert allocate(4, [("a", 1e6, labels), ("b", 1.0, labels)], {}) == [3, 1]


@pytest.mark.parametrize(
    ("size", "sources", "shares", "message"),
    [
        (1, [("a", 1, frozenset()), ("b", 1, frozenset())], {}, "1 clips of a batch for 2 sources"),
        (8, [("a", 0, frozenset())], {}, "weights of sources are above 0"),
        (8, [("a", 1, frozenset())], {"force": 0.5}, "no source has force"),
        (8, [("a", 1, frozenset({"force"}))], {"force": 1.5}, "add up to at most 1"),
    ],
)
def test_impossible_portions_are_named(size, sources, shares, message) -> None:
    with pytest.raises(ConfigError, match=message):
        allocate(size, sources, shares)


def test_every_batch_holds_the_portions_and_the_force_it_was_asked_for() -> None:
    force = np.ones((20, 3), np.float32)
    data = touch(Mixed(a=Memory(40), b=Memory(10, force=force)), shares={"force": 0.5})
    stream = data.stream()
    assert [track.count for track in stream.tracks] == [3, 5]
    for number in range(12):
        batch = stream[number]
        assert batch["force_valid"].all(1).tolist() == [False] * 3 + [True] * 5
        assert len(batch["frames"]) == 8


class Mixed(Mixture):
    """A mixture of data sets in memory."""

    def __init__(self, **datasets: Memory) -> None:
        super().__init__({name: {} for name in datasets})
        self.__dict__["datasets"] = datasets


def test_objects_of_two_data_sets_are_told_apart_and_actions_are_not() -> None:
    data = touch(Mixed(a=Memory(12), b=Memory(12)), match=1.0, batch_size=16)
    stream = data.stream()
    mixed = 0
    for number in range(20):
        batch = stream[number]
        sources = [key.split("/")[0] for key in keys(stream, number)]
        group = batch["group"]
        for a, b in zip(*torch.where((group[:, None] == group) & (group >= 0)), strict=True):
            if batch["object"][a] == batch["object"][b]:
                assert sources[a] == sources[b]
            elif batch["action"][a] == batch["action"][b]:
                mixed += sources[a] != sources[b]
    assert mixed > 10


def keys(stream: Stream, number: int) -> list[str]:
    keys_found = []
    for track, items in zip(stream.tracks, stream.items(number), strict=True):
        assert isinstance(track, FullSource)
        keys_found += [track.clips.recordings[track.clips.index[clip, 0]].key for clip, _ in items]
    return keys_found


def test_weights_of_a_mixture_change_its_portions() -> None:
    mixed = Mixed(a=Memory(40), b=Memory(10))
    assert [track.count for track in touch(mixed).stream().tracks] == [6, 2]
    mixed.weights = {"a": 1.0, "b": 3.0}
    assert [track.count for track in touch(mixed).stream().tracks] == [2, 6]
    with pytest.raises(ConfigError, match=r"source in data\.weights 'c'"):
        Mixture({"a": {"name": "sim"}}, {"c": 1.0})


# from shards


def test_small_shards_give_the_batches_of_the_data_they_were_packed_from(tmp_path: Path) -> None:
    loose = Memory(24)
    tight = Shards(str(pack(loose, tmp_path, size=5)))
    first, other = touch(loose, match=0.5).stream(), touch(tight, match=0.5).stream()
    assert len(first) == len(other)
    assert all(same(first[number], other[number]) for number in range(2 * len(first)))


@pytest.mark.slow
def test_large_shards_are_read_by_workers_as_by_none(tmp_path: Path) -> None:
    folder = pack(Memory(48), tmp_path, size=4)
    data = touch(Shards(str(folder)), window=8, workers=2, match=0.5)
    stream = data.stream()
    assert stream.tracks[0].windowed
    loader = Loader.of(stream, BatchIndexSampler(len(stream), lambda: 3), data.workers)
    numbers = list(BatchIndexSampler(len(stream), lambda: 3))
    for number, batch in zip(numbers, loader, strict=True):
        assert same(batch, data.stream()[number])


@pytest.mark.slow
def test_workers_of_several_processes_are_not_forked(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    data = touch(Shards(str(pack(Memory(24), tmp_path, size=4))), workers=1)
    stream, numbers = data.stream(), BatchIndexSampler(1)
    alone = Loader.of(stream, numbers, 1).multiprocessing_context
    assert alone.get_start_method() == get_start_method()
    monkeypatch.setattr("tactileforge.data.batches.loader.world", lambda: (0, 2))
    assert Loader.of(stream, numbers, 0).multiprocessing_context is None
    loader = Loader.of(stream, numbers, 1)
    assert loader.multiprocessing_context.get_start_method() == "forkserver"
    (batch,) = loader
    assert same(batch, stream[0])
    # Windows
    monkeypatch.setattr("tactileforge.data.batches.loader.get_all_start_methods", lambda: ["spawn"])
    monkeypatch.setattr("tactileforge.data.batches.loader.get_start_method", lambda: "spawn")
    loader = Loader.of(stream, numbers, 1)
    assert loader.multiprocessing_context.get_start_method() == "spawn"


def test_a_daemon_process_reads_itself_and_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """As the jobs of a sweep by joblib."""
    data = touch(Shards(str(pack(Memory(24), tmp_path, size=4))), workers=2)
    here = SimpleNamespace(daemon=True)
    monkeypatch.setattr("tactileforge.data.batches.loader.current_process", lambda: here)
    loader = Loader.of(data.stream(), BatchIndexSampler(1), 2)
    assert loader.num_workers == 0
    assert "batch.workers=2: this process may start no others, so it reads" in caplog.text
    (batch,) = loader
    assert same(batch, data.stream()[0])


@pytest.mark.parametrize("match", [0.5, 1.0])
def test_pairs_are_found_in_a_window(match: float, tmp_path: Path) -> None:
    folder = pack(Memory(48), tmp_path, size=4)
    stream = touch(Shards(str(folder)), window=8, match=match).stream()
    # of four places two pairs, of eight two clips with a partner of each kind, and a pair
    drawn = [0, 0, 1, 1, -1, -1, -1, -1] if match == 0.5 else [0, 0, 0, 1, 1, 1, 2, 2]
    for number in range(12):
        assert stream[number]["group"].tolist() == drawn


def test_a_resumed_run_may_change_its_workers_and_nothing_else(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    folder = pack(Memory(48), tmp_path, size=4)
    before = touch(Shards(str(folder)), window=8, workers=2)
    after = touch(Shards(str(folder)), window=8, workers=1)
    state = Loader.of(before.stream(), BatchIndexSampler(1), before.workers).state_dict()
    with caplog.at_level("WARNING", "tactileforge"):
        Loader.of(after.stream(), BatchIndexSampler(1), after.workers).load_state_dict(state)
    assert "resume: workers were 2 and are 1" in caplog.text
    with pytest.raises(ConfigError, match="resume: seed was 5 and is 0"):
        Loader.of(after.stream(), BatchIndexSampler(1), 1).load_state_dict(state | {"seed": 5})


def flip(path: Path, place: int) -> None:
    raw = bytearray(path.read_bytes())
    raw[place] ^= 1
    path.write_bytes(raw)


def test_a_damaged_picture_is_named_and_replaced(tmp_path: Path) -> None:
    folder = pack(Memory(24), tmp_path, size=6)
    stream = touch(Shards(str(folder))).stream()
    first = next(iter(shards.read_shard(folder / "train-000000.tar")))
    assert isinstance(first.frames, shards.PackedFrames)
    for start in first.frames.starts:  # after it was opened
        flip(folder / "train-000000.tar", int(start) + 520)
    skipped: dict[str, tuple[str, int]] = {}
    for number in range(len(stream)):
        batch = stream[number]
        assert len(batch["frames"]) == 8
        skipped |= batch["skipped"]
    ((key, (line, count)),) = skipped.items()
    assert (key, count) == (first.key, 1)
    assert f"of {folder / 'train-000000.tar'}:{first.key} is damaged" in line


@pytest.mark.parametrize("window", [4, 100])
def test_a_shard_that_is_gone_is_named_and_counted(tmp_path: Path, window: int) -> None:
    folder = pack(Memory(24), tmp_path, size=4)
    (folder / "train-000002.tar").unlink()
    data = touch(Shards(str(folder)), window=window)
    stream = data.stream()
    skipped = dict(data.skipped)
    for number in range(2 * len(stream)):
        skipped |= stream[number]["skipped"]
    ((line, count),) = skipped.values()
    assert "train-000002.tar: listed in the index, but not there" in line
    assert count == 4


def test_a_shard_that_is_cut_off_is_lost(tmp_path: Path) -> None:
    folder = pack(Memory(24), tmp_path, size=6)
    path = folder / "train-000001.tar"
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    data = touch(Shards(str(folder)))
    ((line, count),) = data.skipped.values()
    assert "train-000001.tar" in line
    assert "(their SHA-256 is another): damaged, or another shard" in line
    assert data.train is not None
    assert len(data.train.recordings) == 24 - count
    assert count == 6


@pytest.mark.parametrize("split", ["train", "val"])
def test_shards_that_were_swapped_are_refused(tmp_path: Path, split: str) -> None:
    """Else validation data is trained on."""
    folder = pack(Memory(24), tmp_path, size=6)
    first, last = folder / "train-000000.tar", folder / "val-000000.tar"
    swapped = first.read_bytes(), last.read_bytes()
    last.write_bytes(swapped[0])
    first.write_bytes(swapped[1])
    keys = {recording.key for recording in shards.read_shard(last if split == "train" else first)}
    data = Shards(str(folder))
    assert not keys & {
        recording.key for recording in data.recordings("val" if split == "train" else "train")
    }
    assert "damaged, or another shard" in data.skipped[0]


def test_every_flipped_bit_of_an_index_is_found(tmp_path: Path) -> None:
    """Or changes nothing: a blank became another blank."""
    folder = pack(Memory(8), tmp_path, size=4)
    raw = (folder / "index.json").read_bytes()
    whole, found = index.parse_index(raw, "x"), 0
    for bit in range(0, 8 * len(raw), 5):
        flipped = bytearray(raw)
        flipped[bit // 8] ^= 1 << bit % 8
        try:
            assert index.parse_index(bytes(flipped), "x") == whole
        except DataError:
            found += 1
    assert found > 0.8 * 8 * len(raw) / 5


def test_shards_of_one_key_are_refused(tmp_path: Path) -> None:
    folder = pack(Memory(8), tmp_path, size=4)
    about = unsealed((folder / "index.json").read_text())
    shards.write_shard(folder / "train-000002.tar", [packed(recording(3), "png")])
    about["splits"]["train"].append(IndexEntry.of(folder / "train-000002.tar").to_json())
    (folder / "index.json").write_text(sealed(about))
    with pytest.raises(DataError, match=r"train-00000. ?.*hold recordings of one key"):
        touch(Shards(str(folder)))


def test_one_key_twice_in_a_source_that_is_not_sorted_comes_once() -> None:
    part = Part([recording(0), recording(0), recording(1)])
    said: list[str] = []
    source = Source("s", [part], Summary.of(part.content))
    assert len(source.open([0], lambda line, count: said.append(line))) == 2
    assert said == ["r0: two recordings of s have this key"]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"file": "../train-000000.tar"}, "not the name of a shard"),
        ({"file": "pipe:rm -rf x"}, "not the name of a shard"),
        ({"bytes": "many"}, "invalid literal"),
        ({"holds": 3}, "not iterable"),
        ({"holds": [{"sensor": "digit"}]}, "KeyError"),
    ],
)
def test_a_wrong_index_is_named(tmp_path: Path, change: dict[str, Any], message: str) -> None:
    folder = pack(Memory(8), tmp_path, size=4)
    about = unsealed((folder / "index.json").read_text())
    about["splits"]["train"][0] |= change
    (folder / "index.json").write_text(sealed(about))
    with pytest.raises(DataError, match=f"index.json: no index of shards.*{message}"):
        touch(Shards(str(folder)))


def test_an_older_index_is_refused(tmp_path: Path) -> None:
    folder = pack(Memory(8), tmp_path, size=4)
    about = json.loads((folder / "index.json").read_text()) | {"version": 1}
    (folder / "index.json").write_text(json.dumps(about))
    with pytest.raises(DataError, match="version 1, but this tactileforge reads 4"):
        touch(Shards(str(folder)))


def test_what_is_opened_is_all_there_is() -> None:
    content = [recording(0)]
    part = InMemory(content, 1.0)
    assert part.recordings == 1
    assert part.open(lambda line, count: None) is content


def test_a_run_may_lose_one_in_a_hundred_recordings_and_always_one() -> None:
    assert touch(Memory(20)).allowed == 1
    assert touch(Memory(396)).allowed == 4
    assert touch(Memory(20), max_bad=0.5).allowed == 12


def test_a_force_that_cannot_be_true_is_left_out_and_named() -> None:
    """Seventeen tons, or a number beyond float32."""
    force = np.zeros((20, 3), np.float32)
    good = recording(0, force=force.copy())
    force[2, 1] = 1.7e5
    bad = recording(1, force=force)
    part = Part([good, bad])
    said: list[str] = []
    source = Source("s", [part], Summary.of(part.content))
    assert source.open([0], lambda line, count: said.append(line)) == [good]
    assert re.match(r"r1, row 2: a force of \(.*170000.*\) N, where .* can feel", said[0])


def test_a_damaged_recording_for_validation_is_left_out() -> None:
    class Damaged:
        shape = (8, 8)

        def __len__(self) -> int:
            return 6

        def read(self, indices: Any) -> Any:
            raise DataError("v: cannot be decoded")

    data = Memory(8, val=1)
    data.content["val"][0] = replace(data.content["val"][0], frames=Damaged())
    found = touch(data)
    assert found.val is None
    assert [line for line, _ in found.skipped.values()] == ["r1000: v: cannot be decoded"]
    data = Memory(8, val=2)
    data.content["val"][0] = replace(data.content["val"][0], frames=Damaged())
    found = touch(data)
    assert found.val is not None
    assert [one.key for one in found.val.recordings] == ["r1001"]
