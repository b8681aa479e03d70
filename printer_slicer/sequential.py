"""Join the stages of objects that are printed one after the other (`quality.print_order = by_object`)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Final

import numpy as np

from printer_slicer.adhesion.loops import loop_paths
from printer_slicer.adhesion.skirt import skirt_paths
from printer_slicer.arrays import Bool, Float, distinct
from printer_slicer.errors import PartError
from printer_slicer.extrusion import extrude
from printer_slicer.geometry import convex_hull, offset
from printer_slicer.labelling import make_unique_names
from printer_slicer.model import (
    Labels,
    LayerPlan,
    Mesh,
    Overhangs,
    Program,
    Regions,
    Sections,
    SupportPlan,
    Supports,
    Toolpaths,
    Travels,
    Walls,
    stack_sections,
)
from printer_slicer.object_plans import Plans
from printer_slicer.objects import separate_objects
from printer_slicer.ordering import order
from printer_slicer.profile import Profile, profile_with
from printer_slicer.roles import Role
from printer_slicer.sequencing import (
    find_print_order,
    join_plans,
    join_programs,
    measure_extent,
)
from printer_slicer.stages import Stages
from printer_slicer.travels import travel
from printer_slicer.values import replace

if TYPE_CHECKING:
    from printer_slicer.link_limiter import LinkReport

__all__ = ["join_stages", "split_for_sequence"]

_WITHOUT_SKIRT: Final = {"quality.skirt_loops": 0, "quality.print_order": "by_layer"}


def split_for_sequence(part: Mesh, plan: Plans, profile: Profile) -> list[tuple[Mesh, LayerPlan, Profile]]:
    """Return each object with its layers and with its profile, which has no skirt.

    Raises:
        PartError: a repair mixed the facets of the objects.
        UsageError: an override names no object, or the number of plans is not that of the objects.
    """
    if not all(item.count for item in part.objects):
        raise PartError(
            f"{part.name}: the mesh needs repair, and after that it is unknown which facets belong to which object, so "
            "the objects cannot be printed one after the other",
            remedy="Repair the mesh file first, or set print_order = by_layer",
        )
    meshes, plans, profiles = separate_objects(part, plan, profile)
    own = [profile_with(one, _WITHOUT_SKIRT) for one in profiles]
    return [(mesh, _cut_off(one, mesh), mine) for mesh, one, mine in zip(meshes, plans, own, strict=True)]


def _cut_off(plan: LayerPlan, mesh: Mesh) -> LayerPlan:
    """Return a plan without the layers above an object."""
    n = int(np.searchsorted(plan.bottom, float(mesh.bounds[1, 2]) - 1e-6))
    if not 0 < n < plan.n_layers:
        return plan
    return LayerPlan(plan.top[:n], plan.cut[:n], plan.planner, plan.containment, plan.base[:n])


def join_stages(part: Mesh, stages: Sequence[Stages], profile: Profile) -> Stages:
    """Join the stages of all objects of a part, in an order in which the print head touches no finished object.

    Sections, walls and regions are those of all objects together. Toolpaths, travels and program are in printing order;
    the layers of their plan ascend within each object.

    Args:
        part: the part, with its objects.
        stages: of each object.
        profile: settings of the whole plate.

    Raises:
        PartError: there is no such order.
    """
    names = make_unique_names([item.name for item in part.objects])
    extents = [
        measure_extent(name, one.program, one.sections, one.supports)
        for name, one in zip(names, stages, strict=True)
    ]
    chosen = find_print_order(extents, profile.printer)
    ordered = [stages[index] for index in chosen]
    programs = [one.program for one in ordered]
    skirt = _make_skirt(programs, profile)
    if skirt:
        programs.insert(0, skirt[2])
    program, owner = join_programs(programs, profile, has_skirt=skirt is not None)
    objects = np.array([*([-1] if skirt else []), *chosen])[owner]
    boxes = np.array([[item.low[:2], item.high[:2]] for item in part.objects])
    labels = Labels(names, boxes, np.where(program.role == Role.TRAVEL, -1, objects))
    laid = ([skirt[0]] if skirt else []) + [one.toolpaths for one in ordered]
    ways = ([skirt[1]] if skirt else []) + [one.travels for one in ordered]
    return Stages(
        part,
        stack_sections([one.sections for one in stages]),
        Walls.joined([one.walls for one in stages]),
        Regions.joined([one.regions for one in stages]),
        _join_paths(laid),
        _join_travels(ways),
        program,
        _join_link_reports(ordered),
        labels,
        overhangs=_join_overhangs([one.overhangs for one in stages]),
        overhangs_without_supports=_join_overhangs([one.overhangs_without_supports for one in stages]),
        supports=_join_supports(stages),
    )


def _make_skirt(programs: Sequence[Program], profile: Profile) -> tuple[Toolpaths, Travels, Program] | None:
    """Return a skirt around the lowest layers of all objects; None if the profile or the bed allows none."""
    points, first = list[Float](), programs[0]
    for program in programs:
        lays = _find_lowest_extrusions(program)
        points.append(program.xyz[lays, :2])
        points.append(program.start[lays, :2])
    width = max(float(program.width[_find_lowest_extrusions(program)].max()) for program in programs)
    hull = offset(convex_hull(np.concatenate(points)), width / 2, join="round")
    around = Sections(LayerPlan.from_tops(first.plan.top[:1], first.plan.planner), hull)
    empty = loop_paths(around.plan, [], np.zeros(0, np.int64), Role.BRIM, 0.0)
    profile = profile_with(profile, {"quality.spiral": False})
    paths = order(skirt_paths(around, empty, profile), around, profile)
    if not paths.n_paths:
        return None
    ways = travel(paths, around, profile)
    return paths, ways, extrude(paths, ways, profile)


def _find_lowest_extrusions(program: Program) -> Bool:
    """Return a mask (K,) of the extrusions on the lowest layer that has any."""
    lays = program.role != Role.TRAVEL
    return np.asarray(lays & (program.layer == program.layer[lays].min()))


def _join_paths(parts: Sequence[Toolpaths]) -> Toolpaths:
    """Return the paths of all objects in printing order, on the layers of all objects one after the other."""
    plan = join_plans([one.plan for one in parts])
    first = np.cumsum([0, *(one.plan.n_layers for one in parts)]).tolist()
    moved = [
        replace(one, plan=plan, layer=one.layer + begin) for one, begin in zip(parts, first, strict=False)
    ]
    return Toolpaths.joined(plan, moved)


def _join_travels(parts: Sequence[Travels]) -> Travels:
    """Return the travels of all objects in printing order; those between objects have no waypoints."""
    counts = np.concatenate([np.diff(one.start) for one in parts])
    return Travels(
        np.concatenate([one.xy for one in parts]),
        np.append(0, np.cumsum(counts)),
        np.concatenate([one.retract for one in parts]),
        np.concatenate([one.crossings for one in parts]),
    )


def _join_link_reports(stages: Sequence[Stages]) -> LinkReport | None:
    """Return the changes for the link in all objects, with layers counted in printing order; None without any."""
    reports = [one.link for one in stages if one.link is not None]
    layers, waits, n_before = list[int](), list[int](), 0
    for one in stages:
        used = distinct(one.program.layer)
        if one.link is not None:
            for numbers, own in ((layers, one.link.layers), (waits, one.link.waits)):
                place = np.searchsorted(used, np.array(own, np.int64) - 1)
                numbers.extend((place + 1 + n_before).tolist())
        n_before += len(used)
    if not reports:
        return None
    merged, slowed = sum(one.merged for one in reports), sum(one.slowed for one in reports)
    seconds = sum(one.seconds for one in reports)
    return replace(
        reports[0], layers=tuple(layers), merged=merged, slowed=slowed, seconds=seconds, waits=tuple(waits)
    )


def _join_overhangs(parts: Sequence[Overhangs | None]) -> Overhangs | None:
    """Return the overhangs of all objects for which they are known; None if there are none."""
    known = [one for one in parts if one is not None]
    return Overhangs.joined(known) if known else None


def _join_supports(stages: Sequence[Stages]) -> Supports | None:
    """Return the supports of all objects that have some, on the union of their layers; None without any."""
    made = [(one.supports, one.sections.plan) for one in stages if one.supports is not None]
    if not made:
        return None
    layers = LayerPlan.union([supports.plan.layers for supports, _ in made])
    moved, plans = list[Supports](), list[SupportPlan]()
    for supports, _ in made:
        layer = layers.find_tops(supports.plan.layers.top)
        stacks = {
            name: getattr(supports, name).on_layers(layer, layers.n_layers)
            for name in ("base", "interface", "floor", "joists", "hollow")
        }
        carrier = supports.plan.carrier
        carried = np.where(carrier >= 0, layer[carrier], -1) if len(layer) else carrier
        plans.append(replace(supports.plan, layers=layers, carrier=carried))
        moved.append(replace(supports, plan=plans[-1], **stacks))
    return Supports.joined(SupportPlan.joined(plans, [plan for _, plan in made]), moved)
