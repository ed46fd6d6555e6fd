"""Files as people download them: read without running anything, or refused for a reason."""

import argparse
import collections
import importlib
import pickle
import sys
import zipfile
from pathlib import Path
from types import ModuleType

import pytest
import torch
from bomb import Bomb
from omegaconf import OmegaConf
from safetensors.torch import save_file
from tactileforge_published import read_tensors

from tactileforge.errors import DataError, DataNotFoundError

STATE = {"a.weight": torch.arange(6.0).view(2, 3), "a.bias": torch.ones(2)}


def same(tensors: dict[str, torch.Tensor]) -> bool:
    return tensors.keys() == STATE.keys() and all(torch.equal(tensors[k], STATE[k]) for k in STATE)


@pytest.mark.parametrize(
    "content",
    [
        STATE,
        {"model": STATE, "optimizer": {"state": {}}, "epoch": 3},
        {"state_dict": STATE, "global_step": 7},
        {"state_dict": {f"module.{key}": x for key, x in STATE.items()}},
        {"model": STATE, "args": argparse.Namespace(lr=1e-3, output_dir="log")},
    ],
    ids=["flat", "model", "state_dict", "module", "namespace"],
)
def test_containers(tmp_path: Path, content: object) -> None:
    torch.save(content, tmp_path / "file.pth")
    assert same(read_tensors(tmp_path / "file.pth"))


def test_safetensors_and_the_old_format_of_torch(tmp_path: Path) -> None:
    save_file(STATE, tmp_path / "file.safetensors")
    torch.save(STATE, tmp_path / "old.pth", _use_new_zipfile_serialization=False)
    assert same(read_tensors(tmp_path / "file.safetensors"))
    assert same(read_tensors(tmp_path / "old.pth"))


def test_objects_of_a_training_program_are_left_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Sparsh's checkpoints hold its schedule, and with it the optimiser; neither is imported."""
    name = "tactile_ssl.model.custom_scheduler"
    module = ModuleType(name)
    kind = type("WarmupCosineScheduler", (), {"__module__": name})
    monkeypatch.setattr(module, "WarmupCosineScheduler", kind, raising=False)
    for part in ("tactile_ssl", "tactile_ssl.model", name):
        monkeypatch.setitem(sys.modules, part, module)
    schedule = kind()
    schedule.__dict__ |= {"optimizer": torch.optim.AdamW([torch.nn.Parameter(torch.ones(2))])}
    torch.save({"model": STATE, "scheduler": {"scheduler": schedule}}, tmp_path / "file.ckpt")
    for part in ("tactile_ssl", "tactile_ssl.model", name):
        monkeypatch.delitem(sys.modules, part)
    with pytest.raises(ModuleNotFoundError):
        torch.load(tmp_path / "file.ckpt", weights_only=False)
    assert same(read_tensors(tmp_path / "file.ckpt"))
    assert name not in sys.modules


def test_an_optimiser_that_has_stepped_and_hyper_parameters(tmp_path: Path) -> None:
    """Its state is a `collections.defaultdict`; Lightning keeps OmegaConf's objects as they are."""
    weight = torch.nn.Parameter(torch.ones(2))
    optimizer = torch.optim.AdamW([weight])
    weight.sum().backward()
    optimizer.step()
    given = OmegaConf.create({"lr": 1e-3, "sizes": [1, 2], "name": "x", "nested": {"a": None}})
    content = {
        "state_dict": STATE,
        "optimizer": optimizer,
        "seen": collections.defaultdict(list, {"a": [1]}),
        "best": collections.Counter("aab"),
        "hyper_parameters": given,
        "path": Path("runs"),
        "numbers": {1, 2},
    }
    for zipped in (True, False):
        torch.save(content, tmp_path / "a.ckpt", _use_new_zipfile_serialization=zipped)
        assert same(read_tensors(tmp_path / "a.ckpt"))


def test_the_old_format_with_a_namespace(tmp_path: Path) -> None:
    content = {"model": STATE, "args": argparse.Namespace(lr=1e-3, dirs=["log"], path=Path("a"))}
    torch.save(content, tmp_path / "old.pth", _use_new_zipfile_serialization=False)
    assert same(read_tensors(tmp_path / "old.pth"))


@pytest.mark.parametrize("zipped", [True, False])
@pytest.mark.parametrize("name", ["builtins.eval", "builtins.getattr", "torch.load", "os.getcwd"])
def test_names_that_make_no_tensor_are_refused(tmp_path: Path, name: str, zipped: bool) -> None:
    module, _, attribute = name.rpartition(".")
    found = getattr(importlib.import_module(module), attribute)
    torch.save({"model": STATE, "x": found}, tmp_path / "a.pth",
               _use_new_zipfile_serialization=zipped)  # fmt: skip
    with pytest.raises(DataError, match=r"GLOBAL \w+(\.\w+)* is not a tensor"):
        read_tensors(tmp_path / "a.pth")


