"""G-code of this program: the profiles that it was made with come back as they were."""

from __future__ import annotations

from pathlib import Path

import pytest

from printer_slicer import job_of, load_mesh
from printer_slicer.errors import ProfileError
from printer_slicer.importing import Wanted, import_profiles
from printer_slicer.profile import Profile, load_profile, settings_of
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


def written(folder: Path, **load: str) -> tuple[Path, Profile]:
    profile = load_profile(changes=CHANGES, **load)  # type: ignore[arg-type]
    path = folder / "box.gcode"
    path.write_bytes(job_of(load_mesh(PART), profile).text)
    return path, profile


@pytest.mark.parametrize("printer", ["marlin_220", "voron_2_4_350"])
def test_what_was_set_is_set_again(tmp_path: Path, printer: str) -> None:
    path, profile = written(tmp_path, printer=printer)
    made = imported(path)

    assert settings_of(loaded(made, tmp_path)) == settings_of(profile)
    assert made["material"].name == "Our PETG, green"
    assert not any(one.left or one.notes or one.approximated for one in made.values())


def test_kinds_and_names_choose(tmp_path: Path) -> None:
    path, _ = written(tmp_path)

    assert [one.kind for one in import_profiles(path, Wanted(names=("Our*",)))] == ["material"]
    with pytest.raises(ProfileError, match="no preset of this name"):
        import_profiles(path, Wanted(names=("Nobody",)))


def test_it_may_not_heat_further_than_other_files(tmp_path: Path) -> None:
    path, _ = written(tmp_path)
    hotter = b"; printer.max_nozzle_temperature = 4"
    path.write_bytes(path.read_bytes().replace(hotter[:-1] + b"2", hotter))

    assert "an import lets nozzles go up to 300" in refused(path, "printer").problem


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        (b"\n; settings\n", b"\n", "without the settings at its end"),
        (b"; printer.bed_x = ", b"; printer.bed_q = ", "of another version"),
        (b"; printer.bed_x = ", b"; printer.bed_x = wide", "of another version"),
    ],
)
def test_settings_that_are_not_all_there_are_refused(
    tmp_path: Path, old: bytes, new: bytes, said: str
) -> None:
    path, _ = written(tmp_path)
    path.write_bytes(path.read_bytes().replace(old, new))

    with pytest.raises(ProfileError, match=said):
        import_profiles(path)
