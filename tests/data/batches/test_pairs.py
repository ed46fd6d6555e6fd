import numpy as np
import pytest

from tactileforge.data.batches.pairs import Pairs

OBJECTS = np.array([0, 0, 0, 1, 1, 2, -1, -1])
SENSORS = np.array(["a", "b", "b", "a", "b", "a", "a", "b"])
ACTIONS = np.array([0, 1, 0, 1, -1, -1, 2, -1])


def drawn(count: int, seed: int = 0) -> dict[int, list[int]]:
    """Clips of each group."""
    items = Pairs(OBJECTS, SENSORS, ACTIONS).draw(count, np.random.default_rng(seed))
    assert len(items) == 2 * count
    return {group: [clip for clip, g in items if g == group] for _, group in items}


def same_object(a: int, b: int) -> bool:
    return bool(OBJECTS[a] == OBJECTS[b] >= 0 and SENSORS[a] != SENSORS[b])


def same_action(a: int, b: int) -> bool:
    return bool(ACTIONS[a] == ACTIONS[b] >= 0)


def test_a_group_is_of_one_object_by_two_sensors_or_of_one_action_or_both_of_one_clip() -> None:
    kinds = set()
    groups = drawn(200)
    for group, clips in groups.items():
        if group < 0:  # keeps the size of the batch
            continue
        first, second, *third = clips
        assert len(third) < 2
        assert len(set(clips)) == len(clips)
        assert (same_object if group % 2 == 0 else same_action)(first, second)
        for clip in third:
            assert (same_action if group % 2 == 0 else same_object)(first, clip)
        kinds.add((first, second, *third))
    assert len(kinds) == 9


def test_a_clip_with_both_labels_serves_both() -> None:
    """In whatever group it comes first, as long as its partners are not one clip."""
    groups = [clips for group, clips in drawn(200).items() if group >= 0]
    firsts = {clips[0] for clips in groups if len(clips) == 3}
    assert firsts == {0, 1, 3}  # the only partner of 2 is of its object and of its action
    assert all(len(clips) == 2 for clips in groups if clips[0] in (2, 4, 6))


@pytest.mark.parametrize("count", range(1, 9))
def test_a_batch_has_its_size_whatever_the_groups(count: int) -> None:
    for seed in range(20):
        groups = drawn(count, seed)
        assert len(groups.get(-1, [])) <= 1
        assert count > 2 or all(len(clips) == 2 for clips in groups.values())


def test_a_draw_is_that_of_its_seed() -> None:
    assert drawn(8, 3) == drawn(8, 3) != drawn(8, 4)


@pytest.mark.parametrize(
    ("objects", "sensors", "actions"),
    [
        ([0, 0], [0, 1], [-1, -1]),  # the only object has no negative
        ([0, 1], [0, 0], [0, 1]),  # nothing is there twice
        ([-1, -1], [0, 1], [0, 0]),  # the only action has no negative
        ([-1, -1], [0, 1], [-1, -1]),  # nothing is known
    ],
)
def test_without_a_pair_and_its_negative_there_are_none(objects, sensors, actions) -> None:
    assert not Pairs(*map(np.array, (objects, sensors, actions)))
