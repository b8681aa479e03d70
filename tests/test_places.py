"""Objects and heights with settings of their own: what is laid follows them, and nothing else changes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from parts import box, joined, layers, plain, pyramid, step_pyramid

from printer_slicer import Mesh, Stages, gcode_of, load_profile, profile_with, slice_stages, transform
from printer_slicer.errors import ProfileError, UsageError
from printer_slicer.inspection.coverage.measurement import coverage_of
from printer_slicer.inspection.coverage.stack import stack_of_program
from printer_slicer.layer_settings import resolve_layer_settings
from printer_slicer.model import Heat, LayerPlan, PlateObject
from printer_slicer.objects import split_objects
from printer_slicer.profile import Profile
from printer_slicer.roles import Role

FILAMENT = np.pi * 1.75**2 / 4  # mm²
SIDE = 16.0  # mm


def place_objects(*meshes: Mesh, names: tuple[str, ...] = ("lid", "can")) -> Mesh:
    """Several meshes on one plate, each an object."""
    items, first = [], 0
    for name, mesh in zip(names, meshes, strict=True):
        items.append(PlateObject.of(name, mesh.bounds, first, mesh.n_facets))
        first += mesh.n_facets
    return replace(joined(meshes, "plate"), objects=tuple(items))


PLATE = place_objects(box((SIDE, SIDE, 6)), box((SIDE, SIDE, 6), (SIDE + 8, 0, 0)))
TALL = box((SIDE, SIDE, 12))


def sliced(mesh: Mesh, **changes: object) -> Stages:
    return slice_stages(mesh, plain(infill_anchor_max=0, **changes))


def volume(
    stages: Stages, *roles: Role, z: tuple[float, float] = (0, 1e9), right: bool | None = None
) -> float:
    """mm³ laid by some roles between two heights, on one side of the middle of the plate."""
    program = stages.program
    chosen = np.isin(program.role, roles or list(Role)) & (program.role != Role.TRAVEL)
    top = program.plan.top[program.layer]
    chosen &= (top > z[0] + 1e-6) & (top <= z[1] + 1e-6)
    if right is not None:
        chosen &= (program.xyz[:, 0] > 0) == right
    return float(program.filament[chosen].sum() * FILAMENT)


def sparse_share(stages: Stages, z: tuple[float, float], *, right: bool | None = None) -> float:
    """Plastic in the sparse regions between two heights, as a share of their volume."""
    plan, sparse = stages.regions.plan, stages.regions.internal_infill
    if right is not None:
        middle = np.add.reduceat(sparse.xy[:, 0], sparse.ring_start[:-1])
        sparse = sparse.select((middle > 0) == right)
    here = (plan.top > z[0] + 1e-6) & (plan.top <= z[1] + 1e-6)
    return volume(stages, Role.INTERNAL_INFILL, z=z, right=right) / float(
        (sparse.area() * plan.height)[here].sum()
    )


# Heights


def test_the_infill_of_heights_is_as_dense_as_they_ask() -> None:
    stages = sliced(TALL, infill_density=0.15, overrides="4:8:infill_density=0.45")

    assert sparse_share(stages, (1, 4)) == pytest.approx(0.15, rel=0.1)
    assert sparse_share(stages, (4, 8)) == pytest.approx(0.45, rel=0.1)
    assert sparse_share(stages, (8, 11)) == pytest.approx(0.15, rel=0.1)


def test_the_ledger_finds_as_much_plastic_as_the_heights_ask_for() -> None:
    """Layer by layer, whatever it was laid for; solid heights are full, and what they stand on is closed."""
    stages = sliced(TALL, infill_density=0.2, overrides="4:8:infill_density=1")
    coverage = coverage_of(stack_of_program(stages.program, 1.75), stages.sections.solid)
    plan = stages.sections.plan
    full = coverage.volume / coverage.section_volume
    inside = (plan.bottom > 4.3) & (plan.top < 7.9)

    assert coverage.volume.sum() == pytest.approx(volume(stages), rel=1e-6)
    assert full[inside] == pytest.approx(1, abs=0.02)
    assert full[(plan.bottom > 1) & (plan.top < 4)].max() < 0.55
    # The first full layer lies over sparse infill: it is bridged, not begun in the air.
    assert volume(stages, Role.INTERNAL_BRIDGE, z=(4, 4.2)) > 0.5 * (SIDE - 2) ** 2 * 0.2


@pytest.mark.parametrize("count", [1, 3, 4])
def test_the_perimeters_of_heights_are_as_many_as_they_ask(count: int) -> None:
    stages = sliced(TALL, overrides=f"4:8:perimeters={count}")
    paths, plan = stages.toolpaths, stages.sections.plan
    loops = np.bincount(
        paths.layer[np.isin(paths.role, [Role.EXTERNAL_PERIMETER, Role.PERIMETER])],
        minlength=plan.n_layers,
    )
    within = (plan.bottom >= 4 - 1e-6) & (plan.top <= 8 + 1e-6)

    assert set(loops[within].tolist()) == {count}
    assert set(loops[~within].tolist()) == {2}


def test_a_pattern_of_heights_is_theirs_alone() -> None:
    usual, stages = sliced(TALL), sliced(TALL, overrides="4:8:infill=gyroid")

    def lines(of: Stages, low: float, high: float) -> list[list[list[float]]]:
        paths, top = of.toolpaths, of.sections.plan.top
        return [
            paths.path(i).tolist()
            for i in np.flatnonzero(
                (paths.role == Role.INTERNAL_INFILL) & (top[paths.layer] > low) & (top[paths.layer] < high)
            )
        ]

    assert max(map(len, lines(usual, 4.1, 8))) == 2
    assert max(map(len, lines(stages, 4.1, 8))) > 20
    assert max(map(len, lines(stages, 8.1, 11))) == 2


def test_speeds_and_accelerations_of_heights_are_theirs_alone() -> None:
    changes = "4:8:speeds.external_perimeter=11; 4:8:accelerations.external_perimeter=123"
    program = sliced(TALL, overrides=changes).program
    outer, top = program.role == Role.EXTERNAL_PERIMETER, program.plan.top[program.layer]
    within = (top > 4.01) & (top < 8.01)

    assert set(program.speed[outer & within].tolist()) == {11.0}
    assert set(program.speed[outer & ~within & (program.layer > 0)].tolist()) == {60.0}
    hard = [event for event in program.events if getattr(event, "value", 0) == 123]
    assert {int(program.layer[event.index]) for event in hard} == set(program.layer[within].tolist())


def test_a_tower_of_temperatures_changes_them_where_heights_begin() -> None:
    stages = sliced(TALL, overrides="3:6:nozzle_temperature=225; 6:9:nozzle_temperature=195")
    program = stages.program
    heat = [event for event in program.events if isinstance(event, Heat)]

    assert [
        (round(float(program.plan.bottom[program.layer[event.index]]), 4), event.nozzle) for event in heat
    ] == [
        (0.2, 210),
        (3.0, 225),
        (6.0, 195),
        (9.0, 210),
    ]
    text = gcode_of(program, plain(overrides="3:6:nozzle_temperature=225"))
    assert b"M104 S225" in text


def test_skins_of_heights_are_as_thick_as_they_ask() -> None:
    part = step_pyramid([20, 12], [5, 5])
    stages = sliced(part, top_thickness=0.6, overrides="3:6:top_thickness=1.4")
    solid = (
        stages.regions.solid_infill.area()
        + stages.regions.internal_bridge.area()
        + stages.regions.top_solid_infill.area()
    )
    plan = stages.sections.plan
    ring = (solid > 0.3 * (20**2 - 12**2)) & (plan.top <= 5.001) & (plan.bottom > 1)

    assert float(plan.height[ring].sum()) == pytest.approx(1.4)


def test_sparse_infill_does_not_begin_over_what_is_hollow() -> None:
    stages = sliced(TALL, infill_density=0.2, overrides="0:5:infill_density=0")
    plan, regions = stages.sections.plan, stages.regions
    first = int(np.searchsorted(plan.bottom, 5 - 1e-6))

    assert volume(stages, Role.INTERNAL_INFILL, z=(0, 5)) == 0
    assert regions.internal_infill.area()[first] == 0
    assert regions.bridge.area()[first] > 0.8 * (SIDE - 2) ** 2
    assert regions.internal_infill.area()[first + 4] > 0.5 * SIDE**2


def test_later_heights_win_where_several_overlap() -> None:
    layered = resolve_layer_settings(
        plain(overrides="0:6:perimeters=3; 4:8:perimeters=5; 4:8:infill_density=0.5"), layers(10, 1.0)
    )
    perimeters = layered.values(lambda one: one.quality.perimeters)
    density = layered.values(lambda one: one.quality.infill_density)

    assert perimeters.tolist() == [3, 3, 3, 3, 5, 5, 5, 5, 2, 2]
    assert density.tolist() == [0.15] * 4 + [0.5] * 4 + [0.15] * 2
    assert len(layered.profiles) == 3
    assert layered.run_starts().tolist() == [0, 0, 0, 0, 4, 4, 4, 4, 8, 8]


def test_thick_beads_end_where_heights_do() -> None:
    stages = sliced(TALL, layer_height=0.1, internal_infill_every=0.3, overrides="4.1:8:infill_density=0.3")
    paths, top = stages.toolpaths, stages.sections.plan.top
    sparse = paths.role == Role.INTERNAL_INFILL
    low = top[paths.layer[sparse]] - paths.height[sparse]

    assert (paths.height[sparse] > 0.25).any()
    assert not ((low < 4.1 - 1e-6) & (top[paths.layer[sparse]] > 4.1 + 1e-6)).any()


def test_heights_that_change_nothing_give_the_same_moves() -> None:
    usual, same = sliced(pyramid(12, 8)), sliced(pyramid(12, 8), overrides="2:4:perimeters=2")

    assert same.program.xyz.shape == usual.program.xyz.shape
    assert same.program.filament.sum() == pytest.approx(usual.program.filament.sum())
    assert same.program.xyz == pytest.approx(usual.program.xyz)


# Objects


def test_each_object_has_its_own_infill_and_perimeters_on_one_plan() -> None:
    stages = sliced(PLATE, infill_density=0.15, overrides="lid:infill_density=0.4; lid:perimeters=3")
    usual = sliced(PLATE, infill_density=0.15)

    assert sparse_share(stages, (1, 5), right=False) == pytest.approx(0.4, rel=0.1)
    assert sparse_share(stages, (1, 5), right=True) == pytest.approx(0.15, rel=0.1)
    inner = Role.PERIMETER
    assert volume(stages, inner, right=False) > 1.8 * volume(usual, inner, right=False)
    assert volume(stages, inner, right=True) == pytest.approx(volume(usual, inner, right=True), rel=0.01)
    assert stages.sections.plan.top.tolist() == usual.sections.plan.top.tolist()


def test_an_object_is_filled_as_if_it_were_alone() -> None:
    stages = sliced(PLATE, overrides="lid:infill_density=0.4")
    alone = sliced(box((SIDE, SIDE, 6)), infill_density=0.4)

    assert volume(stages, right=False) == pytest.approx(volume(alone), rel=0.01)


def test_the_ledger_finds_every_object_closed() -> None:
    stages = sliced(PLATE, overrides="lid:infill_density=0.4; can:top_thickness=1.2")
    coverage = coverage_of(stack_of_program(stages.program, 1.75), stages.sections.solid)

    assert coverage.uncovered.area().max() < 0.2
    assert np.nanmin(coverage.fill.shell) > 0.96  # the raster blurs the inner edge by a cell


def test_speed_and_flow_of_an_object_are_its_alone() -> None:
    stages = sliced(PLATE, overrides="lid:speeds.internal_infill=22; lid:flow_ratio=0.9")
    usual = sliced(PLATE)
    program = stages.program
    sparse = (program.role == Role.INTERNAL_INFILL) & (program.layer > 0)
    left = program.xyz[:, 0] < 0

    assert set(program.speed[sparse & left].tolist()) == {22.0}
    assert 22.0 not in program.speed[sparse & ~left]
    assert volume(stages, right=False) == pytest.approx(0.9 * volume(usual, right=False), rel=1e-3)
    assert volume(stages, right=True) == pytest.approx(volume(usual, right=True), rel=1e-3)


def test_heights_of_an_object_are_its_alone() -> None:
    stages = sliced(PLATE, overrides="lid:2:4:infill_density=0.5")

    assert sparse_share(stages, (2, 4), right=False) == pytest.approx(0.5, rel=0.15)
    assert sparse_share(stages, (2, 4), right=True) == pytest.approx(0.15, rel=0.15)


def test_what_overlaps_is_laid_once_and_belongs_to_the_first() -> None:
    overlapping = place_objects(box((SIDE, SIDE, 4)), box((SIDE, SIDE, 4), (SIDE / 2, 0, 0)))
    stages = sliced(overlapping, infill_density=1, overrides="can:infill_angle_deg=0")

    assert volume(stages) == pytest.approx(1.5 * SIDE * SIDE * 4, rel=0.02)
    assert stages.sections.solid.area() == pytest.approx(1.5 * SIDE * SIDE)


def test_objects_of_one_name_are_meant_together_or_by_number() -> None:
    twins = place_objects(box((10, 10, 3)), box((10, 10, 3), (20, 0, 0)), names=("lid", "lid"))
    both, second = (sliced(twins, overrides=f"{name}:perimeters=4") for name in ("lid", "lid_2"))

    inner = Role.PERIMETER
    assert volume(both, inner, right=False) == pytest.approx(volume(both, inner, right=True))
    assert volume(second, inner, right=True) > 1.8 * volume(second, inner, right=False)


def test_a_single_part_can_be_named_too() -> None:
    part = box((SIDE, SIDE, 4))
    own, usual = sliced(part, overrides=f"{part.name}:perimeters=4"), sliced(part, perimeters=4)

    assert volume(own) == pytest.approx(volume(usual))


# Errors


def test_an_unknown_object_is_told_with_those_there_are() -> None:
    with pytest.raises(UsageError, match="'ldi'") as caught:
        sliced(PLATE, overrides="ldi:perimeters=3")

    assert "Did you mean 'lid'?" in caught.value.remedy
    assert "objects: can, lid" in str(caught.value)


def test_objects_whose_facets_are_not_known_are_refused() -> None:
    lost = replace(PLATE, objects=tuple(item.without_facets() for item in PLATE.objects))

    with pytest.raises(UsageError, match="unknown which facets belong"):
        sliced(lost, overrides="lid:perimeters=3")


def attempt(text: str, **changes: object) -> Profile:
    return load_profile("marlin_220", "pla", "standard", {"overrides": text, **changes})


@pytest.mark.parametrize(
    ("text", "told", "remedy"),
    [
        ("lid:perimetres=3", "lid:perimetres: no such setting", "Did you mean 'perimeters'?"),
        (
            "lid:extrusion_width=0.5",
            "quality.extrusion_width cannot be overridden for objects",
            "Set extrusion_width for the whole print",
        ),
        (
            "lid:nozzle_temperature=200",
            "cannot be overridden for objects",
            "Override it for height ranges, or",
        ),
        ("lid:z_contouring=true", "cannot be overridden for objects", "Set z_contouring for the whole print"),
        ("1:2:elephant_foot=0.2", "cannot be overridden for height ranges", "Override it for objects, or"),
        (
            "lid:1:2:nozzle_temperature=200",
            "cannot be overridden for objects and height ranges",
            "Override it for height ranges, or",
        ),
        (
            "lid:perimeters=many",
            "lid:perimeters: quality.perimeters: expected a whole number",
            "units and bounds",
        ),
        ("lid:perimeters=101", "<= 100", "units and bounds"),
        ("2:1:perimeters=3", "from 2 to 1 mm is empty", "lower end first"),
        ("1:2:nozzle_temperature=400", "allows (260", "Choose"),
        ("perimeters=3", "is not a valid list", "lid:infill_density=0.4"),
        ("1:2:max_bead_width=0.2", "is outside", "lies between them"),
    ],
)
def test_overrides_that_make_no_sense_are_refused(text: str, told: str, remedy: str) -> None:
    with pytest.raises(ProfileError) as caught:
        attempt(text)

    assert "overrides" in str(caught.value)
    assert told in str(caught.value)
    assert remedy in caught.value.remedy
    assert len(caught.value.remedy) < 200


def test_a_spiral_has_no_places_of_its_own() -> None:
    with pytest.raises(ProfileError, match="spiral"):
        attempt("1:2:perimeters=3", spiral=True)


def test_overrides_are_written_as_text_and_read_back() -> None:
    text = "lid:infill_density=0.4; 5:10:speeds.internal_infill=40; lid:1:2.5:ironing=true"
    profile = attempt(text)
    from printer_slicer.profile import list_settings

    assert dict(list_settings(profile))["quality.overrides"] == text
    assert attempt(str(dict(list_settings(profile))["quality.overrides"])) == profile


@pytest.mark.parametrize("name", ["lid", "part"])
def test_the_only_object_goes_by_its_name_and_that_of_the_part(name: str) -> None:
    mesh = box((10, 10, 2))
    named = replace(mesh, objects=(PlateObject.of("lid", mesh.bounds, 0, 0),))
    profile = profile_with(load_profile(), {"overrides": [{"object": name, "set": {"perimeters": 5}}]})

    _, _, (own,) = split_objects(replace(named, name="part"), LayerPlan.from_tops(np.array([0.2])), profile)

    assert own.quality.perimeters == 5


def test_the_only_object_is_scaled_though_its_facets_were_mended() -> None:
    mesh = box((10, 10, 2))
    named = replace(mesh, objects=(PlateObject.of("lid", mesh.bounds, 0, 0),))

    (one,) = transform(named, scale=2.0).objects

    assert np.subtract(one.high, one.low).tolist() == [20, 20, 4]
