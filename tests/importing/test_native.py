"""Import of profiles from G-code of this program."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import pytest

from printer_slicer import dry_run, job_of, load_mesh
from printer_slicer.errors import ProfileError
from printer_slicer.importing import ImportRequest, import_profiles
from printer_slicer.profile import Profile, load_profile, settings_as_dict
from tests.importing.files import imported, loaded, refused

PART = Path(__file__).parents[2] / "sample_parts" / "box.stl"
CHANGES: dict[str, object] = {
    "quality.planner.kind": "uniform",
    "quality.layer_height": 0.3,
    "quality.overrides": "box:infill_density=0.4; 5:10:perimeters=4",
    "quality.pause_at": "4, 7.5",
    "printer.thumbnails": "32x32, 300x300/QOI",
    "printer.layer_gcode": ";one\n  ;two {layer_num}\n",
    "material.name": "Our PETG, green",
}


@cache
def sliced(printer: str) -> tuple[bytes, Profile]:
    profile = load_profile(printer, changes=CHANGES)
    return job_of(load_mesh(PART), profile).text, profile


def written(folder: Path, printer: str = "marlin_220") -> tuple[Path, Profile]:
    text, profile = sliced(printer)
    path = folder / "box.gcode"
    path.write_bytes(text)
    return path, profile


@pytest.mark.parametrize("printer", ["marlin_220", "voron_2_4_350"])
def test_importing_own_gcode_restores_all_settings(tmp_path: Path, printer: str) -> None:
    path, profile = written(tmp_path, printer=printer)
    made = imported(path)

    assert settings_as_dict(loaded(made, tmp_path)) == settings_as_dict(profile)
    assert made["material"].name == "Our PETG, green"
    assert not any(one.left or one.notes or one.converted_settings for one in made.values())


def test_kinds_and_names_choose(tmp_path: Path) -> None:
    path, _ = written(tmp_path)

    assert [one.kind for one in import_profiles(path, ImportRequest(names=("Our*",)))] == ["material"]
    with pytest.raises(ProfileError, match="no preset matches the name"):
        import_profiles(path, ImportRequest(names=("Nobody",)))


def test_it_may_not_heat_further_than_other_files(tmp_path: Path) -> None:
    path, _ = written(tmp_path)
    hotter = b"; printer.max_nozzle_temperature = 4"
    path.write_bytes(path.read_bytes().replace(hotter[:-1] + b"2", hotter))

    assert "over the nozzle limit of 300" in refused(path, "printer").problem


OLD_START = """\
G28
M140 S{first_layer_bed_temperature}
M104 S{min(first_layer_nozzle_temperature, 160)}
{if first_layer_min_x > 4}
G1 X{bed_x_middle} Y{bed_y_end} ; {{primed}}
{elif nozzle_diameter == 0.6 and not probe}
M117 '{fixed(part_height, 1)}' {padded(layer_count, 4)} {material_name + '-' + text(perimeters)}
{endif}
M190 S{first_layer_bed_temperature}
M109 S{first_layer_nozzle_temperature}
"""
OLD_END = "G1 Z{min(part_height + 5, bed_z)} F600\nM104 S0\nM140 S0\n"


def test_macros_in_the_old_form_of_the_language_are_imported_sliced_and_printed(tmp_path: Path) -> None:
    changes = {"printer.start_gcode": OLD_START, "printer.end_gcode": OLD_END}
    old = load_profile(changes=changes)
    path = tmp_path / "old.gcode"
    path.write_bytes(job_of(load_mesh(PART), old).text)
    again = loaded(imported(path), tmp_path)
    job = job_of(load_mesh(PART), again)
    lines = job.text.decode().splitlines()

    assert (again.printer.start_gcode, again.printer.end_gcode) == (OLD_START, OLD_END)
    assert job.text.partition(b"\n; settings\n")[0] == path.read_bytes().partition(b"\n; settings\n")[0]
    assert dry_run(job, again).problems == ()
    assert "M104 S160" in lines
    assert "G1 X110 Y215 ; {primed}" in lines
    assert "G1 Z15 F600" in lines


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        (b"\n; settings\n", b"\n", "settings at the end of the file are missing"),
        (b"; printer.bed_x = ", b"; printer.bed_q = ", "to another version"),
        (b"; printer.bed_x = ", b"; printer.bed_x = wide", "to another version"),
    ],
)
def test_settings_that_are_not_all_there_are_refused(
    tmp_path: Path, old: bytes, new: bytes, said: str
) -> None:
    path, _ = written(tmp_path)
    path.write_bytes(path.read_bytes().replace(old, new))

    with pytest.raises(ProfileError, match=said):
        import_profiles(path)
