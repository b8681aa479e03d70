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
    get_flavour,
    match_wire_dialect,
)
from printer_slicer.gcode.commands import TABLE, Effect
from printer_slicer.gcode.labels import LABEL_FORMATS
from printer_slicer.gcode.lexer import parse, parse_extended_command
from printer_slicer.sim.dialect_commands import DIALECT_COMMANDS
from printer_slicer.sim.firmwares import KLIPPER, MARLIN_2_1, SIMULATED_FIRMWARES
from printer_slicer.sim.printer import SimulatedPrinter
from printer_slicer.stream.replies import Identity, parse_replies
from tests.programs import LARGE
from tests.sim.sim_console import Console


def test_the_names_of_flavours_are_those_of_the_table() -> None:
    assert set(get_args(Flavour)) == set(FIRMWARES)


def test_every_wire_dialect_belongs_to_one_firmware() -> None:
    names = [name for firmware in FIRMWARES.values() for name in firmware.wire]

    assert sorted(names) == sorted(WIRE_DIALECTS)
    assert {get_flavour(dialect) for dialect in WIRE_DIALECTS.values()} == set(FIRMWARES)
    assert [name for name, dialect in WIRE_DIALECTS.items() if re.search(dialect.m115_pattern, "")] == [
        DEFAULT_WIRE_DIALECT
    ]
    assert list(WIRE_DIALECTS)[-1] == DEFAULT_WIRE_DIALECT


@pytest.mark.parametrize("name", [name for name in SIMULATED_FIRMWARES if name != "octoprint virtual"])
def test_simulated_printers_are_identified_by_their_reply_to_m115(name: str) -> None:
    simulated = SIMULATED_FIRMWARES[name]
    said = simulated.identity.format(name=simulated.name, tools=1).encode()
    [firmware] = [reply.firmware for reply in parse_replies(said) if isinstance(reply, Identity)]

    assert get_flavour(WIRE_DIALECTS[match_wire_dialect(firmware)]) == simulated.dialect


@pytest.mark.parametrize("name", FIRMWARES)
def test_commands_of_each_row_can_be_parsed(name: str) -> None:
    dialect, firmware = FIRMWARES[name].dialect, FIRMWARES[name]
    pause = (
        parse(dialect.pause.encode())[0]
        or parse_extended_command(dialect.pause.encode())[0]
        or dialect.pause.upper().encode()
    )

    assert {dialect.labels, dialect.m486} <= set(LABEL_FORMATS)
    assert TABLE[pause].effect & Effect.WAITS_FOR_PERSON
    assert b"0.150" in firmware.baby_step_command(0.15)
    assert firmware.cancel_object_command is None or b"left_one" in firmware.cancel_object_command("left_one")
    assert firmware.set_z_command is None or firmware.set_z_command(12.5).endswith(b"12.5")


@pytest.mark.parametrize("name", FIRMWARES)
def test_the_simulator_knows_every_flavour_and_reads_relative_modes_by_the_same_rule(name: str) -> None:
    state = SimulatedPrinter(LARGE, replace(MARLIN_2_1, dialect=name)).state

    assert name in DIALECT_COMMANDS, f"{name} has no entry in sim/dialect_commands.py"
    assert state.positioning.rule == FIRMWARES[name].dialect.counting, (
        f"{name} in _COUNTING of sim/firmware_state.py"
    )


def test_no_two_firmwares_have_one_name_in_prusaslicer() -> None:
    names = [firmware.prusaslicer_name for firmware in FIRMWARES.values() if firmware.prusaslicer_name]

    assert len(set(names)) == len(names)


# What a person types or another program writes is not knowledge about a firmware.
_NAME_FIRMWARES = {"cli/simulator_options.py", "importing/printers.py", "importing/cura_names.py"}


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


def call(firmware: str, command: str, value: float | str) -> bytes:
    """What the function `command` of a firmware's row makes of a value."""
    return bytes(getattr(FIRMWARES[firmware], command)(value))


