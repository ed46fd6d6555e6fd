"""Damaged files for every reader: each mutant in a process of its own, with limits.

``python benchmarks/reader_mutants.py`` reads over 2,000 and writes
``results/reader_mutants.json``: of each format ``--count`` with other bytes, and as many as
``--structures`` with another structure (reader_structures.py). ``--only zarr,HDF5`` takes a part,
``--show`` prints each that is silent. With ``--instead`` each kind of file of each format is
replaced in turn by random bytes of three sizes, its first half, nothing, a folder and a pipe:
``results/reader_instead.json``. result_tables.py makes the tables of docs/reliability.md.

A data set is read through two doors: the scan of ``data inspect``, and then every frame and label
of every recording. A mutant is one of

- refused: an error of the project that names the file or the set; nameless: one that does not;
- counted: a file in ``skipped``, or a new note;
- equal: read as the whole file is;
- silent: read as something else, without a word;
- traceback: any other exception; hang: over 5 s of CPU or 120 s of wall time (other programs share
  the machine); memory: over 500 MB more than reading the whole file takes.
"""

from __future__ import annotations

import argparse
import hashlib
import importlib.util
import inspect
import json
import os
import pickle
import resource
import shutil
import signal
import sqlite3
import sys
import tempfile
import time
import traceback
import zlib
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pyarrow as arrow
import reader_structures
import torch
from _pytest.outcomes import Skipped
from common import RESULTS, memory_mb
from PIL import Image
from rosbags import rosbag2
from safetensors.torch import save_file

from tactileforge.datasets.recordings import Recordings
from tactileforge.datasets.shards import Shards
from tactileforge.errors import TactileForgeError
from tactileforge.hub.classify import CLASS_FORMAT, ClassFacts, ClassHead, read_class_head
from tactileforge.hub.header import read_header
from tactileforge.plugins import registry
from tactileforge.reading.pickles import load_pickle

ROOT = Path(__file__).parents[1]
PLUGINS = ("episodes", "rosbags", "lerobot")
PLACES = ["tests/helpers", "tests/packing", "tests/chaos", "plugins/tactileforge-datasets/tests"]
PLACES += ["plugins/tactileforge-policies/tests/helpers"]
PLACES += [f"plugins/tactileforge-{name}/tests" for name in PLUGINS]
sys.path += [str(ROOT / place) for place in PLACES]

import dataset_fixtures  # type: ignore[import-not-found]  # noqa: E402
import lerobot_sets  # type: ignore[import-not-found]  # noqa: E402
import made_bags  # type: ignore[import-not-found]  # noqa: E402
import made_episodes  # type: ignore[import-not-found]  # noqa: E402
import made_samples  # type: ignore[import-not-found]  # noqa: E402
import made_sets  # type: ignore[import-not-found]  # noqa: E402
import shared_fixtures  # type: ignore[import-not-found]  # noqa: E402
from bent import bent  # type: ignore[import-not-found]  # noqa: E402
from tactileforge_datasets.webdataset import WebDataset  # noqa: E402
from tactileforge_depth.reader import read_optics  # noqa: E402
from tactileforge_episodes.dataset import Episodes  # noqa: E402
from tactileforge_inspect.scan import scan_dataset  # noqa: E402
from tactileforge_labels.marks import read_marks  # noqa: E402
from tactileforge_lerobot.dataset import LeRobot  # noqa: E402
from tactileforge_published.files import read_tensors  # noqa: E402
from tactileforge_rosbags.dataset import Rosbags  # noqa: E402
from tactileforge_sim.geometry.mesh_files import load_mesh, load_points  # noqa: E402

#: Limits of a mutant: CPU s, wall s, MB more than the whole file takes.
CPU, WALL, MORE = 5.0, 120.0, 500.0
#: Wall time of a set with a pipe, which is waited for without CPU time, s.
PIPE = 10.0
#: Recordings that the scan of `data inspect` decodes.
_LOOKED = 40
OUTCOMES = (
    "refused", "counted", "nameless", "equal", "silent", "traceback", "hang", "memory",
)  # fmt: skip
#: Outcomes that no mutant may have.
BAD = ("traceback", "hang", "memory")
#: Errors of a change that a file cannot have: none of its kind is there, or its format forbids it.
NOT_MADE = (LookupError, ValueError, TypeError, OSError, sqlite3.Error, arrow.ArrowException)


