"""Present the results of slicing and planning a part, as facts for JSON and as sentences for people."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from printer_slicer.arrays import Float, Int, distinct
from printer_slicer.facts.overhangs import collect_overhang_facts, format_overhang_sentences
from printer_slicer.model import LayerPlan, Mesh, ObjectStack, Repairs
from printer_slicer.model.layers import SAME_TOP
from printer_slicer.planning.violations import find_violations
from printer_slicer.planning.z_steps import layer_tolerances
from printer_slicer.profile import Profile
from printer_slicer.roles import Role, roles_with
from printer_slicer.slicing import find_mesh_faults
from printer_slicer.stages import Stages
from printer_slicer.surface import Certificate, find_flats
from printer_slicer.texts import format_duration, format_significant
from printer_slicer.values import as_dict

__all__ = [
    "collect_certificate_facts",
    "collect_slicing_facts",
    "find_largest_flat_error",
    "format_certificate_sentences",
    "format_repair_sentences",
    "format_runs",
    "format_slicing_sentences",
    "format_violation_sentences",
    "list_repair_facts",
]

_LOST_SHARE = 0.002  # smallest share of the part's volume whose loss is reported
_SMALLEST_AREA = 0.01  # mm²; smaller areas are not reported
_SMALLEST_LENGTH = 0.01  # mm; smaller lengths are not reported
_MAX_RUNS = 6  # runs of equal layers shown per plan
_MAX_PLACES = 10  # positions listed per fault or repair


def collect_slicing_facts(
    stages: Stages, profile: Profile, seconds: float, certificate: Certificate
) -> dict[str, Any]:
    """Return the results of slicing for JSON; positions are those after scaling and rotating, not those on the bed.

    Args:
        stages: the sliced part.
        profile: the profile used for slicing.
        seconds: estimated time of the moves.
        certificate: the certificate of the layer plan.
    """
    program, plan = stages.program, stages.sections.plan
    area = profile.material.filament_area
    return {
        "layers": plan.n_layers,
        "planner": plan.planner,
        "heights": [[count, height] for count, height in plan.runs()],
        "raft": _collect_raft_facts(stages),
        "seconds": round(seconds, 3),
        "filament_mm": round(program.filament_used, 3),
        "filament_g": round(program.filament_used * area / 1000 * profile.material.density, 3),
        "moves": program.n_moves,
        "link": as_dict(stages.link) if stages.link else None,
        "volume_mm3": round(_compute_part_volume(stages, certificate), 3),
        "unfilled_mm3": (unfilled := round(float((stages.walls.lost * plan.height).sum()), 3)),
        "lost_mm3": unfilled,
        "empty_layers": plan.n_layers - len(_find_filled_layers(stages)),
        "lowest_extrusion_z": (lowest := _find_lowest_extrusion(stages)),
        "begins_at": lowest,
        **_collect_adhesion_facts(stages, profile),
        "overhangs": collect_overhang_facts(stages, profile),
        "supports": _collect_support_facts(stages, profile),
        "faults": {} if stages.repairs.sound else _collect_mesh_fault_facts(stages.part, stages.shift),
        "open_edges": stages.sections.open_edges,
        "repairs": list_repair_facts(stages.repairs),
        "certificate": collect_certificate_facts(certificate, stages.stacks, profile, stages.shift, seconds),
    }


def _collect_support_facts(stages: Stages, profile: Profile) -> dict[str, Any] | None:
    """Return the facts about supports, for JSON; None without supports."""
    if stages.supports is None:
        return None
    from printer_slicer.facts.supports import collect_support_facts  # noqa: PLC0415 - only with supports

    return collect_support_facts(stages, profile)


def _collect_adhesion_facts(stages: Stages, profile: Profile) -> dict[str, Any]:
    """Return how much of the requested skirt and brim is missing, for JSON."""
    paths, program, quality = stages.toolpaths, stages.program, profile.quality
    loops = int(((paths.role == Role.SKIRT) & (paths.layer == 0)).sum())
    fed = float(program.filament[(program.role == Role.SKIRT) & (program.layer == 0)].sum())
    brim = (paths.role == Role.BRIM).any()
    short = quality.skirt_min_length - fed if quality.skirt_loops else 0.0
    facts = {
        "skirt_omitted": bool(quality.skirt_loops) and not loops,
        "skirt_loops_omitted": max(quality.skirt_loops - loops, 0),
        "skirt_missing_mm": round(max(short, 0.0), 3),
        "brim_omitted": quality.brim_type if quality.brim_width and not brim else None,
    }
    return facts | {
        "skirt_left_out": facts["skirt_omitted"],
        "skirt_loops_left_out": facts["skirt_loops_omitted"],
        "skirt_short_mm": facts["skirt_missing_mm"],
        "brim_left_out": facts["brim_omitted"],
    }


def _collect_raft_facts(stages: Stages) -> dict[str, Any] | None:
    """Return the layer heights of the raft and its gap to the part, for JSON; None without a raft."""
    printed, lift = stages.program.plan, _find_lift(stages)
    first = printed.top[: int(np.append(printed.stack_starts, printed.n_layers)[1])]
    n_below = int(np.searchsorted(first, lift + SAME_TOP))
    if not n_below:
        return None
    gap = float(lift - printed.top[n_below - 1])
    return {"heights": printed.height[:n_below].tolist(), "gap_mm": round(gap, 6)}


def _find_filled_layers(stages: Stages) -> Int:
    """Return the layers of the part's plan that contain extrusions of the part itself, ascending."""
    program = stages.program
    filled = distinct(program.layer[roles_with(is_part=True)[program.role]])
    return distinct(stages.sections.plan.find_tops(program.plan.top[filled] - _find_lift(stages)))


