"""Draw the pictures of docs/supports.md: parts with columns and with trees, in 3D, from our own G-code.

    python -m benchmarks.support_pictures            all pictures
    python -m benchmarks.support_pictures tee hook   only these parts

Pictures go to `docs/supports`, parts and G-code to `benchmarks/made`.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from contextlib import chdir
from pathlib import Path
from typing import Final

from benchmarks.processes import WORK
from benchmarks.support_parts import MADE
from printer_slicer import cli
from printer_slicer.mesh_io import export_stl

__all__ = ["PARTS", "STYLES", "main"]

ROOT: Final = Path(__file__).parents[1]
PICTURES: Final = Path("docs/supports")
PARTS: Final = ("tee", "hook", "mushroom", "bracket")
STYLES: Final = ("columns", "tree")
_PIXELS: Final = "420"


def main(argv: Sequence[str] | None = None) -> int:
    """Slice the parts in each style and draw them; return 0, or the exit code of the command that failed."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"of {', '.join(PARTS)}; default: all")
    names = parser.parse_args(argv).names
    if unknown := [name for name in names if name not in PARTS]:
        parser.error(f"no part is called {unknown[0]}; known parts: {', '.join(PARTS)}")
    WORK.mkdir(parents=True, exist_ok=True)
    with chdir(ROOT):
        PICTURES.mkdir(exist_ok=True)
        for name in names or PARTS:
            part = WORK / f"{name}.stl"
            export_stl(MADE[name](), part)
            for style in STYLES:
                gcode, picture = WORK / f"{name}-{style}.gcode", PICTURES / f"{name}-{style}.png"
                sliced = ("slice", part, "-o", gcode, "--quality", "standard", "--supports", style)
                drawn = ("draw", gcode, "--3d", "--pixels", _PIXELS, "-o", picture)
                for command in (sliced, drawn):
                    code = cli.main([*map(str, command), "--quiet"])
                    if code:
                        return code
                print(picture)
    return 0


if __name__ == "__main__":
    sys.exit(main())
