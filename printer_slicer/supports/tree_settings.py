"""Settings of trees, read from a profile."""

from __future__ import annotations

from math import radians, tan

from printer_slicer.profile import Profile
from printer_slicer.values import Struct

__all__ = ["TreeSettings", "read_tree_settings"]


class TreeSettings(Struct, frozen=True):
    """Dimensions and limits of trees, in mm unless said otherwise.

    Attributes:
        gap: distance from the top of a support to the overhang.
        bottom_gap: distance from a part's upper side to the support that stands on it.
        xy_gap: distance beside the part.
        near_gap: distance beside those layers of the part that lie within `gap` above or `bottom_gap` below.
        joist: distance between joists under a roof, and between tips under slopes.
        interface_layers: closed layers of a roof; 0: joists lie right under the overhang.
        tip_distance: distance between tips under a joist.
        tip_radius: radius of a branch under the overhang.
        branch_radius: radius that a branch reaches 2 mm below its tip.
        largest_radius: radius beyond which a branch does not grow.
        growth: increase of the radius per mm from there downwards.
        slope: largest sideways movement of a branch's outline per mm of height.
        slow_slope: sideways movement per mm of height of branches that approach each other.
        foot: height above the bed over which branches widen.
        scar_price: length of branch that is saved for each branch that stands on the part.
        on_bed_only: whether no branch may stand on the part.
        width: extrusion width.
    """

    gap: float
    bottom_gap: float
    xy_gap: float
    near_gap: float
    joist: float
    interface_layers: int
    tip_distance: float
    tip_radius: float
    branch_radius: float
    largest_radius: float
    growth: float
    slope: float
    slow_slope: float
    foot: float
    scar_price: float
    on_bed_only: bool
    width: float


_MAX_RADIUS_RATIO = 1.45  # branch radii; such a branch is still printed as a single loop
_MIN_RADIUS = 1.0  # extrusion widths; a branch is a loop, and no loop can be smaller
_MIN_DISTANCE = 3.0  # extrusion widths between joists; nearer ones leave no room between them
_MAX_SLIMNESS = 35.0  # height by radius
_NEAR_GAP = (
    0.2  # mm; a narrow strip under a slope is farther than this from the layer below, or no tip reaches it
)
_MORE_XY_GAP = 0.15  # mm; a branch touches the part only at its tip, so it may be farther away than a column


def read_tree_settings(profile: Profile, layer_height: float, highest: float) -> TreeSettings:
    """Read the settings of trees.

    The walls of a branch are single loops. In each layer they must lie on the loops of the layer below by half their
    width at least, so the slope is limited by the layer height.

    Args:
        profile: the settings.
        layer_height: the largest layer height of the supports, mm.
        highest: z of the highest support, mm; high branches become thicker.
    """
    quality, width = profile.quality, profile.extrusion_width
    tip_radius = max(quality.support_tip_diameter / 2, _MIN_RADIUS * width)
    radius, xy_gap = quality.support_branch_diameter / 2, quality.support_xy_gap + _MORE_XY_GAP
    slope = min(tan(radians(quality.support_tree_angle_deg)), width / 2 / layer_height)
    return TreeSettings(
        gap=quality.support_gap,
        bottom_gap=quality.support_bottom_gap,
        xy_gap=xy_gap,
        near_gap=min(_NEAR_GAP, xy_gap),
        joist=max(quality.support_joist_spacing, _MIN_DISTANCE * width),
        interface_layers=quality.support_interface_layers,
        tip_distance=max(quality.support_tip_distance, 2 * tip_radius),
        tip_radius=tip_radius,
        branch_radius=max(radius, tip_radius),
        largest_radius=max(_MAX_RADIUS_RATIO * max(radius, tip_radius), highest / _MAX_SLIMNESS),
        growth=tan(radians(quality.support_branch_growth_deg)),
        slope=slope,
        slow_slope=min(tan(radians(quality.support_tree_slow_angle_deg)), slope),
        foot=quality.support_first_layer_expansion,
        scar_price=quality.support_bed_detour,
        on_bed_only=quality.support_on_bed_only,
        width=width,
    )
