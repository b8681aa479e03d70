"""Where does the plastic lie? The material ledger of our files and of those of other slicers, side by side.

    python -m benchmarks.material [--models DIR] [--height MM] [--set KEY=VALUE] [--json FILE] [part ...]

Every part is sliced by us, by PrusaSlicer and by CuraEngine where they are installed, with the settings of one profile
in uniform layers, and every file is checked against the part with the usual rules. What is counted is all that the
ledger finds, not only what is beyond a limit; `told` is how many findings `printer-slicer check` would tell. Peers'
G-code is kept in `benchmarks/made/` and used again.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from time import process_time

import numpy as np

from benchmarks.peers import CuraEngine, Part, PrusaSlicer, find_peers
from benchmarks.processes import SAMPLES, WORK, RunError, machine_note
from benchmarks.sizes import printable
from printer_slicer.checking import Asked, check_gcode
from printer_slicer.errors import PrinterSlicerError
from printer_slicer.healing import repair
from printer_slicer.mesh_io import FORMATS, load_mesh
from printer_slicer.model import Mesh
from printer_slicer.pipeline import gcode_of, slice_part
from printer_slicer.placing import place
from printer_slicer.profile import Profile, load_profile

_HEAD = (
    "| part | slicer | layers | uncovered mm² | of the shell | outside mm² | overlap | in the air mm, longest "
    "| shell holds, least | outline off µm, worst layer | of the volume | told | check CPU s |"
)


@dataclass(frozen=True, slots=True)
class Row:
    """What the ledger says about one file; areas mm², lengths mm, shares 0 to 1."""

    part: str
    slicer: str
    layers: int
    uncovered: float
    uncovered_share: float
    outside: float
    overlap_share: float
    air: float
    air_longest: float
    shell_median: float
    shell_least: float
    outline_median: float
    outline_worst: float
    volume_share: float
    findings: int
    seconds: float

    def line(self) -> str:
        """As a row of the table."""
        cells = [
            self.part,
            self.slicer,
            f"{self.layers}",
            f"{self.uncovered:.1f}",
            f"{self.uncovered_share:.2%}",
            f"{self.outside:.1f}",
            f"{self.overlap_share:.2%}",
            f"{self.air:.0f}, {self.air_longest:.1f}",
            f"{self.shell_median:.1%}, {self.shell_least:.0%}",
            f"{1000 * self.outline_median:.0f}, {1000 * self.outline_worst:.0f}",
            f"{self.volume_share:.1%}",
            f"{self.findings}",
            f"{self.seconds:.1f}",
        ]
        return f"| {' | '.join(cells)} |"


def main(argv: Sequence[str] | None = None) -> int:
    """Print one line per part and slicer."""
    options = _options(argv)
    changes = dict(change.split("=", 1) for change in options.set)
    profile = load_profile(
        changes={
            "planner.kind": "uniform",
            "layer_height": options.height,
            "first_layer_height": options.height,
        }
        | changes
    )
    prusa, cura, absent = find_peers()
    print(machine_note())
    print(*absent, sep="\n", end="\n" if absent else "")
    rows = []
    WORK.mkdir(exist_ok=True)
    print(f"\n{_HEAD}\n|---|---|{'---:|' * 11}", flush=True)
    for mesh in _parts(options):
        for row in _rows(mesh, profile, [peer for peer in (prusa, cura) if peer]):
            rows.append(row)
            print(row.line(), flush=True)
    if options.json:
        options.json.write_text(json.dumps([asdict(row) for row in rows], indent=1), "utf-8")
    return 0


def _rows(mesh: Mesh, profile: Profile, peers: Sequence[PrusaSlicer | CuraEngine]) -> Iterator[Row]:
    part = place(repair(mesh)[0], profile.printer)
    yield _row("ours", gcode_of(slice_part(part, profile), profile), part)
    for peer in peers:
        try:
            printed = peer.uniform(Part(part, profile, WORK), profile.quality.layer_height)
            yield _row(peer.name, printed.gcode.read_bytes(), part)
        except (RunError, PrinterSlicerError) as error:
            print(f"{mesh.name}: {peer.name}: {str(error).splitlines()[0]}")


def _row(slicer: str, text: bytes, part: Mesh) -> Row:
    begun = process_time()
    check = check_gcode(text, part, Asked())
    seconds = process_time() - begun
    ledger = check.ledger
    uncovered, shell, covered = (one.area().sum() for one in (ledger.uncovered, ledger.shell, ledger.covered))
    hanging = ledger.air.length[~ledger.air.bridge]
    return Row(
        part=part.name,
        slicer=slicer,
        layers=ledger.stack.n_layers,
        uncovered=float(uncovered),
        uncovered_share=float(uncovered / shell),
        outside=float(ledger.outside.area().sum()),
        overlap_share=float(ledger.fill.overlap.sum() / covered),
        air=float(hanging.sum()),
        air_longest=float(hanging.max(initial=0.0)),
        shell_median=float(np.nanmedian(ledger.fill.shell)),
        shell_least=float(np.nanmin(ledger.fill.shell)),
        outline_median=float(np.nanmedian(ledger.outline.p95)),
        outline_worst=float(np.nanmax(ledger.outline.p95)),
        volume_share=float(ledger.volume.sum() / ledger.section_volume.sum()),
        findings=len(check.findings) + len(check.problems),
        seconds=seconds,
    )


def _parts(options: argparse.Namespace) -> Iterator[Mesh]:
    """The sample parts and those of the models folder, or only the named ones, large enough to print."""
    folders = [SAMPLES, *([options.models] if options.models else [])]
    paths = sorted(
        path
        for folder in folders
        for path in folder.iterdir()
        if path.suffix.lower().removeprefix(".") in FORMATS
    )
    for path in paths:
        if not options.parts or path.stem in options.parts:
            mesh, told = printable(load_mesh(path))
            print(told, end="\n" if told else "")
            yield Mesh(mesh.triangles, path.stem)


def _options(argv: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.material", description=__doc__.splitlines()[0]
    )
    parser.add_argument(
        "--models", type=Path, help="folder with more parts (default: $PRINTER_SLICER_MODELS)"
    )
    parser.add_argument(
        "--height", type=float, default=0.2, metavar="MM", help="of all layers (default: 0.2)"
    )
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", help="a setting for all")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write every figure")
    parser.add_argument("parts", nargs="*", metavar="part", help="only these, by name")
    options = parser.parse_args(argv)
    if options.models is None and os.environ.get("PRINTER_SLICER_MODELS"):
        options.models = Path(os.environ["PRINTER_SLICER_MODELS"])
    return options


if __name__ == "__main__":
    sys.exit(main())
