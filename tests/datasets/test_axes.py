"""Every reader of force gives newton, with x right, y down and z into the gel."""

import inspect
import io
import json
import pickle
import tarfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tactileforge_arrays.dataset import SimArray
from tactileforge_datasets.sparsh_force import SparshForce
from tactileforge_datasets.sparsh_slip import SparshSlip
from tactileforge_datasets.touchd_force import TouchdForce
from tactileforge_datasets.webdataset import WebDataset
from tactileforge_sim.dataset import Sim
from tactileforge_sim.generate import path_of

from tactileforge.contracts import ACTIONS, Dataset, Recording
from tactileforge.datasets.recordings import Recordings
from tactileforge.datasets.shards import Shards
from tactileforge.plugin import encode_image
from tactileforge.plugins import registry

Make = Callable[..., Any]
PAGE = Path(__file__).parents[2] / "docs/datasets.md"


def simulated(motion: str) -> Sim:
    return Sim(scenes=1, val=0, sensors=("digit",), motions=motion, size=48, processes=1)


@pytest.fixture
def touchd_force(tmp_path: Path, make_images: Make, write: Make) -> Dataset:
    """A session with negative Fz when pressing, as in the published index."""
    rows = [[i, 0.1, 0.2, -0.5 * i] for i in range(2, 12)]
    index = {"obj030_speed1": {name: rows for name in ("digit", "gelsight", "duragel")}}
    write("all_data_direction.json", json.dumps(index))
    for name in ("digit", "gelsight", "duragel"):
        make_images(f"obj030_speed1/{name}/image_{{}}.png", range(1, 12))
    return TouchdForce(str(tmp_path), "all", val=0)


@pytest.fixture
def sparsh(tmp_path: Path, encoded: Make) -> Path:
    """Batches of both signs of Fz: the sign of a batch is not published."""
    for number, sign in ((1, 1), (2, -1)):
        folder = tmp_path / f"sphere/batch_{number}"
        folder.mkdir(parents=True)
        images = [encoded(i) for i in range(10)]
        (folder / "dataset_digit_00.pkl").write_bytes(pickle.dumps(images))
        trajectory = {
            "indexes": np.arange(2, 10),
            "forces": np.linspace([0, 0, 0], [0.3, -0.2, 2.0 * sign], 8),
            "slip_label": np.zeros(8, int),
        }
        labels = {"in_contact": [0, 0] + [1] * 8, "trajectories": {0: trajectory}}
        (folder / "dataset_slip_forces.pkl").write_bytes(pickle.dumps(labels))
    return tmp_path


@pytest.fixture
def recordings(make_video: Make, write: Make) -> Dataset:
    """A layout with signs from the source's axes to ours, and from millinewton to newton."""
    video = make_video("a.avi", count=10)
    write("a.csv", "fz,fx,fy\n" + "".join(f"{-500 * i},0,0\n" for i in range(10)))
    layout = {
        "videos": "*.avi",
        "sensor": "digit",
        "background": {"first": 1},
        "hold_out": "none",
        "force": {"file": "{stem}.csv", "columns": ["fx", "fy", "fz"], "sign": [1, 1, -0.001]},
    }
    return Recordings(str(video.parent), {"mine": layout})


@pytest.fixture
def shards(tmp_path: Path) -> Dataset:
    made = simulated("press")
    list(made.recordings("train"))
    (tmp_path / "train-000000.tar").write_bytes(path_of(made.folder, 0).read_bytes())
    return Shards(str(tmp_path))


@pytest.fixture
def samples(tmp_path: Path) -> Dataset:
    """A tar of pictures with forces in millinewton, negative for presses."""
    folder = tmp_path / "samples"
    folder.mkdir()
    with tarfile.open(folder / "train.tar", "w") as tar:
        for number in range(10):
            picture = encode_image(np.full((8, 8, 3), 100 + number, np.uint8))
            force = json.dumps([0, 0, -500 * number]).encode()
            for ending, content in (("jpg", picture), ("json", force)):
                info = tarfile.TarInfo(f"press_{number}.{ending}")
                info.size = len(content)
                tar.addfile(info, io.BytesIO(content))
    layout = {
        "touch": "jpg",
        "sensor": "digit",
        "background": {"first": 1},
        "samples": "{clip}_{frame}",
        "fps": 10,
        "licence": "MIT",
        "force": {"values": "json", "sign": [1, 1, -0.001]},
    }
    return WebDataset(str(folder), layout, val=0)


@pytest.fixture
def force_readers(
    touchd_force: Dataset, sparsh: Path, recordings: Dataset, shards: Dataset, samples: Dataset
) -> dict[str, Dataset]:
    return {
        "touchd_force": touchd_force,
        "sparsh_force": SparshForce(str(sparsh), split="all", val=0),
        "sparsh_slip": SparshSlip(str(sparsh), split="all", val=0),
        "recordings": recordings,
        "shards": shards,
        "sim": simulated("press"),
        "sim_array": SimArray(scenes=1, val=0),
        "webdataset": samples,
    }


def with_force(dataset: Dataset) -> Iterator[Recording]:
    return (recording for recording in dataset.recordings("train") if recording.force is not None)


@pytest.mark.slow
def test_pressing_is_positive_in_every_reader(force_readers: dict[str, Dataset]) -> None:
    for name, dataset in force_readers.items():
        recordings = list(with_force(dataset))
        assert recordings, name
        for recording in recordings:
            assert recording.force is not None
            assert recording.force.shape == (len(recording.frames), 3)
            assert recording.force[:, 2].min() >= 0, recording.key
            assert 0.5 < recording.force[:, 2].max() < 20, f"{recording.key}: newton"


def _root(made: type[Dataset]) -> dict[str, str]:
    """A folder, for readers in need of one."""
    parameter = inspect.signature(made).parameters.get("root")
    return {"root": "."} if parameter and parameter.default is parameter.empty else {}


def test_no_reader_of_forces_is_left_out(force_readers: dict[str, Dataset]) -> None:
    """A new reader has to be tested here, and named on the page."""
    passing_on = {"mixture"}  # gives what others gave
    by_layout = {"recordings", "webdataset"}
    plugins = [one for one in registry.list_plugins() if one.kind == "datasets"]
    own = {"feats", "feelanyforce", "gelsight_mini_pretrain", "unitac_nv"}  # tests of their package
    ours = ("tactileforge", "tactileforge-arrays", "tactileforge-datasets", "tactileforge-sim")
    names = {one.name for one in plugins if one.distribution in ours} - passing_on
    classes = {name: registry.get("datasets", name) for name in names}
    providing = {
        name
        for name, made in classes.items()
        if name not in by_layout | own and "force" in made(**_root(made)).provides
    }
    assert providing | by_layout == set(force_readers)
    section = PAGE.read_text().partition("## Axes and lag\n")[2].partition("\n## ")[0]
    for name in force_readers:
        assert f"| `{name}`" in section, name


@pytest.mark.parametrize(
    ("motion", "axis", "sign"),
    [("slide_right", 0, 1), ("slide_left", 0, -1), ("slide_down", 1, 1), ("slide_up", 1, -1)],
)
def test_simulated_shear_points_where_the_object_goes(motion: str, axis: int, sign: int) -> None:
    (recording,) = simulated(motion).recordings("train")
    assert recording.force is not None
    assert recording.action is not None
    sliding = recording.force[recording.action == ACTIONS.index(motion)].mean(axis=0)
    assert sign * sliding[axis] > 3 * abs(sliding[1 - axis])
