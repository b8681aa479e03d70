"""Damaged and hostile files: they are imported, or there is a clear error."""

from __future__ import annotations

import json
import re
import tomllib
import zipfile
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from printer_slicer.cli import main
from printer_slicer.errors import ProfileError
from printer_slicer.importing import ImportedProfile, RejectedProfile, format_profile, import_profiles
from printer_slicer.macros import read_template
from printer_slicer.macros.functions import MisusedFunction, matches
from printer_slicer.profile.faults import find_value_fault
from tests.importing.files import FLAT, ini
from tests.importing.test_bundle import BUNDLE
from tests.importing.test_cura import EXPRESSIONS, LITERALS
from tests.importing.test_orca import COMMON, FILAMENT, MACHINE, PROCESS

STRANGE = [
    "nan",
    "inf",
    "-1e400",
    "1e308",
    "",
    ";",
    '"',
    "\\",
    "{",
    "[",
    "%",
    "0x0",
    "-",
    "\x00",
    "é\u2028",
    "9" * 400,
    "{if",
    "=",
    ",",
]
CURA = {key: {"type": "x", "default_value": value} for key, value in LITERALS.items()} | {
    key: {"type": "float", "default_value": 33, "value": text} for key, text in EXPRESSIONS.items()
}
GCODE = "G28\n; prusaslicer_config = begin\n" + "".join(f"; {key} = {value}\n" for key, value in FLAT.items())
SEEDS: dict[str, str] = {
    "flat.ini": ini(FLAT),
    "bundle.ini": BUNDLE,
    "part.gcode": GCODE,
    "machine.json": json.dumps(COMMON | MACHINE | {"inherits": ""}),
    "filament.json": json.dumps(FILAMENT),
    "process.json": json.dumps(PROCESS),
    "one.def.json": json.dumps({"version": 2, "name": "One", "settings": {"all": {"children": CURA}}}),
    "project.json": json.dumps({**COMMON, **MACHINE, **FILAMENT, **PROCESS, "inherits": "", "type": ""}),
}


def damaged(text: str, chance: np.random.Generator) -> str:
    """Return the text with some values, characters or lines replaced."""
    for _ in range(chance.integers(1, 7)):
        what = chance.integers(4)
        place = int(chance.integers(len(text) + 1))
        strange = STRANGE[chance.integers(len(STRANGE))]
        if what == 0:
            text = text[:place] + strange + text[place + int(chance.integers(5)) :]
        elif what == 1:
            lines = text.split("\n")
            at = int(chance.integers(len(lines)))
            key, sign, _ = lines[at].partition("=" if chance.integers(2) else ": ")
            lines[at] = key + sign + strange
            text = "\n".join(lines)
        elif what == 2:
            text = text[:place] + chr(int(chance.integers(1, 0x2FF))) + text[place:]
        else:
            text = text[: int(chance.integers(place, len(text) + 1))]
    return text


def check(path: Path) -> int:
    """Import a file and return the number of profiles; errors must have a place and a remedy."""
    try:
        results = import_profiles(path)
    except ProfileError as error:
        told = str(path.parent) in str(error) and bool(error.remedy)
        assert told, error  # noqa: PT017 - most damaged files are refused, some are not
        return 0
    for one in results:
        if isinstance(one, RejectedProfile):
            assert one.problem
            assert one.remedy
            continue
        assert isinstance(one, ImportedProfile)
        assert find_value_fault(one.kind, tomllib.loads(format_profile(one))) is None
        for name, value in one.values.items():
            if name.endswith("_gcode"):
                readable(one, name, value)
    return len(results)


def readable(made: ImportedProfile, name: str, text: str) -> None:
    """Check that a macro can be read, or that the import has reported why not."""
    try:
        read_template(text, name).list_possible_lines({})
    except ProfileError as error:
        why = str(error.args[0]).removeprefix(f"{name}: ").splitlines()[0].partition(": ")[2]
        assert any(why in note.text for note in made.notes), why


@pytest.mark.parametrize("name", SEEDS)
def test_damaged_files_import_or_are_refused(name: str, tmp_path: Path) -> None:
    chance = np.random.default_rng(7)
    path = tmp_path / name
    path.write_text(SEEDS[name], encoding="utf-8")
    whole = check(path)
    came = 0
    for _ in range(60):
        path.write_text(damaged(SEEDS[name], chance), encoding="utf-8", errors="replace")
        came += check(path)

    assert whole > 0
    assert came > 0


def nested(folder: Path) -> Path:
    path = folder / "deep.json"
    path.write_text("[" * 100_000, encoding="utf-8")
    return path


