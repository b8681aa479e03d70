"""Every pair of shipped profiles that makes sense prints a small part on the simulated printer.

    python -m benchmarks.profiles [NAME ...]

All printers with all qualities (of PLA) and with all materials (of standard quality); with names, only those pairs that
hold one of them. Pairs whose settings contradict each other are listed with the reason. The exit code is 1 if any
other pair does not print as intended.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from itertools import product
from pathlib import Path
from time import process_time

from printer_slicer import dry_run, job_of, load_mesh, load_profile, transformed
from printer_slicer.errors import PrinterSlicerError, ProfileError
from printer_slicer.profile import KINDS, profile_paths

PART = Path(__file__).parent.parent / "sample_parts" / "cone.stl"
SCALE = 0.3

Names = tuple[str, str, str]


def pairs() -> Iterator[Names]:
    """Printer x quality and printer x material."""
    printers, materials, qualities = (list(profile_paths(kind)) for kind in KINDS)
    yield from ((printer, "pla", quality) for printer, quality in product(printers, qualities))
    yield from (
        (printer, material, "standard")
        for printer, material in product(printers, materials)
        if material != "pla"
    )


def outcome(names: Names) -> tuple[str, str]:
    """ok, refused or wrong; and why."""
    try:
        profile = load_profile(*names)
    except ProfileError as error:
        return "refused", str(error).splitlines()[0].rpartition("toml: ")[2]
    try:
        verdict = dry_run(job_of(transformed(load_mesh(PART), scale=SCALE), profile), profile)
    except PrinterSlicerError as error:
        return "wrong", str(error)
    return ("ok", "") if verdict.ok else ("wrong", "; ".join(verdict.problems))


def main(wanted: Sequence[str]) -> int:
    """Print what came of each pair that did not simply print."""
    chosen = [names for names in pairs() if not wanted or set(wanted) & set(names)]
    begun, count = process_time(), {"ok": 0, "refused": 0, "wrong": 0}
    for names in chosen:
        what, why = outcome(names)
        count[what] += 1
        if why:
            print(f"{what:<8}{' '.join(names)}: {why}")
    told = ", ".join(f"{number} {what}" for what, number in count.items())
    print(f"{len(chosen)} pairs: {told}; {process_time() - begun:.0f} s of CPU")
    return 1 if count["wrong"] else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
