"""Objects that are printed one after the other: moves, temperatures, labels, files."""

from __future__ import annotations

from argparse import Namespace
from pathlib import Path

import numpy as np
import pytest

import printer_slicer as ps
from printer_slicer.cli.verdicts import format_verdict
from printer_slicer.errors import PartError, ProfileError
from printer_slicer.importing import ImportedProfile
from printer_slicer.inspection.dry_run.runner import dry_run
from printer_slicer.model import Fan, Heat
from printer_slicer.plates import choose_gap
from printer_slicer.roles import Role
from printer_slicer.travels import measure_detour_reach
from tests.importing.files import flat_file, imported
from tests.parts import box, joined
from tests.sequencing.head_contacts import find_contacts, list_objects

HEAD = "0: 15, 12: -9999x-9999 9999x9999"
CHANGES = {
    "print_order": "by_object",
    "printer.head": HEAD,
    "layer_height": 0.3,
    "infill_density": 0,
    "perimeters": 1,
    "top_thickness": 0.5,
    "bottom_thickness": 0.5,
}
AS_PLACED = ps.Placement(as_placed=True)


def load(**changes: object) -> ps.Profile:
    return ps.load_profile("marlin_220", quality="standard", changes=CHANGES | changes)


def plate(*boxes: tuple[str, tuple[float, float], tuple[float, float, float]]) -> ps.Mesh:
    return ps.join([ps.Mesh(box(size, at=(*at, 0)).triangles, name) for name, at, size in boxes])


THREE = plate(
    ("tall", (50, 60), (12, 12, 20)), ("low", (90, 60), (15, 10, 6)), ("mid", (60, 110), (10, 14, 10))
)


@pytest.fixture(scope="module")
def sliced() -> ps.Stages:
    return ps.slice_stages(THREE, load(), placement=AS_PLACED)


def test_each_object_is_finished_before_the_next_begins(sliced: ps.Stages) -> None:
    assert list_objects(sliced) == [1, 2, 0]
    program = sliced.program
    starts = program.plan.stack_starts
    assert len(starts) == 3
    assert program.plan.highest == pytest.approx(20, abs=0.3)
    assert (np.diff(program.layer) >= 0).all()
    assert program.xyz[program.role != Role.TRAVEL, 2] == pytest.approx(
        program.plan.top[program.layer[program.role != Role.TRAVEL]]
    )


def test_nothing_is_touched_and_the_nozzle_travels_above_everything(sliced: ps.Stages) -> None:
    assert find_contacts(sliced, load().printer) == 0
    program = sliced.program
    top = 0.0
    for begin in program.plan.stack_starts.tolist()[1:]:
        first = int(np.searchsorted(program.layer, begin))
        top = max(top, float(program.plan.top[:begin].max()))
        assert program.xyz[first, 2] > top + 1
        assert program.xyz[first - 1, 2] > top + 1
    assert program.xyz[-1, 2] > program.plan.highest + 1


def test_a_wrong_order_would_touch(sliced: ps.Stages) -> None:
    assert find_contacts(sliced, load(**{"printer.head": "0: 60"}).printer) > 0


def test_the_filament_is_retracted_once_per_travel_and_comes_back(sliced: ps.Stages) -> None:
    program = sliced.program
    pulled = np.cumsum(np.where(program.role == Role.TRAVEL, program.filament, 0.0))
    assert pulled.min() == pytest.approx(-load().printer.retract_length)
    assert pulled[program.role != Role.TRAVEL] == pytest.approx(0)


def test_the_skirt_surrounds_all_objects_once(sliced: ps.Stages) -> None:
    program = sliced.program
    assert set(program.layer[program.role == Role.SKIRT].tolist()) == {0}
    around = program.xyz[program.role == Role.SKIRT, :2]
    assert (around.min(axis=0) < THREE.bounds[0, :2]).all()
    assert (around.max(axis=0) > THREE.bounds[1, :2]).all()


def test_each_object_has_its_own_brim() -> None:
    stages = ps.slice_stages(THREE, load(brim_width=2), placement=AS_PLACED)
    assert stages.labels is not None
    brims = stages.labels.object_id[stages.program.role == Role.BRIM]
    assert brims[np.append(True, np.diff(brims) != 0)].tolist() == [1, 2, 0]


def test_each_object_begins_with_the_nozzle_temperature_of_first_layers(sliced: ps.Stages) -> None:
    program, material = sliced.program, load().material
    heats = [event for event in program.events if isinstance(event, Heat)]
    pair = [material.nozzle_temperature, material.first_layer_nozzle_temperature]
    assert [one.nozzle for one in heats] == [*pair, *pair, pair[0]]
    starts = program.plan.stack_starts
    layers = program.layer[[one.index for one in heats]].tolist()
    assert layers == [1, starts[1], starts[1] + 1, starts[2], starts[2] + 1]


