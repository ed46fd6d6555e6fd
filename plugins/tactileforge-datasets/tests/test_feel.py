from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from tactileforge_datasets.feel import Feel

from tactileforge.errors import DataError

Make = Callable[..., Any]


@pytest.fixture
def root(tmp_path: Path, make_image: Make, write: Make) -> Path:
    for i, moment in enumerate(("before", "during", "after")):
        for finger, more in (("A", 0), ("B", 10)):
            make_image(f"3d_printed_screw/touch_{moment}/0_{finger}.png", i + more)
        make_image(f"3d_printed_screw/vision_{moment}/0.png", i + 20, (60, 80))
        make_image(f"mug/touch_{moment}/4_A.png", i)
    write("feel.csv", "3d_printed_screw,0,1\nmug,4,0\n")
    return tmp_path


def test_grasps(root: Path, levels: Make) -> None:
    data = Feel(str(root), val=0)
    first, other, mug = data.recordings("train")
    assert (first.key, other.key) == ("feel/3d_printed_screw/0_A", "feel/3d_printed_screw/0_B")
    assert (levels(first.frames), levels(other.frames)) == ([0, 1, 2], [10, 11, 12])
    assert levels(other.no_contact) == [10], "before the grasp"
    assert levels(first.image) == [20, 21, 22]
    assert first.labels == {"is_gripping": 1.0, "finger": "A"}
    assert (mug.object, mug.image, mug.labels["is_gripping"]) == ("mug", None, 0)
    (line,) = data.skipped
    assert "mug/touch_before/4_B.png: no such file" in line


def test_a_bad_row_is_named(root: Path, write: Make) -> None:
    write("feel.csv", "mug,4,0\nmug,5,maybe\n")
    with pytest.raises(DataError, match=r"feel\.csv, line 2"):
        list(Feel(str(root)).recordings("train"))


def test_conformance(root: Path, conforms: Make) -> None:
    conforms(Feel, root=str(root), val=0.0)
