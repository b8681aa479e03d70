"""What is printed of supports stands: bead by bead, on beads that stand, on the part or on the bed."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np
import pytest

from printer_slicer.arrays import Float, consecutive
from printer_slicer.geometry import depths, find_enclosing_rings
from printer_slicer.geometry.boxes import Boxes
from printer_slicer.kernel import VARIABLE, load_kernel
from printer_slicer.model import Areas, LayerPlan, Mesh, Overhangs, Sections, Supports, Toolpaths
from printer_slicer.profile import Profile
from printer_slicer.roles import Role
from printer_slicer.supports.bead_samples import PartBelow, find_carried, sample_beads
from printer_slicer.supports.stability import check_stability
from printer_slicer.supports.styles import STYLES, measure_path_volume
from printer_slicer.supports.support_paths import make_support_paths
from printer_slicer.supports.unsupported_beads import keep_samples
from printer_slicer.values import replace
from tests.kernels import needs_kernel
from tests.parts import plain
from tests.supports.by_hand import overhangs_of, support_plan
from tests.supports.by_stages import prepared
from tests.supports.noise import noise_sections
from tests.supports.shapes import bracket, hook, mushroom, sphere_on_bed, table, tee

Case = tuple[Supports, Toolpaths, Overhangs, Sections, Profile]
SHAPES: dict[str, Callable[[], Mesh]] = {
    "tee": tee,
    "hook": hook,
    "mushroom": mushroom,
    "sphere": sphere_on_bed,
    "bracket": bracket,
    "table": lambda: table(40, 30, 20),
}
STYLE_NAMES = list(STYLES)
STEP = 0.2  # mm
ACCURACY = 0.2  # mm, diagonal of the cells of the raster by which the check decides, and some rounding


@cache
def made(name: str, style: str) -> Case:
    """Supports of a shape before the check."""
    overhangs, plan, sections, profile = prepared(SHAPES[name](), support=style)
    supports = STYLES[style](overhangs, plan, sections, profile)
    return supports, make_support_paths(supports, profile), overhangs, sections, profile


def made_on_noise(seed: int, style: str) -> Case:
    """Supports of a random solid before the check."""
    sections, profile = noise_sections(seed), plain()
    overhangs = overhangs_of(sections)
    supports = STYLES[style](overhangs, support_plan(overhangs), sections, profile)
    return supports, make_support_paths(supports, profile), overhangs, sections, profile


def find_free_stretches(paths: Toolpaths, sections: Sections) -> tuple[Float, Float]:
    """Lengths of the stretches without anything below them, mm, and the share (M,) of each path that is free.

    An own computation, by distances to the lines below, for comparison with the raster of the check. A point is carried
    if a line below is nearer than half of the width, or the part below is near, both with the accuracy of the raster.
    """
    begin, end = paths.ends_of_beads
    a, b, layer = paths.xy[begin], paths.xy[end], np.repeat(paths.layer, paths.beads_of_each)
    path, width = paths.path_of_bead, paths.width[begin]
    length = np.hypot(*(b - a).T)
    count = np.maximum(np.ceil(length / STEP), 1).astype(np.int64)
    bead = np.repeat(np.arange(len(a)), count)
    share = (consecutive(np.zeros(len(a), np.int64), count) + 0.5) / count[bead]
    points, step = a[bead] + share[:, None] * (b - a)[bead], (length / count)[bead]
    reach = width.max() / 2 + ACCURACY
    lines = Boxes(np.minimum(a, b), np.maximum(a, b), layer + 1)
    point, line = Boxes(points - reach, points + reach, layer[bead]).find_overlapping(lines)
    way = (b - a)[line]
    along = ((points[point] - a[line]) * way).sum(axis=1) / np.maximum((way**2).sum(axis=1), 1e-12)
    away = np.hypot(*(a[line] + np.clip(along, 0, 1)[:, None] * way - points[point]).T)
    carried = layer[bead] == 0
    carried[point[away <= width[line] / 2 + ACCURACY]] = True
    layers, plan = paths.plan, sections.plan
    lowest = layers.bottom - 0.2 - layers.height.max() - 1e-6
    first, last = np.searchsorted(plan.top, lowest), np.searchsorted(plan.top, layers.bottom + 1e-6)
    for rise in range(int((last - first).max())):
        left = np.flatnonzero(~carried & (first + rise < last)[layer[bead]])
        depth = depths(sections.solid, points[left], (first + rise)[layer[bead[left]]], 3.0)
        carried[left[depth >= -width.max() / 2]] = True
        # Points deep inside are far from all outlines.
        deep = left[np.isnan(depth)]
        ring = find_enclosing_rings(sections.solid, points[deep], (first + rise)[layer[bead[deep]]])
        carried[deep[(ring >= 0) & (sections.solid.ring_area()[ring] > 0)]] = True
    begins = np.append(True, (np.diff(path[bead]) != 0) | (np.diff(carried.astype(int)) != 0))
    run = np.cumsum(begins) - 1
    free = np.bincount(run, step * ~carried)
    whole = np.bincount(path[bead], step, paths.n_paths)
    return free, np.bincount(path[bead], step * ~carried, paths.n_paths) / np.maximum(whole, 1e-9)


@pytest.mark.parametrize(
    ("name", "style"),
    [(name, style) for name in ("tee", "hook", "table") for style in STYLE_NAMES],
)
def test_what_stands_is_returned_as_it_is(name: str, style: str) -> None:
    supports, paths, *rest = made(name, style)

    standing = check_stability(supports, paths, *rest)

    assert standing.supports is supports
    assert standing.paths is paths
    assert not len(standing.removed)


@pytest.mark.parametrize("style", STYLE_NAMES)
def test_only_short_ends_of_interfaces_of_a_round_part_are_taken_out(style: str) -> None:
    supports, paths, *rest = made("mushroom", style)

    standing = check_stability(supports, paths, *rest)
    lost = float(paths.length().sum() - standing.paths.length().sum())

    assert 0 < lost < 10
    assert np.array_equal(standing.supports.area.area(), supports.area.area())


def check_random_solid(seed: int, style: str) -> None:
    """After the check nothing floats, by the check itself and by distances; most of the supports are still there."""
    case = made_on_noise(seed, style)
    standing = check_stability(*case)
    _, paths, overhangs, sections, profile = case

    again = check_stability(standing.supports, standing.paths, overhangs, sections, profile)
    assert again.paths is standing.paths
    if standing.paths.n_paths:
        free, share = find_free_stretches(standing.paths, sections)
        assert free.max(initial=0.0) <= 2.2 * profile.quality.support_spacing
        assert (share <= 0.9).all()
    assert measure_path_volume(standing.paths) >= 0.8 * measure_path_volume(paths)


@pytest.mark.parametrize("style", STYLE_NAMES)
@pytest.mark.parametrize("seed", [3, 14])
def test_after_the_check_no_bead_of_random_solids_floats(seed: int, style: str) -> None:
    check_random_solid(seed, style)


@pytest.mark.thorough
@pytest.mark.parametrize("style", STYLE_NAMES)
@pytest.mark.parametrize("seed", range(100, 300))
def test_after_the_check_no_bead_of_many_random_solids_floats(seed: int, style: str) -> None:
    check_random_solid(seed, style)


def square(side: float, *, at: tuple[float, float]) -> Float:
    return np.array([(0, 0), (side, 0), (side, side), (0, side)]) * 1.0 + at


@pytest.mark.parametrize("style", STYLE_NAMES)
def test_a_planted_piece_in_the_air_is_taken_out(style: str) -> None:
    supports, paths, *rest = made("tee", style)
    n_layers = supports.plan.layers.n_layers
    away = supports.base.xy.max(axis=0) + 5.0
    here = (np.arange(n_layers) >= n_layers // 2) & (np.arange(n_layers) < n_layers // 2 + 6)
    piece = Areas.from_rings([[square(6.0, at=tuple(away))] if some else [] for some in here])
    planted = replace(
        supports,
        base=supports.base.merge(piece),
        hollow=supports.hollow.merge(piece) if style == "tree" else supports.hollow,
    )

    standing = check_stability(planted, make_support_paths(planted, rest[-1]), *rest)

    assert measure_path_volume(standing.paths) == pytest.approx(measure_path_volume(paths))
    assert standing.supports.base.area() == pytest.approx(supports.base.area())
    assert (standing.removed[:, :2] > away - 0.1).all()


def leave_out(paths: Toolpaths, layer: int, low: float) -> Toolpaths:
    """The paths without those of a layer whose points all lie beyond x = `low`."""
    beyond = np.minimum.reduceat(paths.xy[:, 0], paths.start[:-1]) > low
    return paths.take(np.flatnonzero(~(beyond & (paths.layer == layer))))


@pytest.mark.parametrize("share", [0.3, 0.6])
@pytest.mark.parametrize("style", STYLE_NAMES)
def test_a_planted_gap_is_filled(style: str, share: float) -> None:
    supports, paths, overhangs, sections, profile = made("tee", style)
    layer = int(share * paths.plan.n_layers)
    middle = float(sections.solid.xy[:, 0].mean())
    less = leave_out(paths, layer, middle + 5.0)
    assert less.n_paths < paths.n_paths

    standing = check_stability(supports, less, overhangs, sections, profile)

    assert standing.paths is not less
    free, free_share = find_free_stretches(standing.paths, sections)
    assert free.max() <= 2.2 * profile.quality.support_spacing
    assert free_share.max() <= 0.9
    highest = [one.length()[one.layer == paths.layer.max()].sum() for one in (paths, standing.paths)]
    assert highest[1] >= 0.95 * highest[0]


def test_what_may_not_be_carried_is_taken_out() -> None:
    """The upper beads lie 3 mm over a plate, on which no column may stand."""
    supports, paths, overhangs, sections, profile = made("tee", "columns")
    profile = replace(profile, quality=replace(profile.quality, support_on_bed_only=True))
    top = paths.take(np.flatnonzero(paths.layer >= paths.plan.n_layers - 2))
    highest = sections.plan.n_layers - 1
    is_plate = sections.plan.top < paths.plan.top[-1] - 3.0
    solid = sections.solid.copy_layers(np.where(is_plate, highest, np.arange(highest + 1)))

    standing = check_stability(supports, top, overhangs, replace(sections, solid=solid), profile)

    assert standing.paths.n_paths == 0
    assert standing.supports.area.area()[-2:].sum() == 0


def test_no_beads_stand() -> None:
    supports, paths, *rest = made("tee", "columns")
    none = paths.take(np.zeros(0, np.int64))

    assert check_stability(supports, none, *rest).paths is none


def test_the_rest_of_a_cut_loop_is_one_line() -> None:
    plan = LayerPlan.from_tops(np.array([0.2, 0.4]))
    ring = square(10.0, at=(0.0, 0.0))
    paths = Toolpaths.gathered(
        plan,
        xy=ring,
        size=np.array([4]),
        layer=np.array([1]),
        role=np.array([Role.SUPPORT]),
        width=np.full(1, 0.45),
        closed=True,
    )
    samples = sample_beads(paths)
    x, y = samples.points(np.arange(samples.count)).T
    kept = ~((x > 9.9) & (y > 4) & (y < 6))

    line = keep_samples(samples, paths, kept)

    assert line.n_paths == 1
    assert not line.closed.any()
    assert line.length().sum() == pytest.approx(38.0, abs=0.5)
    assert line.length().sum() == pytest.approx(samples.length[kept].sum())
    assert len(line.xy) == 6


def two_lines(y: float, shift: float) -> Toolpaths:
    """A line along x on the bed, and one on top of it that lies `shift` mm beside it."""
    return Toolpaths.gathered(
        LayerPlan.from_tops(np.array([0.2, 0.4])),
        xy=np.array([(0.0, y), (20.0, y), (0.0, y + shift), (20.0, y + shift)]),
        size=np.array([2, 2]),
        layer=np.array([0, 1]),
        role=np.full(2, Role.SUPPORT),
        width=np.full(2, 0.45),
        closed=False,
    )


@pytest.mark.parametrize("y", [0.0, 0.03, 0.07, 0.1, 0.15])
@pytest.mark.parametrize(("shift", "lies"), [(0.15, True), (-0.15, True), (0.26, False), (-0.26, False)])
def test_half_of_the_width_must_lie_on_something(y: float, shift: float, lies: bool) -> None:
    paths = two_lines(y, shift)
    samples = sample_beads(paths)

    carried = find_carried(samples, paths)

    assert carried[samples.path == 0].all()
    assert (carried[samples.path == 1] == lies).all()


@pytest.mark.parametrize(("aside", "lies"), [(-0.15, True), (0.03, False)])
def test_beads_lie_on_slopes_only_near_them(aside: float, lies: bool) -> None:
    plan = LayerPlan.from_tops(np.arange(1, 60) * 0.2)
    steep = np.tan(np.radians(60.0))
    high = 20.0 - plan.cut * steep  # a slope of 30 degrees
    corners = [np.column_stack([(0, x, x, 0), (0, 0, 20, 20)]) for x in np.maximum(high, 0.1)]
    solid = Areas(np.concatenate(corners), 4 * np.arange(60), np.arange(59), 59)
    paths = two_lines(0.0, 0.0)
    edge = 20.0 - (10.2 - 0.45) * steep
    bead = replace(
        paths,
        xy=np.array([(edge + aside, 2.0), (edge + aside, 18.0)] * 2),
        plan=LayerPlan.from_tops(np.array([10.2, 10.4])),
    )
    below = PartBelow.of(Sections(plan, solid), bead.plan, 0.2)
    samples = sample_beads(bead)
    which = np.flatnonzero(samples.path == 1)

    assert (below.carries(samples, which, np.ones(len(which), np.int64)) == lies).all()


@needs_kernel
@pytest.mark.parametrize(("name", "style"), [("tee", "tree"), ("sphere", "columns")])
def test_the_kernel_finds_the_same_samples(name: str, style: str, monkeypatch: pytest.MonkeyPatch) -> None:
    paths = made(name, style)[1]
    samples = sample_beads(paths)
    found = {}
    for choice in ("required", "off"):
        monkeypatch.setenv(VARIABLE, choice)
        found[choice] = find_carried(samples, paths)

    assert 0.5 < found["off"].mean() < 1
    assert (found["required"] == found["off"]).all()


@needs_kernel
def test_wrong_samples_are_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(VARIABLE, "required")
    kernel = load_kernel()
    assert kernel
    xy, across = np.zeros(2, np.float32), np.ones((1, 2), np.float32)
    good = (xy, xy, across, np.zeros(2, np.int64)), np.array([0, 2]), b"\1", (9, 9)

    assert kernel.find_carried_samples(*good) == b"\1\1"
    wrong = [
        ((xy, xy[:1], across, good[0][3]), *good[1:]),
        ((xy, xy, across, np.array([0, 1])), *good[1:]),
        (good[0], np.array([0, 3]), *good[2:]),
        (good[0], np.array([1, 0]), *good[2:]),
        (*good[:3], (0, 9)),
    ]
    for arguments in wrong:
        with pytest.raises(ValueError, match=r"sample|grid"):
            kernel.find_carried_samples(*arguments)
