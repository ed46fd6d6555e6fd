"""Forces of a table of images: each row names its image."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tactileforge.contracts import Recording
from tactileforge.datasets.recordings import Recordings
from tactileforge.errors import ConfigError, DataError

MakeFile = Callable[..., Path]
STILLS = {"images": "**/*.png", "each": "touch", "sensor": "digit", "background": "none"}
FORCE = {"file": "forces.csv", "columns": ["fx", "fy", "fz"]}


def read(root: Path, **layout: Any) -> list[Recording]:
    return list(Recordings(str(root), {"a": layout}, val=0).recordings("train"))


@pytest.fixture
def images(tmp_path: Path, make_image: MakeFile) -> Path:
    for i in range(3):
        make_image(f"run/{i}.png", i)
    return tmp_path


@pytest.mark.parametrize(
    ("header", "name", "key"),
    [
        ("file", "run/{}.png", None),
        ("image", "{}.png", None),
        ("filename", "./run/{}.png", None),
        ("path", "run\\{}.png", None),
        ("picture", "run/{}.png", "picture"),
        ("name", "run/{}", None),
        ("path", "/home/ann/set/run/{}.png", None),
        ("path", "D:\\set\\run\\{}.png", None),
    ],
)
def test_rows_find_their_images(
    images: Path, write: MakeFile, header: str, name: str, key: str | None
) -> None:
    rows = "".join(f"{name.format(i)},0,{i},{2 * i}\n" for i in (2, 0, 1))
    write("forces.csv", f"{header},fx,fy,fz\n{rows}")
    forces = [one.force for one in read(images, **STILLS, force=FORCE | {"key": key})]
    np.testing.assert_array_equal(np.concatenate(forces), [[0, i, 2 * i] for i in range(3)])


def test_an_image_without_a_row_has_no_force(images: Path, write: MakeFile) -> None:
    write("forces.csv", "file,fx,fy,fz\nrun/1.png,1,2,3\n")
    forces = np.concatenate([one.force for one in read(images, **STILLS, force=FORCE)])
    np.testing.assert_array_equal(forces, [[np.nan] * 3, [1, 2, 3], [np.nan] * 3])


def test_a_sequence_takes_forces_by_image_too(images: Path, write: MakeFile) -> None:
    write("forces.csv", "file,fx,fy,fz\nrun/1.png,1,2,3\n")
    layout = STILLS | {"each": "sequence", "fps": 30, "force": FORCE | {"key": "file"}}
    (recording,) = read(images, **layout)
    np.testing.assert_array_equal(recording.force, [[np.nan] * 3, [1, 2, 3], [np.nan] * 3])


def test_a_table_of_many_sequences_asks_for_the_column_of_names(
    images: Path, write: MakeFile
) -> None:
    write("forces.csv", "file,fx,fy,fz\n" + "run/1.png,1,2,3\n" * 4)
    layout = STILLS | {"each": "sequence", "fps": 30, "force": FORCE}
    with pytest.raises(
        DataError, match=r"row 5: a row for each frame, and there are 3 .*, key: that of"
    ):
        read(images, **layout)


def test_rows_that_name_nothing(images: Path, write: MakeFile, make_image: MakeFile) -> None:
    write("forces.csv", "file,fx,fy,fz\nrun/7.png,1,2,3\n")
    with pytest.raises(DataError, match=r"row 2: 'run/7\.png' names no image .*'run/\d\.png'"):
        read(images, **STILLS, force=FORCE)
    write("forces.csv", "file,fx,fy,fz\nrun/2.pngg,1,2,3\n")
    with pytest.raises(DataError, match=r"'run/2\.pngg' names no image .*'run/2\.png'"):
        read(images, **STILLS, force=FORCE)
    write("forces.csv", "file,fx,fy,fz\nrun/1.png,1,2,3\n./run/1.png,1,2,3\n")
    with pytest.raises(DataError, match=r"row 3: 'run/1\.png' has a row already"):
        read(images, **STILLS, force=FORCE)
    write("forces.csv", "file,fx,fy,fz\n/a/run/1.png,1,2,3\n/b/run/1.png,1,2,3\n")
    with pytest.raises(DataError, match=r"row 3: 'run/1\.png' has a row already"):
        read(images, **STILLS, force=FORCE)
    write("forces.csv", "number,fx,fy,fz\n1,1,2,3\n")
    with pytest.raises(ConfigError, match=r"which column names the images\? Give key: NAME"):
        read(images, **STILLS, force=FORCE)
    make_image("other/1.png")
    write("forces.csv", "file,fx,fy,fz\n1.png,1,2,3\n")
    with pytest.raises(DataError, match="several are called so; give the path from"):
        read(images, **STILLS, force=FORCE)
    write("forces.csv", "file,fx,fy,fz\nrun/1.png,9999,2,3\n")
    with pytest.raises(DataError, match=r"row 2: a force of \(9999, 2, 3\) N"):
        read(images, **STILLS, force=FORCE)


def test_a_table_a_touch_stays_what_it_was(images: Path, write: MakeFile) -> None:
    for i in range(3):
        write(f"{i}.csv", f"fx,fy,fz\n0,0,{i}\n")
    recordings = read(images, **STILLS, force=FORCE | {"file": "{stem}.csv"})
    assert [one.force.tolist() for one in recordings] == [[[0, 0, i]] for i in range(3)]
