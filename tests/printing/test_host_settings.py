"""What is kept of a profile with a print."""

from __future__ import annotations

import json

from printer_slicer.cli.commands.resume import _make_command_check_argument
from printer_slicer.printing.host_settings import make_host_settings, parse_host_settings
from printer_slicer.profile import load_profile, restore_profile


def test_it_is_the_same_after_it_was_a_file() -> None:
    setup = make_host_settings(load_profile("voron_trident_300", "abs"), ["cold"])

    kept = parse_host_settings(json.loads(json.dumps(setup.as_json())))
    assert kept.limits == setup.limits
    assert (kept.flavour, kept.allowed, kept.low, kept.high) == ("klipper", ("cold",), setup.low, setup.high)
    assert restore_profile(kept.settings) == load_profile("voron_trident_300", "abs")


def test_one_that_an_earlier_version_kept_judges_nothing() -> None:
    old = make_host_settings(load_profile()).as_json()
    del old["settings"], old["allowed"]

    assert _make_command_check_argument(parse_host_settings(old)) == {}


def test_what_is_typed_after_a_resume_is_judged_as_before() -> None:
    profile = load_profile("marlin_220", "pla")
    allow = _make_command_check_argument(
        parse_host_settings(json.loads(json.dumps(make_host_settings(profile).as_json())))
    )["allow"]
    lenient = _make_command_check_argument(make_host_settings(profile, ["cold"]))["allow"]

    assert "260" in allow(b"M104 S400")
    assert allow(b"M302 P1")
    assert not lenient(b"M302 P1")
    assert not allow(b"M104 S210")
