"""The 71 indenters of AnyTouch 2 (paper, table of indenters), and look-up of a shape by name.

Names and the split of the force benchmark are the paper's. Sizes and heights were not published:
these are our own. The tips are 4 to 14 mm wide.
"""

from __future__ import annotations

from tactileforge.errors import ConfigError, unknown
from tactileforge_sim.geometry.indenter_geometry import (
    DEEP,
    Height,
    Shape,
    Split,
    ball,
    extrude,
    join,
    lift,
    printed,
    shape_of,
)
from tactileforge_sim.geometry.sdf2d import (
    SDF,
    arc,
    around,
    at,
    box,
    circle,
    crescent,
    cross,
    ellipse,
    grid,
    heart,
    minus,
    polygon,
    regular,
    ring,
    sector,
    star,
    stroke,
    teardrop,
    tee,
    trapezoid,
    turn,
    union,
    wavy,
)
from tactileforge_sim.geometry.textures import TEXTURES

__all__ = ["BENCH_TEST", "BENCH_TRAIN", "DEEP", "INDENTERS", "Shape", "printed", "shape"]

#: Indices of the indenters that train and test the force benchmark; all others are for pre-training
BENCH_TRAIN = (62, 65, 66, 67, 68, 70, 71)
BENCH_TEST = (63, 64, 69)

_DISC = circle(5.5)
_PLATE = box(11, 11)
_ESS = union(arc(0.8, 1.2, 90, 360), at(0, 2.4, arc(0.8, 1.2, -90, 180)))
_RAY = polygon((-0.6, 0.8), (0, -1.2), (0.6, 0.8))
_DIAMOND = polygon((0, -2), (1.2, 0), (0, 2), (-1.2, 0))
_LEAVES, _STALK = around(3, 2, circle(1.9)), stroke(0.9, (0, 0), (0, 4.6))
_GAPS = [turn(angle, grid(1, 4, 2.5, box(10, 0.7))) for angle in (0, 90)]
_SCATTER = [
    at(x, y, hole)
    for x, y, hole in (
        (-2.8, -2.6, circle(1.1)),
        (1.8, -3, circle(0.7)),
        (3.2, 0.2, circle(1)),
        (-0.4, -0.3, circle(0.6)),
        (0.9, 3, circle(1.2)),
        (-2.9, 2.4, turn(30, ellipse(1.8, 0.8))),
    )
]
_HOLE = circle(0.5)
_HOLES = (_HOLE, *(turn(a, around(6, r, _HOLE)) for a, r in ((0, 1.6), (0, 3.2), (30, 2.77))))

