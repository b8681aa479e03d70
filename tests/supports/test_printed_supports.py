"""Supports in the whole pipeline: order, heights, what surrounds them, and cooling."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from printer_slicer.gcode import write_gcode
from printer_slicer.geometry import Areas, difference, intersection, offset
from printer_slicer.model import Mesh, Program
from printer_slicer.pipeline import slice_stages
from printer_slicer.placing import join
from printer_slicer.profile import load_profile
from printer_slicer.profile.overrides import Override
from printer_slicer.roles import Role, roles_with
from printer_slicer.stages import Stages
from printer_slicer.values import replace
from tests.parts import box, layers
from tests.supports.shapes import hook, round_body, tee

PARTS = {"tee": tee, "hook": hook}


@cache
def sliced(name: str, **changes: object) -> Stages:
    """A part with supports, uniform layers."""
    return slice_stages(
        PARTS[name](), load_profile(quality="standard", changes={"support": "columns", **changes})
    )


def square(side: float, more: float) -> np.ndarray:
    """A ring from the origin, larger at all sides."""
    a, b = -more, side + more
    return np.array([(a, a), (b, a), (b, b), (a, b)])


def is_support(program: Program) -> np.ndarray:
    """Mask of moves."""
    return roles_with(is_support=True)[program.role]


@pytest.mark.parametrize("style", ["columns", "tree", "auto"])
@pytest.mark.parametrize("name", PARTS)
def test_the_nozzle_never_goes_below_what_is_printed(name: str, style: str) -> None:
    program = sliced(name, support=style).program
    extrudes = program.role != Role.TRAVEL

    assert is_support(program).any()
    assert (np.diff(program.xyz[extrudes, 2]) >= -1e-9).all()
    lowest = np.maximum.accumulate(np.where(extrudes, program.xyz[:, 2], 0.0))
    assert (program.xyz[:, 2] >= lowest - 1e-9)[1:].all()


def test_supports_are_printed_before_the_part_in_each_layer() -> None:
    program = sliced("tee").program
    for layer in np.unique(program.layer[is_support(program)]):
        here = program.layer == layer
        own = np.flatnonzero(here & is_support(program))
        part = np.flatnonzero(here & roles_with(is_part=True)[program.role])
        assert not len(part) or own.max() < part.min()


def test_the_printed_gap_under_a_flat_is_that_of_the_settings() -> None:
    stages = sliced("tee")
    program = stages.program
    bottom = 40.0  # of the arms

    assert program.xyz[is_support(program), 2].max() == pytest.approx(bottom - 0.2, abs=1e-6)
    assert stages.supports is not None
    assert len(stages.supports.unsupported) == 0


def test_layers_of_the_part_are_the_same_with_supports() -> None:
    plain, held = sliced("tee", support="off"), sliced("tee")
    own = held.program.plan.find_tops(plain.program.plan.top)

    assert held.program.plan.top[own] == pytest.approx(plain.program.plan.top, abs=1e-9)
    assert held.program.plan.height[own] == pytest.approx(plain.program.plan.height)
    part = [roles_with(is_part=True)[one.program.role] for one in (plain, held)]
    used = [one.program.filament[some].sum() for one, some in zip((plain, held), part, strict=True)]
    assert used[0] == pytest.approx(used[1], rel=0.02)  # bridges that lie on supports are solid infill


def test_same_input_gives_the_same_bytes() -> None:
    profile = load_profile(quality="standard", changes={"support": "columns"})
    texts = [write_gcode(slice_stages(hook(), profile).program, profile) for _ in range(2)]

    assert texts[0] == texts[1]


def test_the_order_of_facets_does_not_matter() -> None:
    profile = load_profile(quality="standard", changes={"support": "columns"})
    mesh = hook()
    shuffled = Mesh(mesh.triangles[np.random.default_rng(1).permutation(mesh.n_facets)], mesh.name)
    one, other = (slice_stages(part, profile).supports for part in (mesh, shuffled))

    assert one is not None
    assert other is not None
    assert one.area.area() == pytest.approx(other.area.area(), abs=1e-6)


def test_skirt_and_brim_surround_supports() -> None:
    stages = sliced("tee", brim_width=3, skirt_loops=1)
    paths, supports = stages.toolpaths, stages.supports
    assert supports is not None
    first = supports.area.of_layers(np.arange(1))

    for role in (Role.BRIM, Role.SKIRT):
        own = paths.take(np.flatnonzero((paths.role == role) & (paths.layer == 0)))
        low, high = own.xy.min(axis=0), own.xy.max(axis=0)
        assert (low < first.xy.min(axis=0)).all()
        assert (high > first.xy.max(axis=0)).all()


def test_a_draft_shield_has_the_layers_of_the_part() -> None:
    both = [sliced("tee", support=style, skirt_loops=1, skirt_height=10.0) for style in ("off", "columns")]
    plain, held = (one.program.xyz[one.program.role == Role.SKIRT, 2] for one in both)

    assert np.unique(plain) == pytest.approx(np.unique(held))


def test_a_raft_carries_supports() -> None:
    stages = sliced("tee", raft_height=1.0, raft_gap=0.15)
    program, supports = stages.program, stages.supports
    assert supports is not None
    raft = program.xyz[program.role == Role.RAFT]
    own = program.xyz[is_support(program)]

    assert own[:, 2].min() == pytest.approx(1.0 + 0.15 + 0.2)
    assert (raft[:, :2].min(axis=0) < own[:, :2].min(axis=0)).all()
    assert (raft[:, :2].max(axis=0) > own[:, :2].max(axis=0)).all()


def test_objects_without_supports_get_none_and_are_in_no_way_of_others() -> None:
    plain = Mesh(tee().triangles, "plain").moved((0.0, 40.0, 0.0))
    post = Mesh(box((10.0, 10.0, 20.0)).triangles, "post").moved((20.0, -5.0, 0.0))
    usual = load_profile(quality="standard")
    overrides = (Override(object="tee", set={"support": "columns"}),)
    profile = replace(usual, quality=replace(usual.quality, overrides=overrides))
    stages = slice_stages(join([tee(), post, plain]), profile)
    supports = stages.supports
    assert supports is not None

    # Only one of two equal parts, which are 40 mm apart, has supports.
    assert np.ptp(supports.area.xy[:, 1]) < 20
    first = supports.area.copy_layers(np.zeros(1, np.int64))
    near = offset(stages.sections.solid.copy_layers(np.zeros(1, np.int64)), 0.3)
    assert difference(first, near).area() == pytest.approx(first.area(), abs=1e-3)


def test_supports_keep_their_distance_from_objects_with_other_layers() -> None:
    thick = box((8.0, 8.0, 9.0)).moved((16.0, -4.0, 0.0))
    changes = {"support": "columns", "support_gap": 0.0, "support_layer_max": 0.1}
    plans = [layers(140, 0.1), layers(30, 0.3)]
    stages = slice_stages(
        join([tee(height=10.0), thick]), load_profile(quality="standard", changes=changes), plan=plans
    )
    supports = stages.supports
    assert supports is not None

    low = supports.plan.layers.top < 8.9
    corner = np.add(stages.part.bounds.mean(axis=0)[:2], (16.0, -4.0))
    around = Areas.from_rings([[corner + square(8.0, 0.3)]] * int(low.sum()))
    assert intersection(supports.area.copy_layers(np.flatnonzero(low)), around).area().max() < 1e-3


def test_supports_are_labelled_as_the_object_that_they_carry() -> None:
    pair = join([tee(height=10.0), Mesh(tee(height=10.0).triangles, "other").moved((0.0, 40.0, 0.0))])
    stages = slice_stages(pair, load_profile(quality="standard", changes={"support": "columns"}))
    labels, program = stages.labels, stages.program
    assert labels is not None

    own = labels.object_id[is_support(program)]
    is_far = program.xyz[is_support(program), 1] > stages.part.bounds.mean(axis=0)[1]
    assert own.tolist() == is_far.astype(int).tolist()


def test_layers_of_supports_alone_are_not_slowed_down_for_cooling() -> None:
    profile = load_profile(quality="standard", changes={"support": "columns"})
    program = sliced("tee").program
    alone = np.setdiff1d(
        program.layer[is_support(program)], program.layer[roles_with(is_part=True)[program.role]]
    )
    here = np.isin(program.layer, alone) & is_support(program)

    assert len(alone)
    assert np.median(program.speed[here]) > 2 * profile.material.min_speed


def test_there_are_no_supports_in_vase_mode() -> None:
    vase = round_body([(5.0, 0.0), (5.0, 10.0), (9.0, 11.0), (9.0, 20.0)])
    changes = {"support": "columns", "spiral": True}
    stages = slice_stages(vase, load_profile(quality="standard", changes=changes))

    assert stages.overhangs is not None
    assert stages.overhangs.area.n_rings
    assert stages.supports is None
