"""Supports of several objects: each with its own settings, on shared layers, and labelled as the object it carries."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from printer_slicer.extrusion import move_seconds
from printer_slicer.facts.overhangs import collect_overhang_facts
from printer_slicer.geometry import intersection, normalize, offset
from printer_slicer.model import Mesh, Program
from printer_slicer.pipeline import plan_part, slice_planned, slice_stages
from printer_slicer.placing import join, place, transform
from printer_slicer.profile import Profile, load_profile, profile_with
from printer_slicer.roles import roles_with
from printer_slicer.stages import Stages
from tests.parts import box, joined
from tests.supports.shapes import tee

FAR = 40.0  # mm between two parts


def pair() -> Mesh:
    """Two equal parts."""
    one, other = tee(height=10.0), tee(height=10.0)
    return join([Mesh(one.triangles, "one"), Mesh(other.triangles, "other").moved((0.0, FAR, 0.0))])


def wanted(one: dict[str, object], other: dict[str, object], **changes: object) -> Profile:
    """Settings of both."""
    overrides = [{"object": "one", "set": one}, {"object": "other", "set": other}]
    usual = load_profile(quality="standard", changes={"support": "columns", **changes})
    return profile_with(usual, {"quality.overrides": overrides})


@cache
def sliced_pair() -> tuple[Stages, Profile]:
    """Columns with a small gap under one, trees with a large one under the other."""
    profile = wanted({"support_gap": 0.15}, {"support_gap": 0.31, "support": "tree"})
    return slice_stages(pair(), profile), profile


def is_support(program: Program) -> np.ndarray:
    """Mask of moves."""
    return roles_with(is_support=True)[program.role]


def is_far(stages: Stages) -> np.ndarray:
    """Mask of the moves beside the second part."""
    return stages.program.xyz[:, 1] > stages.part.bounds.mean(axis=0)[1]


def test_each_object_has_its_own_gap_and_style() -> None:
    stages, _ = sliced_pair()
    program, far, supports = stages.program, is_far(stages), stages.supports
    assert supports is not None
    highest = [program.xyz[is_support(program) & side, 2].max() for side in (~far, far)]

    assert highest == pytest.approx([9.85, 9.69], abs=1e-6)
    assert supports.plan.flat_gap_error == pytest.approx(0.0, abs=1e-6)
    middle = stages.part.bounds.mean(axis=0)[1]
    assert (supports.branches[:, 2] > middle).all()
    columns = supports.base.of_layers(np.arange(1, supports.base.n_layers))
    assert columns.xy[:, 1].min() < middle


def test_layers_are_shared() -> None:
    stages, _ = sliced_pair()
    program, far = stages.program, is_far(stages)
    tops = [np.unique(program.xyz[is_support(program) & side, 2]) for side in (~far, far)]

    assert len(np.setdiff1d(tops[1], tops[0])) <= 1  # the highest one of the larger gap may be a joist alone
    heights = np.diff(np.unique(np.concatenate(tops)))
    assert heights.min() > 0.05


def test_overhangs_of_objects_without_supports_are_reported() -> None:
    profile = wanted({}, {"support": "off"})
    stages = slice_stages(pair(), profile)
    facts, supports = collect_overhang_facts(stages, profile), stages.supports
    assert facts is not None
    assert supports is not None

    assert facts["count"] == 2
    assert facts["area_mm2"] == pytest.approx(2 * 25 * 10, rel=0.02)
    assert all(place["y"] > FAR / 2 for place in facts["largest"])
    assert supports.area.xy[:, 1].max() < stages.part.bounds.mean(axis=0)[1]


def test_nothing_is_reported_where_all_objects_have_supports() -> None:
    stages, profile = sliced_pair()

    assert stages.overhangs_without_supports is None
    assert collect_overhang_facts(stages, profile) is None


def test_supports_of_different_settings_do_not_meet() -> None:
    low = Mesh(tee(height=10.0, arm=20.0).triangles, "one")
    high = Mesh(tee(height=20.0, arm=20.0).triangles, "other").moved((0.0, 12.0, 0.0))
    for styles in (("columns", "tree"), ("tree", "columns"), ("columns", "columns")):
        profile = wanted(
            *({"support": style, "support_xy_gap": 0.4 + i / 10} for i, style in enumerate(styles))
        )
        stages = slice_stages(join([low, high]), profile)
        supports = stages.supports
        assert supports is not None
        area = supports.area
        assert area.area() == pytest.approx(normalize(area).area(), abs=1e-3)

        layers, part = supports.plan.layers, stages.sections.plan
        own, at = np.nonzero(
            (layers.bottom[:, None] < part.top - 1e-6) & (layers.top[:, None] > part.bottom + 1e-6)
        )
        near = offset(stages.sections.solid.copy_layers(at), 0.39)
        assert intersection(area.copy_layers(own), near).area().max() < 1e-3


def overhanging_pair() -> Mesh:
    """A high part whose arm reaches over a low one."""
    post = joined([box((8.0, 8.0, 31.0)), box((50.0, 8.0, 3.0), (0.0, 0.0, 30.0))], "high")
    low = box((8.0, 8.0, 5.0), (36.0, 0.0, 0.0))
    return join([Mesh(post.triangles, "high"), Mesh(low.triangles, "low")])


@pytest.mark.parametrize("style", ["columns", "tree", "auto"])
def test_supports_belong_to_the_object_that_they_carry(style: str) -> None:
    stages = slice_stages(overhanging_pair(), load_profile(quality="standard", changes={"support": style}))
    labels, program = stages.labels, stages.program
    assert labels is not None
    own = labels.object_id[is_support(program)]

    assert labels.names[0] == "high"
    assert len(own)
    assert (own == 0).all()


def test_a_support_that_carries_two_objects_belongs_to_none() -> None:
    parts = [
        joined([box((6.0, 8.0, 12.0), (x, 0.0, 0.0)), box((20.0, 8.0, 2.0), (x + dx, 0.0, 11.0))], name)
        for x, dx, name in ((0.0, 0.0, "left"), (34.5, -14.0, "right"))
    ]
    both = join([Mesh(part.triangles, name) for part, name in zip(parts, ("left", "right"), strict=True)])
    stages = slice_stages(both, load_profile(quality="standard", changes={"support": "columns"}))
    labels, program = stages.labels, stages.program
    assert labels is not None

    assert np.unique(labels.object_id[is_support(program)]).tolist() == [-1]
    assert set(np.unique(labels.object_id[roles_with(is_part=True)[program.role]])) == {0, 1}


def test_a_trial_gives_the_same_moves_without_what_hangs() -> None:
    for support, expected in (("off", True), ("columns", False)):
        profile = load_profile(quality="standard", changes={"support": support})
        part = place(tee(height=10.0), profile.printer)
        plan = plan_part(part, profile)
        trial, whole = (slice_planned(part, plan, profile, trial=trial) for trial in (True, False))

        assert (trial.overhangs is None) == expected
        assert whole.overhangs is not None
        assert np.array_equal(trial.program.xyz, whole.program.xyz)


def test_a_time_budget_includes_supports() -> None:
    def adaptive(budget: float, support: str) -> Profile:
        changes = {"support": support, "planner.time_budget": budget}
        return load_profile(quality="adaptive", changes=changes)

    def seconds(budget: float, support: str) -> float:
        profile = adaptive(budget, support)
        return float(move_seconds(slice_stages(tee(height=20.0), profile).program, profile).sum())

    without, with_supports = seconds(0, "off"), seconds(0, "columns")
    budget = 1.1 * with_supports

    assert with_supports > 1.2 * without
    assert 0.8 * budget < seconds(budget, "columns") <= budget


def test_a_height_range_has_its_own_supports() -> None:
    post = joined(
        [box((8.0, 8.0, 40.0)), *(box((30.0, 8.0, 3.0), (0.0, 0.0, z)) for z in (12.0, 37.0))], "post"
    )
    low = {"low": 0.0, "high": 20.0, "set": {"support": "off"}}
    gap = {"low": 20.0, "high": 100.0, "set": {"support_gap": 0.3}}
    usual = load_profile(quality="standard", changes={"support": "columns", "support_gap": 0.15})
    tops = []
    for overrides in ([], [gap], [low, gap]):
        profile = profile_with(usual, {"quality.overrides": overrides})
        stages = slice_stages(post, profile)
        top = stages.program.xyz[is_support(stages.program), 2]
        tops.append((float(top[top < 12.0].max(initial=0.0)), float(top.max())))
        assert (stages.overhangs_without_supports is not None) == (low in overrides)

    assert tops == [
        pytest.approx((11.85, 36.85), abs=1e-6),
        pytest.approx((11.85, 36.7), abs=1e-6),
        pytest.approx((0.0, 36.7), abs=1e-6),
    ]


@pytest.mark.parametrize("style", ["auto", "columns", "tree"])
def test_what_begins_in_the_second_layer_lies_on_the_bed(style: str) -> None:
    """A box on its corner, of which compensation removes the first layer."""
    profile = load_profile(quality="standard", changes={"support": style, "xy_compensation": -0.2})
    part = transform(Mesh(box((10.0, 10.0, 10.0)).triangles, "box"), rotate=(45.0, 35.26, 0.0))

    stages = slice_stages(part, profile)

    assert stages.overhangs is not None
    assert stages.overhangs.n_patches > 0
    assert stages.supports is None
