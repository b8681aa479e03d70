"""User functions that replace built-in planners, infill patterns, flavours and post-processors.

A user function gets the same arguments as the built-in function that it replaces. Its result is checked at once, so
that an error message names the function and not a later stage. Exceptions that it raises pass through unchanged.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any, Final

import numpy as np

from printer_slicer.deprecation import renamed_attribute
from printer_slicer.errors import StrategyError
from printer_slicer.firmware import Dialect
from printer_slicer.gcode import LABEL_FORMATS
from printer_slicer.geometry import Polylines
from printer_slicer.infill import Infill, InfillTask
from printer_slicer.model import Heat, LayerPlan, Mesh, Program, ToolChange
from printer_slicer.planning import Planner
from printer_slicer.profile import Profile
from printer_slicer.texts import describe_type, get_callable_name
from printer_slicer.values import Struct, force_setattr, replace

__all__ = ["BUILT_IN", "Strategies", "check_plan", "run_line_functions", "run_program_functions"]

_ROUNDING_ERROR: Final = 1e-6  # mm, of sums of heights
_STEP_TOLERANCE: Final = 1e-3  # z steps


class Strategies(Struct, frozen=True, kw_only=True):
    """User functions that replace built-in ones; the profile sets everything else.

    Attributes:
        planner: (placed part, profile) -> layer plan. Layer heights must be within the printer's limits, layers must
            end on whole z steps, and the plan must cover the part. It may read the settings `quality.planner.*`, which
            are meant for the built-in planners.
        infill: task -> lines of the internal infill, or an `Infill` that also says how their density is measured.
        flavour: a dialect of G-code to write, for example `replace(FLAVOURS["marlin"], pause="M600")`. Macros, limits
            and the simulated printer still follow `printer.flavour`.
        on_program: functions moves -> moves, called in order before labelling, timing and writing.
        on_lines: functions lines -> lines (without line ends), called in order on the finished file.
    """

    planner: Planner | None = None
    infill: Infill | Callable[[InfillTask], Polylines] | None = None
    flavour: Dialect | None = None
    on_program: Sequence[Callable[[Program], Program]] = ()
    on_lines: Sequence[Callable[[list[str]], Iterable[str]]] = ()

    def __post_init__(self) -> None:
        if self.flavour is not None and not isinstance(self.flavour, Dialect):
            raise StrategyError(
                f"flavour {get_callable_name(self.flavour)}: is {describe_type(self.flavour)}, not a Dialect",
                remedy='Derive one from a built-in flavour: dataclasses.replace(ps.FLAVOURS["marlin"], pause="M600")',
            )
        for name in ("planner", "infill"):
            _check_function(name, getattr(self, name))
        for name in ("on_program", "on_lines"):
            value = getattr(self, name)
            if callable(value):
                force_setattr(self, name, (value,))
            for one in getattr(self, name):
                _check_function(name, one)

    @property
    def custom_infill(self) -> Infill | None:
        """The infill as an `Infill`; None if not set."""
        return self.infill if self.infill is None or isinstance(self.infill, Infill) else Infill(self.infill)

    @property
    def checked_flavour(self) -> Dialect | None:
        """The flavour with functions that check every line they return; None if not set."""
        return _wrap_flavour(self.flavour) if self.flavour else None

    own_infill = renamed_attribute("Strategies.own_infill", "Strategies.custom_infill")
    own_flavour = renamed_attribute("Strategies.own_flavour", "Strategies.checked_flavour")

    def facts(self) -> tuple[str, ...]:
        """Return comment lines that name the user's planner and infill, which no setting in the file names."""
        infill = self.custom_infill
        named = {
            "planner": self.planner and get_callable_name(self.planner),
            "infill": infill and infill.name,
        }
        return tuple(f"{what} = {name}, a user function" for what, name in named.items() if name)


def _check_function(name: str, value: object) -> None:
    """Check that a value is a function, or for `infill` an `Infill`; None is allowed."""
    if value is None or callable(value) or (name == "infill" and isinstance(value, Infill)):
        return
    raise StrategyError(
        f"{name}: {value!r} cannot be called",
        remedy=f"Pass the function itself; to use a built-in one, change the setting quality.{name}"
        if isinstance(value, str)
        else "Pass a function",
    )


BUILT_IN: Final = Strategies()


# Planners


