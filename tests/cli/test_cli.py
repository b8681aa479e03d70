"""The contract of the command line: commands, flags, exit codes, and what goes to stdout and stderr."""

from __future__ import annotations

import argparse
import json
import os
import re
import shlex
import sys
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest
from command_line import BOX, MACHINE, NO_BUFFER, PARTS, QUICK, USUAL, is_message, process, started, typed

from printer_slicer.cli.help import SHORT_LINES, HelpFormatter, is_advanced
from printer_slicer.cli.parser import build_parser
from printer_slicer.profile import DEFAULT_NAMES, find_profile_paths, list_settings, load_profile
from printer_slicer.profile.tables import list_setting_definitions
from tests.waiting import LAST_RESORT

COMMANDS = ("slice", "plan", "contours", "dry-run", "print", "sim", "ports", "profiles")
MODEL_COMMANDS = (["slice"], ["plan"], ["dry-run"], ["print", "--port", "sim:"])


def document(text: str) -> Any:
    """The one JSON document that is all of the text; numbers that JSON does not know are refused."""

    def refuse(word: str) -> None:
        raise AssertionError(f"{word} is no JSON")

    return json.loads(text, parse_constant=refuse)


def settings_of(gcode: Path) -> dict[str, str]:
    """The settings that a G-code file ends with."""
    lines = gcode.read_text(encoding="utf-8").partition("; settings\n")[2].splitlines()
    return dict(line.removeprefix("; ").split(" = ", 1) for line in lines)


# Help


@pytest.mark.parametrize("command", COMMANDS)
def test_the_help_of_every_command_shows_examples(command: str) -> None:
    outcome = typed(command, "--help")

    assert (outcome.code, outcome.err) == (0, "")
    assert f"usage: printer-slicer {command}" in outcome.out
    assert "examples:" in outcome.out
    assert f"  printer-slicer {command}" in outcome.out.partition("examples:")[2]


def test_the_help_of_the_program_names_all_commands_and_exit_codes() -> None:
    outcome = typed("--help")

    assert (outcome.code, outcome.err) == (0, "")
    assert all(re.search(rf"(?m)^    {command} ", outcome.out) for command in COMMANDS)
    assert all(
        re.search(rf"\b{code} \w+", outcome.out.partition("exit codes:")[2]) for code in (0, 2, 3, 4, 5, 6, 7)
    )


