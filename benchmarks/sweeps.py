"""List the planners and peers that take part, and their settings."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from time import process_time

import numpy as np

from benchmarks.curves import Row
from benchmarks.peers import CuraEngine, Part, Printed, PrusaSlicer
from benchmarks.scoring import Judge
from printer_slicer.model import LayerPlan
from printer_slicer.planning import PLANNERS, plan_layers
from printer_slicer.profile import Profile, profile_with

__all__ = ["OPTIMAL", "USUAL", "Attempt", "attempts", "our_row", "peer_attempts", "peer_row"]

OPTIMAL = ("optimal", "optimal, any error", "optimal, any flats", "optimal, N layers")
"""Families whose plans form our curve."""

USUAL = {"PrusaSlicer adaptive": "adaptive 0.5", "Cura adaptive": "adaptive 0.2/0.01"}
"""Default settings of the peers."""

_PRICES = (1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0, 128.0, 512.0)  # s/mm³
_LOW_PRICES = (0.01, 0.1, 0.3, 1.0, 4.0, 16.0)  # flats may be missed to save time
_COUNTS = (0.7, 0.8, 0.9, 1.0, 1.2)  # shares of the number of layers at nominal height
_METRICS = ("cusp", "triangle", "wasserfall", "topography")
_QUALITIES = (0.0, 0.25, 0.5, 0.75, 1.0)
_THRESHOLDS = (0.05, 0.1, 0.2, 0.4)  # mm


@dataclass(frozen=True, slots=True)
class Attempt:
    """One of our planners with settings.

    Attributes:
        family: a line of the picture.
        setting: name of the settings.
        changes: changes of the profile.
    """

    family: str
    setting: str
    changes: Mapping[str, object]


def attempts(part: Part, *, quick: bool) -> list[Attempt]:
    """Return every planner with settings over the range where plans can be compared."""
    found = [*_simple_planners(part.profile), *_planners_by_tolerance(part.profile), *_optimal_planners(part)]
    found = [attempt for attempt in found if attempt.changes["quality.planner.kind"] in PLANNERS]
    return [attempt for attempt in found if attempt.family in OPTIMAL or not quick]


def _heights(profile: Profile) -> list[float]:
    """Return uniform layer heights over the range, mm."""
    evenly = np.linspace(profile.thinnest, profile.thickest, 5).round(2)
    return sorted({profile.quality.layer_height, *evenly.tolist()})


def _simple_planners(profile: Profile) -> Iterator[Attempt]:
    for height in _heights(profile):
        changes = {"quality.planner.kind": "uniform", "quality.layer_height": height}
        yield Attempt("uniform", f"{height:g} mm", changes)
    areas = {"kind": "area", "aligned": True, "guarded": True, "relative_tolerance": 0.0005}
    yield Attempt("area", "aligned, guarded", _planner(areas))


def _planners_by_tolerance(profile: Profile) -> Iterator[Attempt]:
    """Return planners with one parameter, from what the thinnest layers reach to what the thickest cannot miss."""
    layer_tolerances = np.geomspace(profile.thinnest / 2, profile.thickest / 2, 4).round(3).tolist()
    kinds: list[dict[str, object]] = [{"kind": "cusp", "metric": metric} for metric in _METRICS]
    kinds += [{"kind": "stepwise"}, {"kind": "genetic"}]
    for settings in kinds:
        family = " ".join(str(value) for value in settings.values())
        # A random search takes long, so there is one plan only.
        for tolerance in layer_tolerances if family != "genetic" else [profile.quality.tolerance]:
            changes = _planner(settings) | {"quality.tolerance": tolerance}
            yield Attempt(family, f"tolerance {tolerance:g}", changes)


def _optimal_planners(part: Part) -> Iterator[Attempt]:
    profile, (asked, free, unsnapped, counted) = part.profile, OPTIMAL
    # The error of a layer that is cut in its middle is at most half of its height.
    loose = {"quality.tolerance": profile.thickest / 2}
    for price in _PRICES:
        changes = _planner({"kind": "optimal", "error_price": price})
        yield Attempt(asked, f"{price:g} s/mm³", changes)
        yield Attempt(free, f"{price:g} s/mm³", changes | loose)
    for price in _LOW_PRICES:
        changes = _planner({"kind": "optimal", "error_price": price, "snap_tolerance": 1.0})
        yield Attempt(unsnapped, f"{price:g} s/mm³", changes | loose)
    usual = part.mesh.height / profile.quality.layer_height
    for share in _COUNTS:
        count = round(share * usual)
        changes = _planner({"kind": "optimal", "objective": "volume", "max_layers": count}) | loose
        if count * profile.thickest >= part.mesh.height:
            yield Attempt(counted, f"{count}", changes)


def _planner(settings: Mapping[str, object]) -> dict[str, object]:
    return {f"quality.planner.{key}": value for key, value in settings.items()}


def our_row(judge: Judge, attempt: Attempt, prusa: PrusaSlicer | None) -> Row:
    """Plan and score; if PrusaSlicer is given, let it print the same layers.

    Raises:
        PrinterSlicerError: the plan cannot be made.
        RunError: PrusaSlicer failed.
    """
    part = judge.part
    profile = profile_with(part.profile, attempt.changes)
    begun = process_time()
    plan = plan_layers(part.mesh, profile)
    cpu = process_time() - begun
    score = judge.score(plan)
    fed = prusa.stack(part, plan) if prusa else None
    return Row(
        attempt.family,
        attempt.setting,
        plan,
        score,
        ours=True,
        own_minutes=score.minutes,
        prusa_minutes=fed.seconds / 60 if fed else None,
        cpu=cpu,
        strayed=_largest_height_error(plan, fed.plan) if fed else None,
        dropped=plan.n_layers - fed.plan.n_layers if fed else None,
    )


def _largest_height_error(plan: LayerPlan, printed: LayerPlan) -> float:
    """Return the largest distance, mm, of a printed layer from the nearest one of the plan."""
    return float(np.abs(printed.top[:, None] - plan.top).min(axis=1).max())


def peer_attempts(
    part: Part, prusa: PrusaSlicer | None, cura: CuraEngine | None, *, quick: bool
) -> list[tuple[str, Callable[[], Printed]]]:
    """Yield (family, function that runs it) for every peer and setting."""
    heights = [part.profile.quality.layer_height] if quick else _heights(part.profile)
    found: list[tuple[str, Callable[[], Printed]]] = []
    if prusa:
        found += _run_each("PrusaSlicer uniform", lambda height: prusa.uniform(part, height), heights)
        qualities = _QUALITIES[2:] if quick else _QUALITIES
        found += _run_each("PrusaSlicer adaptive", lambda quality: prusa.adaptive(part, quality), qualities)
    if cura:
        found += _run_each("Cura uniform", lambda height: cura.uniform(part, height), heights)
        thresholds = _THRESHOLDS[2:] if quick else _THRESHOLDS
        found += _run_each("Cura adaptive", lambda threshold: cura.adaptive(part, threshold), thresholds)
    return found


def _run_each(
    family: str, run: Callable[[float], Printed], values: Sequence[float]
) -> list[tuple[str, Callable[[], Printed]]]:
    return [(family, lambda value=value: run(value)) for value in values]  # type: ignore[misc]


def peer_row(judge: Judge, family: str, printed: Printed) -> Row:
    """Score a plan that a peer printed."""
    plan = judge.extend_to_top(printed.plan)
    minutes = printed.seconds / 60
    return Row(
        family,
        printed.setting,
        plan,
        judge.score(plan),
        ours=False,
        own_minutes=minutes,
        prusa_minutes=minutes if family.startswith("PrusaSlicer") else None,
    )
