"""Four kinds of public recordings and the simulator, packed, train the recipe as one mixture."""

import csv
from pathlib import Path

import pytest
import yaml
from tactileforge_sim.dataset import Sim

from tactileforge import cli
from tactileforge.cli._compose import compose
from tactileforge.data.batches.datamodule import TouchData
from tactileforge.datasets.mixture import Mixture
from tactileforge.datasets.recordings import Recordings
from tactileforge.packing import PackOptions, pack

SOURCES = {
    "touchd_force": ("touchd_force_gelsight_mini", "touchd_force_digit"),
    "touchd_sim": ("touchd_sim_move",),
    "octopi": ("octopi",),
    "presses": ("fots_digit", "fots_gelsight", "taxim_gelsight", "taxim_gelsight_mini"),
}


@pytest.fixture(scope="module")
def packed(realdata: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("packed")
    layouts = compose(overrides=["data=public_samples", f"data.root={realdata}"]).data.layouts
    options = PackOptions(size=64, shard_frames=500, processes=1)
    for name, chosen in SOURCES.items():
        plain = yaml.safe_load(yaml.safe_dump({key: _plain(layouts[key]) for key in chosen}))
        if name == "octopi":
            plain[name] |= {"videos": "[ab]*_0.mov", "hold_out": "recording"}  # a few, to be quick
        data = Recordings(str(realdata), layouts=plain, val=0.2)
        assert pack(data, name, folder / name, options).splits["train"]
    pack(Sim(scenes=3, val=1, size=32), "sim", folder / "sim", options)
    return folder


def _plain(node: object) -> object:
    from omegaconf import OmegaConf

    return OmegaConf.to_container(node)


@pytest.mark.realdata
@pytest.mark.slow
def test_every_batch_holds_each_of_five_sources_and_its_share_of_force(packed: Path) -> None:
    names = [*SOURCES, "sim"]
    mixed = Mixture({name: {"name": "shards", "root": str(packed / name)} for name in names})
    data = TouchData(mixed, 4, (32, 32), 32, workers=0, shares={"force": 0.25}, match=0.25)
    data.setup()
    stream = data.stream()
    counts = [track.count for track in stream.tracks]
    assert min(counts) >= 1
    assert sum(counts) == 24
    for number in range(4):
        batch = stream[number]
        assert (batch["group"][:8] >= -1).all()
        assert (batch["group"] >= 0).sum() in (7, 8)  # one clip may keep the size of the batch
        assert batch["force_valid"].all(1).sum() >= 6
        assert batch["skipped"] == {}
    assert set(data.summary("train").sensors) >= {"digit", "gelsight", "gelsight_mini", "duragel"}


@pytest.mark.realdata
@pytest.mark.slow
def test_the_recipe_trains_on_them(packed: Path, tmp_path: Path) -> None:
    words = ["train", "scale=demo", "data=mixture", f"hydra.run.dir={tmp_path}"]
    for name in [*SOURCES, "sim"]:
        words += [f"+data@data.sources.{name}=shards", f"data.sources.{name}.root={packed / name}"]
    words += ["batch.shares.force=0.25", "batch.workers=1", "trainer.max_steps=6"]
    words += ["encoder.image_size=32", "trainer.log_every_n_steps=1"]
    words += ["trainer.val_check_interval=6"]
    assert cli.run(words) == 0
    (table,) = tmp_path.glob("metrics.csv")
    rows = list(csv.DictReader(table.read_text().splitlines()))
    for objective in ("pixel", "diff", "align", "match", "force"):
        assert len([row for row in rows if row[f"train/{objective}"]]) >= 3
    report = (tmp_path / "report.html").read_text().replace("<wbr>", "")
    assert "GeWu-Lab/AnyTouch2" in report
    assert "simulated by tactileforge" in report
