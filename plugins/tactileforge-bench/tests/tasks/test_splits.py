"""Splits: overlaps and single classes are errors."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch
from tactileforge_bench.tasks import metrics, splits, targets
from tactileforge_bench.tasks.facts import recording_fact
from tactileforge_bench.tasks.source import TaskSource
from tactileforge_bench.tasks.suite import ClipSpec, SplitPlan, Task, parse_task

from tactileforge.contracts import Recording
from tactileforge.data.frames.lazy import ArrayFrames
from tactileforge.errors import ConfigError, DataError


def recording(key: str, **known: Any) -> Recording:
    count = 10
    force = np.outer(np.arange(count), [0.1, -0.2, 1.0]).astype(np.float32)
    options: dict[str, Any] = {"sensor": "digit", "object": "ball", "force": force} | known
    return Recording(
        key=key,
        frames=ArrayFrames(np.full((count, 8, 8, 3), 7, np.uint8)),
        times=np.arange(count) / 20,
        no_contact=None,
        **options,
    )


def task(target: str = "force", **options: Any) -> Task:
    plan = SplitPlan(**{"test": {"side": "val"}, **options})
    return Task(
        name="t",
        title="T",
        data={"name": "x"},
        target=target,
        probe={"name": "force"},
        metrics=["rmse_sum_axes"],
        split=plan,
    )


def source(recordings: list[Recording], sides: list[str], **clip: Any) -> TaskSource:
    return TaskSource(recordings, sides, ClipSpec(**{"span": 0.1, "hop": 0.1} | clip))


def names(of: TaskSource, target: targets.Target, places: Any) -> set[str]:
    return {of.recordings[n].key for n in of.index[target.clips[places], 0]}


def built(planned: Task, of: TaskSource) -> list[tuple[set[str], set[str], set[str]]]:
    target = targets.build_target(planned, of)
    return [
        (
            names(of, target, s.train),
            names(of, target, s.validation),
            names(of, target, s.test),
        )
        for s in splits.build_splits(planned, of, target)
    ]


def test_sides_and_a_share_by_object() -> None:
    data = [recording(f"r{i}", object=f"o{i // 2}") for i in range(10)]
    of = source(data, ["train"] * 8 + ["val"] * 2)
    planned = task(train={"side": "train"}, validation={"share": 0.25, "group": "object"})
    ((train, validation, test),) = built(planned, of)
    assert test == {"r8", "r9"}
    assert len(validation) == 2
    assert train | validation == {f"r{i}" for i in range(8)}
    first = min(int(key[1]) for key in validation)
    assert validation == {f"r{first}", f"r{first + 1}"}, "both recordings of one object"
    assert built(planned, of) == built(planned, of)


def test_filters_combine_and_lists_are_alternatives() -> None:
    sensors = ["digit", "gelsight", "gelsight_mini"]
    data = [recording(f"{s}{i}", sensor=s, object=f"o{i}") for s in sensors for i in range(4)]
    of = source(data, ["train", "train", "train", "val"] * 3)
    planned = task(
        train={"side": "train", "sensor": ["digit", "gelsight"]},
        test={"side": "val", "sensor": "gelsight_mini"},
        validation={"share": 0.3, "group": "object"},
        unseen=["object", "sensor"],
    )
    ((train, validation, test),) = built(planned, of)
    assert test == {"gelsight_mini3"}
    assert not any(key.startswith("gelsight_mini") for key in train | validation)
    assert len(train) == 4
    assert len(validation) == 2


def test_folds_test_everything_once_and_deal_classes_evenly() -> None:
    data = [
        recording(f"r{i:02}", object=f"o{i}", labels={"hardness": float(i % 3)}) for i in range(18)
    ]
    of = source(data, ["train"] * 18)
    planned = task("label:hardness", test={}, folds=3, group="object", unseen=["object"])
    folds = built(planned, of)
    assert sorted(key for _, _, test in folds for key in test) == [f"r{i:02}" for i in range(18)]
    for train, validation, test in folds:
        assert sorted(int(key[1:]) % 3 for key in test) == [0, 0, 1, 1, 2, 2]
        assert not train & test
        assert not validation & (train | test)
        assert validation


def test_a_pattern_keeps_the_touches_of_all_sensors_together() -> None:
    data = [recording(f"sim/{i:06}_{s}") for i in range(6) for s in ("digit", "gelsight")]
    of = source(data, ["train"] * 12)
    group = r"re:sim/(\d+)_"
    planned = task(test={}, folds=2, group=group, validation={"share": 0.3, "group": group})
    for uses in built(planned, of):
        for keys in uses:
            assert {key.partition("_")[0] for key in keys} == {
                key.partition("_")[0] for key in keys if key.endswith("digit")
            }


def test_parts_of_a_recording_do_not_overlap() -> None:
    data = [recording("r").part(2, 10)]
    of = source(data, ["train"], parts=4)
    assert [r.key for r in of.recordings] == [f"r[2:10][{i}:{i + 2}]" for i in (0, 2, 4, 6)]
    planned = task(test={}, folds=2, group="recording")
    for train, validation, test in built(planned, of):
        assert len(train) + len(validation) + len(test) == 4


def test_a_recording_of_fewer_frames_than_parts_keeps_its_side() -> None:
    of = source([recording("a").part(0, 3), recording("b")], ["train", "val"], parts=4)
    sides = zip((one.key[0] for one in of.recordings), of.sides, strict=True)
    assert list(sides) == [("a", "train")] * 3 + [("b", "val")] * 4


def test_a_recording_on_two_sides_is_found() -> None:
    of = source(
        [recording("a"), recording("b"), recording("c"), recording("a")], ["train"] * 3 + ["val"]
    )
    with pytest.raises(ConfigError, match="recording 'a' is in test and in train"):
        built(task(), of)


def test_parts_that_share_frames_are_found() -> None:
    whole = recording("a")
    parts = [whole.part(0, 6), recording("b"), recording("c"), whole.part(5, 10)]
    of = source(parts, ["train"] * 3 + ["val"])
    with pytest.raises(ConfigError, match="recording 'a'"):
        built(task(), of)
    apart = [whole.part(0, 5), recording("b"), recording("c"), whole.part(5, 10)]
    assert built(task(), source(apart, ["train"] * 3 + ["val"]))


def test_an_object_that_has_to_be_unseen_is_found() -> None:
    data = [recording(f"r{i}", object=f"o{i % 3}") for i in range(4)]
    of = source(data, ["train"] * 3 + ["val"])
    assert built(task(), of)
    with pytest.raises(ConfigError, match="object 'o0' is to be unseen"):
        built(task(unseen=["object"]), of)


def test_one_class_is_no_task() -> None:
    data = [recording(f"r{i}", labels={"hardness": 1.0}) for i in range(4)]
    of = source(data, ["train"] * 3 + ["val"])
    with pytest.raises(DataError, match="all 8 clips for train are class '1'"):
        built(task("label:hardness"), of)


def test_nothing_to_test_on_and_unknown_facts() -> None:
    data = [recording(f"r{i}") for i in range(4)]
    of = source(data, ["train"] * 4)
    with pytest.raises(ConfigError, match="no recording for test"):
        built(task(), of)
    with pytest.raises(ConfigError, match=r"has no 'colour'\. It has: side, sensor"):
        built(task(test={"colour": "red"}), of)
    with pytest.raises(ConfigError, match="5 folds of 4 groups"):
        built(task(test={}, folds=5), of)


def test_tasks_are_read_strictly() -> None:
    plain: dict[str, Any] = {
        "title": "T",
        "data": {"name": "sim"},
        "target": "force",
        "probe": {"name": "force"},
        "metrics": ["rmse_sum_axes"],
        "split": {"test": {"side": "val"}},
    }
    assert parse_task("t", plain).sides == ("train", "val"), "what the test leaves trains"
    only = {"split": {"only": {"side": "val"}, "folds": 3}}
    assert parse_task("t", plain | only).sides == ("val",)
    both = {"split": {"train": {"side": "train"}, "test": {"side": "test"}}}
    assert parse_task("t", plain | both).sides == ("train", "test")
    assert parse_task("t", plain | {"split": {"folds": 3}}).sides == ("train", "val")
    assert parse_task("t", plain | {"probe": "ridge"}).probe == {"name": "ridge"}
    for key, value, said in (
        ("clip", {"hopp": 1}, "did you mean 'hop'"),
        ("metrics", [], "metrics is empty"),
        ("probe", {}, "probe has no name"),
        ("split", {}, "give one of test, as in"),
        ("splits", {}, "did you mean 'split'"),
        ("unknown_sensor", "guess", "error or universal"),
        ("title", 3, "not of type str"),
    ):
        with pytest.raises(ConfigError, match=said):
            parse_task("t", plain | {key: value})


def test_targets() -> None:
    """The last frame counts, and changes are over the span."""
    data = [recording("a", action=np.array([0] * 5 + [2] * 5)), recording("b", force=None)]
    of = source(data, ["train", "val"])
    force = targets.build_target(task("force"), of)
    ends = of.index[:, 1]
    assert ends.tolist() == [2, 4, 6, 8] * 2
    assert force.clips.tolist() == [0, 1, 2, 3], "the other has no force"
    np.testing.assert_allclose(force.parts["force"].truth[:, 2], [2, 4, 6, 8])
    np.testing.assert_allclose(force.parts["force"].scale[0], [5.25, 10.61, 14.14], rtol=1e-6)
    delta = targets.build_target(task("delta_force"), of).parts["delta_force"]
    np.testing.assert_allclose(delta.truth, [[0.2, -0.4, 2.0]] * 4, rtol=1e-5)
    action = targets.build_target(task("action"), of)
    assert action.clips.tolist() == [0, 1, 3], "the third shows two actions"
    with pytest.raises(DataError, match="no clip of the data has the label 'label:hardness'"):
        targets.build_target(task("label:hardness"), of)
    with pytest.raises(ConfigError, match="did you mean 'force'"):
        targets.build_target(task("forse"), of)


@pytest.mark.parametrize(
    ("label", "text"),
    [(1234567.0, "1234567"), (0.5, "0.5"), (1 / 3, repr(1 / 3)), ("hard", "hard")],
)
def test_labels_keep_all_their_digits(label: str | float, text: str) -> None:
    data = [recording(str(i), labels={"part": label}) for i in range(2)]
    of = source(data, ["train", "val"])
    assert targets.build_target(task("label:part"), of).parts["class"].names == (text,)
    assert recording_fact(of, 0, "part") == text


def test_a_word_where_a_number_should_be_is_named() -> None:
    data = [recording(str(i), labels={"grade": "hard"}) for i in range(2)]
    with pytest.raises(DataError, match=r"a label of grade is not a number .*'hard'.*label:NAME"):
        targets.build_target(task("numbers:grade"), source(data, ["train", "val"]))


def test_numbers_keep_their_unit_and_shares_are_of_the_width() -> None:
    """Frames are 8 pixels wide."""
    data = [recording(str(i), labels={"a_px": 4.0, "b": 2.0}) for i in range(2)]
    of = source(data, ["train", "val"])
    plain = targets.build_target(task("numbers:a_px+b"), of).parts["numbers"]
    assert plain.truth[0].tolist() == [4.0, 2.0]
    shares = targets.build_target(task("shares:a_px"), of).parts["numbers"]
    assert shares.truth[0].tolist() == [0.5]


def test_a_use_without_recordings_says_what_there_is() -> None:
    data = [recording(str(i), object=str(i)) for i in range(6)]
    of = source(data, ["train"] * 4 + ["val"] * 2)
    planned = task(train={"object": "none"})
    said = r"of 6 recordings of sides train, val the test has 2, and split.train=.* finds none"
    with pytest.raises(ConfigError, match=said):
        splits.build_splits(planned, of, targets.build_target(planned, of))


def test_classes_that_training_never_saw_are_named() -> None:
    data = [recording(str(i), object=("ball", "nut")[i % 2]) for i in range(6)]
    data += [recording("6", object="cube"), recording("7", object="ball")]
    of = source(data, ["train"] * 6 + ["val"] * 2)
    planned = task("object")
    target = targets.build_target(planned, of)
    said = splits.unseen_classes(target, splits.build_splits(planned, of, target))
    assert said == "4 of 8 test labels are classes that training never saw: cube"
    folds = task("object", test={}, folds=2)
    known = source(data[:6], ["train"] * 6)
    target = targets.build_target(folds, known)
    assert splits.unseen_classes(target, splits.build_splits(folds, known, target)) == ""


def test_normal_force_needs_no_other_axis() -> None:
    force = np.full((10, 3), np.nan, np.float32)
    force[:, 2] = np.arange(10)
    of = source([recording("a", force=force), recording("b", force=None)], ["train"])
    target = targets.build_target(task("normal_force"), of)
    part = target.parts["normal_force"]
    assert target.clips.tolist() == [0, 1, 2, 3]
    assert part.truth[:, 0].tolist() == [2, 4, 6, 8]
    np.testing.assert_allclose(part.scale[:, 0], 14.14, rtol=1e-6)
    score = metrics.METRICS["r2"].build(part)
    score.update(part.truth + torch.tensor([[1.0], [-1.0], [1.0], [-1.0]]), part.truth)
    assert score.compute().item() == pytest.approx(1 - 4 / 20)
    with pytest.raises(DataError, match=r"all of x, y, z \(it has z\).*normal_force needs only z"):
        targets.build_target(task("force"), of)


def test_mirrored_targets_follow_physics() -> None:
    of = source([recording("a", action=np.full(10, 2))], ["train"])
    force = targets.build_target(task("force"), of).parts["force"]
    sideways = force.flipped(True, False).truth
    np.testing.assert_allclose(sideways, force.truth.numpy() * [-1, 1, 1])
    np.testing.assert_allclose(force.flipped(True, True).truth, force.truth.numpy() * [-1, -1, 1])
    action = targets.build_target(task("action"), of).parts["action"]
    assert action.flipped(True, False).truth[0] == 3, "left becomes right"
    assert action.flipped(False, True).truth[0] == 2


def test_what_a_mirror_leaves_alone_is_the_same_and_places_are_refused() -> None:
    of = source([recording("a", action=np.full(10, 2))], ["train"])
    for name in ("normal_force", "time"):
        (part,) = targets.build_target(task(name), of).parts.values()
        assert torch.equal(part.flipped(True, False).truth, part.truth)
    place = targets.TargetPart("place", torch.zeros(1, 2), torch.ones(1, 2), ("x", "y"))
    with pytest.raises(ConfigError, match="set flips: false"):
        place.flipped(True, False)


@pytest.mark.parametrize("mirrored", [(True, False), (False, True), (True, True)])
def test_a_mirrored_motion_is_that_of_the_mirrored_pose(mirrored: tuple[bool, bool]) -> None:
    """Shifts of 3 and -0.7 mm and a turn of 0.7 degrees, in the classes of Sparsh."""
    turn, sign = np.radians(0.7), np.where(mirrored, -1.0, 1.0)
    pose = np.eye(4)
    pose[:2, :2] = [[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]
    pose[:2, 3] = 0.003, -0.0007
    mirror = np.diag([*sign, 1.0, 1.0])
    truths = []
    for each in (pose, mirror @ pose @ mirror):
        touch = recording("a", tracks={"relative_pose": np.repeat(each[None], 10, 0)})
        truths.append(targets.build_target(task("pose"), source([touch], ["train"])).parts["pose"])
    assert torch.equal(truths[0].flipped(*mirrored).truth, truths[1].truth)
    assert not torch.equal(truths[0].truth, truths[1].truth)


def test_slip_in_simulation_is_the_friction_cone() -> None:
    from tactileforge_sim.mechanics.sensor_gels import sensor_gel

    friction = sensor_gel("digit").touched(0.5).friction
    force = np.zeros((10, 3), np.float32)
    force[:, 2] = 2.0
    force[5:, 0] = 2.0 * friction
    of = source([recording("a", force=force, labels={"grip": 0.5})], ["train"])
    slip = targets.build_target(task("slip"), of).parts["slip"]
    assert slip.truth[:, 0].tolist() == [0, 0, 1, 1]
    labelled = recording("b", tracks={"slip": np.array([1, 0] * 5, np.int8)})
    folds = targets.build_target(task("slip"), source([labelled], ["train"], hop=0.05)).parts[
        "slip"
    ]
    assert folds.truth[:4, 0].tolist() == [1, 0, 1, 0]


def test_clamped_targets_and_fixed_ends() -> None:
    of = source([recording("a")], ["train"], ends=[-1, -3, 0.0, 0.5])
    assert of.index[:, 1].tolist() == [9, 7, 0, 4]
    assert of.first.tolist() == [7, 5, 0, 2]
    planned = replace(task("force"), scale=[1.0, 1.0, 4.0], clamp=1.0)
    assert targets.build_target(planned, of).parts["force"].truth[:, 2].tolist() == [4, 4, 0, 4]


def test_a_label_may_be_a_track_at_the_last_frame() -> None:
    """Frames without a value have no target; a label of the recording goes before the track."""
    values = np.array([0, 0, 0, np.nan, 1, 1, 1, 1, np.nan, 0], np.float32)
    of = source([recording("a", tracks={"contact": values})], ["val"], span=0.0, hop=0.0)
    target = targets.build_target(task("label:contact"), of)
    assert of.index[target.clips, 1].tolist() == [1, 2, 4, 5, 6, 7, 9]
    assert target.parts["class"].names == ("0", "1")
    assert target.parts["class"].truth[:, 0].tolist() == [0, 0, 1, 1, 1, 1, 0]
    target = targets.build_target(task("numbers:contact"), of)
    assert target.parts["numbers"].truth[:, 0].tolist() == [0, 0, 1, 1, 1, 1, 0]
    labelled = recording("b", tracks={"contact": values}, labels={"contact": 3.0})
    of = source([labelled], ["val"], span=0.0, hop=0.0)
    target = targets.build_target(task("numbers:contact"), of)
    assert target.parts["numbers"].truth[:, 0].tolist() == [3.0] * 9
