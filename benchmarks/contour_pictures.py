"""Draw the pictures of docs/contoured-tops.md, and make the part for its test print.

    python -m benchmarks.contour_pictures                    the pictures in docs/contoured
    python -m benchmarks.contour_pictures --part wedges.stl  the part: wedges of 5, 10, 15 and 20 degrees

A picture is a section along the slope: each extrusion that crosses it is a box of its width and local height.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final

import numpy as np

from printer_slicer.mesh_io import export_stl
from printer_slicer.pipeline import slice_stages
from printer_slicer.profile import load_profile
from printer_slicer.roles import ROLES, Role
from printer_slicer.stages import Stages
from tests.contoured_parts import wedge, wedge_height, wedges

__all__ = ["draw_section", "main"]

FOLDER: Final = Path(__file__).parents[1] / "docs" / "contoured"
_DEGREES: Final = 10.0
_SIZE: Final = (9.0, 8.0)  # mm
_SCALE: Final = 80.0  # px/mm
_MARGIN: Final = 0.15  # mm
_MIN_CROSSING: Final = 0.2  # sine of the angle between the section and an extrusion


def main(argv: Sequence[str] | None = None) -> int:
    """Write the pictures, or the part; return 0."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--part", type=Path, metavar="FILE", help="write the part for a test print instead")
    part = parser.parse_args(argv).part
    if part is not None:
        export_stl(wedges(), part)
        print(part)
        return 0
    FOLDER.mkdir(exist_ok=True)
    for name, is_on in (("flat", False), ("contoured", True)):
        changes = {
            "quality.planner.kind": "uniform",
            "quality.layer_height": 0.2,
            "quality.z_contouring": is_on,
        }
        stages = slice_stages(wedge(_DEGREES, _SIZE), load_profile(quality="standard", changes=changes))
        picture = FOLDER / f"{name}.svg"
        picture.write_text(draw_section(stages), encoding="utf-8")
        print(picture)
    return 0


def draw_section(stages: Stages) -> str:
    """Return a section through the middle of a sliced wedge, along its slope, as an SVG document."""
    low, high = stages.part.bounds
    width, height = high[0] - low[0] + 2 * _MARGIN, high[2] + 2 * _MARGIN
    x = np.array([low[0], high[0]])
    z = wedge_height(x - low[0], _DEGREES)
    ends = " ".join(f"{_SCALE * (a - low[0]):.1f},{-_SCALE * b:.1f}" for a, b in zip(x, z, strict=True))
    box = -_MARGIN, _MARGIN - height, width, height
    size = f'width="{_SCALE * width:.0f}" height="{_SCALE * height:.0f}"'
    shown = " ".join(f"{_SCALE * one:.1f}" for one in box)
    return "\n".join(
        [
            f'<svg xmlns="http://www.w3.org/2000/svg" {size} viewBox="{shown}">',
            '<rect x="-50%" y="-200%" width="300%" height="400%" fill="#ffffff"/>',
            *_draw_extrusions(stages, float((low[1] + high[1]) / 2), float(low[0])),
            f'<polyline points="{ends}" stroke="#000000" stroke-width="2" fill="none"/>',
            "</svg>\n",
        ]
    )


def _draw_extrusions(stages: Stages, y: float, left: float) -> Iterator[str]:
    """Yield a box for each extrusion that crosses the plane at `y`, mm; `left` is x at the left edge, mm."""
    program = stages.program
    begin, end = program.start, program.xyz
    crosses = (program.role != Role.TRAVEL) & ((begin[:, 1] - y) * (end[:, 1] - y) < 0)
    for move in np.flatnonzero(crosses):
        delta = end[move] - begin[move]
        sine = abs(delta[1]) / np.hypot(*delta[:2])
        if sine < _MIN_CROSSING:
            continue
        x, _, z = begin[move] + (y - begin[move, 1]) / delta[1] * delta
        bottom = program.plan.bottom[program.layer[move]]
        half = program.width[move] / 2 / sine
        yield (
            f'<rect x="{_SCALE * (x - half - left):.1f}" y="{-_SCALE * z:.1f}" width="{2 * _SCALE * half:.1f}" '
            f'height="{_SCALE * (z - bottom):.1f}" rx="4" fill="{ROLES[program.role[move]].colour}" '
            'fill-opacity="0.6" stroke="#ffffff" stroke-width="0.7"/>'
        )


if __name__ == "__main__":
    sys.exit(main())
