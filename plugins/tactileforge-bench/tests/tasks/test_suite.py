"""Every suite is read, names existing tasks, and agrees with the published one."""

from pathlib import Path

import numpy as np
import pytest
import torch
from tactileforge_bench.fit.resolve import choose_probe, result_task
from tactileforge_bench.output.published import published_scores
from tactileforge_bench.tasks import metrics, splits, targets
from tactileforge_bench.tasks.contact import contact_energy
from tactileforge_bench.tasks.source import open_source
from tactileforge_bench.tasks.suite import ClipSpec, Task, parse_task
from tactileforge_bench.verbs.bench import COMMANDS

from tactileforge.plugins import registry
from tactileforge.reading.splits import is_held_out

FOLDER = Path(__file__).parents[2] / "src" / "tactileforge_bench" / "conf" / "suite"
SUITES = sorted(path.stem for path in FOLDER.glob("*.yaml"))
#: What a suite asks for.
ASKED = {"classes": ["classes.root=.", "classes.sensor=digit", "classes.folds=5"]}


def suite(name: str, *words: str) -> dict[str, Task]:
    config = COMMANDS[""].compose("bench", [f"suite={name}", *ASKED.get(name, []), *words])
    return {key: parse_task(key, node) for key, node in config["tasks"].items()}


@pytest.mark.parametrize("name", SUITES)
def test_a_suite_can_be_run(name: str) -> None:
    for task in suite(name).values():
        row = result_task(task, choose_probe(task, {}), "validation")
        assert row.main == task.metrics[0]
        assert all(metrics.metric_kind(metric) for metric in task.metrics)
        labels = ("label:", "numbers:", "shares:")
        assert task.target in targets.TARGETS or task.target.startswith(labels)
        if "preset" not in task.data:
            registry.build("datasets", task.data)


@pytest.mark.slow
def test_what_is_published_has_a_task_of_its_title() -> None:
    titles = {task.title for name in SUITES for task in suite(name).values()}
    published = {row.task for row in published_scores()}
    assert len(published) > 8
    assert published <= titles


def test_published_settings() -> None:
    touchd, sparsh, objects = (suite(name) for name in ("touchd", "sparsh", "object"))
    force = choose_probe(touchd["touchd_force_digit"], {}).training
    assert (force.epochs, force.batch, force.lr, force.schedule) == (50, 64, (2e-4,), "constant")
    assert touchd["touchd_force_digit"].split.unseen == ["object"]
    assert sparsh["sparsh_force_digit"].scale == [4, 4, 5]
    assert sparsh["sparsh_slip_gelsight_mini"].scale == [0.8, 0.8, 0.4]
    assert objects["cloth"].clip.ends == [-2, -9]
    assert objects["tag_material"].flips
    assert not touchd["touchd_force_digit"].flips


def test_suites_add_up() -> None:
    config = COMMANDS[""].compose("bench", ["suite=[sim,touchd]"])
    assert list(config["suites"]) == ["sim", "touchd"]
    assert {"sim_force", "touchd_force_digit"} <= set(config["tasks"])


def test_transfer_never_shows_the_third_sensor() -> None:
    split = suite("sim")["sim_transfer"].split
    assert split.test == {"side": "val", "sensor": "gelsight_mini"}
    assert "gelsight_mini" not in split.train["sensor"]
    assert set(split.unseen) == {"object", "sensor"}


@pytest.mark.slow
@pytest.mark.realdata
@pytest.mark.parametrize(
    ("name", "recordings", "tested"),
    [
        ("octopi_hardness", 201, 804),
        ("octopi_object", 240, 960),
        ("ball_place", 114, 114),
        ("touchd_demo_force", 20, None),
    ],
)
def test_public_samples(name: str, recordings: int, tested: int | None, realdata: Path) -> None:
    task = suite("public_samples", f"public_samples.root={realdata}")[name]
    source = open_source(task.data, task.sides, task.clip)
    target = targets.build_target(task, source)
    assert len({int(n) for n in source.index[target.clips, 0]}) == recordings
    folds = splits.build_splits(task, source, target)
    count = sum(len(split.test) for split in folds)
    assert count == len(target.clips), "every clip is tested once"
    if tested is not None:
        assert count == pytest.approx(tested, rel=0.03)


