import logging
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from PIL import Image

from tactileforge.contracts import Recording
from tactileforge.data.batches.datamodule import TouchData
from tactileforge.data.batches.leaks import find_leaks, leak_warning
from tactileforge.data.frames.lazy import ArrayFrames
from tactileforge.datasets.mixture import Mixture


def recording(key: str, seed: int, count: int = 3) -> Recording:
    pixels = np.random.default_rng(seed).integers(0, 255, (count, 8, 8, 3)).astype(np.uint8)
    frames = ArrayFrames(pixels if seed else np.zeros_like(pixels))
    times = np.arange(float(count))
    return Recording(key=key, sensor="digit", frames=frames, times=times, no_contact=None)


def test_the_same_pictures_in_two_sources_are_named() -> None:
    train = [[recording("a/x", 1), recording("a/y", 2)], [recording("b/z", 3)]]
    val = [[recording("a/w", 4)], [recording("b/other", 2), recording("b/new", 5)]]
    assert find_leaks(train, val) == [("a/y", "b/other")]
    assert "a/y and b/other show the same pictures" in leak_warning(find_leaks(train, val))


def test_what_is_no_leak() -> None:
    a, b = recording("a/x", 1), recording("b/x", 2)
    assert find_leaks([[a], [b]], [[], []]) == []
    assert find_leaks([[a], []], [[], [b]]) == [], "one key, other pictures"
    assert find_leaks([[a], []], [[a], []]) == [], "a source splits itself as it likes"
    black, other = recording("a/x", 0), recording("b/x", 0)
    assert find_leaks([[black], []], [[], [other]]) == [], "black pictures are all the same"
    assert find_leaks([[a], []], [[], [recording("b/x", 1, count=2)]]) == []


def pressed(key: str, place: int, quality: int | None = None, count: int = 12) -> Recording:
    """A ball pressing and lifting again; pictures are encoded as JPEG, or not at all."""
    y, x = np.mgrid[:96, :128]
    inside = np.exp(-((x - 20 - 8 * place) ** 2 + (y - 48) ** 2) / 200)
    shown = [100 + 60 * inside * np.sin(np.pi * i / count) for i in range(count)]
    pixels = np.stack([np.repeat(f[..., None], 3, -1) for f in shown]).astype(np.uint8)
    if quality is not None:
        how = [cv2.IMWRITE_JPEG_QUALITY, quality]
        coded = [cv2.imdecode(cv2.imencode(".jpg", one, how)[1], 1) for one in pixels]
        pixels = np.stack(coded).astype(np.uint8)
    times = np.arange(float(count))
    frames = ArrayFrames(pixels)
    return Recording(key=key, sensor="digit", frames=frames, times=times, no_contact=None)


@pytest.mark.parametrize("quality", [95, 60])
def test_a_copy_that_was_encoded_again_is_a_leak(quality: int) -> None:
    train = [[pressed("a/0", 0), pressed("a/1", 4)], []]
    assert find_leaks(train, [[], [pressed("b/9", 4, quality)]]) == [("a/1", "b/9")]
    assert find_leaks(train, [[], [pressed("b/9", 7, quality)]]) == [], "pressed elsewhere"


def test_two_recordings_without_touch_are_no_leak() -> None:
    def resting(key: str, seed: int) -> Recording:
        noise = np.random.default_rng(seed).integers(100, 104, (6, 48, 64, 3)).astype(np.uint8)
        frames, times = ArrayFrames(noise), np.arange(6.0)
        return Recording(key=key, sensor="digit", frames=frames, times=times, no_contact=None)

    assert find_leaks([[resting("a/0", 1)], []], [[], [resting("b/0", 2)]]) == []


def test_many_recordings_are_found_by_their_key_first() -> None:
    train = [[recording(f"a/{i}", i + 1) for i in range(300)], []]
    val: list[list[Recording]] = [[], [recording("b/211", 212)]]
    assert find_leaks(train, val) == [("a/211", "b/211")]


@pytest.mark.parametrize("is_copy", [False, True])
def test_a_folder_in_two_sources_is_told_in_training(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, is_copy: bool
) -> None:
    for name in ("one", "two"):
        (tmp_path / name).mkdir()
        for i in range(4):
            pixels = np.random.default_rng(i).integers(0, 255, (8, 8, 3)).astype(np.uint8)
            Image.fromarray(pixels).save(tmp_path / name / f"{i}.png")

    def source(name: str, split: str, folder: str) -> dict[str, Any]:
        layout = {"images": "*.png", "each": "touch", "sensor": "digit", "background": "none"}
        layouts = {name: layout | {"hold_out": {"train": "none", "val": "all"}.get(split, split)}}
        return {"name": "recordings", "root": str(tmp_path / folder), "layouts": layouts}

    def warnings(second: dict[str, Any]) -> list[str]:
        caplog.clear()
        sources = {"a": source("touches", "train", "one"), "b": second}
        data = TouchData(Mixture(sources), frames=1, size=(8, 8), batch_size=2, match=0)
        with caplog.at_level(logging.WARNING):
            data.setup()
        return [line for line in caplog.messages if "trains on what another" in line]

    (line,) = warnings(source("other", "val", "two" if is_copy else "one"))
    assert "a/touches/0.png and b/other/0.png" in line
    assert warnings(source("other", "train", "two")) == []


@pytest.mark.parametrize("has_share", [True, False])
def test_the_share_is_named_where_the_data_has_that_key(
    caplog: pytest.LogCaptureFixture, has_share: bool
) -> None:
    class Fixed:
        provides = frozenset[str]()

        def __init__(self) -> None:
            self.skipped: list[str] = []

        def recordings(self, split: str) -> list[Recording]:
            return [recording("x", 1)] if split == "train" else []

    class Shared(Fixed):
        def __init__(self, val: float = 0.0) -> None:
            super().__init__()

    kind = Shared if has_share else Fixed
    data = TouchData(kind(), frames=1, size=(8, 8), batch_size=2, match=0)
    with caplog.at_level(logging.WARNING):
        data.setup()
    (line,) = [one for one in caplog.messages if "no recording is held out" in one]
    assert ("data.val=" in line) is has_share
