"""The shipped printers: each says how fast it prints, from whom that is known, and asks nothing that it cannot do."""

from __future__ import annotations

import re

import pytest

from printer_slicer.profile import load_profile
from printer_slicer.profile.folders import find_profile_paths
from printer_slicer.profile.reading import read_chain

PRINTERS = find_profile_paths("printer")
NAMED = (
    "external_perimeter",
    "perimeter",
    "internal_infill",
    "solid_infill",
    "top_solid_infill",
    "gap_fill",
    "bridge",
    "internal_bridge",
    "support",
    "travel",
    "first_layer",
)


@pytest.mark.parametrize("name", PRINTERS)
def test_it_says_how_fast_it_prints_and_from_whom_that_is_known(name: str) -> None:
    known = read_chain("printer", name).values
    text = PRINTERS[name].read_text(encoding="utf-8")

    assert set(NAMED) <= set(known["speeds"])
    assert known["hotend_max_flow"] > 0
    if "\n[speeds]\n" not in text:
        assert name == "marlin_probe_220", "it is its parent with a probe"
        return
    source = re.search(r"\n\[speeds\]\n# (.+)", text)
    assert source
    assert re.search(r"OrcaSlicer|CrealityPrint|ElegooSlicer|PrusaSlicer|Cura", source[1])


@pytest.mark.parametrize("quality", ["standard", "draft", "fine"])
@pytest.mark.parametrize("name", PRINTERS)
def test_it_is_not_asked_for_more_than_its_axes_do(name: str, quality: str) -> None:
    profile = load_profile(name, quality=quality, changes={"max_layer": 0.32})
    printer, speeds, hard = profile.printer, profile.speeds, profile.accelerations
    fastest = max(printer.max_speed_x, printer.max_speed_y)
    hardest = max(printer.max_acceleration_x, printer.max_acceleration_y)

    for key in (*NAMED, "support_interface", "first_layer_infill", "first_layer_travel"):
        assert 0 < getattr(speeds, key) <= fastest, key
    assert speeds.first_layer <= speeds.first_layer_travel <= speeds.travel
    assert 0 < printer.acceleration <= hardest
    assert 0 < printer.travel_acceleration <= hardest
    for key in hard.__struct_fields__:
        assert getattr(hard, key) <= printer.acceleration, key


@pytest.mark.parametrize("name", PRINTERS)
def test_pla_takes_what_its_hotend_melts_and_other_materials_no_more(name: str) -> None:
    hotend = load_profile(name).printer.hotend_max_flow

    assert load_profile(name, "pla").max_flow == hotend
    tpu = load_profile(
        name, "tpu", changes={"nozzle_temperature": 200, "first_layer_nozzle_temperature": 200}
    )
    assert tpu.max_flow == min(tpu.material.max_flow, hotend)
