from importlib import import_module

import pytest

from tactileforge.testing import check
from tactileforge.testing.results import CheckSubject, run_check
from tactileforge.util.threads import one_thread


@pytest.fixture(autouse=True)
def _one_thread():
    with one_thread():
        yield


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


@pytest.fixture
def result_of():
    """Makes one check of a class."""

    def of(kind, plugin, name, **options):
        checks = import_module(f"tactileforge.testing.{kind}s").CHECKS
        check = next(check for check in checks if check.__name__ == name.replace(" ", "_"))
        return run_check(check, CheckSubject(f"{kind}s", plugin, "", {}, **options))

    return of
