"""Cards of sensors: types with a simulated gel, and drivers."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
from PIL import Image

from gallery.entry import Entry
from gallery.touches import (
    SIZE,
    canvas,
    contrast,
    curves,
    picture,
    read,
    show,
    simulated,
    strongest,
    taxels,
)
from tactileforge.plugins import build
from tactileforge.specs import SIMULATED, SPECS

#: Indenters of the pictures of a type, one a panel.
SHAPES = ("pentagram", "screw_m6", "dense_circular_holes_68")
#: Driver of a type, and models that know it.
DRIVERS = {
    "gelsight": ("any camera", "`anytouch2.tiny`, AnyTouch, Sparsh, T3, UniTouch"),
    "digit": ("`tactileforge-digit`", "`anytouch2.tiny`, AnyTouch, Sparsh, T3, TVL, UniTouch"),
    "gelslim": ("any camera", "AnyTouch, T3"),
    "gelsight_mini": (
        "`tactileforge-gelsight`",
        "`anytouch2.tiny`, `anytouch2.tiny-real`, AnyTouch, Sparsh, T3",
    ),
    "duragel": ("any camera", "AnyTouch"),
    "dm": ("`tactileforge-dmtac`", "none: universal tokens"),
}
TITLES = {
    "gelsight": "GelSight R1.5",
    "digit": "DIGIT",
    "gelslim": "GelSlim",
    "gelsight_mini": "GelSight Mini",
    "duragel": "DuraGel, with printed markers",
    "dm": "DM-Tac, with printed markers",
}


def draw_type(name: str) -> Image.Image:
    """Frames of a type without contact, under indenters, and their change."""
    figure, axes = canvas(len(SHAPES) + 2)
    recordings = [simulated(shape)[name] for shape in SHAPES]
    frames = [read(recording, [0, strongest(recording)]) for recording in recordings]
    show(axes[0, 0], frames[0][0], "no contact")
    for axis, shape, pair in zip(axes[0, 1:], SHAPES, frames, strict=False):
        show(axis, pair[1], shape.replace("_68", "").replace("_", " "))
    show(axes[0, -1], contrast(frames[0][1], frames[0][0]), "change, 3 x")
    return picture(figure)


def type_entry(name: str) -> Entry:
    """Card of a type of sensor."""
    known = SPECS[name]
    driver, models = DRIVERS[name]
    area = "area not published"
    if known.area_mm is not None:
        area = f"{known.area_mm[0]:g} x {known.area_mm[1]:g} mm"
    return Entry(
        kind="sensor",
        name=name,
        lines=(
            f"{TITLES[name]}: {known.height} x {known.width} pixels, {known.fps:g} fps, {area}.",
            f"Driver: {driver}. Models that know it: {models}.",
            "[Simulated touch](simulator.md) · [record](record.md)",
        ),
        alt=f"Simulated pictures of {TITLES[name]}",
        draw=partial(draw_type, name),
    )


def draw_film(title: str, rotation: int = 0) -> Image.Image:
    """Frames of a simulated DIGIT, in the order of a driver."""
    recording = simulated()["digit"]
    rows = np.linspace(0, len(recording.frames) - 1, 6).round().astype(int).tolist()
    figure, axes = canvas(6, side=1.3)
    for axis, frame, number in zip(axes[0], read(recording, rows), rows, strict=True):
        label = f"{title} {recording.times[number] - recording.times[0]:.2f} s"
        show(axis, np.rot90(frame, rotation // 90), label)
    return picture(figure)


def draw_stream() -> Image.Image:
    """Frames of the driver ``sim``, as it gives them."""
    with build("sensors", {"name": "sim", "size": SIZE, "realtime": False}) as sensor:
        taken = [sensor.read() for _ in range(60)]
    figure, axes = canvas(6, side=1.3)
    for axis, frame in zip(axes[0], taken[5::10], strict=True):
        show(axis, frame.array, f"{frame.time - taken[0].time:.2f} s")
    return picture(figure)


def draw_samples(name: str, titles: tuple[str, str], halves: tuple[list[str], list[str]]) -> Any:
    """Curves of a simulated wrench sensor or robot over four seconds."""
    sensor = build("sensors", {"name": name} | ({"rest": 0.0} if "wrench" in name else {}))
    times = np.arange(0, 4, 0.01)
    values = np.stack([sensor.sample(float(moment)) for moment in times])
    figure, axes = canvas(2, side=3.4)
    figure.set_size_inches(6.8, 1.9)
    first = len(halves[0])
    curves(axes[0, 0], times, values[:, :first], titles[0], halves[0])
    curves(axes[0, 1], times, values[:, first:], titles[1], halves[1])
    return picture(figure)


def draw_taxels() -> Image.Image:
    """Images of an array of 8 x 8 taxels under a simulated touch."""
    recording = taxels()
    rows = np.linspace(0, len(recording.frames) - 1, 6).round().astype(int).tolist()
    figure, axes = canvas(6, side=1.3)
    for axis, frame, row in zip(axes[0], read(recording, rows), rows, strict=True):
        show(axis, frame, f"{np.asarray(recording.force)[row, 2]:.1f} N")
    return picture(figure)


def drivers() -> list[Entry]:
    """Cards of the drivers without a type of their own."""
    wrench = (("force, N", "torque, N m"), (["x", "y", "z"], ["x", "y", "z"]))
    robot = (("joints of the state", "commands"), ([""] * 4, [""] * 4))
    return [
        _driver(
            "sim",
            "Endless simulated touches in real time: a finger to try everything with.",
            "Any simulated type, indenters and motions; forces are known.",
            "[Live](live.md) · [record](record.md)",
            "Six frames of the simulated sensor",
            draw_stream,
        ),
        _driver(
            "camera",
            "Any camera that OpenCV reads: UVC devices, network streams, files.",
            "Requested size, rate and exposure are checked; border, crop and rotation are options.",
            "[Record](record.md) · [a sensor of your own](plugins/sensor.md)",
            "Six frames of a simulated DIGIT, turned by a quarter as by rotation=90",
            partial(draw_film, "", 90),
        ),
        _driver(
            "replay",
            "A video or a recorded touch, played again as a sensor.",
            "In real time or as fast as it is read; with the times of the recording.",
            "[Live](live.md) · [record](record.md)",
            "Six frames of a recorded touch",
            partial(draw_film, ""),
        ),
        _driver(
            "serial_array",
            "Arrays of taxels as packets; AnySkin, ReSkin and FlexiTac have drivers of their own.",
            "Taxels become images: RGB is x, y, z. Needs `tactileforge-arrays`.",
            "[Record](record.md) · [simulated arrays](simulator.md)",
            "Six images of an array of 8 x 8 taxels under a simulated touch",
            draw_taxels,
        ),
        _driver(
            "sim_wrench",
            "A simulated wrench sensor: six numbers beside a simulated finger.",
            "Forces in N and torques in N m, as labels of a recording.",
            "[Record](record.md)",
            "Curves of three forces and three torques",
            partial(draw_samples, "sim_wrench", *wrench),
        ),
        _driver(
            "force_torque",
            "Base of wrench sensors, by serial port, UDP or TCP.",
            "`tactileforge-ft` has Robotiq FT 300 and ATI Net F/T; the curves are simulated.",
            "[Record](record.md) · [calibrate](calibrate.md)",
            "Curves of three forces and three torques, as packets of a wrench sensor give them",
            partial(draw_samples, "sim_wrench", *wrench),
        ),
        _driver(
            "sim_robot",
            "A simulated arm: its state and its command at every step.",
            "Four joints and four commands unless you say more, for recordings of demonstrations.",
            "[Record](record.md) · [policies](policies.md)",
            "Curves of joint angles and commands",
            partial(draw_samples, "sim_robot", *robot),
        ),
        _driver(
            "serial_robot",
            "A robot or its controller, as packets over a port or the network.",
            "State and command, checked for impossible jumps; the curves are simulated.",
            "[Record](record.md) · [policies](policies.md)",
            "Curves of joint angles and commands, as packets of a robot give them",
            partial(draw_samples, "sim_robot", *robot),
        ),
    ]  # fmt: skip


def _driver(name: str, what: str, facts: str, links: str, alt: str, draw: Any) -> Entry:
    return Entry(kind="sensor", name=name, lines=(what, facts, links), alt=alt, draw=draw)


def entries() -> list[Entry]:
    """Cards of all sensors."""
    return [*map(type_entry, SIMULATED), *drivers()]
