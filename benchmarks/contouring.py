"""Measure how near a print is to its model, from G-code, with the tops of contoured layers.

    python -m benchmarks.contouring sample FILE.gcode MODEL.stl [--points N] [--seed N] [--pressed MM]
    python -m benchmarks.contouring table [--points N] [--rounds N] [MODEL ...]

`sample` prints the mean distance of points drawn evenly from the surface of the model to the printed solid: of all
points, and of those on surfaces that face up with a slope of up to 45 degrees, flats left out. The printed solid has
the section of each layer, up to the top of the nearest extrusion. Layers, sections and position are those of
`check --model`. `--pressed` assumes the worst of a nozzle with a level underside of this diameter: later extrusions of
a layer press down all that is higher within it.

`table` slices wedges of 5 to 20 degrees, a cap of a sphere, a box and the given models with level tops and with
contoured ones, in layers of 0.2 mm and with `adaptive`. It prints these distances, the print time of the moves, the
number of moves, the findings of `check --model`, whether the G-code differs, and the CPU time of slicing: the median of
the ratios of all rounds, in each of which one follows the other.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from time import process_time

import numpy as np

from printer_slicer.arrays import Bool, Float, consecutive
from printer_slicer.deviation import Deviation, LocalTops, measure_deviation
from printer_slicer.extrusion import move_seconds
from printer_slicer.gcode_text import gcode_of
from printer_slicer.geometry.segment_index import SegmentIndex
from printer_slicer.healing import repair
from printer_slicer.inspection.coverage.model_check import check_gcode, place_sections, read_gcode_extrusions
from printer_slicer.inspection.coverage.stack import Stack
from printer_slicer.inspection.deposition.marks import NOT_PART
from printer_slicer.mesh_io import load_mesh
from printer_slicer.model import LayerPlan, Mesh, Sections
from printer_slicer.pipeline import slice_part
from printer_slicer.profile import load_profile
from tests.contoured_parts import dome, wedge
from tests.parts import box

_MAX_GRADIENT = 1.0  # mm per mm, of shallow tops
_PIECE = 0.25  # mm, longest piece that is pressed down as one
_UNIFORM = {"quality.planner.kind": "uniform", "quality.layer_height": 0.2}
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


@dataclass(frozen=True, slots=True)
class Print:
    """A sliced part.

    Attributes:
        gcode: its G-code.
        minutes: of its moves.
        moves: their number.
        cpu: s of slicing.
    """

    gcode: bytes
    minutes: float
    moves: int
    cpu: float


def _print_table(models: Sequence[Path], n_points: int, rounds: int) -> None:
    """Print one row for each part and quality."""
    wedges = [wedge(angle, (30.0, 30.0)) for angle in (5.0, 10.0, 15.0, 20.0)]
    parts = [*wedges, dome(), box((20.0, 15.0, 6.0)), *(repair(load_mesh(path))[0] for path in models)]
    print(
        "| part | layers | tops µm | pressed by a flat of 1 mm µm | whole part µm | print time min | moves "
        "| findings | CPU |"
    )
    print("|---|---|---|---|---|---|---|---|---|")
    for mesh in parts:
        for quality in ("0.2 mm", "adaptive"):
            print(_make_row(mesh, quality, n_points, rounds), flush=True)


def _make_row(mesh: Mesh, quality: str, n_points: int, rounds: int) -> str:
    """Return the row of a part."""
    made = [[_slice(mesh, quality, contoured=on) for on in (False, True)] for _ in range(rounds)]
    level, contoured = made[0]
    start = f"| {mesh.name} | {quality} "
    if _list_commands(level.gcode) == _list_commands(contoured.gcode):
        return (
            f"{start}| same G-code | | | {level.minutes:.2f} | {level.moves} | | {_median_ratio(made):+.0%} |"
        )
    free = [sample(one.gcode, mesh, n_points) for one in made[0]]
    pressed = sample(contoured.gcode, mesh, n_points, pressed=1.0)
    found = len(check_gcode(contoured.gcode, mesh).findings)
    tops, whole = [1000 * one.tops for one in free], [1000 * one.deviation.mean for one in free]
    return (
        f"{start}| {tops[0]:.1f} → {tops[1]:.1f} | {1000 * pressed.tops:.1f} | {whole[0]:.1f} → {whole[1]:.1f} "
        f"| {level.minutes:.2f} → {contoured.minutes:.2f} ({contoured.minutes / level.minutes - 1:+.1%}) "
        f"| {contoured.moves / level.moves - 1:+.0%} | {found} | {_median_ratio(made):+.0%} |"
    )


def _slice(mesh: Mesh, quality: str, *, contoured: bool) -> Print:
    """Slice a part."""
    uniform = {} if quality == "adaptive" else _UNIFORM
    changes = {"quality.z_contouring": contoured, **uniform}
    profile = load_profile("marlin_220", "pla", "standard" if uniform else quality, changes)
    start = process_time()
    program = slice_part(mesh, profile)
    cpu = process_time() - start
    minutes = float(move_seconds(program, profile).sum()) / 60
    return Print(gcode_of(program, profile), minutes, program.n_moves, cpu)


def _list_commands(gcode: bytes) -> list[bytes]:
    """Return the lines of G-code without those that are comments, which list the settings."""
    return [line for line in gcode.splitlines() if not line.startswith(b";")]


def _median_ratio(made: Sequence[Sequence[Print]]) -> float:
    """Return how much more CPU time slicing with contoured tops takes."""
    return median(contoured.cpu / level.cpu for level, contoured in made) - 1


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
    table = commands.add_parser("table", help="level and contoured tops of several parts")
    table.add_argument("models", nargs="*", type=Path)
    table.add_argument("--points", type=int, default=20_000)
    table.add_argument("--rounds", type=int, default=5)
    options = parser.parse_args(argv)
    if "gcode" not in options:
        _print_table(options.models, options.points, options.rounds)
        return 0
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
