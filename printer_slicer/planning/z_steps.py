"""Layer heights as whole numbers of the printer's z steps, so that sums of heights are exact."""

from __future__ import annotations

import numpy as np

from printer_slicer.arrays import Float, Int
from printer_slicer.errors import PlanError
from printer_slicer.model import ContourRule, LayerPlan, Mesh
from printer_slicer.planning.support_tops import find_support_contacts
from printer_slicer.profile import Profile

__all__ = ["ZSteps", "fill_with_layers", "layer_tolerances"]

_LIST_STEP = 0.01  # mm between allowed heights, if neither the profile nor the printer sets more
_BORDER_TOLERANCE = 6e-3  # mm; layers end within this distance of the ends of ranges
_STEP_TOLERANCE = 1e-2  # of a step; precision of heights in 32-bit coordinates


def layer_tolerances(profile: Profile, bottom: Float, top: Float) -> Float:
    """Return the tolerance of layers, mm, from the quality or from the height ranges that they overlap.

    Args:
        profile: tolerance and ranges.
        bottom: (...) mm.
        top: mm, of the same shape.
    """
    inside, tolerance = np.zeros(bottom.shape, np.bool_), np.full(bottom.shape, np.inf)
    for height_range in profile.dials.ranges:
        if height_range.tolerance:
            low, high = height_range.low, height_range.high
            inside |= (bottom >= low - _BORDER_TOLERANCE) & (top <= high + _BORDER_TOLERANCE)
            overlaps = (top > low + _BORDER_TOLERANCE) & (bottom < high - _BORDER_TOLERANCE)
            np.minimum(tolerance, height_range.tolerance, out=tolerance, where=overlaps)
    np.minimum(tolerance, profile.quality.tolerance, out=tolerance, where=~inside)
    return tolerance


class ZSteps:
    """Converts between mm and the z steps of the printer.

    Attributes:
        size: mm per step.
        lowest, highest: minimum and maximum layer height of the printer, in steps.
        part: height of the part in whole steps.
        first: height of the first layer in steps; 0 if the planner may choose it.
        allowed: (n,) layer heights that a planner may choose, in steps, ascending.
        support_tops: (n,) heights at which supports should end below flats, in steps, ascending.
    """

    def __init__(self, mesh: Mesh, profile: Profile) -> None:
        self.size = profile.printer.z_step
        self._height = mesh.height
        self.lowest = int(np.ceil(profile.printer.min_layer / self.size - 1e-6))
        self.highest = int(np.floor(profile.printer.max_layer / self.size + 1e-6))
        self._containment, self._contour_rule = profile.quality.containment, _make_contour_rule(profile)
        self.part = max(self._round_to_steps(mesh.height), 1)
        self.first = self.to_steps(profile.quality.first_layer_height)
        self.allowed = self._list_allowed_heights(profile)
        self.support_tops = find_support_contacts(mesh, profile, self.size)[1]
        if self.part < self.lowest:
            raise PlanError(
                f"{mesh.name}: {mesh.height:.4g} mm high, thinner than the thinnest layer of "
                f"{profile.printer.name!r} ({profile.printer.min_layer:g} mm)",
                remedy="Check the unit of the part; if it is right, scale the part up or lower printer.min_layer",
            )

    def _list_allowed_heights(self, profile: Profile) -> Int:
        """Return the layer heights (n,) that the profile allows, in steps, ascending."""
        quality = profile.quality
        if quality.layer_heights:
            listed = np.unique([self.to_steps(height) for height in quality.layer_heights]).astype(np.int64)
            return listed[(listed >= self.lowest) & (listed <= self.highest)]
        thin = max(self.to_steps(profile.thinnest), self.lowest)
        thick = max(min(self.to_steps(profile.thickest), self.highest), thin)
        if not quality.layer_step and profile.printer.z_full_step:
            return self._list_full_steps(thin, thick, profile.printer.z_full_step)
        step = quality.layer_step or max(_LIST_STEP, self.size)
        return np.arange(thin, thick + 1, max(self.to_steps(step), 1), dtype=np.int64)

    def _list_full_steps(self, thin: int, thick: int, full: float) -> Int:
        """Return the multiples of a full motor step from `thin` to `thick`; only `thin` if there are none."""
        most = int(np.floor(thick * self.size / full + _STEP_TOLERANCE))
        least = min(int(np.ceil(thin * self.size / full - _STEP_TOLERANCE)), most)
        heights = np.unique(np.round(np.arange(least, most + 1) * full / self.size)).astype(np.int64)
        within = heights[(heights >= thin) & (heights <= thick)]
        return within if len(within) else np.array([thin], np.int64)

    def _round_to_steps(self, height: float) -> int:
        """Convert the height of the part to whole steps; the containment setting determines the rounding."""
        steps = height / self.size
        if self._containment == "mid":
            return round(steps)
        return int(
            np.ceil(steps - _STEP_TOLERANCE)
            if self._containment == "positive"
            else np.floor(steps + _STEP_TOLERANCE)
        )

    def to_steps(self, height: float) -> int:
        """Convert a height in mm to steps, rounded."""
        return round(height / self.size)

    def split_first_layer(self) -> tuple[int, int]:
        """Return the height of a fixed first layer and the height above it; (0, part) if the planner may choose it.

        If less than the thinnest layer would be left above, the part is one layer, or two equal ones.
        """
        rest = self.part - self.first
        if not self.first or rest >= self.lowest:
            return self.first, rest
        if self.part <= self.highest:
            return self.part, 0
        upper = max(self.part // 2, self.lowest)  # a narrow range may have no two layers that fit
        return max(self.part - upper, self.lowest), upper

    def make_plan(self, heights: Int, planner: str) -> LayerPlan:
        """Build a layer plan from layer heights in steps."""
        top = np.round(np.cumsum(heights) * self.size, 7)
        bottom = np.concatenate([[0.0], top[:-1]])
        # A last layer that extends above the part by steps is cut in the middle of the part's material in it.
        over = float(top[-1]) - self._height > self.size
        cut = (bottom + (np.minimum(top, max(self._height, float(bottom[-1]))) if over else top)) / 2
        return LayerPlan(top, cut, planner, self._containment, contour_rule=self._contour_rule)


def _make_contour_rule(profile: Profile) -> ContourRule | None:
    """Return where extrusions follow shallow upper surfaces; None if they do not."""
    if not profile.quality.z_contouring:
        return None
    from printer_slicer.contouring import make_contour_rule  # noqa: PLC0415 - off by default

    return make_contour_rule(profile)


def fill_with_layers(total: int, step: int, lowest: int, highest: int) -> Int:
    """Fill `total` exactly with layers of height `step`; all in z steps.

    The remainder becomes the last layer. If it is too thin for the printer, it is divided among as few of the last
    layers as possible, with or without an additional layer. If that is impossible (a total below `lowest`, or a narrow
    range of heights), the last layer extends above the total.
    """
    if total <= 0:
        return np.zeros(0, np.int64)
    count, rest = divmod(total, step)
    for shared in range(count + 1):
        amount = shared * step + rest
        for layers in (shared + 1, shared):
            if amount == 0 or layers * lowest <= amount <= layers * highest:
                return np.array(
                    [step] * (count - shared) + _split_evenly(amount, layers if amount else 0), np.int64
                )
    return np.array([step] * count + [max(rest, lowest)], np.int64)


def _split_evenly(amount: int, layers: int) -> list[int]:
    """Split `amount` into whole parts that differ by at most one, the larger ones first."""
    return [(amount + layers - 1 - i) // layers for i in range(layers)]