@dataclass(frozen=True)
class Kind:
    """A format: how a good folder is made and read.

    Attributes:
        make: Fills an empty folder.
        read: Reads all of it; returns what was read, as a digest, and the lines that were said.
        checksum: Whether the format holds a checksum of its content.
    """

    make: Callable[[Path], Any]
    read: Callable[[Path], tuple[str, list[str]]]
    checksum: bool = False


def _add(total: Any, value: Any) -> None:
    total.update(value.tobytes() if isinstance(value, np.ndarray) else repr(value).encode())


def _all(data: Any, root: Path) -> tuple[str, list[str]]:
    """Digest of all recordings of a data set, and its messages, through both doors."""
    total, scanned, refused = hashlib.sha256(), list[str](), None
    try:
        scanned = scan_dataset(data, _LOOKED, progress=False).findings.unreadable
    except TactileForgeError as error:
        refused = error
    for split in ("train", "val"):
        for one in data.recordings(split):
            _add(total, (one.key.replace(str(root), ""), one.sensor, one.object, one.text))
            _add(total, sorted(one.labels.items()))
            for frames in (one.frames, one.no_contact, one.image):
                if frames is not None:
                    _add(total, frames.read(range(len(frames))))
            _add(total, np.asarray(one.times))
            for values in (one.force, one.action, *(one.tracks[k] for k in sorted(one.tracks))):
                if values is not None:
                    _add(total, np.asarray(values))
    if refused is not None:
        raise refused
    said = [*data.skipped, *getattr(data, "notes", []), *scanned]
    return total.hexdigest(), [line.replace(str(root), "") for line in said]


def _one(read: Callable[[Path], Any], name: str, root: Path) -> tuple[str, list[str]]:
    total = hashlib.sha256()
    _add(total, read(root / name))
    return total.hexdigest(), []


def _gel(number: int, count: int = 8) -> np.ndarray:
    y, x = np.mgrid[:40, :48]
    dent = np.exp(-((x - 20 - 3 * number) ** 2 + (y - 20) ** 2) / 60.0)[..., None]
    rise = np.sin(np.linspace(0, np.pi, count))[:, None, None, None]
    gel: np.ndarray = 80 + rise * dent * (90, 60, 30) + 10 * (x / 48)[..., None]
    return gel.astype(np.uint8)


_FORCE = "fx,fy,fz\n" + "".join(f"0.1,0.2,{i / 2}\n" for i in range(8))
_TABLE = {"file": "{stem}.csv", "columns": ["fx", "fy", "fz"]}
_LABELS = "file,object,rough\n" + "".join(f"{i},cup{i},{i}\n" for i in range(3))


def _layout(root: Path, **keys: Any) -> None:
    layout = {"sensor": "digit", "background": {"first": 1}, **keys}
    (root / "tactileforge.yaml").write_text("layouts:\n  one: " + json.dumps(layout) + "\n")


def _videos(root: Path, suffix: str = ".mp4") -> None:
    codec = {".mp4": "mp4v", ".avi": "MJPG", ".mkv": "FFV1"}[suffix]
    for i in range(3):
        film = cv2.VideoWriter(
            str(root / f"{i}{suffix}"), cv2.VideoWriter.fourcc(*codec), 20, (48, 40)
        )
        for frame in _gel(i):
            film.write(frame[..., ::-1])
        film.release()
        (root / f"{i}.csv").write_text(_FORCE)
    (root / "labels.csv").write_text(_LABELS)
    _layout(
        root, videos=f"*{suffix}", force=_TABLE,
        labels={"file": "labels.csv", "key": "file"}, object="{object}",
    )  # fmt: skip


def _images(root: Path, suffix: str = ".png", tables: str = "csv") -> None:
    for i in range(3):
        (root / f"{i}").mkdir()
        for k, frame in enumerate(_gel(i)):
            Image.fromarray(frame).save(root / f"{i}" / f"{k:03d}{suffix}")
        if tables == "sidecar":
            for k in range(8):
                said = {"object": f"cup{i}", "rough": k, "force": [0.1, 0.2, k / 2]}
                (root / f"{i}" / f"{k:03d}.json").write_text(json.dumps(said))
        elif tables == "npy":
            np.save(root / f"{i}.npy", np.full((8, 3), i / 2))
        else:
            (root / f"{i}.{tables}").write_text(
                _FORCE if tables == "csv"
                else json.dumps([{"fx": 0.1, "fy": 0.2, "fz": k / 2} for k in range(8)])
            )  # fmt: skip
    keys: dict[str, Any] = {"images": f"*/*{suffix}", "each": "sequence", "fps": 30}
    if tables == "sidecar":
        keys |= {"labels": {"file": "{file}/*.json"}}
    elif tables == "npy":
        keys |= {"force": {"file": "{stem}.npy", "columns": ["0", "1", "2"]}}
    else:
        keys |= {"force": {"file": "{stem}." + tables, "columns": ["fx", "fy", "fz"]}}
    _layout(root, **keys)


