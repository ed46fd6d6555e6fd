"""Small stand-ins for the files of a reader of the docs: recordings, photos, a video.

A block after ``<!-- made: NAME, NAME -->`` runs in tests once these are made beside it; after
``<!-- made: NAME; also: WORDS -->`` the words are added to its last command.
"""

from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from videos import write_video

_LAYOUT = """\
layouts:
  presses:
    videos: "videos/*.avi"
    sensor: digit
    background: {first: 1}
    labels: {file: videos/labels.csv, key: file}
    object: "{object}"
    force: {file: "forces/{stem}.csv", columns: [fx, fy, fz]}
    hold_out: object
"""


def press(number: int, count: int = 12, size: int = 64) -> NDArray[np.uint8]:
    """A growing and fading dent, uint8 (T, size, size, 3); its place and colour are the touch's.

    The first frame is without contact.
    """
    rng = np.random.default_rng(number)
    y, x = np.mgrid[:size, :size] - rng.uniform(0.3, 0.7, (2, 1, 1)) * size
    dent = np.exp(-(x**2 + y**2) / (2 * (6 + 2 * (number % 3)) ** 2))
    rise = np.sin(np.linspace(0, np.pi, count))[:, None, None, None]
    colour = 60 + 60 * rng.random(3)
    noise = rng.normal(0, 1, (count, size, size, 3))
    return (90 + rise * dent[..., None] * colour + noise).clip(0, 255).astype(np.uint8)


def _recordings(folder: Path) -> None:
    rows = ["file,object,grasped,weight"]
    for number in range(24):
        write_video(folder / "videos" / f"t{number}.avi", press(number), 20)
        rows.append(f"videos/t{number}.avi,o{number % 8},{number % 2},{10 + number}")
        fz = 5 * np.sin(np.linspace(0, np.pi, 12))
        lines = ["fx,fy,fz", *(f"0,{0.1 * number:.2f},{z:.3f}" for z in fz)]
        (folder / "forces").mkdir(exist_ok=True)
        (folder / "forces" / f"t{number}.csv").write_text("\n".join(lines) + "\n")
    (folder / "videos" / "labels.csv").write_text("\n".join(rows) + "\n")
    (folder / "tactileforge.yaml").write_text(_LAYOUT)


def _photos(folder: Path) -> None:
    for kind, name in enumerate(("bolt", "nut")):
        (folder / name).mkdir(parents=True)
        for number in range(8):
            image = press(2 * number + kind)[6]
            image[..., kind] //= 2
            Image.fromarray(image).save(folder / name / f"{number}.png")


def _recipe(folder: Path) -> None:
    """The recipe of docs/configuration.md."""
    page = Path(__file__).parents[2] / "docs" / "configuration.md"
    shown = page.read_text("utf-8").partition("`mine/recipe/soft.yaml`")[2]
    (folder / "recipe").mkdir(parents=True)
    (folder / "recipe" / "soft.yaml").write_text(shown.split("```yaml\n")[1].split("```")[0])


MADE: dict[str, Callable[[Path], None]] = {
    "DIR": _recordings,
    "touches": _recordings,
    "photos": _photos,
    "mine": _recipe,
    "press.mp4": lambda path: write_video(path, press(0, 24), 20, "mp4v"),
    "new.png": lambda path: Image.fromarray(press(3)[6]).save(path),
}


def make_files(names: str, folder: Path) -> None:
    """Makes the files named by a comment, in a folder; existing ones stay."""
    for name in (name.strip() for name in names.split(",")):
        if not (folder / name).exists():
            MADE[name](folder / name)
