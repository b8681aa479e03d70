"""The command `profiles import`."""

from __future__ import annotations

import json
import shlex
from pathlib import Path

import pytest

from printer_slicer.cli import main
from printer_slicer.profile.finding import find_profiles
from printer_slicer.profile.folders import VARIABLE, find_shipped_profiles
from printer_slicer.profile.reading import find_profile_file
from tests.importing.files import FLAT, flat_file, ini
from tests.importing.test_bundle import BUNDLE


@pytest.fixture(autouse=True)
def own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the folder of the user's own profiles."""
    monkeypatch.setenv(VARIABLE, str(tmp_path / "own"))
    return tmp_path / "own"


def run(capsys: pytest.CaptureFixture[str], *words: str | Path) -> tuple[int, str, str]:
    code = main(["profiles", "import", *map(str, words)])
    said = capsys.readouterr()
    return code, said.out, said.err


def test_it_writes_three_files_that_slice(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code, said, _ = run(capsys, flat_file(tmp_path), "-o", tmp_path / "made")
    files = sorted(path.relative_to(tmp_path / "made") for path in (tmp_path / "made").rglob("*.toml"))

    assert code == 0
    assert [path.as_posix() for path in files] == [
        "materials/plain_pla.toml", "printers/little_printer.toml", "qualities/0_20mm_plain.toml",
    ]  # fmt: skip
    assert f"3 profiles written to {tmp_path / 'made'}" in said
    flags = shlex.split(said.partition("MODEL ")[2])
    assert main(["slice", "sample_parts/box.stl", "-o", str(tmp_path / "box.gcode"), "-q", *flags]) == 0


def test_by_default_there_are_counts_and_at_most_five_differences(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    changes = {
        "fill_pattern": "stars",
        "support_material": "1",
        "support_material_auto": "0",
        "perimeter_generator": "classic",
        "perimeters": "140",
    }
    path = flat_file(
        tmp_path, **changes, fuzzy_skin="all", complete_objects="1", infill_extrusion_width="0.6",
        filament_max_volumetric_speed="0",
    )  # fmt: skip
    _, said, _ = run(capsys, path)
    lines = said.splitlines()

    assert lines[0] == (
        "printer little_printer from 'Little Printer': 29 settings taken over, 0 not applicable, 0 without equivalent"
    )
    assert [line.split()[0] for line in lines[:3]] == ["printer", "material", "quality"]
    assert lines[3:10] == [
        "largest differences from the source:",
        "  quality: perimeters = 140 -> perimeters = 100 (100 is the maximum here)",
        "  quality: fuzzy_skin = all is not imported (no equivalent)",
        "  quality: fill_pattern = stars -> infill = triangles (triangles is the most similar choice for stars)",
        (
            "  material: filament_max_volumetric_speed = 0 mm³/s -> max_flow = 0 mm³/s "
            "(unlimited in the source; here 0 means printer.hotend_max_flow, or 12 mm³/s if that is 0)"
        ),
        (
            "  quality: infill_extrusion_width = 0.6 mm is not imported (extrusion_width applies to everything but "
            "external perimeters and the first layer)"
        ),
        "add -v to see 1 more difference and all settings",
    ]
    assert len(lines) == 13
    _, material, _ = run(capsys, path, "--only", "Plain PLA", "--force")
    assert (
        "  material: filament_max_volumetric_speed = 0 mm³/s -> max_flow = 0 mm³/s "
        "(unlimited in the source; here 0 means printer.hotend_max_flow, or 12 mm³/s if that is 0)"
        in material.splitlines()
    )


def test_verbose_names_every_setting(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    _, said, _ = run(capsys, flat_file(tmp_path, support_material_pattern="rectilinear"), "-v")

    assert (
        "external_perimeter_speed = 50% -> speeds.external_perimeter = 24 (percentage of perimeter_speed)"
        in said
    )
    assert "not applicable: support_material_pattern = rectilinear (supports are off)" in said
    assert "largest differences" not in said


@pytest.mark.parametrize("where", [[], ["-o", "my profiles"]], ids=["own", "elsewhere"])
@pytest.mark.parametrize(
    "chosen", [[], ["--only", "Little Printer"], ["--name", "mine"], ["--only", "Plain PLA"]], ids=" ".join
)
def test_the_command_at_the_end_works_as_it_is(
    where: list[str],
    chosen: list[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    box = Path("sample_parts/box.stl").resolve()
    monkeypatch.chdir(tmp_path)
    _, said, _ = run(capsys, flat_file(tmp_path), *where, *chosen)
    program, *words = shlex.split(said.splitlines()[-1].replace("MODEL", str(box)))

    assert (program, words[0]) == ("printer-slicer", "slice")
    assert not [word for word in words if word.endswith(".toml")]
    assert main([*words, "-o", "box.gcode"]) == 0
    used = Path("box.gcode").read_text()
    assert "printer.name = Little Printer" in used or "material.name = Plain PLA" in used


def test_an_imported_printer_does_not_make_the_shipped_one_ambiguous(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run(capsys, flat_file(tmp_path, printer_model="ENDER3"), "-o", tmp_path)

    assert find_profiles("printer", "Ender 3", [tmp_path])[0] == ("creality_ender3", "Creality Ender-3", True)


V2 = "Creality Ender-3 V2"


@pytest.mark.parametrize(
    ("typed_name", "found"),
    [
        ("Ender 3", "creality_ender3"),
        ("ender3", "ender3"),
        ("Ender 3 V2", "creality_ender3_v2"),
        (V2, "creality_ender3_v2"),
        (f"{V2} (0.4 mm nozzle)", "ender3"),
        (f"{V2.lower()} 0.4 mm nozzle", "ender3"),
    ],
)
def test_an_exact_name_selects_the_shipped_printer_or_the_imported_one(
    typed_name: str, found: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = flat_file(tmp_path, printer_settings_id=f"{V2} (0.4 mm nozzle)", printer_model="ENDER3V2")
    run(capsys, file, "-o", tmp_path, "--name", "ender3")

    assert find_profile_file("printer", typed_name, [tmp_path]).stem == found


def test_the_users_own_printer_wins_among_equal_display_names(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run(capsys, flat_file(tmp_path, printer_settings_id=V2), "-o", tmp_path)

    assert find_profile_file("printer", V2, [tmp_path]).is_relative_to(tmp_path)
    assert find_profile_file("printer", f"{V2} (0.4 mm nozzle)", [tmp_path]).is_relative_to(tmp_path)
    assert find_profile_file("printer", "Ender 3 V2", [tmp_path]).stem == "creality_ender3_v2"


def test_the_name_of_an_imported_printer_has_other_words_than_a_shipped_one(
    tmp_path: Path, own: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run(capsys, flat_file(tmp_path, printer_settings_id=f"{V2} (0.4 mm nozzle)"))

    assert [one.stem for one in (own / "printers").iterdir()] == ["creality_ender_3_v2_imported"]


def test_profiles_that_do_not_fit_together_cause_a_warning_of_two_lines(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = flat_file(tmp_path, external_perimeter_extrusion_width="1.5")
    _, said, _ = run(capsys, path)
    *_, problem, remedy = said.splitlines()

    assert problem.startswith("warning: the profiles do not fit together: ")
    assert "quality.external_perimeter_width: 1.5 mm" in problem
    assert remedy == "  Choose 0.24 to 1 mm"


def test_all_settings_are_shown_once_and_without_python_values(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = flat_file(tmp_path, interface_shells="1", filament_max_volumetric_speed=None)
    _, said, _ = run(capsys, file, "-v", "--dry-run")

    assert "  not set -> planner.kind = uniform\n" in said
    assert "-> relative_extrusion = false\n" in said
    assert said.count("-> start_gcode = ") == 1
    assert "not applicable: interface_shells = 1 (only one tool is supported)" in said
    _, said, _ = run(capsys, file)
    assert "max_flow" not in said


def test_a_first_layer_that_is_too_high_for_the_nozzle_is_lowered(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    _, said, _ = run(capsys, flat_file(tmp_path, first_layer_height=None))

    assert (
        "first_layer_height = 0.32 mm (the nozzle of 0.4 mm allows 0.32 mm; the source has 0.35 mm)" in said
    )
    assert "fit together" not in said
    _, said, _ = run(capsys, tmp_path / "config.ini", "-v", "--dry-run")
    assert said.count("-> first_layer_height = ") == 1


def test_a_name_can_be_given(tmp_path: Path, own: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = flat_file(tmp_path)

    assert run(capsys, path, "--name", "ender3")[0] == 0
    assert sorted(one.stem for one in own.rglob("*.toml")) == ["ender3"] * 3
    assert "Use --name my_ender" in run(capsys, path, "--name", "My Ender!")[2]
    assert "Use lower-case letters" in run(capsys, path, "--name", "?")[2]
    bundle = tmp_path / "Acme.ini"
    bundle.write_text(BUNDLE, encoding="utf-8")
    assert "--only or --for" in run(capsys, bundle, "--name", "acme")[2]


def test_a_new_profile_hides_neither_a_shipped_one_nor_one_of_another_preset(
    tmp_path: Path, own: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for vendor in ("A", "B", "A"):
        changes = {"print_settings_id": f"0.2mm Fine @{vendor}", "filament_settings_id": "PLA"}
        assert run(capsys, flat_file(tmp_path, **changes))[0] == 0

    assert sorted(one.stem for one in (own / "qualities").iterdir()) == ["0_2mm_fine", "0_2mm_fine_b"]
    assert [one.stem for one in (own / "materials").iterdir()] == ["pla_imported"]


def test_existing_files_are_overwritten_only_with_force(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = flat_file(tmp_path)
    run(capsys, path, "-o", tmp_path)
    mine = tmp_path / "printers" / "little_printer.toml"
    mine.write_text("mine", encoding="utf-8")
    code, _, error = run(capsys, path, "-o", tmp_path)

    assert code == 2
    assert f"{mine}: already exists" in error
    assert "--force" in error
    assert mine.read_text() == "mine"
    assert run(capsys, path, "-o", tmp_path, "--force")[0] == 0
    assert mine.read_text() != "mine"


def test_imported_profiles_are_found_by_name_and_refer_to_their_schema(
    own: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, _, _ = run(capsys, flat_file(tmp_path))
    files = {kind: own / folder / f"{name}.toml" for kind, folder, name in (
        ("printer", "printers", "little_printer"),
        ("material", "materials", "plain_pla"),
        ("quality", "qualities", "0_20mm_plain"),
    )}  # fmt: skip

    assert code == 0
    for kind, path in files.items():
        named = path.read_text(encoding="utf-8").splitlines()[0].removeprefix("#:schema ")
        assert (path.parent / named).read_text() == (
            find_shipped_profiles() / "schema" / f"{kind}.schema.json"
        ).read_text()
    assert main(["profiles", "check", *(path.stem for path in files.values())]) == 0


def test_profiles_in_another_folder_refer_to_the_shipped_schema(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run(capsys, flat_file(tmp_path), "-o", tmp_path / "made")
    first = (tmp_path / "made" / "materials" / "plain_pla.toml").read_text(encoding="utf-8").splitlines()[0]

    assert first == f"#:schema {(find_shipped_profiles() / 'schema').as_uri()}/material.schema.json"
    assert not (tmp_path / "made" / "schema").exists()


def test_without_an_own_folder_the_error_suggests_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv(VARIABLE, "")
    code, _, error = run(capsys, flat_file(tmp_path))

    assert code == 2
    assert "there is no folder for your own profiles" in error
    assert "-o FOLDER" in error


def test_json_has_the_complete_report(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = flat_file(tmp_path, machine_max_feedrate_x="-4")
    code, said, _ = run(capsys, path, "--dry-run", "--json")
    facts = json.loads(said)

    assert code == 0
    assert [one["kind"] for one in facts["imported"]] == ["material", "quality"]
    assert facts["rejected"][0]["kind"] == "printer"
    assert "machine_max_feedrate_x" in facts["rejected"][0]["problem"]
    current = {
        "source_setting": "perimeters",
        "source_value": "4",
        "setting": "quality.perimeters",
        "value": 4,
        "conversion": "",
    }
    former = {"theirs": "perimeters", "text": "4", "ours": "quality.perimeters", "how": ""}
    quality = facts["imported"][1]
    assert {**current, **former} in quality["taken_over"]
    assert facts["refused"] == facts["rejected"]
    assert quality["taken"] == quality["taken_over"]
    assert quality["no_counterpart"] == quality["without_equivalent"]
    assert not list(tmp_path.rglob("*.toml"))


def test_a_bundle_can_be_listed_and_imported_by_printer(
    tmp_path: Path, own: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "Acme.ini"
    path.write_text(BUNDLE, encoding="utf-8")
    _, names, _ = run(capsys, path, "--list")
    _, said, _ = run(capsys, path, "--dry-run")
    _, one, _ = run(capsys, path, "--dry-run", "--for", "Acme A1")

    assert "printer   Acme A1\n" in names
    assert "rejected: printer 'Ring': " in said
    assert f"7 profiles would be written to {own}; 2 rejected" in said
    assert "3 profiles would be written" in one


def test_if_nothing_can_be_imported_the_reason_is_the_error(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "only.ini"
    path.write_text(ini({"temperature": "490", "filament_type": "PLA"}), encoding="utf-8")
    code, _, error = run(capsys, path)

    assert code == 2
    assert f"{path}:2: temperature" in error
    assert "--max-nozzle-temperature 490" in error


REFUSED = "M302 P1\\nM502\\n{if layer_height > 9}M500{endif}\\nM997\\nM104 S{temperature[0] + 90}\\n"


def test_commands_that_print_rejects_are_reported(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = flat_file(tmp_path, start_gcode=f"{REFUSED}M109 S[first_layer_temperature]\\nG28\\nM190 S60\\n")
    _, short, _ = run(capsys, path, "-o", tmp_path)
    _, said, _ = run(capsys, path, "-o", tmp_path, "-v")
    told = [line for line in said.splitlines() if "`print` rejects it" in line]
    names = ["cold", "eeprom", "eeprom", "firmware", "temperature"]

    assert [line.rpartition(" ")[2] for line in told] == names
    assert "nozzle temperature 295 °C" in told[-1]
    assert short.count("`print` rejects it") == 3
    assert "add -v to see 2 more warnings" in short
    assert "# warning: M997" in (tmp_path / "printers" / "little_printer.toml").read_text(encoding="utf-8")
    assert "`print`" not in run(capsys, flat_file(tmp_path), "--dry-run")[1]


@pytest.mark.parametrize(("flag", "most"), [("nozzle", "9999"), ("nozzle", "20"), ("bed", "201")])
def test_temperature_limits_must_be_valid_for_a_printer(
    flag: str, most: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, _, error = run(capsys, flat_file(tmp_path), f"--max-{flag}-temperature", most)

    assert code == 2
    assert f"--max-{flag}-temperature {most}: " in error


def test_patterns_and_stdin_are_files_here_too(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    path = flat_file(tmp_path)
    other = path.rename(tmp_path / "other.ini")
    with other.open(encoding="utf-8") as text:
        monkeypatch.setattr("sys.stdin", text)
        code, said, _ = run(capsys, "-", "--list")
    _, same, _ = run(capsys, tmp_path / "*.ini", "--list")

    assert code == 0
    assert said == same
    assert "printer   Little Printer" in said
    assert "no file matches this pattern" in run(capsys, tmp_path / "V*.ini")[2]


def test_existing_identical_files_are_no_error(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = flat_file(tmp_path)
    run(capsys, path, "-o", tmp_path)
    flat_file(tmp_path, print_settings_id="Another", perimeters="2")

    assert run(capsys, path, "-o", tmp_path)[0] == 0
    assert len(list((tmp_path / "qualities").iterdir())) == 2


@pytest.mark.parametrize("words", [["--cura", "nothing"], ["--only", "Nobody"], ["--for", "x", "--list"]])
def test_invalid_flags_are_errors(
    words: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "Acme.ini"
    path.write_text(BUNDLE, encoding="utf-8")

    assert run(capsys, path, *words)[0] == 2


def test_other_profiles_commands_still_work(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["profiles"]) == 0
    assert "marlin_220 (default)" in capsys.readouterr().out
    assert main(["profiles", "printer", "marlin_220", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["bed_x"]["value"] == 220
    assert len(FLAT) > 40
