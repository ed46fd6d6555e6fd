"""Each test breaks one thing, and one check sees it."""

import os
import sys
import threading
from pathlib import Path

import pytest
import torch
from torch import nn

from tactileforge.errors import PluginError
from tactileforge.testing import check


class Plain:
    """It has nothing of its kind; the others break one thing that every kind has."""

    def __init__(self, gain: float = 1.0) -> None:
        self.gain = gain


def test_good_class_passes(statuses):
    status_by_name = statuses("sensor", Plain)
    assert (
        status_by_name["name is snake case"]
        == status_by_name["module imports no vendor sdk"]
        == "skipped"
    )
    assert status_by_name["parameters are explicit"] == "ran"
    assert status_by_name["defaults are plain data"] == "ran"
    assert status_by_name["constructing does no io"] == "ran"


class StarArguments(Plain):
    def __init__(self, **options) -> None:
        super().__init__()


class OddDefault(Plain):
    def __init__(self, folder: Path = Path()) -> None:
        super().__init__()


class OpensAFile(Plain):
    def __init__(self) -> None:
        super().__init__()
        with open(os.devnull):
            pass


class StartsAThread(Plain):
    stop = threading.Event()

    def __init__(self) -> None:
        super().__init__()
        threading.Thread(target=self.stop.wait, args=(9,), daemon=True).start()


class KeepsAHandle(Plain):
    """Native code opens files unknown to Python, as video drivers do."""

    def __init__(self) -> None:
        super().__init__()
        import ctypes

        pipe = (ctypes.c_int * 2)()
        ctypes.CDLL(None).pipe(pipe)


class ImportsLazily(Plain):
    def __init__(self) -> None:
        super().__init__()
        sys.modules.pop("this_is_imported_late", None)
        import this_is_imported_late  # noqa: F401


class Raises(Plain):
    def __init__(self) -> None:
        raise RuntimeError("out of order")


@pytest.mark.parametrize(
    ("plugin", "name", "detail"),
    [
        (StarArguments, "parameters are explicit", "options"),
        (OddDefault, "defaults are plain data", "folder"),
        (OpensAFile, "constructing does no io", "open '/dev/null'"),
        (StartsAThread, "constructing does no io", "leaves a thread running"),
        (KeepsAHandle, "constructing does no io", "leaves a file or device open"),
        (Raises, "constructing does no io", "RuntimeError: out of order"),
    ],
)
def test_constructor(failed, plugin, name, detail):
    assert detail in failed("sensor", plugin)[name]


def test_a_lazy_import_is_no_io(failed, tmp_path, monkeypatch):
    (tmp_path / "this_is_imported_late.py").write_text("open(__file__).close()")
    monkeypatch.syspath_prepend(tmp_path)
    assert "constructing does no io" not in failed("sensor", ImportsLazily)


def test_io_is_heard_only_while_constructing(failed):
    failed("sensor", OpensAFile)
    with open(os.devnull):
        pass
    assert "constructing does no io" not in failed("sensor", Plain)


SENSOR_MODULE = """
from importlib.metadata import version
import numpy
import torch
from tactileforge.contracts import SensorSpec
from {package} import helper
class Sensor:
    spec = SensorSpec(name="s", height=6, width=8, fps=30, area_mm=None, force_scale=(1., 1., 1.))
    def open(self):
        import acme_sdk
"""
GUARDED = "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    import acme_sdk\n"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("helper", "said"),
    [
        ("", None),
        (GUARDED, None),
        ("try:\n    import acme_sdk.camera as camera\nexcept ImportError: pass", "acme_sdk"),
        ("class Driver:\n    with __import__('contextlib').suppress(ImportError):\n"
         "        from acme_sdk import x", "acme_sdk"),
    ],
)  # fmt: skip
def test_vendor_sdk_at_top_level(failed, installed, request, helper, said):
    package = f"acme_{abs(hash(request.node.name))}"
    modules = {
        f"{package}/__init__.py": "",
        f"{package}/helper.py": helper,
        f"{package}/device.py": SENSOR_MODULE.format(package=package),
    }
    installed("acme", f"[tactileforge.sensors]\nacme = {package}.device:Sensor", modules)
    failures = failed("sensor", "acme").get("module imports no vendor sdk")
    assert (failures is None) == (said is None)
    assert said is None or f"imports {said!r} at top level" in failures


def test_name_is_snake_case(failed, installed):
    modules = {"acme_names.py": "class Sensor: pass"}
    installed("acme-names", "[tactileforge.sensors]\nMySensor = acme_names:Sensor", modules)
    assert failed("sensor", "MySensor")["name is snake case"] == "'MySensor' is not snake_case"


def test_a_plugin_that_cannot_be_imported_is_a_failure(installed):
    installed("acme-broken", "[tactileforge.sensors]\nacme_broken = acme_no_module:Sensor", {})
    (result,) = check("sensor", "acme_broken")
    assert (result.name, result.status) == ("it can be imported", "failed")
    assert "ModuleNotFoundError" in result.detail


@pytest.mark.parametrize(
    ("kind", "plugin", "message"),
    [
        ("sensro", "replay", r"kind of plugin 'sensro'; did you mean 'sensor'"),
        ("objective", "pixle", r"'pixle'; did you mean 'pixel'"),
        ("encoder", nn.Linear(1, 1), r"give check\(\) the class Linear"),
    ],
)
def test_what_cannot_be_checked(kind, plugin, message):
    with pytest.raises(PluginError, match=message):
        check(kind, plugin)


class KnownFailure(OpensAFile):
    expected_failures = {"constructing does no io": "the driver reads its licence"}  # noqa: RUF012


class NoFailureAnyMore(Plain):
    expected_failures = {"constructing does no io": "the driver reads its licence"}  # noqa: RUF012


def test_an_expected_failure_is_reported_as_such():
    result = next(r for r in check("sensor", KnownFailure) if r.status == "expected")
    assert result.name == "constructing does no io"
    assert result.detail.startswith("the driver reads its licence (")


def test_an_expected_failure_that_holds_is_a_failure(failed):
    assert "remove it" in failed("sensor", NoFailureAnyMore)["constructing does no io"]


def test_random_numbers_of_the_caller_are_left_alone():
    torch.manual_seed(3)
    first = torch.rand(2)
    torch.manual_seed(3)
    check("encoder", "byte")
    assert torch.equal(torch.rand(2), first)
