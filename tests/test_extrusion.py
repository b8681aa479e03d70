"""Filament, speed, retraction, cooling: each layer by its own height."""

from __future__ import annotations

from functools import cache
from math import pi
from typing import Any, TypeVar

import numpy as np
import pytest

from printer_slicer import bead
from printer_slicer.arrays import Bool, Float
from printer_slicer.errors import PartError
from printer_slicer.extrusion import extrude, move_seconds
from printer_slicer.model import Areas, Fan, Heat, LayerPlan, Mesh, Program, Sections, Toolpaths
from printer_slicer.pipeline import slice_part, slice_stages
from printer_slicer.profile import Profile
from printer_slicer.roles import Role
from printer_slicer.stages import Stages
from printer_slicer.travels import travel
from tests.effort import crossed
from tests.parts import (
    box,
    box_with_hole,
    joined,
    layers,
    plain,
    profile,
    shape,
    shapely,
    sphere,
    step_pyramid,
    two_boxes,
)

UNEVEN = LayerPlan.from_tops(np.array([0.3, 0.38, 0.6, 0.92, 1.0, 1.32, 1.5, 1.8, 2.1, 2.2]))
MESHES = [
    box((9, 9, 2.2)),
    two_boxes((6, 6, 2.2)),
    box_with_hole((16, 16, 2.2)),
    sphere(3),
    step_pyramid([14, 9, 5], [0.9, 0.4, 0.9]),
]
each_mesh = pytest.mark.parametrize("mesh", MESHES, ids=lambda mesh: mesh.name)
PRINTERS = ["marlin_220", "corexy_klipper"]
each_printer = pytest.mark.parametrize("printer", PRINTERS)
each_mesh_and_printer = pytest.mark.parametrize(("mesh", "printer"), crossed(MESHES, PRINTERS))


def usual(printer: str = "marlin_220", **changes: Any) -> Profile:
    return profile(printer, **changes)


@cache
def made(mesh: Mesh, wanted: Profile) -> Stages:
    return slice_stages(mesh, wanted, plan=UNEVEN)


def is_bead(program: Program) -> Bool:
    return np.asarray(program.role != Role.TRAVEL)


def travelled(program: Program) -> Float:
    """(K,) mm in x and y."""
    return np.asarray(np.hypot(*(program.xyz - program.start)[:, :2].T))


# --- where ---


@each_mesh_and_printer
def test_beads_run_along_the_toolpaths_and_nowhere_else(printer: str, mesh: Mesh) -> None:
    stages = made(mesh, usual(printer))
    paths, program = stages.toolpaths, stages.program
    segments, widths = [], []
    for i in range(paths.n_paths):
        xy, width = paths.path(i), paths.width[paths.start[i] : paths.start[i + 1]]
        ends = np.concatenate([xy, xy[:1]]) if paths.closed[i] else xy
        wide = np.append(width, width[:1]) if paths.closed[i] else width
        moves = np.hypot(*np.diff(ends, axis=0).T) > 0.003  # else the width changes at once
        segments.append(np.stack([ends[:-1], ends[1:]], axis=1)[moves])
        widths.append(((wide[:-1] + wide[1:]) / 2)[moves])

    laid = np.stack([program.start, program.xyz], axis=1)[is_bead(program)]
    wanted = np.concatenate(segments)
    assert np.array_equal(laid[:, 1, :2], wanted[:, 1])
    # What is shorter than 3 µm is laid with the bead after it.
    assert laid[:, 0, :2] == pytest.approx(wanted[:, 0], abs=0.003)
    role = program.role[is_bead(program)]
    given = np.repeat(paths.role, [len(one) for one in segments])
    # A perimeter's bead that hangs has a name of its own.
    hangs = role == Role.OVERHANG_PERIMETER
    assert set(given[hangs].tolist()) <= {Role.PERIMETER, Role.EXTERNAL_PERIMETER}
    assert np.array_equal(role[~hangs], given[~hangs])
    assert program.width[is_bead(program)] == pytest.approx(np.concatenate(widths))


