from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from omegaconf import OmegaConf

from tactileforge.contracts import ACTIONS, Recording
from tactileforge.datasets.recordings import Recordings
from tactileforge.errors import DataNotFoundError

CONFIG = OmegaConf.load(Path(__file__).parents[2] / "conf/data/public_samples.yaml").data


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
    found = {split: list(data.recordings(split)) for split in ("train", "val")}
    assert data.skipped == []
    return found


@pytest.mark.realdata
def test_everything_is_found(splits: dict[str, list[Recording]]) -> None:
    # A file of its own, but a tile or a part of one counts once.
    files = {one.key.split("#")[0].split("[")[0] for found in splits.values() for one in found}
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
    sensors = Counter(one.sensor for one in splits["train"] if one.object == "touchd_sim_strip")
    assert len(sensors) == 5, "nine virtual sensors of five kinds share one contact"
    assert {one.sensor for one in splits["train"] if one.object == "sphere_4mm"} == {
        "digit",
        "gelsight",
        "gelsight_mini",
    }


@pytest.mark.realdata
def test_octopi_keeps_its_labels_and_split(splits: dict[str, list[Recording]]) -> None:
    octopi = {
        split: [one for one in found if one.key.startswith("octopi/")]
        for split, found in splits.items()
    }
    assert len(octopi["val"]) == 21
    foil = next(one for one in octopi["train"] if one.object == "aluminium_foil")
    assert foil.text == "{action} aluminium foil, moderately hard, slightly rough, small bumps"
    assert not {one.object for one in octopi["val"]} & {one.object for one in octopi["train"]}
    unranked = [one for one in octopi["train"] if "hardness" not in one.labels]
    assert len(unranked) == 39
    assert all(one.text == f"{{action}} {one.object}".replace("_", " ") for one in unranked)


@pytest.mark.realdata
def test_the_image_follows_the_force(splits: dict[str, list[Recording]]) -> None:
    """The mean change of the image rises with the normal force of the same frame."""
    for sensor in ("gelsight_mini", "digit"):
        one = next(r for r in splits["train"] if r.key.startswith(f"touchd_force_{sensor}/"))
        assert one.force is not None
        assert one.no_contact is not None
        known = np.flatnonzero(np.isfinite(one.force[:, 2]))
        still = np.median(one.no_contact.read(range(3)), axis=0)
        change = np.abs(one.frames.read(known.tolist()) - still).mean(axis=(1, 2, 3))
        assert np.corrcoef(change, one.force[known, 2])[0, 1] > 0.95
        assert one.action is not None
        assert ACTIONS.index("press") in one.action[:60]
