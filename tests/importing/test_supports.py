"""Import of the settings of supports from PrusaSlicer, OrcaSlicer and Cura."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from printer_slicer.importing.cura_names import translate_cura
from printer_slicer.importing.cura_values import CuraExpressionError
from printer_slicer.importing.presets import Preset
from printer_slicer.importing.qualities import convert_quality
from tests.importing.files import flat_file, imported, json_file, loaded
from tests.importing.test_cura import LITERALS

PRUSA = {
    "support_material": "1",
    "support_material_style": "snug",
    "support_material_threshold": "35",
    "dont_support_bridges": "0",
    "support_material_contact_distance": "0.15",
    "support_material_bottom_contact_distance": "0.25",
    "support_material_xy_spacing": "0.6",
    "support_material_synchronize_layers": "1",
    "support_material_interface_layers": "4",
    "support_material_interface_spacing": "0.3",
    "support_material_spacing": "2",
    "support_material_with_sheath": "1",
    "support_material_closing_radius": "1.5",
    "support_material_buildplate_only": "1",
    "raft_first_layer_expansion": "4",
    "support_tree_angle": "50",
    "support_tree_angle_slow": "20",
    "support_tree_branch_diameter": "3",
    "support_tree_branch_diameter_angle": "6",
    "support_tree_tip_diameter": "0.7",
}
OURS = {
    "support": "columns",
    "support_threshold_deg": 35,
    "support_max_bridge": 0,
    "support_gap": 0.15,
    "support_bottom_gap": 0.25,
    "support_xy_gap": 0.6,
    "support_synchronize_layers": True,
    "support_interface_layers": 4,
    "support_interface_spacing": 0.3,
    "support_spacing": 2.45,  # from line to line; lines are 0.45 mm wide
    "support_walls": 1,
    "support_closing": 1.5,
    "support_on_bed_only": True,
    "support_first_layer_expansion": 4,
    "support_tree_angle_deg": 50,
    "support_tree_slow_angle_deg": 20,
    "support_branch_diameter": 3,
    "support_branch_growth_deg": 6,
    "support_tip_diameter": 0.7,
}
ORCA = {
    "enable_support": "1",
    "support_type": "normal(auto)",
    "support_style": "default",
    "support_threshold_angle": "35",
    "bridge_no_support": "0",
    "support_top_z_distance": "0.15",
    "support_bottom_z_distance": "0.25",
    "support_object_xy_distance": "0.6",
    "independent_support_layer_height": "0",
    "support_interface_top_layers": "4",
    "support_interface_spacing": "0.3",
    "support_base_pattern_spacing": "2",
    "support_on_build_plate_only": "1",
    "raft_first_layer_expansion": "4",
    "tree_support_branch_angle": "50",
    "tree_support_angle_slow": "20",
    "tree_support_branch_diameter": "3",
    "tree_support_branch_diameter_angle": "6",
    "tree_support_tip_diameter": "0.7",
}


def own(values: dict[str, Any]) -> dict[str, Any]:
    """The settings of supports among the values of a quality."""
    return {key: value for key, value in values.items() if key.startswith("support")}


def test_prusaslicer(tmp_path: Path) -> None:
    made = imported(flat_file(tmp_path, **PRUSA))
    quality = loaded(made, tmp_path).quality

    assert own(made["quality"].values) == OURS
    assert {key: getattr(quality, key) for key in OURS} == OURS
    assert not [one for one in made["quality"].left if "support" in one.theirs]


def test_orcaslicer(tmp_path: Path) -> None:
    process = {"type": "process", "name": "process", "inner_wall_line_width": "0.45", **ORCA}
    made = imported(json_file(tmp_path / "process.json", process))["quality"]

    assert own(made.values) == {
        key: value for key, value in OURS.items() if key not in ("support_walls", "support_closing")
    }
    assert not [one for one in made.left if "support" in one.theirs]


@pytest.mark.parametrize(("speed", "ratio"), [("70", 0.7), ("0", 0), ("-1", None)])
def test_the_fan_on_interfaces(speed: str, ratio: float | None, tmp_path: Path) -> None:
    filament = {"type": "filament", "name": "pla", "support_material_interface_fan_speed": [speed]}
    made = imported(json_file(tmp_path / "pla.json", filament))["material"]

    assert made.values.get("support_fan") == ratio


@pytest.mark.parametrize(
    ("changes", "style"),
    [
        ({"support_material": "0"}, None),
        ({"support_material_style": "grid"}, "columns"),
        ({"support_material_style": "organic"}, "tree"),
        ({"support_material_style": None}, "auto"),
        ({"support_material_auto": "0"}, "columns"),
    ],
    ids=str,
)
def test_styles_of_prusaslicer(changes: dict[str, str | None], style: str | None, tmp_path: Path) -> None:
    made = imported(flat_file(tmp_path, **(PRUSA | changes)))["quality"]

    assert made.values.get("support") == style
    assert made.values.get("support_places") == ("enforced" if "support_material_auto" in changes else None)


@pytest.mark.parametrize(
    ("kind", "style", "expected"),
    [
        ("tree(auto)", "default", "tree"),
        ("tree(auto)", "tree_hybrid", "tree"),
        ("normal(auto)", "snug", "columns"),
        ("tree(manual)", "tree_slim", "tree"),
        ("hybrid(auto)", "default", "auto"),
    ],
)
def test_styles_of_orcaslicer(kind: str, style: str, expected: str, tmp_path: Path) -> None:
    process = {"type": "process", "name": "process", **ORCA, "support_type": kind, "support_style": style}
    made = imported(json_file(tmp_path / "process.json", process))["quality"]

    assert made.values["support"] == expected
    assert made.values.get("support_places") == ("enforced" if "manual" in kind else None)


def test_values_that_refer_to_others(tmp_path: Path) -> None:
    changes = {
        "support_material_threshold": "0",
        "support_material_bottom_contact_distance": "0",
        "support_material_xy_spacing": "60%",
        "dont_support_bridges": "1",
        "external_perimeter_extrusion_width": "0.5",
        "layer_height": "0.225",
    }
    made = imported(flat_file(tmp_path, **(PRUSA | changes)))["quality"].values

    assert made["support_threshold_deg"] == 45  # half of 0.45 mm beyond the layer below
    assert made["support_bottom_gap"] == made["support_gap"]
    assert made["support_xy_gap"] == 0.3
    assert made["support_max_bridge"] == 10


def test_settings_are_imported_also_if_supports_are_off(tmp_path: Path) -> None:
    made = imported(flat_file(tmp_path, **(PRUSA | {"support_material": "0"})))
    quality = loaded(made, tmp_path).quality

    assert quality.support == "off"
    assert quality.support_gap == 0.15


CURA = {
    "support_enable": True,
    "support_structure": "tree",
    "support_type": "buildplate",
    "support_angle": 50,
    "support_top_distance": 0.15,
    "support_bottom_distance": 0.1,
    "support_xy_distance": 0.7,
    "support_line_distance": 2.6,
    "support_wall_count": 1,
    "support_join_distance": 2,
    "minimum_support_area": 3,
    "support_roof_enable": True,
    "support_roof_height": 0.8,
    "support_roof_line_distance": 0.6,
    "support_roof_line_width": 0.4,
    "support_tree_angle": 40,
    "support_tree_branch_diameter": 2,
    "support_tree_branch_diameter_angle": 5,
}


def cura(**changes: Any) -> dict[str, Any]:
    """The settings of supports here, for those of a definition of Cura whose other numbers are all 50."""
    known: dict[str, Any] = {**LITERALS, "wall_line_width_x": 0.4, "infill_pattern": "grid", **changes}

    def get(key: str) -> Any:
        if "support" in key and key not in known:
            raise CuraExpressionError(key)
        return known.get(key, 50)

    entries = translate_cura(get, lambda key: key)
    return own(dict(convert_quality(Preset("quality", "test", "cura", "test", entries)).values))


def test_cura() -> None:
    assert cura(**CURA) == {
        "support": "tree",
        "support_threshold_deg": 40,
        "support_gap": 0.15,
        "support_bottom_gap": 0.1,
        "support_xy_gap": 0.7,
        "support_spacing": 2.6,
        "support_walls": 1,
        "support_closing": 1,
        "support_min_area": 3,
        "support_on_bed_only": True,
        "support_interface_layers": 4,
        "support_interface_spacing": 0.2,
        "support_tree_angle_deg": 40,
        "support_branch_diameter": 2,
        "support_branch_growth_deg": 5,
    }


def test_cura_without_an_interface() -> None:
    found = cura(
        **CURA | {"support_roof_enable": False, "support_line_distance": 0, "support_structure": "normal"}
    )

    assert found["support_interface_layers"] == 0
    assert found["support"] == "columns"
    assert "support_interface_spacing" not in found
    assert "support_spacing" not in found
    assert cura() == {}
