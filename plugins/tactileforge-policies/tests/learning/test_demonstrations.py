"""Demonstrations become samples; unsuitable ones raise an error with their name."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from demonstrated import SIZE, demonstrations, episode, rest, write
from tactileforge_policies.data import samples
from tactileforge_policies.data.demonstrations import Demonstrations
from tactileforge_policies.data.episodes import episodes_of
from tactileforge_policies.data.samples import Cutting, EpisodeClips
from tactileforge_policies.reference import GAIN_LABEL, with_gain

from tactileforge.data.batches.clips import collate
from tactileforge.errors import ConfigError, DataError


def clips(recordings, **options) -> EpisodeClips:
    cutting = Cutting(**{"image_size": 16, **options})
    return EpisodeClips(recordings, 4, 1 / 15, (SIZE, SIZE), cutting)


def test_a_sample_is_what_was_perceived_and_what_came_next() -> None:
    pair = episode(0, steps=6)
    cut = clips([pair[1], pair[0]], horizon=4, observations=3)
    assert len(cut) == 6
    assert (cut.robot.fingers, cut.robot.rate) == (("left", "right"), 6.0)
    left, right = pair
    row, state, action = cut[1], left.tracks["state"], left.tracks["robot_action"]
    np.testing.assert_array_equal(row["state"], state[[0, 0, 1]])
    np.testing.assert_array_equal(row["action_chunk"], action[1:5])
    assert row["action_chunk_valid"].all()
    late = cut[4]
    np.testing.assert_array_equal(late["action_chunk"], action[[4, 5, 5, 5]])
    assert late["action_chunk_valid"].tolist() == [True, True, False, False]
    for finger, recording in enumerate((left, right)):
        shown = row["frames"][finger].movedim(1, -1).numpy()
        np.testing.assert_array_equal(shown, recording.frames.read([0, 0, 0, 1]))
    batch = collate([cut[1], cut[4]])
    assert batch["frames"].shape == (4, 4, 3, SIZE, SIZE)
    assert batch["images"].shape == (2, 3, 3, 16, 16)
    np.testing.assert_array_equal(batch["frames"][2], late["frames"][0])


def test_a_robot_knows_the_tasks_of_its_demonstrations() -> None:
    wipe, chip = (
        [replace(one, labels=one.labels | {"task": task}) for one in episode(number, steps=5)]
        for number, task in enumerate(("wipe", "chip"))
    )
    plain = [
        replace(one, labels={k: v for k, v in one.labels.items() if k != "task"}) for one in wipe
    ]
    assert clips([*wipe, *chip]).robot.tasks == ("chip", "wipe")
    assert clips(plain).robot.tasks == ()


def test_touch_is_left_out_or_given_as_forces() -> None:
    pair = episode(0, steps=5)
    bare = clips(pair, touch="none", camera=False)[3]
    assert not {"frames", "tokens", "forces", "images"} & set(bare)
    forces = clips(pair, touch="force")[3]["forces"]
    np.testing.assert_array_equal(forces[1], np.concatenate([one.force[3] for one in pair]))


def with_gains(pair, left, right):
    return [
        replace(one, labels=dict(one.labels) | {GAIN_LABEL: gain})
        for one, gain in zip(pair, (left, right), strict=True)
    ]


def test_pictures_are_divided_by_the_gain_of_their_finger() -> None:
    pair = with_gains(episode(0, steps=5), 2.0, 0.5)
    plain, scaled = clips(pair), clips(pair, reference_press=True)
    assert (plain.robot.reference_press, scaled.robot.reference_press) == (False, True)
    for finger, gain in enumerate((2.0, 0.5)):
        shown = plain[4]["frames"][finger].movedim(1, -1).numpy()
        found = scaled[4]["frames"][finger].movedim(1, -1).numpy()
        np.testing.assert_array_equal(found, with_gain(shown, rest(), gain))
        assert (found != shown).any()


@pytest.mark.parametrize(
    ("gain", "message"),
    [
        (None, "follow_00000/right: no reference press .* give data.reference_press=false"),
        (0.0, "follow_00000/right: label 'reference_gain' is 0.0; give a number above 0"),
        ("much", "label 'reference_gain' is 'much'; give a number above 0"),
    ],
)
def test_a_demonstration_without_a_reference_press_is_named(gain, message) -> None:
    pair = with_gains(episode(0), 1.0, gain)
    if gain is None:
        pair[1] = replace(
            pair[1], labels={k: v for k, v in pair[1].labels.items() if k != GAIN_LABEL}
        )
    clips(pair)  # it is needed with reference_press=true alone
    with pytest.raises(DataError, match=message):
        clips(pair, reference_press=True)
    for touch in ("force", "none"):  # no pictures, no gains
        clips(pair, reference_press=True, touch=touch)


@pytest.mark.parametrize("room", [2**31, 8], ids=["in memory", "in a file"])
def test_tokens_are_computed_once_and_take_the_place_of_frames(
    room: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(samples, "_IN_MEMORY", room)
    cut = clips(episode(0, steps=5))
    asked = []

    def encode(frames, background, sensors):
        asked.append(sensors)
        return frames.float().mean((1, 3, 4))[:, None] / 256  # (n, 1, 3)

    frames = cut[2]["frames"]
    cut.remember(encode)
    cut.remember(encode)
    assert sum(map(len, asked)) == 10
    row = cut[2]
    assert "frames" not in row
    assert row["tokens"].dtype == torch.float16
    for finger in (0, 1):
        true = frames[finger].float().mean((0, 2, 3)) / 256
        torch.testing.assert_close(row["tokens"][finger, 0].float(), true, atol=1e-3, rtol=0)


def test_eight_of_fifty_are_held_out(tmp_path: Path) -> None:
    root = str(demonstrations(tmp_path, 50, steps=2, image=False))
    data = Demonstrations(root, camera=False)
    names = {
        split: {one.labels["episode"] for one in data.recordings(split)}
        for split in ("train", "val")
    }
    assert (len(names["train"]), len(names["val"])) == (42, 8)
    assert not names["train"] & names["val"]
    again = Demonstrations(root, camera=False)
    assert {one.labels["episode"] for one in again.recordings("val")} == names["val"]
    other = Demonstrations(root, camera=False, seed=1)
    assert {one.labels["episode"] for one in other.recordings("val")} != names["val"]


def test_an_episode_that_failed_is_left_out(tmp_path: Path) -> None:
    failed = [replace(one, labels=dict(one.labels) | {"success": 0.0}) for one in episode(1)]
    root = str(write(tmp_path, [*episode(0), *failed, *episode(2)]))
    data = Demonstrations(root)
    kept = [one.labels["episode"] for s in ("train", "val") for one in data.recordings(s)]
    assert sorted(set(kept)) == ["follow_00000", "follow_00002"]


def changed(one, **tracks):
    return replace(one, tracks=dict(one.tracks) | tracks)


def with_nan(values):
    values = values.copy()
    values[3, 1] = np.nan
    return values


WRONG = {
    "no commands": (
        lambda pair: [replace(one, tracks={"state": one.tracks["state"]}) for one in pair],
        r"follow_00001/left: no track 'robot_action' \(it has: state\)",
    ),
    "nan": (
        lambda pair: [changed(one, state=with_nan(one.tracks["state"])) for one in pair],
        r"follow_00001/left: track 'state': row 3 is not finite",
    ),
    "other rate": (
        lambda pair: [replace(one, times=one.times / 2) for one in pair],
        r"follow_00001: 12 commands a second, and follow_00000 has 6",
    ),
    "other size": (
        lambda pair: [changed(one, robot_action=np.zeros((12, 3), np.float32)) for one in pair],
        r"follow_00001: numbers of a command 3, and follow_00000 has 2",
    ),
    "other finger": (
        lambda pair: [replace(pair[0], labels=dict(pair[0].labels) | {"finger": "thumb"})],
        r"follow_00001: fingers \['thumb'\], and follow_00000 has \['left', 'right'\]",
    ),
    "other sensor": (
        lambda pair: [replace(one, sensor="gelsight_mini") for one in pair],
        r"follow_00001: sensors \['gelsight_mini', 'gelsight_mini'\], and follow_00000",
    ),
    "no finger": (
        lambda pair: [replace(pair[0], labels={})],
        r"follow_00001/left: no demonstration, as its labels name no episode and finger",
    ),
    "twice": (
        lambda pair: [pair[0], replace(pair[0], key="again")],
        r"again and follow_00001/left are both finger 'left' of 'follow_00001'",
    ),
    "apart": (
        lambda pair: [pair[0], replace(pair[1], times=pair[1].times + 1)],
        r"follow_00001/right: its times are not those of follow_00001/left",
    ),
    "no camera": (
        lambda pair: [replace(one, image=None, image_times=None) for one in pair],
        r"follow_00001/left: no camera image; give data.camera=false",
    ),
}


@pytest.mark.parametrize("what", WRONG)
def test_what_cannot_train_a_policy_is_named_before_training(what: str, tmp_path: Path) -> None:
    change, message = WRONG[what]
    write(tmp_path, [*episode(0), *change(episode(1))])
    with pytest.raises(DataError, match=message):
        list(Demonstrations(str(tmp_path)).recordings("train"))


def test_forces_that_are_missing_are_named() -> None:
    pair = [replace(one, force=None) for one in episode(0)]
    with pytest.raises(DataError, match=r"left: no force of every frame, and data.touch=force"):
        clips(pair, touch="force").ranges()


def test_options_that_are_none_are_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="give a share below 1, and at least one step each"):
        Demonstrations(str(tmp_path), horizon=0)
    with pytest.raises(ConfigError, match="unknown split 'test'"):
        list(Demonstrations(str(tmp_path)).recordings("test"))
    with pytest.raises(DataError, match="no demonstration; make some"):
        clips([])
    assert episodes_of([]) == []
