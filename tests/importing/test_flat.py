"""Files with one set of settings: config.ini, G-code, 3MF projects."""

from __future__ import annotations

import zipfile
from pathlib import Path

import pytest

from printer_slicer import bead
from printer_slicer.errors import ProfileError
from printer_slicer.importing import import_profiles
from tests.importing.files import FLAT, flat_file, imported, ini, loaded, refused


def test_settings_with_an_equivalent_are_taken_over(tmp_path: Path) -> None:
    profile = loaded(imported(flat_file(tmp_path)), tmp_path)
    printer, material, quality = profile.printer, profile.material, profile.quality

    assert (printer.name, material.name, quality.name) == ("Little Printer", "Plain PLA", "0.20mm PLAIN")
    assert (printer.flavour, printer.corners, printer.bed_z) == ("marlin", ((0, 0), (220, 200)), 240)
    assert (printer.max_speed_x, printer.max_speed_y, printer.max_speed_z) == (300, 310, 11)
    assert (printer.acceleration, printer.retract_length) == (700, 1.5)
    assert (material.nozzle_temperature, material.first_layer_nozzle_temperature) == (205, 212)
    assert (material.bed_temperature, material.first_layer_bed_temperature) == (58, 62)
    assert (material.max_flow, material.fan_ratio, material.fan_ratio_max) == (11, 0.4, 0.9)
    assert (quality.layer_height, quality.first_layer_height, quality.perimeters) == (0.2, 0.25, 4)
    assert (quality.infill, quality.infill_density, quality.extrusion_width) == ("gyroid", 0.18, 0.45)
    assert (quality.speeds.perimeter, quality.speeds.external_perimeter) == (48, 24)
    assert (quality.speeds.solid_infill, quality.speeds.first_layer, quality.speeds.travel) == (60, 21, 160)


@pytest.mark.parametrize(
    ("overlap", "share"),
    [
        ("25%", 0.25),
        ("0.09", 0.09 / float(bead.spacing(0.45, 0.2))),
        ("0", 0.0),
        ("80%", 0.5),
    ],
)
def test_the_overlap_of_infill_with_the_perimeters_is_taken(
    tmp_path: Path, overlap: str, share: float
) -> None:
    """A percentage refers to the mean spacing of perimeters and infill."""
    made = imported(flat_file(tmp_path, infill_overlap=overlap))
    quality = loaded(made, tmp_path).quality

    assert quality.internal_infill_overlap == quality.infill_overlap == pytest.approx(share, abs=1e-4)
    assert "infill_overlap" not in {one.theirs for one in made["quality"].left}
    assert any("infill_overlap" in one.place for one in made["quality"].notes) == (overlap == "80%")


def test_the_report_lists_converted_and_unsupported_settings(tmp_path: Path) -> None:
    quality = imported(flat_file(tmp_path, support_material_pattern="rectilinear"))["quality"]
    taken = {one.ours: one for one in quality.taken}
    left = {one.theirs: one for one in quality.left}

    assert (taken["perimeters"].theirs, taken["perimeters"].text, taken["perimeters"].how) == (
        "perimeters",
        "4",
        "",
    )
    assert taken["speeds.external_perimeter"].how == "percentage of perimeter_speed"
    assert taken["top_thickness"].value == 1
    assert "5 layers" in taken["top_thickness"].how
    assert left["support_material_pattern"].why == "supports are off"
    assert "support_material_spacing" not in left
    assert not {"temperature", "bed_shape", "print_settings_id"} & set(left)


def test_every_setting_is_accounted_for(tmp_path: Path) -> None:
    made = imported(flat_file(tmp_path))
    told = {one.theirs for part in made.values() for one in (*part.taken, *part.left)}
    with_others = {  # made into one setting together with the one that is named, or says where the file is from
        "machine_max_acceleration_extruding", "gap_fill_enabled", "printer_settings_id", "filament_settings_id",
        "print_settings_id", "fan_always_on",
    }  # fmt: skip

    assert set(FLAT) - told <= with_others


