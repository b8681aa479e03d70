"""Find the overhangs of each object, and make the supports of all objects with the settings of each."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from printer_slicer.arrays import Float
from printer_slicer.layer_settings import resolve_layer_settings
from printer_slicer.model import (
    Mesh,
    Overhangs,
    Regions,
    Sections,
    SupportPlan,
    Supports,
    Toolpaths,
    Volumes,
    fill_layers,
)
from printer_slicer.profile import Profile
from printer_slicer.progress import Report
from printer_slicer.slicing import cut_volumes
from printer_slicer.supports import find_overhangs
from printer_slicer.values import Struct

if TYPE_CHECKING:
    from printer_slicer.modifiers import Modifier

__all__ = ["ObjectOverhangs", "find_object_overhangs", "has_supports", "make_object_supports"]


class ObjectOverhangs(Struct, frozen=True, eq=False):
    """The overhangs in the layers of an object that have the same settings of supports.

    Attributes:
        index: number of the object.
        overhangs: areas that need supports, on all layers of the object.
        profile: the settings.
    """

    index: int
    overhangs: Overhangs
    profile: Profile


def has_supports(profile: Profile) -> bool:
    """Return whether objects with this profile get supports."""
    return profile.quality.support != "off" and not profile.quality.spiral


def find_object_overhangs(  # noqa: PLR0913 - the results of all stages
    meshes: Sequence[Mesh],
    sections: Sequence[Sections],
    regions: Sequence[Regions],
    profiles: Sequence[Profile],
    modifiers: Sequence[Sequence[Modifier]],
    *,
    always_steer: bool = False,
    only_supported: bool = False,
) -> list[ObjectOverhangs]:
    """Find the overhangs of each object; its volumes count if it has supports.

    Args:
        meshes: of each object, with its volumes.
        sections: of each object.
        regions: of each object.
        profiles: of each object.
        modifiers: of each object; overhangs within those with other settings of supports have these settings.
        always_steer: whether volumes also count without supports.
        only_supported: whether objects without supports are left out.
    """
    found = []
    for index, (mesh, solid, area, profile) in enumerate(
        zip(meshes, sections, regions, profiles, strict=True)
    ):
        usual = _list_support_settings(profile)
        inside = [one for one in modifiers[index] if _list_support_settings(one.profile) != usual]
        places: list[tuple[Profile, Modifier | None]] = [
            (profile, None),
            *((one.profile, one) for one in inside),
        ]
        for place_profile, place in places:
            for own, here in _divide_by_settings(place_profile, solid):
                if only_supported and not has_supports(own):
                    continue
                overhangs = find_overhangs(solid, area, own)
                is_steered = mesh.volumes is not None or own.quality.support_places == "enforced"
                if is_steered and (always_steer or own.quality.support != "off"):
                    from printer_slicer.supports.enforcers import apply_enforcers_and_blockers  # noqa: PLC0415 - most parts have no volumes

                    volumes = cut_volumes(mesh.volumes or Volumes(), solid.plan)
                    overhangs = apply_enforcers_and_blockers(overhangs, solid, volumes, own.quality)
                if inside:
                    overhangs = _select_place(overhangs, place, inside, own)
                found.append(
                    ObjectOverhangs(index, overhangs if here.all() else overhangs.of_layers(here), own)
                )
    return found


def _select_place(
    overhangs: Overhangs, place: Modifier | None, inside: Sequence[Modifier], profile: Profile
) -> Overhangs:
    """Return the overhangs within a modifier, or outside all modifiers if `place` is None."""
    from printer_slicer.supports.enforcers import select_overhangs  # noqa: PLC0415 - few parts have modifiers

    if place is not None:
        return select_overhangs(overhangs, place.area, profile.quality, inside=True)
    for one in inside:
        overhangs = select_overhangs(overhangs, one.area, profile.quality, inside=False)
    return overhangs


def _divide_by_settings(profile: Profile, sections: Sections) -> list[tuple[Profile, np.ndarray]]:
    """Return the profiles of an object with different settings of supports, and a mask (L,) of the layers of each."""
    divided: dict[tuple[object, ...], tuple[Profile, np.ndarray]] = {}
    for own, here in resolve_layer_settings(profile, sections.plan).each():
        key = _list_support_settings(own)
        first, before = divided.get(key, (own, np.zeros(len(here), np.bool_)))
        divided[key] = first, before | here
    return list(divided.values())


def _list_support_settings(profile: Profile) -> tuple[object, ...]:
    """Return all settings that supports depend on, except those of the whole plate."""
    quality = profile.quality
    names = [name for name in quality.__struct_fields__ if name.startswith("support")]
    return *(getattr(quality, name) for name in names), profile.extrusion_width, quality.spiral


def make_object_supports(
    found: Sequence[ObjectOverhangs], sections: Sequence[Sections], regions: list[Regions], report: Report
) -> tuple[Supports | None, list[Toolpaths]]:
    """Return the supports of all objects that have them, and their paths; change `regions` that lie on supports.

    All supports have the same layers. They avoid all objects, and those of other settings.

    Args:
        found: overhangs of each object.
        sections: of each object.
        regions: of each object.
        report: called when supports begin.
    """
    alike: dict[tuple[object, ...], list[ObjectOverhangs]] = {}
    for one in found:
        if has_supports(one.profile) and one.overhangs.area.n_rings:
            alike.setdefault(_list_support_settings(one.profile), []).append(one)
    if not alike:
        return None, []
    from printer_slicer.support_times import measure_group_times  # noqa: PLC0415 - most parts have no supports
    from printer_slicer.supports.stacking import make_obstacles  # noqa: PLC0415
    from printer_slicer.supports.styles import make_supports  # noqa: PLC0415
    from printer_slicer.supports.support_layers import plan_shared_layers  # noqa: PLC0415
    from printer_slicer.supports.unsupported_places import leave_out_bed  # noqa: PLC0415

    report("supports")
    groups = list(alike.values())
    together = [Overhangs.joined([one.overhangs for one in group]) for group in groups]
    profiles = [group[0].profile for group in groups]
    made, obstacles = [], [fill_layers(sections)]
    demands = list(zip(together, profiles, strict=True))
    plans = plan_shared_layers(demands, _find_start_heights(demands, obstacles[0]))
    if all((plan.carrier < 0).all() for plan in plans) and not any(
        leave_out_bed(*demand).area.n_rings for demand in demands
    ):  # all overhangs lie so low that the bed carries them
        return None, []
    for overhangs, plan, profile in zip(together, plans, profiles, strict=True):
        made.append(make_supports(overhangs, plan, fill_layers(obstacles), profile, measure_group_times))
        obstacles.append(make_obstacles(made[-1].supports))
    for group, overhangs, plan in zip(groups, together, plans, strict=True):
        _replace_bridges(group, overhangs, plan, regions)
    plan = SupportPlan.joined(plans, [overhangs.plan for overhangs in together])
    supports = Supports.joined(plan, [one.supports for one in made])
    return supports, [one.paths for one in made if one.paths.n_paths]


def _find_start_heights(demands: Sequence[tuple[Overhangs, Profile]], sections: Sections) -> Float | None:
    """Return where supports begin above horizontal faces, mm; None if they only begin where layers of the part end.

    Args:
        demands: overhangs, with the profile of each.
        sections: all objects.
    """
    if demands[0][1].quality.support_synchronize_layers:
        return None
    from printer_slicer.supports.upward_faces import find_upward_faces  # noqa: PLC0415

    found = [find_upward_faces(some, sections) + own.quality.support_bottom_gap for some, own in demands]
    return np.concatenate(found)


def _replace_bridges(
    group: Sequence[ObjectOverhangs], together: Overhangs, plan: SupportPlan, regions: list[Regions]
) -> None:
    """Change the bridges of objects that lie on supports.

    Args:
        group: objects with the same settings.
        together: overhangs in all of them.
        plan: which of that supports carry.
        regions: of each object of the plate.
    """
    from printer_slicer.supports.bridges_on_supports import replace_bridges_on_supports  # noqa: PLC0415

    for one in group:
        carrier = plan.carrier[together.plan.find_tops(one.overhangs.plan.top)]
        carried = one.overhangs.area.of_layers(carrier >= 0)
        regions[one.index] = replace_bridges_on_supports(regions[one.index], carried)
