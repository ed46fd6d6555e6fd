"""Training warns once of the doubts of data inspect."""

import logging
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from tactileforge.checks.doors import frame_lines
from tactileforge.checks.log_doubts import Examination
from tactileforge.checks.made import made_touch, press, resting
from tactileforge.checks.run import CHECKED_AT_ENTRY
from tactileforge.contracts import Frames, Recording
from tactileforge.data.batches.datamodule import TouchData
from tactileforge.data.frames.lazy import ArrayFrames
from tactileforge.data.labels.augment import Augment


class Made:
    """Three touches at a rate, with forces up to a number of newton."""

    skipped: list[str]
    provides = frozenset({"force", "action"})

    def __init__(self, fps: float = 30.0, newton: float = 5.0, notes: list[str] | None = None):
        self.skipped, self.notes = [], notes or []
        self.fps, self.newton = fps, newton

    def recordings(self, split: str) -> Iterator[Recording]:
        for i in range(3):
            force = np.zeros((40, 3), np.float32)
            force[:, 2] = np.linspace(0, self.newton, 40)
            yield Recording(
                key=f"made/{split}{i}",
                sensor="digit",
                frames=ArrayFrames(np.zeros((40, 16, 16, 3), np.uint8)),
                times=np.arange(40) / self.fps,
                no_contact=None,
                force=force,
                action=np.full(40, 2, np.int64),
            )

    def plot(self, recording: Recording) -> Any:
        raise NotImplementedError


def lines(caplog: pytest.LogCaptureFixture, dataset: Made, frames: int = 4) -> list[str]:
    caplog.clear()
    data = TouchData(dataset, frames, (16, 16), 4, match=0, workers=0)
    data.examiner = Examination()
    with caplog.at_level(logging.INFO):
        data.setup()
        data.check({"force": frozenset({"force"})})
    return [record.getMessage() for record in caplog.records]


def test_sane_data_is_trained_on_in_silence(caplog: pytest.LogCaptureFixture) -> None:
    assert lines(caplog, Made()) == []
    assert lines(caplog, Made(fps=18)) == []


def test_units_of_force(caplog: pytest.LogCaptureFixture) -> None:
    (line,) = lines(caplog, Made(newton=800))
    assert line.startswith("data: TF201 force out of range in 6 of 6 recordings (made/train0: 800")


def test_forces_of_zero_are_said_where_force_is_learnt(caplog: pytest.LogCaptureFixture) -> None:
    (line,) = lines(caplog, Made(newton=0))
    assert "the forces of all 240 frames are all 0 N" in line


def test_slow_frames(caplog: pytest.LogCaptureFixture) -> None:
    (line,) = lines(caplog, Made(fps=2))
    assert line.startswith(
        "data: frames come every 0.5 s in 3 of 3 recordings, and the recipe's clips have them "
        "0.0667 s apart: such clips are 7.5 times as long."
    )
    assert line.endswith("or give batch.spacing=0.5")
    assert lines(caplog, Made(fps=2), frames=1) == [], "one frame has no spacing"


def test_recordings_shorter_than_a_clip(caplog: pytest.LogCaptureFixture) -> None:
    (line,) = lines(caplog, Made(fps=1000))
    assert line.startswith("data: 3 of 3 recordings last less than half a clip (0.2 s)")
    assert line.endswith("(made/train0 lasts 0.039 s): is their rate (fps:) too high?")
    assert lines(caplog, Made(fps=1000), frames=1) == []


def test_what_the_reader_has_noticed(caplog: pytest.LogCaptureFixture) -> None:
    assert lines(caplog, Made(notes=["a/x: two orders"])) == ["data: a/x: two orders"]


def test_one_class_is_said_where_it_is_learnt(caplog: pytest.LogCaptureFixture) -> None:
    data = TouchData(Made(), 4, (16, 16), 4, match=0, workers=0)
    data.examiner = Examination()
    data.setup()
    data.check({"action": frozenset({"action"})})
    (record,) = caplog.records
    assert "only one action (" in record.getMessage()


