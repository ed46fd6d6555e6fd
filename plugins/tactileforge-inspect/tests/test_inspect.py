import re
import tracemalloc
from collections.abc import Callable, Iterator
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest
from tactileforge_inspect import InspectionFindings, inspect
from tactileforge_inspect.scan import scan_dataset
from tactileforge_sim.dataset import Sim

from tactileforge.contracts import Recording
from tactileforge.data.frames.lazy import ImageFrames
from tactileforge.errors import ConfigError, DataError, DataNotFoundError

Touch = Callable[..., Recording]
VOID = {"meta", "wbr", "link", "img", "br", "path", "circle", "use"}


class Checked(HTMLParser):
    """Raises an error for tags not closed in order; gathers ids and links."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.ids: list[str] = []
        self.sources: list[str] = []
        self.feed(text)
        assert self.open == []

    def handle_starttag(self, tag: str, attrs: Any) -> None:
        given = dict(attrs)
        self.ids += [given["id"]] if "id" in given else []
        self.sources += [given[key] for key in ("src", "href") if given.get(key)]
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: Any) -> None:
        given = dict(attrs)
        self.ids += [given["id"]] if "id" in given else []

    def handle_endtag(self, tag: str) -> None:
        if tag not in VOID:
            assert self.open.pop() == tag


def written(dataset: Any, path: Path, **options: Any) -> tuple[InspectionFindings, str]:
    findings = inspect(dataset, "made <here>", path, progress=False, **options)
    return findings, path.read_text()


def words_of(text: str) -> str:
    return re.sub(r"\s+", " ", re.sub(r"<[^>]*>", " ", text.partition("<nav")[2]))


@pytest.mark.slow
def test_the_page_is_whole_and_needs_no_network(touch: Touch, listed: Any, tmp_path: Path) -> None:
    action = np.repeat([0, 1, 3], 30)
    train = [touch(i, action=action, object=f"object {i}") for i in range(4)]
    train += [touch(10 + i, sensor="gelsight", text="a <b>cup</b>") for i in range(3)]
    findings, text = written(listed(train, [touch(20)]), tmp_path / "new/page.html")
    page = Checked(text)
    ids = [name for name in page.ids if not re.match(r"[0-9a-f]{8}-", name)]  # equal drawings share
    assert len(ids) == len(set(ids))
    assert all(source.startswith(("data:", "#")) for source in page.sources)
    assert "<b>cup</b>" not in text
    assert "made &lt;here&gt;" in text
    assert list((tmp_path / "new").iterdir()) == [tmp_path / "new/page.html"]
    anchors = [source[1:] for source in page.sources if source.startswith("#")]
    assert {"totals", "contact", "clips", "labels", "duplicates", "suspicious"} <= set(anchors)
    assert set(anchors) <= set(page.ids)
    assert (findings.recordings, findings.frames, findings.looked) == (8, 720, 8)
    assert findings.seconds == pytest.approx(24)
    assert not any(findings.counts.values())
    assert "No recording is suspicious" in text
    assert "Images and forces fit in time in 8 recordings" in text
    # Frame and difference of each on the sheets; 8 frames and differences of each strip.
    assert text.count("<img") == 8 * 2 + 8 * 2 * 8
    assert written(listed(train, [touch(20)]), tmp_path / "again.html")[1] == text


@pytest.mark.slow
def test_faults_are_counted_and_the_worst_come_first(
    touch: Touch, listed: Any, tmp_path: Path
) -> None:
    def frozen(seconds: float) -> Callable[[Any], None]:
        def edit(array: Any) -> None:
            array[10 : 10 + round(30 * seconds)] = array[9]

        return edit

    train = [touch(i) for i in range(3)]
    train += [touch(10 + i, edit=frozen(1.3 + 0.4 * i), force=None) for i in range(3)]
    train += [touch(20 + i, no_contact=None) for i in range(15)]
    findings, text = written(listed(train), tmp_path / "page.html")
    assert {k: n for k, n in findings.counts.items() if n} == {"no_background": 15, "frozen": 3}
    assert [suspect.key for suspect in findings.worst["frozen"]] == [
        "made/12",
        "made/11",
        "made/10",
    ]
    values = [suspect.value for suspect in findings.worst["frozen"]]
    np.testing.assert_allclose(values, [2.1, 1.7, 1.3], atol=0.2)
    assert all(suspect.picture is not None for suspect in findings.worst["frozen"])
    assert [suspect.key for suspect in findings.worst["no_background"]] == [
        f"made/{i}" for i in range(20, 32)
    ]
    words = words_of(text)
    assert "Frozen (TF103): 3 of 21 recordings that were looked at" in words
    assert words.index("made/12, digit, training") < words.index("made/10, digit, training")
    first, *kinds = str(findings).splitlines()
    assert first == "21 recordings, 1890 frames, 63 s, of digit; 21 looked at"
    assert kinds[0] == "15 no background, the worst made/20: no frame without contact"
    assert re.fullmatch(r"3 frozen, the worst made/12: .* for [\d.]+ s", kinds[1])
    assert len(kinds) == 2


@pytest.mark.slow
def test_what_cannot_be_read_is_named_and_never_fatal(
    touch: Touch, listed: Any, make_broken: Callable[[], ImageFrames], tmp_path: Path
) -> None:
    bad = touch(1, count=2, frames=make_broken(), no_contact=None, force=None)
    short = touch(2, times=np.arange(4) / 30, force=None)
    breaks = DataError("index.csv, row 9: no such touch")
    dataset = listed([touch(0), bad, short], skipped=["gone.mp4: truncated"], breaks=breaks)
    findings, text = written(dataset, tmp_path / "page.html")
    first, list_broke, broken, wrong = findings.unreadable
    assert first == "gone.mp4: truncated"
    assert "reading stopped, recordings after it are not counted: index.csv, row 9" in list_broke
    assert "made/1: " in broken
    assert "1.png: not a readable image" in broken
    assert "made/2: 4 times for 90 frames" in wrong
    assert (findings.recordings, findings.looked) == (3, 1)
    assert "4 recordings could not be read" in text
    assert "1.png: not a readable image" in text.replace("<wbr>", "")
    assert findings.counts["gaps_in_time"] == 1
    assert "4 times for 90 frames" in words_of(text)
    findings, text = written(listed([bad]), tmp_path / "none.html")
    Checked(text)
    assert (findings.recordings, findings.looked, len(findings.unreadable)) == (1, 0, 1)


@pytest.fixture
def make_broken(tmp_path: Path) -> Callable[[], ImageFrames]:
    """Two images; the second is cut off after its header was read."""
    import cv2

    def make() -> ImageFrames:
        for i in range(2):
            cv2.imwrite(str(tmp_path / f"{i}.png"), np.full((48, 64, 3), 90, np.uint8))
        frames = ImageFrames([tmp_path / "0.png", tmp_path / "1.png"])
        (tmp_path / "1.png").write_bytes((tmp_path / "1.png").read_bytes()[:60])
        return frames

    return make


@pytest.mark.slow
def test_duplicates_across_splits_and_keys(touch: Touch, listed: Any, tmp_path: Path) -> None:
    train = [touch(0), touch(1), touch(1, key="made/copy")]
    dataset = listed(train, [touch(0, key="made/leak"), touch(5, key="made/1")])
    findings, text = written(dataset, tmp_path / "page.html")
    assert findings.duplicates == [("made/0", "made/leak"), ("made/1", "made/copy")]
    assert findings.similar == []
    assert findings.repeated == ["made/1"]
    words = words_of(text)
    assert "IN BOTH SPLITS: made/0, made/leak" in words
    assert "IN BOTH SPLITS: made/1" not in words
    assert "2 groups of recordings with the same pixels" in text


def test_stills_without_anything(touch: Touch, listed: Any, tmp_path: Path) -> None:
    bare: dict[str, Any] = {"count": 1, "force": None, "no_contact": None}
    findings, text = written(listed([touch(i, **bare) for i in range(3)]), tmp_path / "page.html")
    Checked(text)
    assert (findings.recordings, findings.seconds) == (3, 0)
    assert findings.counts["no_background"] == 3
    assert "Every recording that was looked at is a still" in text
    assert "Stills without labels" in text
    assert "NaN" not in text
    assert "nan" not in words_of(text)


def test_axes_without_force_are_left_out_and_named(
    touch: Touch, listed: Any, tmp_path: Path
) -> None:
    force = np.full((90, 3), np.nan, np.float32)
    force[:, 2] = 2.0  # a constant one, besides
    recordings = [touch(i, force=force, action=np.full(90, -1)) for i in range(2)]
    _, text = written(listed(recordings), tmp_path / "page.html")
    Checked(text)
    words = words_of(text)
    assert "Force along z" in words
    assert "Force along x" not in words
    assert "No force is known along x and y." in words
    assert "2 (z alone)" in words
    (drawn,) = re.findall(r'aria-label="shares of frames by force along z".*?</svg>', text)
    ticks = [float(number) for number in re.findall(r">([\d.]+)</text>", drawn)]
    assert min(ticks) <= 2 < max(ticks)
    assert max(ticks) - min(ticks) < 1  # the axis is around the one value
    shares = re.findall(r">([\d.]+) %</text>", drawn)
    assert shares == ["100"]  # no share above all of them
    row = re.search(r"digit, training.*?</tr>", text, re.DOTALL)
    assert row
    assert row[0].count(">none</td>") == 5  # an action that is unknown throughout is none


@pytest.mark.slow
def test_times_that_stand_still(touch: Touch, listed: Any, tmp_path: Path) -> None:
    findings, text = written(
        listed([touch(0, times=np.zeros(90)), touch(1)]), tmp_path / "page.html"
    )
    Checked(text)
    assert findings.counts["gaps_in_time"] == 1


def test_few_are_looked_at_and_all_are_counted(touch: Touch, listed: Any, tmp_path: Path) -> None:
    decoded: set[str] = set()

    def spied(seed: int) -> Recording:
        recording = touch(seed, count=3, force=None, key=f"made/{seed}")

        class Spy:
            shape = recording.frames.shape

            def __len__(self) -> int:
                return 3

            def read(self, indices: Any) -> Any:
                decoded.add(recording.key)
                return recording.frames.read(indices)

        return touch(seed, count=3, force=None, frames=Spy())

    findings, _ = written(
        listed([spied(i) for i in range(40)]), tmp_path / "page.html", recordings=7
    )
    assert (findings.recordings, findings.looked) == (40, 7)
    assert len(decoded) == 7


def test_memory_does_not_grow_with_the_number_of_recordings(touch: Touch, tmp_path: Path) -> None:
    base = touch(count=1, force=None)

    class Many:
        skipped: ClassVar[list[str]] = []
        provides = frozenset[str]()

        def __init__(self, count: int) -> None:
            self.count = count

        def recordings(self, split: str) -> Iterator[Recording]:
            for i in range(self.count if split == "train" else 0):
                yield replace(base, key=f"made/{i}", object=f"object {i}", times=np.zeros(1))

        def plot(self, recording: Recording) -> Any:
            raise NotImplementedError

    def peak(count: int) -> int:
        tracemalloc.start()
        assert scan_dataset(Many(count), 10, progress=False).findings.recordings == count
        traced = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        return traced

    peak(10)
    assert peak(4000) < peak(400) + 50_000, "bytes; one key and object a recording are 400,000"


def test_names_are_shown_as_they_are(touch: Touch, listed: Any, tmp_path: Path) -> None:
    names = ["a$b$c", "<i>", "same beginning, and a different end 1"]
    names += [f"{names[-1][:-1]}{i}" for i in (2, 3)]
    train = [touch(i, object=name) for i, name in enumerate(names)]
    _, text = written(listed(train), tmp_path / "page.html")
    Checked(text)
    bars = text.partition("Recordings by object (5)")[2].partition("</figure>")[0]
    assert ">a$b$c<" in bars
    assert "&lt;i&gt;" in bars
    assert bars.count("same beginning, and a diffe…") == 3


def test_errors_that_are_the_users(touch: Touch, listed: Any, tmp_path: Path) -> None:
    page = tmp_path / "page.html"
    with pytest.raises(ConfigError, match="recordings=0"):
        inspect(listed([touch()]), "made", page, recordings=0)
    with pytest.raises(DataError, match="no recording to look at; gone: truncated"):
        inspect(listed([], skipped=["gone: truncated"]), "made", page, progress=False)
    missing = DataNotFoundError("touches: no such folder")
    with pytest.raises(DataNotFoundError, match="no such folder"):
        inspect(listed([], breaks=missing), "made", page, progress=False)
    assert not page.exists()


@pytest.mark.slow
def test_simulated_touch_is_not_suspicious(tmp_path: Path) -> None:
    data = Sim(scenes=1, val=0, size=64, processes=1, motions="slide_right", randomise="none")
    findings, text = written(data, tmp_path / "page.html")
    Checked(text)
    assert findings.recordings == 3
    assert not any(findings.counts.values())
    assert "slide right" in text


def test_what_no_recording_tells_alone_is_noted(touch: Touch, listed: Any, tmp_path: Path) -> None:
    still = np.zeros((90, 3), np.float32)
    data = listed([touch(i, object="cup", force=still) for i in range(2)])
    data.notes = ["a/x: two orders are possible"]
    findings, text = written(data, tmp_path / "page.html")
    first, forces, objects = findings.notes
    assert first == "a/x: two orders are possible"
    assert forces.startswith("TF207 the forces of all 180 frames are all 0 N")
    assert objects.startswith("TF402 only one object (cup) in 2 recordings")
    assert f"note: {forces}" in str(findings).split("\n")
    assert "TF207 the forces of all 180 frames are all 0 N" in text
    sane = listed([touch(i, object=f"cup {i}") for i in range(2)])
    assert written(sane, tmp_path / "sane.html")[0].notes == []
