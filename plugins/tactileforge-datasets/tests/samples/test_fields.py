"""Every key of a layout of samples, and every kind of part, read back from made tars."""

import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from made_samples import FRAMES, SHAPE, made_set, part, picture, video, write_tar
from tactileforge_datasets.webdataset import WebDataset

from tactileforge.contracts import ACTIONS, Recording

STILL = {"touch": "jpg", "sensor": "digit", "background": "none"}


def read(root: Path, layout: dict[str, Any], **options: Any) -> list[Recording]:
    data = WebDataset(str(root), layout, **{"val": 0, **options})
    found = list(data.recordings("train"))
    assert data.skipped == []
    return found


def levels(recording: Recording) -> list[float]:
    frames = recording.frames.read(range(len(recording.frames)))
    return [round(float(level), -1) for level in frames[:, -4:, -4:].mean(axis=(1, 2, 3))]


def one(tmp_path: Path, parts: dict[str, Any], layout: dict[str, Any]) -> Recording:
    write_tar(tmp_path / "a.tar", [("x", parts)])
    (found,) = read(tmp_path, {**STILL, **layout})
    assert found.key == "a/x"
    assert pickle.loads(pickle.dumps(found)).frames.read([0]).shape == (1, *found.frames.shape, 3)
    return found


def test_samples_that_are_frames_of_clips(tmp_path: Path) -> None:
    found = read(made_set(tmp_path), FRAMES)
    assert len(found) == 12
    first = found[0]
    assert (first.key, first.sensor, first.object) == ("part-000/mug/ep00", "digit", "mug")
    assert (first.text, first.licence, first.tier) == ("touching a mug", "CC0-1.0", 5)
    assert first.frames.shape == SHAPE
    assert levels(first) == [10 * i + 40 for i in range(12)]
    np.testing.assert_allclose(first.times, np.arange(12) * 0.04)
    np.testing.assert_allclose(first.force, [[0.1, -0.2, i / 2] for i in range(12)], rtol=1e-6)
    assert first.action is not None
    assert first.action[6] == ACTIONS.index("press")
    background = first.background()
    assert background is not None
    assert abs(float(background[-4:, -4:].mean()) - 45) < 2


def test_frames_are_in_the_order_of_their_numbers_and_holes_are_holes(tmp_path: Path) -> None:
    samples = [(f"ep_{n}", {"png": picture(10 * n)}) for n in (10, 2, 9, 4)]
    write_tar(tmp_path / "a.tar", samples)
    layout = {**STILL, "touch": "png", "samples": "{clip}_{frame}", "fps": 10}
    (found,) = read(tmp_path, layout)
    assert levels(found) == [20, 40, 90, 100]
    np.testing.assert_allclose(found.times, [0, 0.2, 0.7, 0.8])


@pytest.mark.parametrize("kind", ["jpg", "png", "webp", "npy"])
def test_a_sample_is_a_touch(tmp_path: Path, kind: str) -> None:
    found = one(tmp_path, {kind: picture(90)}, {"touch": kind})
    assert levels(found) == [90]
    assert (len(found.times), found.no_contact, found.action) == (1, None, None)


def test_clips_of_arrays_videos_and_numbered_pictures(tmp_path: Path) -> None:
    values = [30, 60, 90, 120]
    clip = np.stack([picture(level) for level in values])
    found = one(tmp_path / "a", {"npy": clip}, {"touch": "npy", "fps": 10})
    assert levels(found) == values
    np.testing.assert_array_equal(found.frames.read([3, 0]), clip[[3, 0]])
    np.testing.assert_allclose(found.times, [0, 0.1, 0.2, 0.3])
    numbered = {f"touch.{i}.png": picture(10 * i) for i in (2, 10, 9)}
    layout = {"touch": "touch.{frame}.png", "fps": 10}
    assert levels(one(tmp_path / "b", numbered, layout)) == [20, 90, 100]
    filmed = {"mp4": video(tmp_path / "v.mp4", values), "txt": "a bolt"}
    found = one(tmp_path / "c", filmed, {"touch": "mp4", "text": "{txt}"})
    assert np.abs(np.array(levels(found)) - values).max() <= 10
    np.testing.assert_allclose(found.times, np.arange(4) / 20, atol=1e-3)
    found = one(tmp_path / "d", filmed, {"touch": "mp4", "fps": 5})
    np.testing.assert_allclose(found.times, np.arange(4) / 5)


def test_arrays_a_frame(tmp_path: Path) -> None:
    samples = [(f"ep_{n}", {"npy": picture(20 * n)}) for n in range(1, 5)]
    write_tar(tmp_path / "a.tar", samples)
    layout = {**STILL, "touch": "npy", "samples": "{clip}_{frame}", "fps": 10}
    (found,) = read(tmp_path, layout)
    assert levels(found) == [20, 40, 60, 80]


