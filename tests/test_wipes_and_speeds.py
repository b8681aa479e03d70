"""Wipes, hops, and speeds that depend on more than the role."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from printer_slicer.arrays import Bool, Float
from printer_slicer.commands import split_gcode
from printer_slicer.extrusion import extrude, move_seconds
from printer_slicer.firmware import FLAVOURS
from printer_slicer.gcode import read_moves
from printer_slicer.gcode_text import gcode_of
from printer_slicer.model import Acceleration, LayerPlan, Program
from printer_slicer.motion.rules import limits_of
from printer_slicer.pipeline import slice_stages
from printer_slicer.profile import Profile
from printer_slicer.roles import Role
from tests.parts import box, box_with_hole, plain, profile, sphere, two_boxes

UNEVEN = LayerPlan.from_tops(np.cumsum([0.3, 0.1, 0.2, 0.3, 0.15, 0.25, 0.3, 0.1]))
BOXES = two_boxes((6.0, 6.0, 1.7))
SCALE = {"printer.max_speed_e": 60, "quality.speeds.travel": 120}


def program_of(wanted: Profile, mesh: Any = BOXES, plan: LayerPlan = UNEVEN) -> Program:
    return slice_stages(mesh, wanted, plan=plan).program


def pulls(program: Program) -> Bool:
    return np.asarray(program.filament < 0)


def speed_of(program: Program, role: Role) -> Float:
    beads = program.role == role
    highest = np.zeros(program.plan.n_layers)
    np.maximum.at(highest, program.layer[beads], program.speed[beads])
    return highest


# --- wipes ---


@pytest.mark.parametrize("length", [0.5, 2.0, 20.0])
def test_a_wipe_goes_over_the_last_bead_and_pulls_back_as_much_as_standing_does(length: float) -> None:
    straight = program_of(plain(wipe_distance=0))
    wiped = program_of(plain(wipe_distance=length))

    moving = pulls(wiped) & (np.hypot(*(wiped.xyz - wiped.start)[:, :2].T) > 0)
    assert moving.sum() >= 8
    assert wiped.filament[pulls(wiped)].sum() == pytest.approx(straight.filament[pulls(straight)].sum())
    assert wiped.filament_used == pytest.approx(straight.filament_used)
    for move in np.flatnonzero(moving).tolist():
        same = (wiped.layer == wiped.layer[move]) & (wiped.role != Role.TRAVEL)
        assert _distance(wiped.xyz[move, :2], wiped.start[same, :2], wiped.xyz[same, :2]) < 1e-6


def _distance(point: Float, begin: Float, end: Float) -> float:
    way, to = end - begin, point - begin
    share = np.clip((to * way).sum(axis=1) / (way * way).sum(axis=1), 0, 1)
    return float(np.hypot(*(to - way * share[:, None]).T).min())


def test_a_wipe_is_as_long_as_asked_for_and_the_extruder_keeps_its_speed() -> None:
    wanted = plain(wipe_distance=2.0, infill_density=0, bottom_thickness=0, top_thickness=0)
    program = program_of(wanted)

    moving = pulls(program) & (np.hypot(*(program.xyz - program.start)[:, :2].T) > 0)
    begins = np.flatnonzero(moving & ~np.append(False, moving[:-1]))
    step = np.where(moving, np.hypot(*(program.xyz - program.start)[:, :2].T), 0)
    lengths = np.add.reduceat(step, begins)
    assert lengths == pytest.approx(np.full(len(begins), 2.0))
    rate = -program.filament[moving] / (step[moving] / program.speed[moving])
    assert rate.max() <= wanted.printer.retract_speed + 1e-9


@pytest.mark.parametrize("length", [0.0, 2.0])
def test_what_is_pulled_back_standing_stands_behind_a_bead_too_short_to_be_laid(length: float) -> None:
    """Loops that close by a bead of 2 µm: it is left out, and the retraction must not make its way instead."""
    wanted = plain(wipe_distance=length)
    stages = slice_stages(BOXES, wanted, plan=UNEVEN)
    paths, xy = stages.toolpaths, stages.toolpaths.xy.copy()
    closed = paths.closed & (np.diff(paths.start) > 2)
    xy[paths.start[1:][closed] - 1] = xy[paths.start[:-1][closed]] + np.array([0.002, 0.0])
    program = extrude(replace(paths, xy=xy), stages.travels, wanted)

    way = np.hypot(*(program.xyz - program.start)[:, :2].T)
    pulled = program.filament < 0
    slow = wanted.printer.retract_speed * way[pulled] / wanted.speeds.travel
    assert (np.where(way[pulled] > 0, -program.filament[pulled] <= slow + 1e-6, True)).all()


def test_what_is_pushed_forward_may_be_more_than_what_was_pulled_back() -> None:
    wanted = plain(deretract_extra=0.1)
    program = program_of(wanted)

    travels = program.role == Role.TRAVEL
    pushed = program.filament[travels & (program.filament > 0)]
    assert pushed == pytest.approx(np.full(len(pushed), wanted.printer.retract_length + 0.1))


def test_a_ramped_hop_rises_on_the_way_and_a_straight_one_on_the_spot() -> None:
    straight = program_of(plain(z_hop=0.4))
    ramped = program_of(plain(z_hop=0.4, z_hop_ramp=True))

    for program, slope in ((straight, False), (ramped, True)):
        way = program.xyz - program.start
        up = (way[:, 2] > 0.35) & (np.arange(len(way)) > 0)
        assert up.sum() >= 8
        assert ((np.hypot(*way[up, :2].T) > 1.0) == slope).all()
        down = (way[:, 2] < -0.35) & (np.arange(len(way)) > 2)
        assert (np.hypot(*way[down, :2].T) == 0).all()
    assert straight.xyz[-2] == pytest.approx(ramped.xyz[-2])


# --- speeds ---


def test_small_holes_are_slower_and_the_outside_is_not() -> None:
    wanted = plain(quality__speeds__small_perimeter=11, quality__speeds__small_perimeter_radius=3)
    program = program_of(wanted, box_with_hole((20, 20, 1.7), (4.0, 4.0)))

    outer = (program.role == Role.EXTERNAL_PERIMETER) & (program.layer > 0)
    inside = (np.abs(program.xyz[:, :2] - program.xyz[outer, :2].mean(axis=0)) < 4).all(axis=1)
    assert program.speed[outer & inside] == pytest.approx(11)
    assert program.speed[outer & ~inside] == pytest.approx(wanted.speeds.external_perimeter)


def test_speeds_grow_from_the_first_layer_up() -> None:
    wanted = plain(quality__speeds__slow_below=1.3)
    program = program_of(wanted)
    low, high = wanted.speeds.first_layer, wanted.speeds.external_perimeter

    speeds = speed_of(program, Role.EXTERNAL_PERIMETER)
    share = np.clip((UNEVEN.top - 0.3) / (1.3 - 0.3), 0, 1)
    assert speeds == pytest.approx(low + share * (high - low))


def test_an_even_flow_slows_thick_layers_and_hurries_thin_ones_within_a_factor() -> None:
    wanted = plain(quality__speeds__even_flow_ratio=1, quality__speeds__even_flow_most=1.5)
    speeds = speed_of(program_of(wanted), Role.EXTERNAL_PERIMETER)

    assert speeds[1:] == pytest.approx(
        wanted.speeds.external_perimeter * np.clip(0.2 / UNEVEN.height[1:], 1 / 1.5, 1.5)
    )


def test_the_first_layer_melts_less() -> None:
    program = program_of(plain(max_flow=2.0, first_layer_max_flow_ratio=0.5))

    beads = program.role != Role.TRAVEL
    area = (
        program.filament
        * np.pi
        * 1.75**2
        / 4
        / np.maximum(np.linalg.norm(program.xyz - program.start, axis=1), 1e-9)
    )
    flow = area * program.speed
    first = program.layer == 0
    assert flow[beads & first].max() == pytest.approx(1.0, rel=1e-6)
    assert flow[beads & ~first].max() == pytest.approx(2.0, rel=1e-6)


# --- minimum layer time ---


def test_what_is_hidden_is_slowed_down_before_what_is_seen() -> None:
    quick = program_of(plain(), box((14, 14, 1.7)))
    seconds = np.bincount(quick.layer, weights=move_seconds(quick, plain()))
    wanted = plain(min_layer_time=float(seconds[4]) * 1.25, min_speed=5)
    slow = program_of(wanted, box((14, 14, 1.7)))

    assert np.array_equal(slow.xyz, quick.xyz)
    changed = slow.speed < quick.speed - 1e-9
    hidden = np.isin(
        quick.role, [Role.PERIMETER, Role.INTERNAL_INFILL, Role.SOLID_INFILL, Role.BOTTOM_SOLID_INFILL]
    )
    assert changed[hidden & (quick.layer == 4)].any()
    assert not changed[(quick.role == Role.EXTERNAL_PERIMETER) & (quick.layer == 4)].any()


def test_when_that_is_not_enough_everything_is_slowed_down() -> None:
    wanted = plain(min_layer_time=60, min_speed=5)
    slow = program_of(wanted, sphere(2), LayerPlan.from_tops(np.arange(1, 17) * 0.25))

    beads = (slow.role != Role.TRAVEL) & (slow.filament > 0.01)
    assert slow.speed[beads].max() < 8


# --- accelerations ---


@pytest.mark.parametrize("printer", ["marlin_220", "corexy_klipper"])
def test_every_role_has_its_acceleration_and_the_time_follows(printer: str) -> None:
    asked = {
        "external_perimeter": 300,
        "perimeter": 400,
        "internal_infill": 450,
        "first_layer": 200,
        "bridge": 150,
    }
    changes = {f"quality.accelerations.{name}": value for name, value in asked.items()}
    wanted = profile(printer, **{"min_layer_time": 0} | changes)
    usual = profile(printer, min_layer_time=0)
    slow, quick = (slice_stages(box((14, 14, 1.7)), one, plan=UNEVEN).program for one in (wanted, usual))

    events = [event for event in slow.events if isinstance(event, Acceleration)]
    at = np.searchsorted([event.index for event in events], np.arange(slow.n_moves), side="right") - 1
    value = np.array([event.value for event in events])[at]
    above, beads = slow.layer > 0, slow.role != Role.TRAVEL
    assert (value[beads & ~above] == 200).all()
    for role, expected in (
        (Role.EXTERNAL_PERIMETER, 300),
        (Role.PERIMETER, 400),
        (Role.INTERNAL_INFILL, 450),
    ):
        assert (value[above & (slow.role == role)] == expected).all()
    assert (value[slow.role == Role.SOLID_INFILL] == wanted.printer.acceleration).all()
    assert move_seconds(slow, wanted).sum() > 1.02 * move_seconds(quick, usual).sum()
    # What other programs read from the file takes as long.
    beads_only = profile(printer, **{"min_layer_time": 0, "start_gcode": "", "end_gcode": ""} | changes)
    commands = split_gcode(gcode_of(slow, beads_only)).commands
    moves = read_moves(commands, wanted.printer.corners[0], FLAVOURS[wanted.printer.flavour])
    assert moves.seconds(limits_of(wanted.printer)) == pytest.approx(
        move_seconds(slow, wanted).sum(), rel=2e-3
    )
