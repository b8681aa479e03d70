"""Where a section is too narrow for its loops, beads of varying width fill it from side to side."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product

import numpy as np
import pytest
from hypothesis import Phase, example, given, settings
from hypothesis import strategies as st

from printer_slicer import bead
from printer_slicer.arrays import Bool, Float
from printer_slicer.geometry import Areas, normalize
from printer_slicer.geometry.medial_axis import medial_axis
from printer_slicer.model import LayerPlan, Sections, Walls
from printer_slicer.perimeters import fill_narrow, lay_walls
from printer_slicer.roles import Role
from tests.effort import crossed, examples
from tests.parts import plain, shape, shapely
from tests.raster import PITCH, Raster, raster
from tests.strategies import box, clean_areas

WIDTH, NARROWEST, NOZZLE = 0.45, 0.34, 0.4


def stack(*layers: Sequence[Float], height: float = 0.2) -> Sections:
    solid = normalize(Areas.from_rings([list(rings) for rings in layers]))
    return Sections(LayerPlan.from_tops(height * np.arange(1, len(layers) + 1)), solid)


def circle(radius: float, n: int = 60, at: tuple[float, float] = (0.0, 0.0)) -> Float:
    turn = np.arange(n) * (2 * np.pi / n)
    return np.column_stack([np.cos(turn), np.sin(turn)]) * radius + np.array(at)


def wedge(length: float = 20.0) -> Float:
    return np.array([[0, -0.15], [length, -1.5], [length, 1.5], [0, 0.15]])


def turned(ring: Float, angle: float) -> Float:
    return ring @ np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])


def drawn(walls: Walls, sections: Sections, layer: int = 0) -> Raster:
    return raster(walls.paths, sections.solid, walls.inside, layer)


def corners(sections: Sections, image: Raster, reach: float = 0.3) -> Bool:
    """Where round beads leave the tips of corners open, as they do everywhere."""
    solid = sections.solid
    way = solid.xy[solid.following] - solid.xy
    after = way[solid.following]
    turn = np.arctan2(way[:, 0] * after[:, 1] - way[:, 1] * after[:, 0], (way * after).sum(axis=1))
    tips = solid.xy[solid.following][turn > np.deg2rad(30)]
    low = solid.xy.min(axis=0) - 0.6
    x, y = (low[axis] + (np.arange(image.solid.shape[axis]) + 0.5) * PITCH for axis in (0, 1))
    near = np.zeros(image.solid.shape, np.bool_)
    for tip in tips:
        near |= (x[:, None] - tip[0]) ** 2 + (y[None, :] - tip[1]) ** 2 < reach**2
    return near


def plastic(walls: Walls) -> Float:
    """(L,) mm² that the beads fill."""
    paths = walls.paths
    following = paths.following
    path = np.repeat(np.arange(paths.n_paths), np.diff(paths.start))
    length = np.hypot(*(paths.xy[following] - paths.xy).T)
    spacing = bead.spacing((paths.width + paths.width[following]) / 2, paths.height[path])
    return np.bincount(paths.layer[path], length * spacing, walls.plan.n_layers)


def within_walls(walls: Walls, sections: Sections, layer: int) -> float:
    """Mm² of beads outside the section, beyond what a bead that is wider than its wall must leave it."""
    paths = walls.paths
    room = shape(sections.solid, layer).buffer(0.01 + (NARROWEST - 0.1) / 2)
    out = 0.0
    for i in np.flatnonzero(paths.layer == layer).tolist():
        line = paths.path(i)
        ring = shapely.LineString(np.vstack([line, line[:1]]) if paths.closed[i] else line)
        out += shapely.area(shapely.difference(ring.buffer(NARROWEST / 2), room))
    return out


@pytest.mark.parametrize("loops", [1, 2])
def test_a_triangle_beside_something_narrow_keeps_its_loops(loops: int) -> None:
    triangle = np.array([[0.0, 0.0], [8.0, 0.0], [4.0, 7.0]])
    thin = np.array([[12.0, 0.0], [20.0, 0.0], [20.0, 0.7], [12.0, 0.7]])
    alone, beside = stack([triangle]), stack([triangle, thin])
    wanted = plain(perimeters=loops)

    whole, both, narrow = (plastic(lay_walls(one, wanted))[0] for one in (alone, beside, stack([thin])))
    assert whole > 0
    assert both == pytest.approx(whole + narrow, rel=0.03)


# --- what the requirement names ---


@pytest.mark.parametrize(("height", "perimeters"), crossed([0.08, 0.2, 0.32], [2, 4]))
def test_a_wedge_from_0_3_to_3_mm_has_no_gaps_and_no_heaps(height: float, perimeters: int) -> None:
    sections = stack([wedge()], height=height)
    walls = lay_walls(sections, plain(perimeters=perimeters))

    image = drawn(walls, sections)
    assert image.widest_gap(but=corners(sections, image)) <= 0.1
    # On the inner side of every turn beads lie over each other, as they do in any corner of any loop.
    assert image.most_plastic(0.3, but=corners(sections, image, 2.4)) <= 1.3
    assert (walls.inside.area()[0] > 1) == (perimeters == 2)


@settings(deadline=None, max_examples=8, phases=[Phase.explicit, Phase.generate])
@given(thickness=st.floats(0.3, 3.0), height=st.sampled_from([0.08, 0.2, 0.32]), angle=st.floats(0, 3.1))
def test_straight_walls_of_any_thickness_are_filled(thickness: float, height: float, angle: float) -> None:
    sections = stack([turned(box(0, 0, 4.5, thickness), angle)], height=height)
    walls = lay_walls(sections, plain(perimeters=4))

    image = drawn(walls, sections)
    assert image.widest_gap(but=corners(sections, image, 0.36)) <= 0.1 + PITCH  # cells are counted
    assert image.most_plastic(0.3, but=corners(sections, image, 2.4)) <= 1.3
    assert walls.inside.n_rings == 0


@settings(max_examples=examples(10))
@example(thickness=1.25, radius=5.0, height=0.25)  # borders simplified to 0.03 mm were off by too much
@given(thickness=st.floats(0.35, 3.5), radius=st.floats(5, 20), height=st.floats(0.08, 0.32))
def test_ring_walls_of_any_thickness_get_the_plastic_of_their_volume(
    thickness: float, radius: float, height: float
) -> None:
    sections = stack([circle(radius + thickness), circle(radius)[::-1]], height=height)
    walls = lay_walls(sections, plain(perimeters=4))

    outline = sections.solid.ring_length().sum()
    held, area = plastic(walls)[0] + walls.inside.area()[0], sections.solid.area()[0]
    # Outside, the round sides of the beads leave open what inner ones fill, where there are any.
    sides = (
        0.0 if (walls.paths.role == Role.PERIMETER).any() else outline * bead.compute_side_extension(height)
    )
    assert held == pytest.approx(area - sides, rel=0.01)
    assert walls.paths.closed.all()


LETTERS = {
    "T": [[(0, 6), (5, 6)], [(2.5, 6), (2.5, 0)]],
    "K": [[(0, 0), (0, 6)], [(3, 6), (0, 3), (3, 0)]],
    "X": [[(0, 0), (4, 6)], [(0, 6), (4, 0)]],
    "O": [[(0, 0), (4, 0), (4, 6), (0, 6), (0, 0)]],
    "Y": [[(0, 6), (2, 3), (4, 6)], [(2, 3), (2, 0)]],
}


def letter(name: str, stroke: float) -> list[Float]:
    lines = [
        shapely.LineString(line).buffer(stroke / 2, cap_style="flat", join_style="mitre")
        for line in LETTERS[name]
    ]
    polygons = shapely.get_parts(shapely.orient_polygons(shapely.union_all(lines)))
    return [np.asarray(ring.coords)[:-1] for ring in shapely.get_rings(polygons)]


@pytest.mark.parametrize(("name", "stroke"), crossed(LETTERS, [0.4, 0.7, 1.1, 1.6]))
def test_strokes_of_letters_are_filled_and_crossings_hold_no_heap(name: str, stroke: float) -> None:
    sections = stack(letter(name, stroke))
    walls = lay_walls(sections, plain(perimeters=2))

    image = drawn(walls, sections)
    tips = corners(sections, image, 0.4)
    assert image.widest_gap(but=tips) <= 0.17  # in the corners of what the outer loops leave
    assert image.most_plastic(0.3, but=tips) <= 1.6
    assert walls.lost[0] == pytest.approx(0, abs=1e-3)
    assert plastic(walls)[0] > 0.8 * sections.solid.area()[0]


def test_a_letter_of_one_stroke_is_one_line_and_closed_if_the_letter_is() -> None:
    sections = stack(letter("O", 0.4), [box(0, 0, 8, 0.4)])
    paths = lay_walls(sections, plain(perimeters=2)).paths

    assert paths.closed.tolist() == [True, False]
    assert paths.role.tolist() == [Role.EXTERNAL_PERIMETER] * 2
    # Around the corners of the O the wall is thicker.
    assert paths.width.min() == pytest.approx(0.4, abs=1e-3)
    assert paths.width.max() < 0.48


def test_two_holes_near_each_other_and_near_the_outline_keep_their_walls() -> None:
    rings = [box(0, 0, 10, 8), circle(1.5, 40, (2.2, 4))[::-1], circle(1.5, 40, (6.3, 4))[::-1]]
    sections = stack(rings)
    walls = lay_walls(sections, plain(perimeters=2))

    image = drawn(walls, sections)
    # Round beads do not reach into the cusps of what the outer loops leave.
    assert image.widest_gap(but=corners(sections, image)) <= 0.2
    # What is wide enough for all loops is wide enough for infill.
    assert walls.inside.area()[0] == pytest.approx(21.6, abs=0.4)


def test_a_rib_meets_the_block_it_grows_from() -> None:
    rib = np.array([[0, 0], [6, 0], [6, 2], [12, 2], [12, 2.6], [6, 2.6], [6, 6], [0, 6.0]])
    sections = stack([rib])
    walls = lay_walls(sections, plain(perimeters=2))

    image = drawn(walls, sections)
    assert image.widest_gap(but=corners(sections, image)) <= 0.12
    line = next(walls.paths.path(i) for i in range(walls.paths.n_paths) if not walls.paths.closed[i])
    assert line[:, 0].min() < 6.1
    assert line[:, 1] == pytest.approx(2.3, abs=0.01)


def rounded_square(half: float, radius: float) -> Float:
    """With 24 points along each of its corners, around the origin."""
    turn = np.linspace(0, np.pi / 2, 24)
    arc = radius * np.column_stack([np.cos(turn), np.sin(turn)]) + (half - radius)
    return np.concatenate([turned(arc, quarter * np.pi / 2) for quarter in range(4)])


@pytest.mark.parametrize(
    ("ring", "loops"),
    crossed(
        [(2.0, 0.5, 1.2), (4.0, 2.5, 1.2), (2.0, 0.5, 1.18), (3.0, 0.68, 2.02)],
        list(product([2, 4], [0.12, 0.2])),
    ),
)
def test_the_middle_bead_goes_on_around_corners_where_a_wall_is_a_little_thinner(
    ring: tuple[float, float, float], loops: tuple[int, float]
) -> None:
    (outer, inner, thickness), (perimeters, height) = ring, loops
    rings = [rounded_square(10, outer), rounded_square(10 - thickness, inner)[::-1]]
    sections = stack(rings, height=height)
    wanted = plain(perimeters=perimeters)
    walls = lay_walls(sections, wanted)

    paths = walls.paths
    assert paths.closed.all()
    narrowest, widest = wanted.bead_widths
    assert narrowest - 1e-3 <= paths.width.min()
    assert paths.width.max() <= widest
    assert drawn(walls, sections).widest_gap() <= 0.05
    # As many beads lie across it, wherever one cuts it.
    section = shape(sections.solid, 0)
    turn = np.linspace(0, np.pi / 2, 180, endpoint=False) + 1e-3  # the other corners are the same
    beads = [shapely.LinearRing(paths.path(i)) for i in range(paths.n_paths)]
    cuts = [shapely.LineString([(0, 0), (20 * np.cos(a), 20 * np.sin(a))]) for a in turn]
    across = [sum(shapely.get_num_geometries(cut.intersection(bead)) for bead in beads) for cut in cuts]
    assert set(across) == {len(beads)}
    assert min(section.intersection(cut).length for cut in cuts) < thickness - 0.1


# --- limits ---


def test_walls_thinner_than_the_narrowest_bead_get_that_bead_and_thinner_features_are_told_as_lost() -> None:
    sections = stack([box(0, 0, 8, 0.2)], [box(0, 0, 8, 0.08)])
    walls = lay_walls(sections, plain(perimeters=2))

    assert walls.paths.layer.tolist() == [0]
    assert walls.paths.width == pytest.approx(NARROWEST)
    assert walls.lost == pytest.approx([0, 8 * 0.08], abs=1e-4)


@pytest.mark.parametrize("height", [0.08, 0.3, 0.35])
def test_no_bead_is_narrower_than_high(height: float) -> None:
    wanted = plain(perimeters=3, min_bead_width=0.2, max_bead_width=0.6)
    walls = lay_walls(stack([wedge(12)], height=height), wanted)

    assert walls.paths.width.min() >= height


def test_the_widest_bead_is_as_wide_as_allowed() -> None:
    for limit in (0.55, 0.66, 0.8):
        walls = lay_walls(stack([wedge()]), plain(perimeters=3, max_bead_width=limit, min_bead_width=0.25))

        # Short stretches may give by a quarter of a spacing.
        assert walls.paths.width.max() <= limit + 0.1


def test_rounding_does_not_decide_over_walls_as_thin_as_the_thinnest_feature() -> None:
    """A fin exactly that thick, with corners a hair off: all of it is left out."""
    fin = np.array([[0.1, 43.2321], [0, 43.23213], [0, 0], [0.10000001, 0]])
    walls = lay_walls(stack([fin + np.array([80.00000047, 88.3839])]), plain(min_feature=0.1))

    assert walls.paths.n_paths == 0
    assert walls.lost[0] == pytest.approx(4.32, abs=0.02)


def star(points: int, outer: float, inner: float) -> Float:
    turn = np.arange(2 * points) * (np.pi / points)
    radius = np.where(np.arange(2 * points) % 2 == 0, outer, inner)
    return np.column_stack([np.cos(turn), np.sin(turn)]) * radius[:, None]


def test_all_tips_of_a_star_are_filled_alike_whatever_their_direction() -> None:
    sections = stack([star(11, 15.0, 6.0)])
    walls = lay_walls(sections, plain(perimeters=2))

    image = drawn(walls, sections)
    empty = image.solid & ~image.covered & ~image.inside
    low = sections.solid.xy.min(axis=0) - 0.6
    cells = low + (np.argwhere(empty) + 0.5) * PITCH
    tip = np.floor((np.arctan2(cells[:, 1], cells[:, 0]) + np.pi / 11) / (2 * np.pi / 11)).astype(int) % 11
    area = np.bincount(tip, minlength=11) * PITCH**2
    assert area.max() < 0.1
    assert np.ptp(area) < 0.03


def test_the_tip_of_two_strokes_that_meet_in_an_acute_corner_is_filled() -> None:
    lines = shapely.orient_polygons(shapely.LineString([(0, 0), (0, 5), (2.5, 0), (2.5, 5)]).buffer(0.2))
    sections = stack([np.asarray(lines.exterior.coords)[:-1]])
    paths = lay_walls(sections, plain(perimeters=2)).paths

    drawn_lines = shapely.union_all(
        [shapely.LineString(paths.path(i)).buffer(0.2) for i in range(paths.n_paths)]
    )
    assert drawn_lines.covers(shapely.Point(0, 5.1))
    assert drawn_lines.covers(shapely.Point(2.5, -0.1))


def test_wide_parts_have_the_loops_they_had() -> None:
    walls = lay_walls(stack([box(0, 0, 10, 10)]), plain(perimeters=2))

    paths = walls.paths
    outer = np.repeat(paths.role == Role.EXTERNAL_PERIMETER, np.diff(paths.start))
    assert (paths.width[outer] == WIDTH).all()
    assert len(set(paths.width[~outer].tolist())) == 1
    assert np.diff(walls.paths.start).tolist() == [4, 4]


LOBE = [
    (6.29, 0.01),
    (6.5, 0.05),
    (6.7, 0.13),
    (6.89, 0.25),
    (7.07, 0.4),
    (7.23, 0.58),
    (7.37, 0.79),
    (7.52, 1.09),
    (7.59, 1.28),
    (7.66, 1.55),
    (7.7, 1.84),
    (7.72, 2.13),
    (7.71, 2.42),
    (7.67, 2.7),
    (7.6, 2.98),
    (7.51, 3.25),
    (7.39, 3.5),
    (7.26, 3.73),
    (7.1, 3.93),
    (6.92, 4.1),
    (6.73, 4.24),
    (6.59, 4.31),
    (13.82, 4.31),
    (13.82, 15.93),
    (0, 15.93),
    (0, 4.31),
    (5.49, 4.31),
    (5.3, 4.2),
    (5.13, 4.05),
    (4.97, 3.86),
    (4.82, 3.65),
    (4.71, 3.42),
    (4.61, 3.16),
    (4.51, 2.7),
    (4.48, 2.32),
    (4.49, 2.03),
    (4.53, 1.74),
    (4.6, 1.46),
    (4.69, 1.2),
    (4.8, 0.95),
    (4.94, 0.72),
    (5.1, 0.52),
    (5.28, 0.35),
    (5.46, 0.21),
    (5.7, 0.09),
    (5.87, 0.03),
    (6.08, 0),
]
"""A block of 13.8 mm by 11.6 mm with an oval of 3.2 mm by 4.3 mm on a neck of 1.1 mm."""


def test_a_lobe_on_a_narrow_neck_takes_no_loop_from_what_it_stands_on() -> None:
    """A corner of the loop in the block touches what leads into the neck; the whole loop was taken for narrow."""
    walls = lay_walls(stack([np.array(LOBE)], height=0.25), plain(perimeters=2))
    inner = walls.paths.length()[walls.paths.role == Role.PERIMETER]

    assert inner.max(initial=0.0) == pytest.approx(2 * (13.8 + 11.6 - 4 * 0.65), abs=1.0)


def test_a_pin_as_wide_as_long_gets_a_dot_of_its_own_volume() -> None:
    sections = stack([circle(0.3, 24)])
    walls = lay_walls(sections, plain(perimeters=2))

    assert plastic(walls)[0] == pytest.approx(np.pi * 0.09, rel=0.12)


@pytest.mark.parametrize("corners_around", [24, 32, 45, 60])
def test_round_pins_of_any_size_get_the_plastic_of_their_volume(corners_around: int) -> None:
    """Rounding of the corners leaves an axis of no length in the middle, which is a dot all the same."""
    radii = np.arange(0.25, 1.5, 0.05)
    sections = stack(*[[turned(circle(r, corners_around), 0.1 * k)] for k, r in enumerate(radii)])
    walls = lay_walls(sections, plain(perimeters=2))

    share = (plastic(walls) + walls.inside.area()) / sections.solid.area()
    # Less the rounded side of the outer bead.
    assert (share > 1.0 - 0.05 / radii).all()
    assert (share < 1.01).all()


@pytest.mark.parametrize("size", [(0.5, 2.0), (0.6, 1.5), (0.8, 1.2), (1.2, 1.6), (1.3, 3.0)])
def test_ends_of_short_walls_get_the_plastic_of_a_round_end(size: tuple[float, float]) -> None:
    x, y = size
    sections = stack([np.array([[0, 0], [x, 0], [x, y], [0, y]])])
    walls = lay_walls(sections, plain(perimeters=2))

    square = x * y - 2 * (x + y) * bead.compute_side_extension(0.2)
    rounded = square - 4 * (1 - np.pi / 4) * min(x / 2, WIDTH) ** 2
    assert rounded * 0.98 < plastic(walls)[0] + walls.inside.area()[0] < square * 1.02


# --- anything ---


@settings(max_examples=examples(15))
@given(solid=clean_areas(3), perimeters=st.integers(1, 4))
def test_beads_of_any_section_stay_within_it_and_fill_no_more_than_it(solid: Areas, perimeters: int) -> None:
    sections = Sections(LayerPlan.from_tops(np.array([0.2, 0.4, 0.6])), solid)
    walls = lay_walls(sections, plain(perimeters=perimeters))

    used = plastic(walls) + walls.inside.area()
    assert (used <= solid.area() * 1.06 + 0.3).all()
    for layer in range(3):
        assert within_walls(walls, sections, layer) < 0.02
        inside, section = shape(walls.inside, layer), shape(solid, layer)
        assert shapely.area(shapely.difference(inside, section.buffer(1e-3))) < 1e-3


@given(solid=clean_areas(2))
def test_points_of_the_medial_axis_are_as_far_from_the_outline_as_they_say(solid: Areas) -> None:
    axis = medial_axis(solid, 3.0)

    for layer in range(2):
        here = axis.layer == layer
        outline = shape(solid, layer).boundary
        assert shapely.distance(shapely.points(axis.xy[here]), outline) == pytest.approx(
            axis.radius[here], abs=1e-4
        )
    known = axis.following >= 0
    assert (axis.end[known] == axis.start[axis.following[known]]).all()
    assert axis.foot[known, 1] == pytest.approx(axis.foot[axis.following[known], 0], abs=1e-3)


def test_layers_stand_apart_in_the_diagram_whatever_their_size() -> None:
    """Once they were moved by whole millimetres to places less far apart than they were high."""
    first = [box(0, 0, 1.5, 13), box(0, -6.5, 1, -5.5)]
    second = [box(0, 0, 1, 11), box(0, -8, 1, -7)]
    solid = stack(first, second).solid
    axis = medial_axis(solid, 3.0)

    for layer in range(2):
        here = axis.layer == layer
        outline = shape(solid, layer).boundary
        assert shapely.distance(shapely.points(axis.xy[here]), outline) == pytest.approx(
            axis.radius[here], abs=1e-6
        )


NOTCHED = np.array([[0, 0], [10, 0], [10, 1.3], [6, 1.3], [5, 0], [4, 1.3], [0, 1.3]])
"""A notch that ends on the opposite side, as rounding leaves them now and then."""


def test_layers_whose_outlines_touch_themselves_have_no_axis() -> None:
    solid = Areas.from_rings([[box(0, 0, 3, 1)], [NOTCHED]])

    axis = medial_axis(solid, 3.0)

    assert axis.left_out.tolist() == [1]
    assert set(axis.layer.tolist()) == {0}


def test_layers_whose_outlines_touch_themselves_are_filled_all_the_same() -> None:
    plan = LayerPlan.from_tops(np.array([0.2, 0.4]))
    apart = NOTCHED.copy()
    apart[4, 1] = 1e-3

    walls = lay_walls(Sections(plan, Areas.from_rings([[NOTCHED], [apart]])), plain(perimeters=2))

    touching, almost = plastic(walls)
    assert touching == pytest.approx(almost, rel=0.01)
    assert not walls.inside.n_rings


ODD = {
    "tiny": [box(0, 0, 1e-4, 1e-4)],
    "tiny hole": [box(0, 0, 1, 1), box(0.5, 0.5, 0.501, 0.501)[::-1]],
    "needle": [np.array([[0, 0], [10, 0.001], [0, 0.002]])],
    "repeated points": [np.repeat(box(0, 0, 3, 0.5), 3, axis=0)],
    "points on a line": [np.array([[0, 0], [1, 0], [2, 0], [3, 0], [3, 0.5], [2, 0.5], [0, 0.5]])],
    "touching in a point": [box(0, 0, 2, 0.8), box(2, 0.8, 4, 1.6)],
    "touching along a side": [box(0, 0, 2, 0.8), box(2, 0.2, 4, 0.6)],
    "hole that touches the outline": [box(0, 0, 4, 4), np.array([[0, 2], [1, 3], [2, 2], [1, 1.0]])],
}


@pytest.mark.parametrize("name", list(ODD))
def test_odd_outlines_do_no_harm(name: str) -> None:
    sections = stack(ODD[name])
    walls = lay_walls(sections, plain(perimeters=2))

    assert np.isfinite(walls.paths.xy).all()
    assert plastic(walls)[0] <= sections.solid.area()[0] * 1.2 + 0.2


def test_layers_do_not_know_each_other() -> None:
    shapes = [[wedge(12)], [circle(4), circle(3.2)[::-1]], letter("K", 0.7)]
    together = lay_walls(stack(*shapes), plain(perimeters=2))

    for layer, rings in enumerate(shapes):
        alone = lay_walls(stack(rings), plain(perimeters=2))
        mine = together.paths.layer == layer
        points = np.repeat(mine, np.diff(together.paths.start))
        assert together.paths.xy[points] == pytest.approx(alone.paths.xy, abs=1e-6)
        assert together.paths.width[points] == pytest.approx(alone.paths.width, abs=1e-6)


# --- strips between other beads ---


def test_a_strip_is_filled_with_one_bead_and_the_rest_is_given_back() -> None:
    strip = np.array([[0, 0], [10, 0], [10, 3], [7, 3], [7, 0.5], [0, 0.5]])
    sections = stack([strip])
    made = fill_narrow(sections.solid, sections.plan, plain(), role=Role.SOLID_INFILL)
    paths, rest = made.paths, made.rest

    assert paths.n_paths == 1
    assert paths.role[0] == Role.SOLID_INFILL
    assert paths.width.min() == pytest.approx(0.5 + 0.2 * (1 - np.pi / 4), abs=0.01)
    assert rest.area()[0] == pytest.approx(9, abs=0.3)


def test_wider_strips_are_filled_with_as_many_beads_as_asked_for() -> None:
    sections = stack([box(0, 0, 8, 1.2)])
    for beads, left in ((1, 9.6), (2, 9.6), (3, 0.0), (4, 0.0)):
        made = fill_narrow(sections.solid, sections.plan, plain(), beads=beads)

        assert made.rest.area()[0] == pytest.approx(left, abs=0.03)
        assert (made.paths.n_paths > 0) == (left == 0)
