"""The style `auto`: never dearer than one style for all, and cheaper than both where a part needs both."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest

from benchmarks.support_parts import turned
from printer_slicer.extrusion import extrude, move_seconds
from printer_slicer.facts.supports import collect_support_facts, format_support_sentences
from printer_slicer.geometry import difference, intersection, normalize, offset
from printer_slicer.model import Areas, Mesh, Overhangs, Sections, Supports, Toolpaths
from printer_slicer.ordering import order
from printer_slicer.pipeline import slice_stages
from printer_slicer.profile import Profile, load_profile
from printer_slicer.support_times import measure_group_times
from printer_slicer.supports import added_columns, styles
from printer_slicer.supports.patch_groups import group_patches
from printer_slicer.supports.styles import STYLES, PrintedSupports, make_supports, measure_path_volume
from printer_slicer.supports.tree_costs import estimate_least_tree_costs
from printer_slicer.supports.trees import grow_trees
from printer_slicer.travels import travel
from printer_slicer.values import replace
from tests.parts import box, joined
from tests.supports.by_stages import prepared
from tests.supports.shapes import (
    bracket,
    hook,
    mushroom,
    shelf_and_arm,
    sphere_on_bed,
    table,
    tee,
    tip_over_a_ridge,
    tub,
)

PARTS = {
    "tee": tee,
    "hook": hook,
    "sphere": sphere_on_bed,
    "mushroom": mushroom,
    "shelf and arm": shelf_and_arm,
    "bracket": bracket,
    "table": table,
}
SLOW = pytest.mark.thorough


@cache
def made(name: str, style: str) -> tuple[PrintedSupports, Overhangs, Profile]:
    """Supports of a part."""
    overhangs, plan, sections, profile = prepared(PARTS[name](), support=style)
    return make_supports(overhangs, plan, sections, profile, measure_group_times), overhangs, profile


def seconds_of(paths: Toolpaths, profile: Profile) -> float:
    """Print time of all paths, with travels, retractions and the moves to the next layer."""
    around = Sections(paths.plan, Areas.empty(paths.plan.n_layers))
    ordered = order(paths, around, profile)
    return float(move_seconds(extrude(ordered, travel(ordered, around, profile), profile), profile).sum())


def cost_of(name: str, style: str) -> float:
    """Minutes, and grams by their price."""
    supports, _, profile = made(name, style)
    grams = measure_path_volume(supports.paths) * profile.material.density / 1000
    return seconds_of(supports.paths, profile) / 60 + profile.quality.support_minutes_per_gram * grams


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=SLOW if name in {"bracket", "table"} else ()) for name in PARTS]
)
def test_auto_is_at_most_as_dear_as_the_better_style(name: str) -> None:
    assert cost_of(name, "auto") <= 1.02 * min(cost_of(name, "columns"), cost_of(name, "tree"))


def leaning_wall() -> Mesh:
    """A wall that leans back, with a ledge; columns below the ledge end in slim wedges above the wall."""
    wall = joined([box((16.0, 4.0, 30.0)), box((16.0, 3.0, 2.0), (0.0, 3.0, 24.0))], "leaning wall")
    up = turned(wall, (20, 0, 0))
    return up.moved((0.0, 0.0, -float(up.bounds[0, 2])))


def test_groups_whose_columns_do_not_stand_get_trees(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(styles, "_ADDED_STYLES", ())
    monkeypatch.setattr(added_columns, "_STEP", 0.0)  # columns cannot lean beside the wall

    assert bare_area(leaning_wall(), "columns") > 20
    assert bare_area(leaning_wall(), "auto") < 3


def bare_area(mesh: Mesh, style: str) -> float:
    """The area of all places that get no support."""
    overhangs, plan, sections, profile = prepared(mesh)
    chosen = replace(profile, quality=replace(profile.quality, support=style))
    found = make_supports(overhangs, plan, sections, chosen, measure_group_times)
    return sum(place.area for place in found.supports.unsupported)


def test_trees_support_what_columns_leave_unsupported(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(added_columns, "_STEP", 0.0)  # columns cannot lean beside the wall
    overhangs, plan, sections, profile = prepared(leaning_wall())

    made = make_supports(overhangs, plan, sections, profile, measure_group_times)

    assert sum(place.area for place in made.supports.unsupported) < 3
    assert made.supports.hollow.n_rings
    assert made.supports.area.area() == pytest.approx(normalize(made.supports.area).area(), abs=1e-3)


def test_a_tiny_island_without_a_column_gets_a_branch(monkeypatch: pytest.MonkeyPatch) -> None:
    overhangs, plan, sections, profile = prepared(tip_over_a_ridge(), support="columns")
    case = overhangs, plan, sections, profile, measure_group_times

    with monkeypatch.context() as only_columns:
        only_columns.setattr(styles, "_ADDED_STYLES", ())
        alone = make_supports(*case).supports
    completed = make_supports(*case).supports

    assert [place.is_island and place.area < 0.2 for place in alone.unsupported] == [True]
    assert completed.unsupported == ()
    assert completed.hollow.n_rings


def test_small_places_are_not_tried_again(monkeypatch: pytest.MonkeyPatch) -> None:
    overhangs, plan, sections, profile = prepared(turned(tee(), (35.0, 14.0, 10.0)), support="columns")
    monkeypatch.setattr(styles, "find_remaining_overhangs", lambda *_: pytest.fail("searched again"))

    made = make_supports(overhangs, plan, sections, profile, measure_group_times)

    small = [place.area for place in made.supports.unsupported]
    assert sum(small) > 1 > max(small)


def test_columns_support_what_trees_leave_unsupported(monkeypatch: pytest.MonkeyPatch) -> None:
    overhangs, plan, sections, profile = prepared(tee(), support="tree")
    monkeypatch.setitem(STYLES, "tree", grow_one)
    monkeypatch.setattr(styles, "_ADDED_STYLES", ("columns",))

    supports = make_supports(overhangs, plan, sections, profile, measure_group_times).supports

    assert supports.unsupported == ()
    assert normalize(difference(supports.base, supports.hollow)).area()[20:100].min() > 0


def test_places_that_cost_more_than_they_are_worth_stay_unsupported(monkeypatch: pytest.MonkeyPatch) -> None:
    overhangs, plan, sections, profile = prepared(tee(), support="tree")
    monkeypatch.setitem(STYLES, "tree", grow_one)
    dear = replace(profile, quality=replace(profile.quality, support_minutes_per_gram=1000.0))

    made = make_supports(overhangs, plan, sections, dear, measure_group_times)

    assert sum(place.area for place in made.supports.unsupported) > 200


def grow_one(given: Overhangs, *rest: Any) -> Supports:
    """Trees for the first patch only, if there are others."""
    return grow_trees(given.take_patches(np.arange(given.n_patches) == 0), *rest)


def test_groups_that_trees_do_not_reach_get_columns(monkeypatch: pytest.MonkeyPatch) -> None:
    overhangs, plan, sections, profile = prepared(tee(), support="auto")
    monkeypatch.setattr(styles, "_ADDED_STYLES", ())
    monkeypatch.setitem(STYLES, "tree", grow_one)

    found = make_supports(overhangs, plan, sections, profile, measure_group_times).supports

    assert overhangs.n_patches == 2
    assert found.unsupported == ()
    assert found.hollow.n_rings
    assert (found.base.area() - found.hollow.area())[20:100].min() > 100


def test_a_low_plate_gets_columns_and_a_high_arm_trees() -> None:
    supports = made("shelf and arm", "auto")[0].supports

    assert cost_of("shelf and arm", "auto") < 0.95 * min(
        cost_of("shelf and arm", style) for style in ("columns", "tree")
    )
    low = np.arange(2, int(np.searchsorted(supports.plan.layers.top, 7.0)))
    assert (supports.base.area() - supports.hollow.area())[low].min() > 500
    high = np.flatnonzero(supports.plan.layers.top > 20)
    # Where branches join, a layer may be closed.
    assert (supports.hollow.area() + supports.interface.area())[high[:50]].min() > 0
    assert (supports.base.area() - supports.hollow.area())[high].max() < 1e-3


def test_trees_keep_their_distance_from_columns() -> None:
    supports = made("shelf and arm", "auto")[0].supports
    above = np.arange(1, supports.plan.layers.n_layers)
    trees = supports.hollow.of_layers(above)
    columns = supports.base.merge(supports.floor).of_layers(above)
    kept = normalize(columns).area() - normalize(trees).area()

    assert supports.area.area() == pytest.approx(normalize(supports.area).area(), abs=1e-3)
    assert kept.max() > 500
    left = offset(trees, 0.3)
    assert intersection(left, columns).area() == pytest.approx(trees.area(), abs=1e-2)


def test_facts_name_both_styles() -> None:
    hollow = {"perimeters": 1, "infill_density": 0, "top_thickness": 0, "bottom_thickness": 0}
    profile = load_profile(quality="standard", changes={"support": "auto", **hollow})
    styles = {}
    for name in ("shelf and arm", "tee", "mushroom"):
        facts = collect_support_facts(slice_stages(PARTS[name](), profile), profile)
        assert facts is not None
        styles[name] = facts["style"]

    assert styles == {"shelf and arm": "columns and tree", "tee": "tree", "mushroom": "columns"}


@pytest.mark.parametrize(("style", "added"), [("columns", "tree"), ("auto", None), ("tree", None)])
def test_facts_name_the_added_style(style: str, added: str | None) -> None:
    profile = load_profile(quality="standard", changes={"support": style, "infill_density": 0})

    facts = collect_support_facts(slice_stages(tip_over_a_ridge(), profile), profile)

    assert facts is not None
    assert facts["added_style"] == added
    assert ("trees support what columns cannot" in format_support_sentences(facts)[0]) == bool(added)


@pytest.mark.parametrize("style", ["columns", "tree"])
@pytest.mark.parametrize("name", ["tee", "sphere", "mushroom"])
def test_times_of_some_layers_give_that_of_all(name: str, style: str) -> None:
    supports, _, profile = made(name, style)
    paths = supports.paths
    ends = (paths.xy[paths.start[:-1], 0] > paths.xy[:, 0].mean()).astype(np.int64)
    whole, halves = (
        measure_group_times(paths, group, n, profile)
        for group, n in ((np.zeros(paths.n_paths, np.int64), 1), (ends, 2))
    )

    assert whole.sum() == pytest.approx(seconds_of(paths, profile), rel=0.04)
    assert halves.sum() == pytest.approx(whole.sum(), rel=0.04)
    assert halves.max() < 0.65 * whole.sum()


def test_patches_whose_columns_meet_are_one_group() -> None:
    for name, n_patches, n_groups in (("tee", 2, 2), ("shelf and arm", 2, 2), ("bracket", 1, 1)):
        columns, overhangs, _ = made(name, "columns")
        groups = group_patches(overhangs, columns.supports)
        assert (overhangs.n_patches, groups.count) == (n_patches, n_groups)
        assert np.unique(groups.of_patch).tolist() == list(range(n_groups))


@pytest.mark.parametrize("name", ["tee", "sphere", "mushroom", "hook"])
def test_trees_are_not_cheaper_than_their_estimate(name: str) -> None:
    columns, overhangs, profile = made(name, "columns")
    groups = group_patches(overhangs, columns.supports)
    least = estimate_least_tree_costs(columns.supports, columns.paths, groups, profile)

    assert (least > 0).all()
    assert least.sum() < cost_of(name, "tree")


def ledge(clearance: float) -> Mesh:
    """A block with ledges on two sides, just above the bed."""
    return joined([box((20.0, 20.0, 10.0), (10.0, 0.0, 0.0)), box((40.0, 20.0, 2.0), (0.0, 0.0, clearance))])


@pytest.mark.parametrize("clearance", [0.35, 0.5])
def test_trees_of_low_ledges_are_roofs_on_the_bed(clearance: float) -> None:
    profile = load_profile(quality="standard", changes={"support": "tree"})
    stages = slice_stages(ledge(clearance), profile)
    facts = collect_support_facts(stages, profile)

    assert stages.supports is not None
    assert facts is not None
    assert facts["style"] == "tree"
    assert facts["on_bed_mm2"] > 380
    assert not stages.supports.unsupported


def test_supports_without_plastic_have_no_style() -> None:
    profile = load_profile(quality="standard", changes={"support": "columns", "support_on_bed_only": True})
    stages = slice_stages(tub(), profile)
    facts = collect_support_facts(stages, profile)

    assert facts is not None
    assert (facts["style"], facts["filament_g"]) == ("none", 0)
    assert facts["unsupported_places"]
    assert format_support_sentences(facts)[0] == "Supports: none can be printed"