@pytest.mark.parametrize(
    ("text", "options", "told"),
    [
        ("the ball slides left", {}, True),
        ("the ball slides left", {"horizontal": 0.0}, False),
        ("the ball moves down", {"horizontal": 0.0}, True),
        ("the ball moves down", {"vertical": 0.0}, False),
        ("the ball slides left", {"horizontal": 0.0, "vertical": 0.0, "rotate": 180.0}, True),
        ("the ball {action}", {}, False),
    ],
)
def test_captions_of_sides_where_clips_are_mirrored(
    text: str, options: dict[str, float], told: bool, caplog: pytest.LogCaptureFixture
) -> None:
    class Told(Made):
        def recordings(self, split: str) -> Iterator[Recording]:
            return (replace(one, text=text) for one in super().recordings(split))

    data = TouchData(Told(), 4, (16, 16), 4, match=0, workers=0, augment=Augment(**options))
    data.examiner = Examination()
    data.setup()
    lines = [line for line in caplog.messages if "TF405" in line]
    assert bool(lines) == told
    if told:
        assert lines[0].startswith("data: TF405 6 of 6 captions hold words such as ")
        assert "upright: true" in lines[0]


@pytest.mark.parametrize(("turns", "told"), [(0, False), (1, True), (3, True)])
def test_pictures_on_their_side_are_said(
    turns: int, told: bool, caplog: pytest.LogCaptureFixture
) -> None:
    class Turned(Made):
        def recordings(self, split: str) -> Iterator[Recording]:
            for seed in (0, 1, 2) if split == "train" else (3,):
                yield made_touch(seed, still=np.rot90(resting(seed), turns), key=f"{split}/{seed}")

    data = TouchData(Turned(), 4, (16, 16), 4, match=0, workers=0)
    data.examiner = Examination()
    data.setup()
    assert any(line.startswith("data: TF307 ") for line in caplog.messages) == told, caplog.messages


class Counted:
    """Frames with a count of those read."""

    def __init__(self, frames: Frames) -> None:
        self.frames, self.read_rows, self.shape = frames, list[int](), frames.shape

    def __len__(self) -> int:
        return len(self.frames)

    def read(self, indices: Sequence[int]) -> NDArray[np.uint8]:
        self.read_rows += indices
        return self.frames.read(indices)


@pytest.mark.parametrize("count", [4, 9])
def test_few_frames_of_few_recordings_are_decoded(count: int) -> None:
    """However many there are: a start costs the same for 20 recordings and for 20,000."""
    touches = [
        replace(made, frames=Counted(made.frames), no_contact=None)
        for made in (made_touch(seed, depth=press(300)) for seed in range(count))
    ]
    frame_lines(touches[1:], touches[:1])
    decoded = [len(one.frames.read_rows) for one in touches]  # type: ignore[attr-defined]
    assert sum(map(bool, decoded)) == min(count, CHECKED_AT_ENTRY) == min(count, 8)
    assert max(decoded) <= 24 + 24 + 64  # of 300: a sample with the next of each, and a stretch


def test_mirrored_pictures_and_copies_are_said(caplog: pytest.LogCaptureFixture) -> None:
    class Odd(Made):
        def recordings(self, split: str) -> Iterator[Recording]:
            for seed in (0, 1) if split == "train" else (1,):
                yield made_touch(seed, still=resting(seed)[:, ::-1], key=f"{split}/{seed}")

    data = TouchData(Odd(), 4, (16, 16), 4, match=0, workers=0)
    data.examiner = Examination()
    data.setup()
    assert any(line.startswith("data: TF308 mirrored in 3 of 3") for line in caplog.messages)
    assert any("TF501 1 held-out recordings are copies" in line for line in caplog.messages)
