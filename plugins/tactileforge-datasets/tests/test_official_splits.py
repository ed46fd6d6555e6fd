from tactileforge_datasets.official_splits import (
    FORCE_SPLITS,
    SLIP_SPLITS,
    TOUCHD_BENCH,
    TOUCHD_PRETRAIN,
)

from tactileforge.reading.official import ALL_FOR_TRAINING, OfficialSplit


def test_sides() -> None:
    rest = OfficialSplit(
        "a", "", "object", train=None, test=frozenset({"cup"}), val=frozenset({"pen"})
    )
    assert [rest.side({"object": name}) for name in ("cup", "pen", "mug")] == [
        "test",
        "val",
        "train",
    ]
    assert rest.side({}) == "train"
    some = OfficialSplit("b", "", "object", train=frozenset({"mug"}))
    assert [some.side({"object": name}) for name in ("mug", "cup")] == ["train", None]
    assert ALL_FOR_TRAINING.side({"object": "cup"}) == "train"


def test_no_value_is_on_two_sides() -> None:
    splits = [TOUCHD_BENCH, TOUCHD_PRETRAIN]
    for by_sensor in (FORCE_SPLITS, SLIP_SPLITS):
        splits += [split for splits_of_sensor in by_sensor.values() for split in splits_of_sensor]
    for split in splits:
        train = split.train or frozenset()
        assert not train & split.test, split
        assert not (train | split.test) & split.val, split


def test_the_bench_of_anytouch2_has_ten_indenters() -> None:
    assert TOUCHD_BENCH.train is not None
    assert len(TOUCHD_BENCH.train) == 7
    assert TOUCHD_PRETRAIN.test == TOUCHD_BENCH.train | {"18", "22", "61"}
