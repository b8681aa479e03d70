"""Write a program as G-code text, with thumbnails and the certificate of its layer plan."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from datetime import datetime

from printer_slicer.arguments import check_arguments
from printer_slicer.extrusion import move_seconds
from printer_slicer.firmware import FLAVOURS
from printer_slicer.gcode.writer import ProgramFacts, write_program
from printer_slicer.model import Labels, Mesh, Program
from printer_slicer.profile import Profile
from printer_slicer.strategies import BUILT_IN, Strategies, run_line_functions
from printer_slicer.surface import Certificate, certificate_comments
from printer_slicer.thumbnails import render_thumbnail_lines

__all__ = ["gcode_in_pieces", "gcode_of"]


@check_arguments(program=Program, profile=Profile)
def gcode_of(  # noqa: PLR0913 - all options have defaults
    program: Program,
    profile: Profile,
    *,
    part: Mesh | None = None,
    certificate: Certificate | None = None,
    labels: Labels | None = None,
    strategies: Strategies = BUILT_IN,
    made: datetime | None = None,
    comments: Sequence[str] = (),
) -> bytes:
    """Write a program as G-code in the printer's dialect; the output is deterministic.

    Args:
        program: the moves.
        profile: the profile they were made with.
        part: the part to show in the thumbnails of `printer.thumbnails`; None: no thumbnails.
        certificate: certificate of the layer plan, written as comments.
        labels: the object of each move, written as object labels.
        strategies: the user's flavour and functions that change the lines, if any.
        made: date in UTC for the first line; None: no date.
        comments: further comments at the top of the file, such as how the part was turned.

    Raises:
        ProfileError: a macro cannot be evaluated.
        StrategyError: a user's function returned an invalid value.
    """
    pieces = gcode_in_pieces(
        program,
        profile,
        part=part,
        certificate=certificate,
        labels=labels,
        strategies=strategies,
        made=made,
        comments=comments,
    )
    return run_line_functions(b"".join(pieces), strategies.on_lines)


def gcode_in_pieces(  # noqa: PLR0913 - all options have defaults
    program: Program,
    profile: Profile,
    *,
    part: Mesh | None = None,
    certificate: Certificate | None = None,
    labels: Labels | None = None,
    strategies: Strategies = BUILT_IN,
    made: datetime | None = None,
    comments: Sequence[str] = (),
) -> Iterator[bytes]:
    """Yield the text of `gcode_of` some layers at a time, without the functions of the user that change all lines.

    The first piece needs all moves and their times; macros are evaluated before it.

    Raises:
        ProfileError: a macro cannot be evaluated.
        StrategyError: a function of the user's flavour returned an invalid value.
    """
    comments = (*comments, *strategies.facts())
    if certificate is not None:
        comments += certificate_comments(certificate)
    pictures = render_thumbnail_lines(part, profile.printer.thumbnails) if part is not None else []
    facts = ProgramFacts(
        move_seconds(program, profile), comments, pictures, labels, made, part.name if part else ""
    )
    dialect = strategies.checked_flavour or FLAVOURS[profile.printer.flavour]
    yield from write_program(program, profile, dialect, facts)