def _find_lift(stages: Stages) -> float:
    """Return how far a raft raises the part, mm; 0 without one."""
    return stages.program.plan.highest - stages.sections.plan.highest


def _find_lowest_extrusion(stages: Stages) -> float:
    """Return the bottom of the lowest layer with extrusions of the part itself, mm above the bed or the raft."""
    filled = _find_filled_layers(stages)
    return round(float(stages.sections.plan.bottom[filled[0]]), 4) if len(filled) else 0.0


def _collect_mesh_fault_facts(part: Mesh, shift: Float) -> dict[str, Any]:
    """Return the number and the first positions of open, flipped and crowded edges of a mesh, for JSON."""
    faults = find_mesh_faults(part)
    named = {"open": faults.open_edges, "flipped": faults.flipped_edges, "crowded": faults.crowded_edges}
    return {
        name: {"count": len(places), "places": np.round(places[:_MAX_PLACES] + shift, 4).tolist()}
        for name, places in named.items()
        if len(places)
    }


def _format_time_and_filament(facts: dict[str, Any]) -> str:
    """Format print time and filament of the part."""
    metres, grams = format_significant(facts["filament_mm"] / 1000), format_significant(facts["filament_g"])
    return (
        f"Print time {format_duration(facts['seconds'])}; filament {metres} m, {grams} g "
        "(without start and end G-code, homing and heating)"
    )


def format_slicing_sentences(facts: dict[str, Any]) -> list[str]:
    """Format the results of slicing as sentences: first layers, time and filament, then warnings.

    Args:
        facts: the result of `collect_slicing_facts`.
    """
    lines = [
        f"{facts['layers']} layers ({format_runs(facts['heights'])})" + _format_raft(facts["raft"]),
        _format_time_and_filament(facts),
    ]
    first = format_certificate_sentences(facts["certificate"])[0]
    lines += [first, *_format_stack_sentences(facts["certificate"]["stacks"])]
    lines += format_violation_sentences(facts["certificate"])
    if facts["empty_layers"]:
        many = "1 layer is" if facts["empty_layers"] == 1 else f"{facts['empty_layers']} layers are"
        lines.append(f"{many} empty: the part is narrower than one extrusion there")
    if facts["lowest_extrusion_z"]:
        lines.append(
            f"The part does not touch the bed: its first extrusion starts at z {facts['lowest_extrusion_z']:g}"
        )
    lines += format_overhang_sentences(facts["overhangs"])
    if facts["supports"]:
        from printer_slicer.facts.supports import format_support_sentences  # noqa: PLC0415 - only with supports

        lines += format_support_sentences(facts["supports"])
    lines += _format_link_sentences(facts["link"])
    lines += _format_skirt_sentences(facts)
    if facts["brim_omitted"]:
        where = {"inner": "holes", "ears": "sharp corners"}.get(facts["brim_omitted"], "section")
        lines.append(f"No brim was made: the first layer has no {where}")
    if facts["unfilled_mm3"] > _LOST_SHARE * facts["volume_mm3"]:
        lines.append(
            f"{format_significant(facts['unfilled_mm3'])} mm³ of the part are narrower than one extrusion "
            "and stay empty"
        )
    return lines + format_repair_sentences(facts["repairs"]) + _format_mesh_fault_sentences(facts)


