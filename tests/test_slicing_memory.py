"""What slicing keeps in memory: released parts and areas, and arrays that do not grow with the job."""

from __future__ import annotations

import tracemalloc
import weakref
from collections.abc import Callable

import numpy as np
import pytest

from printer_slicer.extrusion.timing import _compute_seconds
from printer_slicer.firmware import FLAVOURS
from printer_slicer.gcode.writer import ProgramFacts, write_program
from printer_slicer.gcode_text import gcode_of
from printer_slicer.geometry.plane_sections import intersect_with_planes
from printer_slicer.model import LayerPlan, Program
from printer_slicer.pipeline import slice_for_output, slice_stages
from printer_slicer.roles import Role
from tests.parts import box, profile, sphere

_FEW, _MANY = 1 << 16, 1 << 18
_PER_LAYER = 1 << 11  # moves


def _make_zigzag(n_moves: int) -> Program:
    """A program of short extrusions to and fro."""
    at, plan = np.arange(n_moves), LayerPlan.from_tops(0.2 * np.arange(1, n_moves // _PER_LAYER + 1))
    xyz = np.column_stack([at % 100 * 1.5, at // 100 * 0.05, plan.top[at // _PER_LAYER]])
    ones = np.ones(n_moves)
    role = np.full(n_moves, Role.INTERNAL_INFILL)
    return Program(
        plan, np.zeros(3), xyz, ones * 0.05, ones * 60, at // _PER_LAYER, role, ones * 0.4, ones * 0.2
    )


def _measure_peak(run: Callable[[], object]) -> int:
    """Return the memory, bytes, that a function allocates at its peak."""
    tracemalloc.start()
    try:
        run()
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


def _grow_per_move(run: Callable[[Program], object]) -> float:
    """Return by how many bytes per move the peak of a function grows with the program."""
    few, many = _make_zigzag(_FEW), _make_zigzag(_MANY)
    run(few)  # what is allocated once is not counted
    peaks = [_measure_peak(lambda program=program: run(program)) for program in (few, many)]
    return (peaks[1] - peaks[0]) / (_MANY - _FEW)


def _bytes_per_move() -> float:
    """Return the bytes of the arrays of a program per move."""
    program = _make_zigzag(_FEW)
    names = ("xyz", "filament", "speed", "layer", "role", "width", "height", "z_top", "tool")
    return sum(getattr(program, name).nbytes for name in names) / _FEW


def _write_in_pieces(program: Program) -> None:
    """Write a program piece by piece, and keep no piece."""
    used = profile()
    facts = ProgramFacts(seconds=np.full(program.n_moves, 0.025))
    for _ in write_program(program, used, FLAVOURS[used.printer.flavour], facts):
        pass


def test_text_is_not_kept_in_memory() -> None:
    assert _grow_per_move(_write_in_pieces) < 0.5 * _bytes_per_move()


def test_times_take_little_more_memory_at_their_peak_than_the_moves() -> None:
    used = profile()
    grown = _grow_per_move(lambda one: _compute_seconds(one, one.speed, used, 0, one.n_moves))
    assert grown < 1.75 * _bytes_per_move()


def test_crossings_are_computed_a_few_planes_at_a_time() -> None:
    part = sphere()
    low, high = part.bounds[:, 2]
    planes = np.linspace(low, high, 4002)[1:-1]

    def count_longest(chosen: np.ndarray) -> int:
        return max(len(one.tail) for one in intersect_with_planes(part.triangles, chosen))

    total = sum(len(one.tail) for one in intersect_with_planes(part.triangles, planes))
    assert count_longest(planes) < total / 2
    assert count_longest(planes) <= 1.1 * count_longest(planes[::2])


def test_the_mesh_is_released_before_layers_are_planned() -> None:
    meshes = [box()]
    given = weakref.ref(meshes[0])
    alive: dict[str, bool] = {}

    def report(stage: str) -> None:
        alive[stage] = given() is not None

    slice_for_output(meshes, profile(), report=report)
    assert alive["placing"]
    assert not alive["planning"]
    assert not alive["slicing"]


@pytest.mark.parametrize("brim", [0, 3])
def test_released_stages_give_the_same_text(brim: float) -> None:
    used = profile(brim_width=brim)
    kept, released = slice_stages(box(), used), slice_for_output([box()], used)
    assert gcode_of(kept.program, used, part=kept.part) == gcode_of(
        released.program, used, part=released.part
    )
    assert released.walls.paths.n_paths == 0
    assert (released.walls.lost == kept.walls.lost).all()
    around = (Role.SKIRT, Role.BRIM)
    assert set(released.toolpaths.role.tolist()) <= set(around)
    assert released.toolpaths.n_paths == np.isin(kept.toolpaths.role, around).sum()
