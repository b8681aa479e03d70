"""Compare the travel moves of our files with those of other slicers.

    python -m benchmarks.travel [--models DIR] [--height MM] [--set KEY=VALUE] [--json FILE] [part ...]

Every part is sliced by us, and by PrusaSlicer and CuraEngine if they are installed, with the settings of one profile in
uniform layers. PrusaSlicer runs with its defaults, and once more avoiding perimeters. CuraEngine runs with lines of our
width, which contain more material, and with lines that contain as much as ours. CuraEngine does not keep shells thick
across slopes, so it is also compared with our file without this feature.

The same code reads all files. A way is everything between two extrusions. It crosses outlines of the part's section in
the layer of the extrusion that follows. Minutes are those of the moves on the profile's machine: accelerations and
other limits in files are ignored. No file has start G-code beyond homing. No slicer slows down for layers to cool,
because each uses its own estimate (`--set material.min_layer_time=8` turns this on for all). Peers' G-code is kept in
`benchmarks/made/` and used again.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from statistics import median
from time import process_time

import numpy as np

from benchmarks.parts import options_of, parser_of, parts_of, profile_of
from benchmarks.peers import CuraEngine, Part, PrusaSlicer, find_peers
from benchmarks.processes import WORK, RunError, machine_note
from printer_slicer.arrays import Float, Int
from printer_slicer.commands import split_gcode
from printer_slicer.errors import PrinterSlicerError
from printer_slicer.gcode import read_moves
from printer_slicer.gcode_text import gcode_of
from printer_slicer.geometry import Areas, crossings
from printer_slicer.healing import repair
from printer_slicer.inspection.coverage.extrusions import extrusions_of_moves
from printer_slicer.inspection.coverage.model_check import place_sections, read_gcode_extrusions
from printer_slicer.model import Mesh
from printer_slicer.motion.rules import limits_of
from printer_slicer.pipeline import slice_part
from printer_slicer.placing import place
from printer_slicer.profile import Profile, profile_with

_SAME_Z = 0.02  # mm
_OURS, _UPRIGHT = "ours", "ours, shells as thick as CuraEngine's"
_NOBODY: dict[str, str | float] = {
    "printer.start_gcode": "G28",
    "material.min_layer_time": 0,
    "material.fan_layer_time": 0,
}


@dataclass(frozen=True, slots=True)
class Figures:
    """Travel in one file, between its first and its last extrusion.

    Attributes:
        slicer: the program that wrote the file.
        seconds: time of its moves.
        travel: length of moves along x and y without extrusion, mm.
        retractions: number of ways with a retraction.
        crossings: number of crossings of ways with outlines of the part.
        crossing: number of ways that cross an outline.
        oozing: number of these ways that have no retraction, although they are longer than travels that need none.
        ways: number of ways between extrusions that are not adjacent.
        cpu: CPU time of slicing, s, for our own file.
    """

    slicer: str
    seconds: float
    travel: float
    retractions: int
    crossings: int
    crossing: int
    oozing: int
    ways: int
    cpu: float = 0.0


_COLUMNS: Mapping[str, Callable[[Figures], str]] = {
    "minutes": lambda one: f"{one.seconds / 60:.1f}",
    "travel m": lambda one: f"{one.travel / 1000:.1f}",
    "retractions": lambda one: str(one.retractions),
    "crossings": lambda one: str(one.crossings),
    "ways that cross": lambda one: str(one.crossing),
    "of them oozing": lambda one: str(one.oozing),
}


def measure_travel(slicer: str, text: bytes, part: Mesh, profile: Profile) -> Figures:
    """Measure one file.

    Args:
        slicer: its name.
        text: G-code.
        part: the repaired part; its position in the file is found.
        profile: the common profile.

    Raises:
        UsageError: the text extrudes nothing.
    """
    deposit, stack = read_gcode_extrusions(text, profile.material.filament_diameter, slicer)
    stack, sections, _ = place_sections(part, deposit, stack)
    moves = read_moves(split_gcode(text).commands, profile.printer.corners[0])
    beads, laying, _ = extrusions_of_moves(moves, profile.material.filament_diameter)
    is_extrusion = np.zeros(len(moves.speed), np.bool_)
    is_extrusion[laying] = True
    way = np.cumsum(is_extrusion)  # for a move without extrusion, the extrusion that follows
    between = ~is_extrusion & (way > 0) & (way < beads.n_beads)
    length = np.where(between, np.hypot(*moves.delta[:, :2].T), 0.0)
    travel = np.bincount(way, weights=length, minlength=beads.n_beads + 1)
    pulled = np.bincount(way[between & (moves.delta[:, 3] < 0)], minlength=len(travel)) > 0
    going = np.flatnonzero(length)
    end = moves.end[going, :2]
    count = _count_crossings(sections, stack.top, end - moves.delta[going, :2], end, beads.z_top[way[going]])
    crossed = np.bincount(way[going], weights=count, minlength=len(travel))
    oozing = (crossed > 0) & ~pulled & (travel > profile.printer.retract_before_travel)
    alike = replace(moves, changes=(), acceleration=np.full(len(moves.speed), np.nan))
    return Figures(
        slicer=slicer,
        seconds=alike.seconds(limits_of(profile.printer)),
        travel=float(travel.sum()),
        retractions=int(pulled.sum()),
        crossings=int(crossed.sum()),
        crossing=int((crossed > 0).sum()),
        oozing=int(oozing.sum()),
        ways=int((travel > 0).sum()),
    )


def _count_crossings(sections: Areas, top: Float, begin: Float, end: Float, z: Float) -> Int:
    """Return (P,) how often ways cross outlines of the section at height z (P,); 0 without a section."""
    layer = np.clip(np.searchsorted(top, z - _SAME_Z), 0, len(top) - 1)
    there = np.abs(top[layer] - z) < _SAME_Z
    count = np.zeros(len(z), np.int64)
    count[there] = crossings(sections, begin[there], end[there], layer[there])
    return count


def main(argv: Sequence[str] | None = None) -> int:
    """Print one line per part, and the comparison with each peer."""
    parser = parser_of("travel", __doc__)
    parser.add_argument(
        "--walls",
        default="arachne",
        choices=("classic", "arachne"),
        help="perimeter generator of PrusaSlicer (default: arachne)",
    )
    parser.add_argument("--alone", action="store_true", help="only our own files")
    options = options_of(parser, argv)
    profile = profile_of(options, _NOBODY)
    prusa, cura, absent = find_peers()
    peers: list[PrusaSlicer | CuraEngine] = []
    if prusa and not options.alone:
        walls = options.walls
        peers += [PrusaSlicer(walls), PrusaSlicer(walls, avoid_crossing_perimeters="")]
    if cura and not options.alone:
        peers += [cura, CuraEngine(cura.definitions, same_beads=True)]
    print(machine_note())
    print(*absent, sep="\n", end="\n" if absent else "")
    print("each figure:", " / ".join([_OURS, _UPRIGHT, *(peer.name for peer in peers)]))
    WORK.mkdir(exist_ok=True)
    print(f"\n| part | {' | '.join(_COLUMNS)} | CPU s |\n|---|{'---:|' * (len(_COLUMNS) + 1)}", flush=True)
    rows: dict[str, list[Figures]] = {}
    upright = profile_with(profile, {"quality.slope_shell_ratio": 0})
    for mesh in parts_of(options):
        part = place(repair(mesh)[0], profile.printer)
        own = [_measure_ours(_OURS, part, profile), _measure_ours(_UPRIGHT, part, upright)]
        rows[part.name] = [*own, *_measure_peers(part, profile, peers)]
        cells = [" / ".join(form(one) for one in rows[part.name]) for form in _COLUMNS.values()]
        print(f"| {part.name} | {' | '.join(cells)} | {rows[part.name][0].cpu:.2f} |", flush=True)
    for peer in peers:
        print(_print_comparison(peer.name, list(rows.values()), 1 if isinstance(peer, CuraEngine) else 0))
    if options.json:
        found = {name: [asdict(one) for one in row] for name, row in rows.items()}
        options.json.write_text(json.dumps(found, indent=1), "utf-8")
    return 0


def _measure_ours(name: str, part: Mesh, profile: Profile) -> Figures:
    begun = process_time()
    text = gcode_of(slice_part(part, profile), profile)
    cpu = process_time() - begun
    return replace(measure_travel(name, text, part, profile), cpu=cpu)


def _measure_peers(
    part: Mesh, profile: Profile, peers: Sequence[PrusaSlicer | CuraEngine]
) -> Iterator[Figures]:
    for peer in peers:
        try:
            printed = peer.uniform(Part(part, profile, WORK), profile.quality.layer_height)
            yield measure_travel(peer.name, printed.gcode.read_bytes(), part, profile)
        except (RunError, PrinterSlicerError) as error:
            print(f"{part.name}: {peer.name}: {str(error).splitlines()[0]}")


def _print_comparison(peer: str, rows: Sequence[Sequence[Figures]], which: int) -> str:
    """Print our figures divided by a peer's: the median over the parts, the greatest, and how often ours is not above.

    `which` of the first figures of each row are ours.
    """
    pairs = [(row[which], one) for row in rows for one in row if one.slicer == peer]
    said = []
    for name in ("seconds", "travel", "retractions", "crossings", "oozing"):
        both = [(getattr(own, name), getattr(other, name)) for own, other in pairs]
        ratios = [own / other for own, other in both if other]
        most = sum(own <= other for own, other in both)
        spread = f"{median(ratios):.2f}, at most {max(ratios):.2f}, " if ratios else ""
        said.append(f"{name} {spread}not above it in {most} of {len(both)}")
    return f"\n{(_OURS, _UPRIGHT)[which]} divided by {peer}: {'; '.join(said)}"


if __name__ == "__main__":
    sys.exit(main())
