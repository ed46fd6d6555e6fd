"""Runs and published files become one-file checkpoints."""

import shutil
from collections.abc import Callable
from functools import partial
from pathlib import Path

import pytest
import torch
from tactileforge_bench.fit.models import model_entry
from tactileforge_export import export

import tactileforge
from tactileforge.api import train
from tactileforge.cli import dispatch
from tactileforge.cli._compose import compose
from tactileforge.errors import ConfigError, DataError, DataNotFoundError
from tactileforge.hub import files, pack, runs
from tactileforge.hub.header import read_header
from tactileforge.runs.checkpoint_file import find_checkpoint, read_checkpoint, seal
from tactileforge.runs.folder import BEST

SMALL = ["encoder.image_size=32", "batch.size=4", "data.scenes=3", "data.val=1", "data.size=32"]

main = partial(dispatch, "zoo")
AddCard = Callable[..., None]


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("run")
    train(compose("anytouch2", ["scale=demo", "debug=steps", "objective=[pixel]", *SMALL]), folder)
    return folder


@pytest.mark.slow
def test_a_run_is_packed_and_loaded(run: Path, tmp_path: Path) -> None:
    path = pack.pack_run(run, tmp_path / "a.safetensors", name="mine.tiny", licence="CC0-1.0")
    model = tactileforge.load(path)
    state = read_checkpoint(run)["state_dict"]
    for key, value in model.encoder.state_dict().items():
        assert torch.equal(value, state[f"encoder.{key}"])
    header = model.header
    assert (header.name, header.licence) == ("mine.tiny", "CC0-1.0")
    assert header.source == {"steps": 2, "encoder": "trained"}
    assert header.spacing == pytest.approx(1 / 15, abs=1e-3)
    assert header.recipe["objective"].keys() == {"pixel"}
    assert header.data["name"] == "sim"
    assert header.versions["torch"] == torch.__version__
    assert header.sensors == {"gelsight": 0, "digit": 1, "gelsight_mini": 3}  # not the others
    assert model.sensors == list(header.sensors)
    assert len(header.commit.removesuffix("-dirty")) in (0, 40)


def test_a_run_is_loaded_as_it_would_be_packed(run: Path, tmp_path: Path) -> None:
    packed = tactileforge.load(pack.pack_run(run, tmp_path / "a.safetensors"))
    for model in (tactileforge.load(f"run:{run}"), tactileforge.load(run)):
        assert model.header == packed.header
        assert model.fingerprint == packed.fingerprint
        assert not model.training
        assert not any(weight.requires_grad for weight in model.parameters())
    with pytest.warns(UserWarning, match="pixels a side"):
        assert tactileforge.load(run, image_size=64).encoder.image_size == (64, 64)


@pytest.mark.parametrize("name", ["run", "file", "hf"])
def test_a_folder_may_be_called_as_a_prefix(
    name: str, run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / name).symlink_to(run)
    monkeypatch.chdir(tmp_path)
    assert tactileforge.load(name).fingerprint == tactileforge.load(run).fingerprint


def test_folders_that_are_no_runs(run: Path, tmp_path: Path) -> None:
    with pytest.raises(DataNotFoundError, match="give the folder of a run"):
        tactileforge.load(tmp_path)
    with pytest.raises(DataNotFoundError, match="give the folder of a run"):
        tactileforge.load(f"run:{tmp_path / 'nowhere'}")
    with pytest.raises(DataNotFoundError, match=f"say so: run:{run}"):
        tactileforge.load(f"file:{run}")
    with pytest.raises(DataNotFoundError, match="give the folder of a run"):
        tactileforge.load(str(tmp_path))


@pytest.mark.slow
def test_the_best_weights_of_a_run_are_loaded(run: Path, tmp_path: Path) -> None:
    copy = tmp_path / "copy"
    shutil.copytree(run, copy)
    last = find_checkpoint(copy)
    best = copy / BEST
    with pytest.raises(DataNotFoundError, match=r"no best weights; train with trainer\.keep_best"):
        tactileforge.load(f"run:{copy}@best")
    kept = torch.load(last, weights_only=True)
    for key, value in kept["state_dict"].items():
        if key.startswith("encoder.") and value.is_floating_point():
            kept["state_dict"][key] = value + 1
    with best.open("wb+") as file:
        torch.save(kept, file)
        seal(file)
    first = tactileforge.load(f"run:{copy}").encoder.state_dict()
    for given in (f"run:{copy}@best", Path(f"{copy}@best"), pack.pack_run(f"{copy}@best")):
        found = tactileforge.load(given).encoder.state_dict()
        assert all(
            torch.equal(found[key], x + 1 if x.is_floating_point() else x)
            for key, x in first.items()
        )
    # and where commands take a run: zoo pack, init= of a new run, bench and export
    assert main(["pack", f"run:{copy}@best", "--out", str(tmp_path / "best.safetensors")]) == 0
    new = tmp_path / "new"
    words = ["scale=demo", "debug=steps", "objective=[pixel]", "trainer.max_steps=1", *SMALL]
    train(compose("anytouch2", [*words, "optim.lr=0", f"init={copy}@best"]), new)
    export(f"run:{copy}@best", tmp_path / "best.pt2", format="torch_export", size=(32, 32))
    exported = torch.export.load(tmp_path / "best.pt2").state_dict
    states = {
        "pack": tactileforge.load(tmp_path / "best.safetensors").encoder.state_dict(),
        "init": tactileforge.load(f"run:{new}").encoder.state_dict(),
        "bench": model_entry(f"run:{copy}@best").open[0]().encoder.state_dict(),
        "export": {key.removeprefix("encoder."): value for key, value in exported.items()},
    }
    weight = next(key for key, x in first.items() if x.is_floating_point() and x.ndim > 1)
    for name, state in states.items():
        assert torch.allclose(state[weight], first[weight] + 1), name
    best.unlink()
    for word in (f"init={copy}@best", f"init=run:{copy}@best"):
        with pytest.raises(DataNotFoundError, match=r"no best weights; train with trainer\.keep_"):
            train(compose("anytouch2", [*words, word]), tmp_path / "other")


