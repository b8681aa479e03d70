"""Make ten parts with a layer worth looking at, and the pictures of `docs/gallery.md`, drawn from our own G-code.

    python -m benchmarks.gallery                   parts, G-code and all pictures, by the commands of docs/gallery.md
    python -m benchmarks.gallery star ribs         only these parts and pictures
    python -m benchmarks.gallery --parts           only the parts, as STL files

Parts and G-code go to the folder `gallery`, which git ignores, and pictures to `docs/gallery`.
"""

from __future__ import annotations

import argparse
import shlex
import sys
from collections.abc import Callable, Mapping, Sequence
from contextlib import chdir
from dataclasses import dataclass
from math import cos, pi, sin
from pathlib import Path
from typing import Any, Final

import numpy as np
import shapely

from printer_slicer import cli
from printer_slicer.arrays import Float
from printer_slicer.mesh_io import export_stl
from printer_slicer.model import Mesh

__all__ = ["ENTRIES", "Entry", "commands", "main", "write_part"]

ROOT: Final = Path(__file__).parents[1]
FOLDER: Final = Path("gallery")
PICTURES: Final = Path("docs/gallery")

Points = Sequence[tuple[float, float]]


@dataclass(frozen=True, slots=True)
class Entry:
    """One picture of the gallery.

    Attributes:
        part: makes the part.
        layer: layer number of the picture, from 1.
        slicing: options of `slice`.
        drawing: options of `draw`.
    """

    part: Callable[[], Mesh]
    layer: int
    slicing: str = ""
    drawing: str = ""


def commands(name: str) -> list[str]:
    """Return the commands for a picture; the part must exist."""
    entry = ENTRIES[name]
    model, gcode = FOLDER / f"{name}.stl", FOLDER / f"{name}.gcode"
    slicing = f"printer-slicer slice {model} -o {gcode} --quality standard {entry.slicing}"
    where = f"--layer {entry.layer} {entry.drawing}".strip()
    return [
        slicing.strip(),
        f"printer-slicer draw {gcode} --model {model} {where} -o {PICTURES / name}.svg",
    ]


# Parts


def wedge() -> Mesh:
    """Make a wedge, 50 mm long, that widens from a point to 6 mm: one to twelve extrusions side by side."""
    return _extrude_walls([(shapely.Polygon([(0, 0), (50, -3), (50, 3)]), 0.0, 2.0)])


def text() -> Mesh:
    """Make a plate with raised letters: strokes of 0.4, 0.6 and 1 mm."""
    rows = [(0.4, 0.0, "THIN 0.4"), (0.6, -7.5, "LESS 0.6"), (1.0, -15.0, "WIDE 1.0")]
    letters = [
        shapely.buffer(_strokes(word, 5.0, (0.0, y)), width / 2, quad_segs=6) for width, y, word in rows
    ]
    plate = shapely.box(-2.5, -17.5, 33.0, 7.5)
    return _extrude_walls([(plate, 0.0, 1.0), (shapely.union_all(letters), 0.6, 2.0)])


def holes() -> Mesh:
    """Make a plate with round, hexagonal and slotted holes, some near each other or near the edge."""
    plate = shapely.box(0, 0, 44, 28)
    cut = [_disc(x, 21.0, d) for x, d in ((3.2, 1.0), (7.0, 2.0), (12.5, 3.0), (19.5, 4.5), (29.0, 7.0))]
    cut += [_disc(38.0, 21.0, 8.0, sides=6), _disc(4.6, 8.0, 8.0), _disc(13.4, 8.0, 8.0)]
    cut += [shapely.buffer(shapely.LineString([(22, 5), (30, 11)]), 1.6, quad_segs=16)]
    cut += [shapely.box(34.5, 4.0, 41.5, 12.0)]
    return _extrude_walls([(shapely.difference(plate, shapely.union_all(cut)), 0.0, 2.0)])


def star() -> Mesh:
    """Make a star with eleven slender points."""
    corners = 11
    outline = [
        (radius * cos(pi * (2 * i + odd) / corners), radius * sin(pi * (2 * i + odd) / corners))
        for i in range(corners)
        for odd, radius in ((0, 20.0), (1, 8.0))
    ]
    return _extrude_walls([(shapely.Polygon(outline), 0.0, 3.0)])


def ribs() -> Mesh:
    """Make a frame with ribs of 0.3 to 1.6 mm that meet at right angles, at an oblique angle and in one point."""
    frame = shapely.difference(shapely.box(0, 0, 44, 28), shapely.box(1.6, 1.6, 42.4, 26.4))
    upright = [(5.0, 0.3), (9.0, 0.5), (13.0, 0.7), (17.0, 0.9), (21.0, 1.2), (25.0, 1.6)]
    bars = [shapely.box(x - w / 2, 1.0, x + w / 2, 27.0) for x, w in upright]
    bars += [shapely.box(1.0, 9.6, 25.0, 10.4), shapely.box(1.0, 17.75, 25.0, 18.25)]
    middle = shapely.Point(34.0, 14.0)
    for turn, width in ((0, 0.5), (36, 0.8), (72, 0.6), (108, 1.0), (144, 0.4)):
        bar = shapely.box(34.0 - 16.0, 14.0 - width / 2, 34.0 + 16.0, 14.0 + width / 2)
        turned = shapely.affinity.rotate(bar, turn, middle)
        bars.append(shapely.intersection(turned, shapely.box(25.0, 1.0, 43.0, 27.0)))
    return _extrude_walls([(shapely.union_all([frame, *bars]), 0.0, 2.0)])


