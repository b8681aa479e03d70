"""Compare the certificate of prints with contoured tops with sampled points.

    python -m benchmarks.contour_bounds [--points N] [--seed N] [part ...]

Parts are sliced with layers of 0.2 mm and with `adaptive`, both with `z_contouring`; without a part, wedges of 5 to 20
degrees, a cap of a sphere, and two of these joined. The printed solid has the section of each layer, up to the top of
the nearest extrusion in contoured layers. Points are drawn near shallow upper surfaces. The exact distance of each
wrongly filled or wrongly empty one to the mesh is compared with the certified bound of its layer. The exit code is 1 if
any exceeds it.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from printer_slicer.arrays import Bool, Float, Int
from printer_slicer.deviation import LocalTops
from printer_slicer.geometry.segment_index import SegmentIndex
from printer_slicer.geometry.vectors import nearest_share
from printer_slicer.mesh_io import load_mesh
from printer_slicer.model import Mesh
from printer_slicer.pipeline import slice_stages
from printer_slicer.profile import Profile, load_profile
from printer_slicer.stages import Stages
from printer_slicer.surface import certify_stacks
from printer_slicer.surface.contoured_tops import select_shallow_facets
from tests.contoured_parts import dome, wedge
from tests.parts import joined
from tests.surface.distances import distance_to_mesh, in_stack, winding

_STEEPEST = 1.0  # mm per mm
_AT_ONCE = 50_000  # points
_ROUNDING = 2e-6  # mm, of the exact distances
_UNIFORM = {"quality.planner.kind": "uniform", "quality.layer_height": 0.2}


def main(argv: Sequence[str] | None = None) -> int:
    """Print one row for each part and quality; return 1 if a point exceeds the bound of its layer."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.contour_bounds", description=__doc__.split("\n")[0]
    )
    parser.add_argument("parts", nargs="*", type=Path, help="files; default: wedges and caps of spheres")
    parser.add_argument(
        "--points", type=int, default=1_000_000, help="of all rows together (default 1000000)"
    )
    parser.add_argument("--seed", type=int, default=0, help="the same seed gives the same points")
    options = parser.parse_args(argv)
    wedges = [wedge(angle, (30.0, 30.0)) for angle in (5.0, 10.0, 15.0, 20.0)]
    meshes = [load_mesh(path) for path in options.parts] or [*wedges, dome(), joined([dome(), wedge(12.0)])]
    rows = [(mesh, quality) for mesh in meshes for quality in ("uniform", "adaptive")]
    rng = np.random.default_rng(options.seed)
    print("| part | layers | points | wrong | bound µm | worst µm | worst share of its bound | beyond |")
    print("|---|---|---|---|---|---|---|---|")
    found = [_sample_part(mesh, quality, -(-options.points // len(rows)), rng) for mesh, quality in rows]
    return int(any(found))


def _sample_part(mesh: Mesh, quality: str, n_points: int, rng: np.random.Generator) -> int:
    """Print the row of a part, and return how many points exceed the bound of their layer."""
    stages = slice_stages(mesh, _load_profile(quality))
    certificate = certify_stacks(stages.stacks)
    shares, worst, done = [np.zeros(0)], 0.0, 0
    while done < n_points:
        count = min(_AT_ONCE, n_points - done)
        points, layer = _find_wrong_points(stages, _choose_points(stages, count, rng))
        bound = certificate.bound[layer]
        distance = distance_to_mesh(points, stages.part, 2 * bound + 0.1)
        shares.append((distance - _ROUNDING) / bound)
        worst, done = max(worst, float(distance.max(initial=0.0))), done + count
    share = np.concatenate(shares)
    beyond = int((share > 1).sum())
    print(
        f"| {mesh.name}, {quality} | {certificate.plan.n_layers} | {n_points} | {len(share)} "
        f"| {1000 * certificate.max_error:.1f} | {1000 * worst:.1f} | {share.max(initial=0.0):.3f} | {beyond} |",
        flush=True,
    )
    return beyond


def _load_profile(quality: str) -> Profile:
    """Return the profile of a quality with contoured tops."""
    uniform = quality == "uniform"
    changes = {"quality.z_contouring": True, **(_UNIFORM if uniform else {})}
    return load_profile("marlin_220", "pla", "standard" if uniform else quality, changes)


def _choose_points(stages: Stages, count: int, rng: np.random.Generator) -> Float:
    """Return points (n, 3) at most a layer above or below shallow upper surfaces, and some beside them."""
    triangles = stages.part.triangles
    facet, _, area = select_shallow_facets(triangles, _STEEPEST)
    chosen = rng.choice(facet, size=count, p=area / area.sum())
    points = np.einsum("ij,ijk->ik", rng.dirichlet(np.ones(3), size=count), triangles[chosen])
    aside = rng.normal(size=(count, 2)) * (rng.random(count) < 0.25)[:, None]
    points[:, :2] += 0.3 * aside
    height = float(stages.stacks[0].plan.height.max())
    points[:, 2] += rng.uniform(-height, height, count) * rng.random(count) ** 2
    return points


def _find_wrong_points(stages: Stages, points: Float) -> tuple[Float, Int]:
    """Return those of the points (n, 3) that are wrongly filled or empty for sure, and their layers."""
    held, layer, sure = in_stack(points, stages.part, stages.sections)
    sure &= layer < stages.sections.plan.n_layers
    points, layer, held = points[sure], layer[sure], held[sure]
    held &= ~_are_above_tops(stages, points, layer)
    turns, _, known = winding(points, stages.part, points[:, 2], points[:, 2])
    wrong = (held != (turns > 0)) & known
    return points[wrong], layer[wrong]


def _are_above_tops(stages: Stages, points: Float, layer: Int) -> Bool:
    """Return which points (n, 3) of layers (n,) are above the top of the nearest extrusion of a contoured layer."""
    tops = LocalTops.of_paths(stages.toolpaths)
    result = np.zeros(len(points), np.bool_)
    if not len(tops.layer):
        return result
    begin, end = tops.begin, tops.end
    box = points[:, :2].min(axis=0), points[:, :2].max(axis=0)
    index = SegmentIndex((begin[:, :2], end[:, :2]), tops.layer, stages.toolpaths.plan.n_layers, box)
    nearest = index.nearest(points[:, :2], layer)
    known = np.flatnonzero(nearest >= 0)
    begin, way = begin[nearest[known]], (end - begin)[nearest[known]]
    share = nearest_share(points[known, :2] - begin[:, :2], way[:, :2])
    result[known] = points[known, 2] > begin[:, 2] + share * way[:, 2]
    return result


if __name__ == "__main__":
    sys.exit(main())
