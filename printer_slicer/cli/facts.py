"""What people want to know about a sliced part, as values and as sentences."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import numpy as np

from printer_slicer.arrays import Float, Int, distinct
from printer_slicer.model import LayerPlan, Mesh, Repairs
from printer_slicer.planning.violations import find_violations
from printer_slicer.planning.z_steps import layer_tolerances
from printer_slicer.profile import Profile
from printer_slicer.roles import Role, roles_with
from printer_slicer.slicing import find_mesh_faults
from printer_slicer.stages import Stages
from printer_slicer.surface import Certificate, find_flats
from printer_slicer.texts import format_duration

__all__ = [
    "certificate_facts",
    "certificate_sentences",
    "facts_of",
    "flats_off",
    "repair_facts",
    "repair_sentences",
    "runs_text",
    "sentences",
    "unkept_sentences",
]

_WORTH_SAYING = 0.002  # share of the part
_WORTH_MENTION = 0.01  # mm²
_MOST_RUNS = 6  # stretches of equal height shown per plan
_MOST_PLACES = 10


def facts_of(stages: Stages, profile: Profile, seconds: float, certificate: Certificate) -> dict[str, Any]:
    """Everything worth knowing, ready for JSON; places as scaled and turned, before the plate is moved to the bed.

    Args:
        stages: the sliced part.
        profile: what it was sliced with.
        seconds: modelled time of the moves.
        certificate: of the plan.
    """
    program, plan = stages.program, stages.sections.plan
    area = np.pi * profile.material.filament_diameter**2 / 4
    return {
        "layers": plan.n_layers,
        "planner": plan.planner,
        "heights": [[count, height] for count, height in plan.runs()],
        "raft": _raft_facts(stages),
        "seconds": round(seconds, 3),
        "filament_mm": round(program.filament_used, 3),
        "filament_g": round(program.filament_used * area / 1000 * profile.material.density, 3),
        "moves": program.n_moves,
        "link": asdict(stages.link) if stages.link else None,
        "volume_mm3": round(_volume(stages, certificate), 3),
        "lost_mm3": round(float((stages.walls.lost * plan.height).sum()), 3),
        "empty_layers": plan.n_layers - len(_filled_layers(stages)),
        "begins_at": _begins_at(stages),
        **_adhesion_facts(stages, profile),
        "faults": {} if stages.repairs.sound else _faults(stages.part, stages.shift),
        "open_edges": stages.sections.open_edges,
        "repairs": repair_facts(stages.repairs),
        "certificate": certificate_facts(certificate, stages.part, profile, stages.shift, seconds),
    }


def _adhesion_facts(stages: Stages, profile: Profile) -> dict[str, Any]:
    """How much of the skirt that was asked for has no room on the bed, and which type of brim has no place."""
    paths, program, quality = stages.toolpaths, stages.program, profile.quality
    loops = int(((paths.role == Role.SKIRT) & (paths.layer == 0)).sum())
    fed = float(program.filament[(program.role == Role.SKIRT) & (program.layer == 0)].sum())
    brim = (paths.role == Role.BRIM).any()
    short = quality.skirt_min_length - fed if quality.skirt_loops else 0.0
    return {
        "skirt_left_out": bool(quality.skirt_loops) and not loops,
        "skirt_loops_left_out": max(quality.skirt_loops - loops, 0),
        "skirt_short_mm": round(max(short, 0.0), 3),
        "brim_left_out": quality.brim_type if quality.brim_width and not brim else None,
    }


def _raft_facts(stages: Stages) -> dict[str, Any] | None:
    """Layer heights of the raft, and the air over it; None without one."""
    plan, printed = stages.sections.plan, stages.program.plan
    n_below = printed.n_layers - plan.n_layers
    if not n_below:
        return None
    gap = float(printed.top[-1] - plan.top[-1] - printed.top[n_below - 1])
    return {"heights": printed.height[:n_below].tolist(), "gap_mm": round(gap, 6)}


def _filled_layers(stages: Stages) -> Int:
    """The layers of the part's plan that hold beads of the part itself, ascending."""
    program = stages.program
    n_below = program.plan.n_layers - stages.sections.plan.n_layers
    return distinct(program.layer[roles_with(is_part=True)[program.role]]) - n_below


