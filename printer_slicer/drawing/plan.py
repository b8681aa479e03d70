"""Draw a layer plan: the part from the front, deviation and layer height over z, and the stack in 3D."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import Final

import numpy as np

from printer_slicer.arguments import check_arguments
from printer_slicer.arrays import Float
from printer_slicer.drawing.canvas import Line, Picture, Shape, Text, estimate_text_width, fit_text
from printer_slicer.drawing.colours import WARNING, choose_height_colours
from printer_slicer.drawing.frame import Panel, ZAxis
from printer_slicer.drawing.legend import LEGEND_HEIGHT, draw_legend
from printer_slicer.drawing.plan_side import draw_deviation, draw_front, draw_grid, draw_heights, make_z_axis
from printer_slicer.drawing.stack import draw_stack
from printer_slicer.model import LayerPlan, Sections
from printer_slicer.surface import Certificate
from printer_slicer.values import replace

__all__ = ["draw_plan"]

_WIDTH, _MARGIN = 1600, 40
_LEGEND_TOP: Final = 212
_LEGEND_GAP: Final = 84  # px between the legend and the panels, for labels
_FOOT: Final = 94  # px under the panels, for labels
_TALLEST: Final = 620  # px, height of the panels; less for parts that are not tall
_FRONT, _ERROR, _HEIGHTS, _STACK = (
    (108, 560),
    (616, 816),
    (872, 1032),
    (1084, 1570),
)  # px, left and right side
_TITLE, _FACT, _NAME, _SMALL = 46, 46, 25, 22  # px, sizes of letters
_SMALLEST_TITLE: Final = 26
_DARK, _SOFT = "#1f2430", "#5b6472"


@check_arguments(sections=Sections, certificate=Certificate, title=str)
def draw_plan(
    sections: Sections,
    certificate: Certificate,
    title: str,
    *,
    tolerance: float | None = None,
    flats: Float | Sequence[float] = (),
    stacks: Sequence[Sections] = (),
) -> Picture:
    """Draw the part from the front, deviation and height of each layer beside it, and the stack in 3D.

    The colour of a layer shows its height.

    Args:
        sections: the part's solid areas, with the layer plan.
        certificate: certificate of the layer plan of the sections.
        title: one line above the picture.
        tolerance: mm, largest allowed deviation, or None.
        flats: mm, heights of flat surfaces, marked on the z axis.
        stacks: the sections of each stack, if there are several; the views then show each with its own layers.

    Raises:
        ValueError: the certificate belongs to another plan, or the plan is empty.
    """
    plan = sections.plan
    if plan.n_layers == 0:
        raise ValueError("a plan without layers has no picture")
    if not np.array_equal(certificate.plan.top, plan.top):
        raise ValueError("sections and certificate are of different plans")
    colours, fronts = _choose_colours(sections, stacks)
    top = _LEGEND_TOP + LEGEND_HEIGHT + _LEGEND_GAP
    axis, scale = make_z_axis(sections, _FRONT[1] - _FRONT[0], _TALLEST, top)
    front, error, heights, stack = (
        Panel(*sides, top, axis.floor) for sides in (_FRONT, _ERROR, _HEIGHTS, _STACK)
    )
    prisms, step = draw_stack(fronts, replace(stack, top=top - 40))
    parts = certificate.parts or (certificate,)
    ranges_beyond = _list_ranges_above(parts, tolerance)
    shapes = [
        *_draw_head(title, certificate, ranges_beyond, tolerance),
        *draw_legend(plan, colours, Panel(_MARGIN, _WIDTH - _MARGIN, _LEGEND_TOP, top - _LEGEND_GAP)),
        *draw_grid(axis, replace(front, right=heights.right)),
        *_draw_flat_marks(axis, front, flats),
        *draw_front(fronts, axis, front, scale),
        *draw_deviation(certificate, ranges_beyond, axis, error, tolerance=tolerance),
        *draw_heights([one.plan for one in parts], colours, axis, heights),
        *prisms,
        *_draw_panel_titles(axis, axis.scale / scale, step, has_flats=len(flats) > 0),
    ]
    return Picture(_WIDTH, round(axis.floor + _FOOT), tuple(shapes), _describe(title, plan))


def _describe(title: str, plan: LayerPlan) -> str:
    """Return the description of the picture."""
    return f"{title}: layer plan, {_format_layer_count(plan)}"


def _choose_colours(
    sections: Sections, stacks: Sequence[Sections]
) -> tuple[list[str], list[tuple[Sections, list[str]]]]:
    """Return the colours of all layers, and each stack with those of its layers; equal heights have the same colour."""
    several = (sections, *(stacks or (sections,)))
    colours = choose_height_colours(np.concatenate([one.plan.height for one in several]))
    ends = np.cumsum([0, *(one.plan.n_layers for one in several)]).tolist()
    first, *others = (colours[begin:end] for begin, end in pairwise(ends))
    return first, list(zip(several[1:], others, strict=True))


def _list_ranges_above(
    stacks: Sequence[Certificate], tolerance: float | None
) -> list[tuple[float, float, float]]:
    """Return the height ranges in which any stack exceeds the tolerance: low, high, bound, mm."""
    return [] if tolerance is None else [row for one in stacks for row in one.ranges_above(tolerance)]


def _draw_head(
    title: str,
    certificate: Certificate,
    ranges_beyond: Sequence[tuple[float, float, float]],
    tolerance: float | None,
) -> Iterator[Shape]:
    """Draw the title and the main numbers, in large letters."""
    max_width = _WIDTH - 2 * _MARGIN
    size = max(min(_TITLE, _TITLE * max_width / max(estimate_text_width(title, _TITLE), 1)), _SMALLEST_TITLE)
    yield Text(_MARGIN, 64, fit_text(title, size, max_width), size, _DARK, bold=True)
    places = (_MARGIN, 350, 790, 1180, _WIDTH)
    for (x, end), (fact, meaning, warns) in zip(
        pairwise(places), _list_facts(certificate, ranges_beyond, tolerance), strict=True
    ):
        size = max(min(_FACT, _FACT * (end - x - 16) / estimate_text_width(fact, _FACT)), _SMALLEST_TITLE)
        yield Text(x, 142, fit_text(fact, size, end - x - 16), size, WARNING if warns else _DARK, bold=True)
        yield Text(x, 176, fit_text(meaning, _NAME, end - x - 16), _NAME, WARNING if warns else _SOFT)


def _list_facts(
    certificate: Certificate, ranges_beyond: Sequence[tuple[float, float, float]], tolerance: float | None
) -> Iterator[tuple[str, str, bool]]:
    """Yield the main numbers: value, meaning, and whether it is a warning."""
    plan, worst = certificate.plan, certificate.worst
    thin, thick = float(plan.height.min()), float(plan.height.max())
    yield _format_layer_count(plan), f"planner {plan.planner}" if plan.planner else "", False
    heights = (
        f"{_format_number(thin)} mm"
        if thin == thick
        else f"{_format_number(thin)} to {_format_number(thick)} mm"
    )
    yield heights, "layer height", False
    where = f", z {worst.z:.4g} mm" if certificate.max_error > 0 else ""
    limit = f", above {tolerance:g}" if ranges_beyond else where
    yield f"{_format_number(certificate.max_error)} mm", f"max deviation{limit}", bool(ranges_beyond)
    yield f"{_format_number(certificate.volume_error)} mm³", "volume error", False


def _format_layer_count(plan: LayerPlan) -> str:
    """Return the number of layers as text."""
    return f"{plan.n_layers} layer{'s' if plan.n_layers != 1 else ''}"


def _format_number(value: float) -> str:
    """Format a number with three digits; large numbers with spaces, tiny numbers as 0."""
    if 999.5 <= value < 1e7:
        return f"{value:,.0f}".replace(",", " ")
    return f"{value:.3g}" if value >= 0.0005 else "0"


def _draw_flat_marks(axis: ZAxis, panel: Panel, flats: Float | Sequence[float]) -> Iterator[Shape]:
    """Draw a tick for each flat surface, to the right of the part."""
    for z in np.asarray(flats, np.float64).tolist():
        if 0 <= z <= axis.total * 1.001:
            y = axis.y(z)
            yield Line(np.array([(panel.right + 10, y), (panel.right + 28, y)]), _DARK, 2.5, name="flat")


def _draw_panel_titles(axis: ZAxis, z_stretch: float, step: float, *, has_flats: bool) -> Iterator[Shape]:
    """Draw the titles of the panels, below them."""
    low, lower = axis.floor + 1.3 * _SMALL, axis.floor + 66
    yield Text(_FRONT[0] - 12, axis.y(axis.total) - 22, "z mm", _SMALL, _SOFT, "end")
    if z_stretch > 1.01:
        yield Text(_FRONT[0], low, f"z drawn {z_stretch:.2g} times as large", _SMALL, _SOFT)
    if has_flats:
        yield Text(_FRONT[1] + 28, low, "flat surfaces", _SMALL, _SOFT, "end")
    yield Text(_FRONT[0], lower, "seen from the front", _NAME, _DARK, bold=True)
    yield Text(_ERROR[0], lower, "max deviation, mm", _NAME, _DARK, bold=True)
    yield Text(_HEIGHTS[0] - 8, lower, "layer height, mm", _NAME, _DARK, bold=True)
    yield Text(_STACK[0], lower, "the stack of layers", _NAME, _DARK, bold=True)
    if step:
        yield Text(_STACK[1], lower, f"bed grid {step:g} mm", _SMALL, _SOFT, "end")
