"""Start, end and layer G-code of other slicers: imported unchanged, with the same result after slicing."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from printer_slicer import job_of
from printer_slicer.errors import ProfileError
from printer_slicer.importing import ImportedProfile
from printer_slicer.importing.machine_gcode import _convert_cura_macro
from printer_slicer.macros import read_template
from tests.importing.files import flat_file, imported, json_file, loaded, refused
from tests.parts import box

HEATS = "M140 S[first_layer_bed_temperature]\nM109 S{first_layer_temperature[0]}\nM190 S60\n"


def printer_with(folder: Path, name: str, text: str, **more: str) -> ImportedProfile:
    changes = {name: text.replace("\\", "\\\\").replace("\n", "\\n"), **more}
    return imported(flat_file(folder, **changes))["printer"]


def notes_of(made: ImportedProfile) -> list[str]:
    return [note.text for note in made.notes]


@pytest.mark.parametrize("name", ["start_gcode", "end_gcode", "layer_gcode"])
@pytest.mark.parametrize(
    "text",
    [
        "G28 W ; [temperature]\n\n  {if layer_height<0.3}\nM1\n{elsif nozzle_diameter[0]==0.6}M2{endif} ; x",
        "{local x = 1; global y = x + 1}\nM117 {y}\n",
        "M117 [temperature_0] {filament_type[0]=~/P(LA|ETG)/} }} ]",
    ],
)
def test_a_macro_is_kept_as_it_is_written(tmp_path: Path, name: str, text: str) -> None:
    made = printer_with(tmp_path, name, HEATS + text)

    assert made.values[name] == HEATS + text
    assert notes_of(made) == []


def test_settings_without_a_counterpart_are_variables_in_front_of_the_macro(tmp_path: Path) -> None:
    text = HEATS + "{if printer_notes=~/.*MODEL_X.*/ and silent_mode}M1{endif}\nG1 Z{z_offset + 0.2}\n"
    more = {"printer_notes": 'MODEL_X \\"quoted\\"\\nline', "silent_mode": "1", "z_offset": "0.1"}
    made = printer_with(tmp_path, "start_gcode", text, **more)
    variables, _, rest = str(made.values["start_gcode"]).partition("\n")
    lines = read_template(str(made.values["start_gcode"]), "start").list_possible_lines({})

    assert rest == text
    assert variables == (
        '{local printer_notes = "MODEL_X \\"quoted\\"\\nline"; local silent_mode = 1; local z_offset = 0.1}'
    )
    assert {"M1", "G1 Z0.3"} <= set(lines)


def test_unknown_placeholders_are_reported_by_import_and_slicing(tmp_path: Path) -> None:
    made = imported(flat_file(tmp_path, start_gcode="G28\\nM104 S{unheard_of}\\nM109 S200\\nM190 S60"))

    (note,) = (note for note in made["printer"].notes if "unheard_of" in note.text)
    assert "line 2: unknown placeholder {unheard_of}" in note.text
    assert "config.ini:" in note.place
    with pytest.raises(
        ProfileError, match=r"start_gcode: line 2, column 8: unknown placeholder \{unheard_of\}"
    ):
        job_of(box((10, 10, 1)), loaded(made, tmp_path))


def test_unknown_placeholders_in_unused_branches_are_allowed(tmp_path: Path) -> None:
    made = imported(
        flat_file(tmp_path, start_gcode="M104 S1\\nM140 S1\\n{if layer_height > 5}{unheard_of}{endif}")
    )

    assert any("unheard_of" in text for text in notes_of(made["printer"]))
    job_of(box((10, 10, 1)), loaded(made, tmp_path))


def test_an_invalid_macro_is_reported_with_its_line(tmp_path: Path) -> None:
    made = printer_with(tmp_path, "end_gcode", "M84\n{if layer_num > 1}M1")

    assert made.values["end_gcode"] == "M84\n{if layer_num > 1}M1"
    assert any("line 2, column 1: {if ...} without {endif}" in text for text in notes_of(made))


def test_placeholders_in_comments_are_ignored(tmp_path: Path) -> None:
    made = imported(flat_file(tmp_path, end_gcode="M84 ; [unheard_of] {neither}"))
    job = job_of(box((10, 10, 1)), loaded(made, tmp_path))

    assert notes_of(made["printer"]) == []
    assert b"M84 ; [unheard_of] {neither}" in job.text


def test_layer_and_end_gcode_is_as_in_prusaslicer(tmp_path: Path) -> None:
    changes = {
        "layer_gcode": ";L {layer_num} {layer_z} [layer_z] {layer_height}",
        "end_gcode": ";E {layer_num} {layer_z} {max_layer_z} {total_layer_count}",
        "retract_lift": "0.5",
    }
    job = job_of(box((10, 10, 1.05)), loaded(imported(flat_file(tmp_path, **changes)), tmp_path))
    lines = job.text.decode().splitlines()

    assert [line for line in lines if line.startswith(";L ")][:2] == [
        ";L 0 0.25 0.25 0.2",
        ";L 1 0.45 0.45 0.2",
    ]
    assert ";E 4 1.55 1.05 5" in lines


@pytest.mark.parametrize(
    ("theirs", "ours"),
    [
        ("M104 S{material_print_temperature_layer_0}", "M104 S{material_print_temperature_layer_0}"),
        ("M104 S{material_print_temperature_layer_0, 0}", "M104 S{material_print_temperature_layer_0[0]}"),
        ("M109 [x] {a[0]} [y", 'M109 {"["}x] {a[0]} {"["}y'),
    ],
)
def test_macros_of_cura_keep_their_meaning(theirs: str, ours: str) -> None:
    assert _convert_cura_macro(theirs) == ours


def test_a_long_text_of_cura_takes_no_longer_than_its_length() -> None:
    assert len(_convert_cura_macro("[a{" * 100_000)) > 300_000


def test_temperature_limits_apply_to_computed_values(tmp_path: Path) -> None:
    path = flat_file(tmp_path, start_gcode="{local hot = 200}{if layer_height > 1}M104 S{hot + 150}{endif}")

    assert "M104 S350" in refused(path, "printer").problem


@given(st.text(alphabet='{}[]ifendsla temperature_0+-*/()"\\;\n=~<>?:,.[]{}éx', max_size=120))
def test_any_text_is_filled_in_or_an_error_that_says_where(text: str) -> None:
    try:
        macro = read_template(text, "here")
        macro.render({})
    except ProfileError as error:
        assert str(error).startswith("here: line ")  # noqa: PT017 - most texts are filled in
    else:
        assert isinstance(macro.list_possible_lines({}), list)


def test_json_of_orca_and_bambu_is_kept_too(tmp_path: Path) -> None:
    text = "M104 S[nozzle_temperature_initial_layer]\nM190 S[bed_temperature_initial_layer_single]\n"
    settings = {
        "type": "machine", "name": "M", "from": "system", "printable_area": ["0x0", "200x0", "200x200", "0x200"],
        "machine_start_gcode": text, "gcode_flavor": "marlin", "nozzle_diameter": ["0.4"], "printable_height": "200",
        "max_layer_height": ["0.3"],
    }  # fmt: skip
    made = imported(json_file(tmp_path / "m.json", settings))["printer"]

    assert made.values["start_gcode"] == text
