"""Combinations of settings, and the rows that no other row beats."""

from __future__ import annotations

from itertools import product

import pytest
from hypothesis import given
from hypothesis import strategies as st

from printer_slicer.batching.matrix import (
    COMPARED,
    combine_choices,
    find_unbeaten_rows,
    name_choices,
    parse_choices,
)
from printer_slicer.errors import UsageError


def test_all_values_are_combined_with_the_last_setting_changing_fastest() -> None:
    choices = parse_choices(["quality=draft,fine", "tolerance = 0.02 , 0.05"])

    assert combine_choices(choices) == [
        {"quality": quality, "tolerance": tolerance}
        for quality, tolerance in product(["draft", "fine"], ["0.02", "0.05"])
    ]
    assert combine_choices({}) == [{}]


def test_a_list_in_brackets_is_one_value() -> None:
    assert parse_choices(["skin=[1,2],[3]"]) == {"skin": ("[1,2]", "[3]")}


@pytest.mark.parametrize(
    "texts", [["quality"], ["=a"], ["a=1,,2"], ["a=1,1"], ["a=1", "a=2"], ["a="], ["a=1,2,"]]
)
def test_texts_that_are_no_values_are_rejected(texts: list[str]) -> None:
    with pytest.raises(UsageError):
        parse_choices(texts)


def test_too_many_combinations_are_rejected_before_they_are_made() -> None:
    values = tuple(map(str, range(1000)))
    with pytest.raises(UsageError, match="1000000000 combinations"):
        combine_choices({"a": values, "b": values, "c": values})


def test_a_combination_is_a_safe_part_of_a_file_name() -> None:
    assert name_choices({"speeds.travel": "../x y", "quality": "fine"}) == "travel-.._x_y-quality-fine"


@given(st.lists(st.tuples(st.integers(0, 3), st.integers(0, 3), st.integers(0, 3)), max_size=12))
def test_a_row_is_beaten_exactly_if_another_is_nowhere_larger_and_somewhere_smaller(
    rows: list[tuple[int, int, int]],
) -> None:
    marks = find_unbeaten_rows([dict(zip(COMPARED, row, strict=True)) for row in rows])

    for row, is_best in zip(rows, marks, strict=True):
        beaten = [
            one for one in rows if all(a <= b for a, b in zip(one, row, strict=True)) and sum(one) < sum(row)
        ]
        assert is_best == (not beaten)
    assert any(marks) == bool(rows)
