"""Measure how near a print is to its model, from G-code, with the tops of contoured layers.

    python -m benchmarks.contouring sample FILE.gcode MODEL.stl [--points N] [--seed N] [--pressed MM]

Prints the mean distance of points drawn evenly from the surface of the model to the printed solid: of all points, and
of those on surfaces that face up with a slope of up to 45 degrees, flats left out. The printed solid has the section of
each layer, up to the top of the nearest extrusion. Layers, sections and position are those of `check --model`.
`--pressed` assumes the worst of a nozzle with a level underside of this diameter: later extrusions of a layer press
down all that is higher within it.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from printer_slicer.arrays import Bool, Float, consecutive
from printer_slicer.deviation import Deviation, LocalTops, measure_deviation
from printer_slicer.geometry.segment_index import SegmentIndex
from printer_slicer.healing import repair
from printer_slicer.inspection.coverage.model_check import place_sections, read_gcode_extrusions
from printer_slicer.inspection.coverage.stack import Stack
from printer_slicer.inspection.deposition.marks import NOT_PART
from printer_slicer.mesh_io import load_mesh
from printer_slicer.model import LayerPlan, Mesh, Sections

_MAX_GRADIENT = 1.0  # mm per mm, of shallow tops
_PIECE = 0.25  # mm, longest piece that is pressed down as one
_MIN_GRADIENT = 1e-3  # mm per mm; less is flat


@dataclass(frozen=True, slots=True)
class Sample:
    """Distances from the surface of a model to a print.

    Attributes:
        deviation: points and their distances, mm.
        is_top: (n,) whether each point is on a shallow top.
        contoured: share of the length of the extrusions that is contoured.
        layers: number of layers.
    """

    deviation: Deviation
    is_top: Bool
    contoured: float
    layers: int

    @property
    def tops(self) -> float:
        """Mean distance of the points on shallow tops, mm; nan without such points."""
        distance = self.deviation.distance[self.is_top]
        return float(distance.mean()) if len(distance) else np.nan


def sample(text: bytes, mesh: Mesh, n_points: int = 20_000, seed: int = 0, *, pressed: float = 0.0) -> Sample:
    """Measure the distances from the surface of a model to its print.

    Args:
        text: G-code of any slicer.
        mesh: the model, repaired and turned as it is printed, at any position.
        n_points: number of points.
        seed: the same seed gives the same points.
        pressed: mm, diameter of the underside of the nozzle, which presses down higher extrusions; 0: none.
    """
    deposit, stack = read_gcode_extrusions(text, None, "G-code")
    stack, sections, match = place_sections(mesh, deposit, stack)
    low = float(mesh.bounds[0, 2])
    part = mesh.moved((*match.shift, -low))
    base = float(stack.bottom[0])
    plan = LayerPlan(stack.top - base, (stack.top + stack.bottom) / 2 - base)
    tops = _tops_of(stack, base)
    tops = _press_down(tops, pressed / 2, stack.n_layers) if pressed and len(tops.layer) else tops
    deviation = measure_deviation(part, Sections(plan, sections), n_points, seed, tops)
    length, contoured = stack.beads.length, stack.beads.is_contoured
    share = float(length[contoured].sum() / length.sum())
    return Sample(deviation, _find_tops(part, deviation.points), share, stack.n_layers)


def _tops_of(stack: Stack, base: float) -> LocalTops:
    """Return the tops of contoured layers, with z from the bottom of the part at `base`, mm."""
    beads = stack.beads
    used = np.zeros(stack.n_layers, np.bool_)
    used[stack.layer[beads.is_contoured]] = True
    own = (stack.layer >= 0) & ~np.isin(beads.purpose, NOT_PART)
    some = np.flatnonzero(own & used[stack.layer])
    # Extrusions that fill several layers, or hang as threads, have their own top.
    begin = np.column_stack([beads.begin, beads.z_top - beads.rise - base])
    end = np.column_stack([beads.end, beads.z_top - base])
    return LocalTops(begin[some], end[some], stack.layer[some])


def _press_down(tops: LocalTops, radius: float, n_layers: int) -> LocalTops:
    """Lower pieces of extrusions, in printing order, to the lowest later ones within a radius, mm."""
    length = np.linalg.norm(tops.end - tops.begin, axis=1)
    count = np.maximum(np.ceil(length / _PIECE), 1).astype(np.int64)
    source = np.repeat(np.arange(len(length)), count)
    place = consecutive(np.zeros(len(length), np.int64), count)
    way = (tops.end - tops.begin)[source] / count[source, None]
    begin = tops.begin[source] + place[:, None] * way
    end, layer, middle = begin + way, tops.layer[source], begin + way / 2
    xy, z, pressed = middle[:, :2], middle[:, 2], middle[:, 2].copy()
    box = xy.min(axis=0) - radius, xy.max(axis=0) + radius
    index = SegmentIndex((begin[:, :2], end[:, :2]), layer, n_layers, box)
    for later, earlier in index.find_touching(xy - radius, xy + radius, layer):
        near = (
            (earlier < later) & (np.hypot(*(xy[later] - xy[earlier]).T) <= radius) & (z[later] < z[earlier])
        )
        np.minimum.at(pressed, earlier[near], z[later[near]])
    for ends in (begin, end):
        ends[:, 2] = np.minimum(ends[:, 2], np.where(pressed < z, pressed, np.inf))
    return LocalTops(begin, end, layer)


def _find_tops(part: Mesh, points: Float) -> Bool:
    """Return whether points (n, 3) of a surface are on facets that face up with a slope of up to 45 degrees."""
    from printer_slicer.inspection.coverage.surface_distance import find_surface

    height, gradient = find_surface(part, points[:, :2], points[:, 2] - 1e-4, points[:, 2] + 1e-4)
    return ~np.isnan(height) & (gradient <= _MAX_GRADIENT) & (gradient >= _MIN_GRADIENT)


def main(argv: Sequence[str] | None = None) -> int:
    """Print the distances of one file."""
    parser = argparse.ArgumentParser(prog="benchmarks.contouring", description=__doc__.split("\n")[0])
    commands = parser.add_subparsers(required=True)
    one = commands.add_parser("sample", help="mean distance of a file from its model")
    one.add_argument("gcode", type=Path)
    one.add_argument("model", type=Path)
    one.add_argument("--points", type=int, default=20_000)
    one.add_argument("--seed", type=int, default=0)
    one.add_argument("--pressed", type=float, default=0.0, metavar="MM")
    options = parser.parse_args(argv)
    mesh = repair(load_mesh(options.model))[0]
    text = options.gcode.read_bytes()
    found = sample(text, mesh, options.points, options.seed, pressed=options.pressed)
    deviation = found.deviation
    print(
        f"whole {1000 * deviation.mean:.2f} µm (±{1000 * deviation.standard_error:.2f}), "
        f"tops {1000 * found.tops:.2f} µm ({found.is_top.mean():.1%} of the points), "
        f"p95 {1000 * deviation.p95:.1f}, maximum {1000 * deviation.max:.0f} µm; "
        f"{found.layers} layers, {found.contoured:.1%} of the length contoured"
    )
    return 0


if __name__ == "__main__":
    sys.exit(main())