@pytest.mark.parametrize(
    ("key", "value", "kind", "said"),
    [
        ("temperature", "450", "material", "--max-nozzle-temperature 450"),
        ("first_layer_bed_temperature", "180", "material", "--max-bed-temperature 180"),
        ("machine_max_feedrate_x", "-5", "printer", "machine_max_feedrate_x (printer.max_speed_x)"),
        ("machine_max_feedrate_y", "13000", "printer", "it is 13000"),
        ("machine_max_acceleration_z", "1e9", "printer", "printer.max_acceleration_z"),
        ("machine_max_acceleration_x", "nan", "printer", "'nan' is not a number"),
        ("machine_max_feedrate_z", "inf", "printer", "'inf' is not a number"),
        ("nozzle_diameter", "0", "printer", "printer.nozzle_diameter"),
        ("bed_shape", "", "printer", "is not a corner"),
        ("bed_shape", "0x0,0x0,0x0", "printer", "the bed has no area"),
        ("bed_shape", "0x0,nanx1,3x4", "printer", "is not a corner"),
        ("bed_shape", "0x0,2x0,2x2,0x2", "printer", "printer.bed_x"),
        ("max_print_height", "-1", "printer", "printer.bed_z"),
        ("min_layer_height", "0.9", "printer", "is more than max_layer_height"),
        ("max_layer_height", "0.6", "printer", "for a nozzle of 0.4 mm"),
        ("gcode_flavor", "makerware", "printer", "unknown flavour 'makerware'"),
        ("printer_technology", "SLA", "printer", "a resin printer"),
        ("use_volumetric_e", "1", "printer", "E in mm³"),
        ("layer_height", "0", "quality", "a layer height of 0 mm"),
        ("perimeter_speed", "-3", "quality", "a speed of -3"),
        ("perimeters", "many", "quality", "'many' is not a number"),
        ("filament_diameter", "17.5", "material", "material.filament_diameter"),
        ("extrusion_multiplier", "100", "material", "a flow ratio of 100"),
        ("fill_density", "500%", "quality", "a density of 500 %"),
        ("start_gcode", "G28\\nM104 S350\\nG1 Z5", "printer", "--max-nozzle-temperature 350"),
        ("start_gcode", "{if layer_height > 9}M109 R 320{endif}", "printer", "--max-nozzle-temperature 320"),
        ("end_gcode", "m140 S200 ; warm", "printer", "over the bed limit of 120"),
    ],
)
def test_unsafe_machines_are_rejected_with_place_and_remedy(
    tmp_path: Path, key: str, value: str, kind: str, said: str
) -> None:
    path = flat_file(tmp_path, **{key: value})
    found = refused(path, kind)
    line = next(n for n, text in enumerate(path.read_text().splitlines(), 1) if text.startswith(f"{key} ="))

    assert said in f"{found.problem}\n{found.remedy}"
    assert f"{path}:{line}: " in found.problem
    assert found.remedy


@pytest.mark.parametrize(
    "macro", ["G28 ; M104 S350", "M104 S{temperature[0]} ; 350", "M1040 S350", "M104 S300"]
)
def test_heating_within_the_limits_is_accepted(tmp_path: Path, macro: str) -> None:
    assert imported(flat_file(tmp_path, start_gcode=macro))["printer"].values["start_gcode"]


def test_numbers_moved_into_their_bounds_cause_a_warning(tmp_path: Path) -> None:
    quality = imported(flat_file(tmp_path, perimeter_speed="99999", skirts="70"))["quality"]

    assert quality.values["speeds"]["perimeter"] == 1000
    assert [note.text for note in quality.notes if "99999" in note.text] == [
        "99999 becomes 1000, the maximum here"
    ]
    assert any("70 becomes 20, the maximum here" in note.text for note in quality.notes)


def test_a_hotter_machine_is_imported_where_somebody_vouches_for_it(tmp_path: Path) -> None:
    from printer_slicer.importing import TemperatureLimits

    made = imported(flat_file(tmp_path, temperature="430"), limits=TemperatureLimits(450, 120))

    assert made["material"].values["nozzle_temperature"] == 430
    assert made["printer"].values["max_nozzle_temperature"] == 430


def test_a_bed_that_begins_elsewhere_keeps_its_place(tmp_path: Path) -> None:
    shifted = loaded(imported(flat_file(tmp_path, bed_shape="5x3,215x3,215x203,5x203")), tmp_path)
    centred = loaded(imported(flat_file(tmp_path, bed_shape="-60x-50,60x-50,60x50,-60x50")), tmp_path)

    assert shifted.printer.corners == ((5, 3), (215, 203))
    assert (centred.printer.corners, centred.printer.origin) == (((-60, -50), (60, 50)), "centre")


