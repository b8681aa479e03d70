"""Run all stages of the slicer, from a mesh to the moves of the print.

Mesh -> LayerPlan -> Sections -> Walls -> Regions -> Toolpaths -> Travels -> Program -> G-code.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from types import NoneType
from typing import TYPE_CHECKING, Final, NamedTuple, TypeAlias, Unpack

import numpy as np

from printer_slicer.adhesion import add_adhesion, place_on_raft
from printer_slicer.arguments import check_argument, check_arguments
from printer_slicer.errors import UsageError
from printer_slicer.extrusion import cool, make_moves
from printer_slicer.healing import repair, require_no_repair
from printer_slicer.labelling import SupportOwners, label_moves
from printer_slicer.model import (
    ContourDeviations,
    LayerPlan,
    Mesh,
    ObjectStack,
    Overhangs,
    Program,
    Regions,
    Repairs,
    Sections,
    Supports,
    Toolpaths,
    Volumes,
    Walls,
    stack_sections,
)
from printer_slicer.object_plans import Plans, list_stack_plans, make_stacks
from printer_slicer.object_supports import (
    ObjectOverhangs,
    find_object_overhangs,
    has_supports,
    make_object_supports,
)
from printer_slicer.objects import cut_objects, make_object_paths, split_objects
from printer_slicer.ordering import apply_spiral_settings, order
from printer_slicer.perimeters import lay_walls
from printer_slicer.placing import IN_THE_MIDDLE, Placement, place
from printer_slicer.profile import Profile, profile_with
from printer_slicer.profile.planners import UniformPlanner
from printer_slicer.progress import Report, quiet
from printer_slicer.regions import classify
from printer_slicer.roles import roles_with
from printer_slicer.slicing import list_section_repairs
from printer_slicer.stages import SliceOptions, Stages, check_part
from printer_slicer.strategies import BUILT_IN, Strategies, run_program_functions
from printer_slicer.time_budget import choose_plan, choose_stacks
from printer_slicer.travels import travel
from printer_slicer.values import replace

if TYPE_CHECKING:
    from printer_slicer.feature_layers import FeatureLayers
    from printer_slicer.modifiers import Modifier
    from printer_slicer.perimeters.known_walls import KnownWalls

__all__ = [
    "overhangs",
    "plan_objects",
    "plan_part",
    "slice_for_output",
    "slice_part",
    "slice_planned",
    "slice_stages",
]


_MAX_CHANGES: Final = 2  # of layers that break the tolerance

_Stages: TypeAlias = tuple[Sections, Walls, Regions, list[ObjectOverhangs], Supports | None]


@check_arguments(placement=Placement, strategies=Strategies, volumes=(Volumes, NoneType))
def slice_stages(  # noqa: PLR0913 - all options have defaults
    mesh: Mesh,
    profile: Profile,
    *,
    plan: Plans | None = None,
    placement: Placement = IN_THE_MIDDLE,
    report: Report = quiet,
    strict: bool = False,
    strict_supports: bool = False,
    strategies: Strategies = BUILT_IN,
    volumes: Volumes | None = None,
) -> Stages:
    """Slice a part and keep the result of each stage.

    Args:
        mesh: the part, anywhere; it is repaired and placed.
        profile: printer, material and quality.
        plan: the layer plan, or one for each object, or the stacks of features; default: the profile's planner makes
            it.
        placement: position of the part; default: the middle of the bed.
        report: called with the name of each stage when it starts.
        strict: raise an error if the mesh needs repair.
        strict_supports: raise an error if a piece of the part begins in the air without a support.
        strategies: user functions that replace built-in ones.
        volumes: support enforcers and blockers and negative volumes, in the coordinates of `mesh`; they are added to
            those of the mesh.

    Raises:
        UsageError: `mesh` is not a Mesh, `profile` is not a Profile, or there are not as many plans as objects.
        PartError: the part does not fit, cannot be repaired, or cannot be divided into layers.
        StrategyError: a user's function returned an invalid value.
    """
    check_argument("mesh", mesh, Mesh)
    meshes = [mesh.with_volumes(volumes)]
    run = partial(_slice, strict=strict, strict_supports=strict_supports)
    return run(meshes, profile, placement, report, strategies, plan=plan)


def slice_for_output(  # noqa: PLR0913 - all options have defaults
    meshes: list[Mesh],
    profile: Profile,
    *,
    placement: Placement = IN_THE_MIDDLE,
    report: Report = quiet,
    strict: bool = False,
    strict_supports: bool = False,
    strategies: Strategies = BUILT_IN,
) -> Stages:
    """Slice a part to write its G-code; memory of finished stages is released.

    The walls of the result have no paths, its regions no areas, and its toolpaths are only skirt and brim.

    Args:
        meshes: the part as the only item; it is removed from the list, so that its memory can be released.
        profile: printer, material and quality.
        placement: position of the part.
        report: called with the name of each stage when it starts.
        strict: raise an error if the mesh needs repair.
        strict_supports: raise an error if a piece of the part begins in the air without a support.
        strategies: user functions that replace built-in ones.

    Raises:
        PrinterSlicerError: as `slice_stages`.
    """
    run = partial(_slice, strict=strict, strict_supports=strict_supports)
    return run(meshes, profile, placement, report, strategies, keep=False)


def _slice(  # noqa: PLR0913 - arguments of `slice_stages`
    meshes: list[Mesh],
    profile: Profile,
    placement: Placement,
    report: Report,
    strategies: Strategies,
    *,
    plan: Plans | None = None,
    strict: bool = False,
    strict_supports: bool = False,
    keep: bool = True,
) -> Stages:
    """Slice the only mesh of a list, which is removed from it; other arguments are those of `slice_planned`."""
    mesh = meshes.pop()
    check_part(mesh, profile)
    report("repairing")
    repaired, repairs = repair(mesh)
    if strict:
        require_no_repair(mesh.name, repairs)
    report("placing")
    part = place(repaired, profile.printer, placement)
    shift = repaired.bounds[0] - part.bounds[0]
    del mesh, repaired  # free memory: millions of facets take hundreds of megabytes
    report("planning")
    stacks = plan_objects(part, profile, strategies) if plan is None else make_stacks(part, plan)
    if profile.quality.z_contouring:
        from printer_slicer.contouring import add_contour_rule  # noqa: PLC0415 - off by default

        stacks = tuple(replace(one, plan=add_contour_rule(one.plan, profile)) for one in stacks)
    stages = slice_planned(part, list_stack_plans(stacks), profile, report, strategies, keep=keep)
    repairs = replace(repairs, done=(*repairs.done, *list_section_repairs(stages.sections, shift)))
    if strict:
        require_no_repair(part.name, repairs)
    if strict_supports:
        from printer_slicer.supports.unsupported_islands import require_supported_islands  # noqa: PLC0415 - only on request

        require_supported_islands(part.name, stages.overhangs, stages.supports, shift)
    if len(stacks) > 1:
        made = zip(stacks, stages.stacks, strict=True)
        stages = replace(
            stages, stacks=tuple(replace(one, plan=two.plan, contours=two.contours) for one, two in made)
        )
    return replace(stages, repairs=repairs, shift=shift)


def slice_planned(  # noqa: PLR0913 - all options have defaults
    part: Mesh,
    plan: Plans,
    profile: Profile,
    report: Report = quiet,
    strategies: Strategies = BUILT_IN,
    *,
    keep: bool = True,
    trial: bool = False,
) -> Stages:
    """Slice a placed part with a given layer plan; arguments and errors are those of `slice_stages`.

    Without `keep`, paths and areas are released as soon as the next stage has used them, see `slice_for_output`. A
    `trial` only needs the moves, so overhangs are not searched for in objects without supports.
    """
    if profile.quality.print_order == "by_object" and len(part.objects) > 1:
        run = partial(slice_planned, report=report, strategies=strategies, keep=keep, trial=trial)
        return _slice_one_by_one(part, plan, profile, run)
    profile = apply_spiral_settings(profile)
    made = _make_ordered_paths(_Task(part, profile, report, strategies, keep, trial), plan)
    (solid, walls, regions, found, supports), profiles = made.stages, made.profiles
    toolpaths, printed, stacks = made.toolpaths, made.printed, made.stacks
    del made  # free memory: toolpaths are replaced
    if profile.quality.arc_tolerance:
        from printer_slicer.curves import fit_arcs  # noqa: PLC0415 - few profiles allow arcs

        toolpaths = fit_arcs(toolpaths, profile)
    report("travels")
    travels = travel(toolpaths, printed, profile)
    report("extrusion")
    limits_link = profile.printer.link_lines_per_second > 0
    moves, link = make_moves(toolpaths, travels, profile, profiles), None
    if not (keep or limits_link):
        toolpaths = _select_adhesion(toolpaths)  # free memory: the moves are timed without their paths
    program = cool(moves, profile)
    del moves
    if limits_link:
        from printer_slicer.link_limiter import limit_link  # noqa: PLC0415 - few profiles limit the link

        toolpaths, travels, program, link = limit_link(
            (toolpaths, travels, program), printed, profile, profiles
        )
        toolpaths = toolpaths if keep else _select_adhesion(toolpaths)
    program = run_program_functions(program, strategies.on_program, len(profile.extruders))
    labels = label_moves(program, part, solid.plan, _find_owners(supports, found, part))
    made_later = toolpaths, travels, program, link, labels, Repairs(), *_join_overhangs(found)
    return Stages(part, solid, walls, regions, *made_later, supports, stacks=stacks)


class _Task(NamedTuple):
    """The arguments of `slice_planned` except for the plan, which may change."""

    part: Mesh
    profile: Profile
    report: Report
    strategies: Strategies
    keep: bool
    trial: bool


class _OrderedPaths(NamedTuple):
    """The results of the stages up to the printing order.

    Attributes:
        stages: sections, walls, regions, overhangs and supports.
        profiles: the profiles to which the paths refer.
        printed: the sections of all printed layers.
        toolpaths: the paths in printing order.
        stacks: the stacks of layers, with the deviations of contoured tops.
    """

    stages: _Stages
    profiles: list[Profile]
    printed: Sections
    toolpaths: Toolpaths
    stacks: tuple[ObjectStack, ...]


def _make_ordered_paths(task: _Task, plan: Plans) -> _OrderedPaths:
    """Run the stages up to the printing order.

    Where contoured tops break the tolerance of the planner, layers are changed, and their paths are made once more.
    """
    quality = task.profile.quality
    if not quality.z_contouring or isinstance(quality.planner, UniformPlanner):
        return _make_paths_in_order(task, plan)
    from printer_slicer.perimeters.known_walls import KnownWalls  # noqa: PLC0415 - off by default
    from printer_slicer.planning.inexact_layers import change_inexact_layers  # noqa: PLC0415 - off by default

    known = KnownWalls()
    for _ in range(_MAX_CHANGES):
        made = _make_paths_in_order(task, plan, known)
        changed = change_inexact_layers(made.stacks, task.profile)
        if changed is None:
            return made
        plan = list_stack_plans(changed)
        del made  # free memory
    return _make_paths_in_order(task, plan, known)


def _make_paths_in_order(task: _Task, plan: Plans, known: KnownWalls | None = None) -> _OrderedPaths:
    """Make the paths of a plan in printing order; `known` are the walls of a similar plan."""
    made, paths, profiles = _make_paths(task, plan, known)
    part, profile = task.part, task.profile
    task.report("ordering")
    solid, supports = made[0], made[-1]
    printed = _stand_on_raft(paths, (solid, supports), profile)
    toolpaths, contours = _order(paths, solid, printed, part, profile)
    lift = float(printed.plan.top[-1] - solid.plan.top[-1])
    stacks = _list_printed_stacks(part, solid.plan if isinstance(plan, LayerPlan) else plan, contours, lift)
    return _OrderedPaths(made, profiles, printed, toolpaths, stacks)


def _list_printed_stacks(
    part: Mesh, plan: Plans, contours: ContourDeviations | None, lift: float
) -> tuple[ObjectStack, ...]:
    """Return the stacks of a part that is raised by `lift`, mm, with the deviations of its contoured tops."""
    stacks = make_stacks(part, plan)
    if contours is None:
        return stacks
    return tuple(replace(one, contours=contours.select_layers(one.plan.top + lift)) for one in stacks)


def _order(
    paths: list[Toolpaths], solid: Sections, printed: Sections, part: Mesh, profile: Profile
) -> tuple[Toolpaths, ContourDeviations | None]:
    """Return the only paths of a list in printing order, which are removed from it, with contoured tops if asked for.

    The deviations of these follow.

    Args:
        paths: the paths.
        solid: the sections of the part.
        printed: the sections of all printed layers.
        part: its surface.
        profile: order, seams and rule of contouring.
    """
    if not profile.quality.z_contouring:
        return order(paths.pop(), printed, profile), None
    from printer_slicer.contouring import (  # noqa: PLC0415 - off by default
        contour,
        find_contoured_paths,
        find_facet_bins,
        make_contour_rule,
        measure_deviations,
    )

    rule = solid.plan.contour_rule or make_contour_rule(profile)
    lift = float(printed.plan.top[-1] - solid.plan.top[-1])
    bins = find_facet_bins(part, printed.plan, rule, lift) if rule else None
    if rule is None or bins is None:
        return order(paths.pop(), printed, profile), None
    is_contoured = find_contoured_paths(paths[0], bins)
    toolpaths = contour(order(paths.pop(), printed, profile, is_contoured), bins, printed, rule)
    return toolpaths, measure_deviations(toolpaths, bins, printed, rule, part)


def _slice_one_by_one(part: Mesh, plan: Plans, profile: Profile, run: Callable[..., Stages]) -> Stages:
    """Slice each object of a part with a function, and join them so that they are printed one after the other."""
    from printer_slicer.sequential import join_stages, split_for_sequence  # noqa: PLC0415 - few plates need it

    made = [run(*one) for one in split_for_sequence(part, plan, profile)]
    stages, stacks = join_stages(part, made, profile), make_stacks(part, plan)
    if profile.quality.z_contouring:
        from printer_slicer.contouring import join_contours  # noqa: PLC0415 - off by default

        own = [one.stacks[0] for one in made]
        stacks = tuple(join_contours(one, [own[index] for index in one.objects]) for one in stacks)
    return replace(stages, stacks=stacks)


def _select_adhesion(paths: Toolpaths) -> Toolpaths:
    """Return the paths that do not belong to the part."""
    return paths.take(np.flatnonzero(roles_with(is_part=False)[paths.role]))


def _find_owners(
    supports: Supports | None, found: Sequence[ObjectOverhangs], part: Mesh
) -> SupportOwners | None:
    """Return the object of each support; None without supports, or if there is only one object."""
    if supports is None or len(part.objects) < 2:
        return None
    from printer_slicer.support_owners import find_support_owners  # noqa: PLC0415 - most parts need no labels

    carried = [one.overhangs for one in found if has_supports(one.profile) and one.overhangs.area.n_rings]
    return find_support_owners(supports, Overhangs.joined(carried), part)


def _join_overhangs(found: Sequence[ObjectOverhangs]) -> tuple[Overhangs | None, Overhangs | None]:
    """Return what hangs in all objects, and in those without supports; None if there are no such objects."""
    without = [one for one in found if not has_supports(one.profile)]
    every, bare = (
        Overhangs.joined([one.overhangs for one in some]) if some else None for some in (found, without)
    )
    return every, bare


def _stand_on_raft(
    paths: list[Toolpaths], made: tuple[Sections, Supports | None], profile: Profile
) -> Sections:
    """Join all paths with those of skirt, brim and raft, in place, and return the sections on all printed layers."""
    solid, supports = made
    if supports is None:
        printed = place_on_raft(solid, profile)
        paths[:] = [add_adhesion(paths, solid, printed, profile)]
        return printed
    from printer_slicer.supports.stacking import add_support_areas, add_support_layers  # noqa: PLC0415

    printed = place_on_raft(add_support_layers(solid, supports), profile, supports.area)
    around = add_support_areas(printed, supports, float(printed.plan.top[-1] - solid.plan.top[-1]))
    paths[:] = [add_adhesion(paths, solid, printed, profile, around)]
    return printed


def _make_paths(
    task: _Task, plan: Plans, known: KnownWalls | None
) -> tuple[_Stages, list[Toolpaths], list[Profile]]:
    """Run the stages up to the paths of all objects; return also the profiles to which the paths refer."""
    part, profile, report = task.part, task.profile, task.report
    features = _list_feature_layers(plan)
    meshes, sections, own = _cut(part, plan, features, profile, report)
    report("perimeters")
    walls = known.lay(sections, own) if known else list(map(lay_walls, sections, own))
    if known and len(sections) == 1:
        from printer_slicer.inexact_walls import change_inexact_walls  # noqa: PLC0415 - off by default

        sections[0], walls[0] = change_inexact_walls(meshes[0], sections[0], walls[0], own[0], known)
    report("regions")
    regions = _classify(meshes, sections, walls, own)
    modifiers = _cut_modifiers(meshes, sections, profile, own)
    seen = 1 if features and not features[0].outline else len(meshes)  # the first has all features
    found = find_object_overhangs(
        meshes[:seen],
        sections[:seen],
        regions[:seen],
        own[:seen],
        modifiers[:seen],
        only_supported=task.trial,
    )
    supports, support_paths = make_object_supports(found, sections, regions, report)
    regions, modified = _divide_by_modifiers(regions, sections, walls, modifiers)
    report("toolpaths")
    paths, profiles = make_object_paths(
        part.name, (sections, walls, regions), own, profile, task.strategies.custom_infill, modified
    )
    if features:
        from printer_slicer.feature_layers import select_printed_layers  # noqa: PLC0415 - off by default

        sections, walls, regions, paths = select_printed_layers(features, (sections, walls, regions), paths)
    regions = [*regions, *(inside for several in modified for inside, _ in several)]
    if not task.keep:
        walls = [one.without_paths() for one in walls]
        regions = [one.of_layers(np.zeros(one.plan.n_layers, np.bool_)) for one in regions]
    made = (
        stack_sections(sections),
        Walls.joined(walls),
        Regions.joined(regions),
        found,
        supports,
    )
    return made, [*paths, *support_paths], profiles


def _list_feature_layers(plan: Plans) -> list[FeatureLayers]:
    """Return the layers of the part and of each feature; an empty list if the plans are not those of features."""
    if isinstance(plan, LayerPlan) or isinstance(plan[0], LayerPlan):
        return []
    from printer_slicer.feature_layers import list_feature_layers  # noqa: PLC0415 - off by default

    return list_feature_layers(plan)


def _cut(
    part: Mesh, plan: Plans, features: list[FeatureLayers], profile: Profile, report: Report
) -> tuple[list[Mesh], list[Sections], list[Profile]]:
    """Return the mesh, the sections and the profile of each object, or of the part and of each feature."""
    if features:
        from printer_slicer.feature_layers import cut_features  # noqa: PLC0415 - off by default

        [_], _, [mine] = split_objects(part, features[0].plan, profile)
        report("slicing")
        n = len(features)
        return [part] * n, cut_features(part, features, mine), [mine] * n
    meshes, plans, own = split_objects(part, plan, profile)
    report("slicing")
    return meshes, cut_objects(meshes, plans, own), own


def _classify(
    meshes: list[Mesh], sections: list[Sections], walls: list[Walls], own: list[Profile]
) -> list[Regions]:
    """Return the regions of each object; the rows of contoured tops follow its surface."""
    regions = list(map(classify, sections, walls, own))
    if not any(one.plan.contour_rule for one in sections):
        return regions
    from printer_slicer.contouring import direct_top_rows  # noqa: PLC0415 - off by default

    return list(map(direct_top_rows, regions, meshes))


def _cut_modifiers(
    meshes: Sequence[Mesh], sections: Sequence[Sections], profile: Profile, own: Sequence[Profile]
) -> list[list[Modifier]]:
    """Return the modifiers of each object."""
    if not any(mesh.volumes and mesh.volumes.modifiers for mesh in meshes):
        return [[] for _ in meshes]
    from printer_slicer.modifiers import cut_modifiers  # noqa: PLC0415 - few parts have modifiers

    rows = zip(meshes, sections, own, strict=True)
    return [cut_modifiers(mesh, solid, profile, one) for mesh, solid, one in rows]


def _divide_by_modifiers(
    regions: list[Regions],
    sections: Sequence[Sections],
    walls: Sequence[Walls],
    modifiers: Sequence[Sequence[Modifier]],
) -> tuple[list[Regions], list[list[tuple[Regions, Profile]]]]:
    """Return the regions of each object outside its modifiers, and those inside each of them with their profiles."""
    if not any(modifiers):
        return regions, [[] for _ in regions]
    from printer_slicer.modifiers import divide_regions  # noqa: PLC0415 - few parts have modifiers

    outside, inside = [], []
    for area, solid, wall, several in zip(regions, sections, walls, modifiers, strict=True):
        rest, own = divide_regions(area, solid, wall, several)
        outside.append(rest)
        inside.append([(one, modifier.profile) for one, modifier in zip(own, several, strict=True)])
    return outside, inside


@check_arguments(mesh=Mesh, profile=Profile, placement=Placement, volumes=(Volumes, NoneType))
def overhangs(
    mesh: Mesh,
    profile: Profile,
    *,
    plan: Plans | None = None,
    placement: Placement = IN_THE_MIDDLE,
    volumes: Volumes | None = None,
) -> Overhangs:
    """Find the areas of a part that need supports, without slicing it completely.

    Args:
        mesh: the part, anywhere; it is repaired and placed.
        profile: printer, material and quality; `quality.support_threshold_deg`, `support_max_bridge`,
            `support_min_area` and `support_min_reach` decide what needs supports. `quality.support` has no effect.
        plan: the layer plan, or one for each object; default: the profile's planner makes it.
        placement: position of the part; default: the middle of the bed.
        volumes: support enforcers and blockers, in the coordinates of `mesh`; they are added to those of the mesh.

    Raises:
        UsageError: `mesh` is not a Mesh, `profile` is not a Profile, or there are not as many plans as objects.
        PartError: the part does not fit, cannot be repaired, or cannot be divided into layers.
    """
    check_part(mesh, profile)
    part = place(repair(mesh.with_volumes(volumes))[0], profile.printer, placement)
    if plan is None:
        stacks = plan_objects(part, profile)
        plan = plan_part(part, profile) if stacks[0].whole_plan else list_stack_plans(stacks)
    if profile.quality.support == "off":  # volumes count only if there are supports
        profile = profile_with(profile, {"quality.support": "columns"})
    meshes, sections, own = _cut(part, plan, [], apply_spiral_settings(profile), quiet)
    regions = [classify(one, lay_walls(one, mine), mine) for one, mine in zip(sections, own, strict=True)]
    modifiers = _cut_modifiers(meshes, sections, profile, own)
    found = find_object_overhangs(meshes, sections, regions, own, modifiers, always_steer=True)
    return Overhangs.joined([one.overhangs for one in found])


@check_arguments(part=Mesh, profile=Profile, strategies=Strategies)
def plan_part(part: Mesh, profile: Profile, strategies: Strategies = BUILT_IN) -> LayerPlan:
    """Plan layers for a placed part within the time budget; arguments and errors are those of `slice_stages`.

    All objects have the same layers, whatever `quality.planner.stacks` is.
    """
    return choose_plan(part, profile, strategies, partial(slice_planned, keep=False, trial=True))


@check_arguments(part=Mesh, profile=Profile, strategies=Strategies)
def plan_objects(part: Mesh, profile: Profile, strategies: Strategies = BUILT_IN) -> tuple[ObjectStack, ...]:
    """Plan the layers of the objects of a placed part within the time budget.

    With `quality.planner.stacks = one` there is one stack for all objects. Arguments and errors are those of
    `slice_stages`.
    """
    return choose_stacks(part, profile, strategies, partial(slice_planned, keep=False, trial=True))


def slice_part(mesh: Mesh, profile: Profile, **options: Unpack[SliceOptions]) -> Program:
    """Slice a part and return its moves; arguments and errors are those of `slice_stages`."""
    if unknown := options.keys() - SliceOptions.__annotations__.keys():
        raise UsageError(
            f"{min(unknown)}: slice_part has no such argument",
            remedy=f"Use one of {', '.join(SliceOptions.__annotations__)}; settings belong to the profile",
        )
    return slice_stages(mesh, profile, **options).program
