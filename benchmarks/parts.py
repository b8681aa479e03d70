"""Parts and options for benchmarks that compare our files with those of other slicers."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

from benchmarks.processes import SAMPLES
from benchmarks.sizes import printable
from printer_slicer.mesh_io import FORMATS, load_mesh
from printer_slicer.model import Mesh
from printer_slicer.profile import Profile, load_profile

__all__ = ["options_of", "parser_of", "parts_of", "profile_of"]


def parser_of(name: str, about: str) -> argparse.ArgumentParser:
    """Return the parser of one benchmark, with the common options."""
    parser = argparse.ArgumentParser(prog=f"python -m benchmarks.{name}", description=about.splitlines()[0])
    parser.add_argument(
        "--models", type=Path, help="folder with more parts (default: $PRINTER_SLICER_MODELS)"
    )
    parser.add_argument(
        "--height", type=float, default=0.2, metavar="MM", help="height of all layers, mm (default: 0.2)"
    )
    parser.add_argument(
        "--set", action="append", default=[], metavar="KEY=VALUE", help="change a setting for all slicers"
    )
    parser.add_argument("--json", type=Path, metavar="FILE", help="write all figures to this file")
    parser.add_argument("parts", nargs="*", metavar="part", help="only the parts with these names")
    return parser


def options_of(parser: argparse.ArgumentParser, argv: Sequence[str] | None) -> argparse.Namespace:
    """Return the parsed options."""
    options = parser.parse_args(argv)
    if options.models is None and os.environ.get("PRINTER_SLICER_MODELS"):
        options.models = Path(os.environ["PRINTER_SLICER_MODELS"])
    return options


def profile_of(options: argparse.Namespace, changes: dict[str, str | float]) -> Profile:
    """Return the common profile: uniform layers, with these changes."""
    typed = dict(change.split("=", 1) for change in options.set)
    height = {"planner.kind": "uniform", "layer_height": options.height, "first_layer_height": options.height}
    return load_profile(changes=height | changes | typed)


def parts_of(options: argparse.Namespace) -> Iterator[Mesh]:
    """Return the sample parts and those of the models folder, or only the named ones; small parts are enlarged."""
    folders = [SAMPLES, *([options.models] if options.models else [])]
    paths = sorted(
        path
        for folder in folders
        for path in folder.iterdir()
        if path.suffix.lower().removeprefix(".") in FORMATS
    )
    for path in paths:
        if not options.parts or path.stem in options.parts:
            mesh, note = printable(load_mesh(path))
            print(note, file=sys.stderr, end="\n" if note else "")
            yield Mesh(mesh.triangles, path.stem)
