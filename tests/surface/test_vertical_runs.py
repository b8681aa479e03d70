"""Bounds of vertical runs against the same worked out place by place."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise
from typing import Final

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from printer_slicer.arrays import Float, Int
from printer_slicer.model import Mesh
from printer_slicer.surface.contacts import Contacts, find_contacts
from printer_slicer.surface.envelope import Envelope
from printer_slicer.surface.range_maximum import compute_range_maxima
from printer_slicer.surface.vertical_runs import bound_runs, bound_runs_by_length, find_main_contact
from tests.parts import box, cone, pyramid, sheared_prism, sphere, step_pyramid

PARTS: Final[Mapping[str, Mesh]] = {
    "box": box((3, 2, 1)),
    "pyramid": pyramid(4, 2),
    "steps": step_pyramid([4, 2, 1], [0.31, 0.42, 0.27]),
    "sphere": sphere(1.5),
    "leaning": sheared_prism(2, 2, 1.5),
    "cone": cone(1, 2, 7),
}


def contacts_of(low: Float, high: Float, rise: Float) -> Contacts:
    order = np.argsort(low, kind="stable")
    return Contacts(low[order], high[order], rise[order], np.arange(len(low)))


def some_contacts(seed: int, lattice: float = 0.0) -> Contacts:
    """Random ones, a third of them flat; on multiples of `lattice` if that is given."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(0, 12))
    low = rng.uniform(-0.2, 2.0, n)
    high = low + rng.choice([0.0, 0.03, 0.4, 2.0], n) * rng.random(n)
    if lattice:
        low, high = (np.round(z / lattice) * lattice for z in (low, high))
    return contacts_of(low, np.maximum(low, high), rng.uniform(0.05, 1, n))


def slow_bound(contacts: Contacts, start: float, end: float) -> float:
    """The integral from start to end of the steepest rise met so far, from one height to the next."""
    heights = np.unique(np.concatenate([[start, end], contacts.low, contacts.high]).clip(start, end))
    total = 0.0
    for below, above in pairwise(heights.tolist()):
        met = [
            float(rise)
            for low, high, rise in zip(contacts.low, contacts.high, contacts.rise, strict=True)
            if low <= below and (high > start or low >= start)
        ]
        total += max(met, default=0.0) * float(above - below)
    return total


def runs_over(seed: int, n: int, top: float = 2.2) -> tuple[Float, Float]:
    """Starts and ends of n runs that do not overlap; some touch, some are empty."""
    rng = np.random.default_rng(seed)
    borders = np.sort(rng.uniform(-0.1, top, 2 * n)).reshape(n, 2)
    if rng.random() < 0.3:
        borders[1:, 0] = borders[:-1, 1]
    empty = rng.random(n) < 0.1
    borders[empty, 1] = borders[empty, 0]
    return borders[:, 0], borders[:, 1]


@given(st.integers(0, 10**6), st.integers(1, 8), st.sampled_from([0.0, 0.1]))
def test_the_bound_of_a_run_is_the_integral_of_the_steepest_rise_so_far(
    seed: int, n: int, lattice: float
) -> None:
    contacts = some_contacts(seed, lattice)
    start, end = runs_over(seed + 1, n)
    if lattice:
        start, end = np.round(start, 1), np.round(end, 1)
    expected = [slow_bound(contacts, a, b) for a, b in zip(start.tolist(), end.tolist(), strict=True)]

    assert bound_runs(contacts, start, end) == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize("name", PARTS)
def test_the_bounds_of_parts_are_that_integral_too(name: str) -> None:
    contacts, _ = find_contacts(PARTS[name])
    for seed, seen in enumerate((contacts, contacts.mirror())):
        start, end = runs_over(seed, 12)
        if seed:
            start, end = -end[::-1], -start[::-1]
        expected = [slow_bound(seen, a, b) for a, b in zip(start.tolist(), end.tolist(), strict=True)]
        assert bound_runs(seen, start, end) == pytest.approx(expected, abs=1e-12)


def test_no_runs_and_no_contacts_have_no_bounds() -> None:
    nothing = np.zeros(0)

    assert bound_runs(some_contacts(3), nothing, nothing).shape == (0,)
    assert bound_runs(contacts_of(nothing, nothing, nothing), np.array([0.0]), np.array([1.0])).tolist() == [
        0
    ]
    assert find_main_contact(contacts_of(nothing, nothing, nothing), 0.0, 1.0) == -1


