"""Bundles: inheritance, compatibility, printers by name."""

from __future__ import annotations

from pathlib import Path

import pytest

from printer_slicer.errors import ProfileError
from printer_slicer.importing import ImportedProfile, ImportRequest, RejectedProfile, import_profiles
from printer_slicer.importing.conditions import evaluate_condition
from printer_slicer.importing.printer_search import find_printers
from printer_slicer.name_search import remove_nozzle
from tests.importing.files import imported, loaded

BUNDLE = """\
# A vendor.
[vendor]
name = Acme

[printer_model:A1]
name = Acme A1
default_materials = Acme PETG; Acme PLA

[print:*base*]
layer_height = 0.3
perimeters = 2
perimeter_speed = 40

[print:*thick walls*]
perimeters = 5
perimeter_speed = 50

[print:Fine]
inherits = *base*; *thick walls*
layer_height = 0.1
first_layer_height = 0.2
compatible_printers_condition = printer_model=="A1" and nozzle_diameter[0]==0.4

[print:Turned]
inherits = *thick walls*; *base*
compatible_printers_condition = printer_model=~/(A2|A3).*/

[filament:Acme PLA]
temperature = 200
compatible_printers_condition = printer_notes!~/.*HOT_ONLY.*/
start_filament_gcode = "M900 K{if nozzle_diameter[0]==0.4}0.05{else}0.03{endif} ; advance"

[filament:Acme PETG]
temperature = 240
first_layer_temperature = 245

[filament:Acme hot]
temperature = 290
first_layer_temperature = 290
compatible_printers_condition = printer_notes=~/.*HOT_ONLY.*/

[filament:Adopted]
inherits = Gone Elsewhere
temperature = 210

[printer:*common*]
gcode_flavor = marlin
bed_shape = 0x0,200x0,200x180,0x180
max_layer_height = 0.25

[printer:Acme A1]
inherits = *common*
printer_model = A1
nozzle_diameter = 0.4
default_print_profile = Fine

[printer:Acme A2]
inherits = Acme A1
printer_model = A2
nozzle_diameter = 0.6
printer_notes = all of it HOT_ONLY\\nyes

[printer:Ring]
inherits = *ring*

[printer:*ring*]
inherits = *ring 2*

[printer:*ring 2*]
inherits = *ring*
"""


# As PrusaSlicer's bundles of other vendors name their printers.
SHOP = """\
[vendor]
name = Shop

[printer_model:E3V2]
name = Shop E-3 V2
variants = 0.4; 0.3
default_materials = Shop PLA

[print:0.16 mm]
layer_height = 0.16
perimeters = 2

[filament:Shop PLA]
temperature = 205
first_layer_temperature = 210

[printer:*e3*]
gcode_flavor = marlin
bed_shape = 5x0,215x0,215x220,5x220
printer_model = E3V2

[printer:Shop E-3 V2 (0.3 mm nozzle)]
inherits = *e3*
nozzle_diameter = 0.3
printer_variant = 0.3

[printer:Shop E-3 V2 (0.4 mm nozzle)]
inherits = *e3*
nozzle_diameter = 0.4
printer_variant = 0.4
renamed_from = "Shop Ender V2"; "Shop E-3V2"
default_print_profile = "0.16 mm"
"""


@pytest.mark.parametrize(
    ("name", "nozzle"),
    [
        ("Shop E-3 V2", 0.4),
        ("E3V2", 0.4),
        ("Shop E-3V2", 0.4),
        ("Shop E-3 V2 (0.3 mm nozzle)", 0.3),
    ],
)
def test_a_printer_of_a_bundle_is_found_by_model_and_older_names(
    name: str, nozzle: float, tmp_path: Path
) -> None:
    (tmp_path / "Shop.ini").write_text(SHOP, encoding="utf-8")
    made = import_profiles(tmp_path / "Shop.ini", ImportRequest(printer=name))

    assert [one.kind for one in made] == ["printer", "material", "quality"]
    assert made[0].name == f"Shop E-3 V2 ({nozzle} mm nozzle)"
    assert values(made[0])["nozzle_diameter"] == nozzle


def test_a_printer_that_a_bundle_does_not_hold_is_an_error(tmp_path: Path) -> None:
    (tmp_path / "Shop.ini").write_text(SHOP, encoding="utf-8")

    with pytest.raises(ProfileError, match="none of the 2 printers is called 'E-9'"):
        import_profiles(tmp_path / "Shop.ini", ImportRequest(printer="E-9"))


@pytest.fixture
def bundle(tmp_path: Path) -> Path:
    path = tmp_path / "Acme.ini"
    path.write_text(BUNDLE, encoding="utf-8")
    return path


def by_name(path: Path, **wanted: object) -> dict[str, ImportedProfile | RejectedProfile]:
    return {one.name: one for one in import_profiles(path, ImportRequest(**wanted))}  # type: ignore[arg-type]


def values(one: ImportedProfile | RejectedProfile) -> dict[str, object]:
    assert isinstance(one, ImportedProfile)
    return dict(one.values)


def test_of_several_parents_the_later_wins_and_the_child_over_all(bundle: Path) -> None:
    made = by_name(bundle)

    assert values(made["Fine"])["layer_height"] == 0.1
    assert values(made["Fine"])["perimeters"] == 5
    assert values(made["Turned"])["perimeters"] == 2
    assert values(made["Turned"])["layer_height"] == 0.3


def test_abstract_sections_are_no_presets(bundle: Path) -> None:
    assert set(by_name(bundle)) == {
        *("Fine", "Turned", "Acme PLA", "Acme PETG", "Acme hot", "Adopted", "Acme A1", "Acme A2", "Ring")
    }


