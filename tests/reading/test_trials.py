import pytest

from tactileforge.reading.trials import trial_of, trials_of

LEFT = ("left", "right")
TEN = range(10)


@pytest.mark.parametrize(
    ("names", "trials"),
    [
        ([f"trial_{i:03d}/{side}" for i in TEN for side in LEFT], 10),
        ([f"{side}/{i:03d}" for i in TEN for side in LEFT], 10),
        ([f"mug_{i}_{side}" for i in TEN for side in "LR"], 10),
        ([f"mug_{i}/frame_{side}" for i in TEN for side in LEFT], 10),
        ([f"{i:03d}/cam{n}" for i in TEN for n in (0, 1)], 10),
        ([f"cam{n}/{i:03d}" for i in TEN for n in (0, 1)], 10),
        ([f"{i:03d}_sensor_{n}" for i in TEN for n in (1, 2)], 10),
        ([f"{sensor}/{i}" for i in TEN for sensor in ("digit", "gelsight_mini")], 10),
        ([f"{sensor}/trial_{i}" for i in TEN for sensor in ("digit", "gsmini")], 10),
        ([f"{serial}/trial_{i}" for i in TEN for serial in ("D20142", "D20456")], 10),
        ([f"{version}/trial_{i}" for i in TEN for version in ("raw", "processed")], 10),
        ([f"mug_{i}_{version}" for i in TEN for version in ("raw", "cropped")], 10),
        ([f"press{i}/{word}" for i in TEN for word in ("tactile", "wrist", "scene")], 10),
        ([f"trial_{i}/{n}" for i in TEN for n in (0, 1, 2)], 10),
        ([f"mug_{i}_rep{n}" for i in TEN for n in (0, 1)], 10),
        ([f"{what}/{i}/{side}" for what in ("mug", "cup") for i in TEN for side in LEFT], 20),
        ([f"2024-05-{i:02d}T10-00-00_finger{n}" for i in range(1, 11) for n in (1, 2)], 10),
        # takes alone, of one sensor or object
        ([f"{what}/{i}" for what in ("mug", "cup") for i in TEN], 20),
        ([f"gelsight_{i}" for i in TEN], 10),
        ([f"day{day}/digit_{i}" for day in (1, 2) for i in TEN], 20),
        ([f"{what}/{how}" for what in ("mug", "cup", "box") for how in ("press", "slide")], 6),
        ([f"{what}/{i}" for what in ("wedge", "sphere") for i in TEN], 20),
        ([f"{day}/trial_{i}" for day in ("20240501", "20240502") for i in TEN], 20),
        ([f"raw/trial_{i}" for i in TEN], 10),
        ([f"day0/{what}" for what in ("mug", "cup")], 2),
        ([f"rep_{i}" for i in TEN], 10),
        (["left", "right"], 2),
        ([], 0),
    ],
)
def test_recordings_of_one_trial_have_one_name(names: list[str], trials: int) -> None:
    found = trials_of(names)
    assert len(found) == len(names)
    assert len(set(found)) == trials
    of_number = dict(zip(names, found, strict=True))
    if trials == 10 and len(names) == 20:  # and it is the trial that they share, not the sensor
        number = {name: "".join(c for c in name if c in "3")[:1] for name in names}
        ours = {of_number[name] for name in names if number[name] and "cam" not in name}
        assert len(ours) <= 1


def test_recordings_of_one_folder_at_once_are_of_one_trial() -> None:
    names = ["day/a", "day/b", "day/c", "other/a"]
    spans = {"day/a": (0.0, 9.0), "day/b": (0.5, 9.5), "day/c": (20.0, 29.0), "other/a": (0.0, 9.0)}
    a, b, c, other = trials_of(names, spans)
    assert a == b
    assert len({a, c, other}) == 3


def test_the_name_of_a_recording_alone() -> None:
    assert trial_of("lab/Trial_007/left.mp4") == "lab/Trial_007"
    assert trial_of("mug_3") == "mug_3"
    assert trial_of("left") == "left", "nothing else is left"