def test_the_bed_keeps_its_temperature_after_the_first_object() -> None:
    stages = ps.slice_stages(THREE, load(first_layer_bed_temperature=70), placement=AS_PLACED)
    beds = [one.bed for one in stages.program.events if isinstance(one, Heat) and one.bed is not None]
    assert beds == [load().material.bed_temperature]


def test_the_fan_is_off_on_the_first_layer_of_every_object(sliced: ps.Stages) -> None:
    program = sliced.program
    fans = [event for event in program.events if isinstance(event, Fan)]
    for begin in program.plan.stack_starts.tolist()[1:]:
        first = int(np.searchsorted(program.layer, begin))
        assert [one.ratio for one in fans if one.index <= first][-1] == 0


def test_the_file_prints_as_planned_on_the_simulated_printer() -> None:
    job = ps.job_of(THREE, load(pause_at="3"), placement=AS_PLACED)
    assert [one for one in job.findings if one.is_error and one.code != "wait"] == []
    text = job.text.decode()
    assert text.count("M0") + text.count("M25") + text.count("M601") == 3

    printed = ps.job_of(THREE, load(), placement=AS_PLACED)
    verdict = dry_run(printed, load())
    assert verdict.problems == ()
    assert verdict.heights_equal
    n_layers = printed.program.plan.n_layers
    assert f"layers      {n_layers} at " in format_verdict(Namespace(verbose=False), verdict, printed, load())


def test_a_printer_that_skips_an_object_first_goes_above_its_end(sliced: ps.Stages) -> None:
    rows = ps.job_of(sliced, load(**{"printer.labels": "octoprint"})).text.decode().splitlines()
    last = [row for row, line in enumerate(rows) if line.startswith("; stop printing object low")][-1]
    after = next(line for line in rows[last + 1 :] if line.startswith("G0"))
    assert "X" in after
    assert "Y" in after
    assert "Z7.9 " in after


def test_facts_for_macros_concern_the_whole_plate(sliced: ps.Stages) -> None:
    ending = "; top {max_layer_z} layers {layer_count} x {first_layer_max_x}"
    text = ps.job_of(sliced, load(**{"printer.end_gcode": ending})).text.decode()
    assert f"; top 20 layers {sliced.program.plan.n_layers}" in text.replace("20.1", "20")