# Firmware, what its row says, source.
FACTS = [
    ("marlin", {"resume_command": b"M108", "has_quick_stop": True, "halts_out_of_bounds": False, "planner_blocks": 16},
     "marlinfw.org: M108, M410, software endstops (M211) stop at the end; BLOCK_BUFFER_SIZE of Configuration_adv.h"),
    ("marlin_legacy", {"resume_command": b"M108", "has_quick_stop": True, "planner_blocks": 16},
     "Marlin 1.1: M108, M410; BLOCK_BUFFER_SIZE of Configuration_adv.h"),
    ("prusa", {"resume_command": b"M602", "halts_out_of_bounds": False, "planner_blocks": 16},
     "Prusa-Firmware's list of commands: M601 pauses, M602 resumes; BLOCK_BUFFER_SIZE of Configuration_adv.h"),
    ("klipper", {"resume_command": b"RESUME", "has_quick_stop": False, "halts_out_of_bounds": True,
                 "allows_unhomed_moves": False, "planner_blocks": 1000},
     "Klipper, G-Codes: PAUSE, RESUME; no M410; `Must home axis first`, `Move out of range`; plans by time"),
    ("reprapfirmware", {"resume_command": b"M24", "has_quick_stop": False, "halts_out_of_bounds": True,
                        "planner_blocks": 40},
     "Duet3D's G-code dictionary: M24 resumes after M25 and M226; M564, M595 (40 moves)"),
    ("repetier", {"planner_blocks": 16}, "Repetier-Firmware: PRINTLINE_CACHE_SIZE of Configuration.h"),
    ("smoothie", {"planner_blocks": 32}, "smoothieware.org, configuration options: planner_queue_size"),
]  # fmt: skip
LINES = [
    ("marlin", "baby_step_command", 0.15, b"M290 Z0.150", "marlinfw.org: M290 Z"),
    ("reprapfirmware", "baby_step_command", -0.15, b"M290 S-0.150", "Duet3D: M290 S, the same as Z"),
    ("klipper", "baby_step_command", 0.15, b"SET_GCODE_OFFSET Z_ADJUST=0.150 MOVE=1", "Klipper: Z_ADJUST is relative"),
    ("klipper", "set_z_command", 12.5, b"SET_KINEMATIC_POSITION Z=12.5", "Klipper: [force_move]"),
    ("klipper", "cancel_object_command", "lid", b"EXCLUDE_OBJECT NAME=lid", "Klipper: [exclude_object]"),
]  # fmt: skip


@pytest.mark.parametrize(("firmware", "facts", "source"), FACTS, ids=[row[0] for row in FACTS])
def test_the_host_knows_what_the_firmware_does(firmware: str, facts: dict[str, object], source: str) -> None:
    assert {fact: getattr(FIRMWARES[firmware], fact) for fact in facts} == facts, source


@pytest.mark.parametrize(("firmware", "command", "value", "line", "source"), LINES)
def test_the_host_says_what_the_firmware_understands(
    firmware: str, command: str, value: float | str, line: bytes, source: str
) -> None:
    assert call(firmware, command, value) == line, source
    assert [name for name in FIRMWARES if FIRMWARES[name].set_z_command] == ["klipper"]


def test_the_simulated_klipper_refuses_what_its_row_says() -> None:
    console = Console(replace(KLIPPER, ahead_seconds=60.0))
    unhomed = console.do("G1 X5 F3000")
    beyond = console.do("G28", "G1 X9999 F6000")

    assert (
        any("Must home axis first" in line for line in unhomed) != FIRMWARES["klipper"].allows_unhomed_moves
    )
    assert any("Move out of range" in line for line in beyond) == FIRMWARES["klipper"].halts_out_of_bounds


@pytest.mark.parametrize("name", ["marlin 1.1", "marlin 2.1", "klipper", "reprapfirmware"])
def test_baby_steps_are_known_to_the_simulated_printer(name: str) -> None:
    console = Console(SIMULATED_FIRMWARES[name])
    command = FIRMWARES[SIMULATED_FIRMWARES[name].dialect].baby_step_command(0.15).decode()
    answers = console.do("G28", "G1 Z5 F600", command)

    assert not any("nknown" in line for line in answers)
    if name != "klipper":  # whose simulation takes the command and moves nothing
        assert console.printer.state.offset[2] == pytest.approx(-0.15)