def _format_link_sentences(link: dict[str, Any] | None) -> list[str]:
    """Format how moves were merged and slowed down so that the serial link is fast enough for their lines."""
    if not link or not link["layers"]:
        return []
    layers, rate = link["layers"], f"{link['lines_per_second']:g} lines/s"
    where = (
        f"Layer {layers[0]}" if len(layers) == 1 else f"{len(layers)} layers from {layers[0]} to {layers[-1]}"
    )
    cost = f"{link['merged']} lines merged, {link['slowed']} moves slowed down, print time {link['seconds']:+.1f} s"
    left = link["waits"]
    still = (
        [f"{len(left)} of these layers still exceed this rate, because macros send too many lines"]
        if left
        else []
    )
    return [f"{where} exceeded {rate}: {cost}", *still]


def _compute_part_volume(stages: Stages, certificate: Certificate) -> float:
    """Return the volume of the part in mm³: from its facets, or from its sections if it is open or its bodies overlap.

    Only in these two cases do the volumes differ by more than the volume error of the layers.
    """
    by_facets, heights = stages.part.volume, stages.sections.plan.height
    if len(stages.stacks) > 1:  # layers of different objects overlap
        return by_facets
    by_sections = float((stages.sections.solid.area() * heights).sum())
    explained = certificate.volume_error + 1e-3 * by_sections
    return by_facets if abs(by_facets - by_sections) <= explained else by_sections


def _format_raft(raft: dict[str, Any] | None) -> str:
    """Format the height and the gap of the raft; return an empty text without one."""
    if raft is None:
        return ""
    heights = raft["heights"]
    return f" on a raft of {sum(heights):g} mm ({len(heights)} layers) with a gap of {raft['gap_mm']:g} mm"


def _format_skirt_sentences(facts: dict[str, Any]) -> list[str]:
    """Format which loops of the skirt or draft shield are missing, or how much of its length."""
    if facts["skirt_omitted"]:
        return [
            "The skirt is left out: the bed has no room for it; check that prime lines do not cross the part"
        ]
    lines = []
    if facts["skirt_loops_omitted"]:
        lines.append(f"Skirt loops left out because the bed has no room: {facts['skirt_loops_omitted']}")
    if facts["skirt_missing_mm"] > _SMALLEST_LENGTH:
        lines.append(
            f"The bed has no room for skirt_min_length: the skirt is {facts['skirt_missing_mm']:g} mm of filament short"
        )
    return lines


def list_repair_facts(repairs: Repairs) -> list[dict[str, Any]]:
    """Return the repairs of a mesh for JSON; lengths and positions in mm, after scaling and rotating."""
    return [
        {
            "kind": one.kind,
            "count": one.count,
            "places": np.round(one.places[:_MAX_PLACES], 4).tolist(),
            "largest_gap_mm": round(one.widest, 6),
            "area_guessed_mm2": round(one.area, 4),
        }
        for one in repairs.done
    ]


def format_repair_sentences(facts: list[dict[str, Any]]) -> list[str]:
    """Format the repairs of a mesh as sentences.

    Args:
        facts: the result of `list_repair_facts`.
    """
    lines = []
    for fact in facts:
        x, y, z = fact["places"][0]
        line = f"repaired: {fact['kind']}: {fact['count']}, first at x {x:g} y {y:g} z {z:g}"
        line += f"; largest gap {fact['largest_gap_mm']:.3g} mm" if fact["largest_gap_mm"] else ""
        area = fact["area_guessed_mm2"]
        lines.append(line + (f"; {area:.3g} mm² of surface filled in" if area > _SMALLEST_AREA else ""))
    return lines


def _format_mesh_fault_sentences(facts: dict[str, Any]) -> list[str]:
    """Format the faults of the mesh as sentences, each with its first position."""
    meaning = {
        "open": "The mesh is not closed: {} edges belong to only one facet",
        "flipped": "The mesh is not oriented: {} edges lie between facets that face opposite ways",
        "crowded": "The mesh is not manifold: {} edges are shared by more than two facets",
    }
    lines = []
    for name, fault in facts["faults"].items():
        x, y, z = fault["places"][0]
        lines.append(f"{meaning[name].format(fault['count'])}, first at x {x:g} y {y:g} z {z:g}")
    return lines


def find_largest_flat_error(flats: Float, plan: LayerPlan) -> float:
    """Return the largest distance between a flat surface and the layer boundary nearest to it, in mm.

    Args:
        flats: (n,) heights of the flats, mm.
        plan: the layer plan.
    """
    ends = np.append(plan.top, plan.bottom[:1])
    return float(np.abs(ends[:, None] - flats).min(axis=0).max()) if len(flats) else 0.0


