"""Cura's definitions, their expressions, and profiles that change them."""

from __future__ import annotations

import json
import math
import zipfile
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from printer_slicer import bead
from printer_slicer.errors import ProfileError
from printer_slicer.importing import ImportRequest, import_profiles
from printer_slicer.importing.cura_values import CuraExpressionError, evaluate_cura
from printer_slicer.importing.ini import FILE_REMEDY
from tests.importing.files import imported, json_file, loaded, needs_proc, refused, unreadable

LITERALS: dict[str, Any] = {
    "machine_width": 200, "machine_depth": 210, "machine_height": 220, "machine_center_is_zero": False,
    "machine_shape": "rectangular", "machine_gcode_flavor": "RepRap (Marlin/Sprinter)", "machine_heated_bed": True,
    "machine_nozzle_size": 0.4, "machine_start_gcode": "G28\nG1 Y{machine_depth}\nG1 E5",
    "machine_end_gcode": "M104 S0 ; {material_print_temperature}", "machine_max_feedrate_x": 299792458000,
    "machine_max_feedrate_y": 350, "machine_max_feedrate_z": 299792458000, "machine_max_feedrate_e": 45,
    "machine_max_acceleration_x": 3000, "machine_acceleration": 1500, "machine_max_jerk_xy": 12,
    "acceleration_enabled": False, "retraction_amount": 4.5, "retraction_enable": True, "retraction_hop": 0.4,
    "retraction_hop_enabled": False, "retraction_retract_speed": 41, "material_flow": 97, "cool_fan_enabled": True,
    "cool_fan_speed_0": 0, "cool_fan_full_layer": 3, "material_bed_temperature": 55,
    "infill_sparse_density": 20, "infill_overlap": 10, "z_seam_type": "back", "initial_layer_line_width_factor": 125,
    "ironing_flow": 10, "retraction_combing": "all", "xy_offset": 0, "xy_offset_layer_0": -0.1,
    "adhesion_type": "skirt",
    "skirt_line_count": 2, "brim_width": 8, "layer_height": 0.2, "material_print_temperature": 203,
}  # fmt: skip
EXPRESSIONS = {
    "layer_height_0": "resolveOrValue('layer_height') * 1.5",
    "material_print_temperature_layer_0": "material_print_temperature + 7",
    "material_bed_temperature_layer_0": "max(extruderValues('material_bed_temperature'))",
    "cool_fan_speed_max": "100.0 if cool_fan_enabled else 0.0",
    "cool_fan_speed_min": "cool_fan_speed_max / 2",
    "wall_line_width_0": "machine_nozzle_size",
    "infill_line_width": "machine_nozzle_size",
    "wall_line_width_x": "wall_line_width_0 * 1.1",
    "wall_line_count": "max(1, round(1.2 / wall_line_width_0))",
    "infill_pattern": "'lines' if infill_sparse_density > 25 else 'grid'",
    "top_layers": "0 if infill_sparse_density == 100 else math.ceil(round(0.8 / layer_height, 4))",
    "bottom_layers": "top_layers",
    "speed_print": "60",
    "speed_wall_x": "speed_print * 0.75",
    "speed_wall_0": "speed_wall_x / 1.5",
    "speed_infill": "speed_print",
    "speed_topbottom": "not_understood(speed_print)",
    "speed_travel": "150.0 if speed_print < 60 else 250.0 if speed_print > 100 else speed_print * 2.5",
    "speed_print_layer_0": "speed_print / 3",
}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Write a definition that inherits from a base, and its extruder."""
    settings = {key: {"type": "x", "default_value": value} for key, value in LITERALS.items()}
    settings |= {
        key: {"type": "float", "default_value": 33, "value": text} for key, text in EXPRESSIONS.items()
    }
    group = {"type": "category", "children": settings}
    json_file(tmp_path / "fdmbase.def.json", {"version": 2, "name": "base", "settings": {"all": group}})
    machine = {
        "version": 2,
        "name": "Acme Mini",
        "inherits": "fdmbase",
        "metadata": {"machine_extruder_trains": {"0": "acme_extruder"}},
        "overrides": {
            "machine_width": {"default_value": 180},
            "speed_print": {"value": "80"},
            "retraction_amount": {"default_value": 5},
        },
    }
    json_file(tmp_path / "acme.def.json", machine)
    extruder = {"version": 2, "overrides": {"machine_nozzle_size": {"default_value": 0.6}}}
    json_file(tmp_path / "acme_extruder.def.json", extruder)
    return tmp_path


def test_a_machine_is_imported_with_the_settings_it_inherits(folder: Path) -> None:
    profile = loaded(imported(folder / "acme.def.json"), folder)
    printer, material, quality = profile.printer, profile.material, profile.quality

    assert (printer.name, printer.corners, printer.bed_z) == ("Acme Mini", ((0, 0), (180, 210)), 220)
    assert (printer.nozzle_diameter, printer.retract_length, printer.retract_speed) == (0.6, 5, 41)
    assert (printer.max_speed_x, printer.max_speed_y, printer.acceleration) == (500, 350, 1500)
    assert (material.nozzle_temperature, material.first_layer_nozzle_temperature) == (203, 210)
    assert (material.first_layer_bed_temperature, material.flow_ratio) == (55, 0.97)
    assert (material.fan_ratio, material.fan_ratio_max, material.fan_off_below) == (0.5, 1, 0.3)
    assert (quality.layer_height, quality.first_layer_height, quality.perimeters) == (0.2, 0.3, 2)
    assert (quality.extrusion_width, quality.first_layer_width) == (0.66, 0.75)
    assert (quality.speeds.perimeter, quality.speeds.external_perimeter, quality.speeds.internal_infill) == (
        60,
        40,
        80,
    )
    assert (quality.speeds.travel, quality.speeds.solid_infill) == (200, 33)
    assert (quality.infill, quality.seam, quality.skirt_loops, quality.brim_width) == ("grid", "rear", 2, 0)
    assert (quality.elephant_foot, quality.top_thickness) == (0.1, 0.8)


@pytest.mark.parametrize(("percent", "walls", "mm"), [("20", "3", 0.126), ("20", "1", 0.12), ("0", "3", 0.0)])
def test_the_overlap_of_infill_is_a_share_of_the_mean_width_of_infill_and_wall(
    folder: Path, percent: str, walls: str, mm: float
) -> None:
    changes = {"infill_overlap": percent, "wall_line_count": walls}
    quality = imported(folder / "acme.def.json", cura=changes)["quality"].values

    spacing = float(bead.spacing(quality["extrusion_width"], quality["layer_height"]))
    assert quality["internal_infill_overlap"] * spacing == pytest.approx(mm, abs=1e-4)


def test_it_heats_before_its_start_gcode_as_the_source_does(folder: Path) -> None:
    text = str(imported(folder / "acme.def.json")["printer"].values["start_gcode"]).splitlines()

    assert text.index("M109 S{first_layer_temperature[0]}") < text.index("G28")
    assert "G1 Y{machine_depth}" in text


def test_changes_affect_dependent_settings(folder: Path) -> None:
    changes = {
        "layer_height": "0.1",
        "speed_print": "=40 * 2.5",
        "adhesion_type": "brim",
        "cool_fan_enabled": "False",
    }
    made = imported(folder / "acme.def.json", cura=changes)

    assert made["quality"].values["first_layer_height"] == 0.15
    assert made["quality"].values["speeds"]["perimeter"] == 75
    assert made["quality"].values["brim_width"] == 8
    assert made["material"].values["fan_ratio_max"] == 0
    with pytest.raises(ProfileError, match="layer_hight: Cura has no such setting"):
        import_profiles(folder / "acme.def.json", ImportRequest(cura={"layer_hight": "1"}))


PROFILE = (
    "[general]\nversion = 4\nname = fine\ndefinition = acme\n\n[metadata]\ntype = quality\n\n"
    "[values]\nlayer_height = 0.15\nspeed_print = =100\n"
)


def test_profiles_change_the_machine_that_they_name(folder: Path, tmp_path: Path) -> None:
    elsewhere = tmp_path / "mine"
    elsewhere.mkdir()
    plain, packed = elsewhere / "fine.inst.cfg", elsewhere / "fine.curaprofile"
    plain.write_text(PROFILE, encoding="utf-8")
    with zipfile.ZipFile(packed, "w") as archive:
        archive.writestr("fine", PROFILE)

    with pytest.raises(ProfileError, match="its machine 'acme' is not in the same folder"):
        import_profiles(plain)
    for path in (plain, packed):
        made = imported(path, folders=(folder,))
        values = made["quality"].values
        assert (values["layer_height"], values["speeds"]["internal_infill"]) == (0.15, 100)
        assert [made[kind].name for kind in ("printer", "material", "quality")] == [
            "Acme Mini", "fine material", "fine",
        ]  # fmt: skip


@pytest.mark.parametrize("value", ["__import__('os')", "=__import__('os')", "wide"])
def test_an_error_names_the_file_with_the_invalid_value(folder: Path, value: str) -> None:
    path = folder / "bad.inst.cfg"
    path.write_text(PROFILE.replace("0.15", value), encoding="utf-8")
    try:
        problem = refused(path, "quality").problem
    except ProfileError as error:
        problem = str(error)

    assert f"{path}:10: layer_height" in problem


def test_a_bed_of_no_size_is_refused_as_it_was_typed(folder: Path) -> None:
    with pytest.raises(ProfileError, match="--cura machine_width=-5: machine_width: the bed size is -5"):
        import_profiles(folder / "acme.def.json", ImportRequest(cura={"machine_width": "-5"}))


def test_a_machine_that_measures_its_bed_as_those_of_prusa_is_one(folder: Path) -> None:
    for text, flavour in (("G28\nG80\nG1 Z5", "prusa"), ("G28\nG29\nG1 Z5", "marlin_legacy")):
        made = imported(folder / "acme.def.json", cura={"machine_start_gcode": text})["printer"]
        assert made.values["flavour"] == flavour


@pytest.mark.parametrize(
    ("key", "value"), [("material_flow", "much"), ("machine_width", []), ("ironing_flow", None)]
)
def test_a_value_that_nothing_can_be_made_of_is_named_and_can_be_changed(
    folder: Path, key: str, value: object
) -> None:
    machine = {"version": 2, "inherits": "fdmbase", "overrides": {key: {"default_value": value}}}
    path = json_file(folder / "bad.def.json", machine)
    with pytest.raises(ProfileError) as caught:
        import_profiles(path)

    assert str(caught.value) == (f"{path}: {key}: invalid value\n  Change it with --cura {key}=VALUE")
    assert imported(path, cura={key: "100"})


def test_a_definition_that_is_not_a_machine_is_an_error(tmp_path: Path) -> None:
    path = json_file(tmp_path / "part.def.json", {"version": 2, "overrides": {}})
    with pytest.raises(ProfileError) as caught:
        import_profiles(path)

    assert str(caught.value) == (
        f"{path}: machine_width is not a setting of this machine\n"
        "  Import the definition of a machine, not one that others inherit from"
    )


def test_circular_inheritance_is_reported_in_order(folder: Path) -> None:
    first, second = folder / "first.def.json", folder / "second.def.json"
    json_file(first, {"version": 2, "inherits": "second", "overrides": {}})
    json_file(second, {"version": 2, "inherits": "first", "overrides": {}})
    with pytest.raises(ProfileError) as caught:
        import_profiles(first)

    assert str(caught.value) == (
        f"{second}: inherits from itself: first.def.json -> second.def.json -> first.def.json\n"
        "  Change one `inherits` in this chain"
    )


def test_a_definition_is_inherited_only_from_the_folders_that_are_looked_into(folder: Path) -> None:
    (folder / "below").mkdir()
    path = json_file(folder / "below" / "it.def.json", {"version": 2, "inherits": "../acme", "overrides": {}})
    with pytest.raises(ProfileError) as caught:
        import_profiles(path)

    assert str(caught.value) == (
        f"{path}: inherits '../acme', but ../acme.def.json is not in the same folder\n"
        "  Give the folder of Cura's definitions with --folder FOLDER"
    )


def test_a_base_that_is_far_too_large_is_not_read(folder: Path) -> None:
    base = folder / "fdmbase.def.json"
    with base.open("r+b") as file:
        file.truncate(50_000_001)
    with pytest.raises(ProfileError) as caught:
        import_profiles(folder / "acme.def.json")

    assert str(caught.value) == (f"{base}: over 50 MB, too large for a settings file\n  {FILE_REMEDY}")


@needs_proc
def test_a_base_that_cannot_be_read_is_named_and_not_the_file_that_builds_on_it(folder: Path) -> None:
    base = unreadable(folder / "fdmbase.def.json")
    with pytest.raises(ProfileError) as caught:
        import_profiles(folder / "acme.def.json")

    assert (
        str(caught.value) == f"{base}: cannot be read: Input/output error\n  Check its name and permissions"
    )


def setting(name: str) -> Any:
    values = {"a": 3, "b": 0.5, "c": "grid", "on": True, "items": [1, 2, 3]}
    if name not in values:
        raise CuraExpressionError(f"{name} is no setting")
    return values[name]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("a + b * 2", 4),
        ("1 if c == 'grid' else 2", 1),
        ("math.ceil(round(0.8 / 0.3, 4)) + math.floor(2.7)", 5),
        ("max(a, 7)", 7),
        ("sum(map(int, [1.5, 2.5]))", 3),
        ("any(extruderValues('on')) and not False", True),
        ("'x' in ['x', c] and a in items", True),
        ("items[1] ** 3 % 5", 3),
        ("0 < a <= 3 != 4", True),
        ("a or b", 3),
        ("-a // 2", -2),
        ("defaultExtruderPosition()", 0),
        ("math.tan(math.radians(45)) * math.pi", pytest.approx(math.pi)),
    ],
)
def test_expressions(text: str, expected: Any) -> None:
    assert evaluate_cura(text, setting) == expected


@pytest.mark.parametrize(
    "text",
    [
        "__import__('os').system('true')",
        "().__class__",
        "(lambda: 1)()",
        "[x for x in items]",
        "open('/etc/passwd')",
        "9 ** 9 ** 9",
        "'x' * 10 ** 9",
        "1 / 0",
        "gone",
        "a[0]",
        "max()",
        "items[9]",
        "f'{a}'",
        "a if",
        "(" * 300 + "1" + ")" * 300,
        "1e300 * 1e300",
        "print(1)",
        "a.real",
        "int('9' * 5000)",
    ],
)
def test_other_python_code_is_rejected_and_never_runs(text: str) -> None:
    with pytest.raises(CuraExpressionError):
        evaluate_cura(text, setting)


@given(st.text(alphabet="ab c()[]+-*/%<>=!'.0123456789andorotif elsemxmi,", max_size=60))
def test_any_text_is_a_value_or_refused(text: str) -> None:
    try:
        value = evaluate_cura(text, setting)
    except CuraExpressionError:
        return
    assert isinstance(value, (bool, int, float, str, list, tuple)) or callable(value) is False


def test_disallowed_areas_are_measured_from_the_middle_and_to_the_front(folder: Path) -> None:
    path = folder / "acme.def.json"
    values = json.loads(path.read_text())
    areas = [[[-90, 105], [-60, 105], [-60, 95], [-90, 95]], [[90, -105], [80, -105], [90, -90]]]
    values["overrides"]["machine_disallowed_areas"] = {"default_value": areas}
    base = json.loads((folder / "fdmbase.def.json").read_text())
    base["settings"]["all"]["children"]["machine_disallowed_areas"] = {
        "type": "polygons",
        "default_value": [],
    }
    json_file(folder / "fdmbase.def.json", base)
    assert loaded(imported(path), folder).printer.excluded_areas == ()
    json_file(path, values)

    printer = loaded(imported(path), folder).printer
    assert printer.excluded_areas == ("0x0 30x0 30x10 0x10", "180x210 170x210 180x195")


def test_the_outline_of_the_head_and_the_height_of_the_gantry_are_imported(folder: Path) -> None:
    machine = json.loads((folder / "acme.def.json").read_text())
    head = [[-26, 34], [-26, -32], [32, -32], [32, 34]]
    machine["overrides"] |= {
        "machine_head_with_fans_polygon": {"default_value": head},
        "gantry_height": {"value": "25"},
    }
    json_file(folder / "acme.def.json", machine)
    low, gantry = loaded(imported(folder / "acme.def.json"), folder).printer.head

    assert low == "0: -26x34 -26x-32 32x-32 32x34"
    assert gantry.startswith("25: ")
