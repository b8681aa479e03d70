"""What speeds, accelerations and flow come to: quality over printer, within machine and material."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from printer_slicer.gcode_text import gcode_of
from printer_slicer.model import Acceleration, Mesh
from printer_slicer.pipeline import slice_stages
from printer_slicer.profile import Profile, load_profile, profile_with
from printer_slicer.roles import Role
from tests.parts import box, loft, two_boxes

BARE = """
name = "bare"
bed_x = 200
bed_y = 200
bed_z = 200
"""
OLD = {
    "external_perimeter": 35,
    "perimeter": 50,
    "internal_infill": 70,
    "solid_infill": 60,
    "top_solid_infill": 40,
    "ironing": 15,
    "bridge": 30,
    "internal_bridge": 40,
    "raft": 30,
    "first_layer": 20,
    "small_perimeter": 0,
    "travel": 150,
}
"""What every printer had before printers had speeds of their own."""

FAST = """
max_speed_x = 400
max_speed_y = 300
acceleration = 8000
hotend_max_flow = 20
pla_pressure_advance = 0.03

[speeds]
external_perimeter = 200
perimeter = 300
internal_infill = 300
top_solid_infill = 150
bridge = 50
support = 120
support_interface = 60
travel = 500
first_layer = 50
first_layer_infill = 100
first_layer_travel = 250

