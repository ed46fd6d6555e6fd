import pytest


@pytest.fixture(autouse=True, scope="session")
def _cache(tmp_path_factory):
    """Puts files made by tests in a temporary cache."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("TACTILEFORGE_CACHE", str(tmp_path_factory.mktemp("cache")))
        yield
