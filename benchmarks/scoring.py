"""Score layer plans of all planners and slicers with the same functions."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from benchmarks.peers import Part
from printer_slicer.deviation import measure_deviation
from printer_slicer.extrusion import move_seconds
from printer_slicer.model import LayerPlan
from printer_slicer.pipeline import slice_stages
from printer_slicer.stages import Stages
from printer_slicer.surface import Certificate, Surface, certify, find_flats, read_surface

__all__ = ["Judge", "Score"]

_TIP = 1e-3  # mm that may be missing at the top without further checks


@dataclass(frozen=True, slots=True)
class Score:
    """Quality and cost of a plan. Lengths in mm.

    Attributes:
        layers: number of layers.
        minutes: modelled time of our toolpaths for this plan.
        mean: mean distance from points on the surface of the part to the surface of the stack.
        standard_error: sampling error of the mean.
        p95: the distance that 95 % of the points do not exceed.
        max: largest distance of the points.
        bound: certified deviation: no wrong point is farther from the surface.
        volume: certified bound of the volume error, mm³; it includes a missing top.
        worst_flat: largest distance of a flat of more than 1 mm² from the nearest end of a layer.
        top_error: height of the last layer's top above the top of the part.
    """

    layers: int
    minutes: float
    mean: float
    standard_error: float
    p95: float
    max: float
    bound: float
    volume: float
    worst_flat: float
    top_error: float


class Judge:
    """Scores plans for one part."""

    def __init__(self, part: Part, n_points: int) -> None:
        self.part = part
        self._n_points = n_points
        self._scores: dict[bytes, Score] = {}

    @cached_property
    def _surface(self) -> Surface:
        return read_surface(self.part.mesh)

    def certificate(self, plan: LayerPlan) -> Certificate:
        """Return the certificate of a plan."""
        return certify(self._surface, plan)

    def score(self, plan: LayerPlan) -> Score:
        """Slice the part with this plan and measure the result; each plan is measured once."""
        key = plan.top.tobytes() + plan.cut.tobytes()
        if key not in self._scores:
            self._scores[key] = self._measure(plan)
        return self._scores[key]

    def _measure(self, plan: LayerPlan) -> Score:
        mesh = self.part.mesh
        stages = self._slice(plan)
        distances = measure_deviation(mesh, stages.sections, self._n_points)
        certificate = self.certificate(plan)
        return Score(
            layers=plan.n_layers,
            minutes=float(move_seconds(stages.program, self.part.profile).sum()) / 60,
            mean=distances.mean,
            standard_error=distances.standard_error,
            p95=distances.p95,
            max=distances.max,
            bound=certificate.max_error,
            volume=certificate.volume_error,
            worst_flat=self.worst_flat(plan),
            top_error=float(plan.top[-1]) - mesh.height,
        )

    def worst_flat(self, plan: LayerPlan) -> float:
        """Return the largest distance, mm, of a flat of the part from the nearest end of a layer."""
        flats = find_flats(self.part.mesh)[0]
        ends = np.concatenate([[0.0], plan.top])
        return float(np.abs(flats[:, None] - ends).min(axis=1).max(initial=0.0))

    def extend_to_top(self, plan: LayerPlan) -> LayerPlan:
        """Extend the plan to the top of the part, if no extrusion fits into the missing part.

        Layers read from G-code end at the last extrusion. No slicer prints a very thin tip, and the plan is not to
        blame for this. A missing layer that could have been printed stays missing.
        """
        missing = self.part.mesh.height - float(plan.top[-1])
        if missing <= _TIP:
            return plan
        n_more = int(np.ceil(missing / float(plan.height[-1]) - 1e-6))
        more = plan.top[-1] + missing * np.arange(1, n_more + 1) / n_more
        top = np.concatenate([plan.top, more])
        ratio = (plan.cut[-1] - plan.bottom[-1]) / plan.height[-1]
        bottom = top[plan.n_layers - 1 : -1]
        whole = LayerPlan(top, np.concatenate([plan.cut, bottom + ratio * (more - bottom)]), plan.planner)
        printed = self._slice(whole).program.printed
        return plan if (printed >= plan.n_layers).any() else whole

    def _slice(self, plan: LayerPlan) -> Stages:
        return slice_stages(self.part.mesh, self.part.profile, plan=plan)
