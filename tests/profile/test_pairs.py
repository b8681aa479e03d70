"""Every pair of shipped profiles that makes sense slices a small part and prints it on the simulated printer.

All printers with all qualities of PLA, and with all materials of standard quality. The simulated printer has the
flavour, the bed and the limits of the profile.
"""

from __future__ import annotations

from functools import cache

import pytest
from parts import step_pyramid

from printer_slicer import Job, dry_run, job_of, load_profile
from printer_slicer.errors import ProfileError
from printer_slicer.profile import KINDS, Profile, profile_paths

PART = step_pyramid([5], [0.9])
QUICK = {"printer.thumbnails": ""}  # pictures are drawn alike on every machine
PRINTERS, MATERIALS, QUALITIES = (list(profile_paths(kind)) for kind in KINDS)


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


@pytest.mark.parametrize("printer", PRINTERS)
def test_a_printer_prints_every_quality_and_every_material(printer: str) -> None:
    for names, profile in pairs(printer).items():
        if isinstance(profile, ProfileError):
            continue
        verdict = dry_run(job_of(PART, profile), profile)

        assert verdict.problems == (), names
        assert verdict.identical, names
        assert verdict.heights_equal, names


@pytest.mark.parametrize("printer", PRINTERS)
def test_few_pairs_make_no_sense_and_these_say_why(printer: str) -> None:
    refused = {names: error for names, error in pairs(printer).items() if isinstance(error, ProfileError)}

    for (material, quality), error in refused.items():
        if material == "pla":
            assert quality in {"case_study", "fine"}
            assert "prints layers of" in str(error)
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
