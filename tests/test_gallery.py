"""The gallery has a card for each part, and its script draws one of each kind.

``python benchmarks/gallery_page.py`` writes the page and its pictures.
"""

from importlib.metadata import entry_points
from pathlib import Path

import pytest
from gallery import page, reports, touches
from gallery.entry import ASSETS, WIDTH
from PIL import Image

from tactileforge.plugins import registry
from tactileforge.specs.published import SPECS

ENTRIES = {(entry.kind, entry.name): entry for entry in page.entries()}
#: Most bytes of all pictures: the site is read on phones too.
MOST = 1_500_000


def _names(kind: str) -> set[str]:
    return {name for of, name in ENTRIES if of == kind}


def _ours(kind: str) -> set[str]:
    """Installed parts of this repository; the example package is a text for authors."""
    installed = entry_points(group=f"tactileforge.{kind}").names  # not what tests registered
    found = {name: registry.get(kind, name).__module__ for name in installed}
    return {name for name, module in found.items() if module.startswith("tactileforge")}


def test_every_part_has_a_card() -> None:
    assert _names("sensor") == set(SPECS) | _ours("sensors")
    assert _names("objective") == _ours("objectives")
    assert _names("reader") == _ours("datasets")
    assert _names("report") == {*reports.PAGES, "live"}


def test_the_page_is_that_of_the_script() -> None:
    written = page.PAGE.read_text("utf-8")
    assert written == page.text(), "write it: python benchmarks/gallery_page.py KIND"
    for entry in ENTRIES.values():
        assert len(entry.lines) == 3
        assert written.count(f"assets/gallery/{entry.file})") == 1


def test_the_pictures_are_there_and_small() -> None:
    files = {path.name: path for path in ASSETS.iterdir()}
    assert set(files) == {entry.file for entry in ENTRIES.values()}
    assert sum(path.stat().st_size for path in files.values()) < MOST
    for path in files.values():
        with Image.open(path) as picture:
            assert 300 < picture.width <= WIDTH


@pytest.mark.slow
@pytest.mark.parametrize("key", [("sensor", "sim_robot"), ("objective", "surface"),
                                 ("reader", "touchd_force")], ids="-".join)  # fmt: skip
def test_a_card_is_drawn(
    key: tuple[str, str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(touches, "SIZE", 48)
    touches.simulated.cache_clear()
    with Image.open(ENTRIES[key].save(tmp_path)) as picture:
        assert picture.format == "WEBP"
        assert len(picture.convert("RGB").getcolors(1 << 20) or []) > 100


@pytest.mark.slow
@pytest.mark.skipif(reports.browser() is None, reason="no Chromium is here")
def test_a_page_is_shown(tmp_path: Path) -> None:
    (tmp_path / "page.html").write_text("<body style='background:#2a6fdb'><h1>Report</h1>")
    picture = reports.shot((tmp_path / "page.html").as_uri(), 100)
    assert picture.size == reports.WINDOW
    assert picture.getpixel((5, 500)) == (42, 111, 219)