def _stack(root: Path) -> None:
    for i in range(3):
        np.save(root / f"{i}.npy", _gel(i))
        (root / f"{i}.csv").write_text(_FORCE)
    _layout(
        root, videos="*.npy", fps=30, force={"file": "{stem}.csv", "columns": ["fx", "fy", "fz"]}
    )


def _episodes(preset: str) -> Kind:
    make, options = made_episodes.FORMATS[preset]
    keys = {"preset": preset, "val": 0, **options}
    return Kind(make, lambda root: _all(Episodes(str(root), **keys), root))


def _zarr3(root: Path) -> None:
    whole = made_episodes.write_zarr
    made_episodes.write_zarr = lambda p, a, version=2, chunk=10: whole(p, a, 3, chunk)
    try:
        made_episodes.reactive_diffusion(root)
    finally:
        made_episodes.write_zarr = whole


def _lerobot(version: str, images: str) -> Kind:
    return Kind(
        lambda root: lerobot_sets.made_set(root / "s", version, images),
        lambda root: _all(
            LeRobot(str(root / "s"), touch=[lerobot_sets.LEFT], sensors=["digit"], val=0), root
        ),
    )


def _bag(kind: str, compress: Any = None) -> Kind:
    def make(root: Path) -> None:
        made_bags.write_rig(root / "one", kind, 8, compress)
        (root / "rig.yaml").write_text(made_bags.RIG_MAP)

    return Kind(
        make, lambda root: _all(Rosbags(str(root), map=str(root / "rig.yaml"), val=0), root)
    )


def _shards(root: Path, indexed: bool = True) -> None:
    from packable import Touches  # type: ignore[import-not-found]

    from tactileforge.packing import PackOptions, pack

    pack(Touches(), "touches", root, PackOptions(codec="png", shard_frames=24, processes=1))
    if not indexed:
        for path in root.iterdir():
            if path.suffix != ".tar":
                shutil.rmtree(path) if path.is_dir() else path.unlink()


def _chaos(name: str) -> Kind:
    """A reader of one file of tests/chaos."""

    def parts(folder: Path) -> tuple[bytes, Callable[[Path], Any]]:
        from test_chaos import (  # type: ignore[import-not-found]
            GIVEN,
            PACKABLE,
            pack,
            parsers,
        )

        packed = folder / "packed"
        pack(PACKABLE.Touches(), "touches", packed, GIVEN)
        found: tuple[bytes, Callable[[Path], Any]] = parsers(folder, packed)[name]
        return found

    kept: list[Callable[[Path], Any]] = []

    def make(root: Path) -> None:
        with tempfile.TemporaryDirectory() as held:
            raw, read = parts(Path(held))
        kept[:] = [read]
        (root / "file").write_bytes(raw)

    return Kind(make, lambda root: _one(lambda p: repr(kept[0](p)), "file", root), True)


def _module(path: str) -> Any:
    """A module of tests, under a name of its own."""
    name = path.replace("/", "_").removesuffix(".py")
    if name not in sys.modules:
        found = importlib.util.spec_from_file_location(name, ROOT / path)
        assert found
        assert found.loader
        sys.modules[name] = importlib.util.module_from_spec(found)
        found.loader.exec_module(sys.modules[name])
    return sys.modules[name]


def _fixture(function: Any, root: Path) -> Any:
    """Files of a fixture of the tests, in a folder."""
    plain = inspect.unwrap(function)
    given: dict[str, Any] = {}
    for name in inspect.signature(plain).parameters:
        place = dataset_fixtures if hasattr(dataset_fixtures, name) else shared_fixtures
        given[name] = root if name == "tmp_path" else _fixture(getattr(place, name), root)
    return plain(**given)


def _published(name: str) -> Kind:
    """A published data set, as its tests make it."""

    def make(root: Path) -> None:
        if name in made_sets.MADE:
            made_sets.MADE[name](root)
        elif name == "sparsh_force":
            tests = _module("plugins/tactileforge-datasets/tests/test_sparsh_force.py")
            _fixture(tests.batch, root)("sphere/batch_1")
        else:
            tests = _module(f"plugins/tactileforge-datasets/tests/test_{name}.py")
            _fixture(tests.root, root)

    def read(root: Path) -> tuple[str, list[str]]:
        keys = {"sensor": "gelsight_mini"} if name == "sparsh_slip" else {}
        return _all(registry.get("datasets", name)(str(root), split="all", val=0, **keys), root)

    return Kind(make, read)


