"""Presets of OrcaSlicer and BambuStudio."""

from __future__ import annotations

import json
import zipfile
from pathlib import Path

import pytest

from printer_slicer.errors import ProfileError
from printer_slicer.importing import ImportedProfile, ImportRequest, import_profiles
from tests.importing.files import imported, json_file, loaded, needs_proc, unreadable

MACHINE = {
    "type": "machine",
    "name": "Acme 300 0.4 nozzle",
    "inherits": "acme_common",
    "printable_area": ["0x0", "300x0", "300x310", "0x310"],
    "printable_height": "320",
    "nozzle_diameter": ["0.4"],
}
COMMON = {
    "type": "machine",
    "name": "acme_common",
    "gcode_flavor": "klipper",
    "machine_max_speed_x": ["400", "200"],
    "machine_max_speed_z": ["9"],
    "machine_max_acceleration_extruding": ["8000", "8000"],
    "machine_max_jerk_x": ["7"],
    "machine_max_jerk_y": ["7"],
    "retraction_length": ["0.7"],
    "z_hop": ["0.2"],
    "max_layer_height": ["0.28"],
    "machine_start_gcode": "PRINT_START EXTRUDER=[nozzle_temperature_initial_layer] "
    "BED=[bed_temperature_initial_layer_single]\n"
    "M109 S{nozzle_temperature_initial_layer[0]}\nM140 S60\n",
    "layer_change_gcode": ";at {layer_z}",
}
FILAMENT = {
    "type": "filament",
    "name": "Acme PETG",
    "filament_type": ["PETG"],
    "nozzle_temperature": ["238"],
    "nozzle_temperature_initial_layer": ["244"],
    "hot_plate_temp": ["75"],
    "hot_plate_temp_initial_layer": ["80"],
    "filament_flow_ratio": ["0.96"],
    "filament_max_volumetric_speed": ["9.5"],
    "enable_pressure_advance": ["1"],
    "pressure_advance": ["0.045"],
    "reduce_fan_stop_start_freq": ["1"],
    "fan_min_speed": ["30"],
    "fan_max_speed": ["70"],
    "slow_down_layer_time": ["9"],
}
PROCESS = {
    "type": "process",
    "name": "0.20 Acme",
    "layer_height": "0.2",
    "initial_layer_print_height": "0.25",
    "line_width": "110%",
    "inner_wall_line_width": "110%",
    "wall_loops": "3",
    "sparse_infill_density": "22%",
    "sparse_infill_pattern": "crosshatch",
    "infill_wall_overlap": "15%",
    "outer_wall_speed": "120",
    "inner_wall_speed": "180",
    "sparse_infill_speed": "200",
    "small_perimeter_speed": "50%",
    "travel_speed": "350",
    "default_acceleration": "6000",
    "outer_wall_acceleration": "50%",
    "wall_sequence": "outer wall/inner wall",
    "xy_hole_compensation": "0.05",
    "enable_support": "1",
    "bool_as_bool": True,
}


def write(folder: Path) -> list[Path]:
    json_file(folder / "common of acme.json", COMMON)
    return [
        json_file(folder / name, values)
        for name, values in (
            ("machine.json", MACHINE),
            ("filament.json", FILAMENT),
            ("process.json", PROCESS),
        )
    ]


def test_the_head_of_a_preset_is_not_a_setting(tmp_path: Path) -> None:
    head = {"from": "User", "version": "1.9.0", "setting_id": "GP1", "instantiation": "true"}
    made = imported(json_file(tmp_path / "fine.json", PROCESS | head | {"is_custom_defined": "0"}))

    assert {one.theirs for one in made["quality"].left} & {
        "type",
        "name",
        *head,
        "is_custom_defined",
    } == set()


