import pytest


@pytest.fixture(autouse=True, scope="session")
def _cache(tmp_path_factory):
    """Touches that tests simulate are thrown away after them."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("TACTILEFORGE_CACHE", str(tmp_path_factory.mktemp("cache")))
        yield
