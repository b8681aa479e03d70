"""Where not everything can be had, no rule is broken for a lesser one, and none by more than it must be."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from printer_slicer.arrays import Float
from printer_slicer.errors import PlanError
from printer_slicer.model import LayerPlan, Mesh
from printer_slicer.planning import plan_layers
from printer_slicer.planning.violations import find_violations
from printer_slicer.profile import HeightRange, Profile
from printer_slicer.surface import certify, find_flats, read_surface
from tests.parts import box, profile, sphere, step_pyramid
from tests.planning.plans import frusta


def optimal(**changes: Any) -> Profile:
    """Heights from 0.08 to 0.32 mm, the first layer free."""
    usual: dict[str, Any] = {"z_step": 0.0025, "first_layer_height": 0, "planner__kind": "optimal"}
    return profile(**(usual | {"min_layer": 0.08, "max_layer": 0.32} | changes))


def bound(mesh: Mesh, plan: LayerPlan) -> Float:
    return certify(read_surface(mesh), plan).bound


def causes(mesh: Mesh, wanted: Profile) -> set[tuple[str, str]]:
    certificate = certify(read_surface(mesh), plan_layers(mesh, wanted))
    return {(one.rule, one.cause) for one in find_violations(mesh, certificate, wanted)}


@pytest.mark.parametrize("tolerance", [0.005, 0.02, 0.035])
def test_flats_are_met_though_the_tolerance_cannot_be_kept(tolerance: float) -> None:
    """A dome on stairs: the dome is too steep for any layer, which is no reason to miss the stairs."""
    stairs, dome = step_pyramid([30, 24, 20], [1.13, 0.97, 1.09]), sphere(4)
    mesh = Mesh(
        np.concatenate([stairs.triangles, np.add(dome.triangles, [0, 0, 3.19 - dome.bounds[0, 2]])]), "part"
    )
    plan = plan_layers(mesh, optimal(tolerance=tolerance))
    off = np.abs(np.append(0.0, plan.top)[:, None] - find_flats(mesh)[0]).min(axis=0)

    assert len(off) > 3
    assert off.max() <= 0.00125 + 1e-6
    assert bound(mesh, plan).max() <= 0.08  # twice what the thinnest layers can be wrong by


@pytest.mark.parametrize("tolerance", [0.001, 0.005, 0.03])
def test_a_tolerance_that_cannot_be_kept_is_broken_by_no_more_than_uniform_thin_layers_do(
    tolerance: float,
) -> None:
    mesh = sphere(4)
    plan = plan_layers(mesh, optimal(tolerance=tolerance))
    thin = plan_layers(mesh, profile(layer_height=0.08, first_layer_height=0, z_step=0.0025, min_layer=0.08))

    assert bound(mesh, plan).max() <= bound(mesh, thin).max() + 1e-6


@pytest.mark.parametrize("lean", [0.0, 5e-5])
def test_flats_that_lean_by_a_hair_are_met_too(lean: float) -> None:
    mesh = step_pyramid([30, 20, 10], [1.013, 0.5, 2.0])
    leaning = mesh.triangles.copy()
    leaning[:, :, 2] += lean * (leaning[:, :, 0] - leaning[:, :, 0].min())
    part = Mesh(leaning, "part")
    plan = plan_layers(part, optimal(tolerance=0.12, layer_heights=(0.1, 0.2, 0.3)))
    flats = find_flats(part)[0]
    inner = flats[(flats > 0.5) & (flats < part.height - 0.5)]
    off = np.abs(plan.top[:, None] - inner).min(axis=0)

    assert len(inner) == 2
    assert off.max() <= 0.00125 + 1e-6


def test_neighbours_are_even_though_a_tall_column_would_save_a_thousand_layers() -> None:
    """A cone needs layers of 0.1 mm; those of 0.3 mm over it, on 238 mm, may not follow."""
    mesh = frusta([8, 4, 4], [2.0, 238.0])
    wanted = optimal(
        tolerance=0.042,
        layer_heights=(0.1, 0.3),
        min_layer=0.1,
        max_layer=0.3,
        bed_z=300,
        planner__max_step=0.05,
        planner__objective="layers",
    )
    plan = plan_layers(mesh, wanted)

    assert np.abs(np.diff(plan.height)).max() <= 0.05 + 1e-6
    assert not find_violations(mesh, certify(read_surface(mesh), plan), wanted)


@pytest.mark.parametrize("objective", ["time", "balanced", "volume", "layers"])
def test_empty_air_gets_few_layers(objective: str) -> None:
    """Between a box and one that floats 20 mm over it nothing is printed."""
    low, high = box((10, 10, 2)), box((10, 10, 2))
    mesh = Mesh(np.concatenate([low.triangles, np.add(high.triangles, [0, 0, 22.4])]), "part")
    plan = plan_layers(mesh, optimal(tolerance=0.12, planner__objective=objective))
    between = (plan.bottom >= 2 - 1e-6) & (plan.top <= 22.4 + 1e-6)

    assert between.sum() == np.ceil(20.4 / 0.32)


def test_a_range_that_begins_in_a_first_layer_that_is_set_names_that_layer() -> None:
    stretch = HeightRange(low=0, high=1, layer_height=0.1)
    found = causes(box((9, 9, 5)), optimal(first_layer_height=0.2, planner__ranges=(stretch,)))

    assert found == {("range height", "the first layer is set to 0.2 mm")}


def test_a_flat_just_over_a_first_layer_that_is_set_names_that_layer() -> None:
    found = causes(step_pyramid([30, 10], [0.25, 3.0]), optimal(first_layer_height=0.2, tolerance=0.3))

    assert found == {
        ("flat", "the flat is less than the printer's thinnest layer, 0.08 mm, away from the first layer")
    }


def roof(ledge: float) -> Mesh:
    """A shallow roof of two slopes with a level ledge between them, as a file of 32-bit numbers has it."""
    mesh = frusta([40, 34, 26, 12], [ledge, 1e-9, 0.6])
    return Mesh(mesh.triangles.astype(np.float32).astype(np.float64), "roof")


@pytest.mark.parametrize("ledge", [0.75, 0.76, 0.87, 0.94, 1.05])
def test_the_dust_of_files_does_not_decide_against_a_flat(ledge: float) -> None:
    """A first layer breaks the tolerance whatever comes after it; the flat can be met all the same."""
    wanted = optimal(tolerance=0.05, first_layer_height=0.2, layer_heights=(0.1, 0.2, 0.3), min_layer=0.1)
    mesh = roof(ledge)
    plan = plan_layers(mesh, wanted)

    assert (bound(mesh, plan)[0] > 0.05) == (bound(mesh, plan).max() > 0.05)
    assert np.abs(plan.top - ledge).min() <= 0.00125 + 1e-6


def test_more_layers_than_memory_holds_are_refused_with_a_remedy() -> None:
    wanted = optimal(z_step=0.0005, layer_step=0.0005, bed_z=300)
    tall = Mesh(sphere(4).triangles * [1, 1, 249 / sphere(4).height], "tall")

    with pytest.raises(PlanError, match="layer heights are too many to search") as refused:
        plan_layers(tall, wanted)
    assert "layer_step" in (refused.value.remedy or "")