@given(st.integers(0, 10**6))
def test_no_bound_is_longer_than_its_run_and_longer_runs_have_no_smaller_ones(seed: int) -> None:
    contacts = some_contacts(seed)
    start = np.array([0.4])
    bounds = [float(bound_runs(contacts, start, np.array([end]))[0]) for end in (0.4, 0.6, 1.0, 1.9)]

    assert bounds[0] == 0
    assert bounds == sorted(bounds)
    assert bounds[-1] <= 1.5 + 1e-12


def test_what_ends_where_a_run_begins_does_not_count_and_what_begins_there_does() -> None:
    below = contacts_of(np.array([0.0]), np.array([1.0]), np.array([0.7]))
    above = contacts_of(np.array([1.0]), np.array([2.0]), np.array([0.7]))
    flat = contacts_of(np.array([1.0]), np.array([1.0]), np.array([1.0]))
    start, end = np.array([1.0]), np.array([1.5])

    assert bound_runs(below, start, end)[0] == 0
    assert bound_runs(above, start, end)[0] == pytest.approx(0.35)
    assert bound_runs(flat, start, end)[0] == pytest.approx(0.5)
    assert bound_runs(flat, np.array([0.5]), np.array([1.0]))[0] == 0


@given(st.integers(0, 10**6))
def test_the_steepest_contact_of_a_run_is_one_that_weighs_most(seed: int) -> None:
    contacts, start, end = some_contacts(seed), 0.3, 1.4
    weight = np.array(
        [slow_bound(contacts_of(*one), start, end) for one in single(contacts)] or [0.0], np.float64
    )
    place = find_main_contact(contacts, start, end)

    assert (place == -1) == (weight.max() == 0)
    if place >= 0:
        assert weight[place] == pytest.approx(weight.max())


def single(contacts: Contacts) -> list[tuple[Float, Float, Float]]:
    """Each contact alone."""
    return [
        (contacts.low[i : i + 1], contacts.high[i : i + 1], contacts.rise[i : i + 1])
        for i in range(len(contacts.low))
    ]


@given(st.integers(0, 10**6), st.sampled_from([0.00125, 0.005, 0.02]), st.sampled_from([0.0, -0.13]))
def test_tables_lie_over_the_bounds_and_by_less_than_a_cell(seed: int, cell: float, bottom: float) -> None:
    contacts = some_contacts(seed)
    n_cells = round(2.3 / cell)
    length = np.array([3, 4, 5, 24])
    table = np.stack(list(bound_runs_by_length(contacts, cell, n_cells, length.tolist(), bottom=bottom)))
    place = np.random.default_rng(seed).integers(0, n_cells - 24, 20)
    for row, cells in enumerate(length.tolist()):
        exact = [
            slow_bound(contacts, bottom + cell * at, bottom + cell * (at + cells)) for at in place.tolist()
        ]
        more = table[row, place] - np.array(exact)
        assert (more >= -1e-5).all()
        assert (more <= cell + 1e-9).all()


@given(st.integers(0, 10**6), st.sampled_from([0.005, 0.02]))
def test_tables_are_exact_where_no_two_contacts_begin_in_a_cell(seed: int, cell: float) -> None:
    rng = np.random.default_rng(seed)
    low = (np.flatnonzero(rng.random(60) < 0.15) + rng.uniform(0.1, 0.9)) * cell
    high = low + rng.choice([0.0, 0.3, 4.0, 20.0], len(low)) * cell
    contacts = contacts_of(low, high, rng.uniform(0.05, 1, len(low)))
    length = [3, 8, 24]
    table = list(bound_runs_by_length(contacts, cell, 80, length))

    for row, cells in zip(table, length, strict=True):
        exact = [slow_bound(contacts, cell * at, cell * (at + cells)) for at in range(80 - cells)]
        assert row[: 80 - cells] == pytest.approx(exact, abs=1e-9)