def test_steps_too_short_to_be_written_are_no_moves() -> None:
    xy = np.array([(0, 0), (10, 0), (10.0012, 0), (20, 0), (20, 0.0014)], np.float64)
    plan = layers(1, 0.2)
    paths = Toolpaths.gathered(
        plan,
        xy=xy,
        size=np.array([5]),
        layer=np.zeros(1, np.int64),
        role=np.array([Role.SOLID_INFILL]),
        width=np.full(5, 0.45),
        closed=False,
    )
    program = extrude(paths, travel(paths, Sections(plan, Areas.empty(1)), usual()), usual())

    assert program.xyz[is_bead(program), 0].tolist() == [10, 20]


@each_mesh_and_printer
def test_beads_lie_at_the_top_of_their_layer(printer: str, mesh: Mesh) -> None:
    program = made(mesh, usual(printer)).program
    beads = is_bead(program)

    assert np.array_equal(program.xyz[beads, 2], UNEVEN.top[program.layer[beads]])
    assert np.array_equal(program.start[beads, 2], UNEVEN.top[program.layer[beads]])


@each_mesh_and_printer
def test_layers_ascend_and_no_move_goes_below_its_layer_or_far_above(printer: str, mesh: Mesh) -> None:
    wanted = usual(printer)
    program = made(mesh, wanted).program

    assert (np.diff(program.layer) >= 0).all()
    below = np.where(program.layer > 0, UNEVEN.top[program.layer - 1], UNEVEN.top[0])
    assert (program.xyz[:, 2] >= below - 1e-9).all()
    later = program.layer > 0
    assert (program.xyz[later, 2] <= UNEVEN.top[program.layer[later]] + wanted.printer.z_hop + 1e-9).all()


def test_the_nozzle_arrives_above_the_first_layer_and_comes_down_at_the_first_path() -> None:
    program = made(box((9, 9, 2.2)), usual()).program

    assert program.origin[2] > UNEVEN.top[0] + 1
    assert program.xyz[0, 2] == program.origin[2]
    assert np.array_equal(program.xyz[1, :2], program.xyz[0, :2])
    assert program.xyz[1, 2] == UNEVEN.top[0]


def test_the_nozzle_never_moves_in_the_plane_of_a_layer_before_it_is_lifted_onto_it() -> None:
    program = made(two_boxes((6, 6, 2.2)), usual()).program
    change = np.flatnonzero(np.diff(program.layer) > 0) + 1

    for first in change.tolist():
        here = np.flatnonzero(program.layer == program.layer[first])
        moves = here[travelled(program)[here] > 0]
        assert program.start[moves[0], 2] >= UNEVEN.top[program.layer[first]]


# --- how much ---


@each_mesh_and_printer
def test_every_bead_gets_the_filament_of_its_width_and_its_layers_height(printer: str, mesh: Mesh) -> None:
    wanted = usual(printer, flow_ratio=0.97)
    program = made(mesh, wanted).program
    beads = is_bead(program)

    per_mm = bead.filament_per_mm(
        program.width, UNEVEN.height[program.layer], wanted.material.filament_diameter
    )
    # What is shorter than 3 µm is laid with the bead after it.
    assert program.filament[beads] == pytest.approx(
        0.97 * (per_mm * travelled(program))[beads], abs=0.003 * per_mm.max()
    )
    assert (travelled(program)[beads] > 0).all()


@each_mesh
def test_nothing_is_extruded_while_travelling(mesh: Mesh) -> None:
    program = made(mesh, usual()).program
    moving = ~is_bead(program) & (np.abs(program.xyz - program.start).max(axis=1) > 0)

    assert (program.filament[moving] == 0).all()
    assert (program.width[~is_bead(program)] == 0).all()


def test_filament_used_is_what_the_beads_contain() -> None:
    program = made(box((9, 9, 2.2)), usual()).program

    assert program.filament_used == pytest.approx(program.filament[is_bead(program)].sum())


