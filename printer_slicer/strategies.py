"""Strategies from outside: functions of one's own in place of ours, and what is asked of what they give.

A function is called as ours are, with the same values. What it gives is checked at once, so that a slip in it is told
in its own words and not by a stage further down. What it raises is passed on as it is.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np

from printer_slicer.errors import StrategyError
from printer_slicer.firmware import Dialect
from printer_slicer.gcode import LABEL_WORDS
from printer_slicer.geometry import Polylines
from printer_slicer.infill import Infill, InfillTask
from printer_slicer.model import Heat, LayerPlan, Mesh, Program, ToolChange
from printer_slicer.planning import Planner
from printer_slicer.profile import Profile
from printer_slicer.texts import callable_name, describe_type

__all__ = ["OURS", "Strategies", "check_plan", "run_line_functions", "run_program_functions"]

_DUST: Final = 1e-6  # mm; floating-point dust of sums of heights
_LATTICE: Final = 1e-3  # of a z step


@dataclass(frozen=True, slots=True, kw_only=True)
class Strategies:
    """Functions of one's own in place of ours; what is not given is done as the profile says.

    Attributes:
        planner: (placed part, profile) -> its layers. They must rise within the printer's limits, end on whole z steps
            and cover the part. The settings `quality.planner.*` are those of our planners; this one takes what it
            likes of them.
        infill: task -> the lines of the sparse infill, or an `Infill` that says how they are measured.
        flavour: how the printer wants commands said, for example `replace(FLAVOURS["marlin"], pause="M600")`. What
            macros, limits and the simulated printer make of commands is still up to `printer.flavour`.
        on_program: one after the other, moves -> moves, before they are labelled, timed and written.
        on_lines: one after the other, lines of the file without line ends -> lines, when all else is written.
    """

    planner: Planner | None = None
    infill: Infill | Callable[[InfillTask], Polylines] | None = None
    flavour: Dialect | None = None
    on_program: Sequence[Callable[[Program], Program]] = ()
    on_lines: Sequence[Callable[[list[str]], Iterable[str]]] = ()

    def __post_init__(self) -> None:
        if self.flavour is not None and not isinstance(self.flavour, Dialect):
            raise StrategyError(
                f"flavour {callable_name(self.flavour)}: is {describe_type(self.flavour)}, not a Dialect",
                remedy='take one and change it: dataclasses.replace(ps.FLAVOURS["marlin"], pause="M600")',
            )
        for name in ("planner", "infill"):
            _insist_on_function(name, getattr(self, name))
        for name in ("on_program", "on_lines"):
            given = getattr(self, name)
            if callable(given):
                object.__setattr__(self, name, (given,))
            for one in getattr(self, name):
                _insist_on_function(name, one)

    @property
    def custom_infill(self) -> Infill | None:
        """The infill, with how it is measured."""
        return self.infill if self.infill is None or isinstance(self.infill, Infill) else Infill(self.infill)

    @property
    def checked_flavour(self) -> Dialect | None:
        """The flavour, with all that it says looked at as it is said."""
        return _watched(self.flavour) if self.flavour else None

    def facts(self) -> tuple[str, ...]:
        """What a file should tell of them, since its settings cannot."""
        infill = self.custom_infill
        named = {"planner": self.planner and callable_name(self.planner), "infill": infill and infill.name}
        return tuple(f"{what} = {name}, a function from outside" for what, name in named.items() if name)


def _insist_on_function(name: str, given: object) -> None:
    if given is None or callable(given) or (name == "infill" and isinstance(given, Infill)):
        return
    raise StrategyError(
        f"{name}: {given!r} cannot be called",
        remedy=f"pass the function itself; a name such as 'gyroid' is a setting: quality.{name}"
        if isinstance(given, str)
        else "pass a function",
    )


OURS: Final = Strategies()


# Planners


def check_plan(plan: object, part: Mesh, profile: Profile, planner: object) -> LayerPlan:
    """The plan that a planner from outside gave.

    Args:
        plan: what it gave.
        part: placed.
        profile: holds the printer's limits.
        planner: the function, for messages.

    Raises:
        StrategyError: it is none, or the printer cannot print it, or the part is not covered.
    """
    name, step = f"planner {callable_name(planner)}", profile.printer.z_step
    if not isinstance(plan, LayerPlan):
        raise StrategyError(
            f"{name}: gave {describe_type(plan)}, not a LayerPlan",
            remedy="return ps.LayerPlan.from_tops(tops), with tops (L,) the z of the top of each layer, mm",
        )
    if not plan.n_layers:
        raise StrategyError(
            f"{name}: gave no layers", remedy=f"the part is {part.height:.4g} mm high: part.height"
        )
    _insist_on_heights(name, plan, profile)
    off = np.abs(plan.top / step - np.round(plan.top / step)) > _LATTICE
    if off.any():
        k = int(np.argmax(off))
        raise StrategyError(
            f"{name}: layer {k + 1} ends at {plan.top[k]:.6g} mm, which is no whole number of z steps of {step:g} mm",
            remedy="round them: np.round(tops / step) * step with step = profile.printer.z_step",
        )
    low, high, top = float(plan.bottom[-1]), float(plan.top[-1]), part.height
    if high < top - step - _DUST or low >= top:
        raise StrategyError(
            f"{name}: the last layer goes from {low:.6g} to {high:.6g} mm, but the part ends at {top:.6g} mm",
            remedy="let the last layer hold the top of the part: part.height",
        )
    return plan if plan.planner else replace(plan, planner=callable_name(planner))


def _insist_on_heights(name: str, plan: LayerPlan, profile: Profile) -> None:
    """All layers rise, within the printer's limits, and are cut within themselves."""
    printer = profile.printer
    heights = np.diff(plan.top, prepend=0.0)
    fits = (heights >= printer.min_layer - _DUST) & (heights <= printer.max_layer + _DUST)
    if not fits.all():  # what is not a number does not fit either
        k = int(np.argmin(fits))
        raise StrategyError(
            f"{name}: layer {k + 1} is {heights[k]:.6g} mm high (top {plan.top[k]:.6g} mm), but {printer.name!r} prints"
            f" layers of {printer.min_layer:g} to {printer.max_layer:g} mm",
            remedy="tops must rise by that much each: profile.printer.min_layer, profile.printer.max_layer",
        )
    within = (plan.cut > plan.bottom) & (plan.cut < plan.top)
    if not within.all():
        k = int(np.argmin(within))
        raise StrategyError(
            f"{name}: layer {k + 1} from {plan.bottom[k]:.6g} to {plan.top[k]:.6g} mm is cut at {plan.cut[k]:.6g} mm",
            remedy="cut it between bottom and top; ps.LayerPlan.from_tops(tops) cuts in the middle",
        )


