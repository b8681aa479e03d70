"""Every pair of shipped profiles that makes sense slices a small part and prints it on the simulated printer.

All printers with all qualities of PLA, and with all materials of standard quality; in `just check` each printer with
one of these pairs, a different one than the printer before. The simulated printer has the flavour, the bed and the
limits of the profile.
"""

from __future__ import annotations

from collections import Counter
from functools import cache
from pathlib import Path

import pytest
from parts import step_pyramid

from printer_slicer import Job, dry_run, job_from, job_of, load_profile
from printer_slicer.errors import ProfileError
from printer_slicer.profile import KINDS, Profile, find_profile_paths

PART = step_pyramid([5], [0.9])
QUICK = {"printer.thumbnails": ""}  # pictures are drawn alike on every machine
PRINTERS, MATERIALS, QUALITIES = (list(find_profile_paths(kind)) for kind in KINDS)


@cache
def pairs(printer: str) -> dict[tuple[str, str], Profile | ProfileError]:
    """What the printer goes with: material and quality -> the profile, or why they contradict each other."""
    names = [
        *(("pla", quality) for quality in QUALITIES),
        *((material, "standard") for material in MATERIALS),
    ]
    found: dict[tuple[str, str], Profile | ProfileError] = {}
    for pair in names:
        try:
            found[pair] = load_profile(printer, *pair, QUICK)
        except ProfileError as error:
            found[pair] = error
    return found


@cache
def job(printer: str) -> tuple[Job, Profile]:
    """What is printed by a machine in draft quality."""
    profile = load_profile(printer, "pla", "draft", QUICK)
    return job_of(PART, profile), profile


def prints(profile: Profile, folder: Path) -> None:
    """Assert that a part is printed as intended, and that its file holds nothing that must be allowed."""
    made = job_of(PART, profile)
    file = folder / "part.gcode"
    file.write_bytes(made.text)
    verdict = dry_run(made, profile)

    assert verdict.problems == ()
    assert verdict.ok
    assert verdict.identical
    assert verdict.heights_equal
    assert verdict.report.peak_hotend <= profile.printer.max_nozzle_temperature + 1
    assert verdict.report.peak_bed <= profile.printer.max_bed_temperature + 1
    assert made.findings == ()
    assert job_from(file, profile).findings == ()


@cache
def turns() -> dict[str, tuple[str, str]]:
    """For each printer the pair that the fewest before it have had, and of these what the fewest go with."""
    good = {
        printer: [names for names, one in pairs(printer).items() if isinstance(one, Profile)]
        for printer in PRINTERS
    }
    rare = Counter(names for some in good.values() for names in some)
    had: Counter[tuple[str, str]] = Counter()
    found: dict[str, tuple[str, str]] = {}
    for printer, some in good.items():
        found[printer] = min(some, key=lambda names: (had[names], rare[names]))
        had[found[printer]] += 1
    return found


@pytest.mark.parametrize("printer", PRINTERS)
def test_a_printer_prints_one_of_its_pairs(printer: str, tmp_path: Path) -> None:
    prints(load_profile(printer, *turns()[printer], QUICK), tmp_path)


def test_every_quality_and_every_material_has_its_turn() -> None:
    assert {material for material, _ in turns().values()} == set(MATERIALS)
    assert {quality for _, quality in turns().values()} == set(QUALITIES)


@pytest.mark.thorough
@pytest.mark.parametrize("printer", PRINTERS)
def test_a_printer_prints_every_quality_and_every_material(printer: str, tmp_path: Path) -> None:
    for profile in pairs(printer).values():
        if not isinstance(profile, ProfileError):
            prints(profile, tmp_path)


@pytest.mark.parametrize("printer", PRINTERS)
def test_few_pairs_make_no_sense_and_these_say_why(printer: str) -> None:
    refused = {names: error for names, error in pairs(printer).items() if isinstance(error, ProfileError)}

    for (material, quality), error in refused.items():
        if material == "pla":
            assert quality in {"case_study", "fine"}
            assert "outside the layer heights of printer" in str(error)
        else:
            assert "temperature" in str(error)
            assert "allows" in str(error)
    assert len(pairs(printer)) - len(refused) >= 10


def test_the_simulated_printer_has_the_bed_of_the_profile() -> None:
    printed, _ = job("voron_2_4_350")
    _, small = job("voron_0_2")

    assert not dry_run(printed, small).ok


def test_the_simulated_printer_speaks_the_flavour_of_the_profile() -> None:
    printed, _ = job("voron_0_2")
    _, other = job("marlin_220")

    assert not dry_run(printed, other).ok
