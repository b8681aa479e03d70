"""Write the output of the commands for many parts and profiles, and compare it with earlier output.

    python -m benchmarks.golden write build/golden/before
    python -m benchmarks.golden write build/golden/after
    python -m benchmarks.golden compare build/golden/before build/golden/after

The command line slices every case. Its plan, check and dry run are written as JSON beside the G-code. Refactor between
the two runs: differences are shown, and the exit code is then 1. The version in the first line of G-code is not
compared. Of thumbnails, the pixels are compared, not the bytes.
"""

from __future__ import annotations

import argparse
import difflib
import io
import re
import subprocess
import sys
from base64 import b64decode
from collections.abc import Iterator, Sequence
from hashlib import sha256
from pathlib import Path
from typing import Final, NamedTuple

from PIL import Image

from benchmarks.gallery import write_part
from printer_slicer.mesh_io import export_stl, load_mesh
from printer_slicer.model import Mesh

ROOT: Final = Path(__file__).parents[1]
PARTS: Final = ROOT / "sample_parts"
SHOWN: Final = 12  # lines of a difference that are printed
FIRMWARES: Final = ("klipper", "marlin", "marlin_legacy", "prusa", "repetier", "reprapfirmware", "smoothie")


class Case(NamedTuple):
    """One part, or several, and the options for slicing."""

    name: str
    models: tuple[str, ...]
    options: tuple[str, ...] = ()


def _set(*changes: str) -> tuple[str, ...]:
    return tuple(word for change in changes for word in ("--set", change))


CASES: Final = (
    *(
        Case(f"firmware_{flavour}", ("gallery:holes",), _set(f"printer.flavour={flavour}"))
        for flavour in FIRMWARES
    ),
    Case("planner_uniform", ("cone",), ("--planner", "uniform")),
    Case("planner_area", ("case_study",), ("--quality", "case_study", "--printer", "marlin_220_06")),
    Case("planner_cusp", ("sphere",), ("--planner", "cusp")),
    Case("planner_stepwise", ("cone",), ("--planner", "stepwise")),
    Case("planner_genetic", ("cone",), ("--planner", "genetic", *_set("quality.planner.generations=20"))),
    Case("planner_optimal", ("sphere",)),
    Case("time_budget", ("cone",), ("--time-budget", "25m")),
    Case("max_layers", ("sphere",), ("--max-layers", "60")),
    Case(
        "height_range", ("cone",), ("--range", "4:8:layer_height=0.12", "--range", "8:10:infill_density=0.4")
    ),
    Case("raft", ("thin_wall",), _set("raft_height=0.9")),
    Case("spiral", ("vase",), ("--quality", "vase")),
    Case("arcs", ("cylinder",), _set("arc_tolerance=0.02")),
    Case("scarf", ("cylinder",), _set("scarf_length=10", "scarf_inner=true")),
    Case(
        "thick_interior",
        ("box",),
        _set("internal_infill_every=0.3", "perimeters_every=0.3", "layer_height=0.1"),
    ),
    Case("infill_gyroid", ("gallery:gyroid",), _set("infill=gyroid")),
    Case("infill_lightning", ("gallery:dome",), _set("infill=lightning")),
    Case("infill_honeycomb", ("box",), _set("infill=honeycomb", "infill_angle_deg=30")),
    Case("bridges", ("bridge",)),
    Case("text", ("gallery:text",), _set("single_top_perimeter=true", "ironing=true")),
    Case("ribs", ("gallery:ribs",), ("--printer", "prusa_mk4")),
    Case("ears", ("gallery:ears",), _set("brim_width=5", "brim_type=ears")),
    Case("star_fast", ("gallery:star",), ("--printer", "creality_k1", "--material", "petg")),
    Case(
        "relative_hop_wipe",
        ("gallery:holes",),
        _set("z_hop=0.4", "wipe_distance=2", "relative_extrusion=false"),
    ),
    Case("firmware_retraction", ("gallery:star",), _set("firmware_retraction=true", "seam=rear")),
    Case(
        "compensated",
        ("gallery:holes",),
        _set("xy_compensation=-0.05", "hole_compensation=0.1", "elephant_foot=0.2"),
    ),
    Case("slow_link", ("gallery:star",), _set("link_lines_per_second=60", "baud=57600")),
    Case(
        "two_objects",
        ("box", "beside:cone"),
        ("--set-for", "box:infill_density=0.5", "--set-for", "box:perimeters=3"),
    ),
    Case("labels_klipper", ("box", "beside:cone"), ("--printer", "voron_trident_300")),
    Case("paused", ("cylinder",), _set("pause_at=4, 7.5")),
    Case("strong_delta", ("cylinder",), ("--printer", "flsun_qqs_pro", "--quality", "strong")),
)


