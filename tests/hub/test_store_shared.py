"""The store under several people and processes, on full or read-only disks."""

import json
import os
import resource
import subprocess
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import torch
from safetensors.torch import load_file, save_file

import tactileforge
from tactileforge.encoders.tactile_vit import TactileViT
from tactileforge.errors import DataError
from tactileforge.hub import cards, store
from tactileforge.hub.files import save_checkpoint
from tactileforge.hub.header import Header, read_header
from tactileforge.util.files import new_part

AddCard = Callable[..., None]


@pytest.mark.parametrize("mask", [0o022, 0o077, 0o007])
def test_files_are_as_readable_as_the_umask_says(
    vit: TactileViT, header: Header, tmp_path: Path, mask: int
) -> None:
    before = os.umask(mask)
    try:
        save_checkpoint(tmp_path / "a.safetensors", vit, header)
    finally:
        os.umask(before)
    assert (tmp_path / "a.safetensors").stat().st_mode & 0o777 == 0o666 & ~mask


@pytest.mark.slow
def test_two_imports_at_once_and_loads_meanwhile(
    add_card: AddCard, vit: TactileViT, header: Header, tmp_path: Path
) -> None:
    weight = {"tag": "tiny", "licence": "MIT", "layout": "anytouch2", "source": "their page"}
    add_card("thing", weights=[weight])
    card, row = cards.find_card("thing")
    files = []
    for number in range(6):
        with torch.no_grad():
            vit.class_token.fill_(number)
        files.append(tmp_path / f"{number}.safetensors")
        save_checkpoint(files[-1], vit, header)

    def keep(number: int) -> None:
        with new_part(store.weights_folder() / "thing.tiny.safetensors") as part:
            part.write_bytes(files[number].read_bytes())
            store.keep_import(card, row, part, files[number].name, "")

    keep(0)
    over, failures, loads = threading.Event(), [], []

    def load() -> None:
        while not over.is_set():
            try:
                loads.append(float(tactileforge.load("thing").encoder.class_token[0]))
            except Exception as error:
                failures.append(error)

    def imports(first: int) -> None:
        for turn in range(8):
            keep((first + 2 * turn) % 6)

    reader = threading.Thread(target=load)
    writers = [threading.Thread(target=imports, args=(number,)) for number in (0, 1)]
    for thread in (reader, *writers):
        thread.start()
    for thread in writers:
        thread.join()
    while not loads and not failures:
        over.wait(0.05)
    over.set()
    reader.join()
    assert failures == []
    assert set(loads) <= set(range(6))
    assert float(tactileforge.load("thing").encoder.class_token[0]) in range(6)


def test_weights_that_are_not_numbers_are_refused(checkpoint: Path) -> None:
    state = load_file(checkpoint)
    state["norm_out.weight"][3] = torch.nan
    metadata = read_header(checkpoint).metadata()
    save_file(state, checkpoint, metadata=metadata)
    with pytest.raises(DataError, match=r"1 not finite: norm_out\.weight$"):
        tactileforge.load(checkpoint)


@pytest.mark.parametrize("change", [{"depth": 8000}, {"depth": 1_000_000}, {"depth": 400}])
def test_a_header_of_many_blocks_costs_no_memory(
    checkpoint: Path, monkeypatch: pytest.MonkeyPatch, change: dict[str, Any]
) -> None:
    """Not even modules without numbers are made of it: a file has a tensor for each."""
    header = read_header(checkpoint)
    metadata = {"tactileforge": json.dumps(vars(header) | {"encoder": header.encoder | change})}
    save_file(load_file(checkpoint), checkpoint, metadata=metadata)
    monkeypatch.setattr("tactileforge.plugins.registry.build", pytest.fail)
    with pytest.raises(DataError, match=r"larger than in any model|and the file has \d+ tensors"):
        tactileforge.load(checkpoint)


@pytest.mark.slow
def test_a_disk_that_is_full_is_one_line(checkpoint: Path, tmp_path: Path) -> None:
    """A limit on the size of files stands for a disk."""
    code = (
        "import resource, signal, sys\n"
        "from tactileforge.hub.files import open_encoder, save_checkpoint\n"
        "from tactileforge.errors import DataError\n"
        "signal.signal(signal.SIGXFSZ, signal.SIG_IGN)\n"
        "encoder, header = open_encoder(sys.argv[1])\n"
        "sys.dont_write_bytecode = True\n"
        "resource.setrlimit(resource.RLIMIT_FSIZE, (1 << 20, 1 << 20))\n"
        "try: save_checkpoint(sys.argv[2], encoder, header)\n"
        "except DataError as error: print(error)\n"
    )
    target = tmp_path / "out" / "a.safetensors"
    command = [sys.executable, "-c", code, str(checkpoint), str(target)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert resource.RLIMIT_FSIZE >= 0
    [line] = done.stdout.splitlines()
    assert line.startswith(f"{target}: cannot be written (")
    assert "make room" in line
    assert list(target.parent.iterdir()) == []


def test_a_folder_that_cannot_be_made_is_one_line(
    add_card: AddCard,
    weight: dict[str, Any],
    checkpoint: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("TACTILEFORGE_CACHE", str(tmp_path / "file" / "cache"))
    add_card("thing", weights=[weight | {"url": checkpoint.as_uri()}])
    with pytest.raises(
        DataError, match=r"cannot be written \(Not a directory\); .*_CACHE"
    ) as found:
        tactileforge.load("thing")
    assert "\n" not in str(found.value)