def test_three_presets_make_a_profile(tmp_path: Path) -> None:
    made: dict[str, ImportedProfile] = {}
    for path in write(tmp_path):
        made |= imported(path)
    profile = loaded(made, tmp_path)
    printer, material, quality = profile.printer, profile.material, profile.quality

    assert (printer.name, printer.flavour, printer.corners) == (
        "Acme 300 0.4 nozzle", "klipper", ((0, 0), (300, 310))
    )  # fmt: skip
    assert (printer.bed_z, printer.max_speed_x, printer.max_speed_z, printer.acceleration) == (
        320,
        400,
        9,
        8000,
    )
    assert (printer.retract_length, printer.z_hop, printer.max_layer) == (0.7, 0.2, 0.28)
    assert printer.square_corner_velocity == 7
    assert printer.layer_gcode.strip() == ";at {layer_z}"
    assert printer.start_gcode == COMMON["machine_start_gcode"]
    assert (material.type, material.nozzle_temperature, material.first_layer_nozzle_temperature) == (
        "PETG",
        238,
        244,
    )
    assert (material.bed_temperature, material.first_layer_bed_temperature) == (75, 80)
    assert (material.flow_ratio, material.max_flow, material.pressure_advance) == (0.96, 9.5, 0.045)
    assert (material.fan_ratio, material.fan_ratio_max, material.min_layer_time) == (0.3, 0.7, 9)
    assert (quality.layer_height, quality.first_layer_height, quality.perimeters) == (0.2, 0.25, 3)
    assert (quality.extrusion_width, quality.infill, quality.infill_density) == (0.44, "gyroid", 0.22)
    assert (quality.infill_overlap, quality.internal_infill_overlap) == (0.15, 0.15)
    assert (quality.speeds.external_perimeter, quality.speeds.small_perimeter, quality.speeds.travel) == (
        120,
        60,
        350,
    )
    assert (quality.accelerations.external_perimeter, quality.accelerations.internal_infill) == (3000, 6000)
    assert (quality.external_perimeter_first, quality.hole_compensation) == (True, 0.05)


def test_parents_may_be_in_another_folder(tmp_path: Path) -> None:
    here, there = tmp_path / "here", tmp_path / "there"
    here.mkdir()
    there.mkdir()
    json_file(there / "any.json", COMMON)
    json_file(there / "broken.json", [1])
    path = json_file(here / "machine.json", MACHINE)

    with pytest.raises(ProfileError, match="inherits 'acme_common', which is not in the same folder"):
        import_profiles(path)
    assert imported(path, folders=(there,))["printer"].values["z_hop"] == 0.2


def test_a_circle_of_presets_is_refused(tmp_path: Path) -> None:
    json_file(tmp_path / "a.json", {"type": "process", "name": "a", "inherits": "b"})
    path = json_file(tmp_path / "b.json", {"type": "process", "name": "b", "inherits": "a"})

    with pytest.raises(ProfileError, match="inherits from itself: b -> a -> b"):
        import_profiles(path)


def test_a_project_holds_all_three(tmp_path: Path) -> None:
    names = {
        "printer_settings_id": "Acme 300", "filament_settings_id": ["Acme PETG"], "print_settings_id": "0.20 Acme",
    }  # fmt: skip
    project = {**COMMON, **MACHINE, **FILAMENT, **PROCESS, **names}
    for key in ("type", "inherits", "name"):
        del project[key]
    path = tmp_path / "plate.3mf"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("Metadata/project_settings.config", json.dumps(project))
    made = imported(path)

    assert {kind: one.name for kind, one in made.items()} == {
        "printer": "Acme 300", "material": "Acme PETG", "quality": "0.20 Acme",
    }  # fmt: skip
    assert made["quality"].values["extrusion_width"] == 0.44
    assert loaded(made, tmp_path).printer.bed_x == 300


@pytest.mark.parametrize("begin", ["; CONFIG_BLOCK_START", "; HEADER"])
def test_settings_in_its_gcode_are_found(tmp_path: Path, begin: str) -> None:
    settings = {**COMMON, **MACHINE, **FILAMENT, **PROCESS}
    lines = [
        f"; {key} = {','.join(value) if isinstance(value, list) else str(value).replace(chr(10), chr(92) + 'n')}"
        for key, value in settings.items()
        if key not in ("type", "inherits", "name")
    ]
    path = tmp_path / "plate.gcode"
    end = "; CONFIG_BLOCK_END" if "CONFIG" in begin else ""
    path.write_text("\n".join([begin, *lines, end, "G28", "G1 X1 E1", ""]), encoding="utf-8")
    made = imported(path)

    assert made["printer"].values["max_speed_x"] == 400
    assert made["printer"].values["layer_gcode"] == ";at {layer_z}"
    assert made["material"].values["nozzle_temperature"] == 238
    assert made["quality"].values["perimeters"] == 3


def test_a_preset_without_a_name_reports_settings_without_equivalent(tmp_path: Path) -> None:
    path = json_file(
        tmp_path / "a.json",
        {"type": "process", "layer_height": "0.2", "reduce_infill_retraction": "1", "x": {"y": 1}},
    )
    (made,) = import_profiles(path, ImportRequest())

    assert isinstance(made, ImportedProfile)
    assert [one.theirs for one in made.left if not one.off and one.theirs != "type"] == [
        "reduce_infill_retraction"
    ]


