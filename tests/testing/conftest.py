import pytest

from tactileforge.testing import check


@pytest.fixture
def statuses():
    """Checks a plugin; gives the status of each check."""

    def of(kind, plugin, **options):
        return {result.name: result.status for result in check(kind, plugin, **options)}

    return of


@pytest.fixture
def failed():
    """Checks a plugin; gives the checks that fail, and what they say."""

    def of(kind, plugin, **options):
        results = check(kind, plugin, **options)
        return {result.name: result.detail for result in results if result.status == "failed"}

    return of
