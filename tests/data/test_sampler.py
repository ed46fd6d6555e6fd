import numpy as np
import pytest

from tactileforge.data.sampler import Batches, Pairs

OBJECTS = np.array([0, 0, 0, 1, 1, 2, -1, -1])
SENSORS = np.array([0, 1, 1, 0, 1, 0, 0, 1])
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
    ],
)
def test_without_a_pair_and_its_negative_there_are_none(objects, sensors, actions) -> None:
    assert not Pairs(*map(np.array, (objects, sensors, actions)))


def test_an_epoch_shows_every_clip_once() -> None:
    batches = Batches(clips=40, size=8, seed=3)
    assert len(batches) == 5
    shown = [clip for batch in batches for clip, group in batch if group == -1]
    assert sorted(shown) == list(range(40))


def test_epochs_and_seeds_differ_and_repeat() -> None:
    batches = Batches(40, 8, seed=3)
    assert batches.batch(7) == Batches(40, 8, seed=3).batch(7)
    assert batches.batch(7) != batches.batch(2)
    assert batches.batch(7) != Batches(40, 8, seed=4).batch(7)


def test_ranks_share_an_epoch() -> None:
    ranks = [Batches(40, 4, seed=3, rank=rank, world=2) for rank in range(2)]
    joint = Batches(40, 8, seed=3)
    for number in range(5):
        assert ranks[0].batch(number) + ranks[1].batch(number) == joint.batch(number)


def test_a_fixed_share_of_each_batch_is_drawn_in_pairs() -> None:
    batches = Batches(8, 8, seed=0, pairs=Pairs(OBJECTS, SENSORS, ACTIONS), share=0.5)
    for number in range(10):
        groups = [group for _, group in batches.batch(number)]
        assert groups == [0, 0, 1, 1, -1, -1, -1, -1]


def test_an_iteration_goes_on_where_the_run_stands() -> None:
    whole = [batch for n in range(3) for batch in Batches(40, 8, 0, position=lambda n=n: 5 * n)]
    rest = list(Batches(40, 8, 0, position=lambda: 7))
    assert rest == whole[7:10]


def test_the_length_of_an_epoch_is_a_multiple_of_the_accumulated_batches() -> None:
    assert len(Batches(40, 8, 0, multiple=2)) == 4