def bridge() -> Mesh:
    """Make walls around an L-shaped, a round and a slanted cavity, under one lid."""
    block = shapely.box(0, 0, 46, 28)
    ell = shapely.Polygon([(3, 3), (21, 3), (21, 11), (11, 11), (11, 25), (3, 25)])
    slanted = shapely.Polygon([(16, 14.5), (24, 14.5), (29, 25), (21, 25)])
    rooms = shapely.union_all([ell, slanted, _disc(35.0, 10.0, 13.0, sides=96)])
    return _extrude_walls([(shapely.difference(block, rooms), 0.0, 5.0), (block, 4.0, 5.6)])


def dome() -> Mesh:
    """Make a flat dome, half an ellipsoid: 30 mm wide, 6 mm high."""
    angles = np.linspace(0.0, pi / 2, 49)
    return _revolve(15.0 * np.cos(angles), 6.0 * np.sin(angles), 160)


def gyroid() -> Mesh:
    """Make a rounded block of 36 x 30 x 12 mm."""
    return _extrude_walls([(shapely.buffer(shapely.box(6, 6, 30, 24), 6.0, quad_segs=24), 0.0, 12.0)])


def lightning() -> Mesh:
    """Make a block of 40 x 30 x 20 mm with a pocket in its top."""
    block = shapely.box(0, 0, 40, 30)
    pocket = shapely.box(24, 8, 40, 22)
    return _extrude_walls([(block, 0.0, 14.0), (shapely.difference(block, pocket), 10.0, 20.0)])


def ears() -> Mesh:
    """Make a frame with sharp, right, blunt and rounded corners."""
    outline = [(0, 0), (34, 0), (46, 10), (34, 26), (10, 26), (0, 20)]
    rounded = shapely.union(
        shapely.Polygon(outline), shapely.buffer(shapely.box(14, 18, 30, 30), 4.0, quad_segs=12)
    )
    return _extrude_walls([(shapely.difference(rounded, _disc(18.0, 13.0, 14.0, sides=96)), 0.0, 3.0)])


ENTRIES: Final[Mapping[str, Entry]] = {
    "wedge": Entry(wedge, 5, "--set perimeters=8"),
    "text": Entry(text, 8),
    "holes": Entry(holes, 5),
    "star": Entry(star, 10),
    "ribs": Entry(ribs, 5),
    "bridge": Entry(bridge, 21),
    "dome": Entry(dome, 28),
    "gyroid": Entry(gyroid, 32, "--set infill=gyroid"),
    "lightning": Entry(lightning, 62, "--set infill=lightning"),
    "ears": Entry(ears, 1, "--set brim_type=ears --set brim_width=6"),
}

# Letters

# Strokes on a grid 2 wide and 4 high.
_LETTERS: Final[Mapping[str, Sequence[Points]]] = {
    " ": (),
    ".": (((0.9, 0.0), (1.1, 0.0)),),
    "0": (((0.5, 0), (1.5, 0), (2, 0.7), (2, 3.3), (1.5, 4), (0.5, 4), (0, 3.3), (0, 0.7), (0.5, 0)),),
    "1": (((0.3, 3.2), (1, 4), (1, 0)),),
    "4": (((1.5, 0), (1.5, 4), (0, 1.3), (2, 1.3)),),
    "6": (((1.7, 4), (0.5, 2.8), (0, 1.2), (0.5, 0), (1.5, 0), (2, 0.8), (2, 1.5), (1.5, 2.2), (0.3, 2.2)),),
    "D": (((0, 0), (0, 4), (1.2, 4), (2, 3), (2, 1), (1.2, 0), (0, 0)),),
    "E": (((2, 0), (0, 0), (0, 4), (2, 4)), ((0, 2.1), (1.5, 2.1))),
    "H": (((0, 0), (0, 4)), ((2, 0), (2, 4)), ((0, 2.1), (2, 2.1))),
    "I": (((1, 0), (1, 4)),),
    "L": (((0, 4), (0, 0), (2, 0)),),
    "N": (((0, 0), (0, 4), (2, 0), (2, 4)),),
    "S": (
        ((0, 0.6), (0.6, 0), (1.4, 0), (2, 0.6), (2, 1.5), (0, 2.5), (0, 3.4), (0.6, 4), (1.4, 4), (2, 3.4)),
    ),
    "T": (((0, 4), (2, 4)), ((1, 4), (1, 0))),
    "W": (((0, 4), (0.5, 0), (1, 3), (1.5, 0), (2, 4)),),
}
_GRID: Final = 4.0  # high
_ADVANCE: Final = 3.2  # distance from letter to letter


