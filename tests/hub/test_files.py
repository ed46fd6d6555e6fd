"""One-file checkpoints: reading inverts writing, and nothing else is accepted."""

import hashlib
import json
import pickle
import random
import resource
import signal
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import torch
from bomb import Bomb
from safetensors.torch import load_file, save_file

import tactileforge
from tactileforge.encoders.tactile_vit import TactileViT
from tactileforge.errors import (
    ConfigError,
    DataError,
    DataNotFoundError,
    PluginError,
    TactileForgeError,
)
from tactileforge.hub import files
from tactileforge.hub.files import make_header, open_encoder, save_checkpoint
from tactileforge.hub.header import Header, read_header
from tactileforge.hub.size_limit import Allowance


def rewrite(path: Path, change: Callable[[dict[str, Any]], None]) -> None:
    """Changes the header of a file as another program could."""
    length = int.from_bytes(path.read_bytes()[:8], "little")
    table = json.loads(path.read_bytes()[8 : 8 + length])
    header = json.loads(table["__metadata__"]["tactileforge"])
    header.pop("sha256", None)
    change(header)
    save_file(load_file(path), path, metadata={"tactileforge": json.dumps(header)})


def test_what_is_saved_is_loaded_bit_by_bit(checkpoint: Path, vit: TactileViT) -> None:
    encoder, header = open_encoder(checkpoint)
    for key, value in vit.state_dict().items():
        assert torch.equal(encoder.state_dict()[key], value)
    assert not encoder.training
    assert not any(p.requires_grad for p in encoder.parameters())
    assert header == read_header(checkpoint)
    assert header.package == "tactileforge"
    assert header.package_version == tactileforge.__version__
    assert header.sensors == vit.sensors
    assert header.input["size"] == [32, 32]
    assert header.input["mean"] == pytest.approx([0.48145466, 0.4578275, 0.40821073])


def test_the_same_weights_give_the_same_file(
    checkpoint: Path, vit: TactileViT, header: Header, tmp_path: Path
) -> None:
    save_checkpoint(tmp_path / "again.safetensors", vit, header)
    assert (tmp_path / "again.safetensors").read_bytes() == checkpoint.read_bytes()
    assert not list(tmp_path.rglob("*.part"))


def test_loading_leaves_the_random_numbers_alone(checkpoint: Path) -> None:
    torch.manual_seed(3)
    expected = torch.rand(2)
    torch.manual_seed(3)
    open_encoder(checkpoint)
    assert torch.equal(torch.rand(2), expected)


def test_float16_halves_the_file_and_loads_as_float32(
    checkpoint: Path, vit: TactileViT, header: Header, tmp_path: Path
) -> None:
    path = tmp_path / "half.safetensors"
    save_checkpoint(path, vit, header, "float16")
    assert path.stat().st_size < 0.51 * checkpoint.stat().st_size
    encoder, stored = open_encoder(path)
    assert stored.dtype == "float16"
    for key, value in vit.state_dict().items():
        kept = encoder.state_dict()[key]
        assert kept.dtype == torch.float32
        assert torch.equal(kept, value.half().float())


def test_numbers_that_do_not_fit_are_refused(
    vit: TactileViT, header: Header, tmp_path: Path
) -> None:
    with torch.no_grad():
        vit.class_token[0] = 1e5
    save_checkpoint(tmp_path / "a.safetensors", vit, header)
    with pytest.raises(ConfigError, match=r"class_token .* float16: pack it with dtype=float32"):
        save_checkpoint(tmp_path / "b.safetensors", vit, header, "float16")
    with torch.no_grad():
        vit.class_token[0] = torch.nan
    with pytest.raises(ConfigError, match=r"class_token .* train again"):
        save_checkpoint(tmp_path / "b.safetensors", vit, header)
    with pytest.raises(ConfigError, match="float32 or float16"):
        save_checkpoint(tmp_path / "b.safetensors", vit, header, "int4")  # type: ignore[arg-type]
    assert not (tmp_path / "b.safetensors").exists()


def test_a_pickle_is_not_executed(tmp_path: Path) -> None:
    path = tmp_path / "model.safetensors"
    for write in (torch.save, lambda bomb, path: path.write_bytes(pickle.dumps(bomb))):
        write(Bomb(tmp_path / "executed"), path)
        with pytest.raises(DataError, match="a pickle, whatever its name says"):
            tactileforge.load(path)
        assert not (tmp_path / "executed").exists()
    pickle.loads(path.read_bytes())
    assert (tmp_path / "executed").exists()  # so the file did hold code


