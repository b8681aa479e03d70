"""Compare print times of shipped printers with the published process of the same machine, on one motion model.

    python -m benchmarks.machines [--models DIR] [--machine NAME ...] [--json FILE] [part ...]

Three files are compared for every machine and part: ours with the former speeds, which were the same for all printers;
ours now; and PrusaSlicer's with the machine's published speeds, flow, layer time and minimum speed
(`vendor_speeds.py`). Shells, widths, infill, layers of 0.2 mm, retraction, start and end are ours in all three.
PrusaSlicer 2.5 lacks some accelerations and an infill speed for the first layer. They are added to its file, role by
role, before it is timed. The same code reads and times all files, with the limits of our printer.
"""

from __future__ import annotations

import json
import re
import shutil
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

import numpy as np

from benchmarks.parts import options_of, parser_of
from benchmarks.processes import SAMPLES, run
from benchmarks.prusa_settings import prusa_settings
from benchmarks.vendor_speeds import MACHINES, Vendor
from printer_slicer.firmware import FLAVOURS
from printer_slicer.gcode_text import gcode_of
from printer_slicer.jobs import build_job
from printer_slicer.mesh_io import load_mesh
from printer_slicer.model import Mesh
from printer_slicer.motion.rules import limits_of
from printer_slicer.pipeline import slice_part
from printer_slicer.placing import place
from printer_slicer.profile import Profile, load_profile, profile_with

PEER: Final = "prusa-slicer"
MOST: Final = 1.05
"""Largest allowed ratio of our minutes to the vendor's."""

PARTS: Final = ("benchy", "bp_case", "crazyradio")
"""Parts from the models folder that are used if no part is named; without the folder, `SAMPLE_PARTS` are used."""

SAMPLE_PARTS: Final = ("case_study", "thin_wall")
_BARE: Final = {"start_gcode": "", "end_gcode": "", "progress": False, "printer.thumbnails": []}
_OLD: Final = {
    "speeds.external_perimeter": 35,
    "speeds.perimeter": 50,
    "speeds.internal_infill": 70,
    "speeds.solid_infill": 60,
    "speeds.top_solid_infill": 40,
    "speeds.gap_fill": 50,
    "speeds.bridge": 30,
    "speeds.internal_bridge": 40,
    "speeds.travel": 150,
    "speeds.first_layer": 20,
    "printer.hotend_max_flow": 12,
    "printer.speeds.small_perimeter": 0,
    "printer.speeds.overhang_75": 0,
    "printer.speeds.overhang_50": 0,
    "printer.speeds.overhang_25": 0,
}
"""The former speeds of all printers."""

_ACCELERATED: Final[Mapping[str, int]] = {
    "External perimeter": 1,
    "Perimeter": 2,
    "Overhang perimeter": 6,
    "Internal infill": 3,
    "Solid infill": 4,
    "Top solid infill": 5,
    "Bridge infill": 6,
}
"""PrusaSlicer's roles and their indices in `Vendor.accelerations`; other roles have the default."""

_FIRST, _TRAVEL = 7, 8
_INFILL: Final = ("Internal infill", "Solid infill", "Top solid infill")


@dataclass(frozen=True, slots=True)
class Row:
    """Minutes of one part on one machine; nan if a program is missing."""

    machine: str
    part: str
    before: float
    now: float
    vendor: float

    @property
    def ratio(self) -> float:
        """Return our present minutes divided by the vendor's."""
        return self.now / self.vendor


def main(argv: Sequence[str] | None = None) -> int:
    """Print the table; return 1 if ours take longer than allowed."""
    parser = parser_of("machines", __doc__ or "")
    parser.add_argument("--machine", action="append", choices=[*MACHINES], help="only these printers")
    options = options_of(parser, argv)
    if not shutil.which(PEER):
        print(f"{PEER} is not installed, and the comparison needs it")
        return 0
    rows = []
    for part in _parts(options.models, options.parts):
        for machine in options.machine or MACHINES:
            rows.append(_measure_row(machine, part, load_mesh(part)))
            print(f"measured {machine}, {part.stem}", file=sys.stderr)
    print("\n".join(table(rows)))
    if options.json:
        options.json.write_text(json.dumps([asdict(row) for row in rows], indent=1) + "\n")
    slow = [row for row in rows if row.ratio > MOST]
    print(f"\n{len(rows) - len(slow)} of {len(rows)} within {MOST:g} of the vendor's minutes")
    return int(bool(slow))


def _parts(models: Path | None, wanted: Sequence[str]) -> Iterator[Path]:
    folders = [SAMPLES, *([models] if models else [])]
    known = {path.stem: path for folder in folders for path in sorted(folder.iterdir())}
    names = list(wanted) or [name for name in PARTS if name in known] or SAMPLE_PARTS
    for name in names:
        if name not in known:
            sys.exit(f"no part {name}; known parts: {', '.join(known)}")
        yield known[name]


def table(rows: Sequence[Row]) -> Iterator[str]:
    """Return the rows in Markdown."""
    yield "| machine | part | minutes before | now | vendor | now / vendor |"
    yield "|---|---|---|---|---|---|"
    for row in rows:
        yield (
            f"| `{row.machine}` | {row.part} | {row.before:.1f} | {row.now:.1f} | {row.vendor:.1f} | {row.ratio:.2f} |"
        )


