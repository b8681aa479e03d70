"""Custom infill patterns: functions from areas and heights to lines, and the checks of their results."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from printer_slicer.arrays import Float
from printer_slicer.errors import StrategyError
from printer_slicer.geometry import Polylines, clip_lines
from printer_slicer.infill.infill_task import InfillTask, Pattern
from printer_slicer.profile import Profile
from printer_slicer.texts import describe_type, get_callable_name
from printer_slicer.values import Struct

__all__ = ["Infill", "check_density", "make_checked_pattern"]

_MAX_ERROR: float = 0.1  # largest relative error of the density
_MIN_VOLUME: float = 20.0  # mm³; smaller volumes are not checked, because single lines decide
_MAX_COORDINATE: float = 1e5  # mm


class Infill(Struct, frozen=True):
    """A custom pattern for internal infill.

    Attributes:
        lines: function from the task to lines. The lines are clipped to the areas and connected along the perimeters as
            the profile says. The function is called several times, also with some areas empty, and must return the
            same lines for the same areas.
        measured: whether the lines must have the density of the profile. The function then gets a `spacing`; its lines
            are measured, requested again with a corrected spacing, and printed up to a fifth wider or narrower. A
            remaining error of more than a tenth is reported. If False, lines have the usual width and any density.
    """

    lines: Callable[[InfillTask], Polylines]
    measured: bool = True

    @property
    def name(self) -> str:
        """Name of the pattern in messages."""
        return get_callable_name(self.lines)


def make_checked_pattern(custom: Infill) -> Pattern:
    """Wrap a custom pattern in a `Pattern` that checks its lines and clips them to the areas."""

    def pattern(task: InfillTask) -> tuple[Polylines, Float]:
        """Return the lines within the areas."""
        lines = custom.lines(task)
        _check_lines(custom.name, lines, task.area.n_layers)
        return clip_lines(task.area, _open_loops(lines)), np.ones(task.area.n_layers)

    return pattern


def _check_lines(name: str, lines: object, n_layers: int) -> None:
    """Raise StrategyError unless `lines` are finite polylines on these layers."""
    if not isinstance(lines, Polylines):
        raise StrategyError(
            f"infill {name}: returned {describe_type(lines)} instead of Polylines",
            remedy="Return ps.Polylines.from_lines(lists), with one list of (n, 2) arrays, mm, for each area",
        )
    if lines.n_lines and not 0 <= int(lines.layer.min()) <= int(lines.layer.max()) < n_layers:
        raise StrategyError(
            f"infill {name}: has lines for area {lines.layer.max()}, but the task has {n_layers} areas",
            remedy="Count areas from 0; task.area.rings(k) are the outlines of area k",
        )
    if (np.diff(lines.layer) < 0).any():
        raise StrategyError(
            f"infill {name}: the lines are not sorted by area",
            remedy="Sort them by layer, or use ps.Polylines.from_lines",
        )
    if not (np.abs(lines.xy) < _MAX_COORDINATE).all():  # also true for nan
        where = int(np.flatnonzero(~(np.abs(lines.xy) < _MAX_COORDINATE).all(axis=1))[0])
        x, y = lines.xy[where].tolist()
        raise StrategyError(
            f"infill {name}: point {where} is at x {x:g}, y {y:g}, far outside of any bed",
            remedy="Look for divisions by zero and for lengths that are not in mm",
        )


def _open_loops(lines: Polylines) -> Polylines:
    """Turn loops into open lines that end at their first point."""
    if not lines.closed.any():
        return lines
    closed = np.flatnonzero(lines.closed)
    points = np.insert(np.arange(len(lines.xy)), lines.start[closed + 1], lines.start[closed])
    return Polylines.of(lines.xy[points], lines.size + lines.closed, lines.layer)


def check_density(name: str, volume: float, nominal: float, profile: Profile) -> None:
    """Check that the lines of a custom pattern reach the density.

    Args:
        name: of the pattern.
        volume: volume of its lines and connections with corrected widths, mm³.
        nominal: volume for the density of the profile, mm³.
        profile: has the density.

    Raises:
        StrategyError: the volume is off by more than a tenth.
    """
    if nominal < _MIN_VOLUME or abs(volume / nominal - 1) <= _MAX_ERROR:
        return
    density = profile.quality.infill_density
    raise StrategyError(
        f"infill {name}: extrudes {volume / nominal:.2g} times the volume of infill_density = {density:g}",
        remedy="Place lines task.spacing apart, or pass ps.Infill(function, measured=False) to skip this check",
    )
