"""Any data set as zarr in the format of FTP-1: read back to the bit, here and by zarr alone."""

from dataclasses import replace

import numpy as np
import pytest
import zarr
from tactileforge_episodes.dataset import Episodes
from tactileforge_episodes.zarr_writer import write_zarr

from tactileforge import cli
from tactileforge.contracts import FrameSubset, Recording
from tactileforge.data import ArrayFrames
from tactileforge.datasets import recognise
from tactileforge.errors import ConfigError, DataError
from tactileforge.testing import check


def recording(name, seed, count=37, sensor="gelsight_mini", size=(12, 16)):
    rng = np.random.default_rng(seed)
    frames = ArrayFrames(rng.integers(0, 256, (count, *size, 3), np.uint8))
    force = rng.normal(0, 1, (count, 3)).astype(np.float32)
    force[:, 2] += 3
    times = 5 + np.cumsum(rng.uniform(0.01, 0.05, count))
    text = "touching a mug"
    return Recording(
        key=name,
        sensor=sensor,
        frames=frames,
        times=times,
        no_contact=FrameSubset(frames, [0]),
        force=force,
        text=text,
        licence="CC0-1.0",
    )


def with_camera(one):
    views = np.random.default_rng(9).integers(0, 256, (11, 8, 8, 3), np.uint8)
    times = np.linspace(one.times[0], one.times[-1], 11)
    return replace(one, image=ArrayFrames(views), image_times=times)


def test_recordings_are_read_back_with_no_key_typed(tmp_path):
    made = [recording("a", 1), recording("b", 2, count=5), recording("c", 3, count=40)]
    written = write_zarr(made, tmp_path / "set")
    assert written == {"gelsight_mini_16x12_force.zarr": (3, 82)}
    name, guess = recognise(tmp_path / "set")[0]
    assert (name, guess.options["preset"]) == ("episodes", "open_x_tactile")
    data = Episodes(**{**guess.options, "val": 0})
    found = list(data.recordings("train"))
    assert not data.skipped
    assert len(found) == 3
    for one, wanted in zip(found, made, strict=True):
        every = range(len(wanted.frames))
        np.testing.assert_array_equal(one.frames.read(every), wanted.frames.read(every))
        np.testing.assert_array_equal(one.force, wanted.force)
        np.testing.assert_allclose(one.times, wanted.times - wanted.times[0], atol=1e-12)
        assert (one.sensor, one.text) == ("gelsight_mini", "touching a mug")


def test_zarr_alone_finds_the_arrays_of_the_format(tmp_path):
    made = [with_camera(recording("a", 1)), with_camera(recording("b", 2))]
    write_zarr(made, tmp_path / "set", side="left")
    (path,) = (tmp_path / "set").iterdir()
    group = zarr.open_group(str(path), mode="r")
    assert group.metadata.zarr_format == 2
    assert group["meta/episode_ends"][:].tolist() == [37, 74]
    names = {"data", "area", "sensor", "type"}
    assert {f"left_tactile_{name}_gripper" for name in names} <= {*group["data"].keys()}
    touch = group["data/left_tactile_data_gripper"]
    assert touch.shape == (74, 1, 12, 16, 3)
    np.testing.assert_array_equal(touch[37:, 0], made[1].frames.read(range(37)))
    np.testing.assert_array_equal(group["data/left_tactile_data_force"][:37, 0], made[0].force)
    assert set(group["data/left_tactile_type_gripper"][:]) == {"image"}
    assert set(group["data/left_tactile_sensor_gripper"][:]) == {"GelSightMini"}
    nearest = np.abs(made[0].image_times - made[0].times[:, None]).argmin(1)
    views = made[0].image.read(nearest.tolist())
    np.testing.assert_array_equal(group["data/camera_main_rgb"][:37], views)


def test_sensors_and_sizes_have_groups_of_their_own(tmp_path):
    made = [recording("a", 1), recording("b", 2, sensor="digit", size=(16, 12))]
    made.append(replace(recording("c", 3), force=None))
    written = write_zarr(made, tmp_path / "set")
    assert written == {
        "gelsight_mini_16x12_force.zarr": (1, 37),
        "digit_12x16_force.zarr": (1, 37),
        "gelsight_mini_16x12.zarr": (1, 37),
    }
    data = Episodes(str(tmp_path / "set"), val=0)
    found = {one.sensor: one for one in data.recordings("train")}
    np.testing.assert_array_equal(found["digit"].force, made[1].force)


def test_nothing_is_overwritten_or_empty(tmp_path):
    write_zarr([recording("a", 1)], tmp_path / "set")
    with pytest.raises(ConfigError, match=r"set exists: give another out="):
        write_zarr([recording("a", 1)], tmp_path / "set")
    with pytest.raises(DataError, match="no recordings to write"):
        write_zarr([], tmp_path / "other")
    with pytest.raises(ConfigError, match="unknown side 'top'"):
        write_zarr([], tmp_path / "other", side="top")
    assert not (tmp_path / "other").exists()


def test_the_verb_conforms():
    assert {one.status for one in check("verb", "data.zarr")} == {"ran"}


@pytest.mark.slow
def test_the_command_writes_a_set_that_is_recognised(tmp_path, capsys):
    words = ["data", "zarr", "data=sim", "data.scenes=2", "data.val=1", "data.size=32"]
    assert cli.run([*words, f"out={tmp_path / 'set'}"]) == 0
    assert "data=open_x_tactile data.root=" in capsys.readouterr().out
    assert recognise(tmp_path / "set")[0][0] == "episodes"