@pytest.mark.slow
def test_a_miniature_that_is_trained_twice_is_the_same_file(run: Path, tmp_path: Path) -> None:
    again = tmp_path / run.name
    train(compose("anytouch2", ["scale=demo", "debug=steps", "objective=[pixel]", *SMALL]), again)
    files = [pack.pack_run(path, tmp_path / f"{i}.bin") for i, path in enumerate((run, again))]
    assert files[0].read_bytes() == files[1].read_bytes()


@pytest.mark.slow
@pytest.mark.parametrize("objective", ["jepa", "dino"])
def test_the_slow_copy_is_what_is_packed(objective: str, tmp_path: Path) -> None:
    recipe = {"jepa": "vjepa", "dino": "dino"}[objective]
    train(compose(recipe, ["scale=demo", "debug=steps", *SMALL]), tmp_path)
    state = read_checkpoint(tmp_path)["state_dict"]
    places = {"slow": f"heads.{objective}.target.network", "trained": "encoder"}
    for encoder, kind in ((None, "slow"), ("slow", "slow"), ("trained", "trained")):
        model = tactileforge.load(pack.pack_run(tmp_path, encoder=encoder))
        assert model.header.source == {"steps": 2, "encoder": kind}
        for key, value in model.encoder.state_dict().items():
            assert torch.equal(value, state[f"{places[kind]}.{key}"])
    norm = "norm_out.weight"
    assert not torch.equal(state[f"encoder.{norm}"], state[f"{places['slow']}.{norm}"])


def test_no_slow_copy_and_several(run: Path) -> None:
    with pytest.raises(ConfigError, match=r"found none; give encoder=trained"):
        pack.pack_run(run, encoder="slow")
    with pytest.raises(ConfigError, match="unknown encoder 'slw'; did you mean 'slow'"):
        pack.pack_run(run, encoder="slw")  # type: ignore[arg-type]
    state = {"encoder.norm.w": torch.ones(1), "heads.a.target.network.norm.w": torch.zeros(1)}
    other = {"heads.b.target.network.norm.w": torch.zeros(1)}
    part = {"heads.c.target.network.head.norm.w": torch.zeros(1)}
    assert runs._choose(state | part, None, run) == ("slow", {"norm.w": torch.zeros(1)})
    with pytest.raises(ConfigError, match=r"found heads.a.target, heads.b.target; give"):
        runs._choose(state | other, None, run)


def test_the_default_place_is_the_run(run: Path) -> None:
    half = pack.pack_run(run, dtype="float16")
    assert half == run / "model.safetensors"
    assert read_header(half).dtype == "float16"


def test_folders_of_the_machine_stay_there(run: Path, tmp_path: Path) -> None:
    copy = tmp_path / "run"
    shutil.copytree(run, copy)
    config = copy / "config.yaml"
    changed = config.read_text().replace("init: null", "init: /home/ada/secret/runs/first")
    config.write_text(changed.partition("\n")[2])  # without its checksum
    path = pack.pack_run(copy)
    assert read_header(path).recipe["init"] == "first"
    assert read_header(path).recipe["data"] == read_header(pack.pack_run(run)).recipe["data"]
    assert b"/home/ada" not in path.read_bytes()


def test_only_absolute_paths_are_cut() -> None:
    config = {"a": ["/x/y", "~ada/y", "C:\\x\\y"], "b": "x/y", "c": "s3://x/y", "d": 1}
    kept = {"a": ["y", "y", "y"], "b": "x/y", "c": "s3://x/y", "d": 1}
    assert files.without_folders(config) == kept


def test_what_is_no_run(run: Path, tmp_path: Path) -> None:
    with pytest.raises(DataNotFoundError, match="give the folder of a run"):
        pack.pack_run(tmp_path)
    (tmp_path / "config.yaml").write_text("model: x\n")
    with pytest.raises(DataError, match="not the configuration of a run"):
        pack.pack_run(tmp_path)
    copy = tmp_path / "run"
    shutil.copytree(run, copy)
    config = copy / "config.yaml"
    changed = config.read_text().replace("image_size: 32", "image_size: 48")
    config.write_text(changed)
    with pytest.raises(DataError, match="its checksum does not match"):
        pack.pack_run(copy)
    config.write_text(changed.partition("\n")[2])
    with pytest.raises(DataError, match=r"of another shape: position \("):
        pack.pack_run(copy)
    (copy / "checkpoints" / "last.ckpt").unlink()
    with pytest.raises(DataNotFoundError, match="no checkpoint"):
        pack.pack_run(copy)
