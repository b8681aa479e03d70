"""Program -> lines: the text of a program, with what is proven about its layers and pictures of the part."""

from __future__ import annotations

from datetime import datetime

from printer_slicer.extrusion import move_seconds
from printer_slicer.gcode import write_gcode
from printer_slicer.model import Labels, Mesh, Program
from printer_slicer.profile import Profile
from printer_slicer.strategies import OURS, Strategies, run_line_functions
from printer_slicer.surface import Certificate, certificate_comments
from printer_slicer.thumbnails import thumbnail_lines

__all__ = ["gcode_of"]


def gcode_of(  # noqa: PLR0913 - every choice has a usual value
    program: Program,
    profile: Profile,
    *,
    part: Mesh | None = None,
    certificate: Certificate | None = None,
    labels: Labels | None = None,
    strategies: Strategies = OURS,
    made: datetime | None = None,
) -> bytes:
    """The text of a program in the printer's dialect; the same program and profile give the same bytes.

    Args:
        program: the moves.
        profile: what they were made with.
        part: shown in the pictures of `printer.thumbnails`; without it there are none.
        certificate: of the plan, to be told in comments.
        labels: which moves lay which of several things on the plate, to be marked.
        strategies: may hold a flavour, and functions that change the lines.
        made: date in UTC for the first line; None: no date.

    Raises:
        ProfileError: a macro that cannot be filled in.
        StrategyError: a function from outside gives what cannot be used.
    """
    facts = strategies.facts()
    if certificate is not None:
        facts += certificate_comments(certificate)
    pictures = thumbnail_lines(part, profile.printer.thumbnails) if part is not None else []
    seconds = move_seconds(program, profile)
    text = write_gcode(
        program,
        profile,
        seconds,
        facts,
        comments=pictures,
        labels=labels,
        flavour=strategies.checked_flavour,
        made=made,
        name=part.name if part else "",
    )
    return run_line_functions(text, strategies.on_lines)
