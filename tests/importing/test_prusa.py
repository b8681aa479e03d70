"""Compare imports with PrusaSlicer: its bundles, its `--save`, and the macros in its G-code."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from benchmarks.importing import compare_macros, differences, triple
from benchmarks.prusa_presets import BUNDLES, Oracle, saved
from printer_slicer.importing import ImportedProfile, RejectedProfile, format_profile, import_profiles
from printer_slicer.macros import read_template
from printer_slicer.profile import load_profile

pytestmark = [
    pytest.mark.skipif(not shutil.which("prusa-slicer"), reason="PrusaSlicer is not installed"),
    pytest.mark.skipif(not BUNDLES.is_dir(), reason="its bundles are not installed"),
]

SOME = (
    "Anycubic",
    "Artillery",
    "BIBO",
    "Elegoo",
    "FLSun",
    "INAT",
    "Jubilee",
    "LulzBot",
    "RatRig",
    "Ultimaker",
    "gCreate",
)
TRIPLES = {
    "Artillery": "Artillery Sidewinder X1",
    "BIBO": "BIBO2 Touch Dual extrusion",
    "Creality": "Creality Ender-3 V2 (0.4 mm nozzle)",
    "PrusaResearch": "Original Prusa i3 MK3S & MK3S+",
    "FLSun": "FLSun QQS Pro",
    "RatRig": "RatRig V-Core-3-300",
    "Voron": "Voron_v0 0.4 nozzle",
}


@pytest.mark.parametrize("vendor", SOME)
def test_nearly_every_preset_of_a_bundle_imports_and_the_others_say_why(vendor: str) -> None:
    path = BUNDLES / f"{vendor}.ini"
    results = import_profiles(path)
    oracle = Oracle(path)
    refused = [one for one in results if isinstance(one, RejectedProfile)]

    assert sorted(one.name for one in results if one.kind == "printer") == sorted(oracle.names("printer"))
    assert len(results) == sum(len(oracle.names(kind)) for kind in ("printer", "print", "filament"))
    assert len(refused) <= 6
    assert all(f"{path}:" in one.problem and one.remedy for one in refused)


def test_everything_that_imports_is_a_profile_of_ours(tmp_path: Path) -> None:
    for made in import_profiles(BUNDLES / "FLSun.ini"):
        assert isinstance(made, ImportedProfile)
        path = tmp_path / "one.toml"
        path.write_text(format_profile(made), encoding="utf-8")
        profile = load_profile(**{made.kind: str(path)}, slices=False)  # type: ignore[arg-type]
        assert getattr(profile, made.kind).name == made.name
        for name in ("start_gcode", "end_gcode", "before_layer_gcode", "layer_gcode", "pause_gcode"):
            read_template(getattr(profile.printer, name), name)


@pytest.mark.parametrize("vendor", TRIPLES)
def test_main_values_are_those_that_prusaslicer_saves(vendor: str, tmp_path: Path) -> None:
    made, settings, refused = triple(BUNDLES / f"{vendor}.ini", TRIPLES[vendor])
    theirs = saved(settings, tmp_path)

    assert refused == []
    assert len(made) == 3
    assert differences(made, theirs) == []
    for key in ("max_print_height", "temperature", "infill_speed", "machine_max_feedrate_x"):
        assert differences(made, theirs | {key: "77"}) != []


@pytest.mark.parametrize("vendor", ["BIBO", "Creality", "PrusaResearch", "RatRig"])
def test_macros_come_out_as_in_the_files_of_prusaslicer(
    vendor: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    different = compare_macros((BUNDLES / f"{vendor}.ini", TRIPLES[vendor]), tmp_path)
    said = capsys.readouterr().out

    assert different == 0
    assert "commands; all the same" in said, said
