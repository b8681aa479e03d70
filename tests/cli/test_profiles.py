"""`profiles`: what each of its commands says and writes, and flags that are short names of settings."""

from __future__ import annotations

import json
import re
import tomllib
from pathlib import Path
from typing import Any

import pytest
from command_line import BOX, QUICK, Outcome, is_message, typed

from printer_slicer.cli.setting_options import SETTING_OPTIONS
from printer_slicer.gcode.macro_faults import find_macro_faults
from printer_slicer.profile import KINDS, find_profile_paths, load_profile
from printer_slicer.profile.folders import VARIABLE, find_shipped_profiles
from printer_slicer.profile.tables import list_setting_definitions


@pytest.fixture
def own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder of a person."""
    monkeypatch.setenv(VARIABLE, str(tmp_path / "own"))
    return tmp_path / "own"


def told(*arguments: object) -> Any:
    outcome = typed("profiles", *arguments, "--json")
    assert (outcome.code, outcome.err) == (0, "")
    return json.loads(outcome.out)


@pytest.mark.parametrize(
    ("words", "kind"),
    [
        (["printers"], "printer"),
        (["printer"], "printer"),
        (["materials"], "material"),
        (["qualities"], "quality"),
        (["list", "qualities"], "quality"),
    ],
)
def test_a_kind_alone_is_listed(words: list[str], kind: str) -> None:
    assert list(json.loads(typed("profiles", *words, "--json").out)) == [kind]


def failed(*arguments: object) -> Outcome:
    outcome = typed("profiles", *arguments)
    assert (outcome.code, outcome.out) == (2, "")
    return outcome


def test_list_of_one_kind_shows_only_that() -> None:
    outcome = typed("profiles", "list", "materials")

    assert "petg" in outcome.out
    assert "--printer" not in outcome.out
    assert is_message(failed("list", "colours"), "colour", "printer|material|quality")


def test_show_tells_where_values_come_from() -> None:
    shown = told("show", "voron_0_2")
    text = typed("profiles", "show", "voron_0_2").out

    assert shown["bed_x"] == {"value": 120, "from": f"{find_shipped_profiles()}/printers/voron_0_2.toml:8"}
    assert shown["flavour"]["from"].startswith(f"{find_shipped_profiles()}/printers/corexy_klipper.toml:")
    assert shown["probe"] == {"value": False, "from": "default"}
    assert re.search(
        rf"(?m)^bed_x = 120 +# {re.escape(str(find_shipped_profiles()))}/printers/voron_0_2.toml:8$", text
    )


def test_what_is_shown_without_places_is_toml() -> None:
    text = typed("profiles", "show", "voron_0_2").out
    values = tomllib.loads(text)

    assert values["start_gcode"] == load_profile("voron_0_2").printer.start_gcode
    assert values["probe"] is False


def test_show_of_a_print_tells_what_was_typed() -> None:
    shown = told("show", "--printer", "prusa_mini", "--quality", "fine", "--set", "perimeters=5")

    assert shown["quality.perimeters"] == {"value": 5, "from": "perimeters=5"}
    assert shown["printer.bed_x"]["value"] == 180
    assert shown["material.name"]["value"] == "PLA"


def test_diff_tells_both_values() -> None:
    assert told("diff", "standard", "strong")["perimeters"] == {"standard": 2, "strong": 4}
    assert "perimeters                          2 -> 4" in typed("profiles", "diff", "standard", "strong").out
    assert typed("profiles", "diff", "pla", "pla").out == "no differences\n"
    assert is_message(failed("diff", "pla", "fine"), "material", "quality", "same kind")
    assert is_message(failed("diff", "pla"), "two profiles must be named")


@pytest.mark.parametrize("kind", KINDS)
def test_a_new_profile_is_used_by_its_name_and_never_overwritten(own: Path, kind: str) -> None:
    parent = {"printer": "voron_0_2", "material": "petg", "quality": "fine"}[kind]
    first = typed("profiles", "new", kind, "mine", "--inherits", parent)
    path = own / {"printer": "printers", "material": "materials", "quality": "qualities"}[kind] / "mine.toml"
    text = path.read_text(encoding="utf-8")

    assert (first.code, first.err) == (0, "")
    assert str(path) in first.out
    assert told("path", "mine") == {"kind": kind, "path": str(path)}
    assert told("diff", parent, "mine") == {
        "name": {parent: told("show", parent)["name"]["value"], "mine": "mine"}
    }
    assert typed("profiles", "check", "mine").code == 0
    schema = (path.parent / text.splitlines()[0].removeprefix("#:schema ")).resolve()
    assert json.loads(schema.read_text(encoding="utf-8"))["title"].startswith(kind)

    assert is_message(failed("new", kind, "mine"), "already exists", "another name")
    assert path.read_text(encoding="utf-8") == text


def test_a_new_profile_inherits_from_the_file_that_a_name_means(own: Path) -> None:
    assert typed("profiles", "new", "printer", "mine", "--inherits", "Ender 3").code == 0

    assert 'inherits = "creality_ender3"\n' in (own / "printers" / "mine.toml").read_text(encoding="utf-8")
    assert typed("profiles", "check", "mine").code == 0


@pytest.mark.parametrize("word", ["v0.3 mini x", "Ender 2"])
def test_one_similar_profile_is_not_several(word: str) -> None:
    assert is_message(failed("path", "printer", word), "unknown printer")


def test_words_of_several_kinds_are_answered_with_the_kinds() -> None:
    assert is_message(failed("show", "p"), "several profiles match 'p'", "printer prusa_mini, material pa")


def test_a_new_profile_goes_where_it_is_told(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    outcome = typed("profiles", "new", "quality", "mine", "--inherits", "fine", "-o", path)
    directive = path.read_text(encoding="utf-8").splitlines()[0]

    assert outcome.code == 0
    assert directive == f"#:schema {(find_shipped_profiles() / 'schema' / 'quality.schema.json').as_uri()}"
    assert typed("profiles", "check", path).out == f"{path}: no errors\n"
    assert typed("profiles", "new", "quality", "mine", "-o", "-").out.startswith("#:schema ")


def test_new_without_a_folder_a_kind_or_a_name_says_what_it_needs(
    own: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert is_message(failed("new", "mine"), "the kind and the name of the profile are missing")
    assert is_message(failed("new", "printer", "../mine"), "not a valid name")
    monkeypatch.setenv(VARIABLE, "")
    assert is_message(failed("new", "printer", "mine"), "no folder for your own profiles", "-o FILE")
    assert not own.exists()


def test_check_tells_all_faults_of_all_files(tmp_path: Path) -> None:
    one, two = tmp_path / "one.toml", tmp_path / "two.toml"
    one.write_text('inherits = "standard"\nperimetres = 3\ninfill_density = 2\n')
    two.write_text('inherits = "pla"\ndensity = = 3\n')
    outcome = failed("check", one, two)

    assert f"{one}:2: quality.perimetres: no such setting\n  Did you mean 'perimeters'?" in outcome.err
    assert f"{one}:3: quality.infill_density: expected a number <= 1; got 2" in outcome.err
    assert f"{two}:2: not valid TOML" in outcome.err
    found = json.loads(typed("profiles", "check", one, "--json").out)
    assert len(found) == 2
    assert all(fault["remedy"] for fault in found)


def test_check_tells_whether_parts_suit_each_other(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text('inherits = "creality_ender3"\nmax_nozzle_temperature = 200\n')

    assert typed("profiles", "check", path).code == 0
    said = failed("check", path, "--material", "petg").err
    assert "material.nozzle_temperature" in said
    assert "allows (200" in said


def test_path_tells_the_folders(own: Path, tmp_path: Path) -> None:
    assert told("path", "--profiles", tmp_path) == {
        "named": [str(tmp_path)],
        "own": [str(own)],
        "shipped": [str(find_shipped_profiles())],
    }
    assert "does not exist yet" in typed("profiles", "path").out


def test_settings_with_a_word_are_those_that_tell_of_it() -> None:
    keys = [row["key"] for row in told("settings", "anchor")]

    assert "quality.infill_anchor" in keys
    assert len(keys) < 8
    for word in ("walls", "wall", "wall_loops", "Perimeters"):
        assert told("settings", word)[0]["key"] == "quality.perimeters"
    assert [row["key"] for row in told("settings", "fill_density")] == ["quality.infill_density"]
    assert is_message(failed("settings", "xyzzy"), "xyzzy", "shorter")


def test_schema_is_written_or_shown(tmp_path: Path) -> None:
    assert typed("profiles", "schema", "-o", tmp_path / "schemas").code == 0
    assert {path.name for path in (tmp_path / "schemas").iterdir()} == {
        f"{kind}.schema.json" for kind in KINDS
    }
    assert json.loads(typed("profiles", "schema", "printer").out)["properties"]["bed_x"]["minimum"] == 20
    assert is_message(failed("schema", "colour"), "colour")


def test_profiles_of_a_folder_are_used_by_other_commands(tmp_path: Path) -> None:
    folder = tmp_path / "shop"
    (folder / "qualities").mkdir(parents=True)
    (folder / "qualities" / "shop.toml").write_text(
        'inherits = "standard"\nname = "shop"\nlayer_height = 0.3\n'
    )
    outcome = typed("plan", BOX, "--profiles", folder, "--quality", "shop", "--json")

    assert outcome.code == 0
    assert is_message(typed("plan", BOX, "--quality", "shop"), "shop", "Known: adaptive")


@pytest.mark.parametrize(
    ("words", "problem", "remedy"),
    [
        (["show", "a", "b", "c"], "profiles show: one profile must be named", 'profiles show "a b c"'),
        (["show", "standart"], "unknown profile 'standart'", "Did you mean 'standard'?"),
        (["diff", "standard"], "profiles diff: two profiles must be named", "profiles diff standard fine"),
        (
            ["diff", "standard", "pla"],
            "standard is a quality profile, but pla is a material profile",
            "Compare two profiles of the same kind",
        ),
        (["check"], "profiles check: no file is named", "profiles check my_printer.toml"),
        (["settings", "zebra"], "profiles settings zebra: no setting matches", "Try a shorter word"),
        (["schema", "colour"], "profiles schema colour: no such kind of profile", "profiles schema quality"),
        (["path", "nowhere/x.toml"], "nowhere/x.toml: no such profile", "Check the path"),
    ],
)
def test_slips_are_told_with_a_remedy(words: list[str], problem: str, remedy: str) -> None:
    assert is_message(failed(*words), problem, remedy)


MACROS = """\
inherits = "marlin_220"
name = "macros"
start_gcode = \"\"\"
G28
M117 {nosuchname}
\"\"\"
layer_gcode = "M117 {9**9}"
end_gcode = "{if layer_count > 1}M84"
pause_gcode = "M117 {flor(layer_z)}"
tool_gcode = "T{layer_num}"
"""


def test_what_is_wrong_with_macros_is_told_by_key_and_place(tmp_path: Path) -> None:
    file = tmp_path / "macros.toml"
    file.write_text(MACROS)
    outcome = failed("check", file)
    wrong = [line for line in outcome.err.splitlines() if "gcode: " in line]

    assert outcome.code == 2
    assert [line.removeprefix(f"{file}:").partition(": line")[0] for line in wrong] == [
        "3: printer.start_gcode",
        "8: printer.end_gcode",
        "7: printer.layer_gcode",
        "10: printer.tool_gcode",
        "9: printer.pause_gcode",
    ]
    for text in (
        "line 2, column 7: unknown placeholder {nosuchname}",
        "line 1, column 1: {if ...} without {endif}",
        "line 1, column 9: expected a value, got '*'",
        "line 1, column 3: unknown placeholder {layer_num}",  # there is no layer yet
        "line 1, column 7: unknown function flor()",
    ):
        assert text in outcome.err
    assert len(outcome.err) < 4000  # not the hundreds of settings


def test_macros_are_told_beside_other_faults(tmp_path: Path) -> None:
    (tmp_path / "two.toml").write_text(MACROS + "bed_x = -3\n")
    outcome = failed("check", tmp_path / "two.toml")

    assert "bed_x" in outcome.err
    assert "{nosuchname}" in outcome.err


GOOD_MACROS = """\
inherits = "marlin_220"
name = "good"
start_gcode = "M104 S{first_layer_nozzle_temperature + 1 / (layer_count - 1)} ; {planner.seed} {object_names[0]}"
before_layer_gcode = "; {layer_num} {layer_tops[5]}"
layer_gcode = "{if layer_num > 3}M117 {quality.planner.max_step} {{{part_height}}}{endif}"
end_gcode = "; {printer_name} {print_seconds} {fixed(filament_used_g, 1)}"
pause_gcode = "M0 {layer_z}"
"""


def test_macros_that_hang_on_part_material_or_quality_are_not_faulted(tmp_path: Path) -> None:
    (tmp_path / "good.toml").write_text(GOOD_MACROS)
    outcome = typed("profiles", "check", tmp_path / "good.toml")

    assert (outcome.code, outcome.err) == (0, "")


@pytest.mark.parametrize("printer", find_profile_paths("printer"))
def test_macros_of_all_shipped_printers_are_sound(printer: str) -> None:
    assert list(find_macro_faults(load_profile(printer, slices=False).printer)) == []


def test_a_folder_that_cannot_be_made_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "file").touch()
    monkeypatch.setenv(VARIABLE, str(tmp_path / "file"))

    assert is_message(
        failed("new", "quality", "mine"),
        f"{tmp_path}/file/qualities: the folder cannot be created",
        "Not a directory",
    )


# Flags


@pytest.mark.parametrize("flag", SETTING_OPTIONS)
def test_an_option_means_what_its_setting_means(flag: str) -> None:
    option = SETTING_OPTIONS[flag]
    rows = {row.key.replace("[optimal]", ""): row for row in list_setting_definitions()}
    row = rows[option.setting]
    told = row.meaning + (f"; one of: {row.bounds.replace(' |', ',')}" if row.type == "literal" else "")

    told = (option.meaning or told) + option.help_suffix
    assert " ".join(told.split()) in " ".join(typed("slice", "--help-all").out.split())


def test_ranges_and_objects_are_typed(tmp_path: Path) -> None:
    out = tmp_path / "box.gcode"
    outcome = typed(
        "slice", BOX, "-o", out, *QUICK, "--range", "1:2:infill_density=0.5", "--set-for", "box:perimeters=3"
    )

    assert (outcome.code, outcome.err) == (0, "")
    assert "; quality.overrides = box:perimeters=3; 1:2:infill_density=0.5" in out.read_text()


def test_an_object_that_there_is_not_is_told(tmp_path: Path) -> None:
    outcome = typed("slice", BOX, "-o", tmp_path / "x.gcode", *QUICK, "--set-for", "bix:perimeters=3")

    assert outcome.code == 2
    assert is_message(outcome, "'bix'", "Did you mean 'box'")