@pytest.mark.parametrize(
    "changes", [{}, {"min_layer_time": 40, "min_speed": 1}, {"max_flow": 1.5}, {"speeds__travel": 40}]
)
def test_slowing_down_changes_no_filament_and_no_position(changes: dict[str, Any]) -> None:
    fast, slow = made(MESHES[1], usual(min_layer_time=0)).program, made(MESHES[1], usual(**changes)).program

    assert np.array_equal(fast.xyz, slow.xyz)
    assert np.array_equal(fast.filament, slow.filament)


# --- retraction ---


def pulled_back(program: Program) -> Float:
    """(K,) filament missing in the nozzle after each move."""
    return -np.cumsum(np.where(is_bead(program), 0.0, program.filament))


@each_mesh_and_printer
def test_what_is_pulled_back_is_pushed_forward_before_the_next_bead(printer: str, mesh: Mesh) -> None:
    wanted = usual(printer)
    program = made(mesh, wanted).program
    missing = np.round(pulled_back(program), 9)

    assert set(missing.tolist()) <= {0.0, wanted.printer.retract_length}
    assert (missing[is_bead(program)] == 0).all()
    assert missing[-1] == wanted.printer.retract_length


@each_mesh
def test_only_travels_that_are_long_enough_retract(mesh: Mesh) -> None:
    wanted = usual()
    program = made(mesh, wanted).program
    travels = ~is_bead(program) & (travelled(program) > 0)

    assert (
        travelled(program)[travels & (pulled_back(program) > 0)] > wanted.printer.retract_before_travel
    ).all()


def leaves_the_part(stages: Stages) -> Bool:
    """(K,) whether a long travel passes over air in its layer; ends within a bead of the outline do not count."""
    program = stages.program
    result = np.zeros(program.n_moves, bool)
    for move in np.flatnonzero(~is_bead(program) & (travelled(program) > 2)).tolist():
        way = shapely.LineString([program.start[move, :2], program.xyz[move, :2]])
        section = shape(stages.sections.solid, int(program.layer[move]))
        result[move] = shapely.length(shapely.difference(way, section)) > 0.5
    return result


@each_mesh
def test_travels_over_air_are_retracted(mesh: Mesh) -> None:
    stages = made(mesh, usual(skirt_loops=0))
    air = leaves_the_part(stages)
    air[: np.flatnonzero(is_bead(stages.program))[0]] = False

    assert (pulled_back(stages.program)[air] > 0).all()


def test_travels_between_islands_are_retracted_on_every_layer() -> None:
    program = made(two_boxes((6, 6, 2.2)), usual(skirt_loops=0)).program
    across = ~is_bead(program) & (travelled(program) > 9) & (np.arange(program.n_moves) > 0)

    assert across.sum() >= 10
    assert (pulled_back(program)[across] > 0).all()


def test_a_travel_that_leaves_by_one_corner_and_comes_in_by_another_is_retracted() -> None:
    """Seams in the rear right corners of two boxes on a diagonal: the way between them meets no side of either."""
    boxes = joined([box((10, 10, 2.2)), box((10, 10, 2.2), (20, 20, 0))])
    hollow: dict[str, Any] = {
        "perimeters": 1,
        "infill_density": 0,
        "top_thickness": 0,
        "bottom_thickness": 0,
        "seam": "rear",
    }
    program = made(boxes, usual(skirt_loops=0, **hollow)).program
    across = ~is_bead(program) & (travelled(program) > 20) & (np.arange(program.n_moves) > 0)

    assert across.sum() >= 10
    assert (pulled_back(program)[across] > 0).all()


def test_travels_within_the_part_are_not_retracted() -> None:
    stages = made(box((40, 40, 2.2)), usual(skirt_loops=0))
    travels = ~is_bead(stages.program) & (travelled(stages.program) > 2)
    travels &= stages.program.layer < UNEVEN.n_layers - 1  # over top skin they are

    assert travels[5:].sum() > 3
    assert (pulled_back(stages.program)[np.flatnonzero(travels)] == 0).all()


