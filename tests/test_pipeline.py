"""From a part to its G-code: what must hold for the whole, whatever the stages do."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Sequence
from functools import cache
from itertools import pairwise
from math import pi
from pathlib import Path

import numpy as np
import pytest

from printer_slicer.errors import MeshError, PartError, UsageError
from printer_slicer.gcode_text import gcode_of
from printer_slicer.geometry.engine import ENGINES, using_engine
from printer_slicer.mesh_io import export_stl
from printer_slicer.model import LayerPlan, Mesh, Program
from printer_slicer.pipeline import slice_part, slice_stages
from printer_slicer.profile import Profile
from printer_slicer.roles import Role
from tests.effort import crossed
from tests.parts import (
    box,
    box_with_hole,
    case_study,
    cone,
    joined,
    plain,
    prism,
    profile,
    pyramid,
    shape,
    shapely,
    sheared_prism,
    sphere,
    step_pyramid,
    turned,
    two_boxes,
    without,
)
from tests.tiny_gcode import commands


def plastic(program: Program, wanted: Profile) -> float:
    """mm³ in all beads."""
    fed = float(program.filament[program.role != Role.TRAVEL].sum())
    return fed * pi * wanted.material.filament_diameter**2 / 4


def uneven(height: float) -> LayerPlan:
    """Layers of 0.08 to 0.32 in no order that end at `height`."""
    rng = np.random.default_rng(5)
    tops = [0.2]
    while height - tops[-1] > 0.7:
        tops.append(round(tops[-1] + int(rng.integers(8, 33)) / 100, 2))
    rest = height - tops[-1]
    return LayerPlan.from_tops(np.array([*tops, tops[-1] + rest / 3, tops[-1] + rest / 3 * 2, height]))


# --- as much plastic as the part holds ---


SIZES = [(20.0, 20.0, 5.0), (40.0, 15.0, 3.0), (12.0, 80.0, 2.0), (10.0, 10.0, 5.0), (60.0, 60.0, 1.0)]


@pytest.mark.parametrize(("size", "layer_height"), crossed(SIZES, [0.16, 0.2, 0.32]), ids=str)
def test_a_solid_box_takes_its_volume_of_filament(
    size: tuple[float, float, float], layer_height: float
) -> None:
    wanted = plain(infill_density=1, layer_height=layer_height, first_layer_height=0)

    assert plastic(slice_part(box(size), wanted), wanted) == pytest.approx(np.prod(size), rel=0.01)


@pytest.mark.parametrize(("engine", "size"), crossed(ENGINES, SIZES), ids=str)
def test_a_solid_box_of_uneven_layers_takes_its_volume_of_filament(
    engine: str, size: tuple[float, float, float]
) -> None:
    wanted = plain(infill_density=1)
    with using_engine(engine):
        program = slice_part(box(size), wanted, plan=uneven(size[2]))

    assert plastic(program, wanted) == pytest.approx(size[0] * size[1] * size[2], rel=0.01)


@pytest.mark.parametrize(("layer_height", "side"), crossed([0.08, 0.1], [6.0, 10.0, 15.0]))
def test_thin_layers_do_not_overfill_small_boxes(side: float, layer_height: float) -> None:
    """What the infill overlaps the perimeters by must be what the round sides of the beads leave free."""
    wanted = plain(infill_density=1, layer_height=layer_height, first_layer_height=0)

    assert plastic(slice_part(box((side, side, 4.0)), wanted), wanted) == pytest.approx(4 * side**2, rel=0.01)


@pytest.mark.parametrize(("perimeters", "angle"), crossed([1, 2, 3, 6], [0, 30, 45]))
def test_neither_perimeters_nor_direction_change_how_much_a_solid_box_takes(
    perimeters: int, angle: float
) -> None:
    wanted = plain(infill_density=1, perimeters=perimeters, infill_angle_deg=angle)

    assert plastic(slice_part(box((25, 25, 2)), wanted), wanted) == pytest.approx(1250, rel=0.01)


@pytest.mark.parametrize("kind", ["uniform", "area"])
def test_solid_boxes_planned_either_way_take_the_same(kind: str) -> None:
    wanted = plain(planner__kind=kind, infill_density=1, thinnest_layer=0.16, first_layer_height=0)

    assert plastic(slice_part(box((25, 25, 4)), wanted), wanted) == pytest.approx(2500, rel=0.01)


@pytest.mark.parametrize(
    "mesh",
    [sphere(6), cone(8, 9), box_with_hole((30, 30, 4), (14, 10)), case_study(), sheared_prism()],
    ids=lambda m: m.name,
)
def test_solid_parts_of_any_shape_take_about_their_volume(mesh: Mesh) -> None:
    wanted = plain(infill_density=1)

    assert plastic(slice_part(mesh, wanted), wanted) == pytest.approx(mesh.volume, rel=0.02)


def test_sparse_parts_take_between_shell_and_solid() -> None:
    shell, sparse, solid = (
        plastic(slice_part(box((30, 30, 10)), plain(infill_density=density)), plain())
        for density in (0, 0.2, 1)
    )

    inside = solid - shell
    assert sparse - shell == pytest.approx(0.2 * inside, rel=0.1)


@pytest.mark.parametrize(("pattern", "density"), crossed(["grid", "rectilinear"], [0.2, 0.4]))
def test_sparse_density_is_the_share_of_the_sparse_area(pattern: str, density: float) -> None:
    wanted = plain(infill=pattern, infill_density=density, layer_height=0.25, first_layer_height=0)
    stages = slice_stages(box((80, 80, 3)), wanted)
    sparse = stages.program.role == Role.INTERNAL_INFILL

    fed = float(stages.program.filament[sparse].sum()) * pi * 1.75**2 / 4
    room = float(stages.regions.internal_infill.area() @ stages.program.plan.height)
    assert fed / room == pytest.approx(density, rel=0.06)


# --- the whole is consistent ---


def test_stages_share_one_plan_and_are_told_by_name() -> None:
    heard: list[str] = []
    stages = slice_stages(box(), plain(), report=heard.append)

    assert heard == [
        "repairing",
        "placing",
        "planning",
        "slicing",
        "perimeters",
        "regions",
        "toolpaths",
        "ordering",
        "travels",
        "extrusion",
    ]
    for value in (stages.sections, stages.walls, stages.regions, stages.toolpaths):
        assert value.plan is stages.program.plan


@pytest.mark.parametrize("none", [[], ()], ids=str)
def test_an_empty_list_of_plans_is_no_wish_for_the_planner(none: Sequence[LayerPlan]) -> None:
    with pytest.raises(UsageError, match=r"0 layer plans for 1 objects\n.*Give one plan for all"):
        slice_part(box(), plain(), plan=none)


def test_a_plan_given_is_the_plan_used() -> None:
    plan = LayerPlan.from_tops(np.array([0.3, 0.5, 0.9]))

    program = slice_part(box((10, 10, 0.9)), plain(), plan=plan)

    assert program.plan is plan
    assert sorted(set(program.xyz[program.role != Role.TRAVEL, 2].tolist())) == [0.3, 0.5, 0.9]


@pytest.mark.parametrize(
    ("engine", "mesh"),
    crossed(
        ENGINES,
        [sphere(4), box_with_hole((20, 20, 4)), step_pyramid([20, 12, 5], [1, 1, 2]), sheared_prism(8, 4, 6)],
    ),
)
def test_every_bead_lies_in_the_section_of_its_layer(engine: str, mesh: Mesh) -> None:
    """Half a width inside for perimeters; infill ends within the perimeters."""
    with using_engine(engine):
        stages = slice_stages(mesh, plain(infill_density=0.3))
    paths = stages.toolpaths
    for layer in range(stages.sections.plan.n_layers):
        room = shapely.buffer(shape(stages.sections.solid, layer), -(0.225 - 1e-3), join_style="mitre")
        for i in np.flatnonzero(paths.layer == layer).tolist():
            line = shapely.LinearRing(paths.path(i)) if paths.closed[i] else shapely.LineString(paths.path(i))
            assert shapely.length(shapely.difference(line, room)) < 1e-6


@pytest.mark.parametrize(
    ("printer", "quality"),
    crossed(["marlin_220", "marlin_220_06", "corexy_klipper"], ["standard", "adaptive", "strong"]),
)
def test_all_shipped_profiles_slice_a_part_within_the_bed(printer: str, quality: str) -> None:
    wanted = profile(printer, quality=quality)
    program = slice_part(step_pyramid([30, 20, 10], [1, 2, 1]), wanted)

    assert np.isfinite(program.xyz).all()
    assert np.isfinite(program.filament).all()
    assert (program.speed > 0).all()
    assert (program.xyz >= 0).all()
    assert (
        program.xyz.max(axis=0) <= [wanted.printer.bed_x, wanted.printer.bed_y, wanted.printer.bed_z]
    ).all()
    assert program.plan.top[-1] == pytest.approx(4)


def test_a_bed_around_its_middle_is_printed_on_around_zero() -> None:
    program = slice_part(box(), plain(origin="centre"))
    beads = program.xyz[program.role != Role.TRAVEL]

    assert beads[:, :2].min(axis=0) == pytest.approx([-5 + 0.225] * 2, abs=1e-4)
    assert beads[:, :2].max(axis=0) == pytest.approx([5 - 0.225] * 2, abs=1e-4)


def test_parts_that_do_not_fit_are_refused_with_both_sizes() -> None:
    with pytest.raises(PartError, match=r"300 x 10 x 10 mm does not fit.*220 x 220 x 250") as caught:
        slice_part(box((300, 10, 10)), plain())

    assert "scale" in caught.value.remedy


def test_open_parts_are_refused() -> None:
    turn = np.linspace(0, 2 * np.pi, 24, endpoint=False)
    pipe = prism(10 * np.column_stack([np.cos(turn), np.sin(turn)]), 5.0)
    middle = pipe.triangles.mean(axis=1)
    half = np.flatnonzero((middle[:, 0] < 0) | (middle[:, 2] == 0) | (middle[:, 2] == 5))

    with pytest.raises(MeshError, match="surface is open"):
        slice_part(without(pipe, *half.tolist()), plain())


def test_what_was_put_right_is_told_and_refused_when_that_is_asked_for() -> None:
    holed = without(box((10, 20, 5), (100, 0, 0)), 5)

    repairs = slice_stages(holed, plain()).repairs
    with pytest.raises(MeshError, match="needs repair: holes filled: 1, the first at x 110"):
        slice_part(holed, plain(), strict=True)

    assert [one.kind for one in repairs.done] == ["holes filled"]
    assert repairs.done[0].places[0, 0] == 110
    assert repairs.done[0].area == pytest.approx(50)
    assert slice_stages(box(), plain(), strict=True).repairs.count == 0


# --- the same part, put otherwise ---


PARTS = [
    box((17, 11, 3)),
    two_boxes((7, 9, 3)),
    box_with_hole((16, 16, 3), (6, 5)),
    sphere(4),
    step_pyramid([20, 12, 5], [1, 1, 1]),
    cone(5, 4),
]
each_part = pytest.mark.parametrize("mesh", PARTS, ids=lambda mesh: mesh.name)


SHIFTS = [
    (-8.499, 233.693, 260.426),
    (1.0, 2.0, 3.0),
    (0.1, 0.2, 0.3),
    (-100.25, 57.125, 10.5),
    (-85.323, 42.918, -106.878),
]
"""By binary numbers, and by what is none."""


@cache
def usual(mesh: Mesh) -> Program:
    return slice_part(mesh, plain())


@pytest.mark.parametrize(("mesh", "by"), crossed(PARTS, SHIFTS), ids=str)
def test_shifting_the_part_changes_nothing_in_the_gcode(mesh: Mesh, by: tuple[float, float, float]) -> None:
    wanted = plain()

    assert gcode_of(slice_part(mesh.moved(by), wanted), wanted) == gcode_of(usual(mesh), wanted)


@pytest.mark.parametrize(("mesh", "quarters"), crossed(PARTS, [1, 2, 3]))
def test_a_part_turned_by_right_angles_takes_the_same_filament(mesh: Mesh, quarters: int) -> None:
    wanted = plain()

    assert plastic(slice_part(turned(mesh, quarters), wanted), wanted) == pytest.approx(
        plastic(usual(mesh), wanted), rel=5e-3
    )


@each_part
def test_a_mirrored_part_takes_the_same_filament(mesh: Mesh) -> None:
    wanted = plain()
    mirrored = Mesh((mesh.triangles * [-1, 1, 1])[:, ::-1])

    assert plastic(slice_part(mirrored, wanted), wanted) == pytest.approx(
        plastic(usual(mesh), wanted), rel=5e-3
    )


@each_part
def test_the_order_of_facets_changes_no_filament(mesh: Mesh) -> None:
    wanted = plain()
    order = np.random.default_rng(1).permutation(mesh.n_facets)

    assert plastic(slice_part(Mesh(mesh.triangles[order]), wanted), wanted) == pytest.approx(
        plastic(usual(mesh), wanted), rel=1e-6
    )


@each_part
def test_both_engines_lay_the_same_plastic(mesh: Mesh) -> None:
    laid = []
    for engine in ENGINES:
        with using_engine(engine):
            laid.append(plastic(slice_part(mesh, plain()), plain()))

    assert laid[0] == pytest.approx(laid[1], rel=1e-3)


def test_twice_the_part_takes_twice_the_filament() -> None:
    wanted = plain()
    one, two = slice_part(box((7, 9, 3)), wanted), slice_part(two_boxes((7, 9, 3)), wanted)

    assert plastic(two, wanted) == pytest.approx(2 * plastic(one, wanted), rel=0.02)


def test_denser_infill_takes_more_plastic_and_more_time() -> None:
    wanted = [plain(infill_density=density) for density in (0.0, 0.1, 0.3, 0.6, 1.0)]
    laid = [plastic(slice_part(box((25, 25, 5)), one), one) for one in wanted]

    assert all(a < b for a, b in pairwise(laid))


# --- as a program ---


def test_a_plain_slice_loads_nothing_it_does_not_need(tmp_path: Path) -> None:
    export_stl(pyramid(), tmp_path / "part.stl")
    script = """
