"""The rules of G-code stand in one place: no second lexer, list of waiting commands, or handling of inches.

Outside of the simulated printer, which is an independent firmware on purpose, and of the vectorised reader, its fast
twin. What may hold several such commands is a list of lines to be sent.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

import printer_slicer
from printer_slicer.gcode.commands import TABLE, Effect

ROOT = Path(printer_slicer.__file__).parent
ALLOWED = (
    "sim/",
    "cli/inputs.py",  # tells G-code from other files by its first bytes
    "inspection/dry_run/command_runs.py",  # executes many commands at once, for the simulated printer
    "gcode/commands.py",
    "gcode/lexer.py",
    "gcode/state.py",
    "gcode/reading.py",
    "motion/counting.py",
)
CLASSES = {
    "waiting": {code.decode() for code, row in TABLE.items() if row.effect & Effect.WAITS},
    "heating": {code.decode() for code, row in TABLE.items() if row.heater},
    "modes": {code.decode() for code, row in TABLE.items() if row.effect & (Effect.MODE | Effect.UNITS)},
}
BUTTONS = {"M0", "M1"}  # the lint's row for them is one rule, not a class
CODES = re.compile(r"@?[A-Z_]+\d*")
PATTERN_OF_CODE = re.compile(r"\[(?:GM|MG)[TDN]*\]|\((?:[GMT]\d+\|)+[GMT]\d+\)")


def text_of(node: ast.AST) -> str:
    """The text of a constant, empty for anything else."""
    if isinstance(node, ast.Constant) and isinstance(node.value, str | bytes):
        return node.value.decode("latin-1") if isinstance(node.value, bytes) else node.value
    return ""


def together(tree: ast.AST) -> Iterator[tuple[int, list[str]]]:
    """Texts that stand together in a set, a tuple, the keys of a table, a comparison, or one text of codes."""
    for node in ast.walk(tree):
        match node:
            case ast.Set() | ast.Tuple():
                yield node.lineno, [text_of(one) for one in node.elts]
            case ast.Dict():
                yield node.lineno, [text_of(one) for one in node.keys if one is not None]
            case ast.BoolOp():
                compared = [one for one in node.values if isinstance(one, ast.Compare)]
                yield node.lineno, [text_of(two) for one in compared for two in one.comparators]
            case ast.Call(func=ast.Name(id="set" | "frozenset"), args=[ast.List() as one]):
                yield node.lineno, [text_of(two) for two in one.elts]
            case ast.Constant() if len(words := text_of(node).split()) > 1 and all(
                CODES.fullmatch(one) for one in words
            ):
                yield node.lineno, words


def handled_inches(tree: ast.AST) -> Iterator[int]:
    """Where the program compares, looks up or searches for G20."""
    for node in ast.walk(tree):
        parts: list[ast.expr] = []
        match node:
            case ast.Compare():
                parts = [node.left, *node.comparators]
            case ast.Dict():
                parts = [one for one in node.keys if one is not None]
            case ast.Set() | ast.Tuple():
                parts = node.elts
            case ast.Call(func=ast.Attribute(attr="startswith" | "count" | "find" | "get")):
                parts = node.args
            case ast.MatchValue():
                parts = [node.value]
        if any(text_of(part).strip().upper() == "G20" for part in parts):
            yield node.lineno


def faults_of(source: str) -> list[str]:
    """What a module says about commands that only the table, the lexer and the machine's state may say."""
    tree = ast.parse(source)
    faults = [f"{line}: handles G20" for line in handled_inches(tree)]
    for line, texts in together(tree):
        codes = {one.upper() for one in texts} - BUTTONS
        faults += [
            f"{line}: lists {name} commands" for name, known in CLASSES.items() if len(codes & known) > 1
        ]
    for node in ast.walk(tree):
        if (
            isinstance(node, ast.Call)
            and isinstance(node.func, ast.Attribute)
            and node.func.attr == "compile"
        ):
            faults += [
                f"{node.lineno}: takes a command apart"
                for one in node.args
                if PATTERN_OF_CODE.search(text_of(one))
            ]
        if (
            isinstance(node, ast.Call)
            and isinstance(node.func, ast.Attribute)
            and node.func.attr == "startswith"
        ):
            prefixes = [
                two for one in node.args for two in (one.elts if isinstance(one, ast.Tuple) else [one])
            ]
            faults += [
                f"{node.lineno}: looks for a command by its first letters"
                for one in prefixes
                if re.fullmatch(r"[GM]\d+ ?", text_of(one))
            ]
    return faults


MODULES = [path for path in sorted(ROOT.rglob("*.py")) if not str(path.relative_to(ROOT)).startswith(ALLOWED)]


def test_only_the_table_the_lexer_and_the_state_know_what_commands_do() -> None:
    faults = {
        str(path.relative_to(ROOT)): found
        for path in MODULES
        if (found := faults_of(path.read_text("utf-8")))
    }

    assert not faults


@pytest.mark.parametrize(
    "planted",
    [
        'WAITS = frozenset({b"M109", b"M190"})',
        'WAITS = frozenset("G4 M400 M600".split())',
        'WAITS = ("G28", "M400")',
        'OWN = {b"M109": 1800.0, b"M190": 1800.0}',
        'HEATS = {"M104": "nozzle", "M140": "bed"}',
        'waits = word == b"M109" or word == b"M190"',
        'MODES = frozenset(["G90", "G91"])',
        'unit = 25.4 if word == b"G20" else 1.0',
        'inches = "G20" in codes',
        'inches = command.startswith(b"G20")',
        'ACTIONS = {"G20": set_inches}',
        'CODE = re.compile(rb"([GMT])\\s*(\\d+)")',
        'HEATING = re.compile(r"(M104|M109)\\b")',
        'sets = command.startswith(b"M110")',
    ],
)
def test_a_second_model_is_found(planted: str) -> None:
    assert faults_of(planted)


@pytest.mark.parametrize(
    "fine",
    [
        'script = [b"G91", b"G1 Z5 F300", b"G90"]',
        'script = [b"G20"] if inches else []',
        'line = "M83" if relative else "M82"',
        'asked = word == b"M400"',
    ],
)
def test_lines_to_be_sent_are_no_second_model(fine: str) -> None:
    assert not faults_of(fine)
