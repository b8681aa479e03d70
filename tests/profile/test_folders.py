"""Where profiles are found, and which of several with one name is taken."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from platformdirs import user_config_path

from printer_slicer.errors import ProfileError
from printer_slicer.profile import find_profile_paths, load_profile
from printer_slicer.profile.folders import (
    VARIABLE,
    find_shipped_profiles,
    find_user_folders,
    list_search_folders,
)
from printer_slicer.profile.reading import find_profile_file, find_profile_kind


def written(folder: Path, name: str, text: str) -> Path:
    path = folder / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")
    return path


@pytest.fixture
def own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder of a person."""
    monkeypatch.setenv(VARIABLE, str(tmp_path / "own"))
    return tmp_path / "own"


def test_a_persons_profile_is_found_by_its_name(own: Path) -> None:
    path = written(own, "printers/shed.toml", 'inherits = "marlin_220"\nname = "shed"\nbed_x = 200\n')

    assert load_profile("shed").printer.bed_x == 200
    assert find_profile_paths("printer")["shed"] == path
    assert "shed" not in find_profile_paths("material")


def test_a_persons_profile_stands_before_the_shipped_one_of_its_name_and_can_inherit_from_it(
    own: Path,
) -> None:
    shipped = load_profile().material
    written(own, "materials/pla.toml", 'inherits = "pla"\nnozzle_temperature = 201\n')
    material = load_profile().material

    assert material.nozzle_temperature == 201
    assert material.density == shipped.density


def test_folders_that_are_named_stand_before_a_persons_own(own: Path, tmp_path: Path) -> None:
    for folder, width in ((own, 150), (tmp_path / "named", 160)):
        written(folder, "printers/marlin_220.toml", f'inherits = "marlin_220"\nbed_x = {width}\n')
    written(own, "printers/small.toml", 'inherits = "marlin_220"\nname = "small"\n')

    assert load_profile("marlin_220").printer.bed_x == 150
    assert load_profile("marlin_220", folders=[tmp_path / "named"]).printer.bed_x == 160
    assert load_profile("small", folders=[tmp_path / "named"]).printer.bed_x == 160


def test_a_chain_of_one_name_goes_through_all_folders(own: Path, tmp_path: Path) -> None:
    written(own, "materials/pla.toml", 'inherits = "pla"\nnozzle_temperature = 201\n')
    written(tmp_path / "named", "materials/pla.toml", 'inherits = "pla"\nbed_temperature = 51\n')
    material = load_profile(folders=[tmp_path / "named"]).material

    assert (material.nozzle_temperature, material.bed_temperature, material.name) == (201, 51, "PLA")


def test_a_new_name_that_inherits_from_itself_is_refused(own: Path) -> None:
    written(own, "materials/dream.toml", 'inherits = "dream"\n')

    with pytest.raises(ProfileError, match=r"inherits from itself: dream\.toml -> dream\.toml"):
        load_profile(material="dream")


def test_a_circle_of_names_is_told_as_it_goes_round(own: Path) -> None:
    written(own, "materials/a.toml", 'inherits = "b"\n')
    written(own, "materials/b.toml", 'inherits = "c"\n')
    written(own, "materials/c.toml", 'inherits = "b"\n')

    with pytest.raises(ProfileError, match=r"itself: b\.toml -> c\.toml -> b\.toml"):
        load_profile(material="a")


