"""How does the nozzle get from bead to bead? Our files against those of other slicers.

    python -m benchmarks.travel [--models DIR] [--height MM] [--set KEY=VALUE] [--json FILE] [part ...]

Every part is sliced by us, by PrusaSlicer (as it is by default, and avoiding perimeters) and by CuraEngine (with lines
of our width, which hold more, and with lines that hold as much as ours) where they are installed, with the settings of
one profile in uniform layers. CuraEngine knows no shells that stay thick across slopes: beside it stands our file
without them too. All files are read by the same code: a way is
everything between two beads; the outlines that it crosses are those of the part's section in the layer of the bead it
leads to. Minutes are those of the moves on one machine, that of the profile: what files say of accelerations and other
limits is left out, nobody has start G-code beyond homing, and nobody slows down for layers to cool, which each would
reckon by an estimate of its own (`--set material.min_layer_time=8` asks all of them to). Peers' G-code is kept in
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
from printer_slicer.inspection.coverage.model_check import placed_sections, read_gcode_extrusions
from printer_slicer.model import Mesh
from printer_slicer.motion.rules import limits_of
from printer_slicer.pipeline import slice_part
from printer_slicer.placing import place
from printer_slicer.profile import Profile, profile_with

_SAME_Z = 0.02  # mm
_OURS, _UPRIGHT = "ours", "ours, shells as thick as CuraEngine's"
_NOBODY = {"printer.start_gcode": "G28", "material.min_layer_time": 0, "material.fan_layer_time": 0}


@dataclass(frozen=True, slots=True)
class Figures:
    """How the nozzle travels in one file, between its first and its last bead.

    Attributes:
        slicer: that wrote it.
        seconds: that its moves take.
        travel: mm along x and y that lay nothing.
        retractions: ways on which filament is pulled back.
        crossings: how often ways cross outlines of the part.
        crossing: ways that cross any.
        oozing: of these those without retraction that are longer than travels that need none.
        ways: between beads that do not follow each other.
        cpu: s that slicing took, for our own file.
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


def figures(slicer: str, text: bytes, part: Mesh, profile: Profile) -> Figures:
    """Read one file.

    Args:
        slicer: its name.
        text: G-code.
        part: repaired; where it lies in the file is found.
        profile: that everybody was given.

    Raises:
        UsageError: the text lays nothing.
    """
    deposit, stack = read_gcode_extrusions(text, profile.material.filament_diameter, slicer)
    stack, sections, _ = placed_sections(part, deposit, stack)
    moves = read_moves(split_gcode(text).commands, profile.printer.corners[0])
    beads, laying, _ = extrusions_of_moves(moves, profile.material.filament_diameter)
    lays = np.zeros(len(moves.speed), np.bool_)
    lays[laying] = True
    way = np.cumsum(lays)  # of a move that lays nothing: the bead it leads to
    between = ~lays & (way > 0) & (way < beads.n_beads)
    length = np.where(between, np.hypot(*moves.delta[:, :2].T), 0.0)
    travel = np.bincount(way, weights=length, minlength=beads.n_beads + 1)
    pulled = np.bincount(way[between & (moves.delta[:, 3] < 0)], minlength=len(travel)) > 0
    going = np.flatnonzero(length)
    end = moves.end[going, :2]
    count = _crossings(sections, stack.top, end - moves.delta[going, :2], end, beads.z_top[way[going]])
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


def _crossings(sections: Areas, top: Float, begin: Float, end: Float, z: Float) -> Int:
    """(P,) how often ways (P, 2) to (P, 2) cross outlines of the section at height z (P,); none without a section."""
    layer = np.clip(np.searchsorted(top, z - _SAME_Z), 0, len(top) - 1)
    there = np.abs(top[layer] - z) < _SAME_Z
    count = np.zeros(len(z), np.int64)
    count[there] = crossings(sections, begin[there], end[there], layer[there])
    return count


def main(argv: Sequence[str] | None = None) -> int:
    """Print one line per part, and how ours compare with each peer's."""
    parser = parser_of("travel", __doc__)
    parser.add_argument(
        "--walls", default="arachne", choices=("classic", "arachne"), help="of PrusaSlicer (default: arachne)"
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
        own = [_own(_OURS, part, profile), _own(_UPRIGHT, part, upright)]
        rows[part.name] = [*own, *_of_peers(part, profile, peers)]
        cells = [" / ".join(form(one) for one in rows[part.name]) for form in _COLUMNS.values()]
        print(f"| {part.name} | {' | '.join(cells)} | {rows[part.name][0].cpu:.2f} |", flush=True)
    for peer in peers:
        print(_compared(peer.name, list(rows.values()), 1 if isinstance(peer, CuraEngine) else 0))
    if options.json:
        found = {name: [asdict(one) for one in row] for name, row in rows.items()}
        options.json.write_text(json.dumps(found, indent=1), "utf-8")
    return 0


def _own(name: str, part: Mesh, profile: Profile) -> Figures:
    begun = process_time()
    text = gcode_of(slice_part(part, profile), profile)
    cpu = process_time() - begun
    return replace(figures(name, text, part, profile), cpu=cpu)


def _of_peers(part: Mesh, profile: Profile, peers: Sequence[PrusaSlicer | CuraEngine]) -> Iterator[Figures]:
    for peer in peers:
        try:
            printed = peer.uniform(Part(part, profile, WORK), profile.quality.layer_height)
            yield figures(peer.name, printed.gcode.read_bytes(), part, profile)
        except (RunError, PrinterSlicerError) as error:
            print(f"{part.name}: {peer.name}: {str(error).splitlines()[0]}")


def _compared(peer: str, rows: Sequence[Sequence[Figures]], which: int) -> str:
    """Ours by theirs: the median over the parts, the greatest, and in how many parts ours is at most theirs.

    `which` of the first figures of each row are ours.
    """
    pairs = [(row[which], one) for row in rows for one in row if one.slicer == peer]
    said = []
    for name in ("seconds", "travel", "retractions", "crossings", "oozing"):
        both = [(getattr(own, name), getattr(other, name)) for own, other in pairs]
        ratios = [own / other for own, other in both if other]
        most = sum(own <= other for own, other in both)
        spread = f"{median(ratios):.2f}, at most {max(ratios):.2f}, " if ratios else ""
        said.append(f"{name} {spread}no more in {most} of {len(both)}")
    return f"\n{(_OURS, _UPRIGHT)[which]} by {peer}: {'; '.join(said)}"


if __name__ == "__main__":
    sys.exit(main())