import sys
from pathlib import Path
from printer_slicer.mesh_io import load_mesh
from printer_slicer.gcode_text import gcode_of
from printer_slicer.pipeline import slice_part
from printer_slicer.profile import load_profile
profile = load_profile()
text = gcode_of(slice_part(load_mesh(Path(sys.argv[1])), profile), profile)
heavy = {"trimesh", "scipy", "networkx", "numba", "matplotlib", "serial", "rich", "pandas", "lxml"} & set(sys.modules)
print(len(text), sorted(heavy))
"""
    root = Path(__file__).parents[1]
    done = subprocess.run(
        [sys.executable, "-c", script, str(tmp_path / "part.stl")],
        cwd=root,
        env={"PYTHONPATH": str(root)},
        capture_output=True,
        text=True,
        check=False,
    )

    assert done.stderr == ""
    size, heavy = done.stdout.split(" ", 1)
    assert int(size) > 10_000
    assert heavy.strip() == "[]"


def test_different_processes_make_the_same_bytes(tmp_path: Path) -> None:
    """Nothing depends on the seed of Python's hashes."""
    export_stl(joined([sphere(4), box((3, 3, 3), (10, 0, 0))]), tmp_path / "part.stl")
    script = """
import sys, hashlib
from pathlib import Path
from printer_slicer.mesh_io import load_mesh
from printer_slicer.gcode_text import gcode_of
from printer_slicer.pipeline import slice_part
from printer_slicer.profile import load_profile
profile = load_profile(quality="standard")
print(hashlib.sha256(gcode_of(slice_part(load_mesh(Path(sys.argv[1])), profile), profile)).hexdigest())
"""
    root = Path(__file__).parents[1]
    digests = {
        subprocess.run(
            [sys.executable, "-c", script, str(tmp_path / "part.stl")],
            cwd=root,
            env={"PYTHONPATH": str(root), "PYTHONHASHSEED": seed},
            capture_output=True,
            text=True,
            check=True,
        ).stdout
        for seed in ("1", "2")
    }

    assert len(digests) == 1


