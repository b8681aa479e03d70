"""The part stands on its raft as it would on the bed, with air between them, and nothing else changes."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from printer_slicer import bead
from printer_slicer.adhesion import adhesion_paths, place_on_raft
from printer_slicer.adhesion.raft import raft_heights
from printer_slicer.errors import PartError, PlanError, ProfileError
from printer_slicer.gcode_text import gcode_of
from printer_slicer.geometry import Areas
from printer_slicer.geometry.engine import using_engine
from printer_slicer.inspection.coverage.model_check import CheckOptions, check_gcode
from printer_slicer.inspection.dry_run.runner import dry_run
from printer_slicer.model import LayerPlan, Mesh
from printer_slicer.pipeline import slice_stages
from printer_slicer.placing import Placement
from printer_slicer.planning import PLANNERS
from printer_slicer.roles import Role
from printer_slicer.slice_jobs import job_of
from printer_slicer.stages import Stages
from tests.adhesion.plates import foot, lines, plastic, plate, ring_of, standing
from tests.effort import examples
from tests.parts import box, case_study, cone, plain, profile, shapely, two_boxes
from tests.strategies import clean_areas

SQUARE = plate([ring_of(0, 0, 10, 10)], [ring_of(0, 0, 10, 10)])


def volume_of(stages: Stages, layer: int) -> float:
    """Plastic on one layer of the program, mm³."""
    chosen = (stages.program.layer == layer) & (stages.program.role != Role.TRAVEL)
    return float(stages.program.filament[chosen].sum() * np.pi * 1.75**2 / 4)


# The layers


@given(
    st.integers(18, 400),
    st.sampled_from([(0.4, 0.09, 0.32), (0.6, 0.1, 0.4), (0.25, 0.05, 0.2), (0.4, 0.2, 0.3)]),
)
def test_heights_of_the_raft_come_to_its_height_within_the_limits(
    steps: int, limits: tuple[float, float, float]
) -> None:
    nozzle, thinnest, thickest = limits
    wanted = plain(
        printer__nozzle_diameter=nozzle,
        printer__min_layer=thinnest,
        printer__max_layer=thickest,
        extrusion_width=1.2 * nozzle,
        layer_height=thickest / 2 if thickest > 2 * thinnest else thinnest,
        raft_height=steps / 100,
        planner__kind="uniform",
    )
    try:
        heights = raft_heights(wanted)
    except PlanError:
        # Only what cannot be cut into two or more layers is refused.
        assert not any(n * thinnest - 1e-9 <= steps / 100 <= n * thickest + 1e-9 for n in range(2, 50))
        return
    assert heights.sum() == pytest.approx(steps / 100)
    assert len(heights) >= 2
    assert (thinnest - 1e-9 <= heights).all()
    assert (heights <= thickest + 1e-9).all()
    assert np.allclose(np.round(heights * 100) / 100, heights)
    assert np.ptp(heights[1:]) < 0.011


def test_without_a_raft_what_is_printed_are_the_sections() -> None:
    assert place_on_raft(SQUARE, plain()) is SQUARE
    assert not lines(adhesion_paths(SQUARE, plain()), Role.RAFT)


@pytest.mark.parametrize("engine", ["clipper", "planar"])
@settings(max_examples=examples(6))
@given(clean_areas(2), st.sampled_from([1.0, 3.0]))
def test_the_raft_covers_the_first_section_and_its_margin(engine: str, areas: Areas, margin: float) -> None:
    sections = standing(areas)
    setting = plain(raft_height=0.8, raft_margin=margin)
    if not list(areas.rings(0)):
        with pytest.raises(PartError, match="does not touch the bed"):
            place_on_raft(sections, setting)
        return
    with using_engine(engine):
        printed = place_on_raft(sections, setting)
        paths = adhesion_paths(printed, setting)
    n = printed.plan.n_layers - 2
    grown = shapely.buffer(foot(sections), margin - 0.05)

    for layer in range(n):
        assert shapely.contains(foot(printed, layer), grown)
        assert shapely.area(foot(printed, layer)) < shapely.area(
            shapely.buffer(foot(sections), 2 * margin + 0.1)
        )
    # The interface is closed under the part but for the corners of its rows; nothing leaves the raft.
    top = paths.layer == n - 1
    width = paths.width[paths.start[:-1]]
    laid = shapely.union_all([shapely.buffer(line, 0.225) for line in lines(paths, Role.RAFT, n - 1)])
    assert (width[top] == 0.45).all()
    share = shapely.area(shapely.intersection(laid, foot(sections))) / max(shapely.area(foot(sections)), 1e-9)
    assert share > 0.95
    assert shapely.area(shapely.difference(laid, shapely.buffer(foot(printed, n - 1), 0.02))) < 1e-3


def test_the_interface_is_full_and_the_base_as_dense_as_asked_for() -> None:
    sections = plate([ring_of(0, 0, 60, 60)])
    for density in (0.3, 0.5, 1.0):
        setting = plain(raft_height=0.8, raft_base_density=density)
        printed = place_on_raft(sections, setting)
        paths = adhesion_paths(printed, setting)
        size = np.diff(paths.start)
        for layer in range(printed.plan.n_layers - 1):
            height = float(printed.plan.height[layer])
            wide = float(paths.width[paths.start[:-1]][paths.layer == layer][0])
            length = sum(line.length for line in lines(paths, Role.RAFT, layer))
            volume = length * float(bead.cross_section(wide, height))
            full = float(printed.solid.area()[layer]) * height
            assert volume / full == pytest.approx(
                1.0 if layer else density, abs=0.06 if density == 1 or layer else 0.1
            )
        assert (size > 1).all()


def test_lines_of_each_layer_cross_those_below_and_the_parts_first_layer_crosses_the_raft() -> None:
    stages = slice_stages(box((30, 30, 2)), plain(raft_height=0.8, infill_angle_deg=20))
    paths = stages.toolpaths
    directions = []
    for layer in range(4):
        role = Role.RAFT if layer < 3 else Role.BOTTOM_SOLID_INFILL
        chosen = np.flatnonzero((paths.layer == layer) & (paths.role == role) & ~paths.closed)
        longest = max(
            (np.diff(paths.path(i), axis=0) for i in chosen.tolist()), key=lambda d: np.abs(d).max()
        )
        way = longest[np.argmax(np.hypot(*longest.T))]
        directions.append(np.rad2deg(np.arctan2(way[1], way[0])) % 180)

    assert directions[3] == pytest.approx(20, abs=0.1)
    turns = np.abs(np.diff(directions))
    assert turns == pytest.approx([90, 90, 90], abs=0.1)


# The part on it


@pytest.mark.parametrize(
    "mesh", [box((20, 20, 1)), cone(6, 4), two_boxes((8, 8, 1))], ids=lambda mesh: mesh.name
)
def test_the_part_is_printed_as_on_the_bed_only_higher(mesh: Mesh) -> None:
    changes = {"skirt_loops": 0, "raft_gap": 0.2}
    bare, raised = (slice_stages(mesh, plain(raft_height=height, **changes)) for height in (0, 0.8))
    n = raised.toolpaths.plan.n_layers - bare.toolpaths.plan.n_layers
    own = raised.toolpaths.role != Role.RAFT

    assert n == 3
    assert raised.sections.plan.top.tolist() == bare.sections.plan.top.tolist()
    assert raised.program.plan.top[n:] == pytest.approx(bare.program.plan.top + 1.0)
    assert sorted(raised.toolpaths.height[own]) == sorted(bare.toolpaths.height)
    for layer in range(bare.program.plan.n_layers):
        # A bead's plastic does not depend on how the paths are ordered, nor on what is below.
        assert volume_of(raised, layer + n) == pytest.approx(volume_of(bare, layer), rel=1e-9)


def test_the_first_layer_over_the_air_has_the_plastic_of_its_own_height() -> None:
    stages = slice_stages(box((20, 20, 2)), plain(raft_height=0.8, raft_gap=0.3, first_layer_height=0.2))
    area = stages.sections.solid.area()[0]

    assert volume_of(stages, 3) == pytest.approx(area * 0.2, rel=0.03)
    first = (stages.program.layer == 3) & (stages.program.role != Role.TRAVEL)
    assert set(np.round(stages.program.xyz[first, 2], 6).tolist()) == {0.8 + 0.3 + 0.2}


def test_every_bead_rests_on_plastic_or_the_air_of_the_gap() -> None:
    """Each layer's beads begin where the layer below ends, but for the gap under the part's first one."""
    stages = slice_stages(case_study(), profile(raft_height=1, skirt_height=3, skirt_loops=2))
    paths, top = stages.toolpaths, stages.toolpaths.plan.top
    n = paths.plan.n_layers - stages.sections.plan.n_layers
    bottom = top[paths.layer] - paths.height
    below = np.append(0.0, top)[paths.layer]
    over = paths.role > Role.RAFT

    air = np.where((paths.layer == n) & over, 0.16, 0.0)
    # Of layer and gap, 0.36 mm, the nozzle can press 0.32 down to the shield's last bead.
    air[(paths.layer == n) & (paths.role == Role.SKIRT)] = 0.04
    assert bottom - below == pytest.approx(air, abs=1e-6)
    assert (paths.width[paths.start[:-1]] >= paths.height - 1e-9).all()  # the shield spans the air too
    shield = plastic(paths, Role.SKIRT, 0)
    for layer in range(n):
        assert (
            shapely.distance(shield, foot(place_on_raft(stages.sections, profile(raft_height=1)), layer))
            > 4.9
        )


@pytest.mark.parametrize("planner", list(PLANNERS))
def test_every_planner_prints_on_a_raft(planner: str) -> None:
    wanted = profile(raft_height=0.6, planner__kind=planner)
    job = job_of(two_boxes((6, 6, 1.5)), wanted)
    verdict = dry_run(job, wanted)

    assert verdict.problems == ()
    assert verdict.heights_equal


def test_ranges_are_those_of_the_part() -> None:
    ranges = "1:2:layer_height=0.1"
    stages = slice_stages(
        box((12, 12, 4)), profile(raft_height=0.8, planner__kind="optimal", planner__ranges=ranges)
    )
    plan = stages.sections.plan
    inside = (plan.bottom > 1 - 1e-6) & (plan.top < 2 + 1e-6)

    assert plan.height[inside].tolist() == pytest.approx([0.1] * 10)
    assert stages.program.plan.height[-plan.n_layers :][inside].tolist() == pytest.approx([0.1] * 10)


# Speed, heat, text


def test_the_first_layers_rules_are_the_rafts_and_the_part_begins_slowly() -> None:
    stages = slice_stages(
        box((60, 60, 2)), plain(raft_height=0.8, speeds__raft=44, first_layer_nozzle_temperature=230)
    )
    program = stages.program
    beads = program.role != Role.TRAVEL
    n = program.plan.n_layers - stages.sections.plan.n_layers

    def speeds(layer: int) -> set[float]:
        return set(np.round(program.speed[beads & (program.layer == layer)], 6).tolist())

    assert speeds(0) == {20.0}
    assert speeds(1) == speeds(2) == {44.0}
    assert speeds(n) == {20.0}
    assert max(speeds(n + 1)) > 20
    (heat,) = [event for event in program.events if hasattr(event, "nozzle")]
    assert program.layer[heat.index] == 1


def test_the_text_tells_the_height_of_beads_and_their_type() -> None:
    wanted = plain(raft_height=0.8, raft_gap=0.2, first_layer_height=0.3, skirt_loops=1)
    text = gcode_of(slice_stages(box((20, 20, 2)), wanted).program, wanted).decode()
    heights = [line[8:] for line in text.split("\n") if line.startswith(";HEIGHT:")]

    assert heights[:4] == ["0.32", "0.24", "0.24", "0.3"]
    assert ";Z:1.3\n" in text
    assert ";TYPE:Support material\n" in text


# What is refused


def test_a_raft_beside_the_bed_or_too_high_is_refused_with_a_remedy() -> None:
    with pytest.raises(PartError, match="leaves the bed"):
        slice_stages(box((218, 20, 1)), plain(raft_height=0.8))
    low = plain(raft_height=0.8, printer__bed_z=20)
    with pytest.raises(PartError, match=r"20\.46 mm high"):
        slice_stages(box((20, 20, 19.5)), low)
    assert slice_stages(box((20, 20, 19)), low).program.plan.top[-1] <= 20


def test_a_part_that_does_not_stand_on_the_bed_has_no_raft() -> None:
    with pytest.raises(PartError, match="does not touch the bed"):
        slice_stages(box((20, 20, 2), (0, 0, 2)), plain(raft_height=0.8), placement=Placement(drop=False))


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"raft_height": 0.805}, "raft_height=0.805: 0.805 mm is not a multiple"),
        ({"raft_height": 0.8, "raft_gap": 0.155}, "raft_gap=0.155: 0.155 mm is not a multiple"),
        ({"raft_height": 0.8, "brim_width": 3}, "a brim of 3 mm cannot be combined with a raft"),
    ],
)
def test_settings_that_contradict_a_raft_are_refused(changes: dict[str, float], said: str) -> None:
    with pytest.raises(ProfileError, match=said):
        plain(**changes)


def test_a_raft_too_thin_for_two_layers_is_refused() -> None:
    with pytest.raises(PlanError, match="cannot be divided into layers"):
        slice_stages(box((20, 20, 2)), plain(raft_height=0.1))


@pytest.mark.parametrize("gap", [0.16, 1.0])
def test_a_draft_shield_over_the_air_is_no_higher_than_the_nozzle_can_press(gap: float) -> None:
    chosen = profile(raft_height=1, raft_gap=gap, skirt_height=10000)

    paths = slice_stages(box((8, 8, 3)), chosen).toolpaths

    shield = paths.height[paths.role == Role.SKIRT]
    assert shield.max() <= 0.8 * chosen.printer.nozzle_diameter + 1e-9
    assert shield.max() > paths.plan.height.min() + 0.05  # and higher than elsewhere


def test_check_finds_a_part_of_uneven_layers_on_its_raft() -> None:
    """The first layer is thinner than the second: only the file tells how thick it is."""

    wanted = plain(raft_height=1.0)
    plan = LayerPlan.from_tops(np.cumsum([0.2, 0.3, 0.32, 0.32, 0.25, 0.32]))
    stages = slice_stages(box((14, 14, float(plan.top[-1]))), wanted, plan=plan)

    check = check_gcode(gcode_of(stages.program, wanted), stages.part, CheckOptions())

    assert [finding.message for finding in check.findings] == []
