"""Checks left out by a recording: at every door, and no other recording."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from tactileforge.checks import CheckRun, check_labels, check_recordings, made_touch
from tactileforge.checks.doors import frame_lines
from tactileforge.checks.made import resting
from tactileforge.datasets.recordings import Recordings
from tactileforge.errors import ConfigError


def mirrored(key, **labels):
    return replace(made_touch(still=resting()[:, ::-1]), key=key, labels=labels)


@pytest.mark.parametrize("ignore", ["TF308", "TF3", "mirrored", "TF203 TF308"])
def test_a_check_of_the_set_is_left_out_for_one_recording(ignore):
    both = [mirrored("a", ignore=ignore), mirrored("b")]
    found = check_recordings(both, CheckRun(["mirrored"]))
    assert [one.where for one in found] == ["b"]
    assert not any("TF308" in line for line in frame_lines(both[:1]))
    assert any("TF308" in line for line in frame_lines(both[1:]))


def test_another_code_leaves_it_in():
    found = check_recordings([mirrored("a", ignore="TF307")], CheckRun(["mirrored"]))
    assert [one.code for one in found] == ["TF308"]


def test_checks_of_labels_are_left_out():
    pulling = replace(made_touch(force=-made_touch().force), labels={"ignore": "TF202"})
    assert "pulling_force" not in {flag.reason for flag in check_labels(pulling)}
    assert not check_recordings([pulling], CheckRun(["TF202"]))
    assert check_recordings([replace(pulling, labels={})], CheckRun(["TF202"]))


def test_a_layout_says_it(tmp_path):
    for number in range(3):
        cv2.imwrite(str(tmp_path / f"{number}.png"), np.full((32, 48, 3), 60, np.uint8))
    layout = {"images": "*.png", "each": "touch", "sensor": "digit", "background": "none"}

    def labels(ignore):
        data = Recordings(str(tmp_path), layouts={"a": {**layout, "ignore": ignore}}, val=0)
        return [one.labels.get("ignore") for one in data.recordings("train")]

    assert labels(["TF307", "TF2"]) == ["TF307 TF2"] * 3
    assert labels([]) == [None] * 3
    with pytest.raises(ConfigError, match=r"ignore has 'tf307'; give codes"):
        labels(["tf307"])
