"""The rules of G-code stand in one place: no second lexer, list of waiting commands, or handling of inches.

Outside of the simulated printer, which is an independent firmware on purpose, and of the vectorised reader, its fast
twin. What may hold several such commands is a list of lines to be sent.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator

import pytest

from printer_slicer.gcode.commands import TABLE, Effect
from tests.sources import PACKAGE, SOURCES, trees

ALLOWED = (
    "sim/",
    "cli/inputs.py",  # tells G-code from other files by its first bytes
    "inspection/dry_run/command_runs.py",  # executes many commands at once, for the simulated printer
    "gcode/commands.py",
    "gcode/lexer.py",
    "gcode/state.py",
    "gcode/move_actions.py",
    "motion/positioning_mode.py",
)
CLASSES = {
    "waiting": {code.decode() for code, row in TABLE.items() if row.effect & Effect.WAITS},
    "heating": {code.decode() for code, row in TABLE.items() if row.heater},
    "modes": {code.decode() for code, row in TABLE.items() if row.effect & (Effect.MODE | Effect.UNITS)},
}
BUTTONS = {"M0", "M1"}  # the lint's row for them is one rule, not a class
CODES = re.compile(r"@?[A-Z_]+\d*")
PATTERN_OF_CODE = re.compile(
    r"\[(?=[^]]*G)(?=[^]]*M)[A-Z]{2,10}\]"
    r"|\((?:\?:|\?P<\w+>)?(?:[GMT]\d*\|)+[GMT]\d*\)"
    r"|\b[GMT]\d+(?:\|[GMT]\d+)+"
)
"""A class of first letters, their alternatives, or those of codes, in the capitals of a regular expression."""

WRITES_INCHES = {
    "printing/objects.py": "goes back to the units of the file behind an object that is left out",
    "printing/parking.py": "goes back to the units of the file after a pause",
    "printing/recovery.py": "says what was set in inches once more in inches",
}
"""Modules that send G20, which they may not look for."""


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


def chosen(tree: ast.AST) -> Iterator[tuple[int, list[str]]]:
    """Texts between which a match statement, or the comparisons of a function or a chain of ifs choose."""
    for node in ast.walk(tree):
        match node:
            case ast.Match():
                patterns = [one for case in node.cases for one in ast.walk(case.pattern)]
                yield node.lineno, [text_of(one.value) for one in patterns if isinstance(one, ast.MatchValue)]
            case ast.FunctionDef() | ast.AsyncFunctionDef() | ast.Lambda() | ast.If() | ast.IfExp():
                compared = [one for one in ast.walk(node) if isinstance(one, ast.Compare)]
                yield (
                    node.lineno,
                    [text_of(two) for one in compared for two in (one.left, *one.comparators)],
                )


def scripts(tree: ast.AST) -> Iterator[tuple[int, list[str]]]:
    """Lists of texts: those of other commands than waiting ones may be lines to be sent."""
    for node in ast.walk(tree):
        if isinstance(node, ast.List):
            yield node.lineno, [text_of(one) for one in node.elts]


def named_inches(tree: ast.AST) -> Iterator[int]:
    """Where G20 stands in a text that is no sentence, or in a regular expression."""
    for node in ast.walk(tree):
        texts: list[str] = []
        if isinstance(node, ast.Constant) and not re.search(r"\s", text_of(node).strip()):
            texts = [text_of(node)]
        elif isinstance(node, ast.Call) and ast.unparse(node.func).startswith("re."):
            texts = [text_of(one) for one in node.args]
        if any(re.search(r"G20(?!\d)", one.upper()) for one in texts):
            yield node.lineno


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


ANY_CODE = re.compile(
    "|".join([r"[GM]\d", PATTERN_OF_CODE.pattern, *map(re.escape, set().union(*CLASSES.values()))])
)
"""What stands in some text of every module that has a fault."""


def faults_of(source: str, *, writes_inches: bool = False) -> list[str]:
    """The faults of a source text."""
    return faults_in(ast.parse(source), writes_inches=writes_inches)


def faults_in(tree: ast.AST, *, writes_inches: bool = False) -> list[str]:
    """What a module says about commands that only the table, the lexer and the machine's state may say."""
    if not any(ANY_CODE.search(text_of(node).upper()) for node in ast.walk(tree)):
        return []
    faults = [f"{line}: handles G20" for line in handled_inches(tree)]
    faults += [] if writes_inches else [f"{line}: names G20" for line in named_inches(tree)]
    for line, texts in scripts(tree):
        if len(({one.strip().upper() for one in texts} - BUTTONS) & CLASSES["waiting"]) > 1:
            faults.append(f"{line}: lists waiting commands")
    for line, texts in (*together(tree), *chosen(tree)):
        codes = {one.upper() for one in texts} - BUTTONS
        faults += [
            f"{line}: lists {name} commands" for name, known in CLASSES.items() if len(codes & known) > 1
        ]
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and PATTERN_OF_CODE.search(text_of(node).upper()):
            faults.append(f"{node.lineno}: takes a command apart")
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


MODULES = [path for path in SOURCES if not str(path.relative_to(PACKAGE)).startswith(ALLOWED)]


def test_only_the_table_the_lexer_and_the_state_know_what_commands_do() -> None:
    faults = {
        name: found
        for name, path in ((path.relative_to(PACKAGE).as_posix(), path) for path in MODULES)
        if (found := faults_in(trees()[path], writes_inches=name in WRITES_INCHES))
    }

    assert not faults


@pytest.mark.parametrize("name", WRITES_INCHES)
def test_every_exemption_is_needed(name: str) -> None:
    assert faults_in(trees()[PACKAGE / name])


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
        'waits = word in [b"M109", b"M190"]',
        'WAITS = ["M109", "M190", "G4"]',
        'match word:\n    case "M109" | "M190":\n        wait()',
        'match word:\n    case "M109":\n        wait()\n    case "M190":\n        wait()',
        'if word == b"M109":\n    nozzle()\nelif word == b"M190":\n    bed()',
        'def waits(word):\n    if word == b"M109":\n        return 1\n    return 2 if word == b"M400" else 0',
        'inches = word in [b"G20"]',
        'inches = re.search(rb"\\bG20\\b", line)',
        'INCHES = b"G20"',
        'code = re.match(rb"([GMT])(\\d+)", line)',
        'CODE = re.compile(r"^(G|M|T)(\\d+)")',
        'CODE = r"(?P<letter>[gmt])(?P<number>\\d+)"',
        'heats = re.search("M104|M109", line)',
    ],
)
def test_a_second_model_is_found(planted: str) -> None:
    assert faults_of(planted)


@pytest.mark.parametrize(
    "fine",
    [
        'script = [b"G91", b"G1 Z5 F300", b"G90"]',
        'raise Fault("the file counts in inches (G20): is it in mm?")',
        'line = "M83" if relative else "M82"',
        'asked = word == b"M400"',
    ],
)
def test_lines_to_be_sent_are_no_second_model(fine: str) -> None:
    assert not faults_of(fine)


def test_who_sends_inches_may_not_look_for_them() -> None:
    assert not faults_of('script = [b"G20"] if inches else []', writes_inches=True)
    assert faults_of('inches = word in (b"G20",)', writes_inches=True)
