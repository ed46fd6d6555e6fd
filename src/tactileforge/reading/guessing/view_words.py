"""Words in names of pictures: of touch, of views of a scene, and of computed ones."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from itertools import pairwise
from pathlib import Path

from tactileforge.reading.sides import SIDES

#: A capital that begins a word behind another.
_CAPITAL = re.compile(r"(?<=[a-z0-9])(?=[A-Z])")
#: Parts of words that mean touch, and whole words that do.
_TOUCH_PARTS = (
    *(
        "tactile",
        "touch",
        "gelsight",
        "gelslim",
        "taxel",
        "tactip",
        "tacto",
        "taxim",
        "dtact",
        "dmtac",
    ),
    *("taxim", "mctac", "xense", "daimon", "skin", "flexitac", "gsmini", "duragel", "papillarray"),
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
#: Words of what is computed from forces, or is none.
DERIVED_FORCES = {
    *("max", "min", "std", "stddev", "sd", "sigma", "var", "variance", "cov", "bias", "offset"),
    *("tare", "pred", "predicted", "prediction", "error", "err", "residual", "dot", "rate"),
    *("derivative", "vel", "velocity", "norm", "magnitude"),
}
#: Words of pictures without contact.
STILL = {"reference", "ref", "background", "bg", "baseline"}
#: Words of pictures that are computed from others.
DERIVED = {
    *("depth", "flow", "mask", "masks", "seg", "segmentation", "marker", "markers", "diff"),
    *("difference", "normal", "normals", "height", "heightmap", "shear", "embedding", "emb"),
    *("latent", "pred", "next", "overlay", "overlays", "annotated", "annotation", "annotations"),
    *("heatmap", "heatmaps", "plot", "plots", "preview", "previews", "thumbnail", "thumbnails"),
    *("visualization", "visualizations", "visualisation", "spectrogram", "debug"),
}
#: Words of pictures that a network is to give for others.
_WANTED = {"target", "targets", "label", "labels", "gt", "output", "outputs"}
#: Words of folders beside the recordings, of pictures that nothing touched.
_ASIDE = {
    *("plots", "figures", "results", "checkpoints", "calibration", "calib", "calibrations"),
    *("overlays", "annotated", "heatmaps", "previews", "thumbnails", "visualization", "debug"),
    *("visualizations", "screenshots"),
}
#: Words of views of a scene.
VIEWS = {"camera", "cameras", "cam", "image", "images", "img", "imgs", "rgb", "view", "views"}
#: Words of the view of a scene that is taken before others.
_FIRST_VIEWS = ("front", "agentview", "scene", "external", "top", "high", "main", "third", "head")
#: Words of views of a scene that say so without others.
_CAMERAS = {*_FIRST_VIEWS, "wrist", "camera", "cameras", "cam", "view"}
#: Words that no picture of touch has, whatever the others are called.
_SCENE = {
    *("webcam", "realsense", "kinect", "gopro", "agentview", "thirdperson", "orbbec"),
    *("d405", "d415", "d435", "d435i", "d455", "l515"),
}
#: Words of pictures that are no view of a scene either.
NO_VIEW = DERIVED | _WANTED | _ASIDE
#: Words that a name of captured pictures may have beside those of computed ones.
_CAPTURED = VIEWS | {
    *("color", "colour", "raw", "input", "inputs"),
    *("rectify", "rectified", "undistorted", "cropped"),
}
#: The same for folders of images, without markers: those may be on the gel itself.
_COMPUTED = DERIVED - {"marker", "markers"}
#: Words of a view of a scene beside pictures that are called touch.
_BESIDE = VIEWS | _COMPUTED | {"color", "colour", "vision", "visual", "wrist"}
_BESIDE |= {*_FIRST_VIEWS, "side", "eye", "hand", "robot", "overhead", "zed", "kamera"}
_BESIDE |= {"video", "videos", "overview", "azure", "phone", "iphone", "ego", "exo", "static"}
_BESIDE |= {"vis", "ir", "nir", "thermal", "workspace", "environment", "context", "c920"}


def says_touch(words: Sequence[str]) -> bool:
    """Whether words of a name say touch."""
    parts = any(part in word for part in _TOUCH_PARTS for word in words)
    return parts or not _TOUCH.isdisjoint(words)


def says_scene(words: Sequence[str]) -> bool:
    """Whether words of a name say the view of a scene."""
    return not _SCENE.isdisjoint(words) or not _CAMERAS.isdisjoint(words)


def words_of(name: str) -> tuple[str, ...]:
    """Words of a path, in small letters.

    Example:
        >>> words_of("obs/leftTactile_img2")
        ('obs', 'left', 'tactile', 'img', '2')
    """
    return tuple(re.findall(r"[a-z]+|\d+", apart_by_capitals(name).lower()))


def apart_by_capitals(name: str) -> str:
    """Put ``_`` before each capital inside a name.

    Example:
        >>> apart_by_capitals("ForceTorqueData"), apart_by_capitals("left_img")
        ('Force_Torque_Data', 'left_img')
    """
    return _CAPITAL.sub("_", name)


def touch_among(pictures: Sequence[str]) -> list[str]:
    """Pictures of touch by their names: the captured ones of those called so, or else of fingers.

    Args:
        pictures: Names of keys, features or topics of pictures.

    Example:
        >>> touch_among(["rgb", "tactile/raw", "tactile/depth"]), touch_among(["rgb", "thumb"])
        (['tactile/raw'], ['thumb'])
    """
    words = {name: words_of(name) for name in pictures}
    touch = [name for name in pictures if says_touch(words[name])]
    fingers = [name for name in pictures if not FINGERS.isdisjoint(words[name])]
    for called in (touch, fingers):
        for others in (DERIVED | STILL, STILL | {"next"}):
            if found := [name for name in called if others.isdisjoint(words[name])]:
                return found
    return []


def scene_among(pictures: Iterable[str]) -> str:
    """The view of the scene by the names of pictures, a fixed one first; "" for none.

    Args:
        pictures: Names of keys, features or topics of pictures; those of touch are passed over.

    Example:
        >>> scene_among(["tactile", "wrist_rgb", "front_rgb", "front_depth"])
        'front_rgb'
    """
    words = {name: words_of(name) for name in pictures}
    views = [
        name
        for name, own in words.items()
        if (DERIVED | STILL).isdisjoint(own) and not says_touch(own)
    ]
    first = (name for word in _FIRST_VIEWS for name in views if word in words[name])
    return next(first, views[0] if views else "")


def touch_of(name: str, touch: Sequence[str]) -> list[str]:
    """The touch with the telling words of a name; all for a name without any.

    Args:
        name: Name of a force, a time or another value.
        touch: Names of keys, features or topics of touch.

    Example:
        >>> touch_of("l_force", ["left/digit", "right/digit"]), touch_of("force", ["left/digit"])
        (['left/digit'], ['left/digit'])
    """
    words = {one: _sided(one) for one in touch}
    telling = {*SIDES.values()}
    if len(words) > 1:
        owns = [*words.values()]
        telling = set[str]().union(*owns) - owns[0].intersection(*owns)
    return [one for one in touch if _sided(name) & telling <= words[one]]


def _sided(name: str) -> set[str]:
    """Words of a name, those of a side by its usual word."""
    return {SIDES.get(word, word) for word in words_of(name)}


def force_of_touch(
    touch: Sequence[str], forces: Sequence[str], *, only: bool = True
) -> dict[str, str]:
    """Name the force on the gel of each touch, if names leave no choice.

    A force of the robot's body (`ROBOT`), one that is aimed at (`COMMANDS`) or computed
    (`DERIVED_FORCES`), is none, unless its touch has the same word. A touch has the one force that
    shares a telling word with it, such as ``left``.

    Args:
        touch: Names of keys, features or topics of touch.
        forces: Those of forces.
        only: Whether the only force left belongs to the only touch, whatever their names.

    Returns:
        Name of the force, by that of its touch; touch without one is left out.

    Example:
        >>> force_of_touch(["digit"], ["ft/wrench", "robot/wrench", "pred/wrench"])
        {'digit': 'ft/wrench'}
        >>> force_of_touch(["left/digit", "right/digit"], ["r_force", "l_force"])
        {'left/digit': 'l_force', 'right/digit': 'r_force'}
    """
    words = {name: _sided(name) for name in touch}
    shared = set.intersection(*words.values()) if len(words) > 1 else set()
    out: dict[str, str] = {}
    for name, own in words.items():
        elsewhere = (ROBOT | COMMANDS | DERIVED_FORCES) - own
        fits = [
            one
            for one in forces
            if touch_of(one, touch) == [name] and elsewhere.isdisjoint(_sided(one))
        ]
        alike = [one for one in fits if _sided(one) & (own - shared - VIEWS)]
        chosen = alike or (fits if only else [])
        if len(chosen) == 1:
            out[name] = chosen[0]
    return out


def scenes(paths: Sequence[Path], root: Path) -> list[Path]:
    """Find pictures and films of a scene among those of touch, by the words of their names.

    Those with the name of a camera for scenes (``webcam``, ``realsense``) are, where others have
    none. Those with a usual word of a view (``rgb``, ``wrist``), or of what is computed
    (``depth``), are where all others are called touch: beside ``cup``, ``rgb`` may be an object.
    So are folders of what is no recording (``plots``), and pictures beside those that they are
    computed from (``masks`` beside ``images``).

    Example:
        >>> files = [Path("a/tactile/0.png"), Path("a/rgb/0.png"), Path("b/tactile/0.png")]
        >>> [path.as_posix() for path in scenes(files, Path())]
        ['a/rgb/0.png']
    """
    kinds: dict[str, list[Path]] = {}
    for path in paths:
        name = path.relative_to(root).with_suffix("").as_posix()
        kinds.setdefault(re.sub(r"\d+(?![a-z\d])", "", name), []).append(path)
    words = {
        kind: _meant(words_of(kind)) | _joined(own[0].relative_to(root).with_suffix("").as_posix())
        for kind, own in kinds.items()
    }
    same = set.intersection(*words.values()) if words else set()
    own = {kind: said - same for kind, said in words.items()}
    touch = {kind for kind, said in own.items() if says_touch([*said])}
    out = {kind for kind in own.keys() - touch if own[kind] & _SCENE}
    beside = {kind for kind in own.keys() - touch if own[kind] & (_SCENE | _BESIDE)}
    if touch and len(touch) + len(beside) == len(own):
        out = beside
    out |= {kind for kind in own.keys() - out if _is_aside(kind, own[kind])}
    out |= _computed(own)
    return [path for kind in kinds if kind in out for path in kinds[kind]] if out != {*own} else []


def _is_aside(kind: str, said: Collection[str]) -> bool:
    """Whether a folder is by its whole name beside the recordings."""
    folders = (words_of(part) for part in kind.split("/")[:-1])
    return any(words and {*words} <= _ASIDE & {*said} for words in folders)


def _computed(kinds: Mapping[str, Collection[str]]) -> set[str]:
    """Names of computed pictures beside captured ones of another kind.

    ``gelsight_depth`` beside ``gelsight`` or ``gelsight_rgb``, and ``masks`` beside ``images``.
    """
    words = _COMPUTED | _WANTED
    candidates = [kind for kind, said in kinds.items() if not words.isdisjoint(said)]
    # what is said in place of each part of a name, where the other parts are the same
    beside: dict[tuple[int, tuple[str, ...]], set[tuple[frozenset[str], bool]]] = {}
    for kind in kinds if candidates else ():
        for place, others, said in _parts(kind):
            beside.setdefault((place, others), set()).add((said - _CAPTURED, bool(said)))
    found = set()
    for kind in candidates:
        for place, others, said in _parts(kind):
            rest = said - words
            # of names without other words, a folder of numbers may be of anything
            plain = {(rest, True), (rest, False)} if place == len(others) else {(rest, True)}
            if rest != said and plain & beside[place, others]:
                found.add(kind)
    return found


def _parts(kind: str) -> Iterator[tuple[int, tuple[str, ...], frozenset[str]]]:
    """Place of each part of a path, the other parts, and its words."""
    parts = kind.split("/")
    for place, part in enumerate(parts):
        yield place, (*parts[:place], *parts[place + 1 :]), frozenset(_meant(words_of(part)))


def _meant(words: Iterable[str]) -> set[str]:
    """Words, the one of each of several, and the kind of picture in a word of two.

    Example:
        >>> sorted(_meant(["contactmasks"]))
        ['contactmask', 'contactmasks', 'mask']
    """
    one = {word.removesuffix("s") for word in words}
    kinds = {"map": "heightmap", "mask": "mask"}
    return {*words, *one, *(kinds[end] for end in kinds for word in one if word.endswith(end))}


def _joined(name: str) -> set[str]:
    """Whole parts of a name, and two words side by side as one: ``d435``, ``third_person``."""
    apart = apart_by_capitals(name).lower()
    pairs = pairwise(re.findall(r"[a-z]+", apart))
    return {*re.split(r"[^a-z0-9]+", apart), *(first + second for first, second in pairs)}