def test_retracted_travels_are_lifted_by_the_hop_and_others_are_not() -> None:
    wanted = usual("corexy_klipper", z_hop=0.4, skirt_loops=0)
    program = made(two_boxes((6, 6, 2.2)), wanted).program
    travels = (~is_bead(program) & (travelled(program) > 0))[1:]
    over = (program.xyz[:, 2] - UNEVEN.top[program.layer])[1:]

    assert travels.sum() > 20
    assert over[travels] == pytest.approx(np.where(pulled_back(program)[1:] > 0, 0.4, 0.0)[travels])


def test_a_printer_that_does_not_retract_never_turns_the_extruder_back() -> None:
    program = made(MESHES[1], usual(retract_length=0)).program

    assert (program.filament >= 0).all()


# --- how fast ---


@each_mesh_and_printer
def test_the_first_layer_is_slow(printer: str, mesh: Mesh) -> None:
    wanted = usual(printer, min_layer_time=0)
    program = made(mesh, wanted).program
    first = is_bead(program) & (program.layer == 0)
    walls = first & ~np.isin(
        program.role,
        (Role.BOTTOM_SOLID_INFILL, Role.SOLID_INFILL, Role.INTERNAL_INFILL, Role.TOP_SOLID_INFILL),
    )

    assert program.speed[walls].max() <= wanted.speeds.first_layer
    assert program.speed[first].max() <= wanted.speeds.first_layer_infill


def test_every_role_has_its_speed_above_the_first_layer() -> None:
    wanted = usual(min_layer_time=0, max_flow=100)
    program = slice_part(box((20, 20, 6)), wanted)
    speeds = wanted.speeds
    above = program.layer > 0

    for role, speed in (
        (Role.EXTERNAL_PERIMETER, speeds.external_perimeter),
        (Role.PERIMETER, speeds.perimeter),
        (Role.SOLID_INFILL, speeds.solid_infill),
        (Role.TOP_SOLID_INFILL, speeds.top_solid_infill),
        (Role.INTERNAL_INFILL, speeds.internal_infill),
    ):
        here = above & (program.role == role)
        assert here.any()
        assert np.unique(program.speed[here]).tolist() == [speed]


@pytest.mark.parametrize(("mesh", "max_flow"), crossed(MESHES, [0.5, 2.0, 5.0]))
def test_no_bead_asks_for_more_plastic_than_the_nozzle_melts(mesh: Mesh, max_flow: float) -> None:
    wanted = usual(max_flow=max_flow, min_layer_time=0, flow_ratio=1.1)
    program = made(mesh, wanted).program
    beads = is_bead(program)

    area = pi * wanted.material.filament_diameter**2 / 4
    flow = (program.filament * area / np.maximum(travelled(program), 1e-12) * program.speed)[beads]
    assert flow.max() <= max_flow * (1 + 1e-9)
    if max_flow < 5:
        assert flow.max() == pytest.approx(max_flow)


def test_thick_layers_are_slowed_by_the_flow_limit_and_thin_ones_are_not() -> None:
    wanted = usual(max_flow=4, min_layer_time=0, speeds__internal_infill=70)
    program = made(box((20, 20, 2.2)), wanted).program
    sparse = program.role == Role.INTERNAL_INFILL

    by_layer = {
        int(k): float(program.speed[sparse & (program.layer == k)].max())
        for k in np.unique(program.layer[sparse])
    }
    width = {k: float(program.width[sparse & (program.layer == k)].min()) for k in by_layer}
    assert by_layer == pytest.approx(
        {k: min(70.0, 4 / float(bead.cross_section(w, UNEVEN.height[k]))) for k, w in width.items()}
    )
    assert 70.0 in by_layer.values()
    assert min(by_layer.values()) < 40


def layer_seconds(program: Program, wanted: Profile) -> Float:
    seconds = np.bincount(program.layer, move_seconds(program, wanted), minlength=program.plan.n_layers)
    return seconds.astype(np.float64)


