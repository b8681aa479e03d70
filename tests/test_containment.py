"""Layers that hold everything of the part, or nothing but the part: points tried in the sections as they are cut."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from itertools import product
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
import pytest

from printer_slicer.arrays import Float
from printer_slicer.mesh_io import load_mesh
from printer_slicer.model import LayerPlan, Mesh, Sections
from printer_slicer.planning import plan_layers
from printer_slicer.slicing import cut
from printer_slicer.surface import Certificate, certify, read_surface
from tests.effort import crossed
from tests.parts import box, cone, joined, profile, pyramid, sheared_prism, sphere, step_pyramid, two_boxes
from tests.planning.plans import frusta
from tests.surface.distances import distance_to_mesh, winding, wrong_points

ROUNDING = 5e-6  # mm; contours lie on a lattice
ASIDE_BORDERS = 4.1e-5  # mm; what contained layers leave out beside both of their borders
ASIDE = 0.005  # mm; contours are simplified by 0.002 mm and moved to their side by as much, a little more at corners
SAMPLES = Path(__file__).parents[1] / "sample_parts"


def single(mesh: Mesh) -> Mesh:
    """As a binary STL file holds it."""
    return Mesh(mesh.triangles.astype(np.float32).astype(np.float64), mesh.name)


def hollow() -> Mesh:
    """A box with a ball of air inside."""
    return joined([box((8, 8, 6)), Mesh(sphere(2).moved((4, 4, 1)).triangles[:, ::-1])])


@cache
def sample(name: str) -> Mesh:
    mesh = load_mesh(SAMPLES / f"{name}.stl")
    low = mesh.bounds[0]
    return mesh.moved((-low[0], -low[1], -low[2]))


PARTS: Final[Mapping[str, Mesh]] = {
    "sphere": sphere(2.5),
    "leaning": sheared_prism(5, 4, 3),
    "slot": frusta([10, 10, 6, 6, 10, 10], [1.12, 0, 0.25, 0, 1.03]),
    "overhang": frusta([4, 4, 10, 10], [2.03, 0.4, 1.5]),
    "hollow": hollow(),
    "cone": cone(3, 4.03, 12),
    "steps": step_pyramid([10, 8, 5], [1.203, 1.151, 0.804]),
    "two boxes": two_boxes(),
    "steps as in a file": single(step_pyramid([10, 8, 5], [1.2, 1.1, 0.8])),
    "leaning as in a file": single(sheared_prism(5, 4.1, 3).moved((0.1, 0.1, 0))),
}
SAMPLE_PARTS = ("bridge", "cylinder", "thin_wall", "vase")
PLANNERS: Final[Mapping[str, dict[str, Any]]] = {
    "optimal": {},
    "uniform": {"layer_height": 0.2},
    "cusp": {},
    "area": {"planner__aligned": True},
}
each_planner = pytest.mark.parametrize("planner", PLANNERS)
each_part = pytest.mark.parametrize("name", PARTS)
SIDES = ["positive", "negative"]
one_sided = pytest.mark.parametrize("containment", SIDES)


class Tried(NamedTuple):
    """What points say about a part and its sections.

    Attributes:
        empty: mm, how far from the surface the farthest point of the part is that no section holds.
        filled: mm, the same of the points of sections that the part does not hold.
        over: mm, by how much a point is farther from the surface than certified; negative: by how much less.
        volume: mm³ in the sections.
    """

    empty: float
    filled: float
    over: float
    volume: float


def sliced(mesh: Mesh, planner: str, containment: str, **changes: Any) -> tuple[LayerPlan, Sections]:
    usual: dict[str, Any] = {"z_step": 0.01, "first_layer_height": 0}
    wanted = profile(
        **(usual | {"planner__kind": planner, "containment": containment} | PLANNERS[planner] | changes)
    )
    plan = plan_layers(mesh, wanted)
    return plan, cut(mesh, plan, wanted.quality.resolution)


def tried(mesh: Mesh, sections: Sections, n: int = 500) -> Tried:
    points, layer = wrong_points(mesh, sections, n, np.random.default_rng(1))
    held = winding(points, mesh, points[:, 2], points[:, 2])[0] > 0
    distance = distance_to_mesh(points, mesh, 1.0)
    certificate = certify(read_surface(mesh), sections.plan)
    bound = np.append(certificate.bound, certificate.missing)[layer]
    volume = float((sections.solid.area() * sections.plan.height).sum())
    return Tried(
        float(distance[held].max(initial=0)),
        float(distance[~held].max(initial=0)),
        float((distance - bound).max(initial=-1)),
        volume,
    )


@pytest.mark.parametrize(("name", "how"), crossed(PARTS, list(product(PLANNERS, SIDES))))
def test_nothing_lies_on_the_wrong_side(name: str, how: tuple[str, str]) -> None:
    planner, containment = how
    mesh = PARTS[name]
    plan, sections = sliced(mesh, planner, containment)
    found = tried(mesh, sections)

    assert plan.containment == containment
    if containment == "positive":
        assert found.empty <= ROUNDING
        assert found.volume >= mesh.volume - 1e-6
    else:
        assert found.filled <= ROUNDING
        assert found.volume <= mesh.volume + 1e-6
    assert found.over <= ASIDE


@pytest.mark.parametrize(("name", "containment"), crossed(SAMPLE_PARTS, SIDES))
def test_nothing_of_the_sample_parts_lies_on_the_wrong_side(name: str, containment: str) -> None:
    mesh = sample(name)
    _, sections = sliced(mesh, "optimal", containment, tolerance=0.2)
    found = tried(mesh, sections, 300)

    assert (found.empty if containment == "positive" else found.filled) <= ROUNDING
    assert (found.volume - mesh.volume) * (1 if containment == "positive" else -1) >= -1e-6
    assert found.over <= ASIDE


@pytest.mark.parametrize(("name", "planner"), crossed(PARTS, PLANNERS))
def test_layers_cut_in_the_middle_are_wrong_on_both_sides_within_the_bound(name: str, planner: str) -> None:
    mesh = PARTS[name]
    plan, sections = sliced(mesh, planner, "mid", resolution=0)

    assert plan.containment == "mid"
    assert tried(mesh, sections).over <= ROUNDING


@each_part
def test_contained_volumes_lie_around_that_of_the_middle(name: str) -> None:
    mesh, volumes = PARTS[name], {}
    for containment in ("negative", "mid", "positive"):
        plan, _ = sliced(mesh, "uniform", containment)
        plan = LayerPlan(plan.top, plan.cut, "", containment)
        volumes[containment] = float((cut(mesh, plan, 0.0).solid.area() * plan.height).sum())

    assert volumes["negative"] <= volumes["mid"] + 1e-6
    assert volumes["mid"] <= volumes["positive"] + 1e-6


@pytest.mark.parametrize(("name", "containment"), crossed(PARTS, SIDES))
def test_the_optimal_plan_keeps_the_tolerance_contained(name: str, containment: str) -> None:
    mesh = PARTS[name]
    plan, sections = sliced(mesh, "optimal", containment, tolerance=0.11)

    assert proven(mesh, plan).ranges_above(0.11) == []
    found = tried(mesh, sections)
    assert max(found.empty, found.filled) <= 0.11 + ASIDE


def proven(mesh: Mesh, plan: LayerPlan) -> Certificate:
    return certify(read_surface(mesh), plan)


def simple() -> Mapping[str, Mesh]:
    """Parts of which nothing is wrong in layers of 0.1 mm, whatever they hold."""
    return {"box": box((9, 9, 2)), "steps": step_pyramid([10, 8, 5], [0.3, 0.4, 0.3])}


@pytest.mark.parametrize("name", simple())
@one_sided
def test_nothing_is_said_to_be_wrong_where_layers_end_on_all_flats(name: str, containment: str) -> None:
    mesh = simple()[name]
    plan, sections = sliced(mesh, "uniform", containment, layer_height=0.1)
    assert tried(mesh, sections).over <= ASIDE

    assert proven(mesh, plan).max_error <= ASIDE_BORDERS


@one_sided
def test_the_bed_is_no_error_of_the_first_layer(containment: str) -> None:
    """The usual first layer of 0.2 mm on a cone is off by 0.09 mm at most: far from the tolerance of 0.12 mm."""
    mesh = cone(3, 6, 24)
    plan, sections = sliced(mesh, "optimal", containment, first_layer_height=0.2, tolerance=0.12)
    found = tried(mesh, sections)
    assert max(found.empty, found.filled) <= 0.12

    assert proven(mesh, plan).ranges_above(0.12) == []


@pytest.mark.parametrize("name", simple())
@one_sided
def test_the_rounding_of_files_makes_no_volume_of_error(name: str, containment: str) -> None:
    """Levels such as 0.3 mm are a little off in 32 bits; the sections leave that out."""
    mesh = simple()[name]
    plan, _ = sliced(mesh, "uniform", containment, layer_height=0.1)
    exact, rounded = (proven(one, plan).volume_error for one in (mesh, single(mesh)))

    assert rounded == pytest.approx(exact, abs=0.01)


@pytest.mark.parametrize("level", [2.1, 2.2, 2.3])
@one_sided
def test_the_rounding_of_files_does_not_break_the_tolerance(level: float, containment: str) -> None:
    """A slope up to a level, walls above it."""
    exact = frusta([20, 16, 16], [level, 2.2])
    for mesh in (exact, single(exact)):
        plan, _ = sliced(mesh, "optimal", containment, tolerance=0.12, planner__objective="layers")
        assert proven(mesh, plan).ranges_above(0.12) == []


def section_areas(mesh: Mesh, plan: LayerPlan) -> Float:
    return np.asarray(cut(mesh, plan, 0.0).solid.area())


@pytest.mark.parametrize("foot", ["box", "pyramid"])
@one_sided
def test_bodies_that_overlap_count_as_one(foot: str, containment: str) -> None:
    """A tower of 4 mm stands through a lower body, whose top lies within a layer: the tower has no gap there."""
    low = {"box": box((10, 10, 2.55)), "pyramid": pyramid(8, 2.55).moved((5, 5, 0))}[foot]
    mesh = joined([low, box((4, 4, 6), (3, 3, 0))])
    tops = np.linspace(0.2, 6, 30)
    areas = section_areas(mesh, LayerPlan(tops, tops - 0.1, "", containment))

    assert areas.min() == pytest.approx(16, abs=0.1)


@one_sided
def test_a_plate_thinner_than_a_layer_is_kept_whole_or_left_out(containment: str) -> None:
    mesh = frusta([4, 4, 10, 10, 4, 4], [1.05, 0, 0.08, 0, 0.87])
    tops = np.linspace(0.2, 2, 10)
    areas = section_areas(mesh, LayerPlan(tops, tops - 0.1, "", containment))

    assert areas[5] == pytest.approx(100 if containment == "positive" else 16, abs=0.2)
    assert np.delete(areas, 5) == pytest.approx(16, abs=0.2)


def test_the_top_is_covered_or_not_passed_as_the_part_is_contained() -> None:
    for height in (3.0, 3.004, 3.0061, 3.0099):
        mesh = pyramid(8, height)
        for planner in PLANNERS:
            assert sliced(mesh, planner, "positive")[0].top[-1] >= height - 1e-4
            assert sliced(mesh, planner, "negative")[0].top[-1] <= height + 1e-4
