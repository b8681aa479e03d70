"""The printers, materials and qualities that are shipped; that all of them print is shown by `test_pairs`."""

from __future__ import annotations

import re
import tomllib
from functools import cache
from itertools import product
from pathlib import Path

import pytest
from parts import box, step_pyramid

from printer_slicer import dry_run, job_from, job_of, load_profile
from printer_slicer.errors import ProfileError
from printer_slicer.profile import DEFAULT_NAMES, KINDS, Profile, find_profile_paths, list_settings
from printer_slicer.profile.inspection import read_headline
from printer_slicer.profile.reading import find_profile_file

PART = step_pyramid([8, 5], [1.24, 0.86])
WITHOUT_STEPS = step_pyramid([8], [2.1])
PRINTERS, MATERIALS, QUALITIES = (list(find_profile_paths(kind)) for kind in KINDS)
# Every pair of printer and quality, of printer and material, and of material and quality.
ALL = sorted(
    {
        *product(PRINTERS, ["pla"], QUALITIES),
        *product(PRINTERS, MATERIALS, ["standard"]),
        *product(["marlin_220"], MATERIALS, QUALITIES),
    }
)
OWN_MACROS = [
    name
    for name, path in find_profile_paths("printer").items()
    if "_gcode" in path.read_text(encoding="utf-8")
]
GENERIC = ("corexy_klipper", "marlin_220", "marlin_220_06", "marlin_probe_220")
HOT = "voron_2_4_350"  # prints every material
THICK = "marlin_220_06"  # prints the layers of every quality but draft's


@pytest.mark.parametrize("quality", QUALITIES)
def test_every_quality_prints_flats_and_slopes_as_intended(quality: str) -> None:
    profile = load_profile(THICK if quality == "case_study" else "creality_ender3", "pla", quality)
    # One wall without anything inside cannot carry a step.
    verdict = dry_run(job_of(WITHOUT_STEPS if quality == "vase" else PART, profile), profile)

    assert verdict.problems == ()
    assert verdict.identical
    assert verdict.heights_equal


def test_what_people_look_for_is_there() -> None:
    named = set(PRINTERS) - set(GENERIC)

    assert len(named) >= 20
    assert len(MATERIALS) >= 10
    assert {"draft", "standard", "fine", "adaptive", "strong", "vase"} <= set(QUALITIES)


@pytest.mark.parametrize("kind", KINDS)
def test_every_file_begins_with_what_it_is_for(kind: str) -> None:
    for path in find_profile_paths(kind).values():
        directive, comment = path.read_text(encoding="utf-8").splitlines()[:2]

        assert directive == f"#:schema ../schema/{kind}.schema.json"
        assert 20 < len(comment) <= 130, path
        assert 10 < len(read_headline(path)) < 130, path


@pytest.mark.parametrize("name", sorted(set(PRINTERS) - set(GENERIC)))
def test_a_machine_has_a_bed_a_height_limits_and_a_model_of_its_own(name: str) -> None:
    own = tomllib.loads(find_profile_paths("printer")[name].read_text(encoding="utf-8"))
    printer = load_profile(name, "pla", "draft").printer

    assert {"bed_x", "bed_y", "bed_z", "model", "max_nozzle_temperature", "max_bed_temperature"} <= set(own)
    assert own["model"]
    assert printer.max_nozzle_temperature <= 300
    assert printer.max_bed_temperature <= 120
    assert "{first_layer_bed_temperature[0]}" in printer.start_gcode
    assert "M104 S0" in printer.end_gcode
    assert "M140 S0" in printer.end_gcode


@pytest.mark.parametrize("name", OWN_MACROS)
def test_a_part_as_high_as_the_machine_ends_within_it(name: str) -> None:
    hollow = {"perimeters": 1, "bottom_thickness": 0, "top_thickness": 0, "infill_density": 0}
    profile = load_profile(name, "pla", "draft", {"bed_z": 20, **hollow})
    job = job_of(box((6, 6, 20)), profile)
    verdict = dry_run(job, profile)

    assert verdict.problems == ()
    assert not [one for one in job.findings if one.code == "box"]


@pytest.mark.parametrize("name", OWN_MACROS)
def test_nothing_is_laid_on_the_lines_that_prime(name: str) -> None:
    """Lines that prime are left out where the part, or what is around it, reaches."""
    hollow = {"skirt_loops": 0, "bottom_thickness": 0, "top_thickness": 0, "infill_density": 0}
    plain = load_profile(name, "pla", "standard", hollow)
    (left, front), (right, back) = plain.printer.corners
    small, wide = box((10, 10, 0.4)), box((right - left - 1, back - front - 1, 0.4))

    primes = [
        sum(b"E9 F800" in command for command in job_of(part, plain).commands) for part in (small, wide)
    ]
    assert primes == [2, 0]


