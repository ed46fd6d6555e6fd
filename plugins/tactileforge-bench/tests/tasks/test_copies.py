"""Copies of a recording in the training and the test part of a task."""

from dataclasses import dataclass

import numpy as np
from tactileforge_bench.tasks.splits import Split, copies_across

from tactileforge.checks import made_touch


@dataclass
class Source:
    recordings: list
    index: np.ndarray


@dataclass
class Target:
    clips: np.ndarray


@dataclass
class Task:
    target: Target
    splits: list


def task(recordings: list, *splits: tuple[list[int], list[int], list[int]]) -> tuple[Source, Task]:
    clips = np.arange(len(recordings))
    source = Source(recordings, np.stack([clips, clips], 1))
    parts = [Split(*(np.array(part, np.int64) for part in split)) for split in splits]
    return source, Task(Target(clips), parts)


def noisy(frames: np.ndarray) -> None:
    frames += np.random.default_rng(5).integers(0, 2, frames.shape, np.uint8)


def test_a_copy_that_was_encoded_again_is_told() -> None:
    copy = made_touch(0, edit=noisy, key="copy")
    touches = [made_touch(0), made_touch(1), made_touch(2), copy]
    words = copies_across(*task(touches, ([0], [1], [2, 3])))
    assert words.startswith(
        "TF501 1 test recordings are copies of ones that are trained on (made/0"
    )
    # of two folds, each trains on what the other tests
    words = copies_across(*task(touches, ([0], [1], [2, 3]), ([2], [3], [0, 1])))
    assert words.startswith("TF501 1 test recordings")


def test_other_touches_and_copies_on_one_side_are_no_leak() -> None:
    copy = made_touch(0, edit=noisy, key="copy")
    touches = [made_touch(0), copy, made_touch(2), made_touch(3)]
    assert copies_across(*task(touches, ([0], [1], [2, 3]))) == ""
    assert copies_across(*task(touches, ([2], [3], [0, 1]))) == ""