@pytest.mark.parametrize("begin", ["", "; filament start gcode\n", ";;; a ; b\n"])
def test_gcode_of_a_filament_may_begin_with_a_remark(tmp_path: Path, begin: str) -> None:
    own = {"enable_pressure_advance": ["0"], "filament_start_gcode": [f"{begin}M900 K0.07\nM106 P3 S200\n"]}
    made = imported(json_file(tmp_path / "a.json", FILAMENT | own))["material"]

    assert made.values["pressure_advance"] == 0.07
    assert "add M106 P3 S200 to the printer" in made.notes[0].text


@pytest.mark.parametrize("others", ["", ';"; the second\\nM900 K0.4\\n"'])
def test_gcode_of_a_filament_in_its_gcode_may_begin_with_a_remark(tmp_path: Path, others: str) -> None:
    text = f'"; filament start gcode\\nSET_PRESSURE_ADVANCE ADVANCE=0.035\\n"{others}'
    settings = {
        "printable_area": "0x0,350x0,350x350,0x350",
        "nozzle_temperature": "220",
        "layer_height": "0.2",
    }
    lines = [f"; {key} = {value}" for key, value in (settings | {"filament_start_gcode": text}).items()]
    path = tmp_path / "plate.gcode"
    path.write_text("\n".join(["; CONFIG_BLOCK_START", *lines, "; CONFIG_BLOCK_END", ""]), encoding="utf-8")

    assert imported(path)["material"].values["pressure_advance"] == 0.035


def process(folder: Path, **own: str) -> ImportedProfile:
    return imported(json_file(folder / "process.json", PROCESS | own))["quality"]


def test_small_perimeters_are_those_that_it_says(tmp_path: Path) -> None:
    none, some = (
        process(tmp_path, small_perimeter_threshold=radius).values["speeds"]["small_perimeter_radius"]
        for radius in ("0", "5")
    )

    assert (none, some) == (0, 5)


@pytest.mark.parametrize(
    ("threshold", "ratios"),
    [("95%", (1, 0, 0, 0)), ("50%", (1, 1, 1, 0)), ("25%", (1, 1, 1, 1)), ("0%", (1, 1, 1, 1))],
)
def test_the_fan_runs_on_overhangs_from_its_threshold_on(
    tmp_path: Path, threshold: str, ratios: tuple[int, ...]
) -> None:
    own = {"overhang_fan_threshold": [threshold], "overhang_fan_speed": ["90"]}
    made = imported(json_file(tmp_path / "a.json", FILAMENT | own))["material"]

    assert tuple(made.values[f"fan_overhang_{share}_ratio"] for share in (0, 25, 50, 75)) == ratios
    assert made.values["fan_ratio_bridge"] == 0.9
    assert "overhang_fan_threshold" not in {one.theirs for one in made.left}


def test_a_fan_that_bridges_do_not_change_is_left_alone(tmp_path: Path) -> None:
    own = {"enable_overhang_bridge_fan": ["0"], "overhang_fan_speed": ["90"]}

    assert (
        imported(json_file(tmp_path / "a.json", FILAMENT | own))["material"].values["fan_ratio_bridge"] == 0
    )


def test_scarf_seams_are_taken(tmp_path: Path) -> None:
    own = {
        "seam_slope_type": "all", "seam_slope_min_length": "12", "seam_slope_start_height": "30%",
        "seam_slope_inner_walls": "1", "seam_slope_steps": "10",
    }  # fmt: skip
    made = process(tmp_path, **own)

    assert (made.values["scarf_length"], made.values["scarf_start"]) == (12, 0.3)
    assert made.values["scarf_inner"] is True
    assert [one.theirs for one in made.left if one.theirs.startswith("seam")] == ["seam_slope_steps"]
    assert process(tmp_path, **own | {"seam_slope_entire_loop": "1"}).values["scarf_length"] == 100
    assert "scarf_length" not in process(tmp_path, **own | {"seam_slope_type": "none"}).values


