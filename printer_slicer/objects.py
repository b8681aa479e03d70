"""Slice objects that have their own settings or layer plans; an overlap belongs to the first object."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from printer_slicer.arrays import Int
from printer_slicer.combine_perimeters import combine_perimeters
from printer_slicer.compensation import compensate
from printer_slicer.errors import PartError, UsageError
from printer_slicer.geometry import difference, intersection, union
from printer_slicer.infill import Infill, infill_paths
from printer_slicer.layer_settings import LayerSettings, resolve_layer_settings
from printer_slicer.model import LayerPlan, Mesh, PlateObject, Regions, Sections, Toolpaths, Walls
from printer_slicer.object_plans import Plans, extract_objects, list_plans, number_plans
from printer_slicer.overhang_grades import grade_overhangs
from printer_slicer.profile import Profile
from printer_slicer.profile.object_profiles import (
    list_overridden_objects,
    list_support_styles,
    make_profile_for_object,
)
from printer_slicer.slicing import cut
from printer_slicer.texts import find_similar_words
from printer_slicer.values import replace

__all__ = ["cut_objects", "list_overridable_names", "make_object_paths", "separate_objects", "split_objects"]


_Groups = tuple[list[Mesh], list[LayerPlan], list[Profile]]


def split_objects(part: Mesh, plan: Plans, profile: Profile) -> _Groups:
    """Split a part into groups of objects with the same layers and settings: meshes, layer plans, profiles.

    If all objects have the same layers and settings, the whole part is one group. An object with volumes that matter is
    a group of its own; if a repair mixed the facets of the objects, the volumes apply to all objects. Objects have the
    names of their file; several with the same name get a number, as in `lid_2`. A single object may also be called by
    the name of the part.

    Args:
        part: placed on the bed.
        plan: one layer plan for all objects, or one for each.
        profile: may have overrides for objects.

    Raises:
        UsageError: an override names no object, a repair mixed the facets of the objects, or the number of plans is not
            the number of objects.
    """
    plans = list_plans(part, plan)
    numbers = number_plans(plans)
    groups = _group_objects(part, profile, numbers)
    return (
        [mesh for mesh, _, _ in groups],
        [plans[number] for _, number, _ in groups],
        [own for _, _, own in groups],
    )


def separate_objects(part: Mesh, plan: Plans, profile: Profile) -> _Groups:
    """Split a part into all its objects: meshes, layer plans, profiles; arguments and errors as `split_objects`."""
    plans = list_plans(part, plan)
    object_names = _list_object_names(part)
    overridden = list_overridden_objects(profile)
    _check_names(overridden, object_names, part)
    _require_known_facets(part)
    own = [
        make_profile_for_object(profile, tuple(name for name in overridden if name in names))
        for names in object_names
    ]
    return [extract_objects(part, [item]) for item in part.objects] or [part], plans, own


def _group_objects(part: Mesh, profile: Profile, numbers: Sequence[int]) -> list[tuple[Mesh, int, Profile]]:
    """Return groups of objects with the same plan and settings: mesh, index of the plan, profile.

    `numbers` has the index of the plan of each object.
    """
    overridden = list_overridden_objects(profile)
    has_volumes = any(item.volumes for item in part.objects)
    is_alone = [_needs_own_group(item, profile) for item in part.objects]
    is_known = all(item.count for item in part.objects)
    if not overridden and not any(numbers) and (not any(is_alone) or not is_known):
        return [(replace(part, volumes=part.all_volumes) if has_volumes else part, 0, profile)]
    object_names = _list_object_names(part)
    _check_names(overridden, object_names, part)
    if len(object_names) == 1:
        one = replace(part, volumes=part.all_volumes) if has_volumes else part
        return [(one, 0, make_profile_for_object(profile, object_names[0]))]
    _require_known_facets(part)
    own: dict[tuple[tuple[str, ...], int, int], list[PlateObject]] = {}
    for index, (item, names) in enumerate(zip(part.objects, object_names, strict=True)):
        key = (
            tuple(name for name in overridden if name in names),
            numbers[index],
            index if is_alone[index] else -1,
        )
        own.setdefault(key, []).append(item)
    return [
        (extract_objects(part, items), number, make_profile_for_object(profile, names))
        for (names, number, _), items in own.items()
    ]


def _needs_own_group(item: PlateObject, profile: Profile) -> bool:
    """Return whether an object has volumes of its own that change the print."""
    if item.volumes is None:
        return False
    is_modified = any(mesh.name in list_overridden_objects(profile) for mesh in item.volumes.modifiers)
    return is_modified or item.volumes.negative is not None or list_support_styles(profile) != {"off"}


def _require_known_facets(part: Mesh) -> None:
    """Check that the facets of each object are known.

    Raises:
        UsageError: the part was repaired, which mixed its facets.
    """
    if not all(item.count for item in part.objects):
        raise UsageError(
            f"{part.name}: the mesh needs repair, and after that it is unknown which facets belong to which object",
            remedy="Repair the mesh file first, or leave out the overrides for objects",
        )


def _list_object_names(part: Mesh) -> list[set[str]]:
    """Return for each object all names by which overrides may refer to it."""
    object_names = _number_equal_names([item.name for item in part.objects] or [part.name])
    return [object_names[0] | {part.name}] if len(object_names) == 1 else object_names


def _number_equal_names(names: Sequence[str]) -> list[set[str]]:
    """Return the names of each object: its own name, and a numbered name if several objects have the same name."""
    count: dict[str, int] = {}
    object_names = []
    for name in names:
        count[name] = count.get(name, 0) + 1
        object_names.append({name, f"{name}_{count[name]}"} if names.count(name) > 1 else {name})
    return object_names


def list_overridable_names(part: Mesh) -> list[str]:
    """Return all names by which overrides may refer to the objects and modifiers of a part, sorted."""
    return _join_names(_list_object_names(part), part)


def _join_names(object_names: Sequence[set[str]], part: Mesh) -> list[str]:
    """Return the names of objects and of the modifiers of a part, sorted."""
    volumes = part.all_volumes
    modifiers = {mesh.name for mesh in volumes.modifiers} if volumes else set()
    return sorted(modifiers.union(*object_names))


def _check_names(overridden: Sequence[str], object_names: Sequence[set[str]], part: Mesh) -> None:
    """Check that each overridden name is the name of an object or of a modifier."""
    known = _join_names(object_names, part)
    for name in overridden:
        if name not in known:
            near = find_similar_words(name, known, most=1)
            hint = f"Did you mean {near[0]!r}?" if near else ""
            raise UsageError(
                f"no object named {name!r}; objects: {', '.join(known)}",
                remedy=hint or "Use one of these names",
            )


def cut_objects(
    meshes: Sequence[Mesh], plans: Sequence[LayerPlan], profiles: Sequence[Profile]
) -> list[Sections]:
    """Cut and compensate each mesh; an overlap belongs to the first mesh.

    Raises:
        PartError: no layer contains material, or the contours cannot be closed.
    """
    cuts = [
        compensate(_cut_object(mesh, plan, own), own)
        for mesh, plan, own in zip(meshes, plans, profiles, strict=True)
    ]
    return _subtract_earlier(cuts)


def _cut_object(mesh: Mesh, plan: LayerPlan, profile: Profile) -> Sections:
    """Cut a mesh; with contoured tops, sections take in all that low extrusions reach."""
    resolution = profile.quality.resolution
    if not profile.quality.z_contouring:
        return cut(mesh, plan, resolution)
    from printer_slicer.contouring import find_facet_bins, find_reached_areas, make_contour_rule  # noqa: PLC0415 - off by default

    rule = plan.contour_rule or make_contour_rule(profile)
    bins = find_facet_bins(mesh, plan, rule) if rule else None
    if rule is None or bins is None:
        return cut(mesh, plan, resolution)
    reached = find_reached_areas(bins.tops, rule)
    sections = cut(mesh, plan, resolution, reached)
    return replace(sections, below_cut=intersection(reached.lower, sections.solid))


def _subtract_earlier(sections: Sequence[Sections]) -> list[Sections]:
    """Subtract the sections of all earlier objects from those of each object."""
    result, taken = [sections[0]], sections[0]
    for one in sections[1:]:
        result.append(replace(one, solid=difference(one.solid, taken.solid_at(one.plan))))
        plan = LayerPlan.union([taken.plan, one.plan])
        taken = replace(taken, plan=plan, solid=union(taken.solid_at(plan), one.solid_at(plan)))
    return result


def make_object_paths(  # noqa: PLR0917 - the results of all stages
    name: str,
    stages: tuple[Sequence[Sections], Sequence[Walls], Sequence[Regions]],
    profiles: Sequence[Profile],
    usual: Profile,
    custom_infill: Infill | None = None,
    modified: Sequence[Sequence[tuple[Regions, Profile]]] = (),
) -> tuple[list[Toolpaths], list[Profile]]:
    """Generate the perimeters and infill of all objects.

    Args:
        name: of the part.
        stages: sections, walls and regions of each object.
        profiles: of each object.
        usual: the profile for everything that belongs to no object; it gets index 0.
        custom_infill: the user's infill pattern, if any.
        modified: the regions inside the modifiers of each object, and their profiles.

    Returns:
        The paths of each object, and the profiles to which their `settings_id` refers.

    Raises:
        PartError: the part has no path.
    """
    paths, numbered = list[Toolpaths](), [usual]
    for number, (sections, walls, regions, profile) in enumerate(zip(*stages, profiles, strict=True)):
        perimeters, groups = combine_perimeters(
            grade_overhangs(walls.paths, sections), sections, regions, profile
        )
        of_layer = _find_profile_indices(numbered, resolve_layer_settings(profile, sections.plan))
        infill = infill_paths(regions, profile, groups, custom_infill)
        paths += [perimeters.with_settings(of_layer), infill.with_settings(of_layer)]
        for inside, own in modified[number] if modified else ():
            of_layer = _find_profile_indices(numbered, resolve_layer_settings(own, sections.plan))
            paths.append(infill_paths(inside, own, groups, custom_infill).with_settings(of_layer))
    if sum(some.n_paths for some in paths) == 0:
        raise PartError(
            f"{name}: no extrusion of {usual.extrusion_width:g} mm width fits into the part",
            remedy="Check the unit of the part, or choose a thinner nozzle, more perimeters or denser infill",
        )
    return paths, numbered


def _find_profile_indices(profiles: list[Profile], settings: LayerSettings) -> Int:
    """Return the index (L,) in `profiles` of the profile of each layer; append new profiles."""
    profiles += [one for one in settings.profiles if one not in profiles]
    return np.array([profiles.index(one) for one in settings.profiles])[settings.of_layer]