def _begins_at(stages: Stages) -> float:
    """Bottom of the first layer that holds a bead of the part itself, mm over the bed or the raft."""
    filled = _filled_layers(stages)
    return round(float(stages.sections.plan.bottom[filled[0]]), 4) if len(filled) else 0.0


def _faults(part: Mesh, shift: Float) -> dict[str, Any]:
    """How many edges are open, flipped or crowded, and where the first ones are."""
    faults = find_mesh_faults(part)
    named = {"open": faults.open_edges, "flipped": faults.flipped_edges, "crowded": faults.crowded_edges}
    return {
        name: {"count": len(places), "places": np.round(places[:_MOST_PLACES] + shift, 4).tolist()}
        for name, places in named.items()
        if len(places)
    }


def sentences(facts: dict[str, Any]) -> list[str]:
    """The facts for people: first what was made, then everything that deserves a look.

    Args:
        facts: of `facts_of`.
    """
    metres, grams = facts["filament_mm"] / 1000, facts["filament_g"]
    lines = [
        f"{facts['layers']} layers ({runs_text(facts['heights'])})" + _raft_text(facts["raft"]),
        f"{format_duration(facts['seconds'])} of printing, {metres:.2f} m of filament, {grams} g",
    ]
    first = certificate_sentences(facts["certificate"])[0]
    lines += [first, *unkept_sentences(facts["certificate"])]
    if facts["empty_layers"]:
        many = "1 layer stays" if facts["empty_layers"] == 1 else f"{facts['empty_layers']} layers stay"
        lines.append(f"{many} empty: the part is narrower than a bead there")
    if facts["begins_at"]:
        lines.append(
            f"the part begins in the air, at z {facts['begins_at']:g}: nothing of it reaches the bed"
        )
    lines += _link_sentences(facts["link"])
    lines += _skirt_sentences(facts)
    if facts["brim_left_out"]:
        where = {"inner": "holes", "ears": "sharp corners"}.get(facts["brim_left_out"], "section")
        lines.append(f"there is no brim: the first layer has no {where}")
    if facts["lost_mm3"] > _WORTH_SAYING * facts["volume_mm3"]:
        lines.append(
            f"{facts['lost_mm3']} mm3 of the part are too narrow for beads of this width and stay empty"
        )
    return lines + repair_sentences(facts["repairs"]) + _fault_sentences(facts)


def _link_sentences(link: dict[str, Any] | None) -> list[str]:
    """What it took to stay under the lines per second of the link."""
    if not link or not link["layers"]:
        return []
    layers, rate = link["layers"], f"{link['lines_per_second']:g} lines/s"
    where = (
        f"layer {layers[0]}" if len(layers) == 1 else f"{len(layers)} layers, {layers[0]} to {layers[-1]},"
    )
    cost = f"{link['merged']} were merged, {link['slowed']} moves slowed down; {link['seconds']:+.1f} s"
    left = link["waits"]
    still = (
        [f"{len(left)} of them still have, for nothing there can be slower: macros say too much"]
        if left
        else []
    )
    return [f"{where} had more lines than {rate}: {cost}", *still]


def _volume(stages: Stages, certificate: Certificate) -> float:
    """Mm³ of the part: by its facets; by its sections where bodies overlap or the surface is open.

    Those are all that can make the two differ by more than the layers have wrong.
    """
    by_facets, heights = stages.part.volume, stages.sections.plan.height
    by_sections = float((stages.sections.solid.area() * heights).sum())
    explained = certificate.volume_error + 1e-3 * by_sections
    return by_facets if abs(by_facets - by_sections) <= explained else by_sections


def _raft_text(raft: dict[str, Any] | None) -> str:
    """What the part stands on, for people."""
    if raft is None:
        return ""
    heights = raft["heights"]
    return f" on a raft of {sum(heights):g} mm ({len(heights)} layers), {raft['gap_mm']:g} mm over it"


