"""Make the sample parts: small shapes whose size and volume are known.

    python sample_parts/make.py

writes one STL file for each entry of `PARTS` next to this script. The same code always gives the same bytes:
coordinates are rounded to 0.1 µm, which hides that the sine of one computer differs from that of another in
its last digit. All parts stand on z = 0; lengths are mm. `README.md` tells what each is for.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise
from math import cos, pi, sin
from pathlib import Path
from typing import Final

import numpy as np

from printer_slicer.arrays import Float
from printer_slicer.mesh_io import export_stl
from printer_slicer.model import Mesh

SIDES: Final = 128
"""Sides of the cylinder and the cone."""

MERIDIANS: Final = 64
PARALLELS: Final = 31
"""Rings of the sphere between its poles."""


def case_study(top_side: float = 5.0) -> Mesh:
    """Square prism 50 x 50 x 30, frustum 22.5 high, square prism `top_side` x `top_side` x 30.

    Envelope and heights are those of the part in "Speeding up algorithm for building the STL model using 3D
    printing"; the paper does not give the side of the upper prism, 5 mm is inferred from its figures.
    """
    sides = (50.0, 50.0, top_side, top_side)
    rings = [_square(side, z) for side, z in zip(sides, (0.0, 30.0, 52.5, 82.5), strict=True)]
    return _mesh("case_study", _walls(rings), _fan(rings[0])[:, ::-1], _fan(rings[-1]))


def box() -> Mesh:
    """Box 20 x 20 x 10."""
    rings = [_square(20.0, z) for z in (0.0, 10.0)]
    return _mesh("box", _walls(rings), _fan(rings[0])[:, ::-1], _fan(rings[1]))


def cylinder() -> Mesh:
    """Cylinder of radius 10, 20 high; a prism of 128 sides."""
    rings = [_circle(10.0, z, SIDES) for z in (0.0, 20.0)]
    bottom, top = _umbrella(rings[0], (0.0, 0.0, 0.0)), _umbrella(rings[1], (0.0, 0.0, 20.0))
    return _mesh("cylinder", _walls(rings), bottom[:, ::-1], top)


def cone() -> Mesh:
    """Cone of radius 10, 20 high; a pyramid of 128 sides."""
    foot = _circle(10.0, 0.0, SIDES)
    return _mesh("cone", _umbrella(foot, (0.0, 0.0, 0.0))[:, ::-1], _umbrella(foot, (0.0, 0.0, 20.0)))


def sphere() -> Mesh:
    """Sphere of radius 10, with 64 meridians and 31 rings between the poles."""
    angles = [pi * i / (PARALLELS + 1) for i in range(1, PARALLELS + 1)]
    rings = [_circle(10.0 * sin(angle), 10.0 - 10.0 * cos(angle), MERIDIANS) for angle in angles]
    bottom, top = _umbrella(rings[0], (0.0, 0.0, 0.0)), _umbrella(rings[-1], (0.0, 0.0, 20.0))
    return _mesh("sphere", _walls(rings), bottom[:, ::-1], top)


def sheared_prism() -> Mesh:
    """Prism 10 x 10 x 20 that leans 45° to +x: every section has the same area, in another place."""
    rings = [_square(10.0, 0.0), _square(10.0, 20.0) + np.array([20.0, 0.0, 0.0])]
    return _mesh("sheared_prism", _walls(rings), _fan(rings[0])[:, ::-1], _fan(rings[1]))


def thin_wall() -> Mesh:
    """Plate 40 x 30 x 2 that carries four walls, 18 high and 0.4, 0.8, 1.2 and 2 thick."""
    foot, top = 2.0, 20.0
    walls = [(4.0, 4.4), (12.0, 12.8), (20.0, 21.2), (30.0, 32.0)]
    outline, facets = [(0.0, 0.0), (40.0, 0.0), (40.0, foot)], []
    feet = [2]
    for left, right in reversed(walls):
        at = len(outline)
        outline += [(right, foot), (right, top), (left, top), (left, foot)]
        facets += [(at, at + 1, at + 2), (at, at + 2, at + 3)]
        feet += [at, at + 3]
    outline.append((0.0, foot))
    rim = [1, *feet, len(outline) - 1]
    facets += [(0, a, b) for a, b in pairwise(rim)]
    return _mesh("thin_wall", _extruded(outline, facets, 30.0))


def bridge() -> Mesh:
    """Two pillars 5 x 10 x 15 and a deck 3 thick that spans 20 between them."""
    outline = [(0, 0), (5, 0), (5, 15), (25, 15), (25, 0), (30, 0), (30, 18), (0, 18)]
    facets = [(0, 1, 2), (0, 2, 7), (2, 3, 6), (2, 6, 7), (4, 5, 6), (4, 6, 3)]
    return _mesh("bridge", _extruded(outline, facets, 10.0))


def tee() -> Mesh:
    """Stem 10 x 10 x 30 with a bar 50 x 10 x 4 on it: an arm of 20 hangs on either side."""
    outline = [(20, 0), (30, 0), (30, 30), (50, 30), (50, 34), (0, 34), (0, 30), (20, 30)]
    facets = [(0, 1, 2), (0, 2, 7), (2, 3, 4), (2, 4, 5), (2, 5, 7), (5, 6, 7)]
    return _mesh("tee", _extruded(outline, facets, 10.0))


def vase() -> Mesh:
    """Twisted body with five lobes: r = (16 + 4 sin 2πu) (1 + 0.12 cos(5θ + πu)), u = z / 60.

    Smooth on every side, with overhangs and no two sections alike, as parts are that were not drawn with a
    ruler.
    """
    height, n_rings, n_points = 60.0, 41, 72
    rings = []
    for u in (i / (n_rings - 1) for i in range(n_rings)):
        radius = 16.0 + 4.0 * sin(2 * pi * u)
        angles = [2 * pi * i / n_points for i in range(n_points)]
        lobes = [radius * (1.0 + 0.12 * cos(5 * angle + pi * u)) for angle in angles]
        rings.append(
            np.array([(r * cos(t), r * sin(t), height * u) for r, t in zip(lobes, angles, strict=True)])
        )
    bottom, top = _umbrella(rings[0], (0.0, 0.0, 0.0)), _umbrella(rings[-1], (0.0, 0.0, height))
    return _mesh("vase", _walls(rings), bottom[:, ::-1], top)


PARTS: Final[Mapping[str, Callable[[], Mesh]]] = {
    "case_study": case_study,
    "box": box,
    "cylinder": cylinder,
    "sphere": sphere,
    "cone": cone,
    "sheared_prism": sheared_prism,
    "thin_wall": thin_wall,
    "bridge": bridge,
    "tee": tee,
    "vase": vase,
}


def _mesh(name: str, *surfaces: Float) -> Mesh:
    """Surfaces (n, 3, 3) as one mesh."""
    rounded = np.asarray(np.round(np.concatenate(surfaces), 4), dtype=np.float64)
    return Mesh(rounded + 0.0, name)  # + 0.0 turns -0.0 into 0.0


def _square(side: float, z: float) -> Float:
    """(4, 3) corners, counter-clockwise from above, around the z axis."""
    half = side / 2
    return np.array([(-half, -half, z), (half, -half, z), (half, half, z), (-half, half, z)])


def _circle(radius: float, z: float, n_points: int) -> Float:
    """(n_points, 3) corners of a regular polygon, counter-clockwise from above, around the z axis."""
    angles = [2 * pi * i / n_points for i in range(n_points)]
    return np.array([(radius * cos(angle), radius * sin(angle), z) for angle in angles])


def _walls(rings: list[Float]) -> Float:
    """Facets between rings of equally many points, from the lowest up, that face away from the axis."""
    low, high = np.stack(rings[:-1]), np.stack(rings[1:])
    next_low, next_high = np.roll(low, -1, axis=1), np.roll(high, -1, axis=1)
    first, second = np.stack([low, next_low, next_high], axis=2), np.stack([low, next_high, high], axis=2)
    return np.concatenate([first.reshape(-1, 3, 3), second.reshape(-1, 3, 3)])


def _fan(ring: Float) -> Float:
    """Facets that fill a convex ring from its first corner, facing up."""
    return np.stack([np.broadcast_to(ring[0], (len(ring) - 2, 3)), ring[1:-1], ring[2:]], axis=1)


def _umbrella(ring: Float, tip: tuple[float, float, float]) -> Float:
    """Facets from a ring to a point in or above it, facing up."""
    return np.stack([ring, np.roll(ring, -1, axis=0), np.broadcast_to(tip, ring.shape)], axis=1)


def _extruded(
    outline: Sequence[tuple[float, float]], facets: Sequence[tuple[int, int, int]], depth: float
) -> Float:
    """Draw an outline in x and z, counter-clockwise seen from -y, out to y = `depth`; `facets` fill it."""
    x, z = np.array(outline, dtype=np.float64).T
    front, back = np.stack([x, 0 * x, z], axis=1), np.stack([x, 0 * x + depth, z], axis=1)
    caps = np.array(facets)
    return np.concatenate([front[caps], back[caps[:, ::-1]], _walls([back, front])])


def main() -> None:
    """Write all parts."""
    for name, make in PARTS.items():
        mesh = make()
        export_stl(mesh, Path(__file__).with_name(f"{name}.stl"))
        size = " x ".join(f"{edge:g}" for edge in mesh.size)
        print(f"{name:14} {mesh.n_facets:5} facets  {size:24} {mesh.volume:11.3f} mm³")


if __name__ == "__main__":
    main()
