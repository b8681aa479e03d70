"""Paths of several extruders: tool changes in the moves, and what is written for them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from printer_slicer.errors import StrategyError
from printer_slicer.extrusion import extrude
from printer_slicer.gcode import write_gcode
from printer_slicer.model import Heat, Program, ToolChange
from printer_slicer.pipeline import slice_stages
from printer_slicer.profile import Profile
from printer_slicer.profile.profile import Extruder
from printer_slicer.roles import Role
from printer_slicer.strategies import Strategies
from tests.parts import box, plain
from tests.tiny_gcode import body, commands

PLAIN = plain(skirt_loops=0)
THICKER = 2.85  # mm of the second extruder's filament


class TwoExtruders(Profile, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A profile of a machine that prints with its tools 0 and 3."""

    @property
    def extruders(self) -> tuple[Extruder, ...]:
        """Both."""
        first = super().extruders[0]
        other = type(self.material)(
            **{name: getattr(self.material, name) for name in self.material.__struct_fields__}
            | {"filament_diameter": THICKER}
        )
        return (first, Extruder(3, first.nozzle_diameter, other))


PROFILE = TwoExtruders(printer=PLAIN.printer, material=PLAIN.material, quality=PLAIN.quality)


@pytest.fixture(scope="module")
def program() -> Program:
    """A cube whose outermost perimeters come from the second extruder."""
    stages = slice_stages(box((10.0, 10.0, 2.0)), PLAIN)
    paths = replace(stages.toolpaths, tool=np.where(stages.toolpaths.role == Role.EXTERNAL_PERIMETER, 1, 0))
    return extrude(paths, stages.travels, PROFILE)


def test_the_tool_changes_wherever_the_paths_do(program: Program) -> None:
    changes = [event for event in program.events if isinstance(event, ToolChange)]
    at = np.flatnonzero(np.diff(program.tool)) + 1

    assert len(at) >= 2
    assert [event.index for event in changes] == at.tolist()
    assert [event.tool for event in changes] == program.tool[at].tolist()
    assert (program.tool[program.role == Role.EXTERNAL_PERIMETER] == 1).all()


def test_each_extruder_feeds_its_own_filament(program: Program) -> None:
    alone = slice_stages(box((10.0, 10.0, 2.0)), PLAIN).program
    walls = program.role == Role.EXTERNAL_PERIMETER
    ratio = (PLAIN.material.filament_diameter / THICKER) ** 2

    assert program.filament[walls].sum() == pytest.approx(
        alone.filament[alone.role == Role.EXTERNAL_PERIMETER].sum() * ratio, rel=1e-6
    )


def test_the_file_names_tools_by_their_numbers_on_the_machine(program: Program) -> None:
    hot = replace(program, events=(*program.events, Heat(program.n_moves, 180.0, None, 1)))
    lines = commands(body(write_gcode(hot, PROFILE)))
    said = [line for line in lines if line.startswith(b"T")]

    assert said == [b"T3" if event.tool else b"T0" for event in hot.events if isinstance(event, ToolChange)]
    assert b"M104 T3 S180" in lines


def test_a_function_cannot_ask_for_a_tool_that_there_is_not() -> None:
    def with_another(program: Program) -> Program:
        return replace(program, events=(*program.events, ToolChange(program.n_moves, 1)))

    with pytest.raises(StrategyError, match="uses tool 1, but the number of extruders in the profile is 1"):
        slice_stages(box((10.0, 10.0, 2.0)), PLAIN, strategies=Strategies(on_program=[with_another]))
