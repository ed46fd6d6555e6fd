"""The suite ``classes``: a folder of images for each class, or train and val folders of these."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from tactileforge.errors import ConfigError, DataNotFoundError, home_path
from tactileforge.specs import SPECS

#: Names of folders of images by their use; in lower case.
_SIDES = {
    "train": ("train", "training"),
    "validation": ("val", "valid", "validation"),
    "test": ("test", "testing"),
}


def class_task(task: Mapping[str, Any], classes: Mapping[str, Any]) -> dict[str, Any]:
    """The task of classes, with the split of its folders.

    Where ``root`` holds ``train`` and ``val`` (or ``test``) folders of classes, the first trains
    and the last tests; of all three, ``val`` chooses the penalty. ``folds`` mixes them instead.
    Folders of classes alone are tested in five folds.

    Args:
        task: Configuration of the task.
        classes: The keys ``classes.*``.

    Raises:
        ConfigError: ``root`` or ``sensor`` is not given; or there is a folder to test on, and none
            to train on, or the other way round.
        DataNotFoundError: ``root`` is not a folder.
    """
    root = _root(classes["root"])
    if classes["sensor"] is None:
        raise ConfigError(
            f"give classes.sensor=NAME, the sensor of the images: {', '.join(sorted(SPECS))}"
        )
    sides = _sides(root)
    task = {**task, "data": dict(task["data"]), "split": dict(task["split"])}
    held = [side for side in ("validation", "test") if side in sides]
    if not sides:
        task["split"]["folds"] = classes["folds"] or 5
        return task
    if "train" not in sides or not held:
        raise ConfigError(
            f"classes.root={root}: it holds {', '.join(sides.values())} of classes, and no folder "
            f"{'train' if held else 'val or test'} beside it: add it, or give "
            f"classes.root={root / next(iter(sides.values()))}"
        )
    layout = dict(task["data"]["layouts"]["images"])
    task["data"]["layouts"] = {
        side: {
            **layout,
            "images": [f"{sides[side]}/{glob}" for glob in classes["images"]],
            "hold_out": "none" if side == "train" else "all",
        }
        for side in ("train", *held)
    }
    if classes["folds"]:
        return task
    task["split"] |= {"folds": 0, "test": {"side": "val"}}
    if len(held) == 2:
        # the two of one side are told apart by the folder in the key
        folder = rf"re:^[^/]*/({'|'.join(sides[side] for side in held)})/"
        task["split"] |= {
            "test": {"side": "val", folder: sides["test"]},
            "validation": {"side": "val", folder: sides["validation"]},
        }
    return task


def _root(given: Any) -> Path:
    """The folder of the classes."""
    if given is None:
        raise ConfigError("give classes.root=DIR, a folder with a folder of images for each class")
    root = home_path(str(given))
    if not root.is_dir():
        raise DataNotFoundError(
            f"classes.root={given}: {'not a' if root.exists() else 'no such'} folder; give one "
            "with a folder of images for each class"
        )
    return root


def _sides(root: Path) -> dict[str, str]:
    """Name of the folder of each use, if it holds folders of classes."""
    found = {}
    for path in sorted(root.iterdir()):
        for side, names in _SIDES.items():
            if path.name.lower() in names and any(below.is_dir() for below in path.iterdir()):
                found[side] = path.name
    return found
