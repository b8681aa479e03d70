"""Draw a layer of supports in a G-code file over what carries it.

    python -m benchmarks.draw_supports PART FILE.gcode Z OUT.png [--models DIR]

Z is the bottom of the layer, as `python -m benchmarks.supports --places` lists it. Grey is the part just below, blue
are the supports just below, purple is what they carry, red what nothing carries.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np
from PIL import Image

from benchmarks.support_beads import read_supports
from benchmarks.support_carriers import find_carriers, list_layers
from benchmarks.support_parts import support_parts
from benchmarks.support_solid import Solid
from printer_slicer.profile import load_profile

_PART, _BELOW, _CARRIED, _FREE = (200, 200, 200), (90, 150, 255), (120, 40, 160), (230, 40, 40)
_SAME_Z: Final = 0.006  # mm
_MARGIN: Final = 10  # cells
_ZOOM: Final = 2


def main(argv: Sequence[str] | None = None) -> int:
    """Write the picture of one layer."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.draw_supports", description=__doc__.splitlines()[0]
    )
    parser.add_argument("part", help="name of the part")
    parser.add_argument("gcode", type=Path, help="file to draw")
    parser.add_argument("z", type=float, help="bottom of the layer, mm")
    parser.add_argument("picture", type=Path, help="file to write")
    parser.add_argument("--models", type=Path, help="folder with models (default: $PRINTER_SLICER_MODELS)")
    options = parser.parse_args(argv)
    known = os.environ.get("PRINTER_SLICER_MODELS")
    models = options.models or (Path(known) if known else None)
    profile = load_profile(quality="standard")
    mesh = next(support_parts(models, [options.part], profile), None)
    if mesh is None:
        parser.error(f"no part {options.part}")
    solid = Solid.of(mesh)
    file = read_supports(options.gcode.read_bytes(), profile.material.filament_diameter)
    layers = list_layers(file.support, solid)
    below, part = find_carriers(layers, options.z, solid)
    drawn = np.zeros(solid.grid.shape, np.bool_)
    for layer in layers:
        if abs(layer.bottom - options.z) < _SAME_Z:
            drawn |= layer.drawn
    if not drawn.any():
        parser.error(f"no support begins at {options.z:g} mm")
    pixels = np.full((*drawn.shape, 3), 255, np.uint8)
    carried = drawn & (below | part)
    for flags, colour in ((part, _PART), (below, _BELOW), (drawn, _FREE), (carried, _CARRIED)):
        pixels[flags] = colour
    row, column = np.nonzero(drawn | below)
    top, left = max(row.min() - _MARGIN, 0), max(column.min() - _MARGIN, 0)
    shown = pixels[top : row.max() + _MARGIN, left : column.max() + _MARGIN][::-1]
    size = shown.shape[1] * _ZOOM, shown.shape[0] * _ZOOM
    Image.fromarray(shown).resize(size, Image.Resampling.NEAREST).save(options.picture)
    return 0


if __name__ == "__main__":
    sys.exit(main())