def check_plan(plan: object, part: Mesh, profile: Profile, planner: object) -> LayerPlan:
    """Check the layer plan that a user's planner returned, and return it.

    Args:
        plan: the value that the planner returned.
        part: the part, placed on the bed.
        profile: the profile with the printer's limits.
        planner: the user's function, for messages.

    Raises:
        StrategyError: the value is no LayerPlan, exceeds the printer's limits, or does not cover the part.
    """
    name, step = f"planner {get_callable_name(planner)}", profile.printer.z_step
    if not isinstance(plan, LayerPlan):
        raise StrategyError(
            f"{name}: returned {describe_type(plan)}, not a LayerPlan",
            remedy="Return ps.LayerPlan.from_tops(tops), where tops (L,) has the z of the top of each layer in mm",
        )
    if not plan.n_layers:
        raise StrategyError(
            f"{name}: returned no layers",
            remedy=f"Cover the part, which is {part.height:.4g} mm high (part.height)",
        )
    _check_heights(name, plan, profile)
    off = np.abs(plan.top / step - np.round(plan.top / step)) > _STEP_TOLERANCE
    if off.any():
        k = int(np.argmax(off))
        raise StrategyError(
            f"{name}: layer {k + 1} ends at {plan.top[k]:.6g} mm, not on a whole number of z steps of {step:g} mm",
            remedy="Round the tops: np.round(tops / step) * step with step = profile.printer.z_step",
        )
    low, high, top = float(plan.bottom[-1]), float(plan.top[-1]), part.height
    if high < top - step - _ROUNDING_ERROR or low >= top:
        raise StrategyError(
            f"{name}: the last layer goes from {low:.6g} to {high:.6g} mm, but the part ends at {top:.6g} mm",
            remedy="Make the last layer contain the top of the part (part.height)",
        )
    return plan if plan.planner else replace(plan, planner=get_callable_name(planner))


def _check_heights(name: str, plan: LayerPlan, profile: Profile) -> None:
    """Check that the printer can print the layer heights, and that each cut plane lies within its layer."""
    printer = profile.printer
    heights = np.diff(plan.top, prepend=0.0)
    fits = (heights >= printer.min_layer - _ROUNDING_ERROR) & (heights <= printer.max_layer + _ROUNDING_ERROR)
    if not fits.all():  # false for nan, too
        k = int(np.argmin(fits))
        raise StrategyError(
            f"{name}: layer {k + 1} is {heights[k]:.6g} mm high (top {plan.top[k]:.6g} mm), but {printer.name!r} prints"
            f" layers of {printer.min_layer:g} to {printer.max_layer:g} mm",
            remedy="Keep heights between profile.printer.min_layer and profile.printer.max_layer",
        )
    within = (plan.cut > plan.bottom) & (plan.cut < plan.top)
    if not within.all():
        k = int(np.argmin(within))
        raise StrategyError(
            f"{name}: layer {k + 1} from {plan.bottom[k]:.6g} to {plan.top[k]:.6g} mm is cut at {plan.cut[k]:.6g} mm,"
            " which is not inside the layer",
            remedy="Cut each layer between its bottom and top; ps.LayerPlan.from_tops(tops) cuts it in the middle",
        )


# Post-processors


def run_program_functions(
    program: Program, functions: Sequence[Callable[[Program], Program]], n_tools: int = 1
) -> Program:
    """Apply the user's functions to the moves, in order.

    Args:
        program: the moves of the print.
        functions: the user's functions.
        n_tools: number of extruders of the profile.

    Raises:
        StrategyError: a function returned an invalid program.
    """
    for function in functions:
        n_layers, program = program.plan.n_layers, function(program)
        name = f"on_program {get_callable_name(function)}"
        _check_program(name, program, n_layers)
        _check_tools(name, program, n_tools)
    return program


def _check_tools(name: str, program: Program, n_tools: int) -> None:
    """Check that the program uses only extruders of the profile."""
    tools = [
        *program.tool.tolist(),
        *(one.tool for one in program.events if isinstance(one, ToolChange | Heat)),
    ]
    wrong = {tool for tool in tools if not 0 <= tool < n_tools}
    if wrong:
        raise StrategyError(
            f"{name}: uses tool {min(wrong)}, but the number of extruders in the profile is {n_tools}",
            remedy="Use indices of `Profile.extruders`, counted from 0",
        )