# Post-processors


def run_program_functions(
    program: Program, functions: Sequence[Callable[[Program], Program]], n_tools: int = 1
) -> Program:
    """The moves after all functions from outside had their turn.

    Args:
        program: the moves.
        functions: one after the other.
        n_tools: number of extruders of the profile.

    Raises:
        StrategyError: one of them gave what is no program any more.
    """
    for function in functions:
        n_layers, program = program.plan.n_layers, function(program)
        name = f"on_program {callable_name(function)}"
        _check_program(name, program, n_layers)
        _check_tools(name, program, n_tools)
    return program


def _check_tools(name: str, program: Program, n_tools: int) -> None:
    asked = [
        *program.tool.tolist(),
        *(one.tool for one in program.events if isinstance(one, ToolChange | Heat)),
    ]
    wrong = {tool for tool in asked if not 0 <= tool < n_tools}
    if wrong:
        raise StrategyError(
            f"{name}: asks for tool {min(wrong)}, and the profile has {n_tools}",
            remedy="tools are numbers of `Profile.extruders`, counted from 0",
        )


def _check_program(name: str, program: object, n_layers: int) -> None:
    if not isinstance(program, Program):
        raise StrategyError(
            f"{name}: gave {describe_type(program)}, not a Program",
            remedy="return dataclasses.replace(program, speed=...), or the program itself",
        )
    if program.plan.n_layers != n_layers:
        raise StrategyError(
            f"{name}: the plan has {program.plan.n_layers} layers now, before it had {n_layers}",
            remedy="change the moves; layers are chosen by a planner",
        )
    good = np.isfinite(program.xyz).all(axis=1) & np.isfinite(program.filament)
    good &= np.isfinite(program.speed) & (program.speed > 0)
    if not good.all():
        k = int(np.argmin(good))
        x, y, z = program.xyz[k].tolist()
        raise StrategyError(
            f"{name}: move {k} goes to x {x:g}, y {y:g}, z {z:g} with {program.filament[k]:g} mm of filament at"
            f" {program.speed[k]:g} mm/s",
            remedy="all of these must be numbers, and the speed above 0",
        )
    layer = program.layer
    if len(layer) and not ((np.diff(layer) >= 0).all() and 0 <= layer[0] <= layer[-1] < n_layers):
        raise StrategyError(
            f"{name}: the layers of the moves do not ascend from 0 to {n_layers - 1}",
            remedy="keep moves of a layer together, and layers in their order",
        )
    places = [event.index for event in program.events]
    if places != sorted(places) or (places and not 0 <= places[0] <= places[-1] <= program.n_moves):
        raise StrategyError(
            f"{name}: its events do not stand in the order of the {program.n_moves} moves",
            remedy="where moves are added or left out, move the index of each event along, and sort them by it",
        )


