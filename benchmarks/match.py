"""A peer's plan against ours on its own terms: the fewest layers with no larger error and volume error."""

from __future__ import annotations

from dataclasses import dataclass

from benchmarks.curves import Row
from benchmarks.scoring import Judge
from printer_slicer.errors import PlanError
from printer_slicer.model import LayerPlan
from printer_slicer.planning import plan_layers
from printer_slicer.profile import profile_with

__all__ = ["Match", "match"]

_EQUAL = 2e-5  # mm; a planner keeps this much away from its tolerance
_FINER = 0.001  # mm
_NO_VOLUME = 1e-6  # mm³; less is rounding
_MOST = 1.5  # times the peer's layers: with more the search is given up
_LEAST_TOLERANCE, _WIDEST = 0.001, 1.0  # mm, what the settings allow


@dataclass(frozen=True, slots=True)
class Match:
    """Ours against one plan of a peer.

    Attributes:
        family: the peer.
        setting: how it was set.
        layers: of the peer.
        bound: certified error of the peer's plan, mm; ours has no more.
        volume: certified volume error of the peer's plan, mm³; ours has no more.
        our_layers: fewest that do; None if none were found.
        volume_ratio: our volume error with as many layers, by the peer's; None if there is no such plan.
        minutes: of the peer's layers by our toolpaths.
        our_minutes: of our fewest layers.
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


def match(judge: Judge, row: Row) -> Match:
    """The fewest layers at a peer's own errors, and the least volume error with its number of layers."""
    # The peers' heights are on no printer's lattice; where ours need more layers, a finer lattice is tried.
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
    """Plans with the errors that a peer's plan has."""

    def __init__(self, judge: Judge, row: Row, step: float) -> None:
        self._judge, self._score = judge, row.score
        self._base: dict[str, object] = {
            "quality.planner.kind": "optimal",
            "quality.tolerance": min(max(row.score.bound + _EQUAL / 2, _LEAST_TOLERANCE), 2.0),
            # The peers choose among all heights; so do we, step by step.
            "printer.z_step": step,
            "quality.layer_step": step,
            # Flats are met by default; on the peer's terms they may be missed as far as it misses them.
            "quality.planner.snap_tolerance": min(row.score.worst_flat, _WIDEST),
        }

    def plan(self, most: int = 0) -> LayerPlan | None:
        """Least volume error with at most so many layers, or the fewest layers with 0; None if impossible."""
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
        """The fewest layers with no more error; more layers never have a larger volume error, so halving works."""
        least = self.plan()
        if least is None:
            return None
        low, high = least.n_layers - 1, self._score.layers
        best = self._good(high)
        while best is None and high < _MOST * self._score.layers:
            low, high = high, high + max(high // 20, 1)
            best = self._good(high)
        while best is not None and high - low > 1:
            middle = (low + high) // 2
            found = self._good(middle)
            best, low, high = (found, low, middle) if found else (best, middle, high)
        return best

    def _good(self, count: int) -> LayerPlan | None:
        plan = self.plan(count)
        fits = plan and self._judge.certificate(plan).volume_error <= self._score.volume + _NO_VOLUME
        return plan if fits else None
