"""Official splits of papers, by name."""

from __future__ import annotations

from tactileforge.reading import ALL_FOR_TRAINING, OfficialSplit


def _named(*values: str | int) -> frozenset[str]:
    return frozenset(map(str, values))


def _lists(name: str, about: str) -> OfficialSplit:
    """A split by lists shipped with the data; the data set passes the list's name as ``list``."""
    return OfficialSplit(name, about, "list", _named("train"), _named("test"), _named("val"))


TAG_MATERIAL = _lists("tag-material", "train.txt and test.txt of Touch and Go: 20 materials")
TAG_ROUGH = _lists("tag-rough", "train_rough.txt and test_rough.txt of Touch and Go: two classes")
ANYTOUCH2_MATERIAL = _lists(
    "anytouch2-material", "train_bg.txt and test_bg.txt of AnyTouch 2: materials, with backgrounds"
)
ANYTOUCH2_ROUGH = _lists(
    "anytouch2-rough", "train_rough_bg.txt and test_rough_bg.txt of AnyTouch 2, with backgrounds"
)
TVL_OFFICIAL = _lists("tvl-official", "train.csv and test.csv of TVL")
OCTOPI_OFFICIAL = _lists("octopi-official", "objects in utils/constants.py of Octopi")
CLOTH_OFFICIAL = _lists("cloth-official", "train_data.json and test_data.json of the data set")
ANYTOUCH2_CLOTH = _lists(
    "anytouch2-official", "train_data_new.json and test_data_new.json of AnyTouch 2"
)

_BENCH_TRAIN = _named(6, 41, 52, 53, 59, 69, 70)
_BENCH_TEST = _named(18, 22, 61)
TOUCHD_BENCH = OfficialSplit(
    "anytouch2-official",
    "ToucHD Bench: seven indenters to train a probe, three to test it",
    "indenter",
    _BENCH_TRAIN,
    _BENCH_TEST,
)
TOUCHD_PRETRAIN = OfficialSplit(
    "anytouch2-pretrain",
    "the ten indenters of ToucHD Bench are kept out of the training",
    "indenter",
    None,
    _BENCH_TRAIN | _BENCH_TEST,
)

# Splits of Sparsh's tasks by sensor; the values are ``PROBE/batch_N``.
_FORCE_OFFICIAL = {
    "digit": OfficialSplit(
        "sparsh-official",
        "T1 of Sparsh",
        "batch",
        _named("sphere/batch_1", "sharp/batch_1", "flat/batch_2"),
        _named("flat/batch_1"),
    ),
    "gelsight_mini": OfficialSplit(
        "sparsh-official",
        "T1 of Sparsh",
        "batch",
        _named("sphere/batch_1", "sphere/batch_2", "sharp/batch_1", "sharp/batch_2"),
        _named("flat/batch_1"),
    ),
}
_FORCE_PORT = {
    "digit": OfficialSplit(
        "anytouch2-port",
        "T1 as AnyTouch 2 ports it",
        "batch",
        _named("sphere/batch_2", "sharp/batch_2"),
        _named("flat/batch_1"),
    ),
    "gelsight_mini": OfficialSplit(
        "anytouch2-port",
        "T1 as AnyTouch 2 ports it",
        "batch",
        _named(*(f"sphere/batch_{i}" for i in range(1, 5)), "sharp/batch_1", "sharp/batch_2"),
        _named("flat/batch_1", "flat/batch_2"),
    ),
}
_SPHERE2 = _named("sphere2/batch_1", "sphere2/batch_2", "sphere2/batch_3")
_SLIP_OFFICIAL = {
    "digit": OfficialSplit(
        "sparsh-official", "T2 of Sparsh", "batch", _SPHERE2, _named("sphere2/batch_test")
    ),
    "gelsight_mini": OfficialSplit(
        "sparsh-official",
        "T2 of Sparsh; its test batch is not on Hugging Face",
        "batch",
        _named(*(f"sphere/batch_{i}" for i in (1, 3, 4, 5, 6))),
        _named("sphere/batch_test"),
    ),
}
_SLIP_PORT = {
    "digit": OfficialSplit(
        "anytouch2-port",
        "T2 as AnyTouch 2 ports it",
        "batch",
        _SPHERE2,
        _named("sphere2/batch_test"),
    ),
    "gelsight_mini": OfficialSplit(
        "anytouch2-port",
        "T2 as AnyTouch 2 ports it: batch 6 is test",
        "batch",
        _named(*(f"sphere/batch_{i}" for i in (1, 3, 4, 5))),
        _named("sphere/batch_6"),
    ),
}
POSE_OFFICIAL = OfficialSplit(
    "sparsh-official",
    "T3 of Sparsh: its folders train and test",
    "folder",
    _named("train"),
    _named("test"),
)

#: Splits by sensor.
FORCE_SPLITS = {
    sensor: (_FORCE_OFFICIAL[sensor], _FORCE_PORT[sensor], ALL_FOR_TRAINING)
    for sensor in _FORCE_OFFICIAL
}
SLIP_SPLITS = {
    sensor: (_SLIP_OFFICIAL[sensor], _SLIP_PORT[sensor], ALL_FOR_TRAINING)
    for sensor in _SLIP_OFFICIAL
}
