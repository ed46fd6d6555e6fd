"""The pictures of docs/simulator.md: sensors and actions, units, force curves, response to force.

Run: python benchmarks/sim_pictures.py   (the last picture needs the public recordings)
"""

from __future__ import annotations

import csv
import os
from pathlib import Path

import numpy as np
from common import save
from matplotlib.figure import Figure
from numpy.typing import NDArray
from PIL import Image
from tactileforge_sim.geometry.shapes import shape
from tactileforge_sim.mechanics.motions import MOTIONS, Speeds
from tactileforge_sim.play import play_scenes
from tactileforge_sim.scene import Scene, draw_scene, simulated_rate

from tactileforge.contracts import ACTIONS
from tactileforge.data import VideoFrames
from tactileforge.specs import SIMULATED

ROOT = Path(__file__).parents[1]
ASSETS = ROOT / "docs" / "assets"
REALDATA = Path(os.environ.get("TACTILEFORGE_REALDATA", ROOT / ".." / "shared" / "realdata"))
SHAPES = ("pentagram", "small_sphere", "dense_circular_holes_68", "screw_m6")
#: Sensors of the force trials in ToucHD's demonstrations.
TRIALS = ("gelsight_mini", "digit")


def scene(name: str, motion: str, depth: float, seed: int = 1, grip: float = 0.5) -> Scene:
    """A touch in the middle of the picture."""
    speeds = Speeds(depth=depth, slide=3.0, turn=0.5, seconds=0.6, rest=0.1)
    path = MOTIONS[motion]((0, 0, 0.3, 0, 0), speeds, np.random.default_rng(seed))
    return Scene(seed=seed, shape=shape(name), path=path, motion=motion, grip=grip)


def films(
    touch: Scene, sensors: list[str], size: int, viscosity: float = 0.0
) -> list[tuple[NDArray[np.uint8], NDArray[np.float32]]]:
    """Pictures and forces of a touch on each sensor."""
    parts: list[list[tuple[NDArray[np.uint8], NDArray[np.float32]]]] = [[] for _ in sensors]
    for shots in play_scenes(touch, sensors, size, viscosity=viscosity):
        parts[shots.sensor].append((shots.pictures, shots.force))
    return [
        (np.concatenate([p for p, _ in part]), np.concatenate([f for _, f in part]))
        for part in parts
    ]


