from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tactileforge_datasets.objectfolder_real import ObjectFolderReal

from tactileforge.data.batches.clips import view_of
from tactileforge.errors import DataError

Make = Callable[..., Any]


@pytest.fixture
def root(tmp_path: Path, make_images: Make, write: Make) -> Path:
    for contact in ("1/0", "1/1", "2/0"):
        make_images(f"tactile/{contact}/gelsight/{{}}.png", range(11))
    make_images("tactile/1/0/camera/{}.png", (4, 9), (60, 80))
    rows = [f"1/0/gelsight/{i}.png,1/0/camera/{4 if i < 6 else 9}.png,17\n" for i in (10, 5, 3)]
    gone = "2/0/gelsight/3.png,2/0/camera/0.png,18\n"
    write("contact_text_obj.csv", "".join(rows) + gone)
    return tmp_path


def test_recordings(root: Path, levels: Make) -> None:
    by_key = {
        recording.key: recording
        for recording in ObjectFolderReal(str(root), val=0).recordings("train")
    }
    assert sorted(by_key) == [f"objectfolder_real/{place}" for place in ("1/0", "1/1", "2/0")]
    recording = by_key["objectfolder_real/1/0"]
    assert levels(recording.frames) == list(range(11)), "by number: 10 after 9"
    assert (levels(recording.no_contact), levels(recording.image)) == ([0], [4, 4, 9])
    assert recording.image_times is not None
    np.testing.assert_allclose(recording.image_times, [3 / 30, 5 / 30, 10 / 30])
    assert (recording.object, recording.sensor) == ("objectfolder_1", "gelslim")
    assert by_key["objectfolder_real/2/0"].image is None, "its view is not there"


def test_each_touch_has_the_view_that_the_index_gives_it(
    root: Path, write: Make, levels: Make
) -> None:
    pairs = [4, 4, *[9] * 9]
    lines = [f"1/0/gelsight/{i}.png,1/0/camera/{view}.png,17" for i, view in enumerate(pairs)]
    write("contact_text_obj.csv", "\n".join(lines))
    recording = next(iter(ObjectFolderReal(str(root), val=0).recordings("train")))
    views = levels(recording.image)
    assert [views[view_of(recording, row)] for row in range(11)] == pairs


def test_a_line_that_is_cut_off_is_named(root: Path) -> None:
    index = root / "contact_text_obj.csv"
    index.write_text(index.read_text() + "\n1/0/gel")
    with pytest.raises(DataError, match=r"contact_text_obj\.csv, line 6: \['1/0/gel'\] is not a"):
        list(ObjectFolderReal(str(root), val=0).recordings("train"))


def test_without_the_index_there_are_no_views(root: Path) -> None:
    (root / "contact_text_obj.csv").unlink()
    assert all(
        recording.image is None
        for recording in ObjectFolderReal(str(root), val=0).recordings("train")
    )


def test_a_damaged_recording_is_named(root: Path) -> None:
    (root / "tactile/1/1/gelsight/7.png").write_bytes(b"\x89PNG")
    data = ObjectFolderReal(str(root), val=0)
    assert len(list(data.recordings("train"))) == 2
    assert "1/1/gelsight/7.png" in data.skipped[0]


def test_conformance(root: Path, conforms: Make) -> None:
    conforms(ObjectFolderReal, root=str(root), val=0.0)
