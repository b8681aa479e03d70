"""The whole slicer on one page.

Mesh -> LayerPlan -> Sections -> Walls -> Regions -> Toolpaths -> Travels -> Program -> lines.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from datetime import datetime

import numpy as np

from printer_slicer.adhesion import adhesion_paths, on_raft
from printer_slicer.compensation import compensated
from printer_slicer.curves import curved, merged
from printer_slicer.errors import MeshError, PartError, UsageError
from printer_slicer.extrusion import extrude, move_seconds
from printer_slicer.gcode import write_gcode
from printer_slicer.geometry import frozen_array
from printer_slicer.healing import refuse_repaired, repair
from printer_slicer.infill import infill_paths
from printer_slicer.labelling import labels_of
from printer_slicer.layered import Layered, by_layer
from printer_slicer.model import (
    Float,
    Int,
    Labels,
    LayerPlan,
    Mesh,
    Program,
    Regions,
    Repairs,
    Sections,
    Toolpaths,
    Travels,
    Walls,
)
from printer_slicer.naming import kind_of
from printer_slicer.ordering import order
from printer_slicer.overhangs import graded
from printer_slicer.pacing import LinkReport, crowded, crowded_paths, paced
from printer_slicer.perimeters import lay_walls
from printer_slicer.placing import IN_THE_MIDDLE, Placement, place
from printer_slicer.planning import plan_layers
from printer_slicer.profile import Profile, profile_with
from printer_slicer.regions import classify
from printer_slicer.showing import Drawn
from printer_slicer.slicing import cut, section_repairs
from printer_slicer.strategies import OURS, Strategies, checked_lines, checked_plan, checked_program
from printer_slicer.surface import Certificate, certify, read_surface
from printer_slicer.thick_walls import thickened
from printer_slicer.things import apart, side_by_side, things_of
from printer_slicer.thumbnails import thumbnail_lines
from printer_slicer.travels import travel

__all__ = ["Report", "Stages", "gcode_of", "plan_part", "quiet", "slice_part", "slice_stages"]

Report = Callable[[str], None]
_LONGEST = 1e8  # s
# What a spiral is made of.
_SPIRAL = {
    "quality.perimeters": 1,
    "quality.infill_density": 0,
    "quality.top_thickness": 0,
    "quality.min_sparse_area": 0,
    "quality.extra_perimeters": False,
    "quality.seam": "aligned",
}
_ROUNDS = 6  # of asking for a plan within a time budget


def quiet(stage: str) -> None:
    """A `report` that says nothing."""


@dataclass(frozen=True, slots=True, eq=False)
class Stages(Drawn):
    """Every value on the way from a part to its moves.

    Attributes:
        part: repaired and placed.
        sections: the solid area of each layer. These, the walls and the regions see the part on the bed; where there is
            a raft, toolpaths, travels and program have its layers before the part's, and the part lifted.
        walls: the perimeters, and what is left inside them.
        regions: that by purpose.
        toolpaths: polylines in the order in which they are printed.
        travels: the ways between them.
        program: the moves.
        link: what it took to stay under the lines per second of the link, if the profile tells them.
        labels: which moves lay which of several things; None where there is one.
        repairs: what was put right, at the places of the mesh that was given.
        shift: (3,) mm from the placed part to where that mesh was.
    """

    part: Mesh
    sections: Sections
    walls: Walls
    regions: Regions
    toolpaths: Toolpaths
    travels: Travels
    program: Program
    link: LinkReport | None = None
    labels: Labels | None = None
    repairs: Repairs = field(default_factory=Repairs)
    shift: Float = field(default_factory=lambda: frozen_array(np.zeros(3), np.float64, (3,)))

    def __repr__(self) -> str:
        values = ("part", "sections", "walls", "regions", "toolpaths", "travels", "program")
        return "\n".join(["<Stages", *(f"  {name}: {getattr(self, name)!r}" for name in values), ">"])

    @property
    def looks(self) -> object:
        """The moves."""
        return self.program

    @property
    def plan(self) -> LayerPlan:
        """The layers of the part, without those of a raft."""
        return self.sections.plan


def slice_stages(  # noqa: PLR0913 - as for `slice_part`: every choice has a usual value
    mesh: Mesh,
    profile: Profile,
    *,
    plan: LayerPlan | None = None,
    placement: Placement = IN_THE_MIDDLE,
    report: Report = quiet,
    strict: bool = False,
    strategies: Strategies = OURS,
) -> Stages:
    """Slice a part and keep the value of each stage.

    Args:
        mesh: the part, anywhere; it is repaired and placed.
        profile: printer, material and quality.
        plan: the layers, if not the profile's planner shall choose them.
        placement: where the part is put; by default on the middle of the bed.
        report: is told the name of each stage as it begins.
        strict: whether a mesh that needs repair is refused.
        strategies: functions from outside in place of ours.

    Raises:
        UsageError: the part is no mesh, or the profile none.
        PartError: the part does not fit, cannot be repaired, or cannot be divided into layers.
        StrategyError: a function from outside gives what cannot be used.
    """
    _insist_on_part(mesh, profile)
    report("repairing")
    mended, repairs = repair(mesh)
    if strict:
        refuse_repaired(mesh.name, repairs)
    report("placing")
    part = place(mended, profile.printer, placement)
    shift = frozen_array(mended.bounds[0] - part.bounds[0], np.float64, (3,))
    del mesh, mended  # where nobody else holds them: millions of facets weigh hundreds of megabytes
    report("planning")
    plan = plan or plan_part(part, profile, strategies)
    stages = _down_from(part, plan, profile, report, strategies)
    repairs = replace(repairs, done=(*repairs.done, *section_repairs(stages.sections, shift)))
    if strict:
        refuse_repaired(part.name, repairs)
    return replace(stages, repairs=repairs, shift=shift)


def _insist_on_part(mesh: object, profile: object) -> None:
    """Refuse what nothing can be made of, before a stage fails over it in words of its own."""
    if not isinstance(mesh, Mesh):
        raise UsageError(f"a part is a Mesh, not {kind_of(mesh)}", remedy="read it: ps.load_mesh(path)")
    if not isinstance(profile, Profile):
        raise UsageError(
            f"a profile is a Profile, not {kind_of(profile)}", remedy="load it: ps.load_profile(printer)"
        )
    if not mesh.n_facets:
        raise MeshError(f"{mesh.name}: has no facets", remedy="give it triangles (F, 3, 3), mm")
    if not np.isfinite(mesh.bounds).all():
        raise MeshError(
            f"{mesh.name}: a corner has a coordinate that is no number",
            remedy="all of mesh.triangles must be finite, mm",
        )


def plan_part(part: Mesh, profile: Profile, strategies: Strategies = OURS) -> LayerPlan:
    """The layer plan of a placed part.

    A planner that is given a time budget knows times from a model. Here the budget is held against the moves, and the
    planner is asked for more or less until they agree. A planner from outside is asked once.

    Args:
        part: standing on z = 0.
        profile: printer, material and quality.
        strategies: may hold a planner.

    Raises:
        PartError: the part cannot be divided into layers.
        StrategyError: the planner from outside gives what cannot be used.
    """
    if strategies.planner:
        return checked_plan(strategies.planner(part, profile), part, profile, strategies.planner)
    plan, budget = plan_layers(part, profile), profile.dials.time_budget
    if not budget:
        return plan

    def seconds_of(plan: LayerPlan) -> float:
        """How long the moves of a print with these layers take, s."""
        stages = _down_from(part, plan, profile, quiet, strategies)
        return float(move_seconds(stages.program, profile).sum())

    asked, low, high = budget, 0.0, np.inf
    tried: list[tuple[float, LayerPlan]] = []
    for _ in range(_ROUNDS):
        seconds = seconds_of(plan)
        tried.append((seconds, plan))
        if 0.98 * budget <= seconds <= budget or (len(tried) > 1 and plan.runs() == tried[-2][1].runs()):
            break
        low, high = (asked, high) if seconds <= budget else (low, asked)
        asked = (low + high) / 2 if low and high < np.inf else min(asked * 0.995 * budget / seconds, _LONGEST)
        plan = plan_layers(part, profile_with(profile, {"quality.planner.time_budget": asked}))
    if all(seconds > budget for seconds, _ in tried):
        hurry = {"quality.planner.time_budget": 0, "quality.planner.objective": "time"}
        plan = plan_layers(part, profile_with(profile, hurry))
        tried.append((seconds_of(plan), plan))
    within = [plan for seconds, plan in tried if seconds <= budget]
    if not within:
        return min(tried, key=lambda one: one[0])[1]
    return min(within, key=lambda plan: certify(read_surface(part), plan).volume_error)


def _down_from(
    part: Mesh, plan: LayerPlan, profile: Profile, report: Report, strategies: Strategies
) -> Stages:
    """From a placed part and its plan to the moves."""
    profile = profile_with(profile, _SPIRAL) if profile.quality.spiral else profile
    things = things_of(part, profile)
    report("slicing")
    cuts = apart([compensated(cut(mesh, plan, own.quality.resolution), own) for mesh, own in things])
    report("perimeters")
    walls = [lay_walls(section, own) for section, (_, own) in zip(cuts, things, strict=True)]
    report("regions")
    regions = [
        classify(section, wall, own) for section, wall, (_, own) in zip(cuts, walls, things, strict=True)
    ]
    report("toolpaths")
    rules, paths = [profile], list[Toolpaths]()
    for section, wall, region, (_, own) in zip(cuts, walls, regions, things, strict=True):
        perimeters, groups = thickened(graded(wall.paths, section), section, region, own)
        numbers = _numbers(rules, by_layer(own, plan))
        infill = infill_paths(region, own, groups, strategies.own_infill)
        paths += [perimeters.ruled(numbers), infill.ruled(numbers)]
    if sum(some.n_paths for some in paths) == 0:
        raise PartError(
            f"{part.name}: no bead of {profile.extrusion_width:g} mm fits into the part",
            remedy="is the part in another unit? otherwise choose a thinner nozzle, more perimeters or denser infill",
        )
    report("ordering")
    sections = side_by_side(cuts)
    printed = on_raft(sections, profile)
    lift = float(printed.plan.top[-1] - sections.plan.top[-1])
    lifted = [adhesion_paths(printed, profile), *(some.on_plan(printed.plan, lift) for some in paths)]
    toolpaths = curved(order(Toolpaths.joined(printed.plan, lifted), printed, profile), profile)
    report("travels")
    travels = travel(toolpaths, printed, profile)
    report("extrusion")
    program = extrude(toolpaths, travels, profile, rules)
    stages = Stages(part, sections, Walls.joined(walls), Regions.joined(regions), toolpaths, travels, program)
    if profile.printer.link_lines_per_second:
        stages = _kept_up(stages, printed, profile, rules)
    program = checked_program(stages.program, strategies.on_program)
    return replace(stages, program=program, labels=labels_of(program, part, plan))


def _numbers(rules: list[Profile], layered: Layered) -> Int:
    """(L,) the number of each layer's profile among `rules`, to which those are added that are new."""
    rules += [one for one in layered.profiles if one not in rules]
    return np.array([rules.index(one) for one in layered.profiles])[layered.of_layer]