#: index, name, outline of the tip
_FLAT: tuple[tuple[int, str, SDF], ...] = (
    (1, "semi_cylindrical", at(0, 2.7, sector(5.5, 180))),
    (2, "wavy_cylindrical", wavy(4.8, 0.6, 8)),
    (3, "hexagonal", regular(6, 5)),
    (4, "isosceles_trapezoidal", trapezoid(5, 10, 6)),
    (5, "one_third_cylindrical", at(0, 3, sector(6.5, 120))),
    (6, "five_sixths_cylindrical", sector(5, 300)),
    (8, "heart_shaped", heart(9)),
    (9, "one_quarter_cylindrical", at(0, 4, sector(7.5, 90))),
    (10, "regular_triangular", at(0, 1, regular(3, 5.5))),
    (11, "square_prism", box(8, 8)),
    (12, "cylindrical", circle(4.5)),
    (13, "elliptical_13", ellipse(5.5, 3.4)),
    (14, "rectangular", box(11, 6)),
    (15, "t_shaped", tee(9, 2.6)),
    (16, "u_shaped", minus(box(9, 9), at(0, -2, box(4, 9)))),
    (17, "cross_shaped", cross(10, 3)),
    (18, "isosceles_triangular", polygon((0, -5.5), (3.5, 4.5), (-3.5, 4.5))),
    (19, "ring_shaped", ring(5, 3)),
    (23, "square_holes", minus(_PLATE, grid(2, 2, 4.6, box(2.8, 2.8)))),
    (24, "triangular_hole", minus(_DISC, regular(3, 3))),
    (25, "regular_hexagonal_hole", minus(_DISC, regular(6, 3))),
    (26, "moon_shaped_hole", minus(_DISC, at(0.8, 0, crescent(3.4, 3, 2)))),
    (27, "rectangular_holes_27", minus(_PLATE, grid(3, 2, (3.4, 5), box(1.7, 3.4)))),
    (29, "small_ring", ring(2.6, 1.4)),
    (30, "pentagram_shaped_holes", minus(_PLATE, grid(2, 2, 4.8, star(5, 2.1, 0.85)))),
    (31, "grid_like_gaps", minus(box(12, 12), *_GAPS)),
    (32, "small_trapezoid_array", grid(3, 3, 3.4, trapezoid(1.2, 2.6, 2))),
    (33, "small_pentagons_array", grid(3, 3, 3.4, regular(5, 1.4))),
    (34, "small_ellipse_array", grid(3, 4, (3.6, 2.4), ellipse(1.5, 0.8))),
    (35, "crescent_shaped", at(0.8, 0, crescent(5, 4.2, 2.4))),
    (36, "sun_like_cylindrical", union(circle(3), around(12, 4.4, _RAY))),
    (37, "small_pentagrams_array", grid(3, 3, 3.6, star(5, 1.7, 0.7))),
    (38, "small_rectangular_bars", grid(3, 1, 3, box(1.2, 7))),
    (39, "large_ring", ring(7, 5.4)),
    (40, "rectangular_bar_array", grid(2, 4, (5.4, 2.4), box(4.2, 1.2))),
    (41, "rectangular_holes_41", minus(_PLATE, grid(1, 2, 4.4, box(8, 2.4)))),
    (42, "star_shaped_holes", minus(_PLATE, around(4, 3.3, star(4, 1.8, 0.7)))),
    (43, "elliptical_holes", minus(_PLATE, grid(2, 3, (5, 3.3), ellipse(1.9, 1)))),
    (44, "radial_hole", minus(circle(6), around(8, 3.3, box(0.9, 3.2)))),
    (45, "dense_circular_holes_45", minus(circle(6), *_HOLES)),
    (46, "circular_holes", minus(_DISC, around(3, 2.6, circle(1.5)))),
    (47, "irregular_holes", minus(_PLATE, *_SCATTER)),
    (48, "circular_hole_array", minus(_PLATE, grid(3, 3, 3.4, circle(1.1)))),
    (49, "regular_pentagonal_holes", minus(circle(6), around(5, 3.4, regular(5, 1.5)))),
    (50, "large_star_shaped_hole", minus(circle(6.5), star(5, 5, 2))),
    (51, "small_rectangular_holes", minus(_PLATE, grid(4, 5, (2.5, 2), box(1.5, 0.8)))),
    (52, "teardrop_shaped_hole", minus(_DISC, at(0, 1.1, teardrop(2.4, 4.8)))),
    (53, "large_circular_hole", minus(box(12, 12), circle(4.4))),
    (54, "cross_shaped_hole", minus(_DISC, cross(7, 1.8))),
    (55, "diamond_shaped_holes", minus(_PLATE, grid(3, 2, (3.3, 5), _DIAMOND))),
    (56, "dense_small_holes", minus(_PLATE, grid(8, 8, 1.25, circle(0.35)))),
    (57, "s_shaped_holes", minus(_PLATE, grid(2, 1, 4.8, at(0, -1.2, _ESS)))),
    (58, "teardrop", at(0, 1.6, teardrop(3.2, 6.4))),
    (59, "moon_shaped", at(-0.8, 0, turn(180, crescent(4.5, 4.5, 4)))),
    (60, "rectangular_bar_60", box(10, 3.4)),
    (61, "pentagram", star(5, 6, 2.3)),
    (62, "elliptical_62", ellipse(3, 6.4)),
    (63, "right_angled_trapezoidal", polygon((-4.5, -3), (1, -3), (4.5, 3), (-4.5, 3))),
    (64, "small_square_array", grid(4, 4, 2.6, box(1.4, 1.4))),
    (65, "rectangular_bar_65", box(2.2, 12.6)),
    (66, "semicircular_hole_array", minus(_PLATE, grid(3, 3, 3.4, at(0, 0.6, sector(1.3, 180))))),
    (67, "t_shaped_hole_array", minus(_PLATE, grid(3, 3, 3.4, tee(2.3, 0.8)))),
    (68, "dense_circular_holes_68", minus(_PLATE, grid(5, 5, 2.05, circle(0.7)))),
    (69, "large_triangular_hole", minus(circle(6.5), regular(3, 5))),
    (70, "regular_octagonal", turn(22.5, regular(8, 5))),
    (71, "clover_shaped", union(at(0, -0.8, _LEAVES), _STALK)),
)
#: index, name, height of curved tips
_CURVED: tuple[tuple[int, str, Height], ...] = (
    (7, "small_sphere", ball(2.2)),
    (20, "raised_elliptical", join(extrude(ellipse(3.6, 2)), lift(extrude(_DISC), 1))),
    (21, "five_small_spheres", extrude(union(circle(1.3), around(4, 3.5, circle(1.3))), 1.3)),
    (22, "small_sphere_array", extrude(grid(4, 4, 2.6, circle(1)), 1)),
    (28, "raised_small_sphere", join(ball(1.8), lift(extrude(circle(5)), 1))),
)

_HEIGHTS: dict[int, tuple[str, Height]] = {
    **{index: (name, extrude(mask)) for index, name, mask in _FLAT},
    **{index: (name, height) for index, name, height in _CURVED},
}


def _split(index: int) -> Split:
    if index in BENCH_TRAIN:
        return "bench_train"
    return "bench_test" if index in BENCH_TEST else "pretrain"


#: The indenters by name, in the order of the paper's table.
INDENTERS: dict[str, Shape] = {
    name: shape_of(name, height, index=index, split=_split(index))
    for index, (name, height) in sorted(_HEIGHTS.items())
}


def shape(name: str) -> Shape:
    """An indenter or a texture by name.

    Raises:
        ConfigError: The name is unknown; the message gives the nearest one.

    Example:
        >>> shape("clover_shaped").index
        71
    """
    for known in (INDENTERS, TEXTURES):
        if name in known:
            return known[name]
    fix = "For a mesh, a point cloud or a picture see tactileforge_sim.geometry.objects."
    raise ConfigError(unknown("shape", name, {*INDENTERS, *TEXTURES}, fix))
