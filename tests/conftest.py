import os
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
import torch

from tactileforge import registry
from tactileforge.contracts import Batch
from tactileforge.encoders.tactile_vit import TactileViT


def pytest_configure(config: pytest.Config) -> None:
    """Processes that test side by side (``pytest -n 2``) compute with one thread each."""
    if config.getoption("numprocesses", default=None):
        os.environ["OMP_NUM_THREADS"] = "1"  # they are started with these variables


@pytest.fixture(autouse=True, scope="session")
def _cache(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Touches that tests simulate are kept for the other tests, and thrown away after them.

    Processes that test side by side have folders of their own in one folder, and share this one.
    """
    if "PYTEST_XDIST_WORKER" in os.environ:
        folder = tmp_path_factory.getbasetemp().parent / "cache"
    else:
        folder = tmp_path_factory.mktemp("cache")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("TACTILEFORGE_CACHE", str(folder))
        yield


@pytest.fixture(autouse=True)
def _seeded() -> None:
    torch.manual_seed(0)


@pytest.fixture
def encoder() -> TactileViT:
    return TactileViT("tiny", frames=4, image_size=32)


@pytest.fixture
def batch() -> Batch:
    """Eight clips: four objects, each by two sensors in one group; half have force."""
    rng = torch.Generator().manual_seed(1)
    return {
        "frames": torch.randint(0, 256, (8, 4, 3, 32, 32), dtype=torch.uint8, generator=rng),
        "background": torch.randint(90, 160, (8, 3, 32, 32), dtype=torch.uint8, generator=rng),
        "sensor": ["digit", "gelsight"] * 4,
        "force": torch.randn(8, 4, 3, generator=rng),
        "force_valid": torch.tensor([[True] * 3, [False] * 3] * 4),
        "force_scale": torch.tensor([[5.25, 10.61, 14.14], [6.84, 9.87, 8.52]] * 4),
        "action": torch.tensor([0, 0, 1, 1, 2, 2, -1, -1]),
        "object": torch.tensor([0, 0, 1, 1, 2, 2, 3, 3]),
        "text": ["a ball", "a ball", "", "a bar", "", "a ring", "a cross", "a nut"],
        "image": torch.randint(0, 256, (8, 3, 96, 96), dtype=torch.uint8, generator=rng),
        "image_valid": torch.tensor([True, True, False, True, True, False, True, True]),
        "surface": torch.randint(1, 256, (8, 4, 3, 32, 32), dtype=torch.uint8, generator=rng),
        "surface_valid": torch.tensor([True, False] * 4),
        "group": torch.tensor([0, 0, 1, 1, 2, 2, 3, 3]),
        "skipped": {},
    }


@pytest.fixture(scope="session")
def realdata() -> Path:
    """The folder of public recordings; tests that ask for it are skipped where it is absent."""
    beside = Path(__file__).parents[1] / ".." / "shared" / "realdata"
    folder = Path(os.environ.get("TACTILEFORGE_REALDATA", beside)).resolve()
    if not folder.is_dir():
        pytest.skip("no real recordings here: set TACTILEFORGE_REALDATA")
    return folder


@pytest.fixture
def installed(
    tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch
) -> Iterator[Callable[..., None]]:
    """Makes a folder look like an installed distribution that has entry points."""

    def install(name: str, entry_points: str, modules: dict[str, str]) -> None:
        site = tmp_path_factory.mktemp("site")
        metadata = f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n"
        info = f"{name.replace('-', '_')}-1.0.dist-info"
        files = {f"{info}/METADATA": metadata, f"{info}/entry_points.txt": entry_points, **modules}
        for path, text in files.items():
            (site / path).parent.mkdir(parents=True, exist_ok=True)
            (site / path).write_text(text)
        monkeypatch.syspath_prepend(site)
        registry._entries.cache_clear()

    yield install
    registry._entries.cache_clear()
