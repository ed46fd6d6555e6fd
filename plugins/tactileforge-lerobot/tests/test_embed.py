"""Vectors of a frozen encoder as LeRobot's observation.environment_state."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from lerobot_recordings import all_of, demonstration, touch
from tactileforge_lerobot import folder
from tactileforge_lerobot.embed import EmbedOptions, TouchVectors, held_clips
from tactileforge_lerobot.episode import episode
from tactileforge_lerobot.options import LeRobotOptions
from tactileforge_lerobot.parquet import read_parquet
from tactileforge_lerobot.write import write_dataset

import tactileforge
from tactileforge import cli
from tactileforge.data.frames.cut import clip_rows
from tactileforge.plugin import ConfigError, DataError

#: The pictures are made, one grey each.
pytestmark = pytest.mark.filterwarnings("ignore:clips. in .* the light has changed")


@pytest.mark.parametrize("rate", [6.0, 15.0, 18.0, 30.0, 60.0])
def test_clips_are_those_of_a_stream_and_begin_with_the_first_frame_held(rate: float) -> None:
    rng = np.random.default_rng(int(rate))
    times = 3 + np.arange(40) / rate + rng.uniform(-0.2, 0.2, 40) / rate
    clips = held_clips(times, range(40), 4, 1 / 15)
    assert clips[0].tolist() == [0, 0, 0, 0]
    assert (np.diff(clips, axis=1) >= 0).all()
    assert clips[:, -1].tolist() == list(range(40))
    period = float(np.median(np.diff(times)))
    cut = [clip_rows(times[: end + 1], 4, 1 / 15, period) for end in range(40)]
    full = [end for end, rows in enumerate(cut) if rows is not None]
    assert len(full) > 20
    for end in full:
        assert clips[end].tolist() == cut[end]
    assert held_clips(times, [5], 1, 0.0).tolist() == [[5]]
    assert held_clips(times[:1], [0], 4, 0.1).tolist() == [[0, 0, 0, 0]]


#: Demonstrations have 6 frames a second, the model was trained on 15.
SLOW = pytest.mark.filterwarnings("ignore:frames come every")


@pytest.fixture(scope="module")
def model():
    with pytest.warns(UserWarning, match="interpolated"):
        return tactileforge.load("anytouch2.tiny", image_size=32)


@pytest.mark.slow
@SLOW
def test_vectors_are_those_of_the_model_whatever_the_batch(model) -> None:
    """Computed by hand: the clip of row 9, at 6 frames a second, holds the frames 6, 7, 8, 9."""
    left, right = demonstration(0)
    shown = episode([right, left], 6)
    options = EmbedOptions(batch_size=5)
    pooled = TouchVectors(model, "anytouch2.tiny", options)(shown)
    frames = np.stack([part.frames.read([6, 7, 8, 9]) for part in (left, right)])
    stills = np.stack([part.background() for part in (left, right)])
    tokens = model.features(frames, stills, ["digit", "digit"], tap="tokens")
    by_hand = tokens[:, model.encoder.prefix :].mean(1).reshape(-1).numpy()
    assert pooled.shape == (24, 2 * model.encoder.width)
    np.testing.assert_allclose(pooled[9], by_hand, atol=1e-5)
    projected = TouchVectors(model, "", replace(options, vector="projected"))(shown)
    wanted = model.features(frames, stills, "digit", tap="projected").reshape(-1).numpy()
    np.testing.assert_allclose(projected[9], wanted, atol=1e-5)
    cls = TouchVectors(model, "", replace(options, vector="cls"))(shown)
    np.testing.assert_allclose(cls[9], tokens[:, 0].reshape(-1).numpy(), atol=1e-5)


@pytest.mark.slow
@SLOW
def test_other_devices_are_named(model) -> None:
    vectors = TouchVectors(model, "m", EmbedOptions())
    left, right = demonstration(0)
    vectors(episode([left, right], 6))
    with pytest.raises(DataError, match=r"chip_00000/left: vectors of left, but .* left, right"):
        vectors(episode([left], 6))
    stranger = replace(left, sensor="nosuch")
    with pytest.raises(ConfigError, match="nosuch"):
        TouchVectors(model, "m", EmbedOptions())(episode([stranger], 6))
    for wrong in ({"vector": "patch"}, {"unknown_sensor": "any"}, {"batch_size": 0}):
        with pytest.raises(ConfigError, match=next(iter(wrong))):
            EmbedOptions(**wrong)


@pytest.mark.slow
def test_the_verb_writes_what_lerobots_policies_read(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Camera, state, action and vectors; touch frames are left out, as their shape differs."""
    demos = [part for number in range(2) for part in demonstration(number)]
    write_dataset(demos, tmp_path / "demos", LeRobotOptions(images="png"))
    words = ["data=lerobot", f"data.root={tmp_path / 'demos'}", "data.val=0"]
    words += ["model=anytouch2.tiny", "threads=1", f"out={tmp_path / 'out'}"]
    with pytest.warns(UserWarning, match="0.167 s, and the model was trained on frames 0.0667"):
        assert cli.run(["data", "embed", *words]) == 0
    width = tactileforge.load("anytouch2.tiny").encoder.width
    megabytes = 2 * width * 48 * 4 / 1e6
    out = capsys.readouterr().out
    assert f"{2 * width} numbers a row (left + right), {megabytes:.2f} MB" in out
    assert cli.run(["data", "embed", *words]) == 1
    assert "exists: give another out=" in capsys.readouterr().err
    info = json.loads((tmp_path / "out/meta/info.json").read_text())
    pictures = [name for name in info["features"] if "images" in name]
    assert pictures == ["observation.images.camera"]
    assert info["features"][folder.ENVIRONMENT] == {
        "dtype": "float32",
        "shape": [2 * width],
        "names": None,
    }
    table = read_parquet(tmp_path / "out/data/chunk-000/file-000.parquet").to_pydict()
    assert np.shape(table["action"]) == (48, 4)
    assert np.shape(table[folder.ENVIRONMENT]) == (48, 2 * width)
    assert torch.tensor(table[folder.ENVIRONMENT]).std(0).min() > 0
    stored = json.loads((tmp_path / "out" / folder.TOUCH).read_text())["vectors"]
    assert (stored["model"], stored["vector"]) == ("anytouch2.tiny", "pooled")
    assert stored["devices"] == ["left", "right"]
    with pytest.raises(ConfigError, match="written without frames of touch"):
        all_of(tmp_path / "out")


def test_recordings_without_a_background_have_nothing_subtracted(model) -> None:
    part = replace(touch(0), no_contact=None)
    vectors = TouchVectors(model, "m", EmbedOptions(vector="projected"))(episode([part], 30))
    frames = part.frames.read([1, 3, 5, 7])
    wanted = model.features(frames, "none", "digit", tap="projected").numpy()
    np.testing.assert_allclose(vectors[7], wanted, atol=1e-5)
