"""A card: a headline that says how it went, what is known in two columns, and what is wrong."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

from printer_slicer.drawing.canvas import Box, Picture, Shape, Text, text_width
from printer_slicer.drawing.colours import WARNING

__all__ = ["card"]

_WIDE: Final = 760  # px
_ROW, _LETTERS, _TITLE = 24, 15, 20  # px
_GOOD, _DARK, _SOFT = "#009e73", "#1f2430", "#5b6472"
_MOST: Final = 8  # problems shown


def card(title: str, facts: Mapping[str, str], problems: Sequence[str]) -> Picture:
    """The card; its edge is green where there are no problems.

    Args:
        title: how it went.
        facts: name -> what is known, one line each.
        problems: what is wrong, one line each; of many, the first.
    """
    colour = WARNING if problems else _GOOD
    shapes: list[Shape] = [Text(24, 36, _cut(title, _TITLE), _TITLE, _DARK, bold=True)]
    y = 68.0
    for name, fact in facts.items():
        shapes += [
            Text(24, y, name, _LETTERS, _SOFT),
            Text(170, y, _cut(fact, _LETTERS, 170), _LETTERS, _DARK),
        ]
        y += _ROW
    shown = [*problems[:_MOST], *([f"and {len(problems) - _MOST} more"] if len(problems) > _MOST else [])]
    for problem in shown:
        shapes.append(Text(24, y, _cut(problem, _LETTERS), _LETTERS, WARNING))
        y += _ROW
    tall = round(y - _ROW + 20)
    return Picture(_WIDE, tall, (Box(0, 0, 8, tall, colour, name="state"), *shapes), title)


def _cut(text: str, size: float, left: float = 24) -> str:
    """The text, as much of it as there is room for."""
    room = _WIDE - left - 12
    while text_width(text, size) > room:
        text = text[: int(len(text) * room / text_width(text, size)) - 2] + "…"
    return text
