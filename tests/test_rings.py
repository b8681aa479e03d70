"""No stage hands on rings without area: from the sections to the bridges, with either engine."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from printer_slicer.arrays import Float
from printer_slicer.compensation import compensate
from printer_slicer.geometry import Areas, difference, intersection, normalize, offset_open, union
from printer_slicer.geometry.engine import using_engine
from printer_slicer.geometry.polygons import STEPS_PER_MM
from printer_slicer.infill import PATTERNS
from printer_slicer.infill.combined_infill import group_layers
from printer_slicer.infill.internal_bridges import layers_below_bridges, support_internal_bridges
from printer_slicer.infill.internal_infill import lay_out_pattern, lines_on_layers
from printer_slicer.model import LayerPlan, Mesh
from printer_slicer.perimeters import lay_walls
from printer_slicer.regions import classify
from printer_slicer.slicing import cut
from tests.effort import examples
from tests.geometry.test_engine import engines, is_clean
from tests.infill.test_internal_bridges import ALONG_A_SIDE, bridged_over
from tests.parts import loft, plain
from tests.strategies import star_rings

STEP = 1 / STEPS_PER_MM
USUAL = plain(infill_density=0.15, elephant_foot=0.15, xy_compensation=0.05, extra_perimeters=True)


def assert_rings_hold_area(areas: Areas, where: str) -> None:
    """Each ring is wider than the grid, none turns back on itself, and a second program can work with them."""
    width = 2 * np.abs(areas.ring_area()) / areas.ring_length()
    assert (width > STEP).all(), f"{where}: a ring {width.min():.3g} mm wide"
    for ring in map(areas.ring, range(areas.n_rings)):
        assert not (ring == np.roll(ring, 1, axis=0)).all(axis=1).any(), f"{where}: two equal points"
        assert width_of_spikes(ring).min() > STEP, f"{where}: a spike"
    with using_engine("planar"):
        assert is_clean(areas), f"{where}: the second engine sees another area"


def width_of_spikes(ring: Float) -> Float:
    """(n,) mm between the two sides at the end of the shorter one, for points in which the ring turns back."""
    there, back = ring - np.roll(ring, 1, axis=0), np.roll(ring, -1, axis=0) - ring
    turned = np.arctan2(there[:, 0] * back[:, 1] - there[:, 1] * back[:, 0], (there * back).sum(axis=1))
    shorter = np.minimum(np.hypot(*there.T), np.hypot(*back.T))
    return np.where(np.abs(turned) >= np.pi / 2, shorter * np.abs(np.sin(turned)), np.inf)


def areas_of(value: object) -> Iterator[tuple[str, Areas]]:
    """All areas that a value of some stage holds."""
    for field in fields(value):  # type: ignore[arg-type]  # only values of stages are given
        content = getattr(value, field.name)
        if isinstance(content, Areas):
            yield f"{type(value).__name__}.{field.name}", content


@st.composite
def bodies(draw: st.DrawFn) -> Mesh:
    """Prisms over convex outlines that turn, shrink and grow from one to the next."""
    parts, low = [], 0.0
    for _ in range(draw(st.integers(1, 3))):
        sides, turn = draw(st.integers(3, 9)), draw(st.integers(0, 62)) / 10
        radius, height = draw(st.integers(8, 60)) / 4, draw(st.integers(2, 8)) / 5
        angles = turn + np.arange(sides) * (2 * np.pi / sides)
        ring = radius * np.column_stack([np.cos(angles), np.sin(angles)])
        narrower = ring * draw(st.sampled_from([1.0, 1.0, 0.97, 0.6]))
        parts.append(loft([ring, narrower], [low, low + height]))
        low += height
    return Mesh(np.concatenate(parts), "prisms")


@st.composite
def almost_alike(draw: st.DrawFn) -> tuple[Areas, Areas]:
    """Two stacks of one layer whose outlines lie some steps of the grid apart."""
    rings = draw(star_rings())
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    far = draw(st.sampled_from([0.4, 1.0, 2.0, 5.0])) * STEP
    # In two, so that some outlines are straight on and others have one more corner.
    doubled = [
        np.stack([ring, (ring + np.roll(ring, -1, axis=0)) / 2], axis=1).reshape(-1, 2) for ring in rings
    ]
    moved = [ring + rng.uniform(-far, far, ring.shape) for ring in doubled]
    return normalize(Areas.from_rings([rings])), normalize(Areas.from_rings([moved]))


def stages_of(mesh: Mesh) -> list[object]:
    """The values of all stages that hold areas."""
    plan = LayerPlan.from_tops(np.arange(0.2, mesh.height + 1e-6, 0.2))
    sections = cut(mesh, plan, USUAL.quality.resolution)
    fitted = compensate(sections, USUAL)
    walls = lay_walls(fitted, USUAL)
    regions = classify(fitted, walls, USUAL)
    groups = group_layers(regions.internal_infill, plan, USUAL.quality.internal_infill_every)
    layout = lay_out_pattern(regions, groups, PATTERNS[USUAL.quality.infill], USUAL, measured=True)
    bridged = support_internal_bridges(regions, lines_on_layers(layout, layers_below_bridges(regions)), USUAL)
    return [sections, fitted, walls, regions, bridged]


@engines
@given(pair=almost_alike())
def test_no_operation_on_outlines_that_almost_coincide_leaves_rings_without_area(
    engine: str, pair: tuple[Areas, Areas]
) -> None:
    a, b = pair
    with using_engine(engine):
        made = {
            "a - b": difference(a, b),
            "b - a": difference(b, a),
            "a and b": intersection(a, b),
            "a or b": union(a, b),
            "opened": offset_open(union(a, b), 0.3),
            "strips": difference(a, offset_open(b, 0.3)),
        }
    for where, areas in made.items():
        assert_rings_hold_area(areas, where)


@engines
@settings(max_examples=examples(6))
@given(mesh=bodies())
def test_no_stage_hands_on_rings_without_area(engine: str, mesh: Mesh) -> None:
    with using_engine(engine):
        values = stages_of(mesh)

    for value in values:
        for where, areas in areas_of(value):
            assert_rings_hold_area(areas, where)


@engines
def test_bridges_over_lines_that_almost_run_along_a_side_hold_area(engine: str) -> None:
    """Rows that end a step of the grid apart left a bridge with a spike, in which GEOS fails."""
    with using_engine(engine):
        after = bridged_over(ALONG_A_SIDE, np.deg2rad(179), 2.0)[1]

    for where, areas in areas_of(after):
        assert_rings_hold_area(areas, where)
