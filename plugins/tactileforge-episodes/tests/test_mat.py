"""Pictures, forces and times in .mat of MATLAB 5 and 7.3, as MATLAB lays them out."""

import h5py
import numpy as np
import pytest
from made_episodes import pictures
from tactileforge_episodes.dataset import Episodes
from tactileforge_episodes.places import Place, open_place

from tactileforge.datasets import recognise
from tactileforge.errors import DataError
from tactileforge.testing import check_container

COUNT = 14


def arrays(seed):
    """Frames (H, W, 3, T), forces (T, 3) and times (T, 1)."""
    rng = np.random.default_rng(seed)
    return {
        "tactile": np.moveaxis(pictures(COUNT, 24, 32, 3, seed=seed), 0, -1),
        "force": rng.normal(0, 1, (COUNT, 3)).astype("f4"),
        "time": (np.arange(COUNT) / 25)[:, None],
    }


def mat_5(path, values):
    pytest.importorskip("scipy.io").savemat(path, values, do_compression=True)


def mat_73(path, values):
    with h5py.File(path, "w", userblock_size=512) as file:
        for name, value in values.items():
            if isinstance(value, dict):
                for field, inner in value.items():
                    file[f"{name}/{field}"] = inner.T
            else:
                file[name] = value.T
    with path.open("r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\0\2IM")


WRITERS = [mat_5, mat_73]


@pytest.mark.parametrize("is_last", [True, False])
@pytest.mark.parametrize("write", WRITERS)
def test_a_mat_a_trial(write, is_last, tmp_path):
    for trial in range(3):
        values = arrays(trial)
        if not is_last:
            values["tactile"] = np.moveaxis(values["tactile"], -1, 0)
        write(tmp_path / f"trial_{trial}.mat", values)
    name, guess = recognise(tmp_path)[0]
    assert name == "episodes"
    data = Episodes(**{**guess.options, "val": 0})
    found = list(data.recordings("train"))
    assert not data.skipped
    assert len(found) == 3
    for trial, one in enumerate(found):
        wanted = arrays(trial)
        frames = np.moveaxis(wanted["tactile"], -1, 0)
        np.testing.assert_array_equal(one.frames.read(range(COUNT)), frames)
        np.testing.assert_array_equal(one.frames.read([9, 2]), frames[[9, 2]])
        np.testing.assert_array_equal(one.force, wanted["force"])
        np.testing.assert_array_equal(one.times, wanted["time"][:, 0])


@pytest.mark.parametrize("write", WRITERS)
def test_fields_of_a_struct(write, tmp_path):
    write(tmp_path / "a.mat", {"data": arrays(1), "rate": np.array([[25.0]])})
    file = open_place(Place(str(tmp_path / "a.mat"), "", "mat"))
    assert file.keys() == ["data/force", "data/tactile", "data/time", "rate"]
    assert file.facts("data/tactile").shape == (COUNT, 24, 32, 3)
    assert file.facts("data/time").shape == (COUNT,)
    assert file.array("rate").file.read("rate", 0, 1) == 25
    failed = [one for one in check_container(file) if one.status == "failed"]
    assert not failed


@pytest.mark.parametrize("write", WRITERS)
def test_a_mat_that_is_cut_off_is_named(write, tmp_path):
    path = tmp_path / "a.mat"
    write(path, arrays(1))
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])

    def read():
        return open_place(Place(str(path), "", "mat")).read("force", 0, COUNT)

    with pytest.raises(DataError, match=r"a\.mat"):
        read()
