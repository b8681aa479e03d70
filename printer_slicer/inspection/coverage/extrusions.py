"""The extrusions of a sliced program or of a G-code file, stored in one array per property."""

from __future__ import annotations

from math import pi
from typing import TYPE_CHECKING, Final

import numpy as np

from printer_slicer import bead
from printer_slicer.arrays import Bool, Float, Int, frozen_array
from printer_slicer.gcode import Moves
from printer_slicer.inspection.deposition.marks import Purpose, purposes_of_roles
from printer_slicer.roles import Role
from printer_slicer.values import Struct, force_setattr

if TYPE_CHECKING:
    from printer_slicer.model import Program

__all__ = [
    "Extrusions",
    "Purpose",
    "extrusions_of_moves",
    "extrusions_of_program",
    "sample_points",
    "weighted_median",
]

_NEGLIGIBLE: Final = 1e-9  # mm³ or mm; smaller values are rounding errors
_NO_CONTOURS: Final = frozen_array([], np.float64, (0,))  # in a layer with level tops


class Extrusions(Struct, frozen=True, eq=False):
    """Straight extrusions in printing order, with their position, size and role.

    Attributes:
        begin, end: (B, 2) mm, centre line.
        z_top: (B,) mm, height of the nozzle at the end, which is the top of the extrusion.
        rise: (B,) mm, change of z along the extrusion; 0 except for spirals and sloped seams.
        height: (B,) mm; nan if not known yet.
        area: (B,) mm² of cross-section, from the filament that is fed.
        purpose: (B,) `Purpose` of each.
        line: (B,) line of the text, counted from 1; 0 if there is none.
        layer_top: (B,) mm, top of the layer of each contoured extrusion, which follows the surface of the part in z
            inside its layer; nan for all others. Nothing given means that no extrusion is contoured.
    """

    begin: Float
    end: Float
    z_top: Float
    rise: Float
    height: Float
    area: Float
    purpose: Int
    line: Int
    layer_top: Float = _NO_CONTOURS

    def __post_init__(self) -> None:
        n_beads = len(self.begin)
        if len(self.layer_top) != n_beads:
            force_setattr(self, "layer_top", np.full(n_beads, np.nan))
        for name, dtype, shape in (
            ("begin", np.float64, (-1, 2)),
            ("end", np.float64, (n_beads, 2)),
            ("z_top", np.float64, (n_beads,)),
            ("rise", np.float64, (n_beads,)),
            ("height", np.float64, (n_beads,)),
            ("area", np.float64, (n_beads,)),
            ("purpose", np.int64, (n_beads,)),
            ("line", np.int64, (n_beads,)),
            ("layer_top", np.float64, (n_beads,)),
        ):
            force_setattr(self, name, frozen_array(getattr(self, name), dtype, shape))

    @property
    def n_beads(self) -> int:
        """Number of extrusions."""
        return len(self.begin)

    @property
    def is_contoured(self) -> Bool:
        """Mask (B,) of contoured extrusions."""
        return ~np.isnan(self.layer_top)

    @property
    def level(self) -> Float:
        """Height (B,) of the layer of each extrusion, mm: `layer_top` of contoured extrusions, `z_top` of others."""
        return np.where(self.is_contoured, self.layer_top, self.z_top)

    @property
    def middle_z(self) -> Float:
        """Height (B,) of the top of each extrusion in its middle, mm."""
        return self.z_top - self.rise / 2

    @property
    def length(self) -> Float:
        """Length (B,) of each extrusion in x and y, mm."""
        return np.asarray(np.hypot(*(self.end - self.begin).T))

    @property
    def volume(self) -> Float:
        """Volume (B,) of each extrusion, mm³."""
        return self.area * self.length

    @property
    def width(self) -> Float:
        """Width (B,) of each extrusion, mm, from area and height; see `bead.width_for_section`."""
        return bead.width_for_section(self.area, self.height)

    @property
    def usual_width(self) -> float:
        """Median width of the extrusions, weighted by their length, mm."""
        return weighted_median(self.width, self.length)

    def take(self, chosen: Int | Bool) -> Extrusions:
        """Select extrusions by index or by flags (B,)."""
        return Extrusions(
            self.begin[chosen],
            self.end[chosen],
            self.z_top[chosen],
            self.rise[chosen],
            self.height[chosen],
            self.area[chosen],
            self.purpose[chosen],
            self.line[chosen],
            self.layer_top[chosen],
        )