@pytest.mark.parametrize("name", ["prusa_mk3s", "prusa_mini", "prusa_mk4"])
def test_where_the_maker_primes_can_be_reached(name: str, tmp_path: Path) -> None:
    """The start G-code that comes with PrusaSlicer primes in front of the bed."""
    path = tmp_path / "part.gcode"
    path.write_text("G28\nM109 S210\nM83\nG1 Z0.2 F720\nG1 Y-3 F1000\nG1 X60 E9 F1000\nM104 S0\n")
    profile = load_profile(name)

    assert dry_run(job_from(path, profile), profile).problems == ()


@pytest.mark.parametrize("name", PRINTERS)
def test_heaters_are_off_before_the_last_moves(name: str) -> None:
    """A move that a firmware refuses must not leave anything hot behind."""
    lines = [line.partition(";")[0].strip() for line in load_profile(name).printer.end_gcode.splitlines()]

    assert max(lines.index("M104 S0"), lines.index("M140 S0")) < min(
        at for at, line in enumerate(lines) if line.startswith(("G0", "G1", "G28"))
    )


@pytest.mark.parametrize("name", PRINTERS)
def test_where_the_full_step_is_told_variable_heights_are_multiples_of_it(name: str) -> None:
    profile = load_profile(name, "pla", "adaptive")
    full = profile.printer.z_full_step
    if not full:
        return
    heights = [height for _, height in plan_of(name)[1:]]

    assert heights
    near_flats = {round(height, 4) for height in heights if abs(height / full - round(height / full)) > 1e-6}
    assert len(near_flats) <= 2  # only those that end on a flat or the top


def plan_of(name: str) -> list[tuple[int, float]]:
    from printer_slicer import place, plan_part

    profile = load_profile(name, "pla", "adaptive")
    return plan_part(place(PART, profile.printer), profile).runs()


@cache
def attempt(*names: str) -> Profile | ProfileError:
    """The profile, or why there is none."""
    try:
        return load_profile(*names)
    except ProfileError as error:
        return error


@pytest.mark.parametrize("material", MATERIALS)
def test_a_material_is_refused_where_it_is_too_hot_and_nowhere_else(material: str) -> None:
    tried = {printer: attempt(printer, material, "standard") for printer in PRINTERS}
    refused = [str(one) for one in tried.values() if isinstance(one, ProfileError)]

    assert isinstance(tried[HOT], Profile)
    assert all("temperature" in why and "allows" in why for why in refused)


def printer_name(name: str) -> str:
    return load_profile(name, "pla", "standard").printer.name


@pytest.mark.parametrize(("printer", "material", "quality"), ALL)
def test_shipped_profiles_load_or_are_refused_with_both_settings_named(
    printer: str, material: str, quality: str
) -> None:
    profile = attempt(printer, material, quality)

    if isinstance(profile, ProfileError) and "material." in str(profile):
        assert f"printer {printer_name(printer)!r} allows" in str(profile)
        return
    if isinstance(profile, ProfileError):
        assert re.search(r"(printer|material|quality)\.\w+", str(profile))
        assert printer_name(printer) in str(profile)
        assert profile.remedy
        return
    assert profile.thinnest <= profile.thickest <= profile.printer.nozzle_diameter
    assert {profile.printer.name, profile.material.name, profile.quality.name} <= {
        value for key, value in list_settings(profile) if key.endswith(".name")
    }


@pytest.mark.parametrize("kind", KINDS)
def test_every_shipped_profile_works_in_some_combination(kind: str) -> None:
    place = list(KINDS).index(kind)
    used = {names[place] for names in ALL if isinstance(attempt(*names), Profile)}

    assert used == set(find_profile_paths(kind))


def test_the_defaults_exist_and_fit_each_other() -> None:
    assert all(DEFAULT_NAMES[kind] in find_profile_paths(kind) for kind in KINDS)
    assert load_profile() == load_profile(
        DEFAULT_NAMES["printer"], DEFAULT_NAMES["material"], DEFAULT_NAMES["quality"]
    )


@pytest.mark.parametrize("kind", KINDS)
def test_shipped_profiles_have_names_of_their_own(kind: str) -> None:
    names = []
    for name in find_profile_paths(kind):
        path = find_profile_paths(kind)[name]
        names.append(re.search(r'(?m)^name = "(.+)"$', path.read_text(encoding="utf-8")))

    assert None not in names
    assert len({found[1] for found in names if found}) == len(names)


MODELS = {
    "Ender 3 Pro": "creality_ender3",
    "Neptune 4 Pro": "elegoo_neptune4",
    "Neptune 3 Pro": "elegoo_neptune3_pro",
    "i3 Mega S": "anycubic_i3_mega",
    "Original Prusa i3 MK3S": "prusa_mk3s",
    "Original Prusa MINI": "prusa_mini",
    "original prusa mk4": "prusa_mk4",
    "v0.2": "voron_0_2",
    "V0": "voron_0_2",
    "V2.4": "voron_2_4_350",
    "Rat Rig V-Core 3": "ratrig_vcore3_300",
}


@pytest.mark.parametrize(("model", "name"), MODELS.items())
def test_models_that_share_a_profile_are_found(model: str, name: str) -> None:
    assert find_profile_file("printer", model).stem == name