def run_line_functions(text: bytes, functions: Sequence[Callable[[list[str]], Iterable[str]]]) -> bytes:
    """The text of a file after all functions from outside had their turn.

    Raises:
        StrategyError: one of them gave what are no lines of G-code.
    """
    for function in functions:
        name = f"on_lines {callable_name(function)}"
        given: Any = function(text.decode("utf-8").removesuffix("\n").split("\n"))
        if given is None or isinstance(given, str | bytes):
            raise StrategyError(
                f"{name}: gave {describe_type(given)}, not lines",
                remedy="return a list of lines without line ends, or yield them one by one",
            )
        lines = list(given)
        for number, line in enumerate(lines, 1):
            _check_line(f"{name}: line {number}", line)
        if not any(line.partition(";")[0].strip() for line in lines):
            raise StrategyError(
                f"{name}: no command is left in {len(lines)} lines",
                remedy="give back the lines it was given, too; a generator that was used up gives none",
            )
        text = "".join(f"{line}\n" for line in lines).encode()
    return text


def _check_line(where: str, line: object, *, comment: bool = True) -> None:
    """Refuse what is not one line that a printer could get."""
    if not isinstance(line, str):
        raise StrategyError(f"{where} is {describe_type(line)}, not text", remedy="lines are of type str")
    if not line.replace("\t", " ").isprintable():
        raise StrategyError(
            f"{where} holds what cannot be printed: {line[:60]!r}",
            remedy="one line each, without line ends; return two lines for two commands",
        )
    if not line.partition(";")[0].isascii() or not (comment or line.strip()):
        raise StrategyError(
            f"{where} is no command: {line[:60]!r}",
            remedy="commands are ASCII letters; other ones may stand in comments, after ;",
        )


# Flavours


def _watched(flavour: Dialect) -> Dialect:
    """The same flavour, which is refused as soon as it says something that is no line."""
    for name in ("labels", "m486"):
        if getattr(flavour, name) not in LABEL_WORDS:
            raise StrategyError(
                f"flavour: {name} = {getattr(flavour, name)!r} is no way of marking things",
                remedy=f"one of {', '.join(LABEL_WORDS)}",
            )

    def watched(name: str, *, many: bool) -> Any:
        """One of its functions, looked at."""
        function = getattr(flavour, name)

        def call(*arguments: Any) -> Any:
            """As it is, if it says lines."""
            said = function(*arguments)
            if many and not isinstance(said, list):
                raise StrategyError(
                    f"flavour: {name} gave {describe_type(said)}, not a list of lines",
                    remedy="return a list of str",
                )
            for line in said if many else [said]:
                _check_line(f"flavour: what {name} gave", line, comment=False)
            return said

        return call if function is not None else None

    return replace(
        flavour,
        limits=watched("limits", many=True),
        acceleration=watched("acceleration", many=False),
        pressure_advance=watched("pressure_advance", many=False),
        retraction=watched("retraction", many=True),
        progress=watched("progress", many=False),
    )
