"""How long a layer takes, before anything is sliced: a model for planners that weigh minutes.

A layer's time is made of its perimeters (length of the contours), its solid and sparse infill (area inside them, solid
where the surface lies within the shell thickness above or below), and what each contour costs in travels, all at the
speeds of the profile and the flow that the material allows at that height; it is at least the minimum layer time as far
as the minimum speed allows. Infill lines are short, so accelerating costs a share of their time.

The numbers below were fitted to whole programs (benchy, a case, an enclosure and the paper's case study, layers of
0.1, 0.2 and 0.3 mm), whose total times come out within about a tenth; other parts came out at 0.67 to 1.43 of the
program's time. What a planner needs is that the layers of one part come out in proportion. The minutes that are shown
to people come from the program itself.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from printer_slicer import bead
from printer_slicer.geometry.crossing import crossings_of
from printer_slicer.geometry.joints import lowest_of_chain
from printer_slicer.geometry.vectors import cross
from printer_slicer.model import Float, Int
from printer_slicer.profile import Profile
from printer_slicer.surface import Surface

__all__ = ["LayerTimes"]

_PLANES = 120  # at most, over the height of the part
_CLOSEST = 0.1  # mm between planes at least
_TRAVELS = 2.5  # for each contour of a layer: to its perimeters and between the infill behind them
_TRAVEL = 15.0  # mm on average
_SOLID_LINE = 15.0  # mm on average
_SPARSE_LINE = 34.0
_WALLED = 0.9  # of the length that whole perimeters would have: inner ones are shorter, and left out in narrow places


@dataclass(frozen=True, slots=True, eq=False)
class _Slices:
    """Sums over the section at each of some heights.

    Attributes:
        z: (P,) mm.
        length: (P,) mm, of all contours.
        loops: (P,) number of contours.
        inside: (P,) mm², within the perimeters.
        solid: (P,) mm² of it, near a surface.
    """

    z: Float
    length: Float
    loops: Float
    inside: Float
    solid: Float


class LayerTimes:
    """The modelled time of layers of one part that are cut at some of the heights `z`.

    Args:
        surface: of the part.
        profile: speeds, widths, shells, limits.
        z: (n,) mm, ascending.
    """

    def __init__(self, surface: Surface, profile: Profile, z: Float) -> None:
        self._profile = profile
        at = _measure(surface, profile)
        columns = (np.interp(z, at.z, values) for values in (at.length, at.loops, at.inside, at.solid))
        self._slices = _Slices(z, *columns)

    def seconds(self, which: Int, height: float) -> Float:
        """(m,) s, for layers of `height` mm that are cut at the heights `z[which]`."""
        profile, at = self._profile, self._slices
        speeds, hard = profile.speeds, profile.accelerations
        material, printer = profile.material, profile.printer
        width = profile.extrusion_width
        gap = float(bead.spacing(width, height))
        fastest = profile.max_flow / (gap * height * material.flow_ratio)
        length, loops, inside, solid = (
            values.take(which) for values in (at.length, at.loops, at.inside, at.solid)
        )
        outer, inner = min(profile.quality.perimeters, 1), max(profile.quality.perimeters - 1, 0)
        share = profile.quality.infill_density / gap

        def per_mm(speed: float, acceleration: float = np.inf, line: float = np.inf) -> float:
            """Seconds for a mm of lines of so many mm, which are begun and ended at rest."""
            speed = min(speed, fastest)
            return (1 + speed**2 / (acceleration * line)) / speed

        laid = _WALLED * (outer + inner) * length + (1 / gap - share) * solid + share * inside
        walled = outer * per_mm(speeds.outer_perimeter) + inner * per_mm(speeds.inner_perimeter)
        sparse = share * per_mm(speeds.sparse, hard.sparse, _SPARSE_LINE)
        skin = per_mm(speeds.solid, hard.solid, _SOLID_LINE) / gap
        laying = _WALLED * walled * length + (skin - sparse) * solid
        laying += sparse * inside
        travel = _TRAVEL / speeds.travel + speeds.travel / printer.travel_acceleration
        travel += printer.retract_length * (1 / printer.retract_speed + 1 / printer.deretract_speed)
        between = (_TRAVELS * travel) * loops
        slowest = laid / material.min_speed + between
        laying += between
        return np.asarray(np.clip(material.min_layer_time, laying, np.maximum(slowest, laying)))


def _measure(surface: Surface, profile: Profile) -> _Slices:
    """Sections at heights evenly over the part."""
    quality, height = profile.quality, surface.height
    n = int(np.clip(height / _CLOSEST, 1, _PLANES))
    z: Float = (np.arange(n, dtype=np.float64) + 0.5) * (height / n)
    length, area, loops = _sections(surface.triangles, z)
    inside = np.maximum(area - length * quality.perimeters * profile.extrusion_width, 0.0)
    near = surface.up.under(z + quality.top_thickness) - surface.up.under(z)
    near += surface.down.under(z) - surface.down.under(z - quality.bottom_thickness)
    return _Slices(z, length, loops, inside, np.minimum(near, inside))


def _sections(triangles: Float, z: Float) -> tuple[Float, Float, Float]:
    """Length of the contours, area, and number of contours at each height."""
    length, twice, loops = np.zeros((3, len(z)))
    for part in crossings_of(triangles, z):
        tail, head = part.xy.take(part.tail, axis=0), part.xy.take(part.head, axis=0)
        plane, turn = part.plane[part.tail], cross(tail, head)
        length += np.bincount(plane, weights=np.hypot(*(head - tail).T), minlength=len(z))
        twice += np.bincount(plane, weights=turn, minlength=len(z))
        following = np.arange(len(part.xy))
        following[part.tail] = part.head
        # An open contour may count twice.
        firsts = lowest_of_chain(following) == np.arange(len(following))
        loops += np.bincount(part.plane[firsts], minlength=len(z))
    return length, np.maximum(twice / 2, 0.0), loops