def _image_tables(root: Path) -> None:
    tests = _module("plugins/tactileforge-datasets/tests/test_image_tables.py")
    rows = tests.rows("image", "fx", "fy", "fz", "object", "episode_index", "timestamp")
    tests.parquet.write_table(tests.arrow.Table.from_pylist(rows), root / "train.parquet")


def _table(name: str) -> Kind:
    """A table of forces beside pictures, as another program writes it."""
    tests = _module("tests/datasets/test_tables_as_written.py")

    def make(root: Path) -> None:
        for trial in "ab":
            (root / trial).mkdir()
            for k, frame in enumerate(_gel(1, tests.COUNT)):
                Image.fromarray(frame).save(root / trial / f"{k:03d}.png")
            tests.TABLES[name](root / trial)

    return Kind(make, _guessed)


def _guessed(root: Path) -> tuple[str, list[str]]:
    from tactileforge.datasets import recognise

    found = recognise(root)
    if not found:
        raise TactileForgeError("not recognised")
    name, guess = found[0]
    options = dict(guess.options)
    data = registry.build("datasets", {"name": name, **options, "val": 0})
    total, said = _all(data, root)
    return total, [*said, *(doubt.replace(str(root), "") for doubt in guess.doubts)]


def _mat(write: str) -> Kind:
    tests = _module("plugins/tactileforge-episodes/tests/test_mat.py")

    def make(root: Path) -> None:
        for trial in range(3):
            getattr(tests, write)(root / f"trial_{trial}.mat", tests.arrays(trial))

    return Kind(make, _guessed)


def _single(
    name: str, write: Callable[[Path], Any], read: Callable[[Path], Any], checksum: bool = False
) -> Kind:
    """A format of one file, and its reader."""

    def value(root: Path) -> tuple[str, list[str]]:
        found = read(root / name)
        return hashlib.sha256(repr(found).encode()).hexdigest(), []

    return Kind(lambda root: write(root / name), value, checksum)


def _model(path: Path) -> None:
    made: Path = _module("tests/chaos/test_chaos.py")._model(path.parent)
    made.replace(path)


def _class_head(path: Path) -> None:
    facts = ClassFacts(
        format=CLASS_FORMAT, task="t", names=["cup", "key"], encoder="0" * 64, background=True,
        sensors=["digit"], penalty=0.1, metrics={"accuracy": 0.5},
    )  # fmt: skip
    ClassHead(facts, torch.zeros(2, 8), torch.zeros(2)).save(path)


def _weights(path: Path) -> None:
    tensors = {"blocks.0.weight": torch.ones(8, 8), "norm.bias": torch.zeros(8)}
    if path.suffix == ".pth":
        torch.save({"state_dict": tensors}, path)
    else:
        save_file(tensors, path)


def _optics(path: Path) -> None:
    shutil.copy(
        ROOT / "plugins/tactileforge-depth/src/tactileforge_depth/calibration/digit.json", path
    )


def _marks(path: Path) -> None:
    rows = [f"{i},{i / 20},{int(i > 3)},{int(i > 5)},0" for i in range(8)]
    path.write_text("\n".join(["frame,time,contact,slip,bad", *rows]) + "\n")


def _pickled(path: Path) -> None:
    path.write_bytes(pickle.dumps({"a": [1, (2.5, "x")], "b": np.zeros(9)}))


def _ball(path: Path) -> None:
    numbers = np.arange(150, dtype="<f4").tobytes()
    path.write_bytes(bytes(80) + (12).to_bytes(4, "little") + numbers)