def test_parts_on_a_round_bed_stay_on_it(tmp_path: Path) -> None:
    from math import cos, hypot, pi, sin

    outline = ",".join(
        f"{100 * cos(2 * pi * k / 72):.3f}x{100 * sin(2 * pi * k / 72):.3f}" for k in range(72)
    )
    printer = loaded(imported(flat_file(tmp_path, bed_shape=outline)), tmp_path).printer

    assert 95 < max(hypot(x, y) for x, y in printer.corners) <= 100


def test_the_nozzle_may_go_where_its_own_gcode_goes(tmp_path: Path) -> None:
    start = "G28\\nG1 Y-3.0 F1000\\nG1 X60 E9\\nG91\\nG1 X-90\\nG90\\n;G1 X-50\\nM104 S1\\nM140 S1\\n"

    assert imported(flat_file(tmp_path, start_gcode=start))["printer"].values["reach"] == 3


@pytest.mark.parametrize("there", [True, False])
def test_heating_is_added_as_the_source_does_where_start_gcode_does_not_heat(
    tmp_path: Path, there: bool
) -> None:
    start = "M104 S{temperature[0]}\\nM140 S60\\nG28" if there else "G28 ; M104 in a remark heats nothing"
    text = str(imported(flat_file(tmp_path, start_gcode=start))["printer"].values["start_gcode"])

    assert ("M109 S{first_layer_temperature[0]}" in text) is not there
    assert ("M190 S{first_layer_bed_temperature[0]}" in text) is not there


def test_superslicer_means_the_nozzle_by_percentages_of_widths(tmp_path: Path) -> None:
    changes = {"perimeter_extrusion_width": "110%", "extrusion_width": "110%"}
    theirs = imported(flat_file(tmp_path, **changes))["quality"]
    other = tmp_path / "other.ini"
    other.write_text("# generated by SuperSlicer\n" + ini(FLAT | changes), encoding="utf-8")

    assert theirs.values["extrusion_width"] == pytest.approx(0.22)  # of the layer
    assert imported(other)["quality"].values["extrusion_width"] == pytest.approx(0.44)


GCODE_FORMS = {
    "marked": ("; prusaslicer_config = begin\n", "; prusaslicer_config = end\n"),
    "superslicer": ("; SuperSlicer_config = begin\n", "; SuperSlicer_config = end\n"),
    "slic3r": ("", ""),
}


@pytest.mark.parametrize("form", GCODE_FORMS)
def test_settings_at_the_end_of_gcode_are_found(tmp_path: Path, form: str) -> None:
    begin, end = GCODE_FORMS[form]
    lines = "".join(f"; {key} = {value}\n" for key, value in FLAT.items())
    path = tmp_path / "part.gcode"
    path.write_text(f"; made\nG28\nG1 X1\n; filament used = 1\n\n{begin}{lines}{end}", encoding="utf-8")
    flat = imported(flat_file(tmp_path))

    assert {kind: one.values for kind, one in imported(path).items()} == {
        kind: one.values for kind, one in flat.items()
    }


def test_settings_in_a_project_are_found(tmp_path: Path) -> None:
    path = tmp_path / "part.3mf"
    with zipfile.ZipFile(path, "w") as archive:
        lines = "".join(f"; {key} = {value}\n" for key, value in FLAT.items())
        archive.writestr("Metadata/Slic3r_PE.config", "; generated by PrusaSlicer\n\n" + lines)

    assert imported(path)["quality"].values == imported(flat_file(tmp_path))["quality"].values


@pytest.mark.parametrize(
    ("name", "data", "said"),
    [
        ("a.gcode", b"G28\nG1 X1\n", "this G-code has no settings"),
        ("a.3mf", b"PK\x03\x04broken", "cannot be unpacked"),
        ("a.ini", b"[vendor]\nname = x\n", "no printer, filament or print settings"),
        ("a.ini", b"what is this\n", "is not a [section], a setting or a comment"),
        ("a.ini", b"", "no printer, filament or print settings"),
        ("a.ini", b"\x00\x01\x02", "not a text file"),
        ("a.json", b"{]", "not valid JSON"),
        ("a.json", b"{}", "not a machine, filament or process preset"),
        (
            "a.json",
            b'{"version": 2, "overrides": {}, "inherits": "gone"}',
            "gone.def.json is not in the same folder",
        ),
        ("a.curaprofile", b"no", "cannot be unpacked"),
        ("a.inst.cfg", b"[general]\n", "not a Cura profile"),
    ],
)
def test_files_that_hold_no_settings_are_refused_with_a_remedy(
    tmp_path: Path, name: str, data: bytes, said: str
) -> None:
    path = tmp_path / name
    path.write_bytes(data)

    with pytest.raises(ProfileError) as caught:
        import_profiles(path)

    assert said in str(caught.value)
    assert str(path) in str(caught.value)
    assert caught.value.remedy