def collect_certificate_facts(
    certificate: Certificate, stacks: Sequence[ObjectStack], profile: Profile, shift: Float, seconds: float
) -> dict[str, Any]:
    """Return the certificate of a layer plan for JSON.

    Args:
        certificate: the certificate of all stacks.
        stacks: the layer plans and their objects, placed on the bed.
        profile: the profile used for planning.
        shift: (3,) mm to add to positions on the bed, so that they refer to the part after scaling and rotating.
        seconds: estimated time of the moves.
    """
    worst, plan = certificate.worst, certificate.plan
    pairs = list(zip(certificate.parts or (certificate,), stacks, strict=True))
    flats = [find_flats(stack.mesh)[0] for stack in stacks]
    place = np.round(np.add((worst.x, worst.y, worst.z), shift), 4)
    return {
        "planner": plan.planner,
        "containment": plan.containment,
        "layers": plan.n_layers,
        "distinct_heights": len({height for stack in stacks for height in stack.plan.height.tolist()}),
        "tolerance_mm": profile.quality.tolerance,
        "ranges": len(profile.dials.ranges),
        "max_error_mm": round(certificate.max_error, 6),
        "mean_error_mm": round(certificate.mean_error, 6),
        "volume_error_mm3": round(certificate.volume_error, 3),
        "volume_error_ratio": round(
            certificate.volume_error / max(sum(stack.mesh.volume for stack in stacks), 1e-9), 6
        ),
        "height_error_mm": round(_find_height_error([one for one, _ in pairs]), 6),
        "flats": sum(map(len, flats)),
        "flat_error_mm": round(
            max(find_largest_flat_error(own, stack.plan) for own, stack in zip(flats, stacks, strict=True)), 6
        ),
        "worst": dict(zip("xyz", place.tolist(), strict=True))
        | {"layer": worst.layer, "kind": worst.kind, "bound_mm": round(worst.bound, 6)},
        "over_tolerance": [row for one, _ in pairs for row in _list_ranges_above(one, profile)],
        "violations": [row for one, stack in pairs for row in _list_violations(one, stack.mesh, profile)]
        + _list_budget_violations(profile, plan, seconds),
        "stacks": _collect_stack_facts(certificate),
    }


def _find_height_error(certificates: Sequence[Certificate]) -> float:
    """Return by how much, mm, the last layer of any stack extends above its objects, or below; the largest counts."""
    errors = [one.overshoot - one.missing for one in certificates]
    return max(errors, key=abs)


def _collect_stack_facts(certificate: Certificate) -> list[dict[str, Any]]:
    """Return the layers and the certificate of each stack for JSON."""
    if not certificate.parts:
        return []
    from printer_slicer.facts.stacks import collect_stack_facts  # noqa: PLC0415 - only with several stacks

    return collect_stack_facts(certificate)


def _format_stack_sentences(facts: list[dict[str, Any]]) -> list[str]:
    """Format layers and certificate of each stack."""
    if not facts:
        return []
    from printer_slicer.facts.stacks import format_stack_sentences  # noqa: PLC0415 - only with several stacks

    return format_stack_sentences(facts)


def _list_ranges_above(certificate: Certificate, profile: Profile) -> list[dict[str, Any]]:
    """List the height ranges in which one stack exceeds the tolerance."""
    plan = certificate.plan
    tolerances = layer_tolerances(profile, plan.bottom, plan.top)
    return [
        _name_stack(certificate) | {"from": round(low, 6), "to": round(high, 6), "bound_mm": round(bound, 6)}
        for low, high, bound in certificate.ranges_above(tolerances)
    ]


def _list_violations(certificate: Certificate, mesh: Mesh, profile: Profile) -> list[dict[str, Any]]:
    """List the constraints that one stack violates."""
    return [
        _name_stack(certificate)
        | {
            "rule": violation.rule,
            "from": round(violation.low, 6),
            "to": round(violation.high, 6),
            "amount_mm": round(violation.amount, 6),
            "cause": violation.cause,
        }
        for violation in find_violations(mesh, certificate, profile)
    ]


def _name_stack(certificate: Certificate) -> dict[str, Any]:
    """Return the objects of a stack for JSON; nothing if there is only one stack."""
    return {"objects": certificate.name} if certificate.name else {}


def _list_budget_violations(profile: Profile, plan: LayerPlan, seconds: float) -> list[dict[str, Any]]:
    """List a violation of the time budget, if the moves take longer than the budget allows."""
    budget = profile.dials.time_budget
    if not 0 < budget < seconds:
        return []
    whole = {"rule": "time_budget", "from": 0.0, "to": round(float(plan.top[-1]), 6)}
    cause = "the other rules and the allowed heights take precedence"
    return [whole | {"budget_s": budget, "amount_s": round(seconds - budget, 3), "cause": cause}]