@pytest.mark.parametrize("columns", [None, "", "wide", "0", "-3", "60", "200"])
def test_the_help_is_as_wide_as_argparse_makes_it(
    columns: str | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    if columns is None:
        monkeypatch.delenv("COLUMNS", raising=False)
    else:
        monkeypatch.setenv("COLUMNS", columns)

    assert HelpFormatter("x")._width == argparse.HelpFormatter("x")._width


def parsers() -> Iterator[tuple[str, argparse.ArgumentParser]]:
    """Name and parser of every command."""
    for action in build_parser()._actions:
        for name, parser in (action.choices or {}).items() if isinstance(action.choices, dict) else ():
            yield name, parser
            yield from ((f"{name} {word}", below) for word, below in parser.below.items())


@pytest.mark.parametrize("command", ["", *(name for name, _ in parsers())])
def test_the_short_help_fits_a_screen_and_names_the_complete_one(
    command: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    short, complete = typed(*command.split(), "--help").out, typed(*command.split(), "--help-all").out

    assert short.count("\n") <= SHORT_LINES
    assert short == complete or short.endswith(
        f"All options: printer-slicer {command}".rstrip() + " --help-all\n"
    )


@pytest.mark.parametrize(("command", "parser"), list(parsers()))
def test_the_complete_help_has_every_option_and_the_short_one_the_everyday_ones(
    command: str, parser: argparse.ArgumentParser
) -> None:
    short, complete = typed(*command.split(), "--help").out, typed(*command.split(), "--help-all").out
    for action in parser._actions:
        for flag in action.option_strings:
            assert re.search(rf"{flag}\b", complete)
            assert is_advanced(action) or re.search(rf"{flag}\b", short), flag
    if short != complete:
        assert not any(
            re.search(rf"(?m)^  {flag}\b", short) for flag in ("--planner", "--heights", "--verbose")
        )


def test_the_settings_of_a_print_come_first_and_the_planner_last() -> None:
    everyday = re.findall(r"(?m)^  (--\S+)", typed("slice", "--help").out)
    titles = re.findall(r"(?m)^(\w[\w ]+):$", typed("slice", "--help-all").out)

    assert everyday[:4] == ["--printer", "--material", "--quality", "--layer-height"]
    assert titles[-2:] == ["layer planner", "examples"]


def examples() -> Iterator[str]:
    """Every command line that the help shows."""
    for arguments in ([], *([command] for command in COMMANDS)):
        for line in typed(*arguments, "--help-all").out.partition("examples:")[2].splitlines():
            if line.startswith("  printer-slicer "):
                yield re.split(r"  +|&", line.strip())[0]


@pytest.mark.parametrize("example", sorted(set(examples())))
def test_the_examples_of_the_help_can_be_typed(example: str) -> None:
    parsed = build_parser().parse_args(shlex.split(example)[1:])

    assert callable(parsed.run)
    for kind in ("printer", "material", "quality"):
        name = getattr(parsed, kind, None)
        assert name is None or name in find_profile_paths(kind)


@pytest.mark.parametrize(
    ("command", "flags"),
    [
        ("slice", "-o --output --printer --material --quality --planner --set --json -q -v"),
        ("plan", "--picture --printer --material --quality --planner --set --json -q -v"),
        ("dry-run", "--printer --material --quality --planner --set --json -q -v"),
        ("print", "--port --baud --printer --material --quality --planner --set --json -q -v"),
        ("sim", "--pty --speed --report --printer --set --json -q -v"),
        ("ports", "--json -q -v"),
        ("profiles", "--json -q -v"),
    ],
)
def test_scripts_can_rely_on_the_flags(command: str, flags: str) -> None:
    words = re.findall(r"(?<![\w-])--?[a-z][a-z-]*", typed(command, "--help-all").out)

    assert set(flags.split()) - set(words) == set()


@pytest.mark.parametrize(
    "arguments", [[], ["melt"], ["slice"], ["print", "x.stl"], ["slice", "x.stl", "--colour"]]
)
def test_a_command_that_cannot_be_read_is_a_usage_error(arguments: list[str]) -> None:
    outcome = typed(*arguments)

    assert (outcome.code, outcome.out) == (2, "")
    assert is_message(outcome, "usage: printer-slicer", "see printer-slicer", "--help")


def test_the_version_is_said() -> None:
    outcome = typed("--version")

    assert (outcome.code, outcome.err) == (0, "")
    assert re.fullmatch(r"printer-slicer \d+\.\d+\.\d+\S*\ncompiled kernel: (yes|no \(.+\))\n", outcome.out)


def test_the_program_can_be_called_as_a_module(tmp_path: Path) -> None:
    outcome = process("--help", cwd=tmp_path)

    assert (outcome.code, outcome.err) == (0, "")
    assert outcome.out.startswith("usage: printer-slicer ")


def test_a_refusal_of_the_module_ends_with_its_exit_code(tmp_path: Path) -> None:
    outcome = process("slice", "nowhere.stl", cwd=tmp_path)

    assert outcome.code == 2
    assert is_message(outcome, "nowhere.stl")


# slice


def test_slicing_writes_gcode_beside_the_model(tmp_path: Path) -> None:
    model = tmp_path / "part.stl"
    model.write_bytes(BOX.read_bytes())
    outcome = typed("slice", model, *QUICK)

    assert (outcome.code, outcome.err) == (0, "")
    assert str(tmp_path / "part.gcode") in outcome.out
    assert b"\nG28" in (tmp_path / "part.gcode").read_bytes()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["part.gcode", "part.stl"]


def test_slicing_writes_where_it_is_told(tmp_path: Path) -> None:
    outcome = typed("slice", BOX, "-o", "mine.gcode", *QUICK, cwd=tmp_path)

    assert outcome.code == 0
    assert [path.name for path in tmp_path.iterdir()] == ["mine.gcode"]


def test_slicing_twice_gives_the_same_bytes(tmp_path: Path) -> None:
    for name in ("one.gcode", "two.gcode"):
        assert typed("slice", BOX, "-o", tmp_path / name, *QUICK).code == 0

    assert (tmp_path / "one.gcode").read_bytes() == (tmp_path / "two.gcode").read_bytes()


def test_slicing_to_stdout_writes_the_gcode_and_nothing_else(tmp_path: Path) -> None:
    typed("slice", BOX, "-o", tmp_path / "box.gcode", *QUICK)
    outcome = typed("slice", BOX, "-o", "-", *QUICK)

    assert outcome.code == 0
    assert (
        outcome.err
        == "printer marlin_220 (--printer), material pla (--material), quality standard (--quality) "
        "with uniform layers of 0.3 mm\n"
    )
    assert outcome.out.encode() == (tmp_path / "box.gcode").read_bytes()


def test_slicing_to_stdout_and_asking_for_json_does_not_mix_the_two(tmp_path: Path) -> None:
    outcome = typed("slice", BOX, "-o", "-", "--json", *QUICK)

    if outcome.code == 0:
        document(outcome.out)
    else:
        assert outcome.code == 2
        assert is_message(outcome, "-o -", "--json")


def test_slicing_and_dry_run_say_what_their_times_and_lengths_contain(tmp_path: Path) -> None:
    sliced = typed("slice", BOX, "-o", tmp_path / "box.gcode", *QUICK).out
    run = typed("dry-run", tmp_path / "box.gcode").out

    assert re.search(
        r"Print time \w+ \w+; filament .* \(without start and end G-code, homing and heating\)", sliced
    )
    assert re.search(r"in total: \w+ \w+ of motion with start and end G-code, .* of heating", run)
    assert re.search(r"m, [\d.]+ g of PLA with priming", run)
    assert "in order; motion takes as long as estimated from these commands" in run


def test_slicing_tells_layers_time_and_filament_as_json(tmp_path: Path) -> None:
    outcome = typed("slice", BOX, "-o", tmp_path / "box.gcode", "--json", *QUICK)
    facts = document(outcome.out)

    assert (outcome.code, outcome.err) == (0, "")
    assert facts["output"] == str(tmp_path / "box.gcode")
    assert facts["layers"] == sum(count for count, _ in facts["heights"])
    assert facts["planner"] == "uniform"
    assert facts["seconds"] > 60
    assert facts["filament_mm"] > 100
    assert facts["open_edges"] == 0


def test_the_settings_of_the_flags_are_those_in_the_file(tmp_path: Path) -> None:
    changes = {"infill_density": "0.3", "speeds.travel": "111", "printer.name": "mine"}
    flags = [part for key, value in changes.items() for part in ("--set", f"{key}={value}")]
    names = ("--printer", "marlin_220_06", "--material", "petg", "--quality", "strong")
    assert typed("slice", BOX, "-o", tmp_path / "box.gcode", *names, "--planner", "area", *flags).code == 0
    wanted = load_profile("marlin_220_06", "petg", "strong", {**changes, "planner.kind": "area"})
    written = settings_of(tmp_path / "box.gcode")

    assert written == {key: str(value).replace("\n", "\\n") for key, value in list_settings(wanted)}
    assert written["quality.planner.kind"] == "area"


@pytest.mark.parametrize("order", [1, -1])
def test_a_planner_and_its_settings_can_be_given_in_any_order(order: int, tmp_path: Path) -> None:
    pairs = [("--set", "planner.kind=area"), ("--set", "planner.tolerance=0.5")][::order]
    outcome = typed(
        "slice", BOX, "-o", tmp_path / "b.gcode", *QUICK[:-2], *(flag for pair in pairs for flag in pair)
    )

    assert outcome.code == 0, outcome.err
    assert settings_of(tmp_path / "b.gcode")["quality.planner.tolerance"] == "0.5"


def test_a_layer_can_be_drawn_while_slicing(tmp_path: Path) -> None:
    picture = tmp_path / "layer.svg"
    outcome = typed("slice", BOX, "-o", tmp_path / "b.gcode", "--picture", picture, "--layer", "3", *QUICK)

    assert outcome.code == 0
    assert "layer 3 of" in picture.read_text(encoding="utf-8")
    assert f"{picture}: layer 3 of the print\n" in outcome.out


@pytest.mark.parametrize("number", [0, -1, 999])
def test_a_layer_that_is_not_there_is_refused_before_anything_is_written(number: int, tmp_path: Path) -> None:
    flags = ("--picture", tmp_path / "layer.svg", "--layer", number)
    outcome = typed("slice", BOX, "-o", tmp_path / "b.gcode", *flags, *QUICK)

    assert outcome.code == 2
    assert is_message(outcome, "--layer", number)
    assert list(tmp_path.iterdir()) == []


def test_a_layer_without_beads_can_be_drawn(tmp_path: Path) -> None:
    """The tip of a cone is narrower than a bead: its last layers stay empty."""
    facts = document(typed("slice", PARTS / "cone.stl", "-o", tmp_path / "c.gcode", "--json", *QUICK).out)
    flags = ("--picture", tmp_path / "tip.svg", "--layer", facts["layers"])
    outcome = typed("slice", PARTS / "cone.stl", "-o", tmp_path / "c.gcode", *flags, *QUICK)

    assert (outcome.code, outcome.err) == (0, "")
    assert (tmp_path / "tip.svg").is_file()


# plan


def test_plans_are_compared_in_one_table_above_the_certificate() -> None:
    outcome = typed("plan", BOX, *QUICK)
    table, _, certificate = outcome.out.partition("\n\n")

    assert (outcome.code, outcome.err) == (0, "")
    assert "Table" not in outcome.out
    assert re.findall(r"(?m)^  (uniform \S+ mm) +\d+ +\d.*mm .*mm³ ", table) == [
        "uniform 0.08 mm",
        "uniform 0.3 mm",
        "uniform 0.32 mm",
    ]
    assert certificate.startswith(
        "Certificate of the chosen plan (uniform 0.3 mm):\n  Surface deviation at most "
    )


def test_the_tables_of_the_paper_describe_the_part_and_its_plans() -> None:
    outcome = typed("plan", BOX, *QUICK, "--paper-tables")

    assert (outcome.code, outcome.err) == (0, "")
    assert re.search(r"Table 1.*\n.*vertices +36\n.*facets +12\n", outcome.out)
    assert re.search(r"volume +4000\.0 mm³", outcome.out)
    assert "Table 2" in outcome.out
    for height in (0.08, 0.3, 0.32):
        assert re.search(rf"(?m)^  uniform {height} mm +\d+ +\d", outcome.out)


def test_plans_as_json_hold_every_layer() -> None:
    flags = ("--printer", "marlin_220_06", "--quality", "case_study", "--json")
    outcome = typed("plan", PARTS / "case_study.stl", *flags)
    answer = document(outcome.out)
    rows = {row["plan"]: row for row in answer["plans"]}
    chosen = rows["area 0.1 to 0.4 mm"]

    assert (outcome.code, outcome.err) == (0, "")
    assert answer["part"]["size"] == [50, 50, 82.5]
    assert len(answer["layers"]["top"]) == chosen["layers"] == 375
    assert answer["layers"]["top"][-1] == 82.5
    assert chosen["layers_saved"] == pytest.approx(1 - 375 / 825, abs=1e-3)
    assert 0 < chosen["time_saved"] < 1


@pytest.mark.parametrize("name", [pytest.param("cone", marks=pytest.mark.thorough), "sheared_prism"])
def test_every_part_can_be_planned(name: str, tmp_path: Path) -> None:
    outcome = typed("plan", PARTS / f"{name}.stl", "--picture", tmp_path / "p.svg", "--json", *QUICK)

    assert (outcome.code, outcome.err) == (0, "")
    assert len(document(outcome.out)["plans"]) >= 2
    assert (tmp_path / "p.svg").read_text(encoding="utf-8").startswith("<svg ")


def test_a_picture_on_stdout_is_not_mixed_with_json(tmp_path: Path) -> None:
    outcome = typed("plan", BOX, "--picture", "-", "--json", *QUICK, cwd=tmp_path)

    if outcome.code == 0:
        document(outcome.out)
    else:
        assert outcome.code == 2
        assert is_message(outcome, "--picture -")


# dry-run


def test_a_rehearsal_says_that_what_was_executed_is_what_was_sent() -> None:
    outcome = typed("dry-run", BOX, *QUICK)

    assert (outcome.code, outcome.err) == (0, "")
    assert "in order" in outcome.out
    assert "NOT" not in outcome.out


def test_a_rehearsal_as_json_is_one_document() -> None:
    outcome = typed("dry-run", BOX, "--json", *QUICK)
    verdict = document(outcome.out)

    assert (outcome.code, outcome.err) == (0, "")
    assert verdict["ok"] is True
    assert verdict["executed_equals_sent"] is True
    assert verdict["heights_equal_plan"] is True
    assert verdict["executed"] == verdict["commands"]
    assert verdict["problems"] == []
    assert set(verdict["planned"]) <= set(verdict["heights"])


def test_a_rehearsal_of_a_file_that_fails_ends_with_7_and_still_gives_json(tmp_path: Path) -> None:
    (tmp_path / "cold.gcode").write_text("G28\nG1 X5 E5 F3000\n", encoding="utf-8")
    outcome = typed("dry-run", tmp_path / "cold.gcode", "--json", *MACHINE)

    assert outcome.code == 7
    assert document(outcome.out)["ok"] is False
    assert is_message(outcome, "cold.gcode")


def test_numbers_that_json_does_not_know_never_leave_the_program(tmp_path: Path) -> None:
    (tmp_path / "far.gcode").write_text("G28\nG1 X1e300 F3000\nG1 Xnan\n", encoding="utf-8")
    outcome = typed("dry-run", tmp_path / "far.gcode", "--json", *MACHINE)

    assert outcome.code in {0, 2, 7}
    if outcome.code != 2:
        document(outcome.out)
    if outcome.code:
        assert is_message(outcome, "far.gcode")


def test_a_sliced_file_rehearses_like_the_model(tmp_path: Path) -> None:
    typed("slice", BOX, "-o", tmp_path / "box.gcode", *QUICK)
    outcome = typed("dry-run", tmp_path / "box.gcode", "--json", *MACHINE)
    verdict = document(outcome.out)

    assert outcome.code == 0
    assert verdict["planned"] is None
    assert verdict["heights"] == document(typed("dry-run", BOX, "--json", *QUICK).out)["heights"]


def test_a_dry_run_reports_each_fault_once_with_its_severity(tmp_path: Path) -> None:
    path = tmp_path / "bad.gcode"
    path.write_text(
        "G28\nG90\nM83\nG1 Z0.2 F600\nG1 X500 F1800\nM303 E0\nFOO BAR\nM104 S0\n", encoding="utf-8"
    )
    run, checked = typed("dry-run", path, *MACHINE).out, typed("check", path, *MACHINE).out

    assert run.count("M303 E0") == 1
    assert run.count("FOO BAR") == 1
    assert re.search(r"(?m)^warning +line 7: FOO: unknown command", checked)
    assert all(re.search(r"(?m)^warning +line 4: G1 Z0.2 F600: z moves at", out) for out in (run, checked))
    assert not re.search(r"(?m)^note", run + checked)
    assert re.search(r"motion takes \d+(\.\d+)? % (less|more) time than estimated", run)
    assert "layers      none" in run


@pytest.mark.parametrize(("most", "result"), [(7, "no errors, only warnings"), (6, "do not print, 1 error")])
def test_a_dry_run_reports_a_high_flow_once(most: int, result: str, tmp_path: Path) -> None:
    typed("slice", BOX, "-o", tmp_path / "box.gcode", *QUICK)
    run = typed("dry-run", tmp_path / "box.gcode", *MACHINE, "--set", f"material.max_flow={most}").out

    assert f"box.gcode: {result}" in run
    assert run.count(": flow ") == 1


@pytest.mark.parametrize("command", ["plan", "dry-run"])
def test_a_result_names_its_picture(command: str, tmp_path: Path) -> None:
    outcome = typed(command, BOX, "--picture", "p.svg", *QUICK, cwd=tmp_path)

    assert re.fullmatch(r"picture +p\.svg: the .+", outcome.out.splitlines()[-1])
    assert typed(command, BOX, *QUICK, cwd=tmp_path).out + outcome.out.splitlines()[-1] + "\n" == outcome.out


def test_former_json_keys_of_slice_and_dry_run_still_work(tmp_path: Path) -> None:
    sliced = document(typed("slice", BOX, "-o", tmp_path / "b.gcode", "--json", *QUICK).out)
    verdict = document(typed("dry-run", BOX, "--json", *QUICK).out)
    names = {
        "lowest_extrusion_z": "begins_at",
        "unfilled_mm3": "lost_mm3",
        "brim_omitted": "brim_left_out",
        "skirt_omitted": "skirt_left_out",
        "skirt_loops_omitted": "skirt_loops_left_out",
        "skirt_missing_mm": "skirt_short_mm",
    }

    assert [sliced[name] for name in names] == [sliced[name] for name in names.values()]
    assert verdict["printer"]["halt_reason"] == verdict["printer"]["killed"] == ""
    assert verdict["material"]["volume_without_motion_mm3"] == verdict["material"]["volume_standing_mm3"]


# profiles and ports


def test_profiles_lists_every_profile_and_the_defaults() -> None:
    outcome = typed("profiles")

    assert (outcome.code, outcome.err) == (0, "")
    for kind, default in DEFAULT_NAMES.items():
        assert f"--{kind}\n" in outcome.out
        assert f"{default} (default)" in outcome.out
        assert all(re.search(rf"(?m)^  {name}\b", outcome.out) for name in find_profile_paths(kind))


def test_profiles_as_json_tells_where_the_files_are() -> None:
    listed = document(typed("profiles", "--json").out)

    assert listed == {
        kind: {name: str(path) for name, path in find_profile_paths(kind).items()} for kind in DEFAULT_NAMES
    }


def test_profiles_lists_every_setting() -> None:
    text = typed("profiles", "settings").out
    rows = document(typed("profiles", "settings", "--json").out)

    assert [row["key"] for row in rows] == [row[0] for row in list_setting_definitions()]
    assert all(set(row) == {"key", "type", "unit", "bounds", "default", "meaning", "own"} for row in rows)
    assert all(row["key"] in text and row["meaning"] in text for row in rows)
    assert " 0-1 " not in text


@pytest.mark.parametrize(
    ("kind", "name"), [(kind, name) for kind in DEFAULT_NAMES for name in find_profile_paths(kind)]
)
def test_every_shipped_profile_can_be_shown(kind: str, name: str) -> None:
    text, answer = typed("profiles", kind, name), typed("profiles", kind, name, "--json")

    assert (text.code, text.err) == (0, "")
    assert (answer.code, answer.err) == (0, "")
    shown = document(answer.out)
    assert shown["name"]["value"]
    assert all(f"{key} = " in text.out for key in shown)
    assert all(told["from"] == "default" or ".toml:" in told["from"] for told in shown.values())


def test_showing_an_unknown_profile_lists_the_known_ones() -> None:
    outcome = typed("profiles", "printer", "nobody")

    assert outcome.code == 2
    assert is_message(outcome, "nobody", "`printer-slicer profiles` lists all")


def test_ports_are_listed() -> None:
    assert isinstance(document(typed("ports", "--json").out), list)
    assert typed("ports").code == 0


# quiet, progress, pipes


@pytest.mark.parametrize("command", [*MODEL_COMMANDS, ["ports"], ["profiles"]], ids=lambda words: words[0])
def test_quiet_says_nothing_on_success(command: list[str], tmp_path: Path) -> None:
    model = [BOX, *QUICK] if command in MODEL_COMMANDS else []
    target = ["-o", tmp_path / "b.gcode"] if command == ["slice"] else []

    assert typed(command[0], *model, *command[1:], *target, "-q") == (0, "", "")


@pytest.mark.parametrize("command", MODEL_COMMANDS, ids=lambda words: words[0])
def test_quiet_still_says_what_is_wrong(command: list[str], tmp_path: Path) -> None:
    outcome = typed(command[0], tmp_path / "nowhere.stl", *command[1:], "-q")

    assert (outcome.code, outcome.out) == (2, "")
    assert is_message(outcome, "nowhere.stl")


@pytest.mark.thorough  # what each says to stderr is looked at above, too
@pytest.mark.parametrize("command", MODEL_COMMANDS, ids=lambda words: words[0])
def test_there_is_no_progress_when_stderr_is_no_terminal(command: list[str], tmp_path: Path) -> None:
    target = ["-o", tmp_path / "v.gcode"] if command == ["slice"] else []
    outcome = typed(command[0], BOX, *command[1:], *target, *QUICK)

    assert (outcome.code, outcome.err) == (0, "")
    assert "\r" not in outcome.out
    assert "\x1b" not in outcome.out


@pytest.mark.parametrize("command", [["slice"], ["dry-run"]], ids=lambda words: words[0])
def test_verbose_says_more_on_stderr_and_the_same_on_stdout(command: list[str], tmp_path: Path) -> None:
    words = [
        command[0],
        BOX,
        *command[1:],
        *QUICK,
        *(["-o", tmp_path / "v.gcode"] if command == ["slice"] else []),
    ]
    usual, more = typed(*words), typed(*words, "-v")

    assert (more.code, more.out) == (usual.code, usual.out) == (0, usual.out)
    assert more.err
    assert "\x1b" not in more.err


WRITING = [
    pytest.param(["profiles", "settings"], USUAL, id="text"),
    pytest.param(["profiles", "settings", "--json"], NO_BUFFER, id="json"),
    pytest.param(["slice", BOX, "-o", "-", "--quiet", *QUICK], USUAL, id="gcode"),
    pytest.param(["--version"], USUAL, id="version"),
    pytest.param(["--help"], USUAL, id="help"),
    pytest.param(["slice", "--help"], NO_BUFFER, id="help of a command"),
]
"""Commands that write much and little, with buffers and without."""


@pytest.mark.parametrize(("command", "env"), WRITING)
def test_a_reader_that_goes_away_is_no_failure(
    command: list[object], env: dict[str, str], tmp_path: Path
) -> None:
    reader, writer = os.pipe()
    os.close(reader)
    try:
        outcome = process(*command, cwd=tmp_path, stdout=writer, env=env)
    finally:
        os.close(writer)

    assert (outcome.code, outcome.err) == (0, "")


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="this system has no /dev/full")
@pytest.mark.parametrize(("command", "env"), WRITING)
def test_a_stdout_that_takes_nothing_is_a_failure_with_a_message(
    command: list[object], env: dict[str, str], tmp_path: Path
) -> None:
    with Path("/dev/full").open("wb") as full:
        outcome = process(*command, cwd=tmp_path, stdout=full.fileno(), env=env)

    assert outcome.code == 2
    assert is_message(outcome, "No space left")


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="this system has no /dev/full")
def test_a_print_whose_log_fills_the_disk_goes_on_to_its_verdict(tmp_path: Path) -> None:
    """The exit code is that of the print, which is only known at its end."""
    cold = tmp_path / "cold.gcode"
    cold.write_text("G28\nG1 X20 Y20 Z0.2 F1200\nG1 X40 E1\n", encoding="utf-8")
    for log in (Path("/dev/full"), tmp_path / "log"):
        with log.open("wb") as full:
            outcome = process(
                "print",
                cold,
                "--port",
                "sim:",
                "--allow",
                "cold",
                cwd=tmp_path,
                stdout=full.fileno(),
                env=NO_BUFFER,
            )
        assert outcome.code == 7, outcome.err
        assert ("No space left" in outcome.err) == (log.name == "full")


