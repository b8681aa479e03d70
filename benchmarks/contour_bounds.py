"""Compare the certificate of prints with contoured tops with sampled points.

    python -m benchmarks.contour_bounds [--points N] [--seed N] [part ...]

Parts are sliced with layers of 0.2 mm and with `adaptive`, both with `z_contouring`; without a part, wedges of 5 to 20
degrees, a cap of a sphere, and two of these joined. The printed solid has the section of each layer, up to the top of
the nearest extrusion in contoured layers. Points are drawn near shallow upper surfaces. The exact distance of each
wrongly filled or wrongly empty one to the mesh is compared with the certified bound of its layer. In contoured layers,
points that are farther than half the width of an extrusion from all centre lines lie in gaps: nothing is printed there,
and they are counted apart. The exit code is 1 if any other one exceeds its bound.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from printer_slicer.arrays import Bool, Float, Int
from printer_slicer.geometry.segment_index import SegmentIndex
from printer_slicer.geometry.vectors import nearest_share
from printer_slicer.mesh_io import load_mesh
from printer_slicer.model import Mesh
from printer_slicer.pipeline import slice_stages
from printer_slicer.profile import Profile, load_profile
from printer_slicer.roles import roles_with
from printer_slicer.stages import Stages
from printer_slicer.surface import certify_stacks
from printer_slicer.surface.contoured_tops import select_shallow_facets
from tests.contoured_parts import dome, wedge
from tests.parts import joined
from tests.surface.distances import distance_to_mesh, in_stack, winding

_STEEPEST = 1.0  # mm per mm
_AT_ONCE = 50_000  # points
_RESOLUTION = 0.001  # mm; the certificate assumes exact sections, see docs/layer-planning.md
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
    print(
        "| part | bound µm | layers | points | wrong | worst share of its bound | beyond | in gaps | beyond |"
    )
    print("|---|---|---|---|---|---|---|---|---|")
    found = [sample_part(mesh, quality, -(-options.points // len(rows)), rng) for mesh, quality in rows]
    return int(any(found))


def sample_part(mesh: Mesh, quality: str, n_points: int, rng: np.random.Generator) -> int:
    """Print the row of a part, and return how many points exceed the bound of their layer."""
    stages = slice_stages(mesh, _load_profile(quality))
    certificate = certify_stacks(stages.stacks)
    shares, gaps, done = [np.zeros(0)], [np.zeros(0, np.bool_)], 0
    while done < n_points:
        count = min(_AT_ONCE, n_points - done)
        points, layer, is_in_gap = _find_wrong_points(stages, _choose_points(stages, count, rng))
        bound = certificate.bound[layer]
        distance = distance_to_mesh(points, stages.part, 2 * bound + 0.1)
        shares.append((distance - _ROUNDING) / bound)
        gaps.append(is_in_gap)
        done += count
    share, is_in_gap = np.concatenate(shares), np.concatenate(gaps)
    in_gaps, share = share[is_in_gap], share[~is_in_gap]
    beyond = int((share > 1).sum())
    counts = (
        f"{certificate.plan.n_layers} | {n_points} | {len(share)} | {share.max(initial=0.0):.3f} | {beyond}"
    )
    print(
        f"| {mesh.name}, {quality} | {1000 * certificate.max_error:.1f} | {counts} "
        f"| {len(in_gaps)} | {int((in_gaps > 1).sum())} |",
        flush=True,
    )
    return beyond


def _load_profile(quality: str) -> Profile:
    """Return the profile of a quality with contoured tops."""
    uniform = quality == "uniform"
    changes = {
        "quality.z_contouring": True,
        "quality.resolution": _RESOLUTION,
        **(_UNIFORM if uniform else {}),
    }
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


def _find_wrong_points(stages: Stages, points: Float) -> tuple[Float, Int, Bool]:
    """Return the points (n, 3) that are wrongly filled or empty for sure, their layers, and which are in gaps."""
    held, layer, sure = in_stack(points, stages.part, stages.sections)
    sure &= layer < stages.sections.plan.n_layers
    points, layer, held = points[sure], layer[sure], held[sure]
    top, away = _find_nearest_tops(stages, points, layer)
    held &= points[:, 2] <= top
    turns, _, known = winding(points, stages.part, points[:, 2], points[:, 2])
    wrong = (held != (turns > 0)) & known
    rule = stages.stacks[0].plan.contour_rule
    is_in_gap = (away > rule.width / 2) if rule else np.zeros(len(points), np.bool_)
    return points[wrong], layer[wrong], is_in_gap[wrong]


def _find_nearest_tops(stages: Stages, points: Float, layer: Int) -> tuple[Float, Float]:
    """Return z (n,) of the extrusion nearest to points (n, 3) of layers (n,), and its distance seen from above, mm.

    In layers that are not contoured, z is infinite and the distance 0.
    """
    top, away = np.full(len(points), np.inf), np.zeros(len(points))
    begin, end, bead_layer = _list_extrusions(stages)
    if not len(bead_layer):
        return top, away
    box = points[:, :2].min(axis=0), points[:, :2].max(axis=0)
    index = SegmentIndex((begin[:, :2], end[:, :2]), bead_layer, stages.toolpaths.plan.n_layers, box)
    nearest = index.nearest(points[:, :2], layer)
    known = np.flatnonzero(nearest >= 0)
    begin, way = begin[nearest[known]], (end - begin)[nearest[known]]
    share = nearest_share(points[known, :2] - begin[:, :2], way[:, :2])
    place = begin + share[:, None] * way
    top[known] = place[:, 2]
    away[known] = np.hypot(*(points[known, :2] - place[:, :2]).T)
    return top, away


def _list_extrusions(stages: Stages) -> tuple[Float, Float, Int]:
    """Return both ends (S, 3) and layers (S,) of all extrusions of the part in layers that contouring has changed."""
    paths = stages.toolpaths
    changed = np.zeros(paths.plan.n_layers, np.bool_)
    changed[paths.layer[paths.find_lowered(_ROUNDING)]] = True
    if stages.sections.below_cut is not None:
        changed |= stages.sections.below_cut.used
    xyz = np.column_stack([paths.xy, paths.z_top[paths.path_of_point] + paths.z_offset])
    owner = paths.path_of_bead
    some = np.flatnonzero(roles_with(is_part=True)[paths.role[owner]] & changed[paths.layer[owner]])
    begin, end = (xyz[point[some]] for point in paths.ends_of_beads)
    return begin, end, paths.layer[owner[some]]


if __name__ == "__main__":
    sys.exit(main())
