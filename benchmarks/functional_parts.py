"""Make functional parts of 600 to 63 000 facets from primitives.

    python -m benchmarks.functional_parts [FOLDER]

It writes an STL file for each part. The same version of manifold3d always writes the same files.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Final

import numpy as np
import trimesh

from benchmarks.false_alarms import Solid, subtract, unite
from benchmarks.processes import WORK
from printer_slicer import Mesh
from printer_slicer.mesh_io import export_stl

__all__ = ["PARTS", "make_part", "write_parts"]


def main(argv: Sequence[str] | None = None) -> int:
    """Write all parts and print their numbers of facets."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.functional_parts", description=__doc__.splitlines()[0]
    )
    parser.add_argument(
        "folder", nargs="?", type=Path, default=WORK, help="folder to write to (default: %(default)s)"
    )
    for path in write_parts(parser.parse_args(argv).folder):
        print(path, (path.stat().st_size - 84) // 50, "facets")
    return 0


def write_parts(folder: Path, names: Sequence[str] = ()) -> Iterator[Path]:
    """Write the named parts, or all, as STL files that do not exist yet, and return their paths."""
    folder.mkdir(parents=True, exist_ok=True)
    for name in names or PARTS:
        path = folder / f"{name}.stl"
        if not path.exists():
            export_stl(make_part(name), path)
        yield path


def make_part(name: str) -> Mesh:
    """Make one of `PARTS`, standing on z = 0."""
    solid = PARTS[name]()
    solid.apply_translation(-solid.bounds[0])
    return Mesh(np.asarray(solid.triangles, np.float64), name)


def _box(size: Sequence[float], center: Sequence[float]) -> Solid:
    solid = trimesh.creation.box(size)
    solid.apply_translation(center)
    return solid


def _cylinder(
    radius: float, height: float, center: Sequence[float], *, sections: int = 48, axis: int = 2
) -> Solid:
    solid = trimesh.creation.cylinder(radius, height, sections=sections)
    if axis != 2:
        direction = np.eye(3)[axis]
        solid.apply_transform(trimesh.geometry.align_vectors((0, 0, 1), direction))
    solid.apply_translation(center)
    return solid


def _ring_positions(count: int, radius: float) -> Iterator[tuple[float, float]]:
    for angle in np.arange(count) * 2 * np.pi / count:
        yield radius * float(np.cos(angle)), radius * float(np.sin(angle))


def _angle_bracket() -> Solid:
    """Make two plates at a right angle with a rib and four holes."""
    plates = unite(
        *[_box((50, 40, 5), (0, 0, 2.5)), _box((50, 5, 40), (0, 17.5, 20)), _box((4, 35, 20), (0, 0, 10))]
    )
    holes = [_cylinder(2.6, 20, (x, -8, 2), sections=32) for x in (-15, 15)]
    holes += [_cylinder(2.6, 20, (x, 17, 28), sections=32, axis=1) for x in (-15, 15)]
    return subtract(plates, *holes)


def _electronics_box() -> Solid:
    """Make an open box with standoffs, vents and holes for connectors."""
    shell = subtract(_box((80, 60, 30), (0, 0, 15)), _box((76, 56, 30), (0, 0, 17)))
    posts = [_cylinder(3.5, 8, (x, y, 5), sections=40) for x in (-34, 34) for y in (-24, 24)]
    screws = [_cylinder(1.3, 12, (x, y, 8), sections=24) for x in (-34, 34) for y in (-24, 24)]
    vents = [_box((2, 70, 14), (x, 0, 16)) for x in np.arange(-20.0, 21.0, 4.0)]
    sockets = [_box((10, 12, 7), (40, 0, 10)), _cylinder(4, 10, (40, 18, 12), axis=0)]
    return subtract(unite(shell, *posts), *screws, *vents, *sockets)


def _belt_pulley() -> Solid:
    """Make a belt pulley of 60 teeth with flanges, a bore and lightening holes."""
    body = unite(
        *[_cylinder(19.1, 12, (0, 0, 6), sections=240), _cylinder(21, 1.5, (0, 0, 0.75), sections=240)]
    )
    body = unite(
        *[body, _cylinder(21, 1.5, (0, 0, 11.25), sections=240), _cylinder(8, 8, (0, 0, 16), sections=120)]
    )
    teeth = [_cylinder(0.55, 9, (x, y, 6), sections=24) for x, y in _ring_positions(60, 18.9)]
    holes = [_cylinder(3, 30, (x, y, 6), sections=60) for x, y in _ring_positions(6, 13.0)]
    return subtract(body, *teeth, *holes, _cylinder(2.5, 60, (0, 0, 6), sections=90))


def _knurled_knob() -> Solid:
    """Make a knob with a knurled rim, a domed top and a hexagonal pocket."""
    dome = trimesh.creation.icosphere(5, 40)
    dome.apply_translation((0, 0, -18))
    body = trimesh.boolean.intersection(
        [_cylinder(20, 24, (0, 0, 12), sections=360), dome], engine="manifold"
    )
    grooves = [_cylinder(1.2, 60, (x, y, 10), sections=48) for x, y in _ring_positions(48, 20.3)]
    pocket = _cylinder(7.5, 13, (0, 0, 0), sections=6)
    return subtract(body, *grooves, pocket, _cylinder(3.2, 80, (0, 0, 10), sections=72))


def _threaded_adapter() -> Solid:
    """Make a flange with six holes and an external screw thread."""
    turns, per_turn, pitch, radius, depth = 8, 360, 3.0, 15.0, 1.8
    profile = np.array([(-1.5, -0.3), (-0.55, depth), (0.55, depth), (1.5, -0.3)])
    angle = np.arange(turns * per_turn + 1) * 2 * np.pi / per_turn
    rim = radius + profile[:, 1]
    height = angle[:, None] / (2 * np.pi) * pitch + profile[:, 0]
    points = np.stack([np.cos(angle)[:, None] * rim, np.sin(angle)[:, None] * rim, height], axis=-1)
    n, k = points.shape[:2]
    a = (np.arange(n - 1)[:, None] * k + np.arange(k)).ravel()
    b = (np.arange(n - 1)[:, None] * k + (np.arange(k) + 1) % k).ravel()
    sides = np.concatenate([np.column_stack([a, a + k, b]), np.column_stack([b, a + k, b + k])])
    caps = np.array(
        [(0, 1, 2), (0, 2, 3), (last := (n - 1) * k, last + 2, last + 1), (last, last + 3, last + 2)]
    )
    thread = trimesh.Trimesh(points.reshape(-1, 3), np.concatenate([sides, caps]), process=False)
    if thread.volume < 0:
        thread.invert()
    thread.apply_translation((0, 0, 8))
    tube = unite(
        *[_cylinder(28, 6, (0, 0, 3), sections=720), _cylinder(radius, 36, (0, 0, 20), sections=720)]
    )
    whole = trimesh.boolean.intersection(
        [unite(tube, thread), _box((80, 80, 36), (0, 0, 18))], engine="manifold"
    )
    holes = [_cylinder(2.2, 30, (x, y, 3), sections=180) for x, y in _ring_positions(6, 23.0)]
    return subtract(whole, *holes, _cylinder(11, 120, (0, 0, 20), sections=720))


PARTS: Final[Mapping[str, Callable[[], Solid]]] = {
    "angle_bracket": _angle_bracket,
    "electronics_box": _electronics_box,
    "belt_pulley": _belt_pulley,
    "knurled_knob": _knurled_knob,
    "threaded_adapter": _threaded_adapter,
}

if __name__ == "__main__":
    sys.exit(main())
