"""List the constraints that a plan violates: where, by how much, and why."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final, Literal

import numpy as np

from printer_slicer.arrays import Bool
from printer_slicer.model import Mesh
from printer_slicer.planning.height_grid import FINEST
from printer_slicer.planning.z_steps import layer_tolerances
from printer_slicer.profile import HeightRange, Profile
from printer_slicer.surface import Certificate, find_flats
from printer_slicer.values import Struct

__all__ = ["PlanViolation", "find_violations"]

_ROUNDING: Final = 1e-6  # mm
_CAUSE_UNDIVIDED: Final = "the allowed heights do not divide the space between flats more finely"
_CAUSE_UNREACHED: Final = "no allowed layer heights add up to this height within the tolerance"
_UNGUARANTEED: Final = ("uniform", "area")  # planners that guarantee neither tolerance nor flats


class PlanViolation(Struct, frozen=True):
    """A constraint that a plan violates.

    Attributes:
        rule: "tolerance", "flat", "max_step", "range height", "range end" or "range".
        low, high: z interval, mm; equal for a plane.
        amount: mm: the certified deviation, the distance to a flat or range end, or the difference of heights.
        cause: the reason, as the rest of a sentence.
    """

    rule: Literal["tolerance", "flat", "max_step", "range height", "range end", "range"]
    low: float
    high: float
    amount: float
    cause: str


def find_violations(mesh: Mesh, certificate: Certificate, profile: Profile) -> list[PlanViolation]:
    """Find all constraints of the profile that a plan violates, sorted by constraint, then from the bed up.

    Args:
        mesh: the placed part.
        certificate: certificate of the plan.
        profile: the profile it was planned with.
    """
    plan = _PlanCheck(mesh, certificate, profile)
    blind = certificate.plan.planner in _UNGUARANTEED
    rules = (
        [plan.find_large_steps(), plan.find_missed_ranges()]
        if blind
        else [
            plan.find_deviations(),
            plan.find_missed_flats(),
            plan.find_large_steps(),
            plan.find_missed_ranges(),
        ]
    )
    return [violation for found in rules for violation in found]


class _PlanCheck:
    """Compares a plan with the settings from which it was made."""

    def __init__(self, mesh: Mesh, certificate: Certificate, profile: Profile) -> None:
        self._settings = profile.dials
        self._mesh, self._certificate, self._profile = mesh, certificate, profile
        self._plan, self._first = certificate.plan, profile.quality.first_layer_height
        share = 0.5 if self._plan.containment == "mid" else 1.0
        self._share, self._near = share, share * max(profile.printer.z_step, FINEST) + _ROUNDING

    def find_deviations(self) -> Iterator[PlanViolation]:
        """Yield layers whose certified deviation exceeds the tolerance."""
        plan, bound = self._plan, self._certificate.bound
        over = bound > layer_tolerances(self._profile, plan.bottom, plan.top) + _ROUNDING
        causes = [self._explain_thick_layer(i) if over[i] else "" for i in range(plan.n_layers)]
        # Thinnest layers, and layers between them that meet flats, form one run.
        kinds = ["thin" if cause in (self._thinnest_cause, _CAUSE_UNDIVIDED) else cause for cause in causes]
        for first, end in _find_runs(over, kinds):
            low, high = float(plan.bottom[first]), float(plan.top[end - 1])
            worst = first + int(bound[first:end].argmax())
            yield PlanViolation("tolerance", low, high, float(bound[worst]), causes[worst])
        missing = self._certificate.missing
        if missing > self._profile.quality.tolerance + _ROUNDING:
            top = float(plan.top[-1])
            yield PlanViolation("tolerance", top, top + missing, missing, "no printable layer fits there")

    def find_missed_flats(self) -> Iterator[PlanViolation]:
        """Yield flats on which no layer ends."""
        ends, flats = np.append(self._plan.bottom[:1], self._plan.top), find_flats(self._mesh)[0]
        off = np.abs(ends[:, None] - flats).min(axis=0) if len(flats) else np.zeros(0)
        missed = off > max(self._settings.snap_tolerance, self._near, FINEST) + _ROUNDING
        met = np.concatenate([[0.0, self._first, self._mesh.height], flats[~missed]])
        for z, far in zip(flats[missed].tolist(), off[missed].tolist(), strict=True):
            other = float(met[np.abs(met - z).argmin()])
            thinnest = self._profile.printer.min_layer
            near = abs(other - z) < thinnest - self._near
            there = "the first layer" if 0 < other == self._first else f"z {other:g}"
            between = (
                f"the flat is less than the printer's thinnest layer, {thinnest:g} mm, away from {there}"
            )
            yield PlanViolation("flat", z, z, far, between if near else self._explain_interval(z, z))

    def find_large_steps(self) -> Iterator[PlanViolation]:
        """Yield neighbouring layers whose heights differ by more than `max_step`."""
        most, height = self._settings.max_step, self._plan.height
        change = np.abs(np.diff(height))
        for i in np.flatnonzero(change > most + _ROUNDING).tolist() if most else ():
            z = float(self._plan.top[i])
            yield PlanViolation(
                "max_step", z, z, float(change[i]), "flats, tolerance and allowed heights have priority"
            )

    def find_missed_ranges(self) -> Iterator[PlanViolation]:
        """Yield height ranges above the part, and those whose layer height or ends the plan does not meet."""
        plan, top = self._plan, self._mesh.height
        for height_range in self._settings.ranges:
            if height_range.low >= top:
                yield PlanViolation(
                    "range", height_range.low, height_range.high, 0.0, f"the part is {top:g} mm high"
                )
                continue
            for z in (height_range.low, height_range.high):
                off = float(np.abs(np.append(0.0, plan.top) - z).min())
                if 0 < z < top and off > self._near:
                    asked = f"layers of {height_range.layer_height:g} mm do not add up to this height"
                    why = self._explain_first_layer(z, z) or (
                        asked if height_range.layer_height else _CAUSE_UNREACHED
                    )
                    yield PlanViolation("range end", z, z, off, why)
            other = np.abs(plan.height - height_range.layer_height) > _ROUNDING
            other &= self._overlaps(height_range) & (height_range.layer_height > 0)
            causes = [self._explain_other_height(i, height_range) for i in range(plan.n_layers)]
            for first, end in _find_runs(other, causes):
                low, high = float(plan.bottom[first]), float(plan.top[end - 1])
                far = float(np.abs(plan.height[first:end] - height_range.layer_height).max())
                yield PlanViolation("range height", low, high, far, causes[first])

    def _overlaps(self, height_range: HeightRange) -> Bool:
        """Return which layers (L,) overlap a range."""
        plan = self._plan
        return np.asarray(
            (plan.top > height_range.low + self._near) & (plan.bottom < height_range.high - self._near)
        )

    @property
    def _thinnest_cause(self) -> str:
        """Return the cause of a violation by the thinnest layers."""
        thinnest = self._profile.thinnest
        return (
            f"layers of {thinnest:g} mm, the thinnest allowed, can deviate by {self._share * thinnest:g} mm"
        )

    def _explain_thick_layer(self, layer: int) -> str:
        """Return the cause of a layer that is too thick for the tolerance."""
        plan = self._plan
        if plan.height[layer] <= self._profile.thinnest + _ROUNDING:
            return self._thinnest_cause
        asked = self._explain_interval(float(plan.bottom[layer]), float(plan.top[layer]), otherwise="")
        if asked:
            return asked
        if plan.planner != "optimal":
            return f"planner {plan.planner!r} limits another measure of the deviation"
        return _CAUSE_UNDIVIDED

    def _explain_other_height(self, layer: int, height_range: HeightRange) -> str:
        """Return the cause of a layer that does not have the height of its range."""
        first = self._explain_first_layer(float(self._plan.bottom[layer]), float(self._plan.top[layer]))
        few = self._settings.max_layers
        cause = f"layers of {height_range.layer_height:g} mm do not end where the part or the range does"
        return first or (f"no more than {few} layers are allowed" if few else cause)

    def _explain_first_layer(self, low: float, high: float) -> str:
        """Return the cause of a violation in a z interval within a fixed first layer; empty for other intervals."""
        inside = self._first and low < self._first - _ROUNDING and high <= self._first + _ROUNDING
        return f"the first layer is set to {self._first:g} mm" if inside else ""

    def _explain_interval(
        self,
        low: float,
        high: float,
        otherwise: str = _CAUSE_UNREACHED,
    ) -> str:
        """Return the setting that determines the layers in a z interval as the cause; `otherwise` if there is none."""
        if first := self._explain_first_layer(low, high):
            return first
        for height_range in self._settings.ranges:
            if (
                height_range.layer_height
                and low < height_range.high - _ROUNDING
                and high > height_range.low + _ROUNDING
            ):
                asked = f"{height_range.layer_height:g} mm"
                return f"the range from {height_range.low:g} to {height_range.high:g} sets layers of {asked}"
        if self._settings.max_layers:
            return f"no more than {self._settings.max_layers} layers are allowed"
        return otherwise


def _find_runs(selected: Bool, causes: list[str]) -> Iterator[tuple[int, int]]:
    """Yield (first, end) of each run of selected layers with the same cause."""
    first = 0
    for i in range(1, len(selected) + 1):
        if i == len(selected) or selected[i] != selected[first] or causes[i] != causes[first]:
            if selected[first]:
                yield first, i
            first = i