#: Published data sets whose tests make a small one.
PUBLISHED = [
    *made_sets.MADE, "cloth", "feel", "objectfolder_real", "octopi", "sparsh_force", "sparsh_pose",
    "sparsh_slip", "ssvtp", "tacquad", "touch_and_go", "touch_slide", "touchd_force", "touchd_mani",
    "touchd_sim", "tvl", "visgel", "ycb_slide",
]  # fmt: skip
KINDS: dict[str, Kind] = {
    "zarr 2": _episodes("open_x_tactile"),
    "zarr 3": Kind(
        _zarr3,
        lambda root: _all(
            Episodes(str(root), preset="reactive_diffusion", sensors={"mctac": "digit"}, val=0),
            root,
        ),
    ),
    "zarr in a zip": _episodes("vitamin_b"),
    "HDF5": _episodes("univtac"),
    "HDF5, groups": _episodes("robomimic"),
    "npz": Kind(
        made_episodes.htt, lambda root: _all(Episodes(str(root), preset="htt", fps=25, val=0), root)
    ),
    "LeRobot 2.1, video": _lerobot("v2.1", "video"),
    "LeRobot 3.0, video": _lerobot("v3.0", "video"),
    "LeRobot 3.0, parquet": _lerobot("v3.0", "image"),
    "bag, sqlite3": _bag("sqlite3"),
    "bag, mcap": _bag("mcap"),
    "bag, mcap zstd": _bag("mcap", rosbag2.CompressionMode.MESSAGE),
    "bag, ROS 1": _bag("ros1"),
    "shards, index": Kind(_shards, lambda root: _all(Shards(str(root)), root), True),
    "shards, no index": Kind(
        partial(_shards, indexed=False), lambda root: _all(Shards(str(root)), root), True
    ),
    "mp4, CSV": Kind(_videos, lambda root: _all(Recordings(str(root), val=0), root)),
    "avi, CSV": Kind(
        partial(_videos, suffix=".avi"), lambda root: _all(Recordings(str(root), val=0), root)
    ),
    "png, CSV": Kind(_images, lambda root: _all(Recordings(str(root), val=0), root)),
    "jpg, JSON": Kind(
        partial(_images, suffix=".jpg", tables="json"),
        lambda root: _all(Recordings(str(root), val=0), root),
    ),
    "png, sidecars": Kind(
        partial(_images, tables="sidecar"), lambda root: _all(Recordings(str(root), val=0), root)
    ),
    "png, npy": Kind(
        partial(_images, tables="npy"), lambda root: _all(Recordings(str(root), val=0), root)
    ),
    "npy, CSV": Kind(_stack, lambda root: _all(Recordings(str(root), val=0), root)),
    "checkpoint": _chaos("checkpoint"),
    "model": _single("m.safetensors", _model, read_header, True),
    "calibration": _chaos("calibration"),
    **{
        name: _episodes(name)
        for name in made_episodes.FORMATS
        if name not in ("open_x_tactile", "vitamin_b", "univtac", "robomimic", "htt")
    },
    **{name: _published(name) for name in PUBLISHED},
    "mat 5": _mat("mat_5"),
    "mat 7.3": _mat("mat_73"),
    "image_tables": Kind(_image_tables, _guessed),
    "tars of samples": Kind(
        partial(made_samples.made_set, tars=2, clips=2),
        lambda root: _all(WebDataset(str(root), made_samples.FRAMES, val=0), root),
    ),
    **{
        f"forces in {name}": _table(name)
        for name in ("savetxt", "json", "npz", "mat", "mat 7.3", "xlsx", "parquet", "feather")
    },
    "class head": _single("head.safetensors", _class_head, read_class_head),
    "published weights, pt": _single("weights.pth", _weights, read_tensors),
    "published weights, safetensors": _single("weights.safetensors", _weights, read_tensors),
    "optics": _single("optics.json", _optics, read_optics),
    "marks of label": _single("marks.csv", _marks, lambda path: read_marks(path, 8)),
    "pickle": _single("values.pkl", _pickled, load_pickle),
    "points": _single("cloud.npy", lambda path: np.save(path, np.zeros((20, 3))), load_points),
    "mesh": _single("ball.stl", _ball, lambda path: load_mesh(path, None)),
}


def _bytes(rng: np.random.Generator, raw: bytearray) -> str:
    """Changes bytes; returns how."""
    how = int(rng.integers(0, 6))
    place = int(rng.integers(0, max(len(raw), 1)))
    if how == 0:
        for _ in range(int(rng.integers(1, 8))):
            at = int(rng.integers(0, max(len(raw), 1)))
            raw[at : at + 1] = rng.bytes(1)
        return "bytes changed"
    if how == 1:
        del raw[place:]
        return f"cut at {place}"
    if how == 2:
        raw[place : place + 64] = bytes(len(raw[place : place + 64]))
        return f"zeros at {place}"
    if how == 3:
        raw[place : place + int(rng.integers(1, 16))] = rng.bytes(int(rng.integers(0, 16)))
        return f"other length at {place}"
    if how == 4:
        raw[place : place + 8] = rng.choice([b"\xff" * 8, b"\x7f" + b"\xff" * 7, bytes(8)])
        return f"8 bytes at {place}"
    raw[place:place] = raw[place : place + 512]
    return f"512 bytes twice at {place}"


