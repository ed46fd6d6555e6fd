"""Classes named by a head, against a head of known answers."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch
from torch import nn

from tactileforge.data.labels.objects import object_class
from tactileforge.heads.classify import ClassifyHead
from tactileforge.report import classes
from tactileforge.report.classes import class_results, classes_section

NAMES = ["bar", "disc", "ring"]


class Reader:
    """Clips of one frame, each with a vector along the axis of the class to name."""

    def __init__(self, own: list[str | None], said: list[str]) -> None:
        self._vectors = 3 * np.eye(3, dtype=np.float32)[[NAMES.index(name) for name in said]]
        recordings = [SimpleNamespace(key=f"<{i}>", object=name) for i, name in enumerate(own)]
        index = np.stack([np.arange(len(own)), np.zeros(len(own), int)], 1)
        self.clips = SimpleNamespace(recordings=recordings, index=index)

    def embed(self, which: list[int]) -> Any:
        return SimpleNamespace(clips=np.unique(which))

    def vectors(self, which: list[int]) -> np.ndarray:
        return self._vectors[which]


def module() -> Any:
    head = ClassifyHead(SimpleNamespace(projected=3), classes=32)
    with torch.no_grad():
        head.linear.weight.zero_()
        for axis, name in enumerate(NAMES):
            head.linear.weight[object_class(name, 32), axis] = 1
    made: Any = nn.Module()
    made.heads, made.device = nn.ModuleDict({"classify": head}), torch.device("cpu")
    return made


@pytest.fixture(autouse=True)
def pictures(monkeypatch: pytest.MonkeyPatch) -> None:
    def read(module: Any, clips: Any, which: list[int]) -> Any:
        yield {"frames": torch.zeros(len(which), 2, 3, 8, 8), "clip": torch.tensor(which)}

    monkeypatch.setattr(classes, "batches", read)


def test_classes_are_counted_and_the_wrong_ones_shown() -> None:
    own = ["bar", "bar", "disc", "ring", "unseen", None]
    reader: Any = Reader(own, ["bar", "disc", "disc", "ring", "bar", "bar"])
    (result,) = class_results(module(), "val", reader, NAMES, 100)
    assert (result.own, result.said) == (own[:4], ["bar", "disc", "disc", "ring"])
    assert (result.accuracy, result.guess, result.wrong) == (0.75, 0.5, [1])
    assert result.probability[0] == pytest.approx(float(torch.tensor([3.0, 0, 0]).softmax(0)[0]))
    assert result.line.startswith("Classes: 75 % of 4 validation clips are named right, of 3 ")
    body = classes_section([result], reader.clips).body
    assert '<th scope="row">bar</th><td data-head="bar">1</td><td data-head="disc">1</td>' in body
    assert "bar, named disc" in body
    assert "91 % sure: &lt;1&gt;" in body
    assert body.count("<img") == 1


def test_without_a_head_or_a_clip_of_a_known_class_there_is_no_result() -> None:
    reader: Any = Reader(["unseen", None], ["bar", "bar"])
    assert class_results(module(), "val", reader, NAMES, 100) == []
    made = module()
    made.heads = nn.ModuleDict()
    assert class_results(made, "val", Reader(["bar"], ["bar"]), NAMES, 9) == []  # type: ignore[arg-type]
