"""Draw a summary card: a headline, a table of facts, and the problems."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

from printer_slicer.drawing.canvas import Box, Picture, Shape, Text, fit_text
from printer_slicer.drawing.colours import WARNING

__all__ = ["draw_summary_card"]

_WIDE: Final = 760  # px
_ROW, _LETTERS, _TITLE = 24, 15, 20  # px
_GOOD, _DARK, _SOFT = "#009e73", "#1f2430", "#5b6472"
_MAX_PROBLEMS: Final = 8  # problems shown


def draw_summary_card(title: str, facts: Mapping[str, str], problems: Sequence[str]) -> Picture:
    """Draw a card; its left edge is green if there are no problems.

    Args:
        title: headline.
        facts: name -> text, one line each.
        problems: one line each; only the first eight are shown.
    """
    colour = WARNING if problems else _GOOD
    shapes: list[Shape] = [
        Text(24, 36, fit_text(title, _TITLE, _WIDE - 36, bold=True), _TITLE, _DARK, bold=True)
    ]
    y = 68.0
    for name, fact in facts.items():
        shapes += [
            Text(24, y, name, _LETTERS, _SOFT),
            Text(170, y, fit_text(fact, _LETTERS, _WIDE - 182), _LETTERS, _DARK),
        ]
        y += _ROW
    shown = [
        *problems[:_MAX_PROBLEMS],
        *([f"and {len(problems) - _MAX_PROBLEMS} more"] if len(problems) > _MAX_PROBLEMS else []),
    ]
    for problem in shown:
        shapes.append(Text(24, y, fit_text(problem, _LETTERS, _WIDE - 36), _LETTERS, WARNING))
        y += _ROW
    tall = round(y - _ROW + 20)
    return Picture(_WIDE, tall, (Box(0, 0, 8, tall, colour, name="state"), *shapes), title)