def _check_program(name: str, program: object, n_layers: int) -> None:
    """Check that the value is a program with finite moves, sorted layers and sorted events."""
    if not isinstance(program, Program):
        raise StrategyError(
            f"{name}: returned {describe_type(program)}, not a Program",
            remedy="Return dataclasses.replace(program, speed=...), or the program itself",
        )
    if program.plan.n_layers != n_layers:
        raise StrategyError(
            f"{name}: changed the number of layers from {n_layers} to {program.plan.n_layers}",
            remedy="Change only the moves; a planner chooses the layers",
        )
    good = np.isfinite(program.xyz).all(axis=1) & np.isfinite(program.filament)
    good &= np.isfinite(program.speed) & (program.speed > 0)
    if not good.all():
        k = int(np.argmin(good))
        x, y, z = program.xyz[k].tolist()
        raise StrategyError(
            f"{name}: move {k} is invalid: it goes to x {x:g}, y {y:g}, z {z:g} with {program.filament[k]:g} mm of"
            f" filament at {program.speed[k]:g} mm/s",
            remedy="Use finite numbers only, and a speed above 0",
        )
    layer = program.layer
    if len(layer) and not ((np.diff(layer) >= 0).all() and 0 <= layer[0] <= layer[-1] < n_layers):
        raise StrategyError(
            f"{name}: the layer numbers of the moves do not ascend from 0 to {n_layers - 1}",
            remedy="Keep the moves of a layer together, and the layers in order",
        )
    places = [event.index for event in program.events]
    if places != sorted(places) or (places and not 0 <= places[0] <= places[-1] <= program.n_moves):
        raise StrategyError(
            f"{name}: the events are not sorted by the index of the {program.n_moves} moves",
            remedy="Adjust the index of each event when you add or remove moves, and sort the events by index",
        )


def run_line_functions(text: bytes, functions: Sequence[Callable[[list[str]], Iterable[str]]]) -> bytes:
    """Apply the user's functions to the lines of a file, in order.

    Raises:
        StrategyError: a function returned invalid lines.
    """
    for function in functions:
        name = f"on_lines {get_callable_name(function)}"
        value: Any = function(text.decode("utf-8").removesuffix("\n").split("\n"))
        if value is None or isinstance(value, str | bytes):
            raise StrategyError(
                f"{name}: returned {describe_type(value)}, not lines",
                remedy="Return a list of lines without line ends, or yield them one by one",
            )
        lines = list(value)
        for number, line in enumerate(lines, 1):
            _check_line(f"{name}: line {number}", line)
        if not any(line.partition(";")[0].strip() for line in lines):
            raise StrategyError(
                f"{name}: returned {len(lines)} lines without a command",
                remedy="Return the given lines too; a generator that was used before yields nothing",
            )
        text = "".join(f"{line}\n" for line in lines).encode()
    return text


def _check_line(where: str, line: object, *, comment: bool = True) -> None:
    """Check that a value is one line that can be sent to a printer."""
    if not isinstance(line, str):
        raise StrategyError(f"{where} is {describe_type(line)}, not text", remedy="Return lines of type str")
    if not line.replace("\t", " ").isprintable():
        raise StrategyError(
            f"{where} contains a control character: {line[:60]!r}",
            remedy="Return lines without line ends, and a separate line for each command",
        )
    if not line.partition(";")[0].isascii() or not (comment or line.strip()):
        raise StrategyError(
            f"{where} is not a command: {line[:60]!r}",
            remedy="Use only ASCII characters in commands; other characters are allowed in comments, after ;",
        )


# Flavours


def _wrap_flavour(flavour: Dialect) -> Dialect:
    """Return the flavour with functions that check the lines they return."""
    for name in ("labels", "m486"):
        if getattr(flavour, name) not in LABEL_FORMATS:
            raise StrategyError(
                f"flavour: {name} = {getattr(flavour, name)!r} is not a format of object labels",
                remedy=f"Use one of {', '.join(LABEL_FORMATS)}",
            )

    def wrap_function(name: str, *, many: bool) -> Any:
        """Wrap a function of the flavour, so that its result is checked; None if the flavour lacks the function."""
        function = getattr(flavour, name)

        def call_and_check(*arguments: Any) -> Any:
            """Call the function and check what it returns."""
            lines = function(*arguments)
            if many and not isinstance(lines, list):
                raise StrategyError(
                    f"flavour: {name} returned {describe_type(lines)}, not a list of lines",
                    remedy="Return a list of str",
                )
            for line in lines if many else [lines]:
                _check_line(f"flavour: a line of {name}", line, comment=False)
            return lines

        return call_and_check if function is not None else None

    return replace(
        flavour,
        limits=wrap_function("limits", many=True),
        acceleration=wrap_function("acceleration", many=False),
        pressure_advance=wrap_function("pressure_advance", many=False),
        retraction=wrap_function("retraction", many=True),
        progress=wrap_function("progress", many=False),
    )
