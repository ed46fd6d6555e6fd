"""Models of the package."""

import csv
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
from shipped import SHIPPED
from tactileforge_bench.results.release_gate import not_above
from tactileforge_sim.dataset import Sim
from tactileforge_sim.randomise.table import NEARER, TABLE

import tactileforge
from tactileforge.contracts import Recording
from tactileforge.data.batches.clips import Clips
from tactileforge.data.labels.displacement import decode_displacement
from tactileforge.hub import Measurement, cards
from tactileforge.hub.header import read_header

PHOTOGRAPHS = "photographs with all that is free"


def test_three_models_ship() -> None:
    assert SHIPPED == ["anytouch2.tiny", "anytouch2.tiny-real", "touch.tiny"]


@pytest.mark.parametrize("name", SHIPPED)
def test_it_works_without_a_network_and_is_small(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TACTILEFORGE_CACHE", str(tmp_path))
    monkeypatch.setattr("socket.socket", None)
    model = tactileforge.load(name)
    _, weight = cards.find_card(name)
    assert weight.kind == "shipped"
    assert weight.bytes < 15_000_000
    assert set(model.sensors) == set(weight.sensors), "the card and docs/zoo.md say the same"
    assert model.any_sensor == (name == "touch.tiny")
    assert model.header.licence == weight.licence == "Apache-2.0"
    assert set(model.header.data["licences"]) <= {"BSD-2-Clause", "CC0-1.0"}  # CC0: simulated
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", SHIPPED)
def test_its_card_says_how_it_was_made(name: str) -> None:
    """Data, commit, commands, machine and time stand on the card."""
    card, weight = cards.find_card(name)
    header = read_header(Path(str(cards.zoo_folder() / weight.file)))
    assert set(weight.sensors) == set(header.sensors)
    assert weight.data
    assert "dirty" not in header.commit
    below = card.text.partition(f"## `{weight.tag}`")[2].partition("\n## ")[0]
    assert header.commit[:7] in below
    for word in ("tactileforge train", "zoo pack", "core", "minutes", "seed"):
        assert word in below, word


def means(name: str) -> dict[tuple[str, str], Measurement]:
    card, weight = cards.find_card(name)
    return {
        (row.suite, row.tokens): row for row in card.measurements(weight) if row.metric == "mean"
    }


def test_what_saw_real_video_alone_is_above_random_weights() -> None:
    """In the mean of the tasks of both suites, beyond the interval, with each kind of tokens."""
    found = means("anytouch2.tiny-real")
    for tokens in ("patches", "summary", "pooled"):
        assert found["real", tokens].above["random weights"][1] > 0, tokens
        assert found["real", tokens].above["pixels"][1] > 0, tokens
        assert found["real_held_out", tokens].above["random weights"][1] > 0, tokens
    for suite in ("real", "real_held_out"):
        assert not_above(found[suite, "patches"]) == [PHOTOGRAPHS]


def test_the_network_of_photographs_learned_touch() -> None:
    """Level with photographs, above the rest in both suites; no task below random weights."""
    card, weight = cards.find_card("touch.tiny")
    found = means("touch.tiny")
    for suite in ("real", "real_held_out"):
        mean = found[suite, weight.reading]
        assert not_above(mean) == [PHOTOGRAPHS]
        assert mean.above[PHOTOGRAPHS][0] > 0 > mean.above[PHOTOGRAPHS][1]
    counted = [
        row for row in card.measurements(weight) if row.counted and row.tokens == weight.reading
    ]
    assert len(counted) == 9 + 6 + 2
    assert all(row.above["random weights"][2] >= 0 for row in counted)
    for row in found.values():
        assert row.above["random weights"][1] > 0, row


@pytest.fixture(scope="module")
def unseen() -> list[Recording]:
    """Force trials of the bench's indenters, by units and hands outside every training.

    Pictures are of the kind in their training, without the looks and worn objects added since.
    """
    rows = sorted(TABLE.keys() - NEARER)
    trials = Sim(scenes=4, val=0, indenters="bench", motions="force_trial", seed=5, randomise=rows)
    return list(trials.recordings("train"))


@pytest.mark.slow
@pytest.mark.parametrize(("shear", "axis"), [(0, -2), (1, -3)])
def test_a_mirrored_touch_has_mirrored_shear(shear: int, axis: int) -> None:
    """Shares of the scale along x, or y, change their sign; the other two do not."""
    model, touch = tactileforge.load("anytouch2.tiny"), tactileforge.sample_touch()
    frames, rest = touch.frames.read(range(len(touch.frames))), touch.background()
    clips = np.stack([frames[end - 3 : end + 1] for end in range(3, len(frames), 3)])
    force = model.force(clips, rest, touch.sensor)[:, -1].numpy()
    shown = (np.flip(pictures, axis).copy() for pictures in (clips, rest))
    mirrored = model.force(*shown, touch.sensor, checks=False)[:, -1].numpy()
    for i, (own, other) in enumerate(zip(force.T, mirrored.T, strict=True)):
        assert np.corrcoef(own, other)[0, 1] * (-1 if i == shear else 1) > 0.8
    assert 0.1 < np.abs(force).max() <= 1


@pytest.mark.slow
def test_forces_along_a_video_are_beside_its_first_frame() -> None:
    model, touch = tactileforge.load("anytouch2.tiny"), tactileforge.sample_touch()
    frames = touch.frames.read(range(len(touch.frames)))
    times, forces = model.force_video(frames, "first", touch.sensor, times=touch.times)
    clips = list(model.cut(frames, times=touch.times))
    np.testing.assert_array_equal(times, [end for end, _ in clips])
    expected = [model.force(clip, frames[0], touch.sensor)[-1] for _, clip in clips]
    torch.testing.assert_close(forces, torch.stack(expected), atol=1e-5, rtol=0)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "force", "displacement", "share"),
    [
        # .79 along z: simulated DIGITs have stray light since, which its training had not
        ("anytouch2.tiny", (0.7, 0.7, 0.75), (0.7, 0.7, 0.7), (0.75, 0.75, 0.75)),
        ("touch.tiny", (0.65, 0.6, 0.75), (0.5, 0.45, 0.7), (1.0, 1.0, 0.6)),
    ],
)
def test_it_reads_forces_and_surfaces_of_touches_it_never_saw(
    name: str,
    force: tuple[float, ...],
    displacement: tuple[float, ...],
    share: tuple[float, ...],
    unseen: list[Recording],
) -> None:
    """Least correlations along x, y and z, and the most of the error of the median force."""
    model = tactileforge.load(name)
    clips = Clips(unseen, model.frames, 1 / 15, 0.5, (128, 128))
    rows = [clips[i] for i in range(len(clips))]
    frames, background = (np.stack([row[key] for row in rows]) for key in ("frames", "background"))
    sensors = [row["sensor"] for row in rows]
    with pytest.warns(UserWarning, match="no calibration= of this unit"):
        estimated = model.force(frames, background, sensors, unit="uncalibrated")[:, -1]
    true = np.array([row["force"][-1].numpy() for row in rows])
    errors = np.abs(estimated.numpy() - true).mean(0)
    with pytest.warns(UserWarning, match="surface: an estimate"):
        surface = model.surface(frames, background, sensors)[:, -1].numpy()
    coded = np.stack([row["surface"][-1].movedim(0, -1).numpy() for row in rows])
    moved = np.moveaxis(decode_displacement(coded), -1, 1)
    for axis in range(3):
        assert np.corrcoef(estimated[:, axis], true[:, axis])[0, 1] > force[axis]
        at = surface[:, axis].ravel(), moved[:, axis].ravel()
        assert np.corrcoef(*at)[0, 1] > displacement[axis]
    assert (errors < share * np.abs(true - np.median(true, 0)).mean(0)).all()


@pytest.mark.slow
@pytest.mark.realdata
def test_the_deepest_place_is_where_a_real_ball_presses(realdata: Path) -> None:
    """Circles were drawn by hand on images of a lab GelSight; none of its images was trained on."""
    folder = realdata / "fots_ball_press"
    with (folder / "gelsight_annotations.csv").open() as file:
        circles = list(csv.DictReader(file))
    frames = np.stack([cv2.imread(str(folder / c["file"]), cv2.IMREAD_COLOR_RGB) for c in circles])
    background = cv2.imread(str(folder / "gelsight_background.png"), cv2.IMREAD_COLOR_RGB)
    model = tactileforge.load("anytouch2.tiny")
    with pytest.warns(UserWarning, match="surface: an estimate"):
        surface = model.surface(np.repeat(frames[:, None], 4, 1), background, "gelsight")
    weight = surface[:, -1, 2].clamp(min=0).square().numpy()
    rows, columns = np.indices(weight.shape[1:])
    for places, key in ((columns, "center_x_px"), (rows, "center_y_px")):
        centres = (weight * places).sum((1, 2)) / weight.sum((1, 2))
        true = [float(circle[key]) for circle in circles]
        assert np.corrcoef(centres, true)[0, 1] > 0.9
