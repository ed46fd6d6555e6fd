"""Distributions of the plugins of a run."""

import pytest

from tactileforge.errors import PluginError
from tactileforge.plugins import registry
from tactileforge.plugins.recorded import check_installed

RUN = {
    "encoder": {"name": "tactile_vit"},
    "objective": {"glow": {"name": "glow", "weight": 1.0}, "pixel": {"name": "pixel"}},
    "head": {"glow": {"name": "glow"}, "mine": {"name": "my_module:Head"}},
    "callbacks": {"blink": {"patience": 3}},
    "augment": {"also": {"speckle": {"name": "dusty"}}},
    "optim": {"name": "adamw", "schedule": "stairs"},
    "logger": {"name": "csv"},
}


@pytest.mark.parametrize(
    ("recorded", "said"),
    [
        (
            {"objectives/glow": "acme-glow 0.3", "heads/glow": "acme-glow 0.3"},
            "runs/a was made with head 'glow' and objective 'glow' of acme-glow 0.3, which is not "
            "installed: install it as for that run",
        ),
        ({"callbacks/blink": "acme 1"}, "callback 'blink' of acme 1, which is not installed"),
        ({"augmentations/dusty": "acme 1"}, "augmentation 'dusty' of acme 1"),
        ({"schedules/stairs": "acme 1"}, "schedule 'stairs' of acme 1"),
        ({"objectives/glow": "numpy 0.1"}, r"'glow' of numpy 0.1, and [\d.]+ is installed, which"),
    ],
)
def test_the_distribution_of_an_absent_plugin_is_named(recorded, said):
    with pytest.raises(PluginError, match=said):
        check_installed(RUN, recorded, "runs/a")


def test_one_of_our_packages_is_named_with_its_command(monkeypatch):
    monkeypatch.setattr(registry, "names", lambda kind: [])
    config, recorded = {"encoder": {"name": "timm"}}, {"encoders/timm": "tactileforge-timm 0.1"}
    with pytest.raises(PluginError, match=r"encoder 'timm', which comes with tactileforge-timm: "):
        check_installed(config, recorded, "runs/a", ("encoder",))


def test_what_is_installed_or_was_not_recorded_is_left_to_its_own_error():
    check_installed(RUN, {"objectives/pixel": "tactileforge 0.1"}, "runs/a")
    check_installed(RUN, {"objectives/glow": "acme-glow 0.3"}, "runs/a", ("encoder",))
