import os
from collections.abc import Iterator

import pytest
import torch

from tactileforge import processes


@pytest.fixture(autouse=True, scope="session")
def _alone(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Puts the cache in a temporary folder; tests in parallel start no further processes."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("TACTILEFORGE_CACHE", str(tmp_path_factory.mktemp("cache")))
        if "PYTEST_XDIST_WORKER" in os.environ:
            patch.setattr(processes, "cpus", lambda: 1)
        yield


@pytest.fixture(autouse=True)
def _seeded() -> None:
    torch.manual_seed(0)
