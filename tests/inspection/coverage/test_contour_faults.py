"""Contoured files without faults have no findings, and planted faults are found."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np
import pytest

from printer_slicer.gcode_text import gcode_of
from printer_slicer.inspection.coverage.model_check import Check, check_gcode
from printer_slicer.model import Mesh
from printer_slicer.pipeline import slice_part
from printer_slicer.profile import load_profile
from tests import contoured_parts
from tests.contoured_gcode import (
    HEIGHT,
    KINDS,
    PARTS,
    RULES,
    Line,
    Part,
    Rule,
    contour,
    example,
    level,
    wedge,
)
from tests.parts import box, box_with_hole, joined, loft, pyramid

SEEDS = (1, 2, 3)
Change = Callable[[Line], Line | None]
Planter = Callable[[np.random.Generator, int], Change]


@cache
def small(degrees: int) -> tuple[Part, str]:
    """A small wedge, and its G-code of level layers."""
    part = wedge(degrees, 13.0, 9.0)
    return part, level(part, widened=True)


def checked(degrees: int, change: Change | None = None) -> Check:
    part, text = small(degrees)
    return check_gcode(contour(text, part, Rule(change=change) if change else Rule()).encode(), part.mesh)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", PARTS)
def test_a_contoured_file_has_no_findings(name: str, kind: str) -> None:
    part, text = example(name, kind)
    check = check_gcode(text.encode(), part.mesh)

    assert check.findings == ()
    assert check.problems == ()
    assert check.match.shift == pytest.approx((0, 0), abs=0.002)
    assert check.coverage.surface is not None
    assert check.coverage.surface.length.max() < 1


def test_narrow_sections_on_a_steep_top_need_what_is_below_the_surface() -> None:
    """No extrusion of the file is as low as the setting, because the centre lines are half a width from the edge."""
    settings = {"quality.layer_height": 0.2, "quality.planner.kind": "uniform", "quality.z_contouring": True}
    mesh = contoured_parts.wedge(20.0, (30.0, 30.0))
    profile = load_profile("marlin_220", "pla", "standard", settings)
    text = gcode_of(slice_part(mesh, profile), profile)

    assert check_gcode(text, mesh).findings == ()


@pytest.mark.parametrize("name", ["ends inside another body", "goes on above the layer", "ends at the top"])
def test_surfaces_that_another_body_covers_are_not_followed(name: str) -> None:
    """Bodies overlap: perimeters of one cross the surface of the other, or a flat is under a slope by little."""
    wedge, dome = contoured_parts.wedge, contoured_parts.dome
    bodies = {
        "ends inside another body": [
            wedge(8.0, (20.0, 20.0)),
            box((4.0, 4.0, 6.0), (8.0, 8.0, 0.0)),
            dome(15.0, 2.0).moved((15.0, 10.0, 0.0)),
        ],
        "goes on above the layer": [wedge(7.0, (30.0, 15.0)), box((1.4, 8.0, 2.3), (11.0, 3.0, 0.0))],
        "ends at the top": [box((10.0 - 0.9 * step, 6.0, 1.0 + 0.07 * step)) for step in range(9)],
    }
    settings = {"quality.layer_height": 0.2, "quality.planner.kind": "uniform", "quality.z_contouring": True}
    profile, mesh = load_profile("marlin_220", "pla", "standard", settings), joined(bodies[name])

    assert check_gcode(gcode_of(slice_part(mesh, profile), profile), mesh).findings == ()


def test_sections_may_be_level_around_places_that_break_the_tolerance() -> None:
    """Around these places, sections are not extended."""
    slope = joined([contoured_parts.wedge(12.0), pyramid(6.0, 5.0)])
    mesh = joined(
        [
            slope,
            contoured_parts.dome().moved((40.0, 0.0, 0.0)),
            contoured_parts.wedge(18.0, (8.0, 8.0)).moved((70.0, 0.0, 0.0)),
        ]
    )
    changes = {"quality.z_contouring": True, "quality.tolerance": 0.08}
    profile = load_profile("marlin_220", "pla", "adaptive", changes)

    assert check_gcode(gcode_of(slice_part(mesh, profile), profile), mesh).findings == ()


def test_high_layers_of_a_shallow_cone_have_the_material_they_need() -> None:
    """Lowered extrusions are as far apart as those of full height, although their sides are less round."""
    angle = np.arange(64) / 32 * np.pi
    ring = np.column_stack([np.cos(angle), np.sin(angle)])
    top = 1.0 + 14.0 * np.tan(np.deg2rad(12.0))
    mesh = Mesh(loft([15.0 * ring, 15.0 * ring, ring], [0.0, 1.0, top]), "cone")
    profile = load_profile("marlin_220", "pla", "adaptive", {"quality.z_contouring": True})
    check = check_gcode(gcode_of(slice_part(mesh, profile), profile), mesh)

    assert check.findings == ()
    assert np.median(check.coverage.fill.shell[4:-1]) < 1.06


def test_a_flat_inside_a_layer_is_covered_up_to_the_wall_beside_it() -> None:
    """All its extrusions are level. The file shows that they are contoured by its two levels in one layer."""
    settings = {"quality.layer_height": 0.2, "quality.planner.kind": "uniform", "quality.z_contouring": True}
    outer = box_with_hole((30.0, 20.0, 1.49), (27.6, 17.6))
    inner = box_with_hole((27.6, 17.6, 4.0), (25.0, 15.0)).moved((1.2, 1.2, 0.0))
    mesh = joined([outer, inner])
    profile = load_profile("marlin_220", "pla", "standard", settings)
    check = check_gcode(gcode_of(slice_part(mesh, profile), profile), mesh)

    assert check.findings == ()
    assert check.coverage.stack.n_layers == 20


def test_the_small_wedges_have_no_findings() -> None:
    for degrees in (10, 20):
        assert checked(degrees).findings == ()


def on_slope(one: Line, least: float = 0.02) -> bool:
    """Whether a point lies on a lowered piece."""
    return one["z"] < one["top"] - least


def missing_wall(rng: np.random.Generator, layer: int) -> Change:
    del rng
    return lambda one: None if one["layer"] == layer and one["wall"] and on_slope(one) else one


def shifted(rise: float) -> Planter:
    """Beads on the slope that are too high, or too low, with the flow that suits their height."""

    def plant(rng: np.random.Generator, layer: int) -> Change:
        most = rise * rng.uniform(1.0, 1.2)

        def change(one: Line) -> Line:
            if one["layer"] != layer or not on_slope(one):
                return one
            bottom = one["top"] - HEIGHT
            z = max(one["z"] + most, bottom + 0.02)
            return one | {"z": z, "e": one["e"] * (z - bottom) / (one["z"] - bottom)}

        return change

    return plant


def flow(ratio: float) -> Planter:
    def plant(rng: np.random.Generator, layer: int) -> Change:
        share = ratio * rng.uniform(0.9, 1.1)
        return lambda one: one | {"e": one["e"] * share} if one["layer"] == layer and on_slope(one) else one

    return plant


def below_the_layer(rng: np.random.Generator, layer: int) -> Change:
    depth = rng.uniform(0.03, 0.1)
    return lambda one: (
        one | {"z": one["top"] - HEIGHT - depth} if one["layer"] == layer and on_slope(one, 0.1) else one
    )


def missing_layer(rng: np.random.Generator, layer: int) -> Change:
    del rng
    return lambda one: None if one["layer"] == layer else one


def moved_wall(rng: np.random.Generator, layer: int) -> Change:
    away = rng.uniform(0.45, 0.6)
    return lambda one: (
        one | {"x": one["x"] + away} if one["layer"] == layer and one["wall"] and on_slope(one) else one
    )


def gap_in_skin(rng: np.random.Generator, layer: int) -> Change:
    """A gap of 4 mm in the skin, as far as the slope comes within 2 mm of the top of the layer."""
    middle = rng.uniform(-1.5, 1.5)
    low = {"x": np.inf}

    def change(one: Line) -> Line | None:
        if one["layer"] != layer:
            return one
        if one["wall"] and on_slope(one):
            low["x"] = min(low["x"], one["x"])
        is_gap = not one["wall"] and one["x"] > low["x"] - 2 and abs(one["y"] - middle) < 2
        return None if is_gap else one

    return change


def level_strip(rng: np.random.Generator, layer: int) -> Change:
    """The whole strip at the top of its layer, as if it were not contoured."""
    del rng

    def change(one: Line) -> Line:
        if one["layer"] != layer or not on_slope(one):
            return one
        bottom = one["top"] - HEIGHT
        return one | {"z": one["top"], "e": one["e"] * HEIGHT / (one["z"] - bottom)}

    return change


FAULTS: dict[str, tuple[Planter, set[str]]] = {
    "missing wall": (missing_wall, {"uncovered", "outline", "underfilled"}),
    "too high": (shifted(0.09), {"contour"}),
    "too low": (shifted(-0.09), {"contour"}),
    "too little flow": (flow(0.5), {"uncovered", "underfilled", "outline"}),
    "too much flow": (flow(1.7), {"overlap", "overfilled", "outside", "outline"}),
    "below the layer": (below_the_layer, {"contour"}),
    "missing layer": (missing_layer, {"uncovered", "underfilled", "outline"}),
    "moved wall": (moved_wall, {"outside", "outline", "uncovered"}),
    "gap in skin": (gap_in_skin, {"uncovered", "underfilled"}),
    "level strip": (level_strip, {"contour", "outline", "outside"}),
}


# On 10 degrees, walls cover the whole slope.
CASES = [
    (fault, degrees) for fault in FAULTS for degrees in (5, 10) if (fault, degrees) != ("gap in skin", 10)
]


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize(("fault", "degrees"), CASES)
def test_planted_faults_are_found(fault: str, degrees: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    plant, codes = FAULTS[fault]
    n = round(small(degrees)[0].mesh.height / HEIGHT)
    layer = int(rng.integers(7, n))
    check = checked(degrees, plant(rng, layer))

    found = {one.code for one in check.findings if one.first <= layer + 1 and one.last >= layer - 1}
    assert found & codes, [one.message for one in check.findings]


@pytest.mark.parametrize("seed", SEEDS)
def test_an_extrusion_above_a_lowered_strip_is_found(seed: int) -> None:
    part, text = small(10)
    rng = np.random.default_rng(seed)
    rows = contour(text, part, RULES["lowered"]).split("\n")
    layers = [k for k, row in enumerate(rows) if row.startswith(";LAYER_CHANGE")]
    layer = int(rng.integers(9, len(layers) - 1))
    # The slope one or two layers below, at the end of a layer.
    x = part.mesh.bounds[1, 0] - ((layer - rng.integers(1, 3)) * HEIGHT - 1.0) / np.tan(np.radians(10))
    end = layers[layer]
    added = [";TYPE:Top solid infill", f"G0 X{x:.3f} Y-3", f"G1 X{x:.3f} Y3 E0.25"]
    check = check_gcode("\n".join(rows[:end] + added + rows[end:]).encode(), part.mesh)

    assert {one.code for one in check.findings} & {"outside", "outline", "contour", "unsupported"}
