"""Numeric touch: taxel grids, NaN outside, points with forces, depths, and videos of 16 bits."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from lerobot_recordings import all_of
from lerobot_sets import FPS, PRESSURE, ROWS, columns, made_set, place_videos, write_video
from pyarrow import parquet
from tactileforge_lerobot import parquet as parquet_files
from tactileforge_lerobot.dataset import LeRobot
from tactileforge_lerobot.deep import DeepVideo, form_of

from tactileforge.plugin import ConfigError, DataError, TaxelLayout

PAXINI, GRID = "observation.sensors.paxini_fingertip", "observation.tactile_grid"
DEPTH = "observation.depth.left"


def touch(name: str, **options: Any) -> dict[str, Any]:
    return {"touch": [name], "sensors": ["serial_array"], **options}


def made(root: Path, name: str, parts: list[np.ndarray], version: str = "v3.0") -> Path:
    numbers = {name: parts}
    return made_set(root, version, episodes=len(parts), numbers=numbers, videos={})


@pytest.mark.parametrize("version", ["v2.1", "v3.0"])
def test_a_matrix_of_pressures_is_drawn_taxel_by_taxel(tmp_path: Path, version: str) -> None:
    root = made_set(tmp_path / "set", version, videos={})
    first, second = all_of(root, **touch(PRESSURE, span=4.0))
    values = columns(1)[PRESSURE]
    assert second.key == "set/000001/pressure_matrix"
    assert second.frames.shape == (4, 4)
    shown = second.frames.read([3, 0])
    blue = np.rint(128 + (values[3] - values[0]) * 127 / 4).clip(1, 255)
    np.testing.assert_array_equal(shown[0, ..., 2], blue)
    assert (shown[..., :2] == 128).all()
    assert (shown[1] == 128).all()
    assert (second.no_contact.read([0]) == 128).all()
    np.testing.assert_array_equal(second.tracks["taxels"], values.reshape(ROWS, 16, 1))
    np.testing.assert_array_equal(second.tracks["state"], columns(1)["observation.state"])
    (still, _) = all_of(root, **touch(PRESSURE, span=4.0, background="none", rest=2.0))
    assert still.no_contact is None
    wanted = np.rint(128 + (columns(0)[PRESSURE][0] - 2) * 127 / 4).clip(1, 255)
    np.testing.assert_array_equal(still.frames.read([0])[0, ..., 2], wanted)
    assert first.sensor == "serial_array"


def test_taxels_outside_of_the_hand_are_neutral_and_stay_nan_in_the_track(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    values = rng.normal(0, 1, (ROWS, 2, 5, 4)).astype(np.float32)
    values[:, :, :2, :2] = np.nan  # no taxels there
    values[3, 1, 4, 3] = np.nan  # a value that is lost
    root = made(tmp_path / "set", GRID, [values], "v2.0")
    data = LeRobot(str(root), val=0, **touch(f"{GRID}/0", span=2.0))
    (right,) = data.recordings("train")
    assert (right.key, data.notes) == ("set/000000/tactile_grid_0", [])
    shown = right.frames.read(range(ROWS))
    assert shown.shape == (ROWS, 5, 4, 3)
    assert (shown[:, :2, :2] == 128).all()
    inner = np.rint(128 + (values[:, 0, 2:] - values[:1, 0, 2:]) * 127 / 2).clip(1, 255)
    np.testing.assert_array_equal(shown[:, 2:, :, 2], inner)
    np.testing.assert_array_equal(right.tracks["taxels"][..., 0], values[:, 0].reshape(ROWS, 20))
    data = LeRobot(str(root), val=0, **touch(f"{GRID}/1", span=2.0))
    (left,) = data.recordings("train")
    assert data.notes == ["set/000000/tactile_grid_1: 1 of 5 rows lack values of taxels, left out"]
    np.testing.assert_allclose(left.times, np.array([0, 1, 2, 4]) / FPS, atol=1e-6)
    assert np.isfinite(left.tracks["taxels"][:, 8:]).all()
    assert len(left.frames) == 4
    with pytest.raises(DataError, match=r"paxini|has the shape \[2, 5, 4\]; correct the number"):
        all_of(root, **touch(f"{GRID}/2", span=2.0))


def test_points_with_forces_are_drawn_in_colours(tmp_path: Path) -> None:
    values = np.random.default_rng(1).normal(0, 1, (ROWS, 2, 4, 3)).astype(np.float32)
    root = made(tmp_path / "set", PAXINI, [values])
    (both,) = all_of(root, **touch(PAXINI, span=[1.0, 2.0, 4.0], columns=[0, 1, 2]))
    shown = both.frames.read([2])[0]
    change = (values[2] - values[0]) * 127 / np.array([1, 2, 4])
    np.testing.assert_array_equal(shown, np.rint(128 + change).clip(1, 255))
    assert both.tracks["taxels"].shape == (ROWS, 8, 3)
    places = [[0, 0], [0, 2], [2, 0], [2, 2]]
    options = {"span": 1.0, "columns": [0, 1, 2], "grid": [3, 3], "positions": places}
    (second,) = all_of(root, **touch(f"{PAXINI}/1", **options))
    layout = TaxelLayout((3, 3), places, (0, 1, 2), 1.0)
    wanted = layout.draw(values[4, 1].astype(float), values[0, 1].astype(float))
    assert np.abs(second.frames.read([4])[0].astype(int) - wanted).max() <= 1
    (z,) = all_of(root, **touch(f"{PAXINI}/0", span=1.0, columns=[2], grid=[2, 2]))
    assert z.frames.shape == (2, 2)
    assert (z.frames.read([4])[..., :2] == 128).all()


def test_displacement_and_force_of_points(tmp_path: Path) -> None:
    values = np.random.default_rng(2).normal(0, 1, (ROWS, 6, 6)).astype(np.float32)
    root = made(tmp_path / "set", "observation.tactile", [values])
    (one,) = all_of(root, **touch("observation.tactile", span=3.0, columns=[3, 4, 5], grid=[2, 3]))
    change = (values[1] - values[0])[:, 3:] * 127 / 3
    wanted = np.rint(128 + change).clip(1, 255).reshape(2, 3, 3)
    assert np.abs(one.frames.read([1])[0].astype(int) - wanted).max() <= 1
    np.testing.assert_array_equal(one.tracks["taxels"], values)


def test_a_depth_of_many_numbers_is_a_picture_alone(tmp_path: Path) -> None:
    name = "observation.states.tactile_depth"
    values = np.random.default_rng(3).uniform(0, 1, (ROWS, 72, 64, 1)).astype(np.float32)
    root = made(tmp_path / "set", name, [values, values + 1])
    _, second = all_of(root, **touch(name, span=1.0))
    assert second.frames.shape == (72, 64)
    wanted = np.rint(128 + (values[3, ..., 0] - values[0, ..., 0]) * 127).clip(1, 255)
    shown = second.frames.read([3])[0, ..., 2]
    assert np.abs(shown.astype(int) - wanted).max() <= 1
    assert "taxels" not in second.tracks
    values[2, 5, 5] = np.nan
    root = made(tmp_path / "holes", name, [values])
    (one,) = all_of(root, **touch(name, span=1.0))
    one.frames.read([0, 1, 3])
    with pytest.raises(DataError, match=r"tactile_depth, frame 2: values that are not known"):
        one.frames.read([2])


@pytest.mark.parametrize(
    ("shape", "options", "message"),
    [
        ([4, 4], {}, "holds numbers.*give data.span"),
        ([4, 3], {"span": 1.0}, r"is its last axis x, y and z, or taxels\? Give data.columns"),
        ([8], {"span": 1.0}, r"has taxels of shape \[8\], no rows and columns: give data.grid"),
        ([2, 4, 4], {"span": 1.0}, r"or one part of it: data.touch=\[observation.tactile_grid/0\]"),
        ([4, 4], {"span": 1.0, "grid": [3, 4]}, "has 16 taxels, but data.grid has 12"),
        (
            [4, 4],
            {"span": 1.0, "grid": [9, 9], "positions": [[0, 0]]},
            "has 16 taxels, but data.positions has 1",
        ),
        ([4, 4], {"span": 1.0, "columns": [0, 1, 4]}, r"the shape \[4, 4\], but data.columns"),
        ([4, 4], {"span": 0.0}, "span=0.0: give values above 0"),
        ([4, 4], {"span": 1.0, "grid": [4]}, "give data.grid"),
    ],
)
def test_options_that_do_not_fit_are_named(
    tmp_path: Path, shape: list[int], options: dict[str, Any], message: str
) -> None:
    root = made(tmp_path / "set", GRID, [np.zeros((ROWS, *shape), np.float32)])
    with pytest.raises(ConfigError, match=message):
        all_of(root, **touch(GRID, **options))


def test_a_last_axis_of_three_may_be_taxels(tmp_path: Path) -> None:
    root = made(tmp_path / "set", GRID, [np.zeros((ROWS, 4, 3), np.float32)])
    (one,) = all_of(root, **touch(GRID, span=1.0, columns=[]))
    assert one.frames.shape == (4, 3)


def test_a_first_frame_without_values_is_named(tmp_path: Path) -> None:
    values = np.full((ROWS, 4, 4), np.nan, np.float32)
    values[1:] = 0
    data = LeRobot(str(made(tmp_path / "set", GRID, [values])), val=0, **touch(GRID, span=1.0))
    with pytest.raises(DataError, match="its first frame has no values"):
        list(data.recordings("train"))


def test_numbers_in_place_of_an_unknown_value_are_nan(tmp_path: Path) -> None:
    parts = columns(0)
    parts["observation.state"][2, 1] = 9930.0
    parts[PRESSURE][3, 0, 0] = 9930.0
    root = made_set(
        tmp_path / "set", episodes=1, numbers={n: [v] for n, v in parts.items()}, videos={}
    )
    data = LeRobot(str(root), val=0, missing=[9930.0], **touch(PRESSURE, span=1.0))
    (one,) = data.recordings("train")
    assert len(one.times) == 4
    state = one.tracks["state"]
    assert np.isnan(state[2, 1])
    assert np.isnan(state).sum() == 1
    assert "1 of 5 rows lack values" in data.notes[0]


def deep_set(root: Path, frames: np.ndarray, pix_fmt: str, form: str) -> Path:
    """A set of version 3 with two episodes in one FFV1 video; its info file says .mp4."""
    rows = len(frames) // 2
    state = np.zeros((rows, 2), np.float32)
    state[1, 0] = 9930.0
    made_set(root, "v3.0", rows=rows, numbers={"observation.state": [state] * 2}, videos={})
    path = root / f"videos/{DEPTH}/chunk-000/file-000.mov"
    write_video(path, frames, "ffv1", pix_fmt, form)
    episodes = root / "meta/episodes/chunk-000/file-000.parquet"
    about = parquet.read_table(episodes).to_pydict()
    place_videos(about, DEPTH, rows)
    import pyarrow

    parquet.write_table(pyarrow.Table.from_pydict(about), episodes)
    info = json.loads((root / "meta/info.json").read_text())
    info["features"][DEPTH] = {"dtype": "video", "shape": [24, 32, 3], "names": None}
    info["videos"] = [DEPTH]
    (root / "meta/info.json").write_text(json.dumps(info))
    parquet_files.forget()
    return root


def signal(rows: int, channels: int = 1) -> np.ndarray:
    """Numbers around 30000, 16 bits, none of whose upper bytes would show the signal."""
    rng = np.random.default_rng(rows)
    shape = (rows, 24, 32) if channels == 1 else (rows, 24, 32, channels)
    return (30000 + rng.integers(-300, 300, shape)).astype(np.uint16)


def test_a_grey_video_of_16_bits_is_read_to_the_bit(tmp_path: Path) -> None:
    frames = signal(2 * ROWS)
    root = deep_set(tmp_path / "set", frames, "gray16le", "gray16le")
    options = touch(DEPTH, span=300.0, background="none", rest=30000.0, missing=[9930.0])
    first, second = all_of(root, **options)
    assert second.frames.shape == (24, 32)
    for one, start in ((first, 0), (second, ROWS)):
        shown = one.frames.read(range(ROWS))
        wanted = np.rint(128 + (frames[start : start + ROWS] - 30000.0) * 127 / 300).clip(1, 255)
        assert np.abs(shown[..., 2] - wanted).max() <= 1
        assert (shown[..., :2] == 128).all()
        assert np.isnan(one.tracks["state"][1, 0])
    (again, _) = all_of(root, **touch(DEPTH, span=300.0))
    assert (again.frames.read([0]) == 128).all()
    assert (again.no_contact.read([0]) == 128).all()
    with pytest.raises(ConfigError, match=r"give data\.span"):
        all_of(root, **touch(DEPTH))


def test_a_colour_video_of_16_bits_has_x_y_and_z(tmp_path: Path) -> None:
    frames = signal(2 * ROWS, 3)
    root = deep_set(tmp_path / "set", frames, "gbrp16le", "rgb48le")
    first, _ = all_of(root, **touch(DEPTH, span=300.0, background="none", rest=30000.0))
    wanted = np.rint(128 + (frames[4] - 30000.0) * 127 / 300).clip(1, 255)
    assert np.abs(first.frames.read([4])[0].astype(int) - wanted).max() <= 1


def test_a_video_of_16_bits_that_was_cut_off_is_named(tmp_path: Path) -> None:
    root = deep_set(tmp_path / "set", signal(2 * ROWS), "gray16le", "gray16le")
    path = next(root.rglob("*.mov"))
    path.write_bytes(path.read_bytes()[: path.stat().st_size * 7 // 10])
    data = LeRobot(str(root), val=0, **touch(DEPTH, span=300.0))
    assert len(list(data.recordings("train"))) == 1
    assert "frames, but episode 1 needs 10; download" in data.skipped[0]


def test_frames_far_apart_are_sought(tmp_path: Path) -> None:
    frames = signal(90)
    path = tmp_path / "a.mov"
    write_video(path, frames, "ffv1", "gray16le", "gray16le")
    video = DeepVideo(path, form_of(path))
    assert (len(video), video.shape) == (90, (24, 32))
    np.testing.assert_allclose(video.times, np.arange(90) / FPS, atol=1e-3)
    for rows in ([70, 3, 3, 89], [0], [20, 21, 60], []):
        read = video.read(rows)
        np.testing.assert_array_equal(read.reshape(-1, 24, 32), frames[rows])


def test_a_damaged_video_of_16_bits_is_named(tmp_path: Path) -> None:
    path = tmp_path / "a.mov"
    write_video(path, signal(30), "ffv1", "gray16le", "gray16le")
    whole, form = path.read_bytes(), form_of(path)
    path.write_bytes(whole[: len(whole) // 2])
    assert len(DeepVideo(path, form)) < 30  # an episode that needs more of them is named
    path.write_bytes(whole[:100])
    assert form_of(path) is None
    with pytest.raises(DataError, match=r"a\.mov: its packets cannot be decoded"):
        DeepVideo(path, form)
    path.write_bytes(whole)
    video = DeepVideo(path, form)
    bent = bytearray(whole)
    bent[len(whole) // 3 : len(whole) // 2] = bytes(len(whole) // 2 - len(whole) // 3)
    path.write_bytes(bent)
    with pytest.raises(DataError, match=r"a\.mov"):
        video.read(range(30))
    path.unlink()
    with pytest.raises(DataError, match=r"a\.mov"):
        video.read([0])
    assert form_of(path) is None


def test_an_ordinary_video_is_none_of_16_bits(tmp_path: Path) -> None:
    path = tmp_path / "a.mp4"
    write_video(path, np.zeros((4, 24, 32, 3), np.uint8), "mpeg4", "yuv420p", "rgb24")
    assert form_of(path) is None