@pytest.mark.parametrize("kept", [0, 5, 300, -1])
def test_a_truncated_file(checkpoint: Path, kept: int) -> None:
    checkpoint.write_bytes(checkpoint.read_bytes()[:kept])
    with pytest.raises(DataError, match=r"truncated|expected"):
        tactileforge.load(checkpoint)


def test_other_files(tmp_path: Path, vit: TactileViT) -> None:
    path = tmp_path / "model.safetensors"
    with pytest.raises(DataNotFoundError, match="no such file"):
        tactileforge.load(f"file:{path}")
    path.write_bytes(b"not a checkpoint, but long enough to look like one")
    with pytest.raises(DataError, match="not a safetensors file"):
        tactileforge.load(path)
    path.write_bytes((8).to_bytes(8, "little") + b"{[[[[[[[")
    with pytest.raises(DataError, match="not a checkpoint that can be read"):
        tactileforge.load(path)
    nested = b'{"a":' + b"[" * 200_000
    path.write_bytes(len(nested).to_bytes(8, "little") + nested)
    with pytest.raises(DataError, match="not a checkpoint that can be read"):
        tactileforge.load(path)
    save_file(vit.state_dict(), path)
    with pytest.raises(DataError, match="not written by tactileforge"):
        tactileforge.load(path)
    save_file(vit.state_dict(), path, metadata={"tactileforge": " " * (1 << 21)})
    with pytest.raises(DataError, match="2097152 characters, at most 1048576"):
        tactileforge.load(path)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"format": 2}, "format 2; this tactileforge reads 1"),
        ({"encoder": ["tactile_vit"]}, "encoder is .*not of type"),
        ({"encoder": {"size": "tiny"}}, "encoder has no name"),
        ({"sensors": {"digit": "one"}}, "sensors is"),
        ({"spacing": "fast"}, "spacing is 'fast', which is not of type float"),
        ({"extra": 1}, "unknown key of the header 'extra'"),
    ],
)
def test_headers_at_fault_are_named(checkpoint: Path, change: dict[str, Any], message: str) -> None:
    rewrite(checkpoint, lambda header: header.update(change))
    with pytest.raises(DataError, match=message):
        read_header(checkpoint)


def test_a_missing_key_of_the_header_is_named(checkpoint: Path) -> None:
    rewrite(checkpoint, lambda header: header.pop("licence"))
    with pytest.raises(DataError, match="'licence' is missing"):
        read_header(checkpoint)


def test_a_header_that_no_reader_accepts_is_not_written(header: Header) -> None:
    with pytest.raises(ConfigError, match="at most 1048576 bytes"):
        replace(header, recipe={"x": "y" * (1 << 20)}).metadata()
    with pytest.raises(ConfigError, match="plain data"):
        replace(header, recipe={"x": Path()}).metadata()


def test_a_missing_plugin_says_what_to_install(checkpoint: Path) -> None:
    def other(own: dict[str, Any]) -> None:
        own["encoder"]["name"], own["package"] = "gel_net", "tactileforge-gelnet"

    rewrite(checkpoint, other)
    with pytest.raises(PluginError, match=r"'gel_net' .* pip install tactileforge-gelnet$"):
        tactileforge.load(checkpoint)
    rewrite(checkpoint, lambda own: own.update(package="x; rm -rf ~"))
    with pytest.raises(PluginError, match=r"pip install tactileforge-gel_net$"):
        tactileforge.load(checkpoint)


@pytest.mark.slow
def test_weights_of_another_model(checkpoint: Path, header: Header) -> None:
    deeper = TactileViT("small", frames=2, image_size=32)
    save_checkpoint(checkpoint, deeper, header)
    with pytest.raises(DataError, match=r"unexpected: transformer.*of another shape: class_token"):
        tactileforge.load(checkpoint)
    state = {key: value for key, value in deeper.state_dict().items() if "qkv" not in key}
    metadata = make_header(
        deeper,
        {"name": "tactile_vit", "size": "small", "frames": 2, "image_size": 32},
        licence="MIT",
        spacing=0.1,
    ).metadata()
    save_file(state, checkpoint, metadata=metadata)
    with pytest.raises(
        DataError, match=r"24 missing: transformer.blocks.0.attention.qkv.bias, .*\.\.\."
    ):
        tactileforge.load(checkpoint)


