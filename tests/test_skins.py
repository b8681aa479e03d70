"""Top skins are laid in one sweep, and ironed if that is asked for."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from printer_slicer import bead
from printer_slicer.arrays import Float
from printer_slicer.infill import infill_paths
from printer_slicer.model import Areas, LayerPlan, Regions, Sections, Toolpaths
from printer_slicer.ordering import order
from printer_slicer.roles import Role
from tests.parts import plain, shape, shapely
from tests.strategies import clean_areas


def top_only(areas: Areas) -> tuple[Regions, Sections]:
    """Areas that are all of them top skin, and sections a little larger."""
    plan = LayerPlan.from_tops(np.arange(1, areas.n_layers + 1) * 0.2)
    none = Areas.empty(areas.n_layers)
    return Regions(plan, none, none, areas, none, none, np.zeros(0)), Sections(plan, areas)


def rows_in_order(paths: Toolpaths, layer: int, angle: float) -> Float:
    """(n, 3) the long lines of a layer as they are printed: place across, and from where to where along."""
    across, along = np.array([-np.sin(angle), np.cos(angle)]), np.array([np.cos(angle), np.sin(angle)])
    rows = []
    for i in np.flatnonzero(paths.layer == layer).tolist():
        xy = paths.path(i)
        for a, b in pairwise(xy):
            if abs((b - a) @ across) < 1e-3 * np.hypot(*(b - a)):
                rows.append((a @ across, *sorted((a @ along, b @ along))))
    return np.array(rows).reshape(-1, 3)


def check_monotonic(rows: Float, gap: float) -> None:
    """No line is printed between two neighbours that are there already."""
    for i, (place, left, right) in enumerate(rows):
        before = rows[:i]
        # Rows reach toward the border: at the tip of a hole those on either side of it may pass each other a little.
        beside = (before[:, 1] < right - gap) & (before[:, 2] > left + gap)
        step = (before[beside, 0] - place) / gap
        assert not ((np.abs(step - 1) < 0.3).any() and (np.abs(step + 1) < 0.3).any())


@given(areas=clean_areas(2), degrees=st.integers(0, 90))
def test_no_line_of_a_top_skin_is_laid_between_two_others(areas: Areas, degrees: int) -> None:
    # Round parts of 3 to 10 mm with holes, twice as large.
    areas = Areas(areas.xy * 3, areas.ring_start, areas.ring_layer, areas.n_layers)
    regions, sections = top_only(areas)
    wanted = plain(infill_angle_deg=degrees)

    paths = order(infill_paths(regions, wanted), sections, wanted)

    for layer in range(2):
        parts = [one for one in shapely.get_parts(shape(areas, layer)) if not one.is_empty]
        for part in parts:
            here = shapely.contains(part.buffer(0.1), shapely.points(paths.xy[paths.start[:-1]]))
            # What is too narrow for rows has loops, which are in no sweep.
            some = np.flatnonzero(here & (paths.layer == layer) & (paths.chain_id >= 0))
            if not len(some):
                continue
            mine = Toolpaths.gathered(
                paths.plan,
                xy=np.concatenate([paths.path(i) for i in some.tolist()]),
                size=np.diff(paths.start)[some],
                layer=paths.layer[some],
                role=paths.role[some],
                width=paths.width[paths.start[some]],
                closed=False,
            )
            gap = float(bead.spacing(mine.width[0], 0.2))
            rows = rows_in_order(mine, layer, np.deg2rad(degrees) + np.pi / 2 * (layer % 2))
            check_monotonic(rows, gap)


def test_a_skin_around_a_hole_is_one_sweep_from_one_side_to_the_other() -> None:
    ring = [
        np.array([(0, 0), (30, 0), (30, 20), (0, 20)], float),
        np.array([(10, 6), (10, 14), (20, 14), (20, 6)], float),
    ]
    regions, sections = top_only(Areas.from_rings([ring]))
    wanted = plain(infill_angle_deg=0)

    paths = order(infill_paths(regions, wanted), sections, wanted)

    # Beads amid what rows leave come after them, or before.
    swept = paths.chain_id >= 0
    assert len(np.unique(paths.chain_id[swept])) == 1
    assert (np.diff(np.flatnonzero(swept)) == 1).all()
    rows = rows_in_order(paths, 0, 0.0)
    assert len(rows) > 50
    check_monotonic(rows, float(bead.spacing(paths.width[0], 0.2)))


def test_sweeps_of_more_paths_than_are_worth_sorting_stay_in_order() -> None:
    plan = LayerPlan.from_tops(np.array([0.2]))
    count = 25_000
    y = np.repeat(np.arange(count) * 0.01, 2)
    paths = Toolpaths.gathered(
        plan,
        xy=np.column_stack([np.tile([0.0, 5.0], count), y]),
        size=np.full(count, 2),
        layer=np.zeros(count, np.int64),
        role=np.full(count, Role.TOP_SOLID_INFILL),
        width=np.full(count, 0.4),
        closed=False,
        chain_id=np.zeros(count, np.int64),
    )
    square = np.array([(0, 0), (300, 0), (300, 300), (0, 300)], float)

    after = order(paths, Sections(plan, Areas.from_rings([[square]])), plain())

    assert np.array_equal(after.xy, paths.xy)


# --- ironing ---


def test_ironing_covers_the_top_skin_with_its_spacing_and_flow() -> None:
    square = np.array([(0, 0), (20, 0), (20, 20), (0, 20)], float)
    regions, sections = top_only(Areas.from_rings([[square], [square]]))
    wanted = plain(ironing=True, ironing_spacing=0.2, ironing_flow_ratio=0.12, infill_angle_deg=0)

    paths = order(infill_paths(regions, wanted), sections, wanted)

    for layer in range(2):
        here = paths.layer == layer
        # It is the last, over all of the skin.
        assert (np.diff((paths.role[here] == Role.IRONING).astype(int)) >= 0).all()
        ironed = np.flatnonzero(here & (paths.role == Role.IRONING))
        assert paths.height[ironed] == pytest.approx(0.12 * 0.2)
        length = sum(float(np.hypot(*np.diff(paths.path(i), axis=0).T).sum()) for i in ironed.tolist())
        section = float(bead.cross_section(paths.width[paths.start[ironed[0]]], 0.12 * 0.2))
        assert length * section == pytest.approx(0.12 * 0.2 * 400, rel=0.02)


def test_without_asking_nothing_is_ironed() -> None:
    square = np.array([(0, 0), (20, 0), (20, 20), (0, 20)], float)

    assert Role.IRONING not in infill_paths(top_only(Areas.from_rings([[square]]))[0], plain()).role


def test_layers_of_uneven_height_are_ironed_by_their_own() -> None:
    square = np.array([(0, 0), (20, 0), (20, 20), (0, 20)], float)
    regions, _ = top_only(Areas.from_rings([[square]] * 3))
    plan = LayerPlan.from_tops(np.array([0.1, 0.4, 0.6]))
    none = Areas.empty(3)
    uneven = Regions(plan, none, none, regions.top_solid_infill, none, none, np.zeros(0))

    paths = infill_paths(uneven, plain(ironing=True))

    ironed = paths.role == Role.IRONING
    assert paths.height[ironed] == pytest.approx(0.15 * plan.height[paths.layer[ironed]])