@pytest.mark.slow
@pytest.mark.realdata
@pytest.mark.parametrize(("name", "half"), [("real", "train"), ("real_held_out", "val")])
def test_the_gate_never_shares_a_recording_or_an_object(
    name: str, half: str, realdata: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TACTILEFORGE_REALDATA", str(realdata))
    for task in suite(name).values():
        source = open_source(task.data, task.sides, task.clip)
        target = targets.build_target(task, source)
        folds = splits.build_splits(
            task, source, target
        )  # raises where a recording is on two sides
        tested = np.concatenate([fold.test for fold in folds])
        assert len(set(tested.tolist())) == len(tested)
        groups = [splits.group_names(source, target, fold.test, task.split.group) for fold in folds]
        assert sum(len(set(group)) for group in groups) == len(
            {n for group in groups for n in group}
        )
        for fold in folds:
            known = splits.group_names(source, target, fold.train, task.split.group)
            assert not set(known) & set(
                splits.group_names(source, target, fold.test, task.split.group)
            )
        if "octopi" in task.name or "losing" in task.name:
            objects = splits.group_names(source, target, tested, "object")
            assert {is_held_out(group, 0.5) for group in objects} == {half == "val"}


def test_the_two_parts_of_the_gate_share_nothing() -> None:
    """Other halves of the objects, other layouts of the same folders."""
    for ours, theirs in (("octopi_object", "octopi_object"), ("losing_grip", "losing_grip")):
        group, other = suite("real")[f"real_{ours}"], suite("real_held_out")[f"held_{theirs}"]
        assert group.split.only["side"] == "train"
        assert other.split.only["side"] == "val"
        assert group.data == other.data
    layouts = [
        {layout for task in suite(name).values() for layout in task.data["layouts"]}
        for name in ("real", "real_held_out")
    ]
    assert layouts[0] & layouts[1] == {"octopi", "slip_b"}


def test_new_sets_are_in_the_part_that_their_hash_says() -> None:
    """Folders of sets added since the suites have two parts, whatever their tasks turn out."""
    for name in ("digit_ball_presses", "anytouch2_umi_cable", "gelslam_mini"):
        part = "real_held_out" if is_held_out(name, 0.5) else "real"
        found = {
            suite_name
            for suite_name in ("real", "real_held_out")
            for task in suite(suite_name).values()
            for layout in task.data["layouts"]
            if isinstance(task.data["layouts"], dict)
            and task.data["layouts"][layout]["path"] == name
        }
        assert found == {part}


@pytest.mark.realdata
def test_circles_of_both_digits_lie_in_their_pictures(
    realdata: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The stills of one recording are kept apart, each with its own centre; a unit is one fold."""
    monkeypatch.setenv("TACTILEFORGE_REALDATA", str(realdata))
    task = suite("real")["real_ball_digit_unit"]
    source = open_source(task.data, task.sides, task.clip)
    target = targets.build_target(task, source)
    truth = target.parts["numbers"].truth
    assert len(truth) == len(source.recordings) == 45
    # rows have 240 pixels, columns 320
    assert (truth > 0).all()
    assert (truth < torch.tensor([1, 320 / 240])).all()
    # the first still of the second unit: 145, 130 in labels.csv
    assert (truth[31] * 240).tolist() == pytest.approx([145, 130], abs=1e-3)
    assert sorted(len(fold.test) for fold in splits.build_splits(task, source, target)) == [14, 31]


@pytest.mark.slow
@pytest.mark.realdata
def test_contact_with_the_cable_changes_the_picture(
    realdata: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Labels come from the other finger; shifted by the lag, they split the change in two."""
    monkeypatch.setenv("TACTILEFORGE_REALDATA", str(realdata))
    task = suite("real_held_out")["held_cable_contact"]
    (recording,) = open_source(task.data, task.sides, ClipSpec()).recordings
    contact = recording.tracks["contact"]
    (ranges,) = (track["frames"] for track in task.data["layouts"]["cable"]["tracks"])
    assert len(ranges) == 18
    assert np.isnan(contact).sum() == 18 * 2 * 6
    assert (contact == 1).sum() == sum(stop - start - 6 for start, stop in ranges)
    change = contact_energy(recording)
    assert change[contact == 1].mean() > 2 * change[contact == 0].mean()
