"""Random bodies, random damage: never a crash, sections that keep the volume, and nothing lost without a word."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Final

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from printer_slicer.arrays import Float
from printer_slicer.errors import PartError
from printer_slicer.geometry.plane_sections import section_areas
from printer_slicer.healing import repair
from printer_slicer.model import LayerPlan, Mesh, Repairs, Sections
from printer_slicer.slicing import cut, list_section_repairs
from tests.parts import (
    box,
    box_with_hole,
    case_study,
    cone,
    joined,
    pyramid,
    sheared_prism,
    step_pyramid,
    two_boxes,
)
from tests.torture.bodies import ball, turned_body

CableNoise = Callable[[Float, np.random.Generator], Float]

HOLLOW: Final = joined([box(), Mesh(box((4, 4, 4), (3, 3, 3)).triangles[:, ::-1])], "hollow box")
BODIES: Final = [
    box(),
    ball(),
    box_with_hole(),
    case_study(),
    cone(),
    pyramid(),
    sheared_prism(),
    step_pyramid([20, 12, 5], [3, 2, 4]),
    two_boxes(),
    HOLLOW,
]
one_sided = st.sampled_from(range(len(BODIES) - 1))
seeds = st.integers(0, 2**32 - 1)


def in_file(mesh: Mesh) -> Mesh:
    """As a binary STL file holds it."""
    return Mesh(mesh.triangles.astype(np.float32).astype(np.float64), mesh.name)


def random_cuts(mesh: Mesh, rng: np.random.Generator, n: int = 7) -> Float:
    return np.asarray(np.sort(rng.uniform(0.02, 0.98, n)) * mesh.height)


def attempt(mesh: Mesh, cuts: Float) -> tuple[Sections, Repairs] | None:
    """The same, or None where the part is refused."""
    try:
        return sliced(mesh, cuts)
    except PartError:
        return None


def sliced(mesh: Mesh, cuts: Float) -> tuple[Sections, Repairs]:
    mended, repairs = repair(mesh)
    sections = cut(mended, LayerPlan(cuts + 1e-6, cuts), 0.0)
    return sections, Repairs((*repairs.done, *list_section_repairs(sections)))


def start(body: int, seed: int) -> tuple[Mesh, Float, np.random.Generator]:
    """A body turned at random, heights to cut it at, and what decides about the rest."""
    rng = np.random.default_rng(seed)
    mesh = in_file(turned_body(BODIES[body], seed) if rng.random() < 0.7 else BODIES[body])
    return mesh, random_cuts(mesh, rng), rng


def one_missing(triangles: Float, rng: np.random.Generator) -> Float:
    return np.delete(triangles, rng.integers(len(triangles)), axis=0)


def copied(triangles: Float, rng: np.random.Generator) -> Float:
    return np.concatenate([triangles, triangles[rng.random(len(triangles)) < rng.uniform(0, 0.5)]])


def copied_reversed(triangles: Float, rng: np.random.Generator) -> Float:
    return np.concatenate([triangles, triangles[rng.random(len(triangles)) < rng.uniform(0, 0.5), ::-1]])


def some_turned(triangles: Float, rng: np.random.Generator) -> Float:
    turn = rng.random(len(triangles)) < rng.uniform(0, 0.8)
    return np.where(turn[:, None, None], triangles[:, ::-1], triangles)


def all_turned(triangles: Float, rng: np.random.Generator) -> Float:
    return triangles[:, ::-1]


def rounded_apart(triangles: Float, rng: np.random.Generator) -> Float:
    return triangles + rng.uniform(-1e-5, 1e-5, triangles.shape)


def split_on_one_side(triangles: Float, rng: np.random.Generator) -> Float:
    """Some facets become two, whose neighbours know nothing of it."""
    chosen = rng.random(len(triangles)) < 0.2
    a, b, c = triangles[chosen].transpose(1, 0, 2)
    middle = a + rng.uniform(0.1, 0.9, (len(a), 1)) * (b - a)
    halves = np.concatenate([np.stack([a, middle, c], axis=1), np.stack([middle, b, c], axis=1)])
    return np.concatenate([triangles[~chosen], halves])


def with_needles(triangles: Float, rng: np.random.Generator) -> Float:
    """Facets without area along some edges."""
    chosen = triangles[rng.random(len(triangles)) < 0.3]
    a, b = chosen[:, 0], chosen[:, 1]
    return np.concatenate(
        [triangles, np.stack([a, (a + b) / 2, b], axis=1), np.stack([a, b, (a + b) / 2], axis=1)]
    )


HARMLESS: Final[Mapping[str, CableNoise]] = {
    "one facet missing": one_missing,
    "facets copied": copied,
    "facets copied and reversed": copied_reversed,
    "facets turned": some_turned,
    "all facets turned": all_turned,
    "facets rounded apart": rounded_apart,
    "edges split on one side": split_on_one_side,
    "facets without area": with_needles,
}


@pytest.mark.parametrize("damage", HARMLESS.values(), ids=HARMLESS.keys())
@given(body=one_sided, seed=seeds)
def test_damage_that_loses_nothing_does_not_change_the_sections(
    damage: CableNoise, body: int, seed: int
) -> None:
    whole, cuts, rng = start(body, seed)
    broken = damage(whole.triangles, rng)

    sections, _ = sliced(Mesh(broken[rng.permutation(len(broken))]), cuts)

    assert sections.solid.area() == pytest.approx(
        section_areas(whole.triangles, cuts), abs=1e-4 * float(np.prod(whole.size[:2]))
    )


@given(body=st.sampled_from(range(len(BODIES))), seed=seeds, share=st.floats(0, 0.5))
def test_any_damage_is_sliced_or_refused_and_what_is_off_was_told(body: int, seed: int, share: float) -> None:
    """Facets deleted, turned, copied and moved; areas that differ from those of the whole body come with a repair."""
    whole, cuts, rng = start(body, seed)
    n = whole.n_facets
    broken = whole.triangles[rng.random(n) >= share * rng.random()]
    broken = some_turned(broken, rng) if rng.random() < 0.5 else broken
    broken = copied(broken, rng) if rng.random() < 0.5 else broken
    broken = broken + (rng.uniform(-0.05, 0.05, broken.shape) if rng.random() < 0.2 else 0)

    result = attempt(Mesh(broken), cuts)
    if result is None:
        return
    sections, repairs = result
    off = np.abs(sections.solid.area() - section_areas(whole.triangles, cuts)).max()
    assert sections.solid.ring_area().size
    assert (sections.solid.area() >= 0).all()
    assert np.isfinite(sections.solid.xy).all()
    assert off <= 1e-3 * (float(np.prod(whole.size[:2])) + 1.0) or repairs.count


@given(seed=seeds, n=st.integers(1, 60))
def test_facets_anywhere_are_sliced_or_refused(seed: int, n: int) -> None:
    rng = np.random.default_rng(seed)
    corners = np.round(rng.uniform(0, 10, (n, 3, 3)), rng.integers(0, 3))
    corners[:, :, 2] -= corners[:, :, 2].min()

    result = attempt(Mesh(corners), np.array([0.5, 2.0, 5.0, 7.31]))

    assert result is None or np.isfinite(result[0].solid.area()).all()


@given(body=st.sampled_from(range(len(BODIES))), seed=seeds)
def test_the_order_of_facets_decides_nothing(body: int, seed: int) -> None:
    whole, cuts, rng = start(body, seed)
    broken = one_missing(copied(whole.triangles, rng), rng)
    broken = broken[rng.random(len(broken)) > 0.03]
    first, second = (
        attempt(Mesh(triangles), cuts) for triangles in (broken, broken[rng.permutation(len(broken))])
    )

    assert (first is None) == (second is None)
    if first and second:
        assert second[0].solid.area() == pytest.approx(first[0].solid.area(), abs=1e-3)


@given(body=st.sampled_from(range(len(BODIES))), seed=seeds)
def test_repaired_meshes_need_no_repair(body: int, seed: int) -> None:
    whole, _, rng = start(body, seed)
    mended, _ = repair(Mesh(one_missing(some_turned(copied(whole.triangles, rng), rng), rng)))

    again, repairs = repair(Mesh(mended.triangles))

    assert repairs.count == 0
    assert np.array_equal(again.triangles, mended.triangles)


@given(body=st.sampled_from(range(len(BODIES))), seed=seeds)
def test_a_sound_mesh_is_left_as_it_is(body: int, seed: int) -> None:
    whole, _, _ = start(body, seed)

    mended, repairs = repair(whole)

    assert mended is whole
    assert repairs.count == 0


@given(body=st.sampled_from(range(len(BODIES))), seed=seeds)
def test_the_sections_have_the_volume_of_the_mesh(body: int, seed: int) -> None:
    """Between two levels of corners the area is a quadratic in z, which two planes per slab integrate exactly."""
    whole, _, _ = start(body, seed)
    levels = np.unique(whole.triangles[:, :, 2])
    levels = levels[np.concatenate([[True], np.diff(levels) > 1e-4])]
    low, high = levels[:-1], levels[1:]
    middle, reach = (low + high) / 2, (high - low) / 2 / np.sqrt(3)
    cuts = np.column_stack([middle - reach, middle + reach]).ravel()

    sections, repairs = sliced(whole, cuts)

    assert repairs.count == 0
    assert sections.solid.area().reshape(-1, 2).mean(axis=1) @ (high - low) == pytest.approx(
        whole.volume, rel=5e-4
    )
