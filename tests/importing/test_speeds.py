"""Import of speeds, accelerations, flow, fan heights and the firmware flavour."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.importing.files import flat_file, imported, json_file, loaded


def test_gaps_supports_and_the_first_layers_infill_have_their_speeds(tmp_path: Path) -> None:
    path = flat_file(
        tmp_path,
        gap_fill_speed="22",
        support_material_speed="44",
        support_material_interface_speed="75%",
        first_layer_infill_speed="31",
    )
    speeds = loaded(imported(path), tmp_path).speeds

    assert (speeds.gap_fill, speeds.support, speeds.support_interface) == (22, 44, 33)
    assert (speeds.first_layer, speeds.first_layer_infill) == (21, 31)


def test_a_first_layer_in_percent_is_of_each_role(tmp_path: Path) -> None:
    speeds = loaded(imported(flat_file(tmp_path, first_layer_speed="50%")), tmp_path).speeds

    assert (speeds.first_layer, speeds.first_layer_infill) == (24, 30)


def test_one_first_layer_speed_is_for_all_of_it(tmp_path: Path) -> None:
    speeds = loaded(imported(flat_file(tmp_path)), tmp_path).speeds

    assert (speeds.first_layer, speeds.first_layer_infill) == (21, 21)
    assert speeds.first_layer_travel == speeds.travel == 160


def test_orca_names_them_too(tmp_path: Path) -> None:
    path = json_file(
        tmp_path / "process.json",
        {
            "type": "process",
            "name": "quick",
            "gap_infill_speed": "120",
            "support_speed": "90",
            "support_interface_speed": "60",
            "initial_layer_speed": "40",
            "initial_layer_infill_speed": "90",
            "travel_speed": "300",
            "initial_layer_travel_speed": "50%",
        },
    )
    speeds = loaded(imported(path), tmp_path).speeds

    assert (speeds.gap_fill, speeds.support, speeds.support_interface) == (120, 90, 60)
    assert (speeds.first_layer, speeds.first_layer_infill, speeds.first_layer_travel) == (40, 90, 150)


def test_the_default_acceleration_applies_to_roles_without_one(tmp_path: Path) -> None:
    path = flat_file(
        tmp_path,
        machine_max_acceleration_x="5000",
        machine_max_acceleration_y="5000",
        machine_max_acceleration_extruding="1250",
        default_acceleration="1000",
        perimeter_acceleration="800",
        infill_acceleration="1200",
        bridge_acceleration="700",
        first_layer_acceleration="600",
    )
    hard = loaded(imported(path), tmp_path).accelerations

    assert (hard.default, hard.overhang) == (1000, 1000)
    assert (hard.perimeter, hard.internal_infill, hard.bridge, hard.first_layer) == (800, 1200, 700, 600)


@pytest.mark.parametrize(
    ("first", "height", "off"), [("0.2", "0.15", 0.5), ("0.25", "0.2", 0.65), ("0", "0.3", 0.9)]
)
def test_layers_without_fan_are_as_high_as_the_quality_says(
    tmp_path: Path, first: str, height: str, off: float
) -> None:
    path = flat_file(
        tmp_path,
        layer_height=height,
        first_layer_height=first,
        disable_fan_first_layers="3",
        full_fan_speed_layer="5",
    )
    material = imported(path)["material"]

    assert material.values["fan_off_below"] == pytest.approx(off)
    assert material.values["fan_full_above"] == pytest.approx(off + 2 * float(height))
    taken = {one.ours: one.how for one in material.taken}
    assert height in taken["fan_off_below"]


def test_layers_without_fan_are_guessed_where_no_quality_comes_with_the_material(tmp_path: Path) -> None:
    path = tmp_path / "filament.ini"
    path.write_text("[filament:alone]\ndisable_fan_first_layers = 3\ntemperature = 200\n", encoding="utf-8")
    material = imported(path)["material"]

    assert material.values["fan_off_below"] == pytest.approx(0.6)
    assert {one.ours: one.how for one in material.taken}["fan_off_below"] == "layers of 0.2 mm each"


def test_no_limit_of_flow_leaves_it_to_the_hotend(tmp_path: Path) -> None:
    made = imported(flat_file(tmp_path, filament_max_volumetric_speed="0"))
    profile = loaded(made, tmp_path)

    assert profile.material.max_flow == 0
    assert profile.max_flow == 12
    assert "hotend_max_flow" in {one.ours: one.how for one in made["material"].taken}["max_flow"]


def test_a_marlin_file_with_macros_of_klipper_is_for_klipper_and_says_so(tmp_path: Path) -> None:
    path = flat_file(
        tmp_path,
        gcode_flavor="marlin",
        start_gcode="print_start EXTRUDER=[first_layer_temperature] BED=[first_layer_bed_temperature]\\n",
        end_gcode="print_end    ;end script from macro\\n",
    )
    printer = imported(path)["printer"]

    assert printer.values["flavour"] == "klipper"
    assert any("print_start" in note.text and "Klipper" in note.text for note in printer.notes)
    assert "print_start" in {one.ours: one.how for one in printer.taken}["flavour"]


def test_old_marlin_is_reported(tmp_path: Path) -> None:
    printer = imported(flat_file(tmp_path, gcode_flavor="marlin"))["printer"]

    assert printer.values["flavour"] == "marlin_legacy"
    assert "Marlin 1.1" in {one.ours: one.how for one in printer.taken}["flavour"]


@pytest.mark.parametrize("flavour", ["reprap", "reprapfirmware"])
def test_a_macro_tells_klipper_from_the_oldest_firmware_only(tmp_path: Path, flavour: str) -> None:
    printer = loaded(
        imported(flat_file(tmp_path, gcode_flavor=flavour, start_gcode="START_PRINT EXTRUDER_TEMP=200")),
        tmp_path,
    ).printer

    assert printer.flavour == ("klipper" if flavour == "reprap" else "reprapfirmware")


def test_a_printer_has_the_speeds_flow_and_pressure_advance_that_come_with_it(tmp_path: Path) -> None:
    path = flat_file(
        tmp_path,
        infill_acceleration="650",
        enable_dynamic_overhang_speeds="1",
        overhang_speed_1="50%",
        filament_max_volumetric_speed="17",
        start_filament_gcode="M900 K0.043",
    )
    made = imported(path)
    printer = loaded({"printer": made["printer"]}, tmp_path).printer

    own = loaded(made, tmp_path).speeds
    assert printer.speeds.external_perimeter == own.external_perimeter == 24
    assert (printer.speeds.travel, printer.speeds.first_layer) == (own.travel, own.first_layer)
    assert printer.speeds.overhang_25 == 12
    assert printer.accelerations.internal_infill == 650
    assert (printer.hotend_max_flow, printer.pla_pressure_advance) == (17, 0.043)


def test_a_quality_of_ours_prints_as_fast_on_an_imported_printer_as_its_own(tmp_path: Path) -> None:
    made = imported(flat_file(tmp_path, perimeter_speed="120", infill_speed="180", travel_speed="250"))
    ours = loaded({"printer": made["printer"]}, tmp_path).speeds

    assert (ours.perimeter, ours.internal_infill, ours.travel) == (120, 180, 250)


def test_materials_other_than_pla_do_not_set_the_maximum_flow(tmp_path: Path) -> None:
    made = imported(flat_file(tmp_path, filament_type="TPU", filament_max_volumetric_speed="3"))

    assert "hotend_max_flow" not in made["printer"].values


def test_a_printer_of_a_bundle_has_the_speeds_of_its_usual_print_settings(tmp_path: Path) -> None:
    path = tmp_path / "Acme.ini"
    path.write_text(
        "[vendor]\nname = Acme\n[print:Slow]\nperimeter_speed = 31\n[print:Usual]\nperimeter_speed = 57\n"
        "[filament:PLA]\nfilament_type = PLA\nfilament_max_volumetric_speed = 13\n"
        "[printer:One]\nprinter_model = One\nbed_shape = 0x0,200x0,200x180,0x180\nnozzle_diameter = 0.4\n"
        "default_print_profile = Usual\ndefault_filament_profile = PLA\n"
    )
    for wanted in ({}, {"printer": "One"}):
        printer = loaded({"printer": imported(path, **wanted)["printer"]}, tmp_path).printer

        assert (printer.speeds.perimeter, printer.hotend_max_flow) == (57, 13)
