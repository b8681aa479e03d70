"""Write a wide plate with many islands for measurements: 35 twisted gears on a base of 304 x 214 mm, as binary STL.

    python -m benchmarks.plate [--output FILE]

The plate is 25.8 mm high: 129 layers of 0.2 mm with about 700 simplified contour points each. Every gear overlaps the
base, as in parts that are drawn as several bodies.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from benchmarks.processes import WORK

ACROSS, DEEP, PITCH = 7, 5, 42.0  # number of gears, and their distance, mm
BASE, INSIDE, TOP = 3.0, 2.0, 25.8  # mm: top of the base, bottom and top of the gears
TEETH, BORE, RINGS, TWIST = 7, 10, 48, 0.9  # two corners for each tooth; twist from bottom to top in radians
FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])


def main() -> int:
    """Write the plate."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--output", type=Path, default=WORK / "plate.stl")
    path = parser.parse_args().output
    triangles = np.concatenate([base(), *(gear(k % ACROSS, k // ACROSS) for k in range(ACROSS * DEEP))])
    facets = np.zeros(len(triangles), FACET)
    facets["corners"] = triangles
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(b"plate".ljust(80) + len(facets).to_bytes(4, "little") + facets.tobytes())
    print(f"{path}: {len(facets)} facets, {path.stat().st_size} bytes")
    return 0


def base() -> np.ndarray:
    """Return the base plate (12, 3, 3), mm."""
    low = np.array([-152.0, -107.0, 0.0])
    corners = np.array([(x, y, z) for z in (0, 1) for x, y in ((0, 0), (1, 0), (1, 1), (0, 1))])
    corners = low + corners * [304.0, 214.0, BASE]
    sides = [(k, (k + 1) % 4, (k + 1) % 4 + 4, k + 4) for k in range(4)]
    quads = np.array([(3, 2, 1, 0), (4, 5, 6, 7), *sides])
    return corners[np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])]


def gear(column: int, row: int) -> np.ndarray:
    """Return a gear (F, 3, 3) with a bore, mm, twisted around its axis; every second one turns the other way."""
    middle = (np.array([column, row]) - [(ACROSS - 1) / 2, (DEEP - 1) / 2]) * PITCH
    sense = 1 if (column + row) % 2 else -1
    outer = np.arange(2 * TEETH) * np.pi / TEETH
    radius = np.where(np.arange(2 * TEETH) % 2, 14.0, 18.0) - 0.3 * column
    inner = np.arange(BORE) * 2 * np.pi / BORE
    heights = np.linspace(INSIDE, TOP, RINGS)
    walls = []
    for angles, radii, outward in ((outer, radius, True), (inner, np.full(BORE, 6.0), False)):
        turned = angles + sense * TWIST * (heights[:, None] - INSIDE) / (TOP - INSIDE)
        ring = np.stack([radii * np.cos(turned), radii * np.sin(turned)], axis=2) + middle
        walls.append((np.dstack([ring, np.broadcast_to(heights[:, None], turned.shape)]), outward))
    parts = [side(rings, outward) for rings, outward in walls]
    parts += [cap(walls[0][0][end], walls[1][0][end], middle, up=end < 0) for end in (0, -1)]
    return np.concatenate(parts)


def side(rings: np.ndarray, outward: bool) -> np.ndarray:
    """Return the wall (2 (R - 1) n, 3, 3) through rings (R, n, 3)."""
    a, b = rings[:-1], np.roll(rings[:-1], -1, axis=1)
    c, d = np.roll(rings[1:], -1, axis=1), rings[1:]
    facets = np.concatenate([np.stack([a, b, c], axis=2), np.stack([a, c, d], axis=2)]).reshape(-1, 3, 3)
    return facets if outward else facets[:, ::-1]


def cap(outer: np.ndarray, inner: np.ndarray, middle: np.ndarray, *, up: bool) -> np.ndarray:
    """Return the end face (F, 3, 3) between two rings."""
    angle = [np.arctan2(*(ring[:, :2] - middle).T[::-1]) for ring in (outer, inner)]
    first = [int(np.argmin(one)) for one in angle]
    rings = [np.roll(ring, -k, axis=0) for ring, k in zip((outer, inner), first, strict=True)]
    walk = [np.append(np.sort(one), np.pi + np.inf) for one in angle]
    facets, place = [], [0, 0]
    n, m = len(outer), len(inner)
    while place[0] < n or place[1] < m:
        i, j = place
        on_outer = j == m or (i < n and walk[0][min(i + 1, n)] <= walk[1][min(j + 1, m)])
        if on_outer and i == n:
            on_outer = False
        ahead = rings[0][(i + 1) % n] if on_outer else rings[1][(j + 1) % m]
        facets.append([rings[0][i % n], ahead, rings[1][j % m]])
        place[0 if on_outer else 1] += 1
    made = np.array(facets)
    return made if up else made[:, ::-1]


if __name__ == "__main__":
    raise SystemExit(main())
