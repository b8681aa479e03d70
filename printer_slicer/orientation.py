"""Turn parts on the bed: `orient`, and the table of orientations that it chooses from."""

from __future__ import annotations

from typing import Final, Literal

from printer_slicer.arguments import check_arguments
from printer_slicer.deviation import measure_deviation
from printer_slicer.errors import PartError, UsageError
from printer_slicer.extrusion import move_seconds
from printer_slicer.healing import repair
from printer_slicer.model import Mesh
from printer_slicer.orienting import (
    CostModel,
    Orientation,
    Orientations,
    find_fast_orientations,
    sort_orientations,
    turn_mesh,
)
from printer_slicer.pipeline import plan_part, slice_planned
from printer_slicer.placing import place
from printer_slicer.profile import Profile, profile_with
from printer_slicer.progress import Report, quiet
from printer_slicer.roles import roles_with
from printer_slicer.stages import check_part
from printer_slicer.values import replace

__all__ = ["KEEP_ANY", "Search", "find_orientations", "orient"]

Search = Literal["fast", "careful"]
KEEP_ANY: Final = 180.0
"""Angle in degrees at which the upper side of a part may be turned anywhere."""

_N_SLICED: Final = 3
_N_POINTS: Final = 4000  # at which the deviation is measured


@check_arguments(mesh=Mesh, profile=Profile)
def orient(mesh: Mesh, profile: Profile, *, search: Search = "fast", keep_up: float = KEEP_ANY) -> Mesh:
    """Turn a part so that it prints in little time, with little support and a smooth surface.

    A part stays as it is if turning saves less than 5 % of the cost, unless it may fall over or does not fit. A turned
    part stands on z = 0.

    Args:
        mesh: the part; its objects are turned together.
        profile: printer, material and quality. `quality.support_minutes_per_gram` and `quality.surface_price` weigh
            support and surface against print time. Overhangs count as supported, whether or not `quality.support` is
            off.
        search: "fast" compares estimates; "careful" also slices the best orientations, without overrides.
        keep_up: largest angle by which the z axis of the part may be tilted, degrees; below 90, its top never faces
            down.

    Raises:
        UsageError: an argument is invalid.
        MeshError: the mesh has no facets, or a coordinate that is not finite.
    """
    return turn_mesh(mesh, find_orientations(mesh, profile, search=search, keep_up=keep_up).chosen.rotate)


@check_arguments(mesh=Mesh, profile=Profile)
def find_orientations(
    mesh: Mesh,
    profile: Profile,
    *,
    search: Search = "fast",
    keep_up: float = KEEP_ANY,
    report: Report = quiet,
) -> Orientations:
    """Compare the orientations of a part; arguments and errors are those of `orient`.

        found = ps.find_orientations(mesh, profile)
        turned = ps.transform(mesh, rotate=found.chosen.rotate)

    Args:
        mesh: the part.
        profile: printer, material and quality.
        search: "fast" or "careful".
        keep_up: degrees.
        report: called with the name of each stage when it starts.
    """
    check_part(mesh, profile)
    if search not in ("fast", "careful"):
        raise UsageError(f"search={search!r}: no such search", remedy='Use "fast" or "careful"')
    if not 0 <= keep_up <= KEEP_ANY:
        raise UsageError(
            f"keep_up={keep_up}: must be from 0 to 180 degrees", remedy="Choose an angle such as 60"
        )
    report("orienting")
    found = find_fast_orientations(mesh, profile, keep_up=keep_up)
    return _slice_best(mesh, profile, found, report) if search == "careful" else found


def _slice_best(mesh: Mesh, profile: Profile, found: Orientations, report: Report) -> Orientations:
    """Return the orientations with the figures of the best ones, and of the part as given, measured by slicing."""
    style = "auto" if profile.quality.support == "off" else profile.quality.support
    # Overrides name objects of the whole plate, and heights of the part as given.
    profile = profile_with(profile, {"quality.support": style, "quality.overrides": []})
    repaired, _ = repair(mesh)
    best = [row for row in found.rows if row.is_usable and not row.is_original][:_N_SLICED]
    sliced, rest = [], [row for row in found.rows if row not in best and not row.is_original]
    for number, row in enumerate([found.original, *best], start=1):
        report(f"slicing orientation {number} of {len(best) + 1}")
        sliced.append(_measure(repaired, row, profile))
    measured = [row for row in sliced if row.is_sliced]
    rest += [row for row in sliced if not row.is_sliced]
    if not measured:
        return found
    # Estimates are not comparable with measured figures, so they follow.
    return replace(found, rows=(*sort_orientations(measured), *rest))


def _measure(mesh: Mesh, row: Orientation, profile: Profile) -> Orientation:
    """Return an orientation with time, support and deviation measured by slicing; unchanged if that fails."""
    try:
        part = place(turn_mesh(mesh, row.rotate), profile.printer)
        stages = slice_planned(part, plan_part(part, profile), profile, keep=False, trial=True)
    except PartError:
        return row
    cost_model, program = CostModel(profile), stages.program
    minutes = float(move_seconds(program, profile).sum()) / 60
    filament = float(program.filament[roles_with(is_support=True)[program.role]].sum())
    grams = float(cost_model.compute_grams(filament * profile.material.filament_area))
    overhang = float(stages.overhangs.area.area().sum()) if stages.overhangs else 0.0
    stairs = measure_deviation(part, stages.sections, _N_POINTS).mean * row.surface_area
    volume = stairs + cost_model.gap * overhang
    return replace(
        row,
        minutes=minutes,
        support_g=grams,
        overhang=overhang,
        deviation=volume / row.surface_area,
        cost=float(cost_model.compute_cost(minutes, grams, volume)),
        is_sliced=True,
    )
