"""Objects with settings of their own: each is cut by itself at the planes of one plan, where no other is already."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from difflib import get_close_matches

import numpy as np

from printer_slicer.arrays import Int
from printer_slicer.compensation import compensate
from printer_slicer.errors import PartError, UsageError
from printer_slicer.geometry import Areas, difference, union
from printer_slicer.infill import Infill, infill_paths
from printer_slicer.layer_settings import LayerSettings, settings_by_layer
from printer_slicer.model import LayerPlan, Mesh, PlateObject, Regions, Sections, Toolpaths, Walls
from printer_slicer.overhangs import graded
from printer_slicer.profile import Profile
from printer_slicer.profile.places import for_object, objects_of
from printer_slicer.slicing import cut
from printer_slicer.thick_walls import thickened

__all__ = ["cut_objects", "object_paths", "split_objects", "stack_sections"]


_Groups = tuple[list[Mesh], list[LayerPlan], list[Profile]]


def split_objects(part: Mesh, plan: LayerPlan | Sequence[LayerPlan], profile: Profile) -> _Groups:
    """What is sliced with the same layers and settings: meshes, their layers, their settings.

    That is all of the part where no object has any of its own. Objects are named as in their file, or, where several
    have one name, with a number: `lid_2`; the only one also as the part.

    Args:
        part: placed.
        plan: the layers of all objects, or those of each.
        profile: may have settings for objects.

    Raises:
        UsageError: no object has that name, which facets are whose is not known any more, or there are not as many
            plans as objects.
    """
    if isinstance(plan, LayerPlan):
        meshes, profiles = zip(*_by_settings(part, profile), strict=True)
        return list(meshes), [plan] * len(meshes), list(profiles)
    if len(plan) != max(len(part.objects), 1):
        raise UsageError(
            f"{part.name}: {len(plan)} layer plans for {max(len(part.objects), 1)} objects",
            remedy="give one plan for all, or one for each object",
        )
    called = _names_of(part)
    named = objects_of(profile)
    _refuse_unknown(named, called)
    _require_known_facets(part)
    own = [for_object(profile, tuple(name for name in named if name in names)) for names in called]
    return [_only(part, [item]) for item in part.objects] or [part], list(plan), own


def _by_settings(part: Mesh, profile: Profile) -> list[tuple[Mesh, Profile]]:
    """Groups of objects with the same settings, and these."""
    named = objects_of(profile)
    if not named:
        return [(part, profile)]
    called = _names_of(part)
    _refuse_unknown(named, called)
    if len(called) == 1:
        return [(part, for_object(profile, called[0]))]
    _require_known_facets(part)
    own: dict[tuple[str, ...], list[PlateObject]] = {}
    for item, names in zip(part.objects, called, strict=True):
        own.setdefault(tuple(name for name in named if name in names), []).append(item)
    return [(_only(part, items), for_object(profile, names)) for names, items in own.items()]


def _require_known_facets(part: Mesh) -> None:
    """Refuse a part of several objects if it is not known which facets are whose.

    Raises:
        UsageError: it was repaired.
    """
    if not all(item.count for item in part.objects):
        raise UsageError(
            f"{part.name}: needs repair, after which it is not known what belongs to which object",
            remedy="mend the models, or leave out the settings of objects",
        )


def _names_of(part: Mesh) -> list[set[str]]:
    """All that each object may be called."""
    called = _called([item.name for item in part.objects] or [part.name])
    return [called[0] | {part.name}] if len(called) == 1 else called


def _called(names: Sequence[str]) -> list[set[str]]:
    """The name of each object, and that with a number where several have one name."""
    count: dict[str, int] = {}
    called = []
    for name in names:
        count[name] = count.get(name, 0) + 1
        called.append({name, f"{name}_{count[name]}"} if names.count(name) > 1 else {name})
    return called


def _refuse_unknown(named: Sequence[str], called: Sequence[set[str]]) -> None:
    known = sorted(set().union(*called))
    for name in named:
        if name not in known:
            near = get_close_matches(name, known, n=1)
            hint = f"did you mean {near[0]!r}? " if near else ""
            raise UsageError(
                f"settings for the object {name!r}, which there is not",
                remedy=f"{hint}there are: {', '.join(known)}",
            )


def _only(part: Mesh, items: Sequence[PlateObject]) -> Mesh:
    """Some of the objects as a mesh of their own."""
    pieces = [part.triangles[item.first : item.first + item.count] for item in items]
    return Mesh(np.concatenate(pieces), ", ".join(item.name for item in items))


def cut_objects(
    meshes: Sequence[Mesh], plans: Sequence[LayerPlan], profiles: Sequence[Profile]
) -> list[Sections]:
    """The sections of each, compensated as its settings say; what overlaps belongs to the first.

    Raises:
        PartError: the planes meet no material, or the contours cannot be closed.
    """
    cuts = [
        compensate(cut(mesh, plan, own.quality.resolution), own)
        for mesh, plan, own in zip(meshes, plans, profiles, strict=True)
    ]
    return _subtract_earlier(cuts)


def _subtract_earlier(sections: Sequence[Sections]) -> list[Sections]:
    """The same without what an earlier one of them has already: what overlaps belongs to the first."""
    result, taken = [sections[0]], sections[0]
    for one in sections[1:]:
        result.append(replace(one, solid=difference(one.solid, taken.solid_at(one.plan))))
        plan = LayerPlan.union([taken.plan, one.plan])
        taken = replace(taken, plan=plan, solid=union(taken.solid_at(plan), one.solid_at(plan)))
    return result


def stack_sections(sections: Sequence[Sections]) -> Sections:
    """The sections of all objects together, on all layers that any of them has."""
    if len(sections) == 1:
        return sections[0]
    plan = LayerPlan.union([one.plan for one in sections])
    gaps = sorted((gap for one in sections for gap in one.gaps), key=lambda gap: -gap.width)
    turned = [
        one.turned.on_layers(plan.find_tops(one.plan.top), plan.n_layers) for one in sections if one.turned
    ]
    solid = sections[0].solid_at(plan)
    for one in sections[1:]:
        solid = union(solid, one.solid_at(plan))
    return Sections(
        plan,
        solid,
        sum(one.open_edges for one in sections),
        tuple(gaps),
        Areas.merged(turned) if turned else None,
    )


def object_paths(
    name: str,
    stages: tuple[Sequence[Sections], Sequence[Walls], Sequence[Regions]],
    profiles: Sequence[Profile],
    usual: Profile,
    custom_infill: Infill | None = None,
) -> tuple[list[Toolpaths], list[Profile]]:
    """The paths of all objects, and the profiles whose numbers they have.

    Args:
        name: of the part.
        stages: sections, walls and regions of each object.
        profiles: of each object.
        usual: the profile of what belongs to no object, number 0.
        custom_infill: the sparse infill of a strategy from outside.

    Raises:
        PartError: there is no path.
    """
    paths, numbered = list[Toolpaths](), [usual]
    for sections, walls, regions, profile in zip(*stages, profiles, strict=True):
        perimeters, groups = thickened(graded(walls.paths, sections), sections, regions, profile)
        of_layer = _numbers(numbered, settings_by_layer(profile, sections.plan))
        infill = infill_paths(regions, profile, groups, custom_infill)
        paths += [perimeters.with_settings(of_layer), infill.with_settings(of_layer)]
    if sum(some.n_paths for some in paths) == 0:
        raise PartError(
            f"{name}: no bead of {usual.extrusion_width:g} mm fits into the part",
            remedy="is the part in another unit? otherwise choose a thinner nozzle, more perimeters or denser infill",
        )
    return paths, numbered


def _numbers(profiles: list[Profile], layered: LayerSettings) -> Int:
    """(L,) the number of each layer's profile among `profiles`, to which those are added that are new."""
    profiles += [one for one in layered.profiles if one not in profiles]
    return np.array([profiles.index(one) for one in layered.profiles])[layered.of_layer]
