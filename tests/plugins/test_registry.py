import inspect
import re
import subprocess
import sys
from email import message_from_string
from importlib.metadata import entry_points, version

import pytest

from tactileforge import list_plugins
from tactileforge.errors import ConfigError, PluginError
from tactileforge.plugins import metadata, registry

SENSOR = """
class Toy:
    def __init__(self, encoder, gain: float = 1.0, *, port):
        self.given = (encoder, gain, port)
"""


def test_built_ins_are_on_the_same_entry_points_as_anyone():
    assert {"align", "diff", "force", "match", "pixel"} <= set(registry.names("objectives"))
    plugin = next(p for p in list_plugins() if (p.kind, p.name) == ("encoders", "tactile_vit"))
    assert plugin.target == "tactileforge.encoders.tactile_vit:TactileViT"
    assert (plugin.distribution, plugin.status) == ("tactileforge", "ok")


def test_every_built_in_can_be_imported():
    for plugin in list_plugins():
        if plugin.distribution == "tactileforge":
            loaded = registry.get(plugin.kind, plugin.name)
            assert inspect.isclass(loaded) or plugin.kind == "schedules"
            assert callable(loaded)


def test_listing_imports_no_plugin_and_nothing_heavy(installed):
    installed("toy", "[tactileforge.sensors]\ntoy = toy_that_raises:Toy", {})
    assert "toy" in registry.names("sensors")
    code = (
        "import sys; from tactileforge import list_plugins; list_plugins();"
        "print([m for m in ('torch', 'lightning', 'hydra', 'cv2') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"


def test_unknown_name_lists_what_is_installed_and_the_nearest():
    with pytest.raises(PluginError) as error:
        registry.get("objectives", "pixle")
    text = str(error.value)
    assert "did you mean 'pixel'?" in text
    assert f"Known: {', '.join(sorted(registry.names('objectives')))}" in text
    assert "align, classify, denoise, diff" in text
    assert "nstall" not in text  # a typing mistake is not a package
    with pytest.raises(PluginError, match="Install the package that provides it"):
        registry.get("objectives", "thermal")
    with pytest.raises(PluginError, match=r"callbacks:Class, and your own my_module:Class"):
        registry.get("callbacks", "swa")


def test_unknown_kind():
    with pytest.raises(PluginError, match=r"'sensor'; did you mean 'sensors'"):
        registry.names("sensor")


@pytest.mark.parametrize(
    ("source", "reason"),
    [
        ("import no_such_sdk", "ModuleNotFoundError: No module named 'no_such_sdk'"),
        ("1 / 0", "ZeroDivisionError: division by zero"),
        ("", "AttributeError: module 'toy_broken' has no attribute 'Toy'"),
    ],
)
def test_broken_plugin_breaks_only_those_that_use_it(installed, monkeypatch, source, reason):
    monkeypatch.delitem(sys.modules, "toy_broken", raising=False)
    entry_points = "[tactileforge.sensors]\nbroken = toy_broken:Toy"
    installed("toy-broken", entry_points, {"toy_broken.py": source})
    assert {"broken", "replay"} <= set(registry.names("sensors"))
    assert registry.get("sensors", "replay").__name__ == "Replay"
    said = f"sensor 'broken' (toy_broken:Toy, from toy-broken 1.0) cannot be loaded: {reason}"
    with pytest.raises(PluginError, match=re.escape(said)):
        registry.get("sensors", "broken")


def test_conflict_names_both_distributions(installed):
    entry_points = "[tactileforge.sensors]\ntwin = toy_twin:Toy"
    installed("toy-first", entry_points, {"toy_twin.py": SENSOR})
    assert registry.get("sensors", "twin").__name__ == "Toy"
    installed("toy-second", entry_points, {})
    with pytest.raises(PluginError, match=r"toy-second 1\.0.*and.*toy-first 1\.0.*uninstall one"):
        registry.get("sensors", "twin")
    twins = [plugin for plugin in list_plugins() if plugin.name == "twin"]
    assert [plugin.status for plugin in twins] == ["conflict", "conflict"]
    assert {plugin.distribution for plugin in twins} == {"toy-first", "toy-second"}


def test_one_distribution_seen_twice_is_no_conflict(installed):
    entry_points = "[tactileforge.sensors]\ntwin = toy_twin:Toy"
    installed("toy-same", entry_points, {"toy_twin.py": SENSOR})
    installed("toy-same", entry_points, {"toy_twin.py": SENSOR})
    assert registry.get("sensors", "twin").__name__ == "Toy"


@pytest.fixture
def toy(installed):
    installed("toy", "[tactileforge.sensors]\ntoy = toy_sensor:Toy", {"toy_sensor.py": SENSOR})
    return registry.get("sensors", "toy")


def test_parameters_are_the_configuration_without_context(toy):
    assert registry.parameters(toy) == {"gain": 1.0, "port": inspect.Parameter.empty}
    assert registry.context(toy) == {"encoder"}


def test_build_passes_options_and_the_context_it_names(toy):
    built = registry.build("sensors", {"name": "toy", "port": 3}, encoder="E", text_encoder="T")
    assert built.given == ("E", 1.0, 3)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"port": 3, "gian": 2}, r"option of sensor 'toy' 'gian'; did you mean 'gain'"),
        ({}, r"sensor 'toy' needs 'port': set port=\.\.\."),
        ({"port": 3, "encoder": "mine"}, r"unknown option of sensor 'toy' 'encoder'"),
        ({"port": 3, "gain": "much"}, r"sensor 'toy': gain is 'much', .* not of type float"),
    ],
)
def test_build_rejects_options_that_do_not_fit(toy, options, message):
    with pytest.raises(ConfigError, match=message):
        registry.build("sensors", {"name": "toy", **options})


@pytest.mark.parametrize(
    ("kind", "options", "message"),
    [
        ("datasets", {"name": "sim", "val": 1.5}, "data.val is 1.5, which"),
        (
            "datasets",
            {"name": "shards", "root": "x", "val": 1.5},
            "data.val is 1.5; give the share",
        ),
        ("datasets", {"name": "shards"}, "dataset 'shards' needs 'root': set data.root=..."),
        ("datasets", {"name": "shards", "root": "x", "hold_out": "tak"}, "unknown hold_out 'tak'"),
    ],
)
def test_build_names_the_place_of_an_option(kind, options, message):
    with pytest.raises(ConfigError, match=f"^.*{re.escape(message)}") as told:
        registry.build(kind, options, "data")
    assert "data.unknown" not in str(told.value)


def test_metadata_of_a_package_are_parsed_once(monkeypatch):
    parsed = []

    def counted(text):
        parsed.append(text)
        return message_from_string(text)

    monkeypatch.setattr(metadata, "message_from_string", counted)
    metadata._name_and_version.cache_clear()
    owners = {metadata.owner(entry) for entry in entry_points(group="tactileforge.objectives")}
    assert len(parsed) == len(owners)
    assert ("tactileforge", version("tactileforge")) in owners
