"""Tables, scales and tars with nothing, or no file, in their place: said, and the rest is read."""

import os
from collections.abc import Callable
from pathlib import Path

import pytest
from made_samples import FRAMES, made_set
from made_sets import gelslam
from tactileforge_datasets.gelslam import GelSlam
from tactileforge_datasets.objectfolder_real import ObjectFolderReal
from tactileforge_datasets.octopi import Octopi
from tactileforge_datasets.ssvtp import Ssvtp
from tactileforge_datasets.tvl import Tvl
from tactileforge_datasets.webdataset import WebDataset

from tactileforge.errors import DataError


def emptied(path: Path) -> None:
    path.write_bytes(b"")


def folder(path: Path) -> None:
    path.unlink()
    path.mkdir()


def pipe(path: Path) -> None:
    path.unlink()
    os.mkfifo(path)


@pytest.mark.parametrize("change", [emptied, folder, pipe])
def test_a_catalog_that_is_no_table(change: Callable[[Path], None], tmp_path: Path) -> None:
    gelslam(tmp_path)
    whole = GelSlam(str(tmp_path), val=0)
    assert any("ball" in one.key or one.labels for one in whole.recordings("train"))
    assert whole.notes == []
    (catalog,) = tmp_path.glob("*/catalog.csv")
    change(catalog)
    data = GelSlam(str(tmp_path), val=0)
    assert [*data.recordings("train")]
    (line,) = data.notes
    assert f"{catalog}: " in line
    assert "no table of presses" in line


def test_a_film_without_its_scale(tmp_path: Path) -> None:
    gelslam(tmp_path)
    config = next(tmp_path.rglob("config.yaml"))
    emptied(config)
    data = GelSlam(str(tmp_path), val=0)
    assert [*data.recordings("train")]
    assert data.notes == [f"{config}: no ppmm, so no scale of the film"]


@pytest.mark.parametrize("change", [folder, pipe])
def test_no_file_in_the_place_of_a_tar(change: Callable[[Path], None], tmp_path: Path) -> None:
    made_set(tmp_path, tars=2, clips=2)
    tars = sorted(tmp_path.glob("*.tar"))
    change(tars[1])
    data = WebDataset(str(tmp_path), FRAMES, val=0)
    assert {one.key.split("/")[0] for one in data.recordings("train")} == {tars[0].stem}
    assert data.skipped[0].startswith(f"{tars[1]}: no file but a ")


def test_lists_and_texts_with_nothing_in_them(
    tmp_path: Path, make_images: Callable[..., None], write: Callable[..., Path]
) -> None:
    write("octopi/dataset/mug_0.mov", "")
    constants = write("octopi/utils/constants.py", "# nothing\n")
    with pytest.raises(DataError, match=f"{constants}: no objects, ranks or words"):
        list(Octopi(str(tmp_path / "octopi")).recordings("train"))
    make_images("real/tactile/1/a/gelsight/{}.png", range(3))
    index = write("real/contact_text_obj.csv", "")
    with pytest.raises(DataError, match=f"{index}: empty"):
        list(ObjectFolderReal(str(tmp_path / "real")).recordings("train"))
    write("real/contact_text_obj.csv", "1/a/gelsight/1.png,1/a/view/9.png,0\n")
    data = ObjectFolderReal(str(tmp_path / "real"), val=0)
    assert [*data.recordings("train")]
    assert "the views of 1 touches are not there" in data.notes[0]
    empty = write("tvl/hct/data1/train.csv", "")
    with pytest.raises(DataError, match=f"{empty}: empty"):
        list(Tvl(str(tmp_path / "tvl")).recordings("train"))


def test_a_caption_with_nothing_in_it(
    tmp_path: Path, make_image: Callable[..., Path], write: Callable[..., Path]
) -> None:
    for number in range(2):
        make_image(f"ssvtp/images_tac/image_{number}_tac.jpg")
        write(f"ssvtp/text/labels_{number}.txt", "soft" if number else "\n")
    data = Ssvtp(str(tmp_path), val=0)
    assert [one.text for one in data.recordings("train")] == [None, "soft"]
    assert data.notes == [f"{tmp_path / 'ssvtp/text/labels_0.txt'}: no caption is in it"]
