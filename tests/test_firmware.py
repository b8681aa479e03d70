"""The rows of firmwares agree with each other, with the settings and with the simulated printers."""

from __future__ import annotations

import ast
import re
from dataclasses import replace
from pathlib import Path
from typing import get_args

import pytest

import printer_slicer
from printer_slicer.firmware import (
    DEFAULT_WIRE_DIALECT,
    FIRMWARES,
    WIRE_DIALECTS,
    Flavour,
    flavour_of,
    wire_dialect_name,
)
from printer_slicer.gcode.commands import TABLE, Effect
from printer_slicer.gcode.labels import LABEL_WORDS
from printer_slicer.gcode.lexer import extended, parse
from printer_slicer.sim.flavours import FLAVOURS as SIMULATED_FLAVOURS
from printer_slicer.sim.front_end import FRONT_ENDS, MARLIN_2_1
from printer_slicer.sim.printer import SimulatedPrinter
from printer_slicer.stream.replies import Identity, read_reply
from tests.programs import LARGE


def test_the_names_of_flavours_are_those_of_the_table() -> None:
    assert set(get_args(Flavour)) == set(FIRMWARES)


def test_every_wire_dialect_belongs_to_one_firmware() -> None:
    names = [name for firmware in FIRMWARES.values() for name in firmware.wire]

    assert sorted(names) == sorted(WIRE_DIALECTS)
    assert {flavour_of(dialect) for dialect in WIRE_DIALECTS.values()} == set(FIRMWARES)
    assert [name for name, dialect in WIRE_DIALECTS.items() if re.search(dialect.m115_pattern, "")] == [
        DEFAULT_WIRE_DIALECT
    ]
    assert list(WIRE_DIALECTS)[-1] == DEFAULT_WIRE_DIALECT


@pytest.mark.parametrize("name", [name for name in FRONT_ENDS if name != "octoprint virtual"])
def test_simulated_printers_are_identified_by_their_reply_to_m115(name: str) -> None:
    front_end = FRONT_ENDS[name]
    said = front_end.identity.format(name=front_end.name, tools=1).encode()
    [firmware] = [reply.firmware for reply in read_reply(said) if isinstance(reply, Identity)]

    assert flavour_of(WIRE_DIALECTS[wire_dialect_name(firmware)]) == front_end.flavour


@pytest.mark.parametrize("name", FIRMWARES)
def test_commands_of_each_row_can_be_parsed(name: str) -> None:
    dialect, firmware = FIRMWARES[name].dialect, FIRMWARES[name]
    pause = (
        parse(dialect.pause.encode())[0]
        or extended(dialect.pause.encode())[0]
        or dialect.pause.upper().encode()
    )

    assert {dialect.labels, dialect.m486} <= set(LABEL_WORDS)
    assert TABLE[pause].effect & Effect.WAITS_FOR_PERSON
    assert b"0.150" in firmware.baby_step_command(0.15)
    assert firmware.cancel_object_command is None or b"left_one" in firmware.cancel_object_command("left_one")
    assert firmware.set_z_command is None or firmware.set_z_command(12.5).endswith(b"12.5")


@pytest.mark.parametrize("name", FIRMWARES)
def test_the_simulator_knows_every_flavour_and_reads_relative_modes_by_the_same_rule(name: str) -> None:
    board = SimulatedPrinter(LARGE, replace(MARLIN_2_1, flavour=name)).board

    assert name in SIMULATED_FLAVOURS, f"{name} has no entry in sim/flavours.py"
    assert board.counting.rule == FIRMWARES[name].dialect.counting, f"{name} in _COUNTING of sim/board.py"


def test_no_two_firmwares_have_one_name_in_prusaslicer() -> None:
    names = [firmware.prusaslicer_name for firmware in FIRMWARES.values() if firmware.prusaslicer_name]

    assert len(set(names)) == len(names)


# What a person types or another program writes is not knowledge about a firmware.
_NAME_FIRMWARES = {"cli/arguments.py", "importing/printers.py", "importing/cura_names.py"}


def test_no_other_module_compares_names_of_firmwares() -> None:
    product = Path(printer_slicer.__file__).parent
    names = set(FIRMWARES) - {"marlin"}  # the default of some arguments

    found = {
        path.relative_to(product).as_posix()
        for path in product.rglob("*.py")
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.Constant) and node.value in names
    }
    assert {name for name in found if not name.startswith(("firmware/", "sim/"))} <= _NAME_FIRMWARES