def _skirt_sentences(facts: dict[str, Any]) -> list[str]:
    """What of the skirt or draft shield is missing, for people."""
    if facts["skirt_left_out"]:
        return [
            "the skirt does not fit on the bed beside the part and is left out; mind lines that prime there"
        ]
    lines = []
    if facts["skirt_loops_left_out"]:
        lines.append(f"the bed has no room for {facts['skirt_loops_left_out']} of the skirt's loops")
    if facts["skirt_short_mm"] > _WORTH_MENTION:
        lines.append(
            f"the bed has no room for more of the skirt, which is {facts['skirt_short_mm']:g} mm of filament short"
        )
    return lines


def repair_facts(repairs: Repairs) -> list[dict[str, Any]]:
    """What was put right in a mesh, ready for JSON; lengths and places in mm, the parts as scaled and turned."""
    return [
        {
            "kind": one.kind,
            "count": one.count,
            "places": np.round(one.places[:_MOST_PLACES], 4).tolist(),
            "largest_gap_mm": round(one.widest, 6),
            "area_guessed_mm2": round(one.area, 4),
        }
        for one in repairs.done
    ]


def repair_sentences(facts: list[dict[str, Any]]) -> list[str]:
    """What was put right, for people.

    Args:
        facts: of `repair_facts`.
    """
    lines = []
    for fact in facts:
        x, y, z = fact["places"][0]
        line = f"repaired: {fact['kind']}: {fact['count']}, the first at x {x:g} y {y:g} z {z:g}"
        line += f"; the widest of {fact['largest_gap_mm']:.3g} mm" if fact["largest_gap_mm"] else ""
        area = fact["area_guessed_mm2"]
        lines.append(line + (f", {area:.4g} mm2 guessed" if area > _WORTH_MENTION else ""))
    return lines


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
    return lines


def flats_off(flats: Float, plan: LayerPlan) -> float:
    """The farthest that one of the flats at these heights (n,) is from the end of a layer, mm."""
    ends = np.append(plan.top, 0.0)
    return float(np.abs(ends[:, None] - flats).min(axis=0).max()) if len(flats) else 0.0


def certificate_facts(
    certificate: Certificate, part: Mesh, profile: Profile, shift: Float, seconds: float
) -> dict[str, Any]:
    """What is proven about a plan, ready for JSON.

    Args:
        certificate: of the plan.
        part: as it was placed.
        profile: what it was planned with.
        shift: (3,) mm from the placed part to where it was scaled and turned, in which places are told.
        seconds: modelled time of the moves.
    """
    worst, plan, tolerance = certificate.worst, certificate.plan, profile.quality.tolerance
    flats = find_flats(part)[0]
    place = np.round(np.add((worst.x, worst.y, worst.z), shift), 4)
    return {
        "planner": plan.planner,
        "containment": plan.containment,
        "layers": plan.n_layers,
        "thicknesses": len(set(plan.height.tolist())),
        "tolerance_mm": tolerance,
        "ranges": len(profile.dials.ranges),
        "max_error_mm": round(certificate.max_error, 6),
        "mean_error_mm": round(certificate.mean_error, 6),
        "volume_error_mm3": round(certificate.volume_error, 3),
        "volume_error_share": round(certificate.volume_error / max(part.volume, 1e-9), 6),
        "height_error_mm": round(certificate.overshoot - certificate.missing, 6),
        "flats": len(flats),
        "flat_error_mm": round(flats_off(flats, plan), 6),
        "worst": dict(zip("xyz", place.tolist(), strict=True))
        | {"layer": worst.layer + 1, "kind": worst.kind, "bound_mm": round(worst.bound, 6)},
        "over_tolerance": [
            {"from": round(low, 6), "to": round(high, 6), "bound_mm": round(bound, 6)}
            for low, high, bound in certificate.over(layer_tolerances(profile, plan.bottom, plan.top))
        ],
        "unkept": [
            {
                "rule": unkept.rule,
                "from": round(unkept.low, 6),
                "to": round(unkept.high, 6),
                "amount_mm": round(unkept.amount, 6),
                "cause": unkept.cause,
            }
            for unkept in find_violations(part, certificate, profile)
        ]
        + _budget_facts(profile, plan, seconds),
    }