def test_supports_and_a_raft_belong_to_their_object() -> None:
    table = joined([box((4, 4, 8), at=(74, 74, 0)), box((20, 20, 2), at=(66, 66, 8))]).triangles
    tables = [ps.Mesh(table, "one"), ps.Mesh(table + np.array([70.0, 0, 0]), "two")]
    for changes in ({"support": "columns"}, {"raft_height": 0.9}):
        profile = load(**changes)
        stages = ps.slice_stages(ps.join(tables), profile, placement=AS_PLACED)
        assert list_objects(stages) == [0, 1]
        assert find_contacts(stages, profile.printer) == 0
    assert stages.program.plan.stack_starts.tolist() == [0, stages.program.plan.n_layers // 2]


def test_objects_may_have_plans_and_settings_of_their_own() -> None:
    plans = [ps.LayerPlan.from_tops(np.arange(1, n + 1) * h) for n, h in ((40, 0.5), (20, 0.3), (50, 0.2))]
    stages = ps.slice_stages(THREE, load(overrides="low:perimeters=2"), plan=plans, placement=AS_PLACED)
    assert stages.program.plan.n_layers == 110
    assert stages.program.plan.stack_starts.tolist() == [0, 20, 70]


def test_several_spiral_vases_can_be_printed() -> None:
    stages = ps.slice_stages(THREE, load(spiral=True), placement=AS_PLACED)
    assert list_objects(stages) == [1, 2, 0]


def test_a_single_object_is_printed_as_ever() -> None:
    one = ps.Mesh(box((10, 10, 5)).triangles, "box")
    by_object, by_layer = (
        ps.slice_stages(one, load(print_order=order)).program for order in ("by_object", "by_layer")
    )
    assert (by_object.xyz == by_layer.xyz).all()


def test_objects_that_are_too_near_are_named() -> None:
    near = plate(("left", (50, 60), (12, 12, 9)), ("right", (70, 60), (12, 12, 9)))
    with pytest.raises(PartError, match=r"right and left|left and right"):
        ps.slice_stages(near, load(), placement=AS_PLACED)


def test_arranged_parts_are_so_far_apart_that_the_head_fits_between_them() -> None:
    parts = [ps.Mesh(box((12, 12, 9)).triangles, "box")] * 5
    profile = load(brim_width=3)
    (arranged,) = ps.arrange(parts, profile)
    stages = ps.slice_stages(arranged, profile, placement=AS_PLACED)
    assert sorted(list_objects(stages)) == [0, 1, 2, 3, 4]


def test_a_slow_link_is_reported_for_all_objects() -> None:
    stages = ps.slice_stages(THREE, load(**{"printer.link_lines_per_second": 3.0}), placement=AS_PLACED)
    assert stages.link is not None
    assert len(set(stages.link.layers)) == len(stages.link.layers) > 0
    assert max(stages.link.layers) <= stages.program.plan.n_layers


def test_objects_of_a_repaired_mesh_are_rejected() -> None:
    broken = ps.Mesh(THREE.triangles, "plate", tuple(one.without_facets() for one in THREE.objects))
    with pytest.raises(PartError, match="needs repair"):
        ps.slice_stages(broken, load(), placement=AS_PLACED)


def test_a_draft_shield_is_rejected() -> None:
    with pytest.raises(ProfileError, match="skirt"):
        load(skirt_height=20)


def _quality(path: Path) -> ImportedProfile:
    return imported(path)["quality"]


def test_the_order_is_imported(tmp_path: Path) -> None:
    for changes, order in (
        ({"complete_objects": "1"}, "by_object"),
        ({"complete_objects": "0"}, "by_layer"),
        ({"print_sequence": "by object"}, "by_object"),
    ):
        assert _quality(flat_file(tmp_path, **changes)).values["print_order"] == order
    printer = imported(flat_file(tmp_path, extruder_clearance_radius="45", extruder_clearance_height="25"))[
        "printer"
    ]
    assert printer.values["head"] == ["0: 45", "25: -9999x-9999 9999x9999"]


def test_arranged_plates_have_at_most_one_part_that_is_higher_than_the_gantry() -> None:
    parts = [ps.Mesh(box((10, 10, z)).triangles, f"z{z}") for z in (20, 15, 8, 8, 12.5)]
    plates = ps.arrange(parts, load())
    heights = [[item.high[2] for item in one.objects] or [one.size[2]] for one in plates]
    assert [sum(z > 12 for z in own) for own in heights] == [1, 1, 1]
    assert sum(map(len, heights)) == 5
    assert find_contacts(ps.slice_stages(plates[0], load(), placement=AS_PLACED), load().printer) == 0


@pytest.mark.parametrize("gap", [None, 40.0])
@pytest.mark.parametrize("bar", ["-9999x-20 9999x20", "-20x-9999 20x9999"])
def test_high_parts_share_a_plate_only_in_rows_along_a_gantry_that_is_a_bar(
    bar: str, gap: float | None
) -> None:
    profile = load(**{"printer.head": f"0: 8, 12: {bar}"})
    parts = [ps.Mesh(box((12, 12, z)).triangles, f"z{z}") for z in (20, 15, 8)]
    plates = ps.arrange(parts, profile, gap=gap)
    assert len(plates) <= 2
    for one in plates:
        ps.slice_stages(one, profile, placement=AS_PLACED)


def test_the_raft_counts_for_the_height_of_arranged_parts() -> None:
    profile = load(raft_height=1.0)
    parts = [ps.Mesh(box((12, 12, 12)).triangles, name) for name in ("one", "two")]
    assert len(ps.arrange(parts, load())) == 1
    assert len(ps.arrange(parts, profile)) == 2


def test_no_arranged_part_stands_in_a_notch_of_another() -> None:
    corner = joined([box((60, 8, 20)), box((8, 60, 20))])
    parts = [ps.Mesh(corner.triangles, "corner"), ps.Mesh(box((6, 6, 6)).triangles, "cube")]
    profile = load(**{"printer.head": "0: 10, 12: -9999x-9999 9999x9999"})
    (plate,) = ps.arrange(parts, profile)
    assert sorted(list_objects(ps.slice_stages(plate, profile, placement=AS_PLACED))) == [0, 1]


def test_arranged_parts_leave_room_for_travels_around_their_corners() -> None:
    """The head reaches exactly from part to part; its nozzle travels a little outside the part, and must have room."""
    parts = [ps.Mesh(box((20, 20, 5)).triangles, name) for name in ("one", "two")]
    kept, moved = (choose_gap(parts, load(avoid_crossing=avoids)) for avoids in (False, True))
    assert kept == pytest.approx(15, abs=0.1)
    assert moved == pytest.approx(kept + measure_detour_reach(load()), abs=0.1)
    wider = choose_gap(parts, load(avoid_crossing=False, xy_compensation=0.2))
    assert wider == pytest.approx(kept + 0.4, abs=0.1)