def _strokes(word: str, height: float, place: tuple[float, float]) -> Any:
    """Return the lines of a word whose first letter starts at `place`, mm."""
    scale = height / _GRID
    lines = [
        np.array([(x + _ADVANCE * i, y) for x, y in stroke]) * scale + np.array(place)
        for i, letter in enumerate(word)
        for stroke in _LETTERS[letter]
    ]
    return shapely.MultiLineString(lines)


# Solids


def _disc(x: float, y: float, diameter: float, sides: int = 64) -> Any:
    """Return a regular polygon with its corners on a circle."""
    turn = 2 * pi * np.arange(sides) / sides
    return shapely.Polygon(diameter / 2 * np.column_stack([np.cos(turn), np.sin(turn)]) + np.array([x, y]))


def _extrude_walls(slabs: Sequence[tuple[Any, float, float]]) -> Mesh:
    """Return upright walls over areas, each between two heights; overlapping walls are united."""
    facets = [
        prism
        for area, low, high in slabs
        for polygon in shapely.get_parts(area)
        for prism in _prism(shapely.orient_polygons(polygon), low, high)
    ]
    return _mesh(np.concatenate(facets))


def _prism(polygon: Any, low: float, high: float) -> list[Float]:
    """Return the closed surface between two heights over a polygon whose outer ring is counter-clockwise."""
    triangles = shapely.get_parts(shapely.constrained_delaunay_triangles(polygon))
    flat = np.stack([_ring(triangle.exterior) for triangle in triangles])
    (ax, ay), (bx, by) = (flat[:, 1] - flat[:, 0]).T, (flat[:, 2] - flat[:, 0]).T
    turned = ax * by < ay * bx
    flat[turned] = flat[turned, ::-1]
    surfaces = [_place_at_height(flat, high), _place_at_height(flat[:, ::-1], low)]
    for ring in (polygon.exterior, *polygon.interiors):
        here = _ring(ring)
        after = np.roll(here, -1, axis=0)
        bottom, top = (
            (_place_at_height(here, low), _place_at_height(after, low)),
            (_place_at_height(here, high), _place_at_height(after, high)),
        )
        surfaces += [
            np.stack([bottom[0], bottom[1], top[1]], axis=1),
            np.stack([bottom[0], top[1], top[0]], axis=1),
        ]
    return surfaces


def _ring(ring: Any) -> Float:
    """Return the corners (n, 2) of a ring, without repeated points."""
    return np.asarray(shapely.get_coordinates(ring)[:-1], np.float64)


def _place_at_height(points: Float, z: float) -> Float:
    """Return points (..., 2) at a height."""
    return np.concatenate([points, np.full((*points.shape[:-1], 1), z)], axis=-1)


def _revolve(radii: Float, heights: Float, sides: int) -> Mesh:
    """Return the body of revolution of an outline that starts on the bed and ends on the axis."""
    turn = 2 * pi * np.arange(sides) / sides
    circle = np.column_stack([np.cos(turn), np.sin(turn)])
    rings = [
        _place_at_height(radius * circle, float(z))
        for radius, z in zip(radii[:-1], heights[:-1], strict=True)
    ]
    low, high = np.stack(rings[:-1]), np.stack(rings[1:])
    after_low, after_high = np.roll(low, -1, axis=1), np.roll(high, -1, axis=1)
    walls = [np.stack([low, after_low, after_high], axis=2), np.stack([low, after_high, high], axis=2)]
    foot, last = rings[0], rings[-1]
    middle, tip = np.zeros_like(foot), np.tile([0.0, 0.0, float(heights[-1])], (sides, 1))
    caps = [np.stack([np.roll(foot, -1, axis=0), foot, middle], axis=1)]
    caps.append(np.stack([last, np.roll(last, -1, axis=0), tip], axis=1))
    return _mesh(np.concatenate([*(wall.reshape(-1, 3, 3) for wall in walls), *caps]))


def _mesh(facets: Float) -> Mesh:
    """Return a mesh of facets (n, 3, 3), rounded so that every computer gives the same bytes."""
    return Mesh(np.round(facets, 4) + 0.0)  # + 0.0 turns -0.0 into 0.0


# Commands


def write_part(name: str, folder: Path) -> Path:
    """Write a part as STL into a folder, which is created if necessary; return the path."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{name}.stl"
    export_stl(ENTRIES[name].part(), path)
    return path


def main(argv: Sequence[str] | None = None) -> int:
    """Write parts and draw pictures; return 0, or the exit code of the command that failed."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"of {', '.join(ENTRIES)}; default: all")
    parser.add_argument("--parts", action="store_true", help="write only the parts")
    arguments = parser.parse_args(argv)
    unknown = [name for name in arguments.names if name not in ENTRIES]
    if unknown:
        parser.error(f"no part is called {unknown[0]}; known parts: {', '.join(ENTRIES)}")
    with chdir(ROOT):
        PICTURES.mkdir(exist_ok=True)
        for name in arguments.names or ENTRIES:
            print(write_part(name, FOLDER))
            for command in [] if arguments.parts else commands(name):
                code = cli.main([*shlex.split(command)[1:], "--quiet"])
                if code:
                    return code
    return 0


if __name__ == "__main__":
    sys.exit(main())
