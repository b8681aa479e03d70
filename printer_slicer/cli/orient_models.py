"""Turn the models of a command line so that they print well, and tell how."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

from printer_slicer.cli.output import sanitize
from printer_slicer.errors import UsageError
from printer_slicer.texts import format_duration, format_significant

if TYPE_CHECKING:
    from printer_slicer.cli.output import StageReport
    from printer_slicer.model import Mesh
    from printer_slicer.orienting import Orientation, Orientations
    from printer_slicer.profile import Profile

__all__ = ["TurnedModels", "choose_row", "collect_row_facts", "turn_models"]


class TurnedModels(NamedTuple):
    """Parts that may have been turned.

    Attributes:
        parts: the meshes of each file.
        facts: facts about each part, for JSON; empty without --orient.
        comments: how each part was turned, for the head of the G-code.
    """

    parts: Mapping[Path, Sequence[Mesh]]
    facts: tuple[dict[str, Any], ...] = ()
    comments: tuple[str, ...] = ()


def turn_models(
    arguments: argparse.Namespace, parts: Mapping[Path, Sequence[Mesh]], profile: Profile, report: StageReport
) -> TurnedModels:
    """Turn each part of each file as --orient says, and print a line about each.

    Raises:
        UsageError: an option has no effect without --orient, or does not go together with it, or there is no such row.
    """
    how: Literal["off", "fast", "careful"] = getattr(arguments, "orient", "off")
    _check_options(arguments, how, sum(len(own) for own in parts.values()))
    if how == "off":
        return TurnedModels(parts)
    from printer_slicer.orientation import KEEP_ANY, find_orientations
    from printer_slicer.orienting import turn_mesh
    from printer_slicer.overlaps import name_parts

    keep_up = KEEP_ANY if arguments.orient_keep_up is None else arguments.orient_keep_up
    turned: dict[Path, list[Mesh]] = {path: [] for path in parts}
    facts, comments = [], []
    for path, meshes in parts.items():
        for mesh, name in zip(meshes, name_parts(path.name, meshes), strict=True):
            found = find_orientations(mesh, profile, search=how, keep_up=keep_up, report=report)
            row = choose_row(found, arguments.orient_row)
            turned[path].append(turn_mesh(mesh, row.rotate))
            facts.append({"file": str(path), "part": mesh.name, **collect_row_facts(row)})
            comments.append(row.format_comment(name, how))
            if not arguments.quiet:
                text = f"printer-slicer: {name}: {_describe(row, found, is_chosen=row is found.chosen)}"
                print(sanitize(text), file=sys.stderr)
    return TurnedModels(turned, tuple(facts), tuple(comments))


def _check_options(arguments: argparse.Namespace, how: str, n_parts: int) -> None:
    """Check that the options for turning parts go together.

    Raises:
        UsageError: they do not.
    """
    for name in ("orient_keep_up", "orient_row"):
        value = getattr(arguments, name, None)
        if how == "off" and value is not None:
            flag = f"--{name.replace('_', '-')}"
            raise UsageError(
                f"{flag} {value:g}: this option has no effect without --orient", remedy="Add --orient fast"
            )
    if how == "off":
        return
    if arguments.orient_row is not None and n_parts > 1:
        raise UsageError(
            f"--orient-row {arguments.orient_row}: there are {n_parts} parts, each with rows of its own",
            remedy="Turn the parts one by one, with --rotate",
        )
    for name in ("support_enforcer", "support_blocker", "modifier"):
        if getattr(arguments, name):
            raise UsageError(
                f"--{name.replace('_', '-')}: such a file does not turn with the part, as --orient turns it",
                remedy="Find the rotation with `printer-slicer orient`, then use --rotate instead of --orient",
            )


def choose_row(found: Orientations, number: int | None) -> Orientation:
    """Return the row with this number, from 1; None: the chosen one.

    Raises:
        UsageError: there is no such row.
    """
    if number is None:
        return found.chosen
    if number > len(found.rows):
        raise UsageError(
            f"--orient-row {number}: there are {len(found.rows)} rows",
            remedy="List them with `printer-slicer orient`",
        )
    return found.rows[number - 1]


def _describe(row: Orientation, found: Orientations, *, is_chosen: bool) -> str:
    """Describe how a part is turned, and what this saves; `is_chosen` if the search chose this row."""
    given = found.original
    if row.is_original and row.is_usable:
        return "not rotated" + (", because that would save less than 5 %" if is_chosen else "")
    if row.is_original:
        return f"not rotated; it {_explain_unusable(row)}" + (
            " in every orientation that was compared" if is_chosen else ""
        )
    known = "" if row.is_sliced and given.is_sliced else "about "
    text = (
        f"{row.describe_rotation()}; {known}{format_duration(60 * row.minutes)} and "
        f"{format_significant(row.support_g)} g of support instead of {format_duration(60 * given.minutes)} and "
        f"{format_significant(given.support_g)} g"
    )
    reason = _explain_unusable(given)
    return f"{text}; as it lies in its file, it {reason}" if reason else text


def _explain_unusable(row: Orientation) -> str:
    """Say why a row is not usable; empty if it is."""
    return "may fall over" if not row.is_stable else "does not fit the printer" if not row.fits else ""


def collect_row_facts(row: Orientation) -> dict[str, Any]:
    """Return the facts about a row for JSON."""
    return {
        "rotate": list(row.rotate),
        "original": row.is_original,
        "usable": row.is_usable,
        "unusable_because": _explain_unusable(row) or None,
        "sliced": row.is_sliced,
        "cost_min": round(row.cost, 3),
        "seconds": round(60 * row.minutes, 3),
        "support_g": round(row.support_g, 3),
        "mean_deviation_mm": round(row.deviation, 5),
        "deviation_mm3": round(row.deviation_volume, 3),
        "height_mm": round(row.height, 4),
        "contact_area_mm2": round(row.contact_area, 2),
        "overhang_mm2": round(row.overhang, 2),
        "tilt_deg": round(row.tilt_deg, 2),
    }
