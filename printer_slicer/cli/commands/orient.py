"""`orient`: compare the orientations of a part."""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from printer_slicer.cli.arguments import (
    add_keep_up_option,
    add_output_options,
    add_setting_options,
    add_transform_options,
    add_units_option,
)
from printer_slicer.cli.help import mark_advanced
from printer_slicer.cli.orient_models import collect_row_facts
from printer_slicer.cli.output import print_text, show_stages, warn
from printer_slicer.cli.settings import collect_profile_facts, load_selected_profile
from printer_slicer.texts import format_duration, format_significant

if TYPE_CHECKING:
    from printer_slicer.cli.output import StageReport
    from printer_slicer.orientation import Search
    from printer_slicer.orienting import Orientation, Orientations
    from printer_slicer.profile import Profile

__all__ = ["EXAMPLES", "add_arguments", "run"]

EXAMPLES: Final = """\
  printer-slicer orient part.stl
  printer-slicer orient part.stl --careful --printer creality_ender3 --keep-up 60
  printer-slicer slice part.stl --orient fast                turn the part, then slice it
  printer-slicer slice part.stl --orient fast --orient-row 2   turn it as in the second row"""
_MAX_ROWS: Final = 10


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `orient`."""
    parser.add_argument("models", metavar="MODEL", type=Path, nargs="+", help="models (STL, 3MF, STEP, ...)")
    parser.add_argument(
        "--careful",
        action="store_true",
        help="slice the best three orientations, instead of comparing estimates",
    )
    add_keep_up_option(parser, "--keep-up")
    parser.add_argument("--all", action="store_true", help=f"show all rows, not only the first {_MAX_ROWS}")
    add_setting_options(parser)
    group = parser.add_argument_group("model placement")
    add_transform_options(group)
    mark_advanced(add_units_option(group))
    add_output_options(parser)


class _Table(NamedTuple):
    """The orientations of one part of a file."""

    path: Path
    part: str
    title: str
    found: Orientations


def run(arguments: argparse.Namespace) -> int:
    """Compare the orientations of each part."""
    profile = load_selected_profile(arguments)
    with show_stages(arguments) as report:
        tables = [
            table
            for path in dict.fromkeys(arguments.models)
            for table in _compare_orientations(arguments, path, profile, report)
        ]
    if arguments.json:
        facts = {"models": [_collect_facts(one) for one in tables]}
        print(json.dumps(facts | collect_profile_facts(arguments)))
    else:
        shown = None if arguments.all else _MAX_ROWS
        print_text(
            arguments,
            "\n".join(_format_table(one.title, one.found, shown) for one in tables),
            is_message=False,
        )
    return 0


def _compare_orientations(
    arguments: argparse.Namespace, path: Path, profile: Profile, report: StageReport
) -> Iterator[_Table]:
    """Yield the orientations of each part of a file."""
    from printer_slicer.mesh_io import load_model
    from printer_slicer.orientation import KEEP_ANY, find_orientations
    from printer_slicer.overlaps import name_parts, split_separate_objects
    from printer_slicer.placing import transform

    report(f"loading {path.name}")
    model = load_model(path, units=arguments.units)
    warn(arguments, [f"{path.name}: {note}" for note in model.notes])
    scale = arguments.scale[:3] if arguments.scale else 1.0
    keep_up = KEEP_ANY if arguments.keep_up is None else arguments.keep_up
    search: Search = "careful" if arguments.careful else "fast"
    parts = split_separate_objects(
        transform(model.mesh, scale=scale, rotate=arguments.rotate or (0.0, 0.0, 0.0))
    )
    for part, title in zip(parts, name_parts(path.name, parts), strict=True):
        found = find_orientations(part, profile, search=search, keep_up=keep_up, report=report)
        yield _Table(path, part.name, title, found)


def _collect_facts(table: _Table) -> dict[str, Any]:
    """Return all rows of a part for JSON."""
    found = table.found
    return {
        "file": str(table.path),
        "part": table.part,
        "chosen_row": found.rows.index(found.chosen) + 1,
        "rows": [collect_row_facts(row) for row in found.rows],
    }


def _format_table(title: str, found: Orientations, most: int | None) -> str:
    """Format the rows of a part: the first ones, the part as given and the chosen one."""
    head = (
        f"  {'row':>3} {'cost':>8}{'print time':>12}{'support':>9}{'overhang':>11}{'deviation':>11}{'height':>10}"
        f"{'contact':>10}{'tilt':>6}   --rotate"
    )
    lines = [f"{title}: orientations; cost in minutes, deviation is the mean", head]
    for number, row in enumerate(found.rows, start=1):
        if most is None or number <= most or row.is_original:
            lines.append(_format_row(number, row, is_chosen=row is found.chosen))
    lines.append("  *: chosen by --orient; choose another row with --orient-row N, or with its --rotate")
    return "\n".join(lines)


def _format_row(number: int, row: Orientation, *, is_chosen: bool) -> str:
    """Format one row of the table."""
    notes = [
        *(["as in the file"] if row.is_original else []),
        *([] if row.is_stable else ["may fall over"]),
        *([] if row.fits else ["does not fit"]),
        *(["sliced"] if row.is_sliced else []),
    ]
    values = (
        f"{row.cost:>8.1f}{format_duration(60 * row.minutes):>12}{format_significant(row.support_g) + ' g':>9}"
        f"{row.overhang:>7.0f} mm²{row.deviation:>8.3f} mm{row.height:>7.1f} mm"
        f"{row.contact_area:>6.0f} mm²{row.tilt_deg:>5.0f}°"
    )
    note = f"   ({', '.join(notes)})" if notes else ""
    return f"{'*' if is_chosen else ' ':>2}{number:>3} {values}   {row.format_rotate()}{note}"
