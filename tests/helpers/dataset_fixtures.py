"""Fixtures of readers of data sets: small videos, images and texts, and their conformance."""

from collections.abc import Callable, Iterable
from inspect import signature
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image
from videos import greys, write_video

from tactileforge.plugins import registry
from tactileforge.reading.published import PublishedDataset
from tactileforge.testing import check

MakeVideo = Callable[..., Path]


def _picture(i: int, size: tuple[int, int]) -> NDArray[np.uint8]:
    """A grey picture with its number as level: 7 i."""
    return np.full((*size, 3), min(7 * i, 255), np.uint8)


@pytest.fixture
def make_video(tmp_path: Path) -> MakeVideo:
    """Writes a video with grey level 7 i in frame ``i``; the path is from tmp_path."""

    def make(name: str, count: int = 30, size: tuple[int, int] = (32, 48), fps: float = 30) -> Path:
        return write_video(tmp_path / name, greys(count, 7, size), fps)

    return make


@pytest.fixture
def make_image(tmp_path: Path) -> MakeVideo:
    """Writes an image of grey level 7 i; the path is from tmp_path."""

    def make(name: str, i: int = 0, size: tuple[int, int] = (32, 48)) -> Path:
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        Image.fromarray(_picture(i, size)).save(path)
        return path

    return make


@pytest.fixture
def write(tmp_path: Path) -> Callable[[str, str], Path]:
    """Writes a text file; the path is from tmp_path."""

    def make(name: str, text: str) -> Path:
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
        return path

    return make


@pytest.fixture
def make_images(make_image: MakeVideo) -> Callable[..., None]:
    """Writes numbered images; image i is of grey level 7 i."""

    def make(pattern: str, numbers: Iterable[int], size: tuple[int, int] = (24, 32)) -> None:
        for i in numbers:
            make_image(pattern.format(i), i, size)

    return make


@pytest.fixture
def conforms() -> Callable[..., None]:
    """Runs the conformance suite on a data set and its options; published ones are recognised."""

    def run(dataset: type, **options: Any) -> None:
        if issubclass(dataset, PublishedDataset):
            _is_recognised(dataset, Path(options["root"]))
        results = check("dataset", dataset, **options)
        assert [result for result in results if result.status == "failed"] == []
        assert sum(result.status == "ran" for result in results) >= 8

    return run


def _is_recognised(reader: type[PublishedDataset], root: Path) -> None:
    """No other published reader of the core is surer of a folder."""
    guesses = {}
    for name in registry.names("datasets"):
        other = registry.get("datasets", name)
        if isinstance(other, type) and issubclass(other, PublishedDataset):
            guesses[name] = other.recognise(root)
    guess = guesses[reader.name]
    assert guess is not None
    assert guess.options["root"] == str(root)
    assert 0.5 <= guess.score <= 1
    surer = [name for name, one in guesses.items() if one and one.score > guess.score]
    assert surer == []
    assert [key for key in guess.options if key not in signature(reader).parameters] == []
