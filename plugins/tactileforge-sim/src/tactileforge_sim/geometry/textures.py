"""Everyday things to touch, generated: cloth, threads, letters, knurls, bolts and the like."""

from __future__ import annotations

from tactileforge_sim.geometry.heightfields import (
    bricks,
    bumps,
    coil,
    cut,
    deeper,
    gauze,
    grain,
    grit,
    grooves,
    hexagons,
    knit,
    leather,
    raised,
    thread,
    waves,
    weave,
    whorl,
)
from tactileforge_sim.geometry.indenter_geometry import (
    Height,
    Shape,
    extrude,
    join,
    lift,
    pad,
    rod,
    shape_of,
)
from tactileforge_sim.geometry.sdf2d import (
    SDF,
    around,
    at,
    box,
    circle,
    cross,
    ellipse,
    grid,
    grow,
    minus,
    polygon,
    regular,
    ring,
    stroke,
    turn,
    union,
)

#: Strokes of letters and numerals on a field of 4 x 6 from the top left: lines through points "xy".
GLYPHS = {
    "letter_a": "06 02 20 42 46, 03 43",
    "letter_e": "40 00 06 46, 03 33",
    "letter_f": "40 00 06, 03 33",
    "letter_h": "00 06, 40 46, 03 43",
    "letter_k": "00 06, 40 03 46",
    "letter_m": "06 00 23 40 46",
    "letter_n": "06 00 46 40",
    "letter_p": "06 00 30 41 42 33 03",
    "letter_s": "41 30 10 01 02 13 33 44 45 36 16 05",
    "letter_z": "00 40 06 46",
    "numeral_1": "11 20 26, 16 36",
    "numeral_2": "01 10 30 41 42 06 46",
    "numeral_4": "36 30 04 44",
    "numeral_5": "40 00 03 33 44 45 36 16 05",
    "numeral_7": "00 40 16",
    "numeral_8": "13 02 01 10 30 41 42 33 13 04 05 16 36 45 44 33",
}


def glyph(lines: str, size: float = 9.0, width: float = 1.2) -> SDF:
    """A letter from its strokes; ``size`` is its height in mm."""
    step = size / 6
    strokes = [
        [((int(point[0]) - 2) * step, (int(point[1]) - 3) * step) for point in line.split()]
        for line in lines.split(",")
    ]
    return union(*(stroke(width, *points) for points in strokes))


def on(base: SDF, top: SDF, step: float, fillet: float = 0.2) -> Height:
    """A flat outline ``step`` mm above a larger one."""
    return join(extrude(top, fillet), lift(extrude(base), step))


_COIN = union(ring(6.6, 5.8), glyph(GLYPHS["numeral_5"], 6, 0.9))
_GEAR = minus(union(circle(4.6), around(14, 5.2, box(1.1, 2))), circle(1.5))
_KEY = polygon(
    *((-6.5, -2), (5.5, -2), (6.5, -0.6), (5.2, 2), (4.2, 0.9), (3.2, 2), (2, 0.2), (0.8, 1.2)),
    *((-0.2, 0.1), (-1.4, 2), (-2.6, 1), (-3.6, 2.2), (-6.5, 2.2)),
)
_TREAD = [at(side * 2.4, 0, grid(1, 5, 2.6, turn(side * 30, box(5, 1.3)))) for side in (-1, 1)]
_BUBBLE = grid(4, 3, (4, 6.9), circle(1.7))
_BUBBLES = [_BUBBLE, at(2, 3.45, _BUBBLE)]
_ZIP = [at(side * 0.8, side * 0.4, grid(1, 8, 1.6, box(2.6, 0.7))) for side in (-1, 1)]
_LINKS = [at(x, 0, minus(ellipse(2.5, 1.7), ellipse(1.5, 0.7))) for x in (-3.7, 0, 3.7)]
_LENTIL = ellipse(1.4, 0.45)
_CHEQUER = [grid(4, 4, 3, turn(45, _LENTIL)), at(1.5, 1.5, grid(4, 4, 3, turn(-45, _LENTIL)))]
_CLIP = stroke(
    0.9,
    (-4, 0.6),
    (3.4, 0.6),
    (4.4, 0),
    (4.4, -1.6),
    (3.4, -2.4),
    (-4.4, -2.4),
    (-5.6, -1.4),
    (-5.6, 1.2),
    (-4.4, 2.2),
    (5, 2.2),
)
_DOTS = union(
    *(
        at(x, y, circle(0.75))
        for x, y in (
            (-4.2, -2.5),
            (-1.7, -2.5),
            (-4.2, 2.5),
            (-1.7, 0),
            (1.7, -2.5),
            (4.2, 0),
            (1.7, 2.5),
        )
    )
)