def test_a_program_of_torchscript_is_refused(tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "a.pt", "w") as archive:
        archive.writestr("a/constants.pkl", b"")
        archive.writestr("a/data.pkl", b"")
    with pytest.raises(DataError, match="a program of TorchScript"):
        read_tensors(tmp_path / "a.pt")


@pytest.mark.parametrize("name", ["a.bin", "a.pth", "a.ckpt", "a"])
def test_safetensors_by_any_suffix(tmp_path: Path, name: str) -> None:
    save_file(STATE, tmp_path / name)
    assert same(read_tensors(tmp_path / name))


def test_a_flipped_bit_is_found(tmp_path: Path) -> None:
    """Every 97th byte of the file: none of them gives other numbers without a word."""
    torch.save({"a": torch.arange(500.0)}, tmp_path / "a.pth")
    whole = (tmp_path / "a.pth").read_bytes()
    place = whole.index(torch.arange(500.0).numpy().tobytes()[40:60])
    said = []
    for byte in (place, *range(0, len(whole), 97)):
        data = bytearray(whole)
        data[byte] ^= 16
        (tmp_path / "a.pth").write_bytes(data)
        try:
            assert torch.equal(read_tensors(tmp_path / "a.pth")["a"], torch.arange(500.0)), byte
        except DataError as error:
            said.append(str(error))
    assert "is not what its checksum says; download it again" in said[0]


@pytest.mark.parametrize("beside_weights", [True, False])
def test_a_pickle_that_would_run_code_is_refused(tmp_path: Path, beside_weights: bool) -> None:
    mark, file = tmp_path / "mark", tmp_path / "file.pth"
    bomb = Bomb(mark)
    if beside_weights:
        torch.save({"model": STATE, "args": bomb}, file)
    else:
        file.write_bytes(pickle.dumps(bomb))
    with pytest.raises(DataError, match=r"file\.pth cannot be read as tensors .*was run"):
        read_tensors(file)
    assert not mark.exists()
    if beside_weights:
        torch.load(file, weights_only=False)
    else:
        pickle.loads(file.read_bytes())
    assert mark.exists()  # it would have


@pytest.mark.parametrize("name", ["file.pth", "file.safetensors"])
def test_a_truncated_file_is_refused(tmp_path: Path, name: str) -> None:
    whole = {"a": torch.zeros(1000)}
    path = tmp_path / name
    save_file(whole, path) if path.suffix == ".safetensors" else torch.save(whole, path)
    path.write_bytes(path.read_bytes()[:-500])
    with pytest.raises(DataError, match=name):
        read_tensors(path)


@pytest.mark.parametrize(
    ("content", "found"),
    [
        ({"epoch": 3, "name": "x"}, "a dict of epoch, name"),
        ([torch.zeros(2)], "list"),
        (torch.zeros(2), "Tensor"),
        ({"model": {}}, "a dict of nothing"),
    ],
)
def test_what_holds_no_weights_is_refused(tmp_path: Path, content: object, found: str) -> None:
    torch.save(content, tmp_path / "file.pth")
    with pytest.raises(DataError, match=f"holds {found}: expected a dict of tensors"):
        read_tensors(tmp_path / "file.pth")


def test_what_is_no_checkpoint_is_refused(tmp_path: Path) -> None:
    (tmp_path / "page.pth").write_text("<html>Sign in to download</html>")
    with pytest.raises(DataError, match=r"page\.pth cannot be read as tensors"):
        read_tensors(tmp_path / "page.pth")
    with pytest.raises(DataNotFoundError, match=r"no checkpoint at .*none\.pth"):
        read_tensors(tmp_path / "none.pth")


def test_the_folder_of_t3(tmp_path: Path) -> None:
    with pytest.raises(DataNotFoundError, match=r"without trunk\.pth"):
        read_tensors(tmp_path)
    (tmp_path / "encoders").mkdir()
    torch.save({"norm.weight": torch.ones(2)}, tmp_path / "trunk.pth")
    for stem in ("mini", "digit"):
        torch.save({"cls_token": torch.ones(3)}, tmp_path / "encoders" / f"{stem}.pth")
    assert set(read_tensors(tmp_path)) == {
        "trunk.norm.weight",
        "encoders.mini.cls_token",
        "encoders.digit.cls_token",
    }
