"""Compare where our files and those of other slicers put material, with the measurements of `check --model`.

    python -m benchmarks.material [--models DIR] [--height MM] [--set KEY=VALUE] [--json FILE] [part ...]

Every part is sliced by us, and by PrusaSlicer (Arachne and classic perimeters) and CuraEngine if they are installed.
All use the settings of one profile in uniform layers. Every file is compared with the part by the same rules: the shell
is as deep as the profile's perimeters, not as those of the file. There is one row per part and peer: ours / theirs and
their ratio. The ratio is in bold where ours is worse by more than the measuring error. Peers' G-code is kept in
`benchmarks/made/` and used again.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from time import process_time

import numpy as np

from benchmarks.parts import options_of, parser_of, parts_of, profile_of
from benchmarks.peers import CuraEngine, Part, PrusaSlicer, find_peers
from benchmarks.processes import WORK, RunError, machine_note
from printer_slicer import bead
from printer_slicer.arrays import Float
from printer_slicer.errors import PrinterSlicerError
from printer_slicer.gcode_text import gcode_of
from printer_slicer.healing import repair
from printer_slicer.inspection.coverage.measurement import Coverage, CoverageRules
from printer_slicer.inspection.coverage.model_check import CheckOptions, check_gcode
from printer_slicer.model import LayerPlan, Mesh
from printer_slicer.pipeline import slice_part
from printer_slicer.placing import place
from printer_slicer.profile import Profile
from printer_slicer.slicing import cut

_RESOLUTION = 0.005  # mm, layer height for layers that a file does not have
_SAME_Z = 0.02  # mm
# Changes of the figures when the same file is moved by a fraction of a cell: mm² and share, and mm. Files round
# coordinates to 0.001 mm, and the position of the part is found with the same accuracy.
_UNCOVERED_NOISE = 0.1, 0.01
_OVERLAP_NOISE = 1.0, 0.04
_LENGTH_NOISE = 0.002


@dataclass(frozen=True, slots=True)
class Figures:
    """Measurements of one file; areas mm², lengths mm, shares 0 to 1.

    Attributes:
        slicer: the program that wrote the file.
        z: (L,) tops of the layers, mm.
        missing: area of missing layers below the top of the part, mm²; it counts as uncovered.
        uncovered: uncovered area of the shell.
        overlap: area filled more than 1.3 times.
        covered: area covered by all beads of the part.
        outline: (L,) mm, 95th percentile of the distance of the outlines.
        farthest: (L,) mm, largest distance of the outlines.
        outside: covered area beyond the section, mm².
        air: greatest length of unsupported extrusion in a layer, mm.
        shell: material in the shell, divided by the material that it needs: the median over the layers.
        least: the same in the layer with the smallest value.
        volume: volume of the material, divided by that of the sections.
        findings: number of findings of `printer-slicer check` with its default limits.
        seconds: CPU time of the check.
    """

    slicer: str
    z: list[float]
    missing: float
    uncovered: float
    overlap: float
    covered: float
    outline: list[float]
    farthest: list[float]
    outside: float
    air: tuple[float, float]
    shell: float
    least: float
    volume: float
    findings: int
    seconds: float


@dataclass(frozen=True, slots=True)
class Pair:
    """One figure of both files, mm or mm², and whether ours is worse by more than the measuring error."""

    ours: float
    theirs: float
    noise: float

    @property
    def worse(self) -> bool:
        """Whether our figure is the greater one."""
        return self.ours > self.theirs + self.noise

    def cell(self, scale: float, form: str) -> str:
        """Return `ours / theirs (ratio)`, with the ratio in bold where ours is worse."""
        ratio = f"{self.ours / self.theirs:.2f}" if self.theirs > 1e-9 else "–"
        ratio = f"**{ratio}**" if self.worse else ratio
        return f"{scale * self.ours:{form}} / {scale * self.theirs:{form}} ({ratio})"


@dataclass(frozen=True, slots=True)
class Row:
    """One part: our file and that of a peer."""

    part: str
    ours: Figures
    theirs: Figures

    def compare(self) -> dict[str, Pair]:
        """Return the compared figures; outlines are compared over the layers that both files have."""
        bare = [one.uncovered + one.missing for one in (self.ours, self.theirs)]
        own, other = _common_layers(self.ours.z, self.theirs.z)

        def outline(pick: Callable[[Figures], list[float]], over: Callable[[Float], float]) -> Pair:
            first, second = np.array(pick(self.ours))[own], np.array(pick(self.theirs))[other]
            return Pair(over(first), over(second), _LENGTH_NOISE)

        return {
            "uncovered": Pair(bare[0], bare[1], _measuring_error(bare[1], _UNCOVERED_NOISE)),
            "overlap": Pair(
                self.ours.overlap, self.theirs.overlap, _measuring_error(self.theirs.overlap, _OVERLAP_NOISE)
            ),
            "outline": outline(lambda one: one.outline, lambda value: float(np.nanmean(value))),
            "farthest": outline(lambda one: one.farthest, lambda value: float(np.nanmax(value))),
        }

    def line(self) -> str:
        """Return the row in Markdown."""
        pairs = self.compare()
        cells = [
            self.part,
            self.theirs.slicer,
            f"{len(self.ours.z)} / {len(self.theirs.z)}",
            pairs["uncovered"].cell(1, ".2f"),
            pairs["overlap"].cell(1, ".1f"),
            pairs["outline"].cell(1000, ".1f"),
            pairs["farthest"].cell(1000, ".0f"),
            f"{self.ours.volume:.1%} / {self.theirs.volume:.1%}",
            f"{self.ours.findings} / {self.theirs.findings}",
        ]
        return f"| {' | '.join(cells)} |"


def _measuring_error(value: float, parts: tuple[float, float]) -> float:
    """Return by how much a figure may differ: a fixed and a proportional part."""
    return parts[0] + parts[1] * value


_HEAD = (
    "| part | peer | layers | uncovered mm² | overlap mm² | outline deviation µm, 95th percentile | maximum "
    "| material / volume of the part | findings |"
)


def main(argv: Sequence[str] | None = None) -> int:
    """Print one line per part and peer, and in how many parts our figure is not above the peer's."""
    options = options_of(parser_of("material", __doc__), argv)
    profile = profile_of(options, {})
    prusa, cura, absent = find_peers()
    peers = [peer for peer in (prusa and PrusaSlicer("arachne"), prusa, cura) if peer]
    print(machine_note())
    print(*absent, sep="\n", end="\n" if absent else "")
    WORK.mkdir(exist_ok=True)
    print(f"\n{_HEAD}\n|---|---|{'---:|' * 7}", flush=True)
    rows = []
    for mesh in parts_of(options):
        part = place(repair(mesh)[0], profile.printer)
        ours = _measure_file("ours", gcode_of(slice_part(part, profile), profile), part, profile)
        for theirs in _measure_peers(part, profile, peers):
            rows.append(Row(part.name, ours, theirs))
            print(rows[-1].line(), flush=True)
        if not peers:
            print(Row(part.name, ours, ours).line(), flush=True)
    for peer in peers:
        print(_print_tally(peer.name, [row for row in rows if row.theirs.slicer == peer.name]))
    if options.json:
        options.json.write_text(json.dumps([asdict(row) for row in rows], indent=1), "utf-8")
    return 0