@pytest.mark.parametrize(
    ("printer", "limits", "mesh"),
    crossed(
        PRINTERS,
        [(8, 12), (8, 2), (20, 5), (3, 30)],
        [box((6, 6, 2.2)), box((15, 15, 2.2)), sphere(3)],
    ),
)
def test_layers_take_their_time_unless_beads_are_as_slow_as_allowed(
    printer: str, limits: tuple[float, float], mesh: Mesh
) -> None:
    wait, slowest = limits
    wanted = usual(printer, min_layer_time=wait, min_speed=slowest)
    program = made(mesh, wanted).program
    seconds, beads = layer_seconds(program, wanted), is_bead(program)

    for layer in np.unique(program.layer[beads]).tolist():
        fastest = program.speed[beads & (program.layer == layer)].max()
        assert (
            seconds[layer] > 0.97 * wait or fastest <= slowest * 1.005
        )  # slowing down further by less is not worth it


def test_no_layer_is_slowed_more_than_it_needs_to_be() -> None:
    wanted = usual(min_layer_time=8, min_speed=2)
    fast, slow = (made(box((9, 9, 2.2)), usual(min_layer_time=wait, min_speed=2)).program for wait in (0, 8))
    before, after = layer_seconds(fast, wanted), layer_seconds(slow, wanted)

    assert (after <= np.maximum(before, 8) * 1.01).all()


def test_no_bead_is_slower_than_the_slowest_speed_or_the_speed_it_would_have_anyway() -> None:
    wanted: dict[str, Any] = {"min_speed": 25, "speeds__first_layer": 10}
    program = made(box((6, 6, 2.2)), usual(min_layer_time=60, **wanted)).program
    free = made(box((6, 6, 2.2)), usual(min_layer_time=0, **wanted)).program
    beads = is_bead(program)

    assert (program.speed[beads] >= np.minimum(free.speed[beads], 25) - 1e-9).all()
    assert program.speed[beads & (program.layer == 0)].max() == 10


def test_slowing_down_spares_travels_and_retractions() -> None:
    slow, fast = (made(MESHES[1], usual(min_layer_time=wait)).program for wait in (60, 0))

    assert np.array_equal(slow.speed[~is_bead(slow)], fast.speed[~is_bead(fast)])


@each_printer
def test_travels_and_retractions_have_their_speeds(printer: str) -> None:
    wanted = usual(printer)
    program = made(two_boxes((6, 6, 2.2)), wanted).program
    flat = ~is_bead(program) & (travelled(program) > 0)
    upright = ~is_bead(program) & (travelled(program) == 0) & (program.filament == 0)

    assert np.unique(program.speed[flat]).tolist() == [wanted.speeds.travel]
    assert program.speed[upright].max() <= wanted.printer.max_speed_z
    assert np.unique(program.speed[program.filament < 0]).tolist() == [wanted.printer.retract_speed]
    pushes = ~is_bead(program) & (program.filament > 0)
    assert np.unique(program.speed[pushes]).tolist() == [wanted.printer.deretract_speed]


# --- events ---


E = TypeVar("E", Fan, Heat)


def events(program: Program, kind: type[E]) -> list[E]:
    return [event for event in program.events if isinstance(event, kind)]


def fan_at(program: Program) -> Float:
    """(K,) ratio in force during each move."""
    ratio = np.zeros(program.n_moves)
    for event in events(program, Fan):
        ratio[event.index :] = event.ratio
    return ratio


@each_mesh
def test_events_are_in_order_and_belong_to_moves(mesh: Mesh) -> None:
    program = made(mesh, usual()).program
    places = [event.index for event in program.events]

    assert places == sorted(places)
    assert all(0 <= place < program.n_moves for place in places)
    assert all(0 <= event.ratio <= 1 for event in events(program, Fan))


@pytest.mark.parametrize(("off", "full"), [(0.3, 0.8), (0.95, 1.6), (0, 0), (5, 6)])
def test_the_fan_is_off_up_to_its_height_and_never_weaker_further_up_the_ramp(
    off: float, full: float
) -> None:
    wanted = usual(
        fan_off_below=off, fan_full_above=full, fan_ratio=0.6, fan_ratio_max=0.6, fan_ratio_bridge=0
    )
    program = made(box((9, 9, 2.2)), wanted).program
    fan, top = fan_at(program), UNEVEN.top[program.layer]

    assert (fan[top <= off] == 0).all()
    assert fan[top >= max(full, 1e-9)] == pytest.approx(0.6)
    assert (np.diff(fan) >= 0).all()


