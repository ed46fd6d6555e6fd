"""Cards of objectives: input and target."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from matplotlib.axes import Axes
from PIL import Image
from tactileforge_markers.motion import draw_arrows
from tactileforge_markers.track import MarkerTracker

import tactileforge
from gallery.entry import Entry
from gallery.touches import (
    AXES,
    Array,
    canvas,
    contrast,
    curves,
    moments,
    picture,
    read,
    show,
    simulated,
    strongest,
)
from tactileforge.data.labels.displacement import decode_displacement

SENSOR = "gelsight_mini"
#: Patches a side, as with `scale=paper` (224 pixels in patches of 16), and the share hidden.
GRID, HIDDEN = 14, 0.75


def clip() -> Array:
    """Four frames of a touch, square: uint8 (4, H, H, 3)."""
    recording = simulated()[SENSOR]
    return square(read(recording, moments(recording, 4)))


def square(frames: Array) -> Array:
    """The middle of frames, with a side of a whole number of patches."""
    side = min(frames.shape[1:3]) // GRID * GRID
    top, left = ((size - side) // 2 for size in frames.shape[1:3])
    return frames[:, top : top + side, left : left + side]


def hidden(side: int) -> Array:
    """Mask of tubes: the same hidden places in all frames, bool (side, side)."""
    places = np.random.default_rng(0).permutation(GRID * GRID) < HIDDEN * GRID * GRID
    mask = places.reshape(GRID, GRID).repeat(side // GRID, 0).repeat(side // GRID, 1)
    return np.asarray(mask)


def masked(frames: Array) -> Array:
    """Frames with hidden tubes, painted dark."""
    out = frames.copy()
    out[:, hidden(frames.shape[1])] = (23, 23, 33)
    return out


def pairs(above: Array, below: Array, titles: tuple[str, str]) -> Image.Image:
    """Two rows of pictures: input and target."""
    figure, axes = canvas(len(above), 2, side=1.35)
    for row, (pictures, title) in enumerate(zip((above, below), titles, strict=True)):
        for column, pixels in enumerate(pictures):
            show(axes[row, column], pixels, title if column == 0 else "")
    return picture(figure)


def colours(tokens: Array) -> Array:
    """The three main directions of tokens (..., width) as RGB, (..., 3)."""
    rows = tokens.reshape(-1, tokens.shape[-1])
    rows = rows - rows.mean(0)
    main = rows @ np.linalg.svd(rows, full_matrices=False)[2][:3].T
    low, high = np.percentile(main, [2, 98], axis=0)
    out: Array = np.clip((main - low) / (high - low), 0, 1).reshape(*tokens.shape[:-1], 3)
    return out


def features(name: str) -> Array:
    """Patch tokens of a model for the clip, (slots, rows, columns, width)."""
    recording = simulated()[SENSOR]
    frames = read(recording, moments(recording, 4))
    model = tactileforge.load(name)
    rest = np.asarray(recording.background())
    return np.asarray(model.features(frames, rest, SENSOR, tap="patches"))


def bars(axis: Axes, names: list[str], values: list[float], title: str) -> None:
    """Horizontal bars from 0 to 1."""
    axis.barh(names, values, color="#2a6fdb", height=0.55)
    axis.set_xlim(0, 1)
    axis.invert_yaxis()
    axis.set_title(title, fontsize=8)
    axis.tick_params(labelsize=7)
    for edge in ("top", "right", "bottom"):
        axis.spines[edge].set_visible(False)
    axis.set_xticks([])


def pixel() -> Image.Image:
    """Hidden tubes, and the frames to fill in."""
    return pairs(masked(clip()), clip(), ("input", "target"))


def diff() -> Image.Image:
    """Hidden tubes, and the differences to the first frame."""
    frames = clip()
    return pairs(masked(frames), contrast(frames, frames[:1]), ("input", "target: change, 3 x"))


def jepa() -> Image.Image:
    """Hidden tubes, and the features of the whole clip."""
    tokens = features("anytouch2.tiny")
    slots = np.repeat(colours(tokens), -(-4 // len(tokens)), 0)[:4]
    return pairs(masked(clip()), slots, ("input", "target: features (PCA)"))


def distill() -> Image.Image:
    """The clip, and the features of a network of photographs."""
    tokens = features("anytouch2.tiny-real")
    half = tokens[..., tokens.shape[-1] // 2 :]
    slots = np.repeat(colours(half), -(-4 // len(half)), 0)[:4]
    return pairs(clip(), slots, ("input", "target: photo maps"))


def dino() -> Image.Image:
    """A masked and a whole view, with prototypes in agreement."""
    frames, draw = clip(), np.random.default_rng(2)
    teacher = draw.dirichlet(np.full(12, 0.15))
    student = 0.7 * teacher + 0.3 * draw.dirichlet(np.full(12, 0.5))
    figure, axes = canvas(4, side=1.6)
    show(axes[0, 0], masked(frames)[-1], "student sees")
    show(axes[0, 1], frames[-1], "teacher sees")
    places = [str(number) for number in range(12)]
    bars(axes[0, 2], places, student.tolist(), "student's prototypes")
    bars(axes[0, 3], places, teacher.tolist(), "target: teacher's")
    for axis in axes[0, 2:]:
        axis.set_yticks([])
    return picture(figure)


def align() -> Image.Image:
    """Touch, camera image and caption of one moment."""
    recordings = [simulated(name)[SENSOR] for name in ("pentagram", "screw_m6")]
    figure, axes = canvas(3, 2, side=1.6)
    for row, recording in enumerate(recordings):
        show(axes[row, 0], square(read(recording, [strongest(recording)]))[0], "touch")
        assert recording.image is not None
        show(axes[row, 1], recording.image.read([0])[0], "its camera image")
        words = str(recording.text).replace("{action}", "pressed")
        show(axes[row, 2], np.full((9, 9, 3), 255), "its caption")
        axes[row, 2].text(4, 4, _folded(words), fontsize=7, ha="center", va="center")
    return picture(figure)


def _folded(words: str, width: int = 20) -> str:
    """Words on lines of a width."""
    lines = [""]
    for word in words.split():
        lines += [""] if len(lines[-1]) + len(word) > width else []
        lines[-1] += f"{word} "
    return "\n".join(lines)


def match() -> Image.Image:
    """An anchor, the same object by another sensor, and another object."""
    same, other = simulated(), simulated("screw_m6")
    shown = (
        (same[SENSOR], "anchor"),
        (same["digit"], "same object: 1"),
        (other["digit"], "another: 0"),
        (other[SENSOR], "another: 0"),
    )
    figure, axes = canvas(4)
    for axis, (recording, title) in zip(axes[0], shown, strict=True):
        show(axis, square(read(recording, [strongest(recording)]))[0], title)
    return picture(figure)


def classify() -> Image.Image:
    """A clip, and the object as a class."""
    names = ["pentagram", "screw M6", "ball", "edge", "ring"]
    figure, axes = canvas(3, side=1.9)
    show(axes[0, 0], clip()[2], "input")
    show(axes[0, 1], clip()[-1], "")
    bars(axes[0, 2], names, [1.0, 0, 0, 0, 0], "target: the object")
    return picture(figure)


def force() -> Image.Image:
    """Frames, and the force of each."""
    recording = simulated()[SENSOR]
    figure, axes = canvas(3, side=2.0)
    show(axes[0, 0], clip()[1], "input")
    show(axes[0, 1], clip()[-1], "")
    target = "target: force, N, and its change"
    curves(axes[0, 2], recording.times, np.asarray(recording.force), target, [*AXES])
    return picture(figure)


def surface() -> Image.Image:
    """A frame, and the displacement of the gel along each axis."""
    recording = simulated()[SENSOR]
    top = strongest(recording, 0)
    assert recording.surface is not None
    field = decode_displacement(recording.surface.read([top])[0])
    figure, axes = canvas(4, side=1.6)
    show(axes[0, 0], read(recording, [top])[0], "input")
    for column, name in enumerate("xyz"):
        most = float(np.abs(field[..., column]).max()) or 1.0
        options = {"cmap": "RdBu_r", "vmin": -most, "vmax": most}
        title = f"target: {name}, to {most:.2f} mm"
        show(axes[0, column + 1], field[..., column], title, **options)
    return picture(figure)


def markers() -> Image.Image:
    """A gel with dots, and the displacement of each dot."""
    recording = simulated()["duragel"]
    frames = read(recording, list(range(len(recording.frames))))
    tracker = MarkerTracker(np.asarray(recording.background()))
    moved = [tracker.read(frame) for frame in frames]  # in order, as markers are followed
    figure, axes = canvas(3, side=2.0)
    show(axes[0, 0], frames[0], "no contact")
    normal = np.asarray(recording.force)[:, 2]
    pressed = int(np.argmax(normal > 0.9 * normal.max()))
    rows = (pressed, strongest(recording, 0))
    for axis, row, title in zip(axes[0, 1:], rows, ("press", "shear"), strict=True):
        arrows = draw_arrows(frames[row], tracker.grid.places, moved[row])
        show(axis, arrows, f"target: arrows, {title}")
    return picture(figure)


def _commands() -> tuple[Array, Array]:
    """Times and a chunk of three commands, (T,) and (T, 3)."""
    times = np.linspace(0, 0.8, 16)
    return times, np.stack([np.sin(4 * times), 1 - times, 0.4 * np.cos(5 * times)], 1)


def imitate() -> Image.Image:
    """Two fingers, and the following chunk of commands."""
    recordings = (simulated()["digit"], simulated("screw_m6")["digit"])
    figure, axes = canvas(3, side=2.0)
    for axis, recording, title in zip(axes[0], recordings, ("left", "right"), strict=False):
        show(axis, square(read(recording, [strongest(recording)]))[0], f"input: {title} finger")
    curves(axes[0, 2], *_commands(), "target: the next commands", [""] * 3)
    return picture(figure)


def denoise() -> Image.Image:
    """A chunk of commands with noise, and the noise."""
    times, chunk = _commands()
    noise = np.random.default_rng(0).normal(0, 0.5, chunk.shape)
    recording = simulated()["digit"]
    figure, axes = canvas(3, side=2.0)
    show(axes[0, 0], square(read(recording, [strongest(recording)]))[0], "input: fingers")
    curves(axes[0, 1], times, chunk + noise, "input: commands with noise", [""] * 3)
    curves(axes[0, 2], times, noise, "target: the noise", [""] * 3)
    return picture(figure)


_LEARN = "[Recipes and objectives](configuration.md)"
#: Purpose, facts and links of each objective, and the function to draw it.
CARDS: dict[str, tuple[str, str, str, Callable[[], Image.Image]]] = {
    "pixel": (
        "Fills in the hidden tubes of frames: 75 % of the places, the same in every frame.",
        "Needs only frames. Squared error of normalized pixels.",
        _LEARN,
        pixel,
    ),
    "diff": (
        "Fills in the hidden tubes of the differences from the first frame: motion of the gel.",
        "Needs only frames, at least two per clip.",
        _LEARN,
        diff,
    ),
    "align": (
        "Finds the camera image and the caption of a touch among those of the batch.",
        "Needs `text` or `image`. Symmetric InfoNCE.",
        _LEARN,
        align,
    ),
    "match": (
        "Tells whether two touches are of one object by two sensors, or of one action.",
        "Needs `object` or `action`. Binary cross-entropy.",
        _LEARN,
        match,
    ),
    "force": (
        "Reads the force of each frame and its change since the frame before.",
        "Needs `force`, N along x, y and z.",
        "[Recipes and objectives](configuration.md) · [calibrate](calibrate.md)",
        force,
    ),
    "surface": (
        "Reads the displacement of the gel's surface along x, y and z.",
        "Needs `surface`, which simulated touch has.",
        "[Recipes and objectives](configuration.md) · [depth](depth.md)",
        surface,
    ),
    "jepa": (
        "Predicts the features of hidden tubes by a slowly following copy of the encoder.",
        "Needs only frames. Mean absolute error, as in V-JEPA.",
        _LEARN,
        jepa,
    ),
    "dino": (
        "Agrees, on a masked clip, with what a slow copy says of the whole one.",
        "Needs only frames. The bars are drawn, not measured.",
        _LEARN,
        dino,
    ),
    "distill": (
        "Predicts the maps of a network that was trained on photographs.",
        "Needs only frames. Squared error of normalized features.",
        "[Distillation](configuration.md#distillation)",
        distill,
    ),
    "classify": (
        "Names the object of a clip.",
        "Needs `object`. Cross-entropy.",
        _LEARN,
        classify,
    ),
    "markers": (
        "Reads the displacement of printed markers at every patch (`tactileforge-markers`).",
        "Needs the track `marker_field`, in percent of the shorter side.",
        "[Markers](markers.md)",
        markers,
    ),
    "imitate": (
        "Predicts the next commands of a demonstration (`tactileforge-policies`).",
        "Needs `action_chunk`. The commands are drawn, not recorded.",
        "[Policies](policies.md)",
        imitate,
    ),
    "denoise": (
        "Predicts the noise in a chunk of commands: a diffusion policy (`tactileforge-policies`).",
        "Needs `action_chunk`. The commands are drawn, not recorded.",
        "[Policies](policies.md)",
        denoise,
    ),
}


def entries() -> list[Entry]:
    """Cards of all objectives."""
    return [
        Entry(
            kind="objective",
            name=name,
            lines=(purpose, facts, links),
            alt=f"Input and target of {name}, from simulated touch",
            draw=draw,
        )
        for name, (purpose, facts, links, draw) in CARDS.items()
    ]
