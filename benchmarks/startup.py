"""Measure the cost of starting: CPU time of `--help` and of slicing the smallest part, beyond a bare interpreter.

    python benchmarks/startup.py [--rounds N]

Whole processes are measured, one of each command per round, so that other load on the machine affects all of them.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from statistics import median

from processes import SAMPLES, Cost, machine_note, ours, run, spread

_BARE = "python -c pass"
_HEAVY = "trimesh", "scipy", "networkx", "numba"
"""Modules that slicing an STL file must not load: each costs more than slicing a small part.

Without the compiled kernel, it needs shapely.
"""

_LOADED = (
    "import sys; from printer_slicer.cli import main; main(['slice', sys.argv[1], '-o', sys.argv[2], '-q']);"
    " from printer_slicer.kernel import load_kernel; kernel = load_kernel();"
    f" heavy = {_HEAVY!r} + (('shapely',) if kernel else ());"
    " sys.exit(', '.join(name for name in heavy if name in sys.modules) or 0)"
)


def main(argv: Sequence[str] | None = None) -> int:
    """Print one row per command; return an error if slicing an STL file loads a heavy module."""
    parser = argparse.ArgumentParser(description="Measure the CPU time of starting, in whole processes.")
    parser.add_argument("--rounds", type=int, default=15, help="measured runs of each command (default 15)")
    rounds = parser.parse_args(argv).rounds
    with tempfile.TemporaryDirectory() as folder:
        box, out = str(SAMPLES / "box.stl"), str(Path(folder) / "box.gcode")
        run([sys.executable, "-c", _LOADED, box, out])
        commands = {
            _BARE: [sys.executable, "-c", "pass"],
            "python -c 'import numpy'": [sys.executable, "-c", "import numpy"],
            "python -c 'import printer_slicer'": [sys.executable, "-c", "import printer_slicer"],
            "python -c 'import printer_slicer as ps; ps.slice_part'": [
                sys.executable,
                "-c",
                "import printer_slicer as ps; ps.slice_part",
            ],
            "printer-slicer --help": ours("--help"),
            "printer-slicer profiles": ours("profiles"),
            "printer-slicer slice box.stl": ours("slice", box, "-o", out),
        }
        costs: dict[str, list[Cost]] = {name: [] for name in commands}
        for command in commands.values():
            run(command)
        for _ in range(rounds):
            for name, command in commands.items():
                costs[name].append(run(command))
    print(machine_note())
    print(_table(costs))
    return 0


def _table(costs: dict[str, list[Cost]]) -> str:
    """Return one row per command; differences are taken within a round."""
    lines = [
        f"| command | CPU ms, median [min..max] | beyond `{_BARE}` | wall ms | peak MiB |",
        "|---|---:|---:|---:|---:|",
    ]
    for name, many in costs.items():
        cpu = [cost.cpu * 1000 for cost in many]
        beyond = [(cost.cpu - bare.cpu) * 1000 for cost, bare in zip(many, costs[_BARE], strict=True)]
        wall = median(cost.wall for cost in many) * 1000
        peak = median(cost.peak for cost in many)
        lines.append(f"| `{name}` | {spread(cpu, '.0f')} | {median(beyond):.0f} | {wall:.0f} | {peak:.0f} |")
    return "\n".join(lines)


if __name__ == "__main__":
    sys.exit(main())
