import subprocess
import sys
import threading
from collections.abc import Iterator
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import numpy as np
import pytest

from tactileforge.data.shards import shards
from tactileforge.data.shards.fetch import ShardFolder
from tactileforge.data.shards.index import Index, IndexEntry
from tactileforge.datasets.shards import Shards
from tactileforge.errors import DataError


class Quiet(SimpleHTTPRequestHandler):
    """Serves files and keeps the requested names."""

    asked: list[str]

    def __init__(self, *args, asked: list[str], **options) -> None:
        self.asked = asked
        super().__init__(*args, **options)

    def log_message(self, *args: object) -> None:
        pass

    def do_GET(self) -> None:
        self.asked.append(self.path.rsplit("/", 1)[-1])
        super().do_GET()


@pytest.fixture
def packed(tmp_path: Path) -> Path:
    """Three shards of one recording each, with an index."""
    folder = tmp_path / "packed"
    entries = []
    for number in range(3):
        picture = shards.encode_image(np.full((8, 8, 3), number, np.uint8), "png")
        about = {
            "version": shards.SHARD_VERSION,
            "key": f"r{number}",
            "sensor": "digit",
            "times": [0.0, 0.1],
            "force": None,
            "action": None,
            "object": None,
            "text": None,
            "image_times": None,
            "labels": {},
            "tracks": {},
            "source": "here",
            "tier": 5,
            "licence": "CC0-1.0",
        }
        path = folder / f"train-{number:06d}.tar"
        shards.write_shard(path, [shards.Packed(about, "png", [picture] * 2, [], [])])
        entries.append(IndexEntry.of(path))
    Index("three", {"train": entries, "val": []}).save(folder)
    return folder


@pytest.fixture
def served(packed: Path) -> Iterator[tuple[str, list[str]]]:
    asked: list[str] = []
    handler = partial(Quiet, asked=asked, directory=str(packed))
    with ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        yield f"http://127.0.0.1:{server.server_port}", asked
        server.shutdown()
        thread.join()


def values(data: Shards) -> list[int]:
    return [int(recording.frames.read([1])[0, 0, 0, 0]) for recording in data.recordings("train")]


def test_shards_behind_a_url_are_fetched_once(
    served: tuple[str, list[str]], tmp_path: Path
) -> None:
    url, asked = served
    data = Shards(url, cache=str(tmp_path / "cache"))
    assert asked == []
    assert values(data) == [0, 1, 2]
    assert values(data) == [0, 1, 2]
    assert sorted(name for name in asked if name.endswith(".tar")) == [
        f"train-{number:06d}.tar" for number in range(3)
    ]
    assert not list(tmp_path.rglob("*.part"))


def test_a_shard_is_fetched_when_its_window_opens(
    served: tuple[str, list[str]], tmp_path: Path
) -> None:
    url, asked = served
    (source,) = Shards(url, cache=str(tmp_path / "cache")).sources("train")
    assert asked == ["index.json"]
    source.open([1], lambda line, count: None)
    assert asked == ["index.json", "train-000001.tar"]


def test_a_cache_is_kept_within_its_limit(served: tuple[str, list[str]], tmp_path: Path) -> None:
    url, _ = served
    data = Shards(url, cache=str(tmp_path / "cache"), cache_gb=25e-6)  # two shards of 10 kB
    assert [recording.key for recording in data.recordings("train")] == ["r0", "r1", "r2"]
    held = [path.name for path in (tmp_path / "cache").rglob("*.tar")]
    assert sorted(held) == ["train-000001.tar", "train-000002.tar"]


def test_another_file_than_was_indexed_is_refused(
    served: tuple[str, list[str]], packed: Path, tmp_path: Path
) -> None:
    url, _ = served
    path = packed / "train-000001.tar"
    raw = bytearray(path.read_bytes())
    raw[-2000] ^= 1
    path.write_bytes(raw)
    data = Shards(url, cache=str(tmp_path / "cache"))
    assert values(data) == [0, 2]
    (line,) = data.skipped
    assert "train-000001.tar: 10240 bytes with SHA-256" in line
    assert not list((tmp_path / "cache").rglob("train-000001*"))


@pytest.mark.slow
def test_what_cannot_be_reached_is_named(tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r"127\.0\.0\.1:9/index\.json: cannot be read"):
        list(Shards("http://127.0.0.1:9", cache=str(tmp_path)).recordings("train"))


def test_a_command_is_never_run(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="a command is never run to get data"):
        ShardFolder(f"pipe:touch {tmp_path}/ran", tmp_path)
    assert not list(tmp_path.iterdir())


def test_paths_and_file_urls_are_read_in_place(packed: Path, tmp_path: Path) -> None:
    for root in (str(packed), packed.as_uri()):
        assert values(Shards(root, cache=str(tmp_path / "cache"))) == [0, 1, 2]
    assert not (tmp_path / "cache").exists()


@pytest.mark.slow
def test_processes_that_make_room_take_nothing_from_each_other(tmp_path: Path) -> None:
    """Four processes with one shard each, of forty, and a cache with room for twelve."""
    code = """
import hashlib, random, sys
from pathlib import Path
from tactileforge.data.shards import fetch

bodies = [bytes([i]) * 20_000 for i in range(40)]
fetch.downloads.copy = lambda url, limit, out, whole: out.write(bodies[int(url[-10:-4])])
folder = fetch.ShardFolder("https://example.invalid/x", Path(sys.argv[1]), 12 * 20_000 / 1e9)
draw = random.Random(int(sys.argv[2]))
for _ in range(3000):
    i = draw.randrange(40)
    folder.get(f"train-{i:06d}.tar", 20_000, hashlib.sha256(bodies[i]).hexdigest())
"""
    words = [sys.executable, "-c", code, str(tmp_path)]
    running = [subprocess.Popen([*words, str(number)]) for number in range(4)]
    assert [process.wait(timeout=120) for process in running] == [0] * 4
    held = list(tmp_path.rglob("*.tar"))
    assert 0 < len(held) <= 16
