import io
import json
import tarfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tactileforge_inspect import inspect

from tactileforge.contracts import Dataset, Recording
from tactileforge.data.batches.sources import sources_of
from tactileforge.data.frames.image_codecs import encode_image
from tactileforge.data.frames.lazy import ArrayFrames
from tactileforge.data.shards.foreign import ForeignShardError, is_foreign
from tactileforge.data.shards.shards import Packed, describe_recording, read_shard, write_shard
from tactileforge.datasets.mixture import Mixture
from tactileforge.datasets.shards import Shards
from tactileforge.errors import DataNotFoundError
from tactileforge.packing.options import PackOptions
from tactileforge.packing.plan import plan_pack

PICTURE = encode_image(np.zeros((8, 8, 3), np.uint8), "jpg")


def foreign(folder: Path, name: str = "train-000000.tar", stem: str = "left.{:06d}") -> Path:
    """A webdataset as others write it."""
    with tarfile.open(folder / name, "w") as tar:
        for i in range(3):
            about = json.dumps({"label": i % 2}).encode()
            for ending, content in (("jpg", PICTURE), ("json", about)):
                info = tarfile.TarInfo(f"{stem.format(i)}.{ending}")
                info.size = len(content)
                tar.addfile(info, io.BytesIO(content))
    return folder


@pytest.mark.parametrize("stem", ["left.{:06d}", "{:06d}", "cup/{:09d}"])
@pytest.mark.parametrize("name", ["train-000000.tar", "00000.tar"])
def test_a_webdataset_of_another_program_is_named(tmp_path: Path, stem: str, name: str) -> None:
    data: Dataset = Shards(str(foreign(tmp_path, name, stem)))
    words = rf"{name}: a webdataset of another program \(jpg, json\), .* data=webdataset"
    with pytest.raises(ForeignShardError, match=words):
        list(data.recordings("train"))
    with pytest.raises(ForeignShardError, match=words):
        sources_of(data, "train")


def test_a_tar_of_json_alone_is_named_unless_it_may_be_a_shard_that_was_cut_off(
    tmp_path: Path,
) -> None:
    for name, is_ours in (("meta.json", False), ("000000.json", True)):
        with tarfile.open(tmp_path / "train-000000.tar", "w") as tar:
            info = tarfile.TarInfo(name)
            info.size = 2
            tar.addfile(info, io.BytesIO(b"{}"))
        assert is_foreign(tmp_path / "train-000000.tar") != is_ours


def test_every_door_names_it(tmp_path: Path) -> None:
    root = str(foreign(tmp_path))
    words = "a webdataset of another program"
    with pytest.raises(Exception, match=words):
        inspect(Shards(root), "x", tmp_path / "page.html", progress=False)
    with pytest.raises(ForeignShardError, match=words):
        plan_pack(Shards(root), tmp_path / "out", PackOptions())
    sources: Any = {"a": {"name": "shards", "root": root}}
    with pytest.raises(ForeignShardError, match=words):
        Mixture(sources).sources("train")


def test_shards_of_ours_are_none(tmp_path: Path) -> None:
    frames = ArrayFrames(np.zeros((1, 8, 8, 3), np.uint8))
    recording = Recording(
        key="a", sensor="digit", frames=frames, times=np.zeros(1), no_contact=None
    )
    path = tmp_path / "train-000000.tar"
    write_shard(path, [Packed(describe_recording(recording), "jpg", [PICTURE], [], [])])
    assert [one.key for one in read_shard(path)] == ["a"]
    write_shard(path, [])
    assert list(read_shard(path)) == [], "an empty one is not foreign"
    with pytest.raises(DataNotFoundError, match=r"neither index\.json nor train"):
        list(Shards(str(tmp_path / "nothing")).recordings("train"))
