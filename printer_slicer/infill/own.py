"""Infill from outside: a function from areas and heights to lines, and what is asked of them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from printer_slicer.arrays import Float
from printer_slicer.errors import StrategyError
from printer_slicer.geometry import Polylines, clip_lines
from printer_slicer.infill.task import Pattern, Task
from printer_slicer.profile import Profile
from printer_slicer.texts import callable_name, describe_type

__all__ = ["Infill", "InfillTask", "insist_on_density", "pattern_of"]

InfillTask: TypeAlias = Task
_OFF: float = 0.1  # share by which the density may be missed
_ENOUGH: float = 20.0  # mm³ asked for; in less, single lines decide
_FARTHEST: float = 1e5  # mm


@dataclass(frozen=True, slots=True)
class Infill:
    """Sparse infill from outside.

    Attributes:
        lines: from the task to lines: what of them lies within the areas is printed, joined along the walls as the
            profile says. It is called several times, also with some of the areas empty, and must give the same lines
            for the same areas.
        measured: whether the lines shall have the density of the profile, as the shipped patterns have: they are given
            a `spacing`, are measured with what joins them, asked again with another spacing, and their beads made up to
            a fifth wider or narrower. If they still miss the density by more than a tenth, that is an error. Where
            not, all lines are beads of the usual width, and the density is their own affair.
    """

    lines: Callable[[InfillTask], Polylines]
    measured: bool = True

    @property
    def name(self) -> str:
        """What to call it."""
        return callable_name(self.lines)


def pattern_of(own: Infill) -> Pattern:
    """Infill from outside as one of our patterns: its lines checked, and cut to the areas."""

    def pattern(task: Task) -> tuple[Polylines, Float]:
        """The lines within the areas; none of them counts more than it is long."""
        lines = own.lines(task)
        _check(own.name, lines, task.area.n_layers)
        return clip_lines(task.area, _opened(lines)), np.ones(task.area.n_layers)

    return pattern


def _check(name: str, lines: object, n_layers: int) -> None:
    """Refuse what is no set of lines on these layers."""
    if not isinstance(lines, Polylines):
        raise StrategyError(
            f"infill {name}: gave {describe_type(lines)}, not Polylines",
            remedy="return ps.Polylines.from_lines(lists), one list of (n, 2) arrays, mm, for each area of the task",
        )
    if lines.n_lines and not 0 <= int(lines.layer.min()) <= int(lines.layer.max()) < n_layers:
        raise StrategyError(
            f"infill {name}: has lines for area {lines.layer.max()}, but the task has {n_layers}",
            remedy="count areas from 0; task.area.rings(k) are the outlines of area k",
        )
    if (np.diff(lines.layer) < 0).any():
        raise StrategyError(
            f"infill {name}: its lines are not in the order of their areas",
            remedy="sort them by layer, or let ps.Polylines.from_lines do it",
        )
    if not (np.abs(lines.xy) < _FARTHEST).all():  # what is not a number is not less either
        where = int(np.flatnonzero(~(np.abs(lines.xy) < _FARTHEST).all(axis=1))[0])
        x, y = lines.xy[where].tolist()
        raise StrategyError(
            f"infill {name}: point {where} is at x {x:g}, y {y:g}, which is no place on a bed",
            remedy="look for divisions by zero, and for lengths that are not in mm",
        )


def _opened(lines: Polylines) -> Polylines:
    """Loops as open lines that end where they begin."""
    if not lines.closed.any():
        return lines
    closed = np.flatnonzero(lines.closed)
    points = np.insert(np.arange(len(lines.xy)), lines.start[closed + 1], lines.start[closed])
    return Polylines.of(lines.xy[points], lines.size + lines.closed, lines.layer)


def insist_on_density(name: str, laid: float, wanted: float, profile: Profile) -> None:
    """Refuse lines that are far from the density asked for, whatever their spacing.

    Args:
        name: of the infill.
        laid: mm³ in its lines and what joins them, beads as wide as they may be.
        wanted: mm³ that the density asks for.
        profile: holds the density.

    Raises:
        StrategyError: they are.
    """
    if wanted < _ENOUGH or abs(laid / wanted - 1) <= _OFF:
        return
    density = profile.quality.infill_density
    raise StrategyError(
        f"infill {name}: lays {laid / wanted:.2g} times the plastic that infill_density = {density:g} asks for",
        remedy="lay lines task.spacing apart, fewer where it is larger;"
        " or pass ps.Infill(function, measured=False), if density is its own affair",
    )
