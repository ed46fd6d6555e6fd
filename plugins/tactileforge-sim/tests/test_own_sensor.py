"""A sensor of a package, simulated from its spec."""

from dataclasses import replace

import numpy as np
import pytest
from tactileforge_sim.dataset import Sim

from tactileforge.errors import ConfigError
from tactileforge.plugin import Lamp, MarkerPattern, SensorSpec, Simulation
from tactileforge.specs import published

HOW = Simulation(
    dome=120.0,
    lamps=(Lamp(0.0, 0.6, (120, 40, 40)), Lamp(3.1, 0.6, (40, 40, 120))),
    base=(40, 40, 40),
    pattern=MarkerPattern(8, 6, (2.0, 2.0), 0.3),
)
OWN = SensorSpec(
    name="own",
    height=48,
    width=64,
    fps=20.0,
    area_mm=(14.0, 18.7),
    force_scale=(5.0, 5.0, 10.0),
    simulation=HOW,
)


@pytest.fixture
def own(monkeypatch, request):
    monkeypatch.setitem(published.SPECS, "own", replace(OWN, **getattr(request, "param", {})))


def recordings(tmp_path, **options):
    data = Sim(sensors=["own"], scenes=2, val=1, size=48, cache=str(tmp_path), **options)
    return list(data.recordings("train"))


def test_it_is_simulated_with_markers_or_without(own, tmp_path):
    shown = {}
    for markers in (False, True):
        (first, *_) = recordings(tmp_path, markers=markers)
        assert first.sensor == "own"
        assert np.nanmax(first.force[:, 2]) > 0.3
        still = first.no_contact.read([0])[0].astype(int)
        hardest = first.frames.read([int(np.nanargmax(first.force[:, 2]))])[0]
        assert np.abs(hardest - still).max() > 2 * np.abs(first.frames.read([0])[0] - still).max()
        shown[markers] = still
    assert shown[True].mean(2).min() < shown[False].mean(2).min() - 10  # dark dots


@pytest.mark.parametrize(
    ("own", "message"),
    [
        ({"simulation": None}, "unknown simulated sensor 'own'"),
        ({"simulation": replace(HOW, dome=20.0)}, "dome is 20.0 mm; give 100 mm or more"),
        ({"simulation": replace(HOW, lamps=())}, "it is dark"),
        ({"area_mm": None}, "give area_mm in its SensorSpec"),
    ],
    indirect=["own"],
)
def test_what_lacks_is_named(own, message, tmp_path):
    with pytest.raises(ConfigError, match=message):
        recordings(tmp_path, markers=False)