def _measure_peers(
    part: Mesh, profile: Profile, peers: Sequence[PrusaSlicer | CuraEngine]
) -> Iterator[Figures]:
    for peer in peers:
        try:
            printed = peer.uniform(Part(part, profile, WORK), profile.quality.layer_height)
            yield _measure_file(peer.name, printed.gcode.read_bytes(), part, profile)
        except (RunError, PrinterSlicerError) as error:
            print(f"{part.name}: {peer.name}: {str(error).splitlines()[0]}")


def _measure_file(slicer: str, text: bytes, part: Mesh, profile: Profile) -> Figures:
    quality, width = profile.quality, profile.extrusion_width
    shell = width + (quality.perimeters - 1) * float(bead.spacing(width, quality.layer_height))
    begun = process_time()
    check = check_gcode(text, part, CheckOptions(rules=CoverageRules(shell=shell)))
    seconds = process_time() - begun
    coverage = check.coverage
    hanging = np.array([one.length for one in coverage.unsupported])
    return Figures(
        slicer=slicer,
        z=coverage.stack.top.tolist(),
        missing=_missing_area(coverage, part, quality.layer_height),
        uncovered=float(coverage.uncovered.area().sum()),
        overlap=float(coverage.fill.overlap.sum()),
        covered=float(coverage.covered.area().sum()),
        outline=coverage.outline.p95.tolist(),
        farthest=coverage.outline.largest.tolist(),
        outside=float(coverage.outside.area().sum()),
        air=(float(hanging.sum()), float(hanging.max(initial=0.0))),
        shell=float(np.nanmedian(coverage.fill.shell)),
        least=float(np.nanmin(coverage.fill.shell)),
        volume=float(coverage.volume.sum() / coverage.section_volume.sum()),
        findings=len(check.findings) + len(check.problems),
        seconds=seconds,
    )


def _missing_area(coverage: Coverage, part: Mesh, height: float) -> float:
    """Return the area, mm², of the layers that are missing between the last layer of a file and the top of the part."""
    top = np.arange(float(coverage.stack.top[-1]) + height, part.height + height / 2 - 1e-6, height)
    middle = top - height / 2
    top, middle = top[middle < part.height], middle[middle < part.height]
    return float(cut(part, LayerPlan(top, middle), _RESOLUTION).solid.area().sum()) if len(top) else 0.0


def _common_layers(own: Sequence[float], other: Sequence[float]) -> tuple[list[int], list[int]]:
    """Return the indices of the layers of two files that end at the same height."""
    near = np.abs(np.subtract.outer(np.array(own), np.array(other))) < _SAME_Z
    first, second = np.nonzero(near)
    return first.tolist(), second.tolist()


def _print_tally(peer: str, rows: Sequence[Row]) -> str:
    """Print in how many parts our figure is not above the peer's."""
    pairs = [row.compare() for row in rows]
    said = (
        f"{name} {sum(not one[name].worse for one in pairs)} of {len(pairs)}"
        for name in (pairs[0] if pairs else ())
    )
    return f"\nthese figures of ours are not above those of {peer}: {', '.join(said)}"


if __name__ == "__main__":
    sys.exit(main())