def test_quick_layers_get_more_fan() -> None:
    wanted = usual(min_layer_time=5, fan_layer_time=30, fan_ratio=0.2, fan_ratio_max=1, fan_full_above=0.4)
    small, large = (fan_at(made(box((side, side, 2.2)), wanted).program)[-1] for side in (5, 60))

    assert small == pytest.approx(1.0, abs=0.06)
    assert large == pytest.approx(0.2)


def test_the_fan_is_strong_on_bridges() -> None:
    legs = [box((4, 10, 1.32)), box((4, 10, 1.32), (14, 0, 0)), box((18, 10, 0.88), (0, 0, 1.32))]
    wanted = usual(fan_ratio=0.3, fan_ratio_max=0.3, fan_ratio_bridge=1)
    program = made(joined(legs), wanted).program
    bridge = program.role == Role.BRIDGE

    assert bridge.any()
    assert (fan_at(program)[bridge] == 1).all()
    others = ~np.isin(program.layer, program.layer[bridge])
    assert fan_at(program)[others & (program.role == Role.EXTERNAL_PERIMETER)].max() == pytest.approx(0.3)


def test_temperatures_of_the_rest_of_the_part_come_with_the_second_layer() -> None:
    wanted = usual(
        first_layer_nozzle_temperature=220,
        nozzle_temperature=205,
        first_layer_bed_temperature=65,
        bed_temperature=60,
    )
    program = made(box((9, 9, 2.2)), wanted).program
    second = int(np.flatnonzero(program.layer == 1)[0])

    assert events(program, Heat) == [Heat(second, nozzle=205, bed=60)]


def test_temperatures_that_stay_are_not_set_again() -> None:
    same: dict[str, Any] = {
        "first_layer_nozzle_temperature": 210,
        "nozzle_temperature": 210,
        "first_layer_bed_temperature": 60,
    }

    assert events(made(box((9, 9, 2.2)), usual(**same)).program, Heat) == []
    only_bed = made(box((9, 9, 2.2)), usual(**same, bed_temperature=55)).program
    assert [(event.nozzle, event.bed) for event in events(only_bed, Heat)] == [(None, 55)]


# --- nothing to print ---


def test_a_part_too_thin_for_any_bead_is_refused_with_a_reason() -> None:
    with pytest.raises(PartError):
        slice_part(box((10, 0.05, 3)), plain())


def test_settings_that_lay_nothing_are_refused_with_a_reason() -> None:
    nothing = plain(perimeters=0, infill_density=0, top_thickness=0, bottom_thickness=0)

    with pytest.raises(PartError):
        slice_part(box(), nothing)


@pytest.mark.parametrize("raft", [0, 0.6])
def test_the_flow_of_the_first_layer_is_that_of_the_layer_on_the_bed(raft: float) -> None:
    more, usually = (
        slice_stages(box((9, 9, 2)), plain(first_layer_flow=flow, raft_height=raft, flow_ratio=0.9)).program
        for flow in (1.25, 1)
    )
    fed, beads = (
        more.filament / np.where(usually.filament == 0, 1, usually.filament),
        more.role != Role.TRAVEL,
    )

    assert fed[beads & (more.layer == 0)] == pytest.approx(1.25)
    assert fed[beads & (more.layer > 0)] == pytest.approx(1)


def test_the_flow_of_the_first_layer_stays_within_the_materials() -> None:
    wanted = plain(first_layer_flow=1.5, max_flow=1, speeds__first_layer=60)
    program = slice_part(box((30, 30, 1)), wanted)
    beads = (program.role != Role.TRAVEL) & (program.layer == 0)
    length = np.hypot(*(program.xyz - program.start)[beads, :2].T)
    flow = program.filament[beads] * pi * 1.75**2 / 4 * program.speed[beads] / length

    assert flow.max() == pytest.approx(1)
