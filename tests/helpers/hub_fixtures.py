"""A zoo of its own for each test: cards, weights, cache."""

import hashlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import torch
import yaml

from tactileforge.encoders.tactile_vit import TactileViT
from tactileforge.hub import cards
from tactileforge.hub.files import make_header, save_checkpoint
from tactileforge.hub.header import Header

NODE = {"name": "tactile_vit", "size": "tiny", "frames": 4, "image_size": 32}

FRONT: dict[str, Any] = {
    "title": "A model",
    "licence": "MIT",
    "paper": "none",
    "code": "",
    "sensors": ["digit"],
    "data": ["sim"],
    "frames": 4,
    "spacing": 0.05,
    "weights": [],
    "results": [],
}


def sha256(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


@pytest.fixture(scope="session")
def card_text() -> Callable[..., str]:
    """The text of a complete card, with some fields changed."""
    return lambda **changed: f"---\n{yaml.safe_dump(FRONT | changed)}---\n\nText.\n"


@pytest.fixture
def vit() -> TactileViT:
    torch.manual_seed(7)
    return TactileViT("tiny", frames=4, image_size=32).eval()


@pytest.fixture
def header(vit: TactileViT) -> Header:
    return make_header(vit, NODE, licence="MIT", spacing=0.05, name="thing.tiny")


@pytest.fixture
def checkpoint(vit: TactileViT, header: Header, tmp_path: Path) -> Path:
    path = tmp_path / "thing.safetensors"
    save_checkpoint(path, vit, header)
    return path


@pytest.fixture
def weight(checkpoint: Path) -> dict[str, Any]:
    """A row of weights in need of an address."""
    size = checkpoint.stat().st_size
    return {"tag": "tiny", "licence": "MIT", "sha256": sha256(checkpoint), "bytes": size}


@pytest.fixture
def add_card(
    card_text: Callable[..., str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Iterator[Callable[..., None]]:
    """Adds a card to an empty zoo; the cache is empty as well."""
    folder = tmp_path / "zoo"
    (folder / "recipe").mkdir(parents=True)
    monkeypatch.setattr(cards, "zoo_folder", lambda: folder)
    monkeypatch.setattr(cards, "conf_packages", list)
    monkeypatch.setenv("TACTILEFORGE_CACHE", str(tmp_path / "cache"))

    def clear() -> None:
        cards.card_names.cache_clear()
        cards.read_card.cache_clear()

    def add(name: str, **changed: Any) -> None:
        (folder / "recipe" / f"{name}.md").write_text(card_text(**changed))
        clear()

    clear()
    yield add
    clear()