def _kept_up(stages: Stages, printed: Sections, profile: Profile, rules: Sequence[Profile]) -> Stages:
    """The stages with moves that the link to the printer can carry: merged where they are short, then slowed down."""
    before = stages.program
    busy = crowded(before, profile)
    if not busy.any():
        return replace(stages, link=LinkReport(profile.printer.link_lines_per_second))
    dense = crowded_paths(stages.toolpaths, stages.travels, busy, profile)
    toolpaths = merged(stages.toolpaths, dense, profile.quality.link_tolerance)
    travels = travel(toolpaths, printed, profile)
    program, link = paced(extrude(toolpaths, travels, profile, rules), before, busy, profile)
    return replace(stages, toolpaths=toolpaths, travels=travels, program=program, link=link)


def slice_part(  # noqa: PLR0913 - every choice has a usual value
    mesh: Mesh,
    profile: Profile,
    *,
    plan: LayerPlan | None = None,
    placement: Placement = IN_THE_MIDDLE,
    report: Report = quiet,
    strict: bool = False,
    strategies: Strategies = OURS,
) -> Program:
    """The moves that print a part; arguments and errors are those of `slice_stages`."""
    return slice_stages(
        mesh,
        profile,
        plan=plan,
        placement=placement,
        report=report,
        strict=strict,
        strategies=strategies,
    ).program