def _budget_facts(profile: Profile, plan: LayerPlan, seconds: float) -> list[dict[str, Any]]:
    """The time budget as an unkept rule, where there is one and the moves take longer."""
    budget = profile.dials.time_budget
    if not 0 < budget < seconds:
        return []
    whole = {"rule": "time_budget", "from": 0.0, "to": round(float(plan.top[-1]), 6)}
    cause = "the other rules and the heights allowed come first"
    return [whole | {"budget_s": budget, "amount_s": round(seconds - budget, 3), "cause": cause}]


_WHY = {
    "facet": "by a sloping facet",
    "flat": "by a flat that no layer ends on",
    "edge": "by an edge that is steeper than its facets",
    "corner": "by a peak or pit that no layer ends on",
    "top": "by the top of the part",
}


def certificate_sentences(facts: dict[str, Any]) -> list[str]:
    """The certificate for people: the bound first.

    Args:
        facts: of `certificate_facts`.
    """
    worst = facts["worst"]
    side = {"mid": "wrong", "positive": "too much", "negative": "missing"}[facts["containment"]]
    proven = f"certified error {facts['max_error_mm']:.4f} mm: nothing {side} is farther from the surface"
    lines = [f"{proven}; {facts['volume_error_mm3']:.1f} mm3 in all, at most"]
    many = f"{facts['layers']} layers of {facts['thicknesses']} heights"
    if worst["kind"] in _WHY:
        place = f"x {worst['x']:g} y {worst['y']:g} z {worst['z']:g}"
        lines.append(f"attained in layer {worst['layer']} at {place}, {_WHY[worst['kind']]}")
    share = 100 * facts["volume_error_share"]
    lines.append(
        f"{many}; mean error {facts['mean_error_mm']:.4f} mm, volume error {share:.2f} % of the part"
    )
    flats = f"flats over 1 mm2 ({facts['flats']}) by {facts['flat_error_mm']:.4f} mm at most"
    lines.append(f"top of the part off by {facts['height_error_mm']:.4f} mm, {flats}")
    thin = facts.get("thin_features", {"area_mm2": 0.0})
    if thin["area_mm2"] > _WORTH_MENTION:
        lines.append(
            f"edges and features of {thin['area_mm2']:.2f} mm2, seen from above, are thinner than the layers and come "
            f"out smaller or not at all, most of them near z {thin['z']:g}"
        )
    return lines + unkept_sentences(facts)


_BROKEN = {
    "tolerance": "over the tolerance{wanted} from z {from:g} to {to:g}: {amount_mm:.4f} mm",
    "flat": "the flat at z {from:g} is missed by {amount_mm:.4f} mm",
    "max_step": "neighbours at z {from:g} differ by {amount_mm:g} mm, more than max_step",
    "range height": "from z {from:g} to {to:g} layers differ by {amount_mm:g} mm from the height of their range",
    "range end": "no layer ends at z {from:g}, the end of a range, by {amount_mm:.4f} mm",
    "range": "nothing of the range from z {from:g} to {to:g} is in the part",
}


def unkept_sentences(facts: dict[str, Any]) -> list[str]:
    """The rules that the plan could not keep, for people.

    Args:
        facts: of `certificate_facts`.
    """
    wanted = "" if facts["ranges"] else f" of {facts['tolerance_mm']:g} mm"
    budgets = [one for one in facts["unkept"] if one["rule"] == "time_budget"]
    lines = [
        f"the time budget of {format_duration(one['budget_s'])} is exceeded by "
        f"{format_duration(one['amount_s'])}; {one['cause']}"
        for one in budgets
    ]
    unkept = [one for one in facts["unkept"] if one["rule"] != "time_budget"]
    lines += [
        f"{_BROKEN[one['rule']].format(wanted=wanted, **one)}; {one['cause']}" for one in unkept[:_MOST_RUNS]
    ]
    if len(unkept) > _MOST_RUNS:
        lines.append(f"and {len(unkept) - _MOST_RUNS} more that --json lists")
    return lines


def runs_text(runs: list[tuple[int, float]] | list[list[float]]) -> str:
    """`75 x 0.4, 225 x 0.1 mm`, shortened when there are many."""
    if len(runs) > _MOST_RUNS:
        heights = [height for _, height in runs]
        return f"{len(set(heights))} heights from {min(heights):g} to {max(heights):g} mm"
    return ", ".join(f"{count:g} x {height:g}" for count, height in runs) + " mm"