def test_progress_is_shown_on_a_terminal_and_wiped_away(tmp_path: Path) -> None:
    """A print that lasts longer than people wait without a bar ends with a clean line: its printer dwells a while."""
    import pty

    from benchmarks.killing import served

    moves = "".join(f"G1 X{10 + place} F6000\n" for place in range(100))
    (tmp_path / "job.gcode").write_text(f"G28\nG4 S40\n{moves}", encoding="utf-8")
    master, slave = pty.openpty()
    # A slow machine says more than a terminal holds before somebody reads it.
    with ThreadPoolExecutor(1) as reader, served(tmp_path / "port", 20.0):
        shown_later = reader.submit(read_all, master)
        with started("print", "job.gcode", "--port", "port", cwd=tmp_path, stderr=slave) as running:
            os.close(slave)
            out, _ = running.communicate(timeout=LAST_RESORT)
        shown = shown_later.result()

    assert running.returncode == 0
    assert b"done:" in out
    assert b"\r" not in out
    assert b"%" in shown
    assert shown.endswith((b"\x1b[2K", b"\x1b[?25h")), shown[-80:]


def read_all(master: int) -> bytes:
    """All that is written to a pseudo-terminal until its other end is closed."""
    text = b""
    while True:
        try:
            piece = os.read(master, 65536)
        except OSError:
            piece = b""
        if not piece:
            os.close(master)
            return text
        text += piece