_DEVIATION_PLACES = {
    "facet": "on a sloping facet",
    "flat": "on a flat surface at which no layer ends",
    "edge": "at an edge that is steeper than its facets",
    "corner": "at a peak or pit at which no layer ends",
    "top": "at the top of the part",
}


def format_certificate_sentences(facts: dict[str, Any]) -> list[str]:
    """Format the certificate of a plan as sentences; the first one is the bound of the deviation.

    Args:
        facts: the result of `collect_certificate_facts`.
    """
    worst = facts["worst"]
    side = {"mid": "", "positive": " (excess material only)", "negative": " (missing material only)"}
    deviation = f"{format_significant(facts['max_error_mm'])} mm{side[facts['containment']]}"
    volume = f"{format_significant(facts['volume_error_mm3'])} mm³"
    lines = [f"Surface deviation at most {deviation}; volume error at most {volume}"]
    many = f"{facts['layers']} layers of {facts['distinct_heights']} heights"
    if worst["kind"] in _DEVIATION_PLACES:
        place = f"x {worst['x']:g} y {worst['y']:g} z {worst['z']:g}"
        lines.append(
            f"Largest deviation in layer {worst['layer']} at {place}, {_DEVIATION_PLACES[worst['kind']]}"
        )
    share = 100 * facts["volume_error_ratio"]
    mean = f"mean deviation {format_significant(facts['mean_error_mm'])} mm"
    lines.append(f"{many}; {mean}; volume error {share:.2f} % of the part")
    flats = f"{facts['flats']} flat surfaces over 1 mm² by at most {format_significant(facts['flat_error_mm'])} mm"
    lines.append(f"Part height off by {format_significant(facts['height_error_mm'])} mm; {flats}")
    thin = facts.get("thin_features", {"area_mm2": 0.0})
    if thin["area_mm2"] > _SMALLEST_AREA:
        lines.append(
            f"Features of {thin['area_mm2']:.2f} mm², seen from above, are thinner than a layer; they print too small "
            f"or not at all; most of them are near z {thin['z']:g}"
        )
    return [*lines, *_format_stack_sentences(facts["stacks"]), *format_violation_sentences(facts)]


_VIOLATION_TEXTS = {
    "tolerance": "From z {from:g} to {to:g} the deviation of {amount_mm:.4f} mm exceeds the tolerance{wanted}",
    "flat": "The flat surface at z {from:g} is {amount_mm:.4f} mm away from the nearest layer boundary",
    "max_step": "Neighbouring layers at z {from:g} differ by {amount_mm:g} mm, more than max_step",
    "range height": "From z {from:g} to {to:g} layers differ by {amount_mm:g} mm from the height of their range",
    "range end": "The end of a range at z {from:g} is {amount_mm:.4f} mm away from the nearest layer boundary",
    "range": "The range from z {from:g} to {to:g} does not contain any of the part",
}


def format_violation_sentences(facts: dict[str, Any]) -> list[str]:
    """Format the rules that the plan violates as sentences.

    Args:
        facts: the result of `collect_certificate_facts`.
    """
    wanted = "" if facts["ranges"] else f" of {facts['tolerance_mm']:g} mm"
    budgets = [one for one in facts["violations"] if one["rule"] == "time_budget"]
    lines = [
        f"The time budget of {format_duration(one['budget_s'])} is exceeded by "
        f"{format_duration(one['amount_s'])}; {one['cause']}"
        for one in budgets
    ]
    violations = [one for one in facts["violations"] if one["rule"] != "time_budget"]
    lines += [
        f"{one['objects'] + ': ' if 'objects' in one else ''}"
        f"{_VIOLATION_TEXTS[one['rule']].format(wanted=wanted, **one)}; {one['cause']}"
        for one in violations[:_MAX_RUNS]
    ]
    if len(violations) > _MAX_RUNS:
        lines.append(f"{len(violations) - _MAX_RUNS} more violated rules are in the JSON output")
    return lines


def format_runs(runs: list[tuple[int, float]] | list[list[float]]) -> str:
    """Format runs of equal layers as `75 x 0.4, 225 x 0.1 mm`, or as a range of heights if there are many runs."""
    if len(runs) > _MAX_RUNS:
        heights = [height for _, height in runs]
        return f"{len(set(heights))} heights from {min(heights):g} to {max(heights):g} mm"
    return ", ".join(f"{count:g} x {height:g}" for count, height in runs) + " mm"
