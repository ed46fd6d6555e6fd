from collections import Counter
from importlib.resources import files
from itertools import chain
from pathlib import Path

import numpy as np
import pytest
from omegaconf import OmegaConf

from tactileforge.checks.doubts import Doubts
from tactileforge.contracts import ACTIONS, Recording
from tactileforge.datasets.recordings import Recordings
from tactileforge.errors import DataNotFoundError

PRESET = files("tactileforge_datasets.conf") / "data/public_samples.yaml"
CONFIG = OmegaConf.load(Path(str(PRESET))).data


def test_every_layout_says_where_it_is_from() -> None:
    data = Recordings("gone", CONFIG.layouts)
    assert OmegaConf.is_missing(CONFIG, "root")
    assert all(layout.source and layout.licence for layout in data.layouts)
    assert data.provides == {"force", "action", "object", "text"}
    with pytest.raises(DataNotFoundError, match=r"gone/touchd_force_demo: .*data\.root"):
        list(data.recordings("train"))


@pytest.fixture(scope="module")
def splits(realdata: Path) -> dict[str, list[Recording]]:
    data = Recordings(str(realdata), CONFIG.layouts, CONFIG.val)
    by_split = {split: list(data.recordings(split)) for split in ("train", "val")}
    assert data.skipped == []
    assert data.notes == []
    return by_split


@pytest.mark.realdata
def test_no_label_time_or_size_is_doubted(splits: dict[str, list[Recording]]) -> None:
    doubts = Doubts()
    for recording in chain(*splits.values()):
        doubts.add(recording)
    assert doubts.total > 500
    assert [*doubts.of_each(), *doubts.of_all()] == []


@pytest.mark.realdata
def test_everything_is_found(splits: dict[str, list[Recording]]) -> None:
    # A file of its own, but a tile or a part of one counts once.
    files = {
        recording.key.split("#")[0].split("[")[0]
        for recordings in splits.values()
        for recording in recordings
    }
    assert Counter(name.split("/")[0] for name in files) == {
        "touchd_force_gelsight_mini": 1,
        "touchd_force_digit": 1,
        "touchd_sim_move": 1,
        "touchd_sim_rotate": 1,
        "octopi": 240,
        "fots_digit": 42,
        "fots_gelsight": 42,
        "taxim_gelsight": 48,
        "taxim_gelsight_mini": 24,
        "gelslim3": 39,
        "gelsight_mini_markers": 1,
        "tactile_mnist": 1,
        "gs_sdk": 3,
    }
    sensors = Counter(
        recording.sensor for recording in splits["train"] if recording.object == "touchd_sim_strip"
    )
    assert len(sensors) == 5, "nine virtual sensors of five kinds share one contact"
    assert {
        recording.sensor for recording in splits["train"] if recording.object == "sphere_4mm"
    } == {
        "digit",
        "gelsight",
        "gelsight_mini",
    }


@pytest.mark.realdata
def test_octopi_keeps_its_labels_and_split(splits: dict[str, list[Recording]]) -> None:
    octopi = {
        split: [recording for recording in recordings if recording.key.startswith("octopi/")]
        for split, recordings in splits.items()
    }
    assert len(octopi["val"]) == 21
    foil = next(recording for recording in octopi["train"] if recording.object == "aluminium_foil")
    assert foil.text == "{action} aluminium foil, moderately hard, slightly rough, small bumps"
    assert not {recording.object for recording in octopi["val"]} & {
        recording.object for recording in octopi["train"]
    }
    unranked = [recording for recording in octopi["train"] if "hardness" not in recording.labels]
    assert len(unranked) == 39
    assert all(
        recording.text == f"{{action}} {recording.object}".replace("_", " ")
        for recording in unranked
    )


@pytest.mark.realdata
def test_the_image_follows_the_force(splits: dict[str, list[Recording]]) -> None:
    """The mean change of the image rises with the normal force of the same frame."""
    for sensor in ("gelsight_mini", "digit"):
        recording = next(r for r in splits["train"] if r.key.startswith(f"touchd_force_{sensor}/"))
        assert recording.force is not None
        assert recording.no_contact is not None
        known = np.flatnonzero(np.isfinite(recording.force[:, 2]))
        still = np.median(recording.no_contact.read(range(3)), axis=0)
        change = np.abs(recording.frames.read(known.tolist()) - still).mean(axis=(1, 2, 3))
        assert np.corrcoef(change, recording.force[known, 2])[0, 1] > 0.95
        assert recording.action is not None
        assert ACTIONS.index("press") in recording.action[:60]
