"""How values show themselves where pictures can be seen, as in notebooks.

What draws stands in rooms above those of the values. So values only know that they can be drawn; the package says by
whom, when it is imported.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

__all__ = ["Summary", "SvgRepr", "set_svg_renderer"]

_artists: list[Callable[[object], str]] = []


def set_svg_renderer(artist: Callable[[object], str]) -> None:
    """From now on values are drawn by this function, as the text of an SVG document."""
    _artists[:] = [artist]


@dataclass(frozen=True, slots=True)
class Summary:
    """What is seen of a value that has no shape: a headline, what is known by name, and what is wrong."""

    title: str
    facts: Mapping[str, str]
    problems: Sequence[str] = ()


class SvgRepr:
    """A value that draws itself as SVG, or another value that shows what it is."""

    __slots__ = ()

    @property
    def drawable(self) -> object:
        """What is drawn of it."""
        return self

    def _repr_svg_(self) -> str:
        """What notebooks ask for."""
        return _artists[0](self)