#: name, height, width of the finest detail in mm
_TABLE: tuple[tuple[str, Height, float], ...] = (
    ("cloth_plain", pad(weave(0.6, 0.12, lambda i, j: (i + j) % 2)), 0.3),
    ("cloth_twill", pad(weave(0.5, 0.12, lambda i, j: (i + j) % 4 < 2)), 0.25),
    ("cloth_satin", pad(weave(0.7, 0.14, lambda i, j: (i + 2 * j) % 5 != 0)), 0.35),
    ("cloth_basket", pad(weave(0.9, 0.2, lambda i, j: (i // 2 + j // 2) % 2)), 0.45),
    ("wicker", pad(weave(2.4, 0.7, lambda i, j: (i + j) % 2)), 1.2),
    ("knit", pad(knit(1.6, 1.3, 0.4)), 0.6),
    ("knit_ribbed", pad(deeper(waves(2, 0.5), waves(0.8, 0.3, 90))), 0.4),
    ("corduroy", pad(waves(1.4, 0.4)), 0.7),
    ("screw_m2", thread(2, 0.4), 0.2),
    ("screw_m3", thread(3, 0.5), 0.25),
    ("screw_m4", thread(4, 0.7), 0.35),
    ("screw_m6", thread(6, 1), 0.5),
    ("screw_m10", thread(10, 1.5), 0.75),
    ("spring", coil(3.5, 2, 1.3), 0.6),
    ("rope", rod(3.5, waves(2.6, 0.7, 35)), 1.3),
    ("knurl_straight", rod(5, waves(0.8, 0.25, 90)), 0.4),
    ("knurl_diamond", rod(5, deeper(grooves(1, 0.35, 60), grooves(1, 0.35, -60))), 0.5),
    ("coin_edge", rod(10, grooves(0.5, 0.2), length=2), 0.25),
    ("coin_face", on(circle(7), _COIN, 0.3), 0.8),
    ("hex_mesh", extrude(minus(circle(7), grow(hexagons(2.4), -0.3)), 0.2), 0.6),
    ("honeycomb", extrude(minus(circle(7), grow(hexagons(4), -0.15)), 0.1), 0.3),
    ("hex_tiles", pad(raised(grow(hexagons(3), -0.2), 0.6)), 0.4),
    ("bricks", pad(raised(bricks(4, 2, 0.5), 0.6)), 0.5),
    ("grille", extrude(minus(circle(7), grid(1, 7, 1.8, box(11, 0.9)))), 0.9),
    ("perforated_sheet", extrude(minus(circle(7), grid(6, 6, 1.7, circle(0.55))), 0.1), 0.6),
    ("wire_gauze", pad(gauze(1.5, 0.5)), 0.5),
    ("bolt_hex", extrude(regular(6, 5.8), 0.6), 0),
    ("bolt_socket", extrude(minus(circle(5), regular(6, 3)), 0.4), 0),
    ("screw_phillips", extrude(minus(circle(4), cross(4.6, 1.2)), 0.5), 1.2),
    ("screw_slotted", extrude(minus(circle(4.5), box(10, 1.2)), 0.5), 1.2),
    ("nut", extrude(minus(regular(6, 5.8), circle(2.6)), 0.3), 0),
    ("gear", extrude(_GEAR), 1.1),
    ("key", extrude(_KEY), 1),
    ("studs", on(box(14, 14), grid(2, 2, 8, circle(2.4)), 1.7), 0),
    ("braille", pad(raised(_DOTS, 0.5, 0.7)), 1.5),
    ("pin_header", extrude(grid(4, 2, 2.54, box(0.64, 0.64)), 0.1), 0.6),
    ("bubble_wrap", pad(raised(union(*_BUBBLES), 1.4, 1.7)), 0.6),
    ("corrugation", pad(waves(3.2, 1)), 1.6),
    ("golf_ball", pad(cut(grid(5, 5, 3, circle(1.3)), 0.3, 0.6), curve=21.3), 0.4),
    ("chequer_plate", pad(raised(union(*_CHEQUER), 0.6, 0.3)), 0.9),
    ("tyre_tread", pad(raised(union(*_TREAD), 1.2)), 0.8),
    ("zip", pad(raised(union(*_ZIP), 0.9)), 0.7),
    ("chain", extrude(union(*_LINKS), 0.45), 0.8),
    ("paper_clip", extrude(_CLIP, 0.45), 0.8),
    ("button", extrude(minus(circle(5.5), grid(2, 2, 2.4, circle(0.8)), ring(4.6, 4)), 0.15), 0.5),
    ("comb", extrude(union(at(0, -4, box(13, 2)), grid(9, 1, 1.5, box(0.7, 9)))), 0.7),
    ("wood_grain", pad(grain(1.1, 0.25, 3)), 0.4),
    ("leather", pad(leather(1.6, 0.25, 5)), 0.5),
    ("orange_peel", pad(bumps(1.8, 0.35, 11)), 0.6),
    ("sandpaper", pad(grit(0.5, 0.25, 13)), 0.25),
    ("gravel", pad(grit(2.5, 1.2, 17)), 1),
    ("fingerprint", pad(whorl(0.5, 0.12)), 0.25),
    ("turned_metal", pad(whorl(0.4, 0.1, bend=0)), 0.2),
)

#: The textures by name.
TEXTURES: dict[str, Shape] = {
    **{name: shape_of(name, height, detail=detail) for name, height, detail in _TABLE},
    **{
        name: shape_of(name, on(circle(7), glyph(lines), 0.8), detail=1.2)
        for name, lines in GLYPHS.items()
    },
}
