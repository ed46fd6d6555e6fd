"""Probes by name: small models trained on the features of an encoder.

A new probe is a file here with a subclass of `base.Probe`, and a line in `PROBES`.
"""

from __future__ import annotations

from importlib import import_module

from tactileforge.errors import ConfigError, unknown
from tactileforge_bench.fit.probes.base import Probe

#: Module and class by name.
PROBES = {
    "linear": "linear:Linear",
    "linear_adamw": "linear_adamw:LinearAdamW",
    "attentive": "attentive:Attentive",
    "force": "force:Force",
    "sparsh_force": "force:SparshForce",
    "slip": "slip:Slip",
    "pose": "pose:Pose",
    "knn": "knn:Knn",
    "ridge": "ridge:Ridge",
    "logistic": "logistic:Logistic",
    "zero_shot": "zero_shot:ZeroShot",
}


def probe_class(name: str) -> type[Probe]:
    """The class of a probe.

    Raises:
        ConfigError: No such probe; lists those that there are.
    """
    if name not in PROBES:
        raise ConfigError(unknown("probe", name, PROBES))
    module, _, kind = PROBES[name].partition(":")
    probe_class: type[Probe] = getattr(import_module(f"{__name__}.{module}"), kind)
    return probe_class