def test_contoured_tops_are_taken(tmp_path: Path) -> None:
    own = {
        "zaa_enabled": "1", "zaa_min_z": "0.3",
        "zaa_minimize_perimeter_height": "35", "zaa_dont_alternate_fill_direction": "1",
    }  # fmt: skip
    made = process(tmp_path, **own)

    assert (made.values["z_contouring"], made.values["contour_min_height"]) == (True, 0.2)
    assert {one.theirs for one in made.left if one.theirs.startswith("zaa")} == {
        "zaa_minimize_perimeter_height",
        "zaa_dont_alternate_fill_direction",
    }
    assert process(tmp_path, zaa_enabled="1").values["contour_min_height"] == 0.05
    off = process(tmp_path, **own | {"zaa_enabled": "0"})
    assert "z_contouring" not in off.values
    assert not [one for one in off.left if one.theirs.startswith("zaa")]


def test_missing_settings_have_the_defaults_of_orcaslicer(tmp_path: Path) -> None:
    machine = imported(json_file(tmp_path / "m.json", {"type": "machine", "nozzle_diameter": ["0.4"]}))
    quality = imported(json_file(tmp_path / "q.json", {"type": "process", "layer_height": "0.2"}))["quality"]
    printer = machine["printer"].values

    assert (printer["bed_z"], printer["retract_length"], printer["retract_speed"]) == (100, 0.8, 30)
    assert (quality.values["perimeters"], quality.values["thick_bridges"]) == (2, False)
    assert (quality.values["skirt_distance"], quality.values["solid_infill_below_area"]) == (2, 15)
    assert quality.values["speeds"]["internal_bridge"] == 37.5
    assert quality.values["accelerations"]["bridge"] == 250


def test_the_first_of_several_filaments_is_imported(tmp_path: Path) -> None:
    own = {"filament_type": ["PLA", "PETG"], "nozzle_temperature": ["215", "240"]}
    made = imported(json_file(tmp_path / "a.json", FILAMENT | own))["material"]

    assert (made.values["type"], made.values["nozzle_temperature"]) == ("PLA", 215)
    assert "PETG is not" in made.notes[0].text


def test_its_macros_may_speak_of_pressure_advance(tmp_path: Path) -> None:
    write(tmp_path)
    own = {"machine_start_gcode": "SET_PRESSURE_ADVANCE ADVANCE={pressure_advance[0]}\nM109 S200\nM190 S60"}
    made = imported(json_file(tmp_path / "machine.json", MACHINE | own))["printer"]

    assert made.values["start_gcode"].splitlines()[0] == "SET_PRESSURE_ADVANCE ADVANCE={pressure_advance[0]}"


@needs_proc
def test_a_base_that_cannot_be_read_is_named_and_not_the_file_that_builds_on_it(tmp_path: Path) -> None:
    base = unreadable(tmp_path / "acme_common.json")
    with pytest.raises(ProfileError) as caught:
        import_profiles(json_file(tmp_path / "machine.json", MACHINE))

    assert (
        str(caught.value) == f"{base}: cannot be read: Input/output error\n  Check its name and permissions"
    )


def test_solid_infill_has_an_overlap_of_its_own(tmp_path: Path) -> None:
    quality = process(tmp_path, infill_wall_overlap="12%", top_bottom_infill_wall_overlap="30%").values

    assert (quality["internal_infill_overlap"], quality["infill_overlap"]) == (0.12, 0.3)


def test_outer_walls_keep_their_width(tmp_path: Path) -> None:
    quality = process(tmp_path, inner_wall_line_width="0.45", outer_wall_line_width="0.42").values

    assert (quality["extrusion_width"], quality["external_perimeter_width"]) == (0.45, 0.42)


@pytest.mark.parametrize(
    ("given", "areas"),
    [
        (["0x0", "18x0", "18x28", "0x28"], ("0x0 18x0 18x28 0x28",)),
        (
            ["0x0", "9x0", "9x8", "0x8", "50x0", "60x0", "60x5", "50x5"],
            ("0x0 9x0 9x8 0x8", "50x0 60x0 60x5 50x5"),
        ),
        (["0x0", "20x0", "30x10", "20x20", "0x20"], ("0x0 20x0 30x10 20x20 0x20",)),
        (["0x0"], ()),
        ([], ()),
    ],
)
def test_areas_that_the_bed_excludes_are_imported(
    tmp_path: Path, given: list[str], areas: tuple[str, ...]
) -> None:
    json_file(tmp_path / "acme_common.json", COMMON)
    path = json_file(tmp_path / "machine.json", MACHINE | {"bed_exclude_area": given})

    assert loaded(imported(path), tmp_path).printer.excluded_areas == areas