def weighted_median(values: Float, weights: Float) -> float:
    """Return the weighted median of values; 0 if there are no values."""
    order = np.argsort(values)
    reached = np.cumsum(weights[order])
    return float(values[order][np.searchsorted(reached, reached[-1] / 2)]) if len(values) else 0.0


def sample_points(beads: Extrusions, count: int) -> tuple[Float, Int]:
    """Return points (count, 2), mm, evenly spaced along all extrusions, and each point's extrusion."""
    reached = np.cumsum(beads.length)
    if not len(reached):
        return np.zeros((0, 2)), np.zeros(0, np.int64)
    place = (np.arange(count) + 0.5) / count * reached[-1]
    bead = np.minimum(np.searchsorted(reached, place), len(reached) - 1)
    share = 1 - (reached[bead] - place) / np.maximum(beads.length[bead], 1e-12)
    return beads.begin[bead] + share[:, None] * (beads.end - beads.begin)[bead], bead


def extrusions_of_program(program: Program, filament_diameter: float) -> tuple[Extrusions, Int]:
    """Return the extrusions of a program, and the index of the move that makes each of them, (B,).

    Args:
        program: the moves.
        filament_diameter: mm.
    """
    filament = _extruded_filament(program.filament, np.zeros(program.n_moves, np.int64))
    begin, end = program.start, program.xyz
    length = np.hypot(*(end - begin)[:, :2].T)
    kept = np.flatnonzero((program.role != Role.TRAVEL) & (filament > _NEGLIGIBLE) & (length > _NEGLIGIBLE))
    beads = Extrusions(
        begin=begin[kept, :2],
        end=end[kept, :2],
        z_top=end[kept, 2],
        rise=(end - begin)[kept, 2],
        height=program.height[kept],
        area=filament[kept] * (pi * filament_diameter**2 / 4) / length[kept],
        purpose=purposes_of_roles(program.role[kept]),
        line=np.zeros(len(kept), np.int64),
    )
    return beads, kept


def extrusions_of_moves(moves: Moves, filament_diameter: float | Float) -> tuple[Extrusions, Int, float]:
    """Return the extrusions of moves, with unknown height and purpose.

    An extrusion is a move along x or y that feeds new filament; filament returning after a retraction does not count.

    Args:
        moves: of a file, or as a printer executed them.
        filament_diameter: mm, or one (T,) for each tool.

    Returns:
        The extrusions, with the index of the command as their line; (B,) the move of each; and the volume extruded
        without motion, mm³.
    """
    diameter = np.atleast_1d(np.asarray(filament_diameter, np.float64))
    section = pi * diameter[np.minimum(moves.tool, len(diameter) - 1)] ** 2 / 4
    volume = _extruded_filament(moves.delta[:, 3], moves.tool) * section
    length = np.hypot(*moves.delta[:, :2].T)
    moving = (volume > _NEGLIGIBLE) & (length > _NEGLIGIBLE)
    kept = np.flatnonzero(moving)
    end = moves.end[kept, :2]
    beads = Extrusions(
        begin=end - moves.delta[kept, :2],
        end=end,
        z_top=moves.end[kept, 2],
        rise=moves.delta[kept, 2],
        height=np.full(len(kept), np.nan),
        area=volume[kept] / length[kept],
        purpose=np.full(len(kept), Purpose.UNKNOWN),
        line=moves.line[kept],
    )
    return beads, kept, float(volume[~moving].sum())


def _extruded_filament(fed: Float, tool: Int) -> Float:
    """Return the filament (K,), mm, that leaves the nozzle: what a tool feeds beyond its maximum so far."""
    extruded = np.zeros(len(fed))
    for one in np.unique(tool).tolist():
        own = np.flatnonzero(tool == one)
        # E is written with five decimals: rounding errors of sums must not count as extrusion.
        reached = np.maximum.accumulate(np.maximum(np.round(np.cumsum(fed[own]), 7), 0.0))
        extruded[own] = np.diff(reached, prepend=0.0)
    return extruded
