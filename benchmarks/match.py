"""Find our plan with the fewest layers whose errors are no larger than those of a peer's plan."""

from __future__ import annotations

from dataclasses import dataclass

from benchmarks.curves import Row
from benchmarks.scoring import Judge
from printer_slicer.errors import PlanError
from printer_slicer.model import LayerPlan
from printer_slicer.planning import plan_layers
from printer_slicer.profile import profile_with

__all__ = ["Match", "find_match"]

_EQUAL = 2e-5  # mm; margin that a planner keeps to its tolerance
_FINER = 0.001  # mm
_NO_VOLUME = 1e-6  # mm³; smaller differences are rounding errors
_MOST = 1.5  # times the peer's layers; the search ends at this number
_MIN_TOLERANCE, _WIDEST = 0.001, 1.0  # mm, the range of the setting


@dataclass(frozen=True, slots=True)
class Match:
    """Our plan compared with one plan of a peer.

    Attributes:
        family: the peer.
        setting: its settings.
        layers: number of layers of the peer.
        bound: certified error of the peer's plan, mm; the limit for ours.
        volume: certified volume error of the peer's plan, mm³; the limit for ours.
        our_layers: our fewest layers within these limits; None if no plan was found.
        volume_ratio: our volume error with as many layers, divided by the peer's; None if there is no such plan.
        minutes: minutes of the peer's layers with our toolpaths.
        our_minutes: minutes of our fewest layers.
    """

    family: str
    setting: str
    layers: int
    bound: float
    volume: float
    our_layers: int | None
    volume_ratio: float | None
    minutes: float
    our_minutes: float | None


def find_match(judge: Judge, row: Row) -> Match:
    """Return the fewest layers at a peer's own errors, and the least volume error with its number of layers."""
    # The peers' heights are not multiples of a z step. Where ours need more layers, a finer step is tried.
    for step in (judge.part.profile.printer.z_step, _FINER):
        terms = _Terms(judge, row, step)
        equal, fewest = terms.plan(row.score.layers), terms.fewest()
        if fewest and fewest.n_layers <= row.score.layers:
            break
    return Match(
        row.family,
        row.setting,
        row.score.layers,
        row.score.bound,
        row.score.volume,
        fewest.n_layers if fewest else None,
        judge.certificate(equal).volume_error / row.score.volume
        if equal and row.score.volume > _NO_VOLUME
        else None,
        row.score.minutes,
        judge.score(fewest).minutes if fewest else None,
    )


class _Terms:
    """Plans within the errors of a peer's plan."""

    def __init__(self, judge: Judge, row: Row, step: float) -> None:
        self._judge, self._score = judge, row.score
        self._base: dict[str, object] = {
            "quality.planner.kind": "optimal",
            "quality.tolerance": min(max(row.score.bound + _EQUAL / 2, _MIN_TOLERANCE), 2.0),
            # The peers choose among all heights; ours are all multiples of the step.
            "printer.z_step": step,
            "quality.layer_step": step,
            # Flats are met by default. Here, they may be missed by as much as the peer misses them.
            "quality.planner.snap_tolerance": min(row.score.worst_flat, _WIDEST),
        }

    def plan(self, most: int = 0) -> LayerPlan | None:
        """Return the least volume error with at most `most` layers, or the fewest layers if `most` is 0, or None."""
        dial: dict[str, object] = (
            {"quality.planner.max_layers": most} if most else {"quality.planner.objective": "layers"}
        )
        profile = profile_with(self._judge.part.profile, self._base | dial)
        try:
            plan = plan_layers(self._judge.part.mesh, profile)
        except PlanError:
            return None
        return plan if self._judge.certificate(plan).max_error <= self._score.bound + _EQUAL else None

    def fewest(self) -> LayerPlan | None:
        """Return the fewest layers with no more error.

        More layers never have a larger volume error, so bisection works.
        """
        least = self.plan()
        if least is None:
            return None
        low, high = least.n_layers - 1, self._score.layers
        best = self._has_errors_within(high)
        while best is None and high < _MOST * self._score.layers:
            low, high = high, high + max(high // 20, 1)
            best = self._has_errors_within(high)
        while best is not None and high - low > 1:
            middle = (low + high) // 2
            found = self._has_errors_within(middle)
            best, low, high = (found, low, middle) if found else (best, middle, high)
        return best

    def _has_errors_within(self, count: int) -> LayerPlan | None:
        plan = self.plan(count)
        fits = plan and self._judge.certificate(plan).volume_error <= self._score.volume + _NO_VOLUME
        return plan if fits else None