[accelerations]
default = 6000
external_perimeter = 4000
solid_infill = 9000
first_layer = 500
"""


def _printer(folder: Path, more: str = "") -> str:
    path = folder / "machine.toml"
    path.write_text(BARE + more)
    return str(path)


@pytest.fixture(scope="module")
def bare(tmp_path_factory: pytest.TempPathFactory) -> Profile:
    return load_profile(_printer(tmp_path_factory.mktemp("bare")), quality="standard")


@pytest.fixture(scope="module")
def fast(tmp_path_factory: pytest.TempPathFactory) -> Profile:
    return load_profile(_printer(tmp_path_factory.mktemp("fast"), FAST), quality="standard")


def test_a_printer_without_speeds_prints_as_before(bare: Profile) -> None:
    assert {name: getattr(bare.speeds, name) for name in OLD} == OLD
    assert bare.speeds.gap_fill == bare.speeds.perimeter
    assert bare.speeds.first_layer_infill == bare.speeds.first_layer
    assert bare.speeds.first_layer_travel == bare.speeds.travel
    assert bare.max_flow == 12
    assert bare.pressure_advance == 0
    hard = msgspec.to_builtins(bare.accelerations)
    assert hard.pop("first_layer") == 0
    assert set(hard.values()) == {bare.printer.acceleration}


def test_a_quality_without_speeds_takes_the_printers_within_its_axes(fast: Profile) -> None:
    speeds = fast.speeds
    assert (speeds.external_perimeter, speeds.perimeter, speeds.top_solid_infill) == (200, 300, 150)
    assert (speeds.gap_fill, speeds.support, speeds.support_interface, speeds.raft) == (300, 120, 60, 120)
    assert speeds.travel == 400, "the faster of both axes is the most"
    assert (speeds.first_layer, speeds.first_layer_infill, speeds.first_layer_travel) == (50, 100, 250)
    hard = fast.accelerations
    assert (hard.default, hard.external_perimeter, hard.internal_infill, hard.first_layer) == (
        6000,
        4000,
        6000,
        500,
    )
    assert hard.solid_infill == 8000, "printer.acceleration is the most"


def test_a_quality_scales_and_caps_what_it_leaves_to_the_printer(fast: Profile) -> None:
    changed = profile_with(fast, {"speeds.ratio": 0.5, "speeds.visible_most": 60})
    speeds = changed.speeds
    assert (speeds.external_perimeter, speeds.top_solid_infill) == (60, 60)
    assert (speeds.perimeter, speeds.internal_infill, speeds.support) == (150, 150, 60)
    untouched = ("bridge", "travel", "first_layer", "first_layer_infill", "first_layer_travel")
    for name in untouched:
        assert getattr(speeds, name) == getattr(fast.speeds, name), name


def test_what_a_quality_names_wins_unscaled(fast: Profile) -> None:
    wanted = {"speeds.external_perimeter": 90, "speeds.first_layer": 15, "accelerations.default": 700}
    changed = profile_with(fast, {**wanted, "speeds.ratio": 0.5, "speeds.visible_most": 60})
    assert changed.speeds.external_perimeter == 90
    assert changed.speeds.first_layer == changed.speeds.first_layer_infill == 15
    assert changed.accelerations.external_perimeter == changed.accelerations.solid_infill == 700
    assert profile_with(changed, {"accelerations.solid_infill": 900}).accelerations.solid_infill == 900


def test_keys_without_a_section_mean_the_quality(fast: Profile) -> None:
    changed = profile_with(fast, {"speeds.travel": 123, "printer.speeds.bridge": 77})
    assert changed.quality.speeds.travel == 123
    assert changed.printer.speeds.travel == 500
    assert changed.speeds.bridge == 77


@pytest.mark.parametrize(
    ("hotend", "material", "flow"),
    [(0, 0, 12), (0, 20, 20), (20, 0, 20), (20, 9, 9), (10, 15, 10)],
)
def test_hotend_and_material_cap_the_flow(fast: Profile, hotend: float, material: float, flow: float) -> None:
    changed = profile_with(fast, {"hotend_max_flow": hotend, "max_flow": material})
    assert changed.max_flow == flow


def test_pressure_advance_of_the_printer_is_for_pla_that_names_none(fast: Profile) -> None:
    assert fast.pressure_advance == 0.03
    assert profile_with(fast, {"material.pressure_advance": 0.05}).pressure_advance == 0.05
    assert profile_with(fast, {"material.type": "PETG"}).pressure_advance == 0
    assert profile_with(fast, {"printer.flavour": "repetier"}).pressure_advance == 0


def test_the_file_tells_the_pressure_advance_of_the_printer(fast: Profile) -> None:
    program = slice_stages(box((10, 10, 0.6)), fast).program
    assert b"\nM900 K0.03\n" in gcode_of(program, fast)


def test_the_first_layer_has_speeds_of_its_own(fast: Profile) -> None:
    wanted = profile_with(fast, {"min_layer_time": 0, "max_flow": 200, "hotend_max_flow": 0})
    program = slice_stages(two_boxes((20, 20, 0.6)), wanted).program
    first, speed = program.layer == 0, program.speed
    walls = (program.role == Role.EXTERNAL_PERIMETER) | (program.role == Role.PERIMETER)
    flat = (
        (program.xyz[:, 2] == program.start[:, 2]) & (program.role == Role.TRAVEL) & (program.filament == 0)
    )
    assert np.unique(speed[first & walls]).tolist() == [50]
    assert np.unique(speed[first & (program.role == Role.BOTTOM_SOLID_INFILL)]).tolist() == [60]
    assert speed[first & flat].max() == 250
    assert speed[~first & flat].max() == 400


def test_rafts_end_in_an_interface(fast: Profile) -> None:
    wanted = profile_with(
        fast, {"min_layer_time": 0, "raft_height": 0.9, "hotend_max_flow": 0, "max_flow": 200}
    )
    program = slice_stages(box((20, 20, 0.6)), wanted).program
    raft = program.role == Role.RAFT
    last = program.layer[raft].max()
    assert last >= 2
    assert program.speed[raft & (program.layer == last)].max() == 60
    assert program.speed[raft & (program.layer == last - 1)].max() == 120


def test_accelerations_of_the_printer_are_in_the_program(fast: Profile) -> None:
    program = slice_stages(box((20, 20, 1.2)), fast).program
    begins = [event for event in program.events if isinstance(event, Acceleration)]
    first = np.flatnonzero(program.layer > 0)[0]
    assert {event.value for event in begins if event.index < first} == {500}
    assert {event.value for event in begins if event.index >= first} <= {4000, 6000, 8000}
    assert 4000 in {event.value for event in begins}


def test_overhangs_keep_the_limits_of_the_printer(bare: Profile) -> None:
    """A cone that widens upward: the printer's limits hold between its points, those of the ratios below them."""
    changes = {"min_layer_time": 0, "printer.speeds.external_perimeter": 100, "printer.speeds.bridge": 40}
    limits = {"printer.speeds.overhang_50": 30, "printer.speeds.overhang_25": 20}
    mesh = cone_upward()
    free, held = (
        slice_stages(mesh, profile_with(bare, {**changes, **more})).program for more in ({}, limits)
    )
    hangs = free.role == Role.OVERHANG_PERIMETER
    assert hangs.any()
    assert (held.speed <= free.speed + 1e-9).all()
    assert held.speed[hangs & (held.layer > 0)].max() <= 30 + 1e-9 < free.speed[hangs].max()


def cone_upward() -> Mesh:
    """A cone on its tip's stump, 30 degrees from the bed."""
    turn = np.linspace(0, 2 * np.pi, 48, endpoint=False)
    ring = np.column_stack([np.cos(turn), np.sin(turn)])
    return Mesh(loft([ring * 5, ring * 8], [0, 2.0]), "cone")


@given(usual=st.floats(1, 900), named=st.floats(0, 900), ratio=st.floats(0.1, 5), most=st.floats(0, 900))
def test_a_derived_speed_keeps_every_cap_and_a_named_one_is_itself(
    bare: Profile, usual: float, named: float, ratio: float, most: float
) -> None:
    printer = msgspec.structs.replace(
        bare.printer,
        max_speed_x=400,
        max_speed_y=200,
        speeds=msgspec.structs.replace(bare.printer.speeds, external_perimeter=usual),
    )
    wanted: Any = msgspec.structs.replace(
        bare.quality.speeds, external_perimeter=named, ratio=ratio, visible_most=most
    )
    quality = msgspec.structs.replace(bare.quality, speeds=wanted)
    speed = Profile(printer=printer, material=bare.material, quality=quality).speeds.external_perimeter
    if named:
        assert speed == named
    else:
        assert 0 < speed <= min(usual * ratio, most or speed, 400) + 1e-9
