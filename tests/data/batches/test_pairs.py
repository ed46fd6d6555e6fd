import numpy as np
import pytest

from tactileforge.data.batches.pairs import Pairs

OBJECTS = np.array([0, 0, 0, 1, 1, 2, -1, -1])
SENSORS = np.array(["a", "b", "b", "a", "b", "a", "a", "b"])
ACTIONS = np.array([0, 1, 0, 1, -1, -1, 2, -1])


def test_pairs_are_of_one_object_by_two_sensors_or_of_one_action() -> None:
    items = Pairs(OBJECTS, SENSORS, ACTIONS).draw(40, np.random.default_rng(0))
    assert len(items) == 80
    kinds = set()
    for group in range(40):
        (a, _), (b, _) = pair = [item for item in items if item[1] == group]
        assert len(pair) == 2
        assert a != b
        same_object = OBJECTS[a] == OBJECTS[b] >= 0 and SENSORS[a] != SENSORS[b]
        same_action = ACTIONS[a] == ACTIONS[b] >= 0
        assert same_object if group % 2 == 0 else same_action
        kinds.add((a, b))
    assert len(kinds) > 5


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
