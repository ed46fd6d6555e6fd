"""Words in names of pictures: of touch, of views of a scene, and of computed ones."""

from __future__ import annotations

import re
from collections.abc import Collection, Sequence
from itertools import pairwise
from pathlib import Path

from tactileforge.reading.table_families import apart_by_capitals

#: Parts of words that mean touch, and whole words that do.
_TOUCH_PARTS = (
    *("tactile", "touch", "gelsight", "gelslim", "taxel", "tactip", "tacto", "dtact", "dmtac"),
    *("mctac", "xense", "daimon", "skin", "flexitac", "gsmini", "duragel", "papillarray"),
)
_TOUCH = {"digit", "digits", "tac", "tacs", "gel", "gels", "gs", "xela", "paxini", "fingertip"}
#: Words of fingers, whose pictures are touch where nothing else says touch.
FINGERS = {"finger", "fingers", "fingertip", "fingertips", "thumb", "pinky"}
#: Words of the robot's body: a force there is none on the gel.
ROBOT = {
    *("robot", "tcp", "flange", "wrist", "arm", "ee", "eef", "gripper", "base", "joint", "joints"),
    *("motor", "external", "ext"),
}
#: Words of what is aimed at, and not measured.
COMMANDS = {"cmd", "command", "action", "desired", "des", "target", "goal", "ref", "limit"}
#: Short words of sides.
_SIDES = {"l": "left", "r": "right", "lf": "left", "rf": "right"}
#: Words of pictures that are computed from others.
DERIVED = {
    *("depth", "flow", "mask", "masks", "seg", "segmentation", "marker", "markers", "diff"),
    *("difference", "normal", "normals", "height", "heightmap", "shear", "embedding", "emb"),
    *("latent", "pred", "next"),
}
#: Words of views of a scene.
VIEWS = {"camera", "cameras", "cam", "image", "images", "img", "imgs", "rgb", "view", "views"}
#: Words that no picture of touch has, whatever the others are called.
_SCENE = {
    *("webcam", "realsense", "kinect", "gopro", "agentview", "thirdperson", "orbbec"),
    *("d405", "d415", "d435", "l515"),
}
#: The same for folders of images, without markers: those may be on the gel itself.
_COMPUTED = DERIVED - {"marker", "markers"}
#: Words of a view of a scene beside pictures that are called touch.
_BESIDE = VIEWS | _COMPUTED | {"color", "colour", "vision", "visual", "wrist", "third", "front"}
_BESIDE |= {"side", "top", "eye", "hand", "robot", "head", "scene", "external", "overhead", "zed"}


def says_touch(words: Sequence[str]) -> bool:
    """Whether words of a name say touch."""
    parts = any(part in word for part in _TOUCH_PARTS for word in words)
    return parts or not _TOUCH.isdisjoint(words)


def words_of(name: str) -> tuple[str, ...]:
    """Words of a path, in small letters.

    Example:
        >>> words_of("obs/leftTactile_img2")
        ('obs', 'left', 'tactile', 'img', '2')
    """
    return tuple(re.findall(r"[a-z]+|\d+", apart_by_capitals(name).lower()))


def force_of_touch(
    touch: Sequence[str], forces: Sequence[str], *, only: bool = True
) -> dict[str, str]:
    """Name the force on the gel of each touch, if names leave no choice.

    A force of the robot's body (`ROBOT`), or one that is aimed at (`COMMANDS`), is none, unless its
    touch has the same word. A touch has the one force that shares a word with it and with no other
    touch, such as ``left``.

    Args:
        touch: Names of keys, features or topics of touch.
        forces: Those of forces.
        only: Whether the only force left belongs to the only touch, whatever their names.

    Returns:
        Name of the force, by that of its touch; touch without one is left out.

    Example:
        >>> force_of_touch(["digit"], ["ft/wrench", "robot/wrench"])
        {'digit': 'ft/wrench'}
        >>> force_of_touch(["left/digit", "right/digit"], ["r_force", "l_force"])
        {'left/digit': 'l_force', 'right/digit': 'r_force'}
    """
    words = {name: {_SIDES.get(word, word) for word in words_of(name)} for name in touch}
    said = {name: {_SIDES.get(word, word) for word in words_of(name)} for name in forces}
    shared = set.intersection(*words.values()) if len(words) > 1 else set()
    out: dict[str, str] = {}
    for name, own in words.items():
        others = set().union(*(words[one] - shared for one in words if one != name)) - own
        fits = [one for one in forces if not said[one] & ((ROBOT | COMMANDS) - own | others)]
        alike = [one for one in fits if said[one] & (own - shared - VIEWS)]
        chosen = alike or (fits if only and len(touch) == 1 else [])
        if len(chosen) == 1:
            out[name] = chosen[0]
    return out if len({*out.values()}) == len(out) else {}


def scenes(paths: Sequence[Path], root: Path) -> list[Path]:
    """Find pictures and films of a scene among those of touch, by the words of their names.

    Those with the name of a camera for scenes (``webcam``, ``realsense``) are, where others have
    none. Those with a usual word of a view (``rgb``, ``wrist``), or of what is computed
    (``depth``), are where all others are called touch: beside ``cup``, ``rgb`` may be an object.

    Args:
        paths: Files below ``root``.
        root: Folder of them.

    Example:
        >>> files = [Path("a/tactile/0.png"), Path("a/rgb/0.png"), Path("b/tactile/0.png")]
        >>> [path.as_posix() for path in scenes(files, Path())]
        ['a/rgb/0.png']
    """
    kinds: dict[str, list[Path]] = {}
    for path in paths:
        name = path.relative_to(root).with_suffix("").as_posix()
        kinds.setdefault(re.sub(r"\d+(?![a-z])", "", name), []).append(path)
    words = {kind: {*words_of(kind), *_joined(kind)} for kind in kinds}
    same = set.intersection(*words.values()) if words else set()
    own = {kind: said - same for kind, said in words.items()}
    touch = {kind for kind, said in own.items() if says_touch([*said])}
    out = {kind for kind in own.keys() - touch if own[kind] & _SCENE}
    beside = {kind for kind in own.keys() - touch if own[kind] & (_SCENE | _BESIDE)}
    if touch and len(touch) + len(beside) == len(own):
        out = beside
    out |= {kind for kind in own.keys() - out if _is_computed(kind, own)}
    return [path for kind in kinds if kind in out for path in kinds[kind]] if out != {*own} else []


def _is_computed(kind: str, kinds: Collection[str]) -> bool:
    """Whether a name adds a word for a computed picture to the name of another kind.

    ``gelsight_depth`` beside ``gelsight`` or ``gelsight_rgb``.
    """
    parts = kind.split("/")
    for place, part in enumerate(parts):
        said = {*words_of(part)}
        rest = said - _COMPUTED
        if not rest or rest == said:
            continue
        for other in kinds:
            named = other.split("/")
            same = len(named) == len(parts) and all(
                a == b for i, (a, b) in enumerate(zip(named, parts, strict=True)) if i != place
            )
            if same and {*words_of(named[place])} - VIEWS == rest:
                return True
    return False


def _joined(name: str) -> set[str]:
    """Neighboring words and numbers of a name as one word: ``third_person``, ``d435``."""
    return {first + second for first, second in pairwise(words_of(name))}