@given(st.integers(0, 10**6), st.sampled_from([1e-7, 1e-6, 4e-6]))
def test_the_rounding_of_files_changes_neither_tables_nor_what_they_promise(seed: int, noise: float) -> None:
    """Contacts that should lie on borders of cells lie a little beside them."""
    cell, n_cells = 0.005, 400
    exact = some_contacts(seed, lattice=0.01)
    rng = np.random.default_rng(seed)
    off = np.array([rng.uniform(-noise, noise) for _ in exact.low])
    rounded = contacts_of(exact.low + off, exact.high + off, exact.rise)
    expected, table = (
        np.stack(list(bound_runs_by_length(one, cell, n_cells, [16, 24]))) for one in (exact, rounded)
    )

    assert table == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize("cell", [0.00125, 0.005, 0.02, 0.05])
@pytest.mark.parametrize("share", [-0.0009, -0.0005, 0.0005, 0.0009])
def test_a_contact_a_hair_beside_a_border_takes_no_more_than_rounding_from_a_bound(
    cell: float, share: float
) -> None:
    """One that begins under a border within the rounding of files may count from the border; steps may be coarse."""
    begin = (20 + share) * cell
    contacts = contacts_of(np.array([begin]), np.array([begin]), np.array([1.0]))
    length = np.array([4, 8])
    table = np.stack(list(bound_runs_by_length(contacts, cell, 40, length.tolist())))
    for row, cells in enumerate(length.tolist()):
        for at in range(10, 21):
            exact = slow_bound(contacts, at * cell, (at + cells) * cell)
            assert table[row, at] >= exact - 1e-5


def test_runs_that_leave_the_cells_end_with_the_last_one() -> None:
    contacts = contacts_of(np.array([0.0]), np.array([1.0]), np.array([0.5]))
    table = list(bound_runs_by_length(contacts, 0.1, 10, [2, 5]))

    assert table[1] == pytest.approx(0.5 * 0.1 * np.array([5, 5, 5, 5, 5, 5, 4, 3, 2, 1, 0]))
    assert table[0] == pytest.approx(0.5 * 0.1 * np.array([2] * 9 + [1, 0]))


@given(st.integers(0, 10**6), st.integers(1, 400))
def test_what_lies_under_the_envelope_adds_nothing_to_any_run(seed: int, n: int) -> None:
    rng = np.random.default_rng(seed)
    low = rng.uniform(0, 1, n)
    high = np.minimum(low + rng.choice([0.0, 0.02, 0.07, 0.5], n) * rng.random(n), 1.0)
    every = contacts_of(low, high, rng.uniform(0.05, 1, n))
    envelope = Envelope.between_heights(0.0, 1.0)
    for some in np.array_split(np.arange(n), 3):
        envelope.add(every.low[some], every.high[some], every.rise[some])
    shown = envelope.is_uncovered(every.low, every.high, every.rise)
    few = Contacts(*(getattr(every, name)[shown] for name in ("low", "high", "rise", "source")))
    start = np.sort(rng.uniform(0, 0.9, 30))
    end = np.minimum(start + rng.uniform(0, 0.3, 30), np.append(start[1:], 1.0))

    assert shown.sum() < n or n < 100
    assert bound_runs(few, start, end) == pytest.approx(bound_runs(every, start, end), abs=1e-12)
    assert bound_runs(few.mirror(), -end[::-1], -start[::-1]) == pytest.approx(
        bound_runs(every.mirror(), -end[::-1], -start[::-1]), abs=1e-12
    )


@given(st.integers(0, 10**6), st.integers(1, 40))
def test_painting_gives_every_place_the_largest_value_over_it(seed: int, n: int) -> None:
    rng = np.random.default_rng(seed)
    count = int(rng.integers(0, 9))
    first = rng.integers(0, n, count)
    last = np.minimum(first + rng.integers(0, n, count), n - 1)
    value = rng.random(count) * rng.integers(0, 2, count)

    assert compute_range_maxima(first, last, value, n) == pytest.approx(
        slowly_painted(first, last, value, n), abs=0
    )


def slowly_painted(first: Int, last: Int, value: Float, n: int) -> Float:
    result = np.zeros(n)
    for a, b, v in zip(first.tolist(), last.tolist(), value.tolist(), strict=True):
        result[a : b + 1] = np.maximum(result[a : b + 1], v)
    return result