def test_the_estimate_in_the_header_is_the_time_of_all_moves() -> None:
    from printer_slicer.extrusion import move_seconds
    from printer_slicer.slice_jobs import job_of
    from printer_slicer.texts import format_duration

    bare = profile(start_gcode="", end_gcode="")
    program = slice_part(box(), bare)
    told = "; estimated printing time (normal mode) = "

    line = told + format_duration(float(move_seconds(program, bare).sum()))
    assert line.encode() in gcode_of(program, bare).splitlines()
    # With start and end G-code it is what the whole file takes, but for the way from one to the other.
    whole = job_of(box(), profile())
    seconds = next(line for line in whole.text.splitlines() if line.startswith(b";TIME:"))
    assert int(seconds[6:]) == pytest.approx(whole.seconds, abs=2)


def test_every_command_of_the_whole_file_is_known_to_the_flavour() -> None:
    for printer, words in (
        (
            "marlin_220",
            "G0 G1 G21 G28 G90 G91 G92 M73 M82 M83 M84 M104 M106 M107 M109 M140 M190 M201 M203 M204 M205",
        ),
        (
            "corexy_klipper",
            "G0 G1 G21 G28 G90 G91 G92 M73 M82 M83 M84 M104 M106 M107 M109 M140 M190 SET_VELOCITY_LIMIT",
        ),
    ):
        wanted = profile(printer)
        used = {line.split()[0].decode() for line in commands(gcode_of(slice_part(box(), wanted), wanted))}
        assert used <= set(words.split())
