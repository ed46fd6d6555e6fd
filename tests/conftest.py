import os
import signal

import pytest
from shared_fixtures import *  # noqa: F403


def pytest_configure(config: pytest.Config) -> None:
    """Processes side by side (``pytest -n 2``) compute with one thread each."""
    defaults = {signal.SIGINT: signal.default_int_handler, signal.SIGHUP: signal.SIG_DFL}
    for number, handler in defaults.items():
        if signal.getsignal(number) is signal.SIG_IGN:  # `nohup` and shells in the background
            signal.signal(number, handler)
    os.environ.pop("PYTEST_ADDOPTS", None)  # were of this run, not of those that tests start
    if config.getoption("numprocesses", default=None):
        os.environ["OMP_NUM_THREADS"] = "1"  # they are started with these variables


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Starts the longest tests first: at the end two processes would wait for the third."""
    long = ("test_docs.py", "test_ddp.py", "test_learning.py", "test_resume.py")
    items.sort(key=lambda item: item.path.name not in long)