def a_bomb(folder: Path) -> Path:
    path = folder / "bomb.3mf"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("Metadata/Slic3r_PE.config", b"a = 1\n" * 5_000_000)
    return path


def a_ladder(folder: Path) -> Path:
    """Presets that each inherit twice from the next: 2**40 steps without caching."""
    path = folder / "ladder.ini"
    steps = [f"[print:p{n}]\ninherits = p{n - 1}; p{n - 1}\nlayer_height = 0.2\n" for n in range(1, 40)]
    path.write_text("[print:p0]\nlayer_height = 0.2\n" + "".join(steps), encoding="utf-8")
    return path


PATTERNS = (
    ".*a" * 30,
    "(a|a)*b",
    "(a|aa)+$",
    "(.*){1,30}b",
    "((a?){9}){9}" + "a" * 90 + "c",
    "(a|a)*" * 500,
    "(a{99}){99}b",
    "(a",
    "\\1",
    "(?=a)a*",
)


@pytest.mark.parametrize("pattern", PATTERNS)
def test_no_pattern_takes_for_ever(pattern: str, tmp_path: Path) -> None:
    path = tmp_path / "slow.ini"
    path.write_text(
        f"[printer:P]\nprinter_notes = {'a' * 50_000}\nprinter_settings_id = P\nbed_shape = 0x0,200x0,200x200,0x200\n"
        f"[print:Q]\nlayer_height = 0.2\ncompatible_printers_condition = printer_notes=~/{pattern}/\n",
        encoding="utf-8",
    )
    check(path)
    with suppress(MisusedFunction):
        assert matches("a" * 50_000, pattern) is (pattern in (".*a" * 30, "(a|aa)+$", "(a|a)*" * 500))


@given(
    st.text("ab.", max_size=8),
    st.recursive(
        st.sampled_from(["a", "b", ".", "[ab]", "[^a]", "\\.", "\\w", ""]),
        lambda inner: st.one_of(
            st.tuples(inner, inner).map("".join),
            st.tuples(inner, inner).map(lambda two: f"({two[0]}|{two[1]})"),
            st.tuples(inner, st.sampled_from(["*", "+", "?", "{0,2}"])).map(
                lambda two: f"({two[0]}){two[1]}"
            ),
        ),
        max_leaves=6,
    ),
)
def test_patterns_mean_what_they_mean_elsewhere(text: str, pattern: str) -> None:
    assert matches(text, pattern) == bool(re.fullmatch(pattern, text, re.DOTALL))


def deep_blocks(folder: Path) -> Path:
    path = folder / "blocks.ini"
    path.write_text(
        ini(FLAT | {"start_gcode": "{if true}" * 3000 + "G28" + "{endif}" * 3000}), encoding="utf-8"
    )
    return path


LONG = 200_000
BRANCH = "{if layer_z>1}"
TEXTS_MADE_TO_DELAY: dict[str, dict[str, str]] = {
    "a number, blanks and no remark": {"layer_height": "0.2" + " " * LONG + "x"},
    "a name with many blanks": {"filament_settings_id": "a" + " " * LONG + "b"},
    "something far behind a quoted name": {"print_settings_id": '"a"' + " " * LONG + "b"},
    "braces that nothing closes": {"start_gcode": "{\\n" * (LONG // 8)},
    "braces that close in quotes only": {"start_gcode": "{\\n" * (LONG // 8) + '\\"}'},
    "brackets that nothing closes": {"start_gcode": "[a" * LONG},
    "a sum of very many": {"layer_gcode": "{" + "+".join(["layer_z"] * 900) + "}"},
    "a condition of very many": {
        "layer_gcode": "{if " + " and ".join(["layer_z>1"] * 600) + "}M117 a{endif}"
    },
    "remainders of remainders": {"layer_gcode": "{layer_num" + "%7" * 60 + "}"},
    "choices in choices": {"layer_gcode": "{" + "(layer_num>1?" * 30 + "1" + ":2)" * 30 + "}"},
    "many commands in a line": {"start_gcode": "M104 " * (LONG // 5)},
    "many blanks behind an expression": {"start_gcode": "{" + "a " * 1000 + " " * 2_000_000 + "}"},
}


@pytest.mark.parametrize("what", TEXTS_MADE_TO_DELAY)
def test_no_text_takes_far_longer_than_its_length(what: str, tmp_path: Path) -> None:
    path = tmp_path / "slow.ini"
    path.write_text(ini(FLAT | TEXTS_MADE_TO_DELAY[what]), encoding="utf-8")

    assert check(path) >= 1
    assert main(["profiles", "import", str(path), "--dry-run", "--quiet"]) in (0, 2)