def test_circular_and_missing_inheritance_is_an_error_with_its_place(bundle: Path) -> None:
    made = by_name(bundle)
    ring, adopted = made["Ring"], made["Adopted"]

    assert isinstance(ring, RejectedProfile)
    assert isinstance(adopted, RejectedProfile)
    assert "*ring* -> *ring 2* -> *ring*" in ring.problem
    line = BUNDLE.splitlines().index("inherits = Gone Elsewhere") + 1
    assert adopted.problem.startswith(
        f"{bundle}:{line}: inherits = Gone Elsewhere: this file has no such preset"
    )


def test_a_printer_brings_its_own_material_and_quality(bundle: Path, tmp_path: Path) -> None:
    made = imported(bundle, printer="Acme A1")

    assert {kind: one.name for kind, one in made.items()} == {
        "printer": "Acme A1",
        "material": "Acme PETG",
        "quality": "Fine",
    }
    assert loaded(made, tmp_path).quality.layer_height == 0.1


def test_settings_that_depend_on_the_printer_are_evaluated_for_it(bundle: Path) -> None:
    alone = by_name(bundle)["Acme PLA"]
    assert isinstance(alone, ImportedProfile)

    assert "pressure_advance" not in values(alone)
    assert any("import both together" in note.text for note in alone.notes)
    for printer, advance in (("Acme A1", 0.05), ("Acme A2", 0.03)):
        made = by_name(bundle, printer=printer, names=("Acme PLA",))
        assert values(made["Acme PLA"])["pressure_advance"] == advance


def test_a_printer_may_become_as_hot_as_the_materials_meant_for_it(bundle: Path) -> None:
    made = by_name(bundle)

    assert values(made["Acme A1"])["max_nozzle_temperature"] == 275
    assert values(made["Acme A2"])["max_nozzle_temperature"] == 290


def test_a_printer_prints_the_layers_of_the_qualities_meant_for_it(bundle: Path) -> None:
    assert values(by_name(bundle)["Acme A1"])["max_layer"] == 0.25  # Turned is not for it
    assert values(by_name(bundle)["Acme A2"])["max_layer"] == 0.35  # of the first layer, by default


def test_names_choose(bundle: Path) -> None:
    assert set(by_name(bundle, names=("Acme P*",))) == {"Acme PLA", "Acme PETG"}
    with pytest.raises(ProfileError, match="no preset matches the name"):
        by_name(bundle, names=("Nobody",))
    with pytest.raises(ProfileError, match="Did you mean 'Acme A1'"):
        by_name(bundle, printer="Acme A11")


@pytest.mark.parametrize(
    ("condition", "expected"),
    [
        ("nozzle_diameter[0]==0.4", True),
        ("nozzle_diameter[0]!=0.4 or num_extruders>1", False),
        ("printer_notes=~/.*MODEL_MK(2.5|3).*/ and ! (single_extruder_multi_material)", True),
        ("printer_model!~/A.*/ && true", False),
        ('printer_model=="A1"', True),
        ("1 + 2 * 3 == 7 and 7 / 2 == 3 and 7 % 4 == 3 and -7 / 2 == -3", True),
        ("unheard_of == 1", None),
        ("nozzle_diameter[0] ==", None),
        ("printer_notes =~ /(.*.*)*X/", False),
        ("(" * 500 + "1", None),
        ("not " * 5000 + "true", None),
    ],
)
def test_conditions(condition: str, expected: bool | None) -> None:
    known = {
        "nozzle_diameter": "0.4",
        "printer_model": "A1",
        "single_extruder_multi_material": "0",
        "printer_notes": "keep\\nPRINTER_MODEL_MK3",
    }

    assert evaluate_condition(condition, known) is expected


@pytest.mark.parametrize("typed", ["Shop E-3 V2", "E3V2", "e-3 v2", "shop e3 v2"])
def test_a_model_with_several_nozzles_is_imported_with_the_04_mm_nozzle(tmp_path: Path, typed: str) -> None:
    path = tmp_path / "Shop.ini"
    path.write_text(SHOP, encoding="utf-8")
    printer = imported(path, printer=typed)["printer"]

    assert printer.values["nozzle_diameter"] == 0.4
    assert "0.3, 0.4 mm: 0.4 mm is imported" in printer.notes[0].text


NAMES = ("Creality Ender-3", "Creality Ender-3 V2", "Creality Ender-3 V2 Neo", "Creality Ender-3 Pro")


@pytest.mark.parametrize(
    ("typed", "found"),
    [
        ("Ender 3", ["Creality Ender-3"]),
        ("ender3", ["Creality Ender-3"]),
        ("Ender3 V2", ["Creality Ender-3 V2"]),
        ("CREALITY ENDER-3 V2", ["Creality Ender-3 V2"]),
        ("neo", ["Creality Ender-3 V2 Neo"]),
        ("v2 0.6", ["Creality Ender-3 V2 (0.6 mm nozzle)"]),
        ("end pro", ["Creality Ender-3 Pro"]),
        ("creality", list(NAMES)),
        ("prusa", []),
        ("", []),
    ],
)
def test_printers_are_found_by_a_part_of_their_name(typed: str, found: list[str]) -> None:
    names = {f"{name} ({size} mm nozzle)": () for name in NAMES for size in ("0.4", "0.6")}
    one_of = dict.fromkeys(
        remove_nozzle(name) if "0.6" not in typed else name for name in find_printers(typed, names)
    )

    assert list(one_of) == found


def test_a_name_of_several_models_is_an_error_that_lists_them(tmp_path: Path) -> None:
    path = tmp_path / "Acme.ini"
    path.write_text(BUNDLE, encoding="utf-8")

    with pytest.raises(ProfileError, match="2 printers match 'acme': Acme A1, Acme A2"):
        import_profiles(path, ImportRequest(printer="acme"))
