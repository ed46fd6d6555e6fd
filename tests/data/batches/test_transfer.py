"""Batches on their way to a card; stand-ins keep the order in which things are asked for."""

from contextlib import contextmanager
from typing import Any

import pytest
import torch
from torch import Tensor

from tactileforge.data.batches.transfer import Transfer, pin
from tactileforge.testing import batch as make_batch

CARD, META = torch.device("cuda", 0), torch.device("meta")


class Stream:
    """A stream with a list of the streams it waited for."""

    def __init__(self, name: str, told: list[str]) -> None:
        self.name, self.told = name, told

    def wait_stream(self, other: "Stream") -> None:
        self.told.append(f"{self.name} waits for {other.name}")


@pytest.fixture
def told(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Log of the calls to a card; its tensors are those of the meta device."""
    told: list[str] = []
    pinned: set[int] = set()
    move = Tensor.to

    @contextmanager
    def stream(used: Stream):
        told.append(f"on {used.name}")
        yield
        told.append(f"off {used.name}")

    def to(x: Tensor, where: torch.device, **options: Any) -> Tensor:
        assert id(x) in pinned
        assert options == {"non_blocking": True}
        told.append("copy")
        return move(x, META)

    def pin_memory(x: Tensor) -> Tensor:
        pinned.add(id(x))
        return x

    consumer = Stream("compute", told)
    monkeypatch.setattr(torch.cuda, "Stream", lambda device: Stream("copies", told))
    monkeypatch.setattr(torch.cuda, "stream", stream)
    monkeypatch.setattr(torch.cuda, "current_stream", lambda device: consumer)
    monkeypatch.setattr(Tensor, "to", to)
    monkeypatch.setattr(Tensor, "is_pinned", lambda x: id(x) in pinned)
    monkeypatch.setattr(Tensor, "pin_memory", pin_memory)
    monkeypatch.setattr(Tensor, "record_stream", lambda x, s: told.append(f"kept for {s.name}"))
    return told


def test_a_batch_is_copied_beside_the_computation(told: list[str]) -> None:
    batch = {"frames": torch.ones(2, 3), "force": torch.ones(2), "sensor": ["a", "b"]}
    moved = Transfer()(batch, CARD)
    assert moved["sensor"] == ["a", "b"]
    assert {moved["frames"].device, moved["force"].device} == {META}
    assert told == [
        "on copies",
        *["copy"] * 2,
        "off copies",
        "compute waits for copies",
        *["kept for compute"] * 2,
    ]


def test_what_is_pinned_stays(told: list[str]) -> None:
    batch = pin({"frames": torch.ones(2), "text": ["a"]})
    assert pin(batch)["frames"] is batch["frames"]


def test_elsewhere_a_batch_moves_as_it_is() -> None:
    batch = make_batch(size=2, frames=4, image=32)
    moved = Transfer()(batch, META)
    tensors = {key: value for key, value in batch.items() if isinstance(value, Tensor)}
    assert {moved[key].device for key in tensors} == {META}
    assert {key: value.shape for key, value in tensors.items()} == {
        key: moved[key].shape for key in tensors
    }
