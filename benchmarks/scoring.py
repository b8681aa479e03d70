"""What a layer plan comes to, whoever made it: the same functions for all."""

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

_TIP = 1e-3  # mm that may be missing at the top without a closer look


@dataclass(frozen=True, slots=True)
class Score:
    """How good a plan is, and what it costs. Lengths mm.

    Attributes:
        layers: how many.
        minutes: modelled time of our toolpaths over this plan.
        mean: from points on the surface of the part to the nearest point of the stack's surface.
        standard_error: of the mean, by the choice of the points.
        p95: the distance that 95 % of the points do not exceed.
        max: largest distance of the points.
        bound: no wrong place is farther from the surface than this, by certificate.
        volume: mm³, at most, filled or empty wrongly, by certificate; what is missing at the top is in it.
        worst_flat: largest distance of a flat of more than 1 mm² from the nearest end of a layer.
        top_error: top of the last layer over the top of the part.
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
        """What is proven about a plan."""
        return certify(self._surface, plan)

    def score(self, plan: LayerPlan) -> Score:
        """Slice the part with this plan and measure what comes out; the same plan is measured once."""
        key = plan.top.tobytes() + plan.cut.tobytes()
        if key not in self._scores:
            self._scores[key] = self._measured(plan)
        return self._scores[key]

    def _measured(self, plan: LayerPlan) -> Score:
        mesh = self.part.mesh
        stages = self._sliced(plan)
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
        """Largest distance, mm, of a flat of the part from the nearest end of a layer."""
        flats = find_flats(self.part.mesh)[0]
        ends = np.concatenate([[0.0], plan.top])
        return float(np.abs(flats[:, None] - ends).min(axis=1).max(initial=0.0))

    def completed(self, plan: LayerPlan) -> LayerPlan:
        """The plan with layers up to the top of the part, if no bead fits into what is missing there.

        Layers read from G-code end where the last plastic lies. In a thin tip nobody lays any, and that is not the
        plan's fault; a slab that could have been printed stays missing.
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
        printed = self._sliced(whole).program.printed
        return plan if (printed >= plan.n_layers).any() else whole

    def _sliced(self, plan: LayerPlan) -> Stages:
        return slice_stages(self.part.mesh, self.part.profile, plan=plan)