def test_a_missing_file_and_a_folder_are_refused(tmp_path: Path) -> None:
    for path in (tmp_path / "gone.ini", tmp_path):
        with pytest.raises(ProfileError, match="cannot be read"):
            import_profiles(path)


@pytest.mark.parametrize(
    ("text", "advance"),
    [
        ("; Filament gcode\\nM900 K0.07", 0.07),
        ('"M900 K0.05 ; LA 1.5\\nM900 K30 ; LA 1.0"', 0.05),
        ("M900 K30\\nM900 K0.05", 0.05),
        ('"M900 K0.05";"M900 K0.4"', 0.05),
        ("M900 K0.05\\nM900 K0.06", 0.06),
    ],
)
def test_pressure_advance_is_the_last_that_is_one_in_seconds(
    tmp_path: Path, text: str, advance: float
) -> None:
    made = imported(flat_file(tmp_path, start_filament_gcode=text))["material"]

    assert made.values["pressure_advance"] == advance
    assert made.notes == ()


def test_pressure_advance_in_another_unit_is_not_imported(tmp_path: Path) -> None:
    made = imported(flat_file(tmp_path, start_filament_gcode='"M900 K30"'))["material"]

    assert "pressure_advance" not in made.values
    assert "'M900 K30' is not in seconds" in made.notes[0].text


FILE_REMEDY = "Give an exported config.ini, a bundle, G-code, a 3MF file or a JSON preset"


def test_a_part_without_settings_is_refused_with_how_to_get_them(tmp_path: Path) -> None:
    path = tmp_path / "part.3mf"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("3D/3dmodel.model", "<model/>")
    with pytest.raises(ProfileError) as caught:
        import_profiles(path)

    assert str(caught.value) == (
        f"{path}: has no settings\n  Save it as a project with PrusaSlicer, OrcaSlicer or BambuStudio"
    )


def test_a_file_of_far_too_many_bytes_or_lines_is_no_file_of_settings(tmp_path: Path) -> None:
    heavy, long = tmp_path / "heavy.ini", tmp_path / "long.ini"
    with heavy.open("wb") as file:
        file.truncate(50_000_001)
    long.write_text("\n" * 200_002, encoding="utf-8")
    for path, size in ((heavy, "50 MB"), (long, "200000 lines")):
        with pytest.raises(ProfileError) as caught:
            import_profiles(path)
        assert str(caught.value) == f"{path}: over {size}, too large for a settings file\n  {FILE_REMEDY}"


@pytest.mark.parametrize(
    ("changes", "width"),
    [
        ({}, 0),
        ({"external_perimeter_extrusion_width": "0.42"}, 0.42),
        ({"external_perimeter_extrusion_width": "0.45"}, 0),
        ({"external_perimeter_extrusion_width": "200%"}, 0.4),
        ({"perimeter_extrusion_width": "0", "external_perimeter_extrusion_width": "0.42"}, 0.42),
        (
            {
                "perimeter_extrusion_width": "0",
                "extrusion_width": "0.45",
                "external_perimeter_extrusion_width": "0.6",
            },
            0.6,
        ),
    ],
)
def test_the_width_of_external_perimeters_is_taken_over(
    tmp_path: Path, changes: dict[str, str], width: float
) -> None:
    made = imported(flat_file(tmp_path, **changes))

    assert loaded(made, tmp_path).quality.external_perimeter_width == pytest.approx(width)
    assert not [one for one in made["quality"].left if "perimeter_extrusion_width" in one.theirs]


def test_other_widths_are_reported_by_name(tmp_path: Path) -> None:
    made = imported(flat_file(tmp_path, infill_extrusion_width="0.6", top_infill_extrusion_width="0.45"))
    left = {one.theirs: one.why for one in made["quality"].left}

    assert left["infill_extrusion_width"].startswith("extrusion_width applies to everything but")
    assert "top_infill_extrusion_width" not in left


def test_the_speed_of_gap_fill_is_taken_over(tmp_path: Path) -> None:
    made = imported(flat_file(tmp_path, gap_fill_speed="22"))

    assert [
        (one.theirs, one.value) for one in made["quality"].taken if one.ours.startswith("speeds.gap_fill")
    ] == [("gap_fill_speed", 22)]
