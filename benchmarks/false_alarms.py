"""Slice many parts and check the G-code with `check`, `check --model` and `dry-run`, which must accept all of it.

    python -m benchmarks.false_alarms                       9 sample parts and 165 generated ones
    python -m benchmarks.false_alarms --models FOLDER       also the models in a folder
    python -m benchmarks.false_alarms --only bracket_3      parts whose name starts with this text
    python -m benchmarks.false_alarms --share 0/2           every second part, to divide the work between two processes

The parts use ten machines, three materials and four qualities in turn. Findings about unsupported extrusion are
ignored: some parts need supports and are sliced without them, and must be rejected only for that. `manifold3d` is
required.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import redirect_stderr, redirect_stdout
from io import BytesIO, StringIO, TextIOWrapper
from math import cos, pi, sin
from pathlib import Path
from typing import Any, Final

import numpy as np
import shapely
import trimesh
from manifold3d import CrossSection, FillRule
from trimesh.creation import box, cone, cylinder, icosphere, torus

from printer_slicer.cli import main as command

ROOT: Final = Path(__file__).parents[1]
MACHINES: Final = (
    "marlin_220",
    "creality_ender3",
    "creality_k1",
    "prusa_mk3s",
    "prusa_mk4",
    "prusa_mini",
    "voron_2_4_350",
    "sovol_sv06",
    "elegoo_neptune4",
    "anycubic_kobra",
)
MATERIALS: Final = ("pla", "petg", "pla")
QUALITIES: Final = ("adaptive", "standard", "draft", "fine")
ALLOWED: Final = ("unsupported", "in the air", "hang")
"""Words in findings about a part that needs supports."""

UNITS: Final = {"idler_riser": "inch", "octagonal_pocket": "m"}
"""Units of models whose coordinates are not in mm."""

Solid = trimesh.Trimesh
Random = np.random.Generator


def move_to(solid: Solid, x: float, y: float, z: float) -> Solid:
    """Return the solid, moved."""
    moved: Solid = solid.copy()
    moved.apply_translation((x, y, z))
    return moved


def subtract(solid: Solid, *tools: Solid) -> Solid:
    """Return the solid with other solids subtracted."""
    return trimesh.boolean.difference([solid, *tools], engine="manifold")


def unite(*solids: Solid) -> Solid:
    """Return the union of solids."""
    return trimesh.boolean.union(list(solids), engine="manifold")


def extrude_up(polygon: shapely.Polygon, height: float) -> Solid:
    """Return a polygon extruded upward from z = 0."""
    rings = [np.asarray(ring.coords)[:-1] for ring in (polygon.exterior, *polygon.interiors)]
    made = CrossSection(rings, FillRule.EvenOdd).extrude(height).to_mesh()
    return trimesh.Trimesh(made.vert_properties[:, :3], made.tri_verts)


def bracket(chance: Random) -> Solid:
    """Make an L of two plates with holes and a rib."""
    width, depth, height = chance.uniform(12, 30, 3)
    thick = chance.uniform(1.2, 5)
    plate = move_to(box((width, depth, thick)), width / 2, depth / 2, thick / 2)
    wall = move_to(box((thick, depth, height)), thick / 2, depth / 2, height / 2)
    rib = extrude_up(shapely.Polygon([(0, 0), (width * 0.8, 0), (0, height * 0.8)]), chance.uniform(0.8, 4))
    rib.apply_transform(trimesh.transformations.rotation_matrix(pi / 2, (1, 0, 0)))
    holes = [
        move_to(
            cylinder(chance.uniform(1, 2.5), 40, sections=int(chance.integers(8, 64))),
            width * share,
            depth / 2,
            0,
        )
        for share in (0.45, 0.75)
    ]
    return subtract(unite(plate, wall, move_to(rib, 0, depth / 2, 0)), *holes)


def enclosure(chance: Random) -> Solid:
    """Make an open box with walls of a few extrusion widths or less, with bosses and slots."""
    x, y, z = *chance.uniform(15, 40, 2), chance.uniform(6, 18)
    wall, floor = chance.uniform(0.5, 3), chance.uniform(0.6, 2)
    outer = move_to(box((x, y, z)), 0, 0, z / 2)
    inner = move_to(box((x - 2 * wall, y - 2 * wall, z)), 0, 0, z / 2 + floor)
    boss = move_to(cylinder(chance.uniform(2, 4), z - 1), x / 4, y / 4, (z - 1) / 2)
    bore = move_to(cylinder(chance.uniform(0.5, 1.4), z), x / 4, y / 4, z / 2 + floor)
    slot = move_to(box((x / 3, 4 * wall, z / 3)), 0, y / 2, z)
    return subtract(unite(subtract(outer, inner), boss), bore, slot)


def gear(chance: Random) -> Solid:
    """Make a wheel with teeth and a bore."""
    teeth, radius, depth = int(chance.integers(6, 40)), chance.uniform(6, 15), chance.uniform(0.8, 3)
    turn = np.linspace(0, 2 * pi, 4 * teeth, endpoint=False)
    radii = radius + depth * np.tile([0, 0, 1, 1], teeth)
    outline = shapely.Polygon(np.stack([radii * np.cos(turn), radii * np.sin(turn)], axis=1))
    return extrude_up(outline.difference(shapely.Point(0, 0).buffer(radius / 3)), chance.uniform(2, 8))


def turned(chance: Random) -> Solid:
    """Make a body of revolution about z."""
    count = int(chance.integers(4, 10))
    heights = np.concatenate([[0], np.sort(chance.uniform(1, 20, count)), [22]])
    radii = chance.uniform(2, 12, count + 2)
    line = [(0, 0), *zip(radii.tolist(), heights.tolist(), strict=True), (0, 22)]
    return trimesh.creation.revolve(line, sections=int(chance.integers(12, 90)))


def slivers(chance: Random) -> Solid:
    """Make boxes, cylinders and spheres that cut into each other at any angle."""
    makers: list[Callable[[], Solid]] = [
        lambda: box(chance.uniform(4, 16, 3)),
        lambda: cylinder(chance.uniform(2, 7), chance.uniform(4, 16)),
        lambda: icosphere(subdivisions=3, radius=chance.uniform(3, 8)),
    ]
    solid = box(chance.uniform(10, 18, 3))
    for k in range(int(chance.integers(2, 6))):
        tool = makers[int(chance.integers(3))]()
        tool.apply_transform(trimesh.transformations.random_rotation_matrix(chance.uniform(0, 1, 3)))
        tool = move_to(tool, *chance.uniform(-7, 7, 3))
        made = subtract(solid, tool) if k % 2 else unite(solid, tool)
        solid = made if len(made.faces) and made.volume > 50 else solid
    return solid


def grille(chance: Random) -> Solid:
    """Make a plate of thin bars with gaps between them."""
    bars, wide, gap = int(chance.integers(3, 12)), chance.uniform(0.4, 2), chance.uniform(0.5, 3)
    long, high = chance.uniform(10, 30), chance.uniform(1, 6)
    pieces = [move_to(box((wide, long, high)), k * (wide + gap), 0, high / 2) for k in range(bars)]
    across = move_to(box((bars * (wide + gap), wide, high)), (bars - 1) * (wide + gap) / 2, 0, high / 2)
    return unite(*pieces, across)


def vase(chance: Random) -> Solid:
    """Make a hollow star that turns and widens with height."""
    points, turn = int(chance.integers(3, 9)), chance.uniform(-1, 1)

    def ring(z: float, inset: float) -> Any:
        angles = np.linspace(0, 2 * pi, 120, endpoint=False)
        radius = 8 + 2 * sin(z / 4) + 1.2 * np.cos(points * (angles - turn * z / 20)) - inset
        return np.stack([radius * np.cos(angles), radius * np.sin(angles)], axis=1)

    slabs = [move_to(extrude_up(shapely.Polygon(ring(z, 0)), 0.5), 0, 0, z) for z in np.arange(0, 14, 0.5)]
    holes = [move_to(extrude_up(shapely.Polygon(ring(z, 1.4)), 0.6), 0, 0, z) for z in np.arange(1, 14, 0.5)]
    return subtract(unite(*slabs), *holes)


def rounded(chance: Random) -> Solid:
    """Make spheres and rings on a foot."""
    foot = move_to(cylinder(8, 3), 0, 0, 1.5)
    balls = [
        move_to(
            icosphere(subdivisions=3, radius=chance.uniform(3, 6)),
            chance.uniform(-5, 5),
            chance.uniform(-5, 5),
            chance.uniform(2, 6),
        )
        for _ in range(3)
    ]
    ring = move_to(torus(8, chance.uniform(1, 2.5)), 0, 0, 3)
    return subtract(unite(foot, ring, *balls), move_to(box((60, 60, 20)), 0, 0, -10))


def spikes(chance: Random) -> Solid:
    """Make cones and pins on a plate."""
    pieces = [move_to(box((24, 24, 2)), 0, 0, 1)]
    for _ in range(int(chance.integers(3, 8))):
        x, y = chance.uniform(-9, 9, 2)
        if chance.uniform() < 0.5:
            pieces.append(move_to(cone(chance.uniform(1, 4), chance.uniform(4, 15), sections=32), x, y, 1.9))
        else:
            high = chance.uniform(3, 12)
            pieces.append(move_to(cylinder(chance.uniform(0.5, 2), high), x, y, 1.9 + high / 2))
    return unite(*pieces)


def tilted(chance: Random) -> Solid:
    """Make a tilted box or prism, at any angle."""
    solid = [box(chance.uniform(6, 20, 3)), cylinder(chance.uniform(3, 8), 14, sections=6)][
        int(chance.integers(2))
    ]
    solid.apply_transform(trimesh.transformations.random_rotation_matrix(chance.uniform(0, 1, 3)))
    return move_to(solid, 0, 0, -float(solid.bounds[0, 2]))


def plate(chance: Random) -> Solid:
    """Make raised letters on a thin plate."""
    strokes = []
    for k in range(int(chance.integers(3, 9))):
        angle, x = chance.uniform(0, pi), 4 * k
        ends = [(x - 3 * cos(angle), -3 * sin(angle)), (x + 3 * cos(angle), 3 * sin(angle))]
        strokes.append(shapely.LineString(ends).buffer(chance.uniform(0.25, 1)))
    raised = shapely.union_all(strokes)
    ground = shapely.box(*shapely.buffer(raised, 2).bounds)
    low, high = chance.uniform(0.6, 1.5), chance.uniform(0.4, 2)
    tops = [move_to(extrude_up(one, high + 0.1), 0, 0, low - 0.1) for one in shapely.get_parts(raised)]
    return unite(extrude_up(ground, low), *tops)


FAMILIES: Final = (bracket, enclosure, gear, turned, slivers, grille, vase, rounded, spikes, tilted, plate)
EACH: Final = 15


def make_parts(folder: Path, models: Path | None) -> Iterator[tuple[str, Path]]:
    """Yield name and file of each part."""
    for path in sorted((ROOT / "sample_parts").glob("*.stl")):
        yield path.stem, path
    for path in sorted(models.iterdir()) if models else ():
        yield path.stem, path
    for number in range(EACH):
        for family in FAMILIES:
            name = f"{family.__name__}_{number}"
            path = folder / f"{name}.stl"
            family(np.random.default_rng([number, len(name)])).export(path)
            yield name, path


def run_command(*words: object) -> tuple[int, dict[str, Any]]:
    """Run a command with --json and return its exit code and its result."""
    out, raw = StringIO(), BytesIO()
    stream = TextIOWrapper(raw, "utf-8")
    with redirect_stdout(stream), redirect_stderr(out):
        code = command([*map(str, words), "--json"])
    stream.flush()
    text = raw.getvalue().decode()
    return code, json.loads(text) if text.strip() else {"error": out.getvalue().strip()}


def check_part(name: str, path: Path, folder: Path, turn: int) -> list[str]:
    """Return the findings of all commands about the G-code of a part, one line each."""
    gcode = folder / f"{name}.gcode"
    flags = ("--printer", MACHINES[turn % 10], "--material", MATERIALS[turn % 3])
    units = ("--units", UNITS.get(name, "mm"))
    code, facts = run_command("slice", path, *flags, *units, "--quality", QUALITIES[turn % 4], "-o", gcode)
    if code:
        return [f"slice ended with {code}: {facts.get('error', '')[:200]}"]
    found = []
    for words in (
        ("check", gcode, *flags),
        ("check", gcode, "--model", path, *flags, *units),
        ("dry-run", gcode, *flags),
    ):
        code, facts = run_command(*words)
        messages = [*_finding_texts(facts), facts.get("error", "")]
        rest = [text for text in messages if text and not any(word in text.lower() for word in ALLOWED)]
        if rest or (code and not any(messages)):
            found.append(f"{' '.join(map(str, words[:1]))} ended with {code}: {'; '.join(rest)[:300]}")
    gcode.unlink()
    return found


def _finding_texts(facts: dict[str, Any]) -> list[str]:
    """Return the texts of all findings of a command."""
    if facts.get("ok"):
        return []
    return [
        text if isinstance(text, str) else json.dumps(text)
        for key in ("problems", "findings", "faults", "lint")
        for text in facts.get(key, ())
    ]


def main(words: Sequence[str] | None = None) -> int:
    """Check all parts; return 1 if there was a finding."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--models", type=Path)
    parser.add_argument("--only", default="")
    parser.add_argument("--share", default="0/1")
    arguments = parser.parse_args(words)
    mine, of = map(int, arguments.share.split("/"))
    alarms: Counter[str] = Counter()
    count = 0
    with tempfile.TemporaryDirectory() as name:
        for turn, (part, path) in enumerate(make_parts(Path(name), arguments.models)):
            if turn % of != mine or not part.startswith(arguments.only):
                continue
            count += 1
            found = check_part(part, path, Path(name), turn)
            alarms[part] += len(found)
            for text in found:
                print(f"{part} ({MACHINES[turn % 10]}, {QUALITIES[turn % 4]}): {text}", flush=True)
            print(f"{count} {part}", flush=True)
    n_rejected = sum(number > 0 for number in alarms.values())
    print(f"{count} parts, {n_rejected} with findings")
    return int(n_rejected > 0)


if __name__ == "__main__":
    raise SystemExit(main())