@pytest.mark.slow
def test_a_kill_while_packing_leaves_the_file_as_it_was(checkpoint: Path) -> None:
    """The process is killed when everything is written and not yet renamed."""
    before = checkpoint.read_bytes()
    code = (
        "import os, sys, time; from pathlib import Path; from dataclasses import replace\n"
        "from tactileforge.hub.files import open_encoder, save_checkpoint\n"
        "path = Path(sys.argv[1]); encoder, header = open_encoder(path)\n"
        "os.fsync = lambda number: (print('written', flush=True), time.sleep(60))\n"
        "save_checkpoint(path, encoder, replace(header, name='new'))\n"
    )
    command = [sys.executable, "-c", code, str(checkpoint)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout
        assert process.stdout.readline() == "written\n"
        process.send_signal(signal.SIGKILL)
    [part] = checkpoint.parent.glob(".*.part")
    assert part.stat().st_size > 0
    assert checkpoint.read_bytes() == before
    encoder, header = open_encoder(checkpoint)
    save_checkpoint(checkpoint, encoder, replace(header, name="new"))
    assert read_header(checkpoint).name == "new"
    assert not part.exists()  # its process is gone


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"name": "clip", "path": "attacker/repo", "tower": "image"}, "names no file and no addr"),
        ({"name": "clip", "path": "gpt2", "tower": "image"}, "names no file and no address"),
        ({"name": "clip", "tower": "image"}, "reads other files where it is built"),
        ({"size": "../../etc"}, "names no file and no address"),
        ({"pixels": {"filter": "https://a"}}, "names no file and no address"),
        ({"image_size": 10**9}, "larger than in any model"),
        ({"depth": float("inf")}, "larger than in any model"),
        ({"image_size": 8192, "patch": 4}, r"has [\d,]+ numbers, and the file [\d,]+ bytes"),
        ({"depth": 99, "size": "large"}, r"depth is 99, and the file has 81 tensors"),
        ({"size": "large"}, r"has [\d,]+ numbers, and the file [\d,]+ bytes"),
    ],
    ids=str,
)
def test_a_header_leads_nowhere_and_is_bounded(
    checkpoint: Path, monkeypatch: pytest.MonkeyPatch, change: dict[str, Any], said: str
) -> None:
    seen: list[Allowance] = []

    def watch(path: Path) -> Allowance:
        seen.append(Allowance(path))
        return seen[-1]

    monkeypatch.setattr(files, "Allowance", watch)
    header = read_header(checkpoint)
    node = change if "name" in change else header.encoder | change
    state = load_file(checkpoint)
    metadata = {"tactileforge": json.dumps(vars(header) | {"encoder": node})}
    save_file(state, checkpoint, metadata=metadata)
    with pytest.raises(DataError, match=said):
        tactileforge.load(checkpoint)
    most = checkpoint.stat().st_size + (1 << 24)
    # the last count is of what was refused, before there was memory for it
    assert all(one.made - one.refused <= most for one in seen), "little memory was taken"


@pytest.mark.slow
def test_a_flipped_bit_is_named(checkpoint: Path) -> None:
    raw = checkpoint.read_bytes()
    length = 8 + int.from_bytes(raw[:8], "little")
    rng = random.Random(0)
    bits = [rng.randrange(8 * length) for _ in range(150)]
    bits += [rng.randrange(8 * length, 8 * len(raw)) for _ in range(50)]
    place = raw.index(b'sha256\\": \\"')
    bits += range(8 * place, 8 * (place + 80), 5)  # every byte, and each bit of eight of them
    for bit in bits:
        flipped = bytearray(raw)
        flipped[bit // 8] ^= 1 << bit % 8
        checkpoint.write_bytes(flipped)
        with pytest.raises(DataError, match=checkpoint.name):
            open_encoder(checkpoint)
    checkpoint.write_bytes(raw)
    open_encoder(checkpoint)


def test_the_checksum_is_that_of_the_file_with_zeros_in_its_place(checkpoint: Path) -> None:
    raw = checkpoint.read_bytes()
    table = json.loads(raw[8 : 8 + int.from_bytes(raw[:8], "little")])
    stated = json.loads(table["__metadata__"]["tactileforge"])["sha256"]
    assert raw.count(stated.encode()) == 1
    zeros = raw.replace(stated.encode(), b"0" * 64)
    assert hashlib.sha256(zeros).hexdigest() == stated


def test_a_full_disk_is_named_and_leaves_the_file_as_it_was(
    checkpoint: Path, vit: TactileViT, header: Header, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        sys, "dont_write_bytecode", True
    )  # a compiled file that is cut would break later imports
    before, limits = checkpoint.read_bytes(), resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (len(before) // 2, limits[1]))
    try:
        with pytest.raises(TactileForgeError, match=r"thing\.safetensors: .*make room"):
            save_checkpoint(checkpoint, vit, header)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert checkpoint.read_bytes() == before
    assert not list(checkpoint.parent.glob("*.part"))
    assert not list(checkpoint.parent.glob(".*.part"))
