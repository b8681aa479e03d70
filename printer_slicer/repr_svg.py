"""SVG pictures of values in notebooks (`_repr_svg_`).

The drawing package imports the value classes, so these cannot import it. Instead, `printer_slicer` registers the
drawing function when it is imported.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

from printer_slicer.deprecation import renamed_attribute

__all__ = ["Summary", "SvgRepr", "set_svg_renderer"]

_renderers: list[Callable[[object], str]] = []


def set_svg_renderer(renderer: Callable[[object], str]) -> None:
    """Register the function that draws a value as the text of an SVG document."""
    _renderers[:] = [renderer]


class Summary(NamedTuple):
    """A table to show for a value without geometry: title, named facts and problems."""

    title: str
    facts: Mapping[str, str]
    problems: Sequence[str] = ()


class SvgRepr:
    """Mixin for values that notebooks show as an SVG picture."""

    __slots__ = ()

    @property
    def drawable(self) -> object:
        """The value that the picture shows; by default the object itself."""
        return self

    looks = renamed_attribute("looks", "drawable")

    def _repr_svg_(self) -> str:
        """Return the SVG document that notebooks show."""
        return _renderers[0](self)
