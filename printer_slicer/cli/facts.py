"""What people want to know about a sliced part, as values and as sentences."""

from __future__ import annotations

from typing import Any

import numpy as np

from printer_slicer.gcode import spoken
from printer_slicer.model import Mesh, Program, Role
from printer_slicer.pipeline import Stages
from printer_slicer.profile import Profile
from printer_slicer.slicing import mesh_faults

__all__ = ["facts_of", "runs_text", "sentences"]

_WORTH_SAYING = 0.002  # share of the part
_MOST_RUNS = 6  # stretches of equal height shown per plan
_MOST_PLACES = 10


def facts_of(mesh: Mesh, stages: Stages, profile: Profile, seconds: float) -> dict[str, Any]:
    """Everything worth knowing, ready for JSON.

    Args:
        mesh: the part as it was read; places are told in its coordinates.
        stages: the sliced part.
        profile: what it was sliced with.
        seconds: modelled time of the moves.
    """
    program = stages.program
    area = np.pi * profile.material.filament_diameter**2 / 4
    shift = mesh.bounds[0] - stages.part.bounds[0]
    gaps = [
        dict(zip("xyz", np.round(np.add((gap.x, gap.y, gap.z), shift), 4).tolist(), strict=True))
        | {"width": gap.width}
        for gap in stages.sections.gaps[:_MOST_PLACES]
    ]
    return {
        "layers": program.plan.n_layers,
        "planner": program.plan.planner,
        "heights": [[count, height] for count, height in program.plan.runs()],
        "seconds": round(seconds, 3),
        "filament_mm": round(program.filament_used, 3),
        "filament_g": round(program.filament_used * area / 1000 * profile.material.density, 3),
        "moves": program.n_moves,
        "volume_mm3": round(mesh.volume, 3),
        "lost_mm3": round(float((stages.walls.lost * program.plan.height).sum()), 3),
        "empty_layers": program.plan.n_layers - len(program.printed),
        "begins_at": _begins_at(program),
        "skirt_left_out": bool(profile.quality.skirt_loops) and not (program.role == Role.SKIRT).any(),
        "faults": _faults(mesh),
        "open_edges": stages.sections.open_edges,
        "n_gaps": len(stages.sections.gaps),
        "gaps": gaps,
    }


def _begins_at(program: Program) -> float:
    """Z of the bottom of the first layer that holds a bead of the part itself, mm; 0 on the bed."""
    of_part = program.role > Role.BRIM
    return round(float(program.plan.bottom[program.layer[of_part].min()]), 4) if of_part.any() else 0.0


def _faults(mesh: Mesh) -> dict[str, Any]:
    """How many edges are open, flipped or crowded, and where the first ones are."""
    faults = mesh_faults(mesh)
    named = {"open": faults.open_edges, "flipped": faults.flipped_edges, "crowded": faults.crowded_edges}
    return {
        name: {"count": len(places), "places": np.round(places[:_MOST_PLACES], 4).tolist()}
        for name, places in named.items()
        if len(places)
    }


def sentences(facts: dict[str, Any], changes: list[str]) -> list[str]:
    """The facts for people: first what was made, then everything that deserves a look.

    Args:
        facts: of `facts_of`.
        changes: settings changed on the command line.
    """
    metres, grams = facts["filament_mm"] / 1000, facts["filament_g"]
    lines = [
        f"{facts['layers']} layers ({runs_text(facts['heights'])})",
        f"{spoken(facts['seconds'])} of printing, {metres:.2f} m of filament, {grams} g",
    ]
    if facts["planner"] != "uniform" and any(
        change.removeprefix("quality.").startswith("layer_height") for change in changes
    ):
        lines.append(f"layer_height was not used: {facts['planner']} chooses heights; try --planner uniform")
    if facts["empty_layers"]:
        many = "1 layer stays" if facts["empty_layers"] == 1 else f"{facts['empty_layers']} layers stay"
        lines.append(f"{many} empty: the part is narrower than a bead there")
    if facts["begins_at"]:
        lines.append(
            f"the part begins in the air, at z {facts['begins_at']:g}: nothing of it reaches the bed"
        )
    if facts["skirt_left_out"]:
        lines.append(
            "the skirt does not fit on the bed beside the part and is left out; mind lines that prime there"
        )
    if facts["lost_mm3"] > _WORTH_SAYING * facts["volume_mm3"]:
        lines.append(
            f"{facts['lost_mm3']} mm3 of the part are too narrow for beads of this width and stay empty"
        )
    return lines + _fault_sentences(facts)


def _fault_sentences(facts: dict[str, Any]) -> list[str]:
    """What is wrong with the mesh, and where."""
    meaning = {
        "open": "the mesh is not closed: {} edges have a facet on one side only",
        "flipped": "the mesh is not oriented: {} edges lie between facets that face opposite ways",
        "crowded": "the mesh is not a simple surface: {} edges are shared by more than two facets",
    }
    lines = []
    for name, fault in facts["faults"].items():
        x, y, z = fault["places"][0]
        lines.append(f"{meaning[name].format(fault['count'])}, the first at x {x:g} y {y:g} z {z:g}")
    if facts["n_gaps"]:
        gap = facts["gaps"][0]
        place = f"x {gap['x']:g} y {gap['y']:g} z {gap['z']:g}"
        lines.append(
            f"{facts['n_gaps']} gaps in contours were closed, the widest of {gap['width']:.3g} mm at {place}"
        )
    return lines


def runs_text(runs: list[tuple[int, float]] | list[list[float]]) -> str:
    """`75 x 0.4, 225 x 0.1 mm`, shortened when there are many."""
    if len(runs) > _MOST_RUNS:
        heights = [height for _, height in runs]
        return f"{len(set(heights))} heights from {min(heights):g} to {max(heights):g} mm"
    return ", ".join(f"{count:g} x {height:g}" for count, height in runs) + " mm"