def test_several_folders_stand_in_the_variable_as_in_path(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(VARIABLE, os.pathsep.join(["one", "two"]))

    assert list_search_folders([Path("zero")]) == [
        Path("zero"),
        Path("one"),
        Path("two"),
        find_shipped_profiles(),
    ]


def test_without_the_variable_it_is_the_platforms_folder(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.delenv(VARIABLE)
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    (folder,) = find_user_folders()

    assert folder.name == "printer_slicer"
    assert folder.is_absolute()


def test_an_empty_variable_means_no_folder() -> None:
    assert find_user_folders() == []


# Which kind a name or a file is


def test_the_kind_of_a_name_is_that_which_has_it() -> None:
    assert [find_profile_kind(name) for name in ("voron_0_2", "petg", "fine")] == [
        "printer",
        "material",
        "quality",
    ]


def test_a_name_of_several_kinds_must_say_which(own: Path) -> None:
    written(own, "materials/fine.toml", 'inherits = "pla"\n')

    with pytest.raises(ProfileError, match="a material and of a quality"):
        find_profile_kind("fine")


def test_an_unknown_name_gets_the_near_one() -> None:
    with pytest.raises(ProfileError) as caught:
        find_profile_kind("vornon_0_2")

    assert "voron_0_2" in caught.value.remedy


@pytest.mark.parametrize(
    ("name", "text", "kind"),
    [
        ("materials/x.toml", "", "material"),
        ("x.toml", 'inherits = "petg"\n', "material"),
        ("x.toml", 'name = "x"\nbed_x = 100\n', "printer"),
        ("x.toml", 'name = "x"\nperimeters = 3\n', "quality"),
    ],
)
def test_the_kind_of_a_file_is_told_by_its_folder_its_parent_or_its_keys(
    tmp_path: Path, name: str, text: str, kind: str
) -> None:
    assert find_profile_kind(str(written(tmp_path, name, text))) == kind


def test_a_file_that_could_be_anything_must_say_what_it_is(tmp_path: Path) -> None:
    path = written(tmp_path, "x.toml", 'name = "x"\n')

    with pytest.raises(ProfileError, match="cannot tell whether this is a printer") as caught:
        find_profile_kind(str(path))

    assert f"printer {path}" in caught.value.remedy


def test_a_file_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(ProfileError, match="nowhere"):
        find_profile_kind(str(tmp_path / "nowhere.toml"))


def test_words_do_not_match_the_printer_that_a_quality_is_for(own: Path) -> None:
    name = "0.20mm Standard @Creality Ender3V2"
    written(own, "qualities/mine.toml", f'inherits = "standard"\nname = "{name}"\n')

    assert find_profile_kind("Ender 3") == "printer"
    assert find_profile_kind("ender") == "printer"
    assert find_profile_file("quality", name).stem == "mine"


@pytest.mark.parametrize(
    ("typed", "name"),
    [("Silk PLA", "pla_silk"), ("generic PLA", "pla"), ("Generic PETG", "petg"), ("nylon", "pa")],
)
def test_materials_are_found_by_their_usual_names(typed: str, name: str) -> None:
    assert find_profile_file("material", typed).stem == name


@pytest.mark.parametrize(
    ("kind", "typed", "remedy"),
    [
        ("quality", "0.20mm Standard", "Did you mean 'standard'?"),
        ("quality", "Fast", "Did you mean 'draft'?"),
        ("material", "Prusament PLA", "Did you mean 'pla'?"),
        ("printer", "Ender3 Max", "Similar printer: 'creality_ender3'"),
        ("printer", "anycubic kobra 2", "Similar printer: 'anycubic_kobra'"),
    ],
)
def test_unknown_names_get_a_suggestion(kind: str, typed: str, remedy: str) -> None:
    with pytest.raises(ProfileError, match="unknown") as caught:
        find_profile_file(kind, typed)

    assert caught.value.remedy == remedy


def test_names_that_no_file_can_have_are_unknown() -> None:
    with pytest.raises(ProfileError, match="unknown printer"):
        find_profile_file("printer", "a\0b")


@pytest.mark.parametrize("configured", [None, "", "relative", "/elsewhere"])
@pytest.mark.parametrize("home", [None, "", "relative", "/home/someone", "/home/someone/"])
def test_without_a_named_folder_the_platforms_folder_is_used(
    monkeypatch: pytest.MonkeyPatch, configured: str | None, home: str | None
) -> None:
    monkeypatch.delenv(VARIABLE, raising=False)
    for name, value in (("XDG_CONFIG_HOME", configured), ("HOME", home)):
        if value is None:
            monkeypatch.delenv(name, raising=False)
        else:
            monkeypatch.setenv(name, value)

    assert find_user_folders() == [user_config_path("printer_slicer", appauthor=False)]