def _text(rng: np.random.Generator, path: Path) -> str:
    """Changes the structure of a text file; returns how."""
    text = path.read_text("utf-8")
    try:
        plain = json.loads(text)
    except ValueError:
        plain = None
    if isinstance(plain, dict | list) and plain:
        changes = list(bent(plain))
        how, value = changes[int(rng.integers(0, len(changes)))]
        path.write_text(json.dumps(value))
        return str(how)
    lines = text.split("\n")
    row = int(rng.integers(0, len(lines)))
    cells = lines[row].split(",")
    cell = int(rng.integers(0, len(cells)))
    other = ["", "nan", "inf", "-1", "1e999", "9" * 400, "x" * 10**6, "\x00", "[[[", "{a: &a [*a]}"]
    other += ["!!python/object:os.system", "1_0", "٣", "\ud800".encode("utf-8", "replace").decode()]
    how = int(rng.integers(0, 4))
    if how == 0:
        cells[cell] = str(rng.choice(other))
    elif how == 1:
        del cells[cell]
    elif how == 2:
        cells = cells * 300
    lines[row : row + 1] = [",".join(cells)] if how < 3 else []
    path.write_text("\n".join(lines))
    return f"line {row + 1}, change {how}"


def _file(rng: np.random.Generator, path: Path, root: Path) -> str:
    """Puts something else in place of a file; returns what."""
    others = sorted(one for one in root.rglob("*") if one.is_file() and one != path)
    how = int(rng.integers(0, 10))
    if how == 7 and not others:
        how = 0
    raw = path.read_bytes()
    path.unlink()
    if how == 0:
        return "missing"
    if how == 1:
        path.mkdir()
        return "a folder"
    if how == 2:
        os.mkfifo(path)
        return "a pipe"
    if how == 3:
        path.symlink_to(path.name)
        return "a link to itself"
    if how == 4:
        path.write_bytes(b"")
        return "empty"
    if how == 5:
        with path.open("wb") as file:
            file.write(raw)
            file.truncate(3 * 10**9)
        return "3 GB of nothing at its end"
    if how == 6:
        path.symlink_to("/dev/zero")
        return "a link to /dev/zero"
    if how == 7:
        path.write_bytes(others[int(rng.integers(0, len(others)))].read_bytes())
        return "another file of the set"
    if how == 8:
        path.write_text("version https://git-lfs.github.com/spec/v1\noid sha256:00\nsize 12\n")
        return "a pointer"
    path.write_bytes(rng.bytes(int(rng.integers(1, 3000))))
    return "random bytes"


def mutate(rng: np.random.Generator, root: Path) -> str:
    """Damages one file of a folder; returns which and how."""
    files = sorted(one for one in root.rglob("*") if one.is_file())
    texts = [one for one in files if _is_text(one)]
    how = rng.random()
    if how < 0.35 and texts:
        path = texts[int(rng.integers(0, len(texts)))]
        said = _text(rng, path)
    else:
        path = files[int(rng.integers(0, len(files)))]
        if how > 0.8:
            said = _file(rng, path, root)
        else:
            raw = bytearray(path.read_bytes())
            said = _bytes(rng, raw)
            path.write_bytes(raw)
    return f"{path.relative_to(root)}: {said}"


#: Files of an ending that are tried until one is read.
_TRIED = 8
#: What takes the place of a file, and how.
INSTEAD = (
    "nothing", "16 random bytes", "1,000 random bytes", "100,000 random bytes", "its first half",
    "a folder", "a pipe",
)  # fmt: skip