def test_json_beats_the_terminal(tmp_path: Path) -> None:
    import pty

    master, slave = pty.openpty()
    with started("dry-run", BOX, "--json", *QUICK, cwd=tmp_path, stderr=slave) as running:
        out, _ = running.communicate(timeout=LAST_RESORT)
    os.close(slave)

    assert document(out.decode())["ok"] is True
    assert read_all(master) == b""


@pytest.mark.parametrize(
    "command", [["profiles", "settings"], ["profiles", "settings", "--json"], ["--help"]]
)
def test_a_terminal_without_degrees_and_cubes_is_served_too(command: list[str], tmp_path: Path) -> None:
    outcome = process(*command, cwd=tmp_path, env={"PYTHONIOENCODING": "ascii"})

    assert (outcome.code, outcome.err) == (0, "")
    assert outcome.out.isascii()


@pytest.mark.skipif(sys.platform in {"win32", "darwin"}, reason="names are always Unicode there")
@pytest.mark.parametrize("flag", ["--strict", "--json"], ids=["text", "json"])
def test_a_file_whose_name_is_no_text_is_sliced(flag: str, tmp_path: Path) -> None:
    name = os.fsdecode(b"\xff.stl")
    (tmp_path / name).write_bytes(BOX.read_bytes())
    outcome = process("slice", name, flag, *QUICK, cwd=tmp_path, env={"PYTHONIOENCODING": "utf-8:strict"})

    assert (outcome.code, outcome.err) == (0, "")
    assert (tmp_path / os.fsdecode(b"\xff.gcode")).is_file()
