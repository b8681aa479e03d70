"""Equal keys, links, near points, chains: against numpy and scipy."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from printer_slicer.arrays import Int
from printer_slicer.geometry.connectivity import (
    count_chain_steps,
    find_chain_ends,
    find_cycles,
    group_close_points,
    label_components,
    weld_keys,
)
from printer_slicer.geometry.facet_topology import corner_keys, may_have_neighbours
from tests.effort import few_of

seeds = st.integers(0, 2**32 - 1)


def same_partition(one: Int, other: Int) -> bool:
    """Whether two numberings put the same items together."""
    pairs = len(np.unique(np.stack([one, other]), axis=1).T)
    return len(np.unique(one)) == len(np.unique(other)) == pairs


SIGNS = [np.array([x, y, z]) for x in (1, -1) for y in (1, -1) for z in (1, -1)]


@given(seed=seeds, n=st.integers(1, 3000), kinds=st.integers(1, 5000), shift=st.integers(0, 60))
def test_equal_keys_get_one_number(seed: int, n: int, kinds: int, shift: int) -> None:
    """Also keys that differ only in their lowest or highest bits."""
    key = np.random.default_rng(seed).integers(0, kinds, n).astype(np.uint64) << np.uint64(shift)

    number, firsts = weld_keys(key)

    assert same_partition(number, np.unique(key, return_inverse=True)[1])
    assert number[firsts].tolist() == list(range(len(firsts)))


@pytest.mark.parametrize("n_different", [3, 1000, 500_000])
def test_many_keys_are_welded_wherever_their_equals_stand(n_different: int) -> None:
    """More than are welded at once, near their equals and far from them."""
    rng = np.random.default_rng(n_different)
    key = rng.integers(0, 2**63, n_different).astype(np.uint64)[rng.integers(0, n_different, 400_000)]
    number, firsts = weld_keys(key)

    assert len(firsts) == len(np.unique(key))
    assert np.array_equal(key[firsts][number], key)
    assert np.array_equal(number[firsts], np.arange(len(firsts)))


def test_no_keys_have_no_numbers() -> None:
    number, firsts = weld_keys(np.zeros(0, np.uint64))

    assert number.size == firsts.size == 0


@given(seed=seeds, n=st.integers(1, 400), links=st.integers(0, 600), k=st.integers(2, 3))
def test_linked_items_are_the_connected_components_of_a_graph(seed: int, n: int, links: int, k: int) -> None:
    members = np.random.default_rng(seed).integers(0, n, (k, links))
    graph = coo_array(
        (np.ones(links * (k - 1)), (np.tile(members[0], k - 1), members[1:].ravel())), shape=(n, n)
    )

    group = label_components(members, n)

    assert same_partition(group, connected_components(graph, directed=False)[1])
    assert sorted(set(group.tolist())) == list(range(len(set(group.tolist()))))


def test_a_long_chain_is_one_group() -> None:
    chain = np.random.default_rng(2).permutation(100_000)

    assert label_components(np.stack([chain[1:], chain[:-1]]), len(chain)).max() == 0


@given(seed=seeds, n=st.integers(2, 60), reach=st.floats(1e-3, 0.5))
def test_points_within_reach_are_together_and_far_ones_are_not(seed: int, n: int, reach: float) -> None:
    points = np.random.default_rng(seed).uniform(-2, 2, (n, 3))
    apart = np.abs(points[:, None] - points[None]).max(axis=2)

    group = group_close_points(points, reach)

    exactly = connected_components(coo_array(apart <= reach), directed=False)[1]
    assert ((group[:, None] == group[None]) == (exactly[:, None] == exactly[None])).all()


@given(seed=seeds, n=st.integers(1, 200))
def test_cycles_number_the_steps_from_the_lowest_item(seed: int, n: int) -> None:
    following = np.random.default_rng(seed).permutation(n)

    lowest, steps = find_cycles(following)

    at = lowest.copy()
    for step in range(n):
        assert (at[steps == step] == np.flatnonzero(steps == step)).all()
        at = following[at]
    assert (lowest <= np.arange(n)).all()
    assert pytest.approx(steps[lowest]) == 0


@pytest.mark.parametrize("steps", few_of([1, 16, 4, 32], 2))
def test_corners_of_symmetric_parts_have_keys_of_their_own(steps: int) -> None:
    """Mirrored, and a few 32-bit steps apart, as rounding leaves them."""
    rng = np.random.default_rng(steps)
    single = rng.uniform(-20, 20, (20_000, 3)).astype(np.float32)
    near = single.copy()
    for _ in range(steps):
        near = np.nextafter(near, np.float32(100) * np.sign(near))
    mixed = np.where(rng.random(single.shape) < 0.5, single, near)
    points = (
        np.concatenate([part * sign for part in (single, near, mixed) for sign in SIGNS]).astype(float) + 0.0
    )
    unique = np.unique(points, axis=0)

    assert len(np.unique(corner_keys(unique))) == len(unique)


@given(seed=seeds, n=st.integers(0, 300), kind=st.sampled_from([np.int32, np.int64]))
def test_chains_end_where_going_on_leads_to_in_as_many_steps(seed: int, n: int, kind: type) -> None:
    rng = np.random.default_rng(seed)
    order = rng.permutation(n)
    following = np.zeros(n, kind)
    following[order] = order[np.maximum(np.arange(n) - rng.integers(0, 4, n), 0)]

    end, steps = count_chain_steps(following)

    here, counted = np.arange(n), np.zeros(n, np.int64)
    for _ in range(n):
        counted += following[here] != here
        here = following[here]
    assert end.tolist() == find_chain_ends(following).tolist() == here.tolist()
    assert steps.tolist() == counted.tolist()
    assert end.dtype == steps.dtype == following.dtype


@given(seed=seeds, n=st.integers(0, 200), room=st.sampled_from([1, 30, 1000]), flat=st.booleans())
def test_points_with_others_around_are_never_missed(seed: int, n: int, room: int, flat: bool) -> None:
    rng = np.random.default_rng(seed)
    points = rng.uniform(-room, room, (n, 2 if flat else 3))
    plane = rng.integers(0, 3, n)

    found = may_have_neighbours(points, 0.7, plane=plane if flat else None, shift=rng.uniform())

    gap = np.abs(points[:, None] - points[None]).max(axis=2)
    gap[plane[:, None] != plane[None] if flat else np.zeros((n, n), np.bool_)] = np.inf
    np.fill_diagonal(gap, np.inf)
    assert found[(gap <= 0.7).any(axis=1)].all()


def test_points_that_are_alone_are_mostly_known_to_be() -> None:
    points = np.random.default_rng(7).uniform(-1e5, 1e5, (2000, 3))

    assert may_have_neighbours(points, 0.1).mean() < 0.25
    assert may_have_neighbours(points[:, :2] * 1e-3, 0.1, plane=np.arange(2000)).mean() < 0.25
