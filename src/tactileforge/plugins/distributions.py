"""Options of installed distributions, and the content of those in `plugins/`; imports nothing."""

from __future__ import annotations

from importlib.metadata import entry_points

#: Our own packages in plugins/: names they provide, by kind of plugin or group of options.
_OURS: dict[str, dict[str, tuple[str, ...]]] = {
    "tactileforge-anyskin": {"sensors": ("anyskin", "reskin")},
    "tactileforge-arrays": {
        "datasets": ("sim_array",),
        "recipe": ("anytouch2_array",),
        "sensors": ("serial_array",),
    },
    "tactileforge-bench": {
        "pretrain": ("miniature", "none"),
        "suite": (
            *("classes", "feel", "object", "public_samples", "real", "real_held_out", "sim"),
            *("sparsh", "touchd"),
        ),
        "verbs": ("bench",),
    },
    "tactileforge-datasets": {
        "datasets": (
            *("anytouch2", "cloth", "feats", "feel", "feelanyforce", "fota"),
            *("gelsight_mini_pretrain", "gelslam", "gsmini_slip", "incipient_slip"),
            *("objectfolder_real", "octopi", "public_samples", "sparsh", "sparsh_force"),
            *("sparsh_pose", "sparsh_slip", "ssvtp", "tacquad", "tactile_mnist"),
            *("tactile_tracking", "touch_and_go", "touch_slide", "touchd_force", "touchd_mani"),
            *("touchd_sim", "tvl", "unitac_nv", "visgel", "webdataset", "webdataset_classes"),
            *("webdataset_clips", "ycb_slide"),
        ),
    },
    "tactileforge-digit": {"sensors": ("digit",)},
    "tactileforge-dmtac": {"sensors": ("dmtac", "dmtac_sdk")},
    "tactileforge-episodes": {
        "datasets": (
            *("aloha", "episodes", "freetacman", "htt", "manifeel", "omnisharing"),
            *("open_x_tactile", "reactive_diffusion", "touch_in_the_wild", "univtac"),
            *("vitamin_b", "vtouch"),
        ),
    },
    "tactileforge-export": {"verbs": ("export",)},
    "tactileforge-flexitac": {"sensors": ("flexitac",)},
    "tactileforge-ft": {"sensors": ("ati_netft", "robotiq")},
    "tactileforge-gelsight": {"sensors": ("gelsight_mini", "gelsight_mini_markers")},
    "tactileforge-inspect": {"verbs": ("data.inspect",)},
    "tactileforge-labels": {"verbs": ("label",)},
    "tactileforge-lerobot": {
        "datasets": ("daimon", "lerobot", "opentouch", "taf", "trex"),
        "verbs": ("data.embed", "data.lerobot"),
    },
    "tactileforge-live": {"verbs": ("calibrate", "live", "record")},
    "tactileforge-depth": {},
    "tactileforge-markers": {
        "heads": ("markers",),
        "objectives": ("markers",),
        "trackers": ("markers",),
    },
    "tactileforge-policies": {
        "datasets": ("demonstrations",),
        "heads": ("act", "diffusion_policy", "regression"),
        "objectives": ("denoise", "imitate"),
        "recipe": ("diffusion_policy", "imitation"),
        "runners": ("manipulation",),
        "suite": ("manipulation",),
        "verbs": ("demos", "rollout"),
    },
    "tactileforge-published": {
        "encoders": ("resnet18", "vqgan"),
        "heads": ("published_force", "published_probe", "published_regressor"),
        "importers": ("published",),
    },
    "tactileforge-rosbags": {"datasets": ("rosbags",)},
    "tactileforge-sim": {
        "datasets": ("sim",),
        "sensors": ("sim", "sim_robot", "sim_wrench"),
        "verbs": ("sim",),
    },
    "tactileforge-timm": {"encoders": ("timm", "timm_image")},
}


def package_of(kind: str, name: str) -> str:
    """Name of our package with a plugin or option; "" for none.

    Args:
        kind: Kind of the plugin, or a group of options such as ``recipe``.
        name: Name that users type.

    Example:
        >>> package_of("recipe", "imitation")
        'tactileforge-policies'
    """
    found = (package for package, kinds in _OURS.items() if name in kinds.get(kind, ()))
    return next(found, "")


def is_ours(distribution: str) -> bool:
    """Whether a distribution is the core or one of our packages."""
    return distribution == "tactileforge" or distribution in _OURS


def conf_packages() -> list[str]:
    """Packages of YAML options, recipes and cards in installed distributions."""
    return [entry.value for entry in entry_points(group="tactileforge.conf")]