def gcode_of(  # noqa: PLR0913 - every choice has a usual value
    program: Program,
    profile: Profile,
    *,
    part: Mesh | None = None,
    certificate: Certificate | None = None,
    labels: Labels | None = None,
    strategies: Strategies = OURS,
    made: datetime | None = None,
) -> bytes:
    """The text of a program in the printer's dialect; the same program and profile give the same bytes.

    Args:
        program: the moves.
        profile: what they were made with.
        part: shown in the pictures of `printer.thumbnails`; without it there are none.
        certificate: of the plan, to be told in comments.
        labels: which moves lay which of several things on the plate, to be marked.
        strategies: may hold a flavour, and functions that change the lines.
        made: date in UTC for the first line; None: no date.

    Raises:
        ProfileError: a macro that cannot be filled in.
        StrategyError: a function from outside gives what cannot be used.
    """
    facts = strategies.facts()
    if certificate is not None:
        worst = certificate.worst
        facts += (
            f"layer heights = {len(set(certificate.plan.height.tolist()))}",
            f"certified error [mm] = {certificate.max_error:.4f}",
            f"certified error attained = layer {worst.layer + 1}, z {worst.z:.4g}, {worst.kind}",
            f"mean error [mm] = {certificate.mean_error:.4f}",
            f"volume error [mm3] = {certificate.volume_error:.2f}",
        )
    pictures = thumbnail_lines(part, profile.printer.thumbnails) if part is not None else []
    seconds = move_seconds(program, profile)
    text = write_gcode(
        program,
        profile,
        seconds,
        facts,
        comments=pictures,
        labels=labels,
        flavour=strategies.own_flavour,
        made=made,
    )
    return checked_lines(text, strategies.on_lines)