def test_values_of_a_clip(tmp_path: Path) -> None:
    count = 5
    force = np.arange(3 * count, dtype=np.float64).reshape(count, 3)
    parts = {
        "touch.npy": np.stack([picture(20 * i) for i in range(count)]),
        "force.npy": force,
        "meta.json": {
            "clock": [100.0, 100.1, 100.2, 100.4, 100.5],
            "sensor": "gelsight_mini",
            "robot": {"pose": [[i, None] for i in range(count)]},
            "scene": [{"name": "mug"}],
            "temperature": 21.5,
            "act": "press",
            "empty": None,
        },
        "cls": "3\n",
        "txt": " pressed hard ",
        "cam.jpg": picture(50, (16, 16)),
        "bg.png": picture(7),
    }
    layout = {
        "touch": "touch.npy",
        "sensor": "{meta.json:sensor}",
        "background": {"file": "bg.png"},
        "times": {"values": "meta.json:clock"},
        "force": {"values": "force.npy", "columns": [1, None, 0], "unit": "mN", "sign": [1, 1, -1]},
        "action": "{meta.json:act}",
        "object": "{meta.json:scene.0.name}",
        "text": ["{txt}", "{meta.json:empty}", "of {cls}"],
        "words": {"cls": {3: "steel"}},
        "camera": "cam.jpg",
        "tracks": {"pose": "meta.json:robot.pose", "slip": "slip.npy?"},
        "labels": {"temperature": "{meta.json:temperature}", "from": "{tar}"},
        "source": "a lab",
        "tier": 2,
    }
    found = one(tmp_path, parts, layout)
    assert (found.sensor, found.object, found.source, found.tier) == (
        *("gelsight_mini", "mug", "a lab"),
        2,
    )
    assert found.text == "pressed hard, of steel"
    np.testing.assert_allclose(found.times, [0, 0.1, 0.2, 0.4, 0.5], atol=1e-9)
    assert found.force is not None
    np.testing.assert_allclose(found.force[:, 0], force[:, 1] / 1000, rtol=1e-6)
    assert np.isnan(found.force[:, 1]).all()
    np.testing.assert_allclose(found.force[:, 2], -force[:, 0] / 1000, rtol=1e-6)
    assert found.action is not None
    assert set(found.action) == {ACTIONS.index("press")}
    assert found.image is not None
    assert found.image.shape == (16, 16)
    assert found.labels == {"temperature": 21.5, "from": "a"}
    np.testing.assert_array_equal(found.tracks["pose"][:, 0], range(count))
    assert np.isnan(found.tracks["pose"][:, 1]).all()
    assert np.isnan(found.tracks["slip"]).all()
    np.testing.assert_array_equal(found.background(), picture(7))


def test_axes_of_force_in_places_of_their_own(tmp_path: Path) -> None:
    said = {"fx": 100, "fz": 2}
    layout = {"force": {"values": ["json:fx", None, "json:fz"], "unit": "gf"}, "action": "none"}
    found = one(tmp_path, {"jpg": picture(9), "json": said}, layout)
    assert found.force is not None
    np.testing.assert_allclose(found.force[0, [0, 2]], [0.980665, 0.0196133], rtol=1e-6)
    assert np.isnan(found.force[0, 1])
    assert found.action is None


def test_colours_and_turns(tmp_path: Path) -> None:
    raw = {"png": picture(60)[..., ::-1]}
    layout = {"touch": "png", "channels": "bgr", "rotate": 90, "background": {"first": 1}}
    found = one(tmp_path, raw, layout)
    shown = found.frames.read([0])[0]
    np.testing.assert_array_equal(shown, np.rot90(picture(60), -1))
    np.testing.assert_array_equal(found.background(), shown)


def test_actions_and_cameras_a_frame(tmp_path: Path) -> None:
    names = ["press", "press", None, "leave"]
    samples = [
        (f"ep_{i}", {"jpg": picture(9), "cam.jpg": picture(20 * i), "json": {"do": name}})
        for i, name in enumerate(names)
    ]
    write_tar(tmp_path / "a.tar", samples)
    layout = {**STILL, "samples": "{clip}_{frame}", "fps": 10}
    layout |= {"action": "{json:do}", "camera": "cam.jpg"}
    (found,) = read(tmp_path, layout)
    assert found.action is not None
    assert found.action.tolist() == [0, 0, -1, 1]
    assert found.image is not None
    assert found.image_times is not None
    np.testing.assert_array_equal(found.image_times, found.times)
    assert abs(float(found.image.read([3])[0, -4:, -4:].mean()) - 60) < 2


def test_every_label_is_stated(tmp_path: Path) -> None:
    made_set(tmp_path, tars=1)
    data = WebDataset(str(tmp_path), FRAMES)
    assert data.provides == {"force", "action", "object", "text"}
    assert WebDataset(str(tmp_path), STILL).provides == frozenset()
    recording = next(iter(data.recordings("train")))
    assert data.plot(recording).axes


def test_a_key_has_the_folder_and_endings_count_in_any_case(tmp_path: Path) -> None:
    samples = [("./a/b/0001", {"JPG": part("jpg", picture(9)), "CLS": "7"})]
    write_tar(tmp_path / "t.tar", samples)
    layout = {**STILL, "object": "{folder} {cls}", "text": "{key}"}
    (found,) = read(tmp_path, layout)
    assert (found.key, found.object, found.text) == ("t/a/b/0001", "a/b 7", "a/b/0001")
