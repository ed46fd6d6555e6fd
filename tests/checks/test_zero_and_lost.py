"""Forces of 0 under a press, and lost pictures."""

import numpy as np

from tactileforge.checks import CheckRun
from tactileforge.checks.made import made_touch, press


def test_a_zero_force_under_a_weaker_press_is_found():
    depth = np.concatenate([press(45), 0.65 * press(45)])
    right = made_touch(depth=depth)
    assert right.force is not None
    missing = np.where((np.arange(90) < 45)[:, None], right.force, 0).astype(np.float32)
    air = np.where((np.abs(np.arange(90) - 44) > 40)[:, None], 0, right.force).astype(np.float32)
    made = [made_touch(depth=depth, force=force) for force in (right.force, air, missing)]
    found = [
        [one.words for one in CheckRun(["TF203"]).look(recording, "train", False)]
        for recording in made
    ]
    assert found == [[], [], ["force is zero for 50 % of the frames, where the gel is pressed"]]


def test_an_imprint_that_lasts_after_its_force_is_not_pressed():
    """A gel relaxes, and a camera is late, by up to a third of a second."""
    depth = np.concatenate([press(30), np.zeros(15)])
    right = made_touch(depth=depth)
    assert right.force is not None
    lifted = np.where(np.arange(45) < 20, depth, 0)[:, None] > 0.02
    for late, wanted in ((8, 0), (20, 1)):
        seen = np.maximum(depth, np.where(np.arange(45) < 20 + late, 0.9, 0) * (depth.cumsum() > 3))
        recording = made_touch(
            depth=seen, force=np.where(lifted, right.force, 0).astype(np.float32)
        )
        assert len(list(CheckRun(["TF203"]).look(recording, "train", False))) == wanted


def test_a_picture_that_is_mostly_lost_is_more_than_a_note():
    levels = []
    for share, level in (0.1, 255), (0.9, 255), (0.9, 0):
        bad = made_touch(edit=lambda frames, n=int(80 * share), to=level: frames[:, :n].fill(to))
        levels += [one.level for one in CheckRun(["TF305"]).look(bad, "train", False)]
    assert levels == ["note", "warning", "note"], "of light, not of a black border"
