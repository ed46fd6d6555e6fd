"""Options of installed distributions, and the content of those in `plugins/`; imports nothing."""

from __future__ import annotations

import re
import shlex
from importlib.metadata import PackageNotFoundError, distribution, entry_points
from pathlib import Path

from tactileforge.util.origin import clone, folder, install_extra, local, origin, typed

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
        "verbs": ("bench", "zoo.gate"),
    },
    "tactileforge-datasets": {
        "datasets": (
            *("anytouch2", "cloth", "feats", "feel", "feelanyforce", "fota"),
            *("gelsight_mini_pretrain", "gelslam", "gsmini_slip", "image_tables", "incipient_slip"),
            *("objectfolder_real", "octopi", "public_samples", "sparsh", "sparsh_force"),
            *("sparsh_pose", "sparsh_slip", "ssvtp", "tacquad", "tactile_mnist"),
            *("tactile_tracking", "touch_and_go", "touch_slide", "touchd_force", "touchd_mani"),
            *("touchd_sim", "tvl", "unitac_nv", "visgel", "webdataset", "webdataset_classes"),
            *("webdataset_clips", "ycb_slide"),
        ),
        "verbs": ("data.parquet", "data.tlabel"),
    },
    "tactileforge-bridge": {"publishers": ("ros2", "zmq")},
    "tactileforge-digit": {"sensors": ("digit",)},
    "tactileforge-dmtac": {"sensors": ("dmtac", "dmtac_sdk")},
    "tactileforge-episodes": {
        "datasets": (
            *("aloha", "episodes", "freetacman", "htt", "manifeel", "omnisharing"),
            *("open_x_tactile", "reactive_diffusion", "touch_in_the_wild", "univtac"),
            *("vitamin_b", "vtouch"),
        ),
        "verbs": ("data.zarr",),
    },
    "tactileforge-export": {"verbs": ("export",)},
    "tactileforge-flexitac": {"sensors": ("flexitac",)},
    "tactileforge-ft": {"sensors": ("ati_netft", "robotiq")},
    "tactileforge-gelsight": {"sensors": ("gelsight_mini", "gelsight_mini_markers")},
    "tactileforge-inspect": {"verbs": ("data.check", "data.inspect")},
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


def how_to_get(kind: str, name: str) -> str:
    """Words on the package of ours with a plugin or option, and how to install it; "" for none.

    Args:
        kind: Kind of the plugin, or a group of options such as ``recipe``.
        name: Name that users type.

    Example:
        >>> how_to_get("recipe", "no_such_recipe")
        ''
    """
    package = package_of(kind, name)
    return package and f"comes with {package}: {install_command(package)}"


def install_command(package: str) -> str:
    """Shell command that installs a package or an extra from where this package came.

    Our packages are on no index, where a stranger could take their names. They are installed from
    the clone or the folder of wheels that this package was installed from, with those of ours that
    they need.

    Args:
        package: Name of the package; one that is not ours is taken from an index. With an extra
            in brackets it is one of ours that is installed: outside a clone, what the extra
            requires is named instead.

    Example:
        >>> install_command("tactileforge-sim").endswith("plugins/tactileforge-sim")
        True
        >>> install_command("numpy")
        'pip install numpy'
    """
    name, _, extra = package.rstrip("]").partition("[")
    if not is_ours(name):
        return f"pip install {package}"
    if extra:
        return install_extra(extra, name)
    if place := clone(package):
        return f"pip install {' '.join(_folders(place, package))}"
    noted = origin()
    url = str(noted.get("url", ""))
    if version := noted.get("vcs_info"):
        where = f"{version['vcs']}+{url}@{version['commit_id']}#subdirectory=plugins/{package}"
        return f"pip install {shlex.quote(f'{package} @ {where}')}"
    wheel = f"{package.replace('-', '_')}-*.whl"
    beside = local(url).parent if url.endswith(".whl") and url.startswith("file:") else None
    if beside is not None and (found := sorted(beside.glob(wheel))):
        wheels = shlex.quote(str(beside))
        return f"pip install --find-links {wheels} {shlex.quote(str(found[-1]))}"
    # the file by its name: an index is not asked for it
    return f"pip install --find-links WHEELS WHEELS/{wheel} (WHEELS: where tactileforge's own lies)"


def _folders(place: Path, package: str) -> list[str]:
    """Folders of a package and of those of ours that it needs and that are absent, as typed."""
    wanted = [package]
    for name in wanted:  # grows while it is read
        text = (place / folder(name) / "pyproject.toml").read_text("utf-8")
        needs = re.search(r"^dependencies = \[(.*?)\]", text, re.MULTILINE | re.DOTALL)
        for need in re.findall(r'"(tactileforge-[\w-]+)', needs[1] if needs else ""):
            if need not in wanted and need in _OURS and not _is_installed(need):
                wanted.append(need)
    return [shlex.quote(typed(place, name)) for name in wanted]


def _is_installed(package: str) -> bool:
    try:
        distribution(package)
    except PackageNotFoundError:
        return False
    return True


def is_ours(distribution: str) -> bool:
    """Whether a distribution is the core or one of our packages."""
    return distribution == "tactileforge" or distribution in _OURS


def conf_packages() -> list[str]:
    """Packages of YAML options, recipes and cards in installed distributions."""
    return [entry.value for entry in entry_points(group="tactileforge.conf")]