def _measure_row(machine: str, path: Path, mesh: Mesh) -> Row:
    vendor = MACHINES[machine]
    now = load_profile(machine, quality="standard", changes=_BARE)
    before = _former_profile(now, vendor)
    part = place(mesh, now.printer)
    past, present = (
        _total_minutes(gcode_of(slice_part(part, profile), profile), profile) for profile in (before, now)
    )
    with TemporaryDirectory() as folder:
        text = _slice_with_vendor_speeds(part, now, vendor, Path(folder))
    return Row(
        machine, path.stem, past, present, _total_minutes(apply_published_values(text, vendor, now), now)
    )


def _former_profile(now: Profile, vendor: Vendor) -> Profile:
    """Return the profile with the speeds that all printers had, and the former limits of this one."""
    speed, acceleration = vendor.before
    limits = {f"printer.max_speed_{axis}": speed for axis in "xy"}
    hard = dict.fromkeys(
        ("printer.acceleration", "printer.travel_acceleration", "accelerations.default"), acceleration
    )
    return profile_with(now, {**_OLD, **limits, **hard, "accelerations.first_layer": acceleration})


def _total_minutes(text: bytes, profile: Profile) -> float:
    printer = profile.printer
    job = build_job(
        "file", text, limits=limits_of(printer), corner=printer.corners[0], flavour=printer.flavour
    )
    return job.seconds / 60


def _slice_with_vendor_speeds(part: Mesh, profile: Profile, vendor: Vendor, folder: Path) -> str:
    """Return PrusaSlicer's file of the part with the vendor's speeds."""
    outer, inner, sparse, solid, top, gap, bridge, small, travel, first, _ = vendor.speeds
    printer, height = profile.printer, profile.quality.layer_height
    settings = prusa_settings(profile, "arachne") | {
        "layer-height": f"{height:g}",
        "first-layer-height": f"{profile.quality.first_layer_height:g}",
        "external-perimeter-speed": f"{outer:g}",
        "perimeter-speed": f"{inner:g}",
        "infill-speed": f"{sparse:g}",
        "solid-infill-speed": f"{solid:g}",
        "top-solid-infill-speed": f"{top:g}",
        "gap-fill-speed": f"{gap:g}",
        "bridge-speed": f"{bridge:g}",
        "small-perimeter-speed": f"{small:g}",
        "travel-speed": f"{min(travel, max(printer.max_speed_x, printer.max_speed_y)):g}",
        "first-layer-speed": f"{first:g}",
        "max-print-speed": "1000",
        "filament-max-volumetric-speed": f"{vendor.flow:g}",
        "slowdown-below-layer-time": f"{vendor.layer_time:g}",
        "min-print-speed": f"{vendor.slowest:g}",
        "machine-limits-usage": "ignore",
    }
    source, target = folder / "part.stl", folder / "part.gcode"
    write_stl(source, part)
    words = [
        word for key, text in settings.items() for word in ([f"--{key}", text] if text else [f"--{key}"])
    ]
    run([PEER, "--export-gcode", str(source), "--output", str(target), *words])
    return target.read_text("utf-8")


def write_stl(path: Path, part: Mesh) -> None:
    """Write a binary STL file."""
    record = np.zeros(
        part.n_facets, np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("more", "<u2")])
    )
    record["corners"] = part.triangles
    path.write_bytes(bytes(80) + np.uint32(part.n_facets).tobytes() + record.tobytes())


def apply_published_values(text: str, vendor: Vendor, profile: Profile) -> bytes:
    """Add the accelerations of every role and the published infill speed of the first layer to PrusaSlicer's file.

    Args:
        text: PrusaSlicer's file, without accelerations of its own.
        vendor: the published values.
        profile: our profile; its firmware and limits apply to the accelerations.
    """
    printer, accelerations = profile.printer, vendor.accelerations
    most = min(printer.max_acceleration_x, printer.max_acceleration_y)
    set_to = FLAVOURS[printer.flavour].acceleration
    one = printer.firmware.has_single_acceleration
    lines = [] if one else [f"M204 T{min(accelerations[_TRAVEL], most):g}"]
    role, layer, now = "", 0, 0.0
    for line in text.splitlines():
        layer += line.startswith(";LAYER_CHANGE")
        role = line.removeprefix(";TYPE:") if line.startswith(";TYPE:") else role
        if line.startswith("M204"):
            continue
        found = re.match(r"G1 (?=.*[XY])", line)
        is_extrusion = " E" in line
        if found and (is_extrusion or one):
            which = _FIRST if layer == 1 else _ACCELERATED.get(role, 0)
            wanted = min(accelerations[which if is_extrusion else _TRAVEL], most)
            if wanted != now:
                lines.append(set_to(wanted))
                now = wanted
        slow = layer == 1 and role in _INFILL and re.fullmatch(r"G1 F[\d.]+", line)
        lines.append(f"G1 F{60 * vendor.speeds[-1]:g}" if slow else line)
    return ("\n".join(lines) + "\n").encode()


if __name__ == "__main__":
    sys.exit(main())