def put_instead(path: Path, what: str) -> None:
    """Puts one of `INSTEAD` in the place of a file."""
    raw = path.read_bytes()
    path.unlink()
    if what == "a folder":
        path.mkdir()
    elif what == "a pipe":
        os.mkfifo(path)
    elif what == "its first half":
        path.write_bytes(raw[: len(raw) // 2])
    elif what == "nothing":
        path.write_bytes(b"")
    else:
        count = int(what.split()[0].replace(",", ""))
        path.write_bytes(np.random.default_rng(count).bytes(count))


def instead(name: str) -> Iterator[tuple[str, str, dict[str, Any]]]:
    """Replaces a file of each ending of a format in turn; yields as `mutants` does."""
    kind = KINDS[name]
    with tempfile.TemporaryDirectory() as held:
        good, whole = _good(kind, name, Path(held))
        files = sorted(one for one in good.rglob("*") if one.is_file() and one.name[0] != ".")
        # the last of each ending that is read: the first is often the background
        for ending in dict.fromkeys(one.suffix or one.name for one in files):
            same = [one for one in files if (one.suffix or one.name) == ending][::-1]
            tried = same[:: max(1, len(same) // _TRIED)]
            path = next((one for one in tried if _is_read(kind, one, whole)), None)
            if path is None:
                continue
            for number, what in enumerate(INSTEAD):
                root = Path(held) / f"m{number}"
                shutil.copytree(good, root, symlinks=True)
                put_instead(root / path.relative_to(good), what)
                out = read_apart(kind, root, PIPE if what == "a pipe" else WALL)
                yield f"{path.relative_to(good)}: {what}", outcome(out, whole), out
                shutil.rmtree(root)


def _is_read(kind: Kind, path: Path, whole: dict[str, Any]) -> bool:
    """Whether an empty file changes the reading of a folder."""
    good = path.parent
    raw = path.read_bytes()
    while good.name != "good":
        good = good.parent
    path.write_bytes(b"")
    try:
        return outcome(read_apart(kind, good), whole) != "equal"
    finally:
        path.write_bytes(raw)


def _good(kind: Kind, name: str, held: Path) -> tuple[Path, dict[str, Any]]:
    """A whole folder of a format, and its readings."""
    good = held / "good"
    good.mkdir()
    try:
        kind.make(good)
    except Skipped as error:
        raise SystemExit(f"{name}: {error}") from error
    kind.read(good)  # imports
    lerobot_sets.parquet_files.forget()
    whole = read_apart(kind, good)
    if whole["state"] != "read":
        raise SystemExit(f"{name}: the whole file is not read: {whole}")
    return good, whole


def _is_text(path: Path) -> bool:
    try:
        return path.stat().st_size < 10**6 and "\x00" not in path.read_text("utf-8")
    except UnicodeDecodeError:
        return False


def _peak() -> float:
    return memory_mb("VmHWM")


def read_apart(kind: Kind, root: Path, wall: float = WALL) -> dict[str, Any]:
    """Reads a folder in a process of its own.

    Returns:
        ``state`` (read, refused, nameless, traceback, hang), ``digest``, ``said``, ``mb`` (its
        peak) and ``error``.
    """
    ends = os.pipe()
    child = os.fork()
    if not child:
        os.close(ends[0])
        quiet = os.open(os.devnull, os.O_RDWR)
        for number in (0, 1, 2):
            os.dup2(quiet, number)
        Path("/proc/self/clear_refs").write_text("5")  # the peak starts here
        space = memory_mb("VmSize") * 2**20 + 4 * 2**30
        resource.setrlimit(resource.RLIMIT_AS, (int(space), int(space)))
        out: dict[str, Any] = {"state": "read", "digest": "", "said": [], "error": ""}
        try:
            out["digest"], out["said"] = kind.read(root)
        except TactileForgeError as error:
            state = "refused" if root.name in str(error) else "nameless"
            out |= {"state": state, "error": str(error)[:300]}
        except BaseException:
            out |= {"state": "traceback", "error": traceback.format_exc()[-1500:]}
        out["mb"] = _peak()
        with os.fdopen(ends[1], "wb") as pipe:
            pickle.dump(out, pipe)
        os._exit(0)
    os.close(ends[1])
    os.set_blocking(ends[0], False)
    begun, raw, state = time.monotonic(), b"", ""
    tick = os.sysconf("SC_CLK_TCK")
    while True:
        done, status = os.waitpid(child, os.WNOHANG)
        while True:
            try:
                more = os.read(ends[0], 1 << 16)
            except BlockingIOError:
                break
            if not more:
                break
            raw += more
        if done:
            break
        try:
            used = Path(f"/proc/{child}/stat").read_text().rpartition(")")[2].split()
            cpu = (int(used[11]) + int(used[12])) / tick
        except OSError:
            cpu = 0.0
        if cpu > CPU or time.monotonic() - begun > wall:
            state = "hang"
            os.kill(child, signal.SIGKILL)
            os.waitpid(child, 0)
            break
        time.sleep(0.002)
    os.close(ends[0])
    if state:
        return {"state": state, "digest": "", "said": [], "mb": 0.0, "error": ""}
    if not raw:
        return {"state": "traceback", "digest": "", "said": [], "mb": 0.0,
                "error": f"ended by status {status}"}  # fmt: skip
    plain: dict[str, Any] = pickle.loads(raw)
    return plain


def outcome(out: dict[str, Any], whole: dict[str, Any]) -> str:
    """Outcome of a mutant, one of `OUTCOMES`."""
    if out["state"] in ("hang", "traceback"):
        return str(out["state"])
    if out["mb"] > whole["mb"] + MORE:
        return "memory"
    if out["state"] in ("refused", "nameless"):
        return str(out["state"])
    if set(out["said"]) - set(whole["said"]):
        return "counted"
    return "equal" if out["digest"] == whole["digest"] else "silent"


def mutants(
    name: str, count: int, structures: int, seed: int
) -> Iterator[tuple[str, str, dict[str, Any]]]:
    """Reads mutants of a format: the change, the verdict, and the details."""
    kind = KINDS[name]
    rng = np.random.default_rng([seed, zlib.crc32(name.encode())])
    with tempfile.TemporaryDirectory() as held:
        good, whole = _good(kind, name, Path(held))
        for number, change in enumerate(_changes(rng, good, count, structures)):
            root = Path(held) / f"m{number:05}"
            shutil.copytree(good, root, symlinks=True)
            try:
                how = change(root)
            except NOT_MADE:  # nothing in this file is of that kind
                continue
            else:
                out = read_apart(kind, root)
                words = {root.name, "udcff", *(Path(how.split(": ")[1]).with_suffix("").parts)}
                if out["state"] == "nameless" and any(one in out["error"] for one in words):
                    out["state"] = "refused"
                yield how, outcome(out, whole), out
            finally:
                shutil.rmtree(root)


def _changes(
    rng: np.random.Generator, good: Path, count: int, structures: int
) -> Iterator[Callable[[Path], str]]:
    """Changes of a folder: of structure, then of bytes."""
    applied = 0
    for path, said, change in reader_structures.changes(good, rng):
        if applied == structures:
            break
        place = path.relative_to(good)

        def structure(
            root: Path, place: Path = place, said: str = said, change: Any = change
        ) -> str:
            nonlocal applied
            change(root / place, rng)
            applied += 1
            return f"structure: {place}: {said}"

        yield structure
    for _ in range(count):
        yield lambda root: f"bytes: {mutate(rng, root)}"


def main() -> None:
    """Reads the mutants and writes their counts."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--only", default="")
    parser.add_argument("--count", type=int, default=12)
    parser.add_argument("--structures", type=int, default=30)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--show", action="store_true")
    parser.add_argument("--instead", action="store_true")
    given = parser.parse_args()
    path = RESULTS / ("reader_instead.json" if given.instead else "reader_mutants.json")
    for name in [n for n in KINDS if any(word in n for word in given.only.split(","))]:
        found = (
            instead(name)
            if given.instead
            else mutants(name, given.count, given.structures, given.seed)
        )
        row = _row(name, found, given.show)
        print(name, row, flush=True)
        # read again: other processes may write other formats
        held = json.loads(path.read_text()) if path.exists() else {}
        held[name] = row
        order = {one: held[one] for one in KINDS if one in held}
        path.write_text(json.dumps(order, indent=1) + "\n")


def _row(name: str, found: Iterator[tuple[str, str, dict[str, Any]]], show: bool) -> dict[str, Any]:
    """Counts of the outcomes of a format, and of the silent ones by the kind of change."""
    counts: Counter[str] = Counter()
    ways: dict[str, Counter[str]] = {}
    files: dict[str, None] = {}
    for how, what, out in found:
        counts[what] += 1
        way, _, rest = how.partition(": ")
        if way in ("bytes", "structure"):
            ways.setdefault(way, Counter())[what] += 1
        files[_ending(rest if way in ("bytes", "structure") else how)] = None
        if what in BAD or (show and what in ("silent", "nameless")):
            print(f"{name}: {what}: {how} ({out['mb']:.0f} MB)\n{out['error']}", flush=True)
    row: dict[str, Any] = {"mutants": sum(counts.values()), "checksum": KINDS[name].checksum}
    if not ways:
        named = sum(counts[one] for one in ("refused", "counted", "nameless"))
        row |= {"files": list(files), "named": named}
        return row | {one: counts[one] for one in ("equal", "silent", *BAD)}
    return row | {way: {one: held[one] for one in OUTCOMES} for way, held in sorted(ways.items())}


def _ending(how: str) -> str:
    """Ending, or name without one, of a file in the text of a mutant."""
    path = Path(how.partition(": ")[0])
    return path.suffix or path.name


if __name__ == "__main__":
    main()