def gallery() -> None:
    """Draws a grid of sensors (rows) and actions (columns, near their end), indenters in turn."""
    sensors, cell = list(SIMULATED), 120
    rows: list[list[NDArray[np.uint8]]] = [[] for _ in sensors]
    for number, action in enumerate(ACTIONS):
        touch = scene(SHAPES[number % len(SHAPES)], action, 0.6)
        phase = touch.path.actions.index(action)
        share = 0.35 if action == "leave" else 0.95
        start, stop = touch.path.times[phase : phase + 2]
        moment = start + share * (stop - start)
        for row, sensor, (pictures, _) in zip(
            rows, sensors, films(touch, sensors, cell), strict=True
        ):
            picture = pictures[int(moment * simulated_rate(sensor))]
            side = min(picture.shape[:2])
            top, left = ((n - side) // 2 for n in picture.shape[:2])
            row.append(picture[top : top + side, left : left + side])
    sheet = np.concatenate([np.concatenate(row, 1) for row in rows], 0)
    figure = Figure(figsize=(11, 8.4), layout="constrained")
    axes = figure.subplots()
    axes.imshow(sheet)
    axes.set_xticks((np.arange(len(ACTIONS)) + 0.5) * cell, ACTIONS)
    axes.set_yticks((np.arange(len(sensors)) + 0.5) * cell, sensors)
    axes.xaxis.tick_top()
    axes.tick_params(length=0)
    figure.savefig(ASSETS / "sim_gallery.jpg", dpi=90)


def looks() -> None:
    """Draws presses on four units of two sensors each, with all randomisation: at rest, pressed."""
    height, rows = 150, []
    for sensor in TRIALS:
        row = []
        for seed, name in enumerate(("hexagonal", "cross_shaped", "leather", "screw_m6")):
            touch = draw_scene(
                seed, shape(name), "press", force=(3, 5), seconds=0.6, randomise="all"
            )
            ((pictures, force),) = films(touch, [sensor], height)
            row += [pictures[0], pictures[int(force[:, 2].argmax())]]
        rows.append(np.concatenate(row, 1))
    width = min(row.shape[1] for row in rows)
    tall = [
        np.asarray(Image.fromarray(row).resize((width, round(len(row) * width / row.shape[1]))))
        for row in rows
    ]
    Image.fromarray(np.concatenate(tall)).save(ASSETS / "sim_looks.jpg", quality=88)


def curves() -> None:
    """Draws the forces of a force trial on two sensors."""
    touch = scene("one_quarter_cylindrical", "force_trial", 0.5)
    figure = Figure(figsize=(9, 3), layout="constrained")
    for axes, sensor, (_, force) in zip(
        figure.subplots(1, 2, sharey=True), TRIALS, films(touch, list(TRIALS), 32), strict=True
    ):
        for column, name in enumerate(("x right", "y down", "z into the gel")):
            axes.plot(touch.times(simulated_rate(sensor)), force[:, column], label=name)
        axes.set(title=f"{sensor}: {' · '.join(a for a in touch.path.actions if a != 'stay')}")
        axes.title.set_fontsize(8)
        axes.set(xlabel="s", ylabel="force, N")
        axes.legend(fontsize=7)
    figure.savefig(ASSETS / "sim_forces.png", dpi=100)


def change(pictures: NDArray[np.uint8]) -> NDArray[np.float64]:
    """Mean absolute difference of each picture from the first, less the second one's."""
    still = pictures[0].astype(np.float32)
    found = np.array([float(np.abs(picture - still).mean()) for picture in pictures])
    return np.asarray(found - found[1], np.float64)


def lag(response: NDArray[np.float64], normal: NDArray[np.float64]) -> tuple[int, float]:
    """Delay of pictures behind force with the largest correlation, frames, and the correlation."""
    found = {}
    for shift in range(12):
        stop = len(normal) - shift
        found[shift] = float(np.corrcoef(response[shift:], normal[:stop])[0, 1])
    best = max(found, key=lambda shift: found[shift])
    return best, round(found[best], 3)


def responses() -> dict[str, object]:
    """Draws the response of images to force, simulated beside measured, one trial per sensor."""
    out: dict[str, object] = {}
    figure = Figure(figsize=(9, 3.4), layout="constrained")
    for axes, sensor in zip(figure.subplots(1, 2), TRIALS, strict=True):
        folder = REALDATA / "touchd_force_demo"
        with (folder / f"{sensor}_force.csv").open() as file:
            normal = np.array([-float(row["fz_n"]) for row in csv.DictReader(file)])
        film = VideoFrames(folder / f"{sensor}_tactile_320x240.mp4")
        count = min(len(film), len(normal))
        real = change(film.read(range(count))), normal[:count]
        peak = float(real[1].max())
        touch = scene("one_quarter_cylindrical", "force_trial", 0.2)
        ((_, probe),) = films(touch, [sensor], 16)
        # The depth of the measured peak force, from a probe at 0.2 mm and force ~ depth^1.1.
        depth = 0.2 * (peak / float(probe[:, 2].max())) ** (1 / 1.1)
        touch = scene("one_quarter_cylindrical", "force_trial", depth)
        ((pictures, force),) = films(touch, [sensor], 240, viscosity=0.1)
        simulated = change(pictures), force[:, 2].astype(np.float64)
        entry: dict[str, object] = {"peak force N": round(peak, 2), "depth mm": round(depth, 3)}
        for name, (response, load), fps in (
            ("measured", real, 30.0),
            ("simulated", simulated, simulated_rate(sensor)),
        ):
            shift, together = lag(response, load)
            moved = response[shift:], load[: len(load) - shift]
            axes.plot(moved[1] / moved[1].max(), moved[0] / moved[0].max(), ".", ms=3, label=name)
            share = moved[1] / moved[1].max(), moved[0] / moved[0].max()
            near = {
                at: float(np.median(share[1][np.abs(share[0] - at) < 0.1])) for at in (0.25, 0.5)
            }
            entry[name] = {
                "lag s": round(shift / fps, 3),
                "correlation": together,
                "change at 1/4 and 1/2 of the force": [round(v, 2) for v in near.values()],
                "largest change, grey levels": round(float(moved[0].max()), 2),
            }
        out[sensor] = entry
        axes.set(title=sensor, xlabel="normal force / largest", ylabel="picture change / largest")
        axes.legend()
    figure.savefig(ASSETS / "sim_response.png", dpi=100)
    return out


def main() -> None:
    ASSETS.mkdir(exist_ok=True)
    gallery()
    looks()
    curves()
    if REALDATA.is_dir():
        save("sim_response", {"what": __doc__, **responses()})
    for path in sorted(ASSETS.glob("sim_*.png")):
        Image.open(path).convert("P", palette=Image.Palette.ADAPTIVE, colors=255).save(path)


if __name__ == "__main__":
    main()
