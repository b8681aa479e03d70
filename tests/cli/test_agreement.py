"""The same fault in the same file: `check`, `check --model` and `dry-run` agree, for every flavour of G-code."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from pathlib import Path

import pytest

from printer_slicer.firmware import FLAVOURS
from printer_slicer.mesh_io import export_stl
from tests.cli.command_line import typed
from tests.effort import crossed
from tests.parts import box

Lines = list[str]
HEIGHTS = ("--set", "layer_height=0.3", "--set", "first_layer_height=0.3", "--planner", "uniform")


def without(*beginnings: str) -> Callable[[Lines], Lines]:
    """A file that lacks these commands."""
    return lambda lines: [line for line in lines if not line.startswith(beginnings)]


def with_line(line: str) -> Callable[[Lines], Lines]:
    """A file with one more line where the fourth layer begins."""

    def plant(lines: Lines) -> Lines:
        at = [nth for nth, one in enumerate(lines) if one == ";LAYER_CHANGE"][3] + 1
        return [*lines[:at], line, *lines[at:]]

    return plant


NUMBERS = {
    "bare letter": ("G1 X Y100", "X has no number"),
    "bare feed": ("G1 X100 F", "F has no number"),
    "nan": ("G1 Xnan Y100", "X is nan"),
    "infinity": ("G1 X100 E-inf", "E is -inf"),
    "two points": ("G1 X100.2.3 Y100", "X100.2.3 is not a valid number"),
    "two signs": ("G1 X100 Y--5", "Y--5 is not a valid number"),
    "position": ("G92 E1.2.3", "E1.2.3 is not a valid number"),
    "temperature": ("M104 Snan", "S is nan"),
    "limit": ("M204 S1.2.3", "S1.2.3 is not a valid number"),
}
FAULTS: dict[str, tuple[Callable[[Lines], Lines], str]] = {
    "half the plastic": (with_line("M221 S50"), "sets the flow to 50%"),
    "a tenth of the speed": (with_line("M220 S10"), "sets the speed to 10%"),
    "no heating": (without("M104 S2", "M109"), "cold"),
    "no waiting for heat": (without("M190", "M109"), "cold"),
    "switched off": (with_line("M104 S0"), "cold"),
    "cooled": (with_line("M109 R60"), "cold"),
    "no homing": (without("G28"), "moved before homing|moves before homing"),
    "motors off": (with_line("M84"), "motors were"),
    "under the bed": (with_line("G1 Z-0.5"), "would hit the bed|outside the machine|out of the machine"),
    "350 C": (with_line("M104 S350"), "350"),
    "stored settings": (with_line("M500"), "M500"),
    "a long line": (with_line("G1 X" + "0" * 100 + "100"), "bytes long"),
}


@cache
def part(folder: Path) -> Path:
    path = folder / "part.stl"
    export_stl(box((6.0, 6.0, 1.5)), path)
    return path


@cache
def sliced(folder: Path, flavour: str) -> tuple[str, ...]:
    path = folder / f"{flavour}.gcode"
    done = typed("slice", part(folder), "-o", path, "--set", f"printer.flavour={flavour}", *HEIGHTS)
    assert done.code == 0, done.err
    return tuple(path.read_text().splitlines())


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("agreement")


def planted(folder: Path, flavour: str, plant: Callable[[Lines], Lines]) -> Path:
    """A file with a fault in it."""
    path = folder / "planted.gcode"
    path.write_text("\n".join(plant(list(sliced(folder, flavour)))) + "\n")
    return path


def told(folder: Path, flavour: str, plant: Callable[[Lines], Lines]) -> dict[str, tuple[int, str]]:
    """Exit code and words of each tool about a file with a fault in it."""
    path = planted(folder, flavour, plant)
    machine = ("--set", f"printer.flavour={flavour}")
    runs = {
        "check": typed("check", path, *machine),
        "check --model": typed("check", path, "--model", part(folder), *machine),
        "dry-run": typed("dry-run", path, *machine),
    }
    return {name: (run.code, run.out + run.err) for name, run in runs.items()}


def printed(folder: Path, flavour: str, *flags: str) -> dict[str, tuple[int, str]]:
    """The same of `print`, for the file that was planted last."""
    machine = ("--set", f"printer.flavour={flavour}")
    run = typed("print", folder / "planted.gcode", "--port", "sim:", "-q", *machine, *flags, cwd=folder)
    return {"print": (run.code, run.out + run.err)}


@pytest.mark.parametrize("flavour", sorted(FLAVOURS))
def test_every_tool_passes_a_good_file(flavour: str, folder: Path) -> None:
    found = told(folder, flavour, lambda lines: lines)

    assert {name: code for name, (code, _) in found.items()} == dict.fromkeys(found, 0), found


TAKES_LOWER_CASE = {"klipper", "reprapfirmware", "repetier"}
LOWER_CASE = {
    "whole line": ("g1 x100 y100", "G1 X100 Y100"),
    "a word": ("G1 X100 y100", "G1 X100 Y100"),
    "no blanks": ("g1x100y100", "G1X100Y100"),
    "a heater": ("m104 s200", "M104 S200"),
}
FREE_TEXT = ("M117 printing layer 4 of x 8", 'M117 "x 4"')


@pytest.mark.parametrize(("case", "flavour"), crossed(LOWER_CASE, sorted(FLAVOURS)))
def test_every_tool_takes_lower_case_as_the_firmware_does(case: str, flavour: str, folder: Path) -> None:
    line, capitals = LOWER_CASE[case]
    found = told(folder, flavour, with_line(line)) | printed(folder, flavour)

    refused = flavour not in TAKES_LOWER_CASE
    codes = {name: (2 if name == "print" else 7) if refused else 0 for name in found}
    assert {name: code for name, (code, _) in found.items()} == codes, found
    for name, (_, text) in found.items() if refused else ():
        assert f"line {1 + (folder / 'planted.gcode').read_text().splitlines().index(line)}" in text, name
        assert f"write {capitals}" in text, name


@pytest.mark.parametrize(("line", "flavour"), crossed(FREE_TEXT, sorted(FLAVOURS)))
def test_no_tool_minds_lower_case_in_a_text(line: str, flavour: str, folder: Path) -> None:
    found = told(folder, flavour, with_line(line))

    assert "lower case" not in str(found), found


@pytest.mark.parametrize("flavour", sorted(FLAVOURS))
def test_the_simulator_takes_lower_case_where_it_is_allowed(flavour: str, folder: Path) -> None:
    planted(folder, flavour, with_line("g1 x100 y100"))

    _, text = printed(folder, flavour, "--allow", "unreadable")["print"]

    assert ("nknown command" in text) == (flavour not in TAKES_LOWER_CASE), text


@pytest.mark.parametrize(("fault", "flavour"), crossed(NUMBERS, sorted(FLAVOURS)))
def test_every_tool_refuses_words_that_hold_no_number(fault: str, flavour: str, folder: Path) -> None:
    line, words = NUMBERS[fault]
    found = told(folder, flavour, with_line(line))

    assert {name: code for name, (code, _) in found.items()} == dict.fromkeys(found, 7), found
    for name, (_, text) in found.items():
        assert words in text or "cannot be parsed" in text, name


@pytest.mark.parametrize(("fault", "flavour"), crossed(FAULTS, ["klipper", "marlin", "reprapfirmware"]))
def test_every_tool_refuses_the_same_faults(fault: str, flavour: str, folder: Path) -> None:
    plant, words = FAULTS[fault]
    found = told(folder, flavour, plant)

    codes = {code for code, _ in found.values()}
    assert codes in ({7}, {2}), found
    for name, (_, text) in found.items():
        assert any(one in text for one in words.split("|")), (name, text)


def test_a_ratio_that_machines_are_known_to_ask_for_is_told(folder: Path) -> None:
    found = told(folder, "marlin", with_line("M221 S95"))

    for name, (code, text) in found.items():
        assert code == 0, name
        assert "sets the flow to 95%" in text, name


READS = {
    ("marlin", "G1 X Y5"): "ignores the word",
    ("prusa", "G1 X Y5"): "reads it as 0",
    ("smoothie", "G1 X Y5"): "reads it as 0",
    ("repetier", "G1 X Y5"): "reads it as 0",
    ("klipper", "G1 X Y5"): "rejects the whole line",
    ("reprapfirmware", "G1 X Y5"): "rejects the whole line",
    ("klipper", "G1 X1.2.3"): "rejects the whole line",
    ("marlin_legacy", "G1 X1.2.3"): "only the valid part",
    ("klipper", "G1 Xnan"): "ignores the word",
    ("prusa", "G1 Xnan"): "loses its position",
}


@pytest.mark.parametrize(("flavour", "line"), READS)
def test_what_a_firmware_makes_of_a_word_is_said(flavour: str, line: str, folder: Path) -> None:
    path = planted(folder, flavour, with_line(line))

    assert READS[flavour, line] in typed("check", path, "--set", f"printer.flavour={flavour}").err
