"""Settings of SuperSlicer: its percentages, and settings that PrusaSlicer does not have."""

from __future__ import annotations

from pathlib import Path

import pytest

from printer_slicer.importing import ImportedProfile, import_profiles
from printer_slicer.profile import Profile
from tests.importing.files import flat_file, imported, loaded

OWN = {
    "layer_height": "0.2",
    "first_layer_height": "75%",
    "nozzle_diameter": "0.4",
    "default_speed": "100",
    "perimeter_speed": "100%",
    "external_perimeter_speed": "60%",
    "small_perimeter_speed": "50%",
    "small_perimeter_min_length": "6",
    "small_perimeter_max_length": "20",
    "solid_infill_speed": "90%",
    "infill_speed": "120%",
    "top_solid_infill_speed": "50%",
    "bridge_speed": "60%",
    "bridge_speed_internal": "150%",
    "ironing_speed": "20%",
    "support_material_speed": "70%",
    "travel_speed": "180",
    "default_acceleration": "1000",
    "perimeter_acceleration": "80%",
    "external_perimeter_acceleration": "50%",
    "bridge_acceleration": "40%",
    "infill_acceleration": "90%",
    "solid_infill_acceleration": "60%",
    "top_solid_infill_acceleration": "50%",
    "first_layer_acceleration": "50%",
    "travel_acceleration": "650",
    "first_layer_size_compensation": "-0.12",
    "xy_size_compensation": "0.02",
    "xy_inner_size_compensation": "0.03",
    "hole_size_compensation": "0.05",
    "brim_width": "4",
    "brim_ears": "1",
    "brim_ears_max_angle": "110",
    "init_z_rotate": "0",
    "bridge_overlap": "100%",
}


def file(folder: Path, **changes: str | None) -> Path:
    path = flat_file(folder, **(OWN | changes))
    path.write_text(path.read_text().replace("by PrusaSlicer", "by SuperSlicer 2.5.59"), encoding="utf-8")
    return path


@pytest.fixture
def made(tmp_path: Path) -> dict[str, ImportedProfile]:
    return imported(file(tmp_path))


@pytest.fixture
def profile(made: dict[str, ImportedProfile], tmp_path: Path) -> Profile:
    return loaded(made, tmp_path)


def test_percentages_refer_to_the_settings_of_superslicer(profile: Profile) -> None:
    speeds, hard = profile.quality.speeds, profile.quality.accelerations

    assert profile.quality.first_layer_height == 0.3
    assert (speeds.perimeter, speeds.external_perimeter, speeds.small_perimeter) == (100, 60, 50)
    assert (speeds.solid_infill, speeds.internal_infill, speeds.top_solid_infill) == (90, 108, 45)
    assert (speeds.bridge, speeds.internal_bridge, speeds.ironing, speeds.support) == (60, 90, 9, 70)
    assert (hard.perimeter, hard.external_perimeter, hard.bridge) == (800, 400, 400)
    assert (hard.solid_infill, hard.internal_infill, hard.top_solid_infill, hard.first_layer) == (
        600,
        540,
        300,
        500,
    )


def test_the_whole_of_the_whole_may_be_the_machines_limit(tmp_path: Path) -> None:
    quality = imported(file(tmp_path, default_speed="50%", default_acceleration="50%"))["quality"].values

    assert quality["speeds"]["perimeter"] == 150  # of 300 mm/s
    assert quality["accelerations"]["perimeter"] == 360  # of 900 mm/s²


def test_sizes_are_counted_as_here(profile: Profile) -> None:
    quality = profile.quality

    assert (quality.elephant_foot, quality.elephant_foot_height) == (0.12, 0)
    assert (quality.xy_compensation, quality.hole_compensation) == (0.02, -0.08)
    assert (quality.brim_type, quality.brim_width, quality.brim_ear_angle_deg) == ("ears", 4, 110)
    assert quality.speeds.small_perimeter_radius == pytest.approx(6 / 6.283185)


def test_an_inset_that_fades_away_does_so_here(tmp_path: Path) -> None:
    quality = imported(file(tmp_path, first_layer_size_compensation_layers="3"))["quality"]

    assert quality.values["elephant_foot_height"] == 0.7


def test_travels_are_accelerated_as_it_says_up_to_the_machines_limit(tmp_path: Path) -> None:
    usual, more = (
        imported(file(tmp_path, travel_acceleration=value))["printer"].values["travel_acceleration"]
        for value in ("65%", "5000")
    )

    assert (usual, more) == (650, 800)


def test_none_of_them_is_reported_as_without_equivalent(made: dict[str, ImportedProfile]) -> None:
    left = {one.theirs for part in made.values() for one in part.left}

    assert left & set(OWN) == {"init_z_rotate", "bridge_overlap"}


def test_the_speed_of_internal_bridges_has_two_names(tmp_path: Path) -> None:
    quality = imported(file(tmp_path, bridge_speed_internal=None, internal_bridge_speed="120%"))["quality"]

    assert quality.values["speeds"]["internal_bridge"] == 72
    assert "internal_bridge_speed" not in {one.theirs for one in quality.left}


def test_before_it_had_a_default_speed_percentages_were_prusaslicers(tmp_path: Path) -> None:
    speeds = {"default_speed": None, "perimeter_speed": "48", "infill_speed": "80", "bridge_speed": "33"}
    made = imported(file(tmp_path, **speeds))["quality"].values["speeds"]

    assert (made["solid_infill"], made["top_solid_infill"]) == (72, 36)


def test_percentages_of_prusaslicer_are_unchanged(tmp_path: Path) -> None:
    path = flat_file(tmp_path, first_layer_height="75%", infill_speed="80", solid_infill_speed="50%")
    quality = next(one for one in import_profiles(path) if one.kind == "quality")

    assert isinstance(quality, ImportedProfile)
    assert quality.values["first_layer_height"] == 0.15
    assert quality.values["speeds"]["solid_infill"] == 40