def main(argv: Sequence[str] | None = None) -> int:
    """Write or compare; return 1 if something differs."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    commands = parser.add_subparsers(dest="command", required=True)
    writing = commands.add_parser("write", help="slice all cases into a folder")
    writing.add_argument("folder", type=Path)
    writing.add_argument("--only", nargs="+", metavar="CASE", default=[case.name for case in CASES])
    comparing = commands.add_parser("compare", help="show the differences between two folders")
    comparing.add_argument("before", type=Path)
    comparing.add_argument("after", type=Path)
    options = parser.parse_args(argv)
    if options.command == "write":
        for case in CASES:
            if case.name in options.only:
                write(case, options.folder)
                print(case.name, flush=True)
        return 0
    found = list(differences(options.before, options.after))
    print("\n".join(found) or "nothing differs")
    return 1 if found else 0


def write(case: Case, folder: Path) -> None:
    """Write the G-code of a case, and the JSON of its plan, check and dry run, into a folder."""
    home = (folder / case.name).resolve()
    home.mkdir(parents=True, exist_ok=True)
    models = [_write_model(model, home) for model in case.models]
    _write_output(home, "plan.json", "plan", *models, *case.options, "--json")
    _write_output(home, "slice.json", "slice", *models, "-o", "part.gcode", *case.options, "--json")
    _write_output(home, "check.json", "check", "part.gcode", "--model", *models, "--json")
    _write_output(home, "dry_run.json", "dry-run", "part.gcode", "--json")


def _write_output(home: Path, name: str, *arguments: str) -> None:
    """Write stdout, stderr and exit code of a command to a file."""
    command = [sys.executable, "-m", "printer_slicer", *arguments]
    done = subprocess.run(command, cwd=home, capture_output=True, text=True, check=False)
    (home / name).write_text(f"{done.stdout}{done.stderr}exit code {done.returncode}\n", encoding="utf-8")


def _write_model(name: str, home: Path) -> str:
    """Return the file name of a part; `gallery:` is a part of the gallery, `beside:` one moved to the side."""
    kind, _, part = name.rpartition(":")
    if kind == "gallery":
        return write_part(part, home).name
    mesh = load_mesh(PARTS / f"{part}.stl")
    moved = Mesh(mesh.triangles + ((40.0, 5.0, 0.0) if kind == "beside" else 0.0), part)
    export_stl(moved, home / f"{part}.stl")
    return f"{part}.stl"


def differences(before: Path, after: Path) -> Iterator[str]:
    """Return a line for each file that differs or is in only one of two folders."""
    names = sorted({path.relative_to(side) for side in (before, after) for path in side.rglob("*.*")})
    for name in names:
        old, new = before / name, after / name
        if not (old.exists() and new.exists()):
            yield f"{name}: only in {after if new.exists() else before}"
        elif old.read_bytes() != new.read_bytes() and (was := _comparable_lines(old)) != (
            now := _comparable_lines(new)
        ):
            changes = list(difflib.unified_diff(was, now, lineterm="", n=0))[2:]
            shown = [f"  {line[:160]}" for line in changes[:SHOWN]]
            yield "\n".join([f"{name}: {len(changes)} lines of difference", *shown])


def _comparable_lines(path: Path) -> list[str]:
    """Return the lines of a file that are compared."""
    text = re.sub(r"^(; generated by \w+) [\d.]+", r"\1", path.read_text(encoding="utf-8", errors="replace"))
    return re.sub(
        r"(?s)(?<=; thumbnail begin )(\S+) \d+\n(.*?)(?=; thumbnail end)", _hash_pixels, text
    ).splitlines()


def _hash_pixels(found: re.Match[str]) -> str:
    """Return the size of a thumbnail and a checksum of its pixels."""
    picture = Image.open(io.BytesIO(b64decode(found[2].replace("; ", ""))))
    return f"{found[1]} {sha256(picture.convert('RGBA').tobytes()).hexdigest()}\n"


if __name__ == "__main__":
    raise SystemExit(main())
