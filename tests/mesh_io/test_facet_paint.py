"""Painted facets: what a writer writes is read as it was, damaged paint is refused with the triangle's number."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from painting import Tree, digits_of, painted_pieces, trees

from printer_slicer.arrays import Float
from printer_slicer.errors import MeshError
from printer_slicer.mesh_io import LIMITS
from printer_slicer.mesh_io.facet_paint import BLOCKED, ENFORCED, MAX_DEPTH, split_painted_facets
from printer_slicer.values import replace

TRIANGLES: Float = np.random.default_rng(5).uniform(-9, 9, (12, 3, 3))


def _ordered(pieces: list[tuple[int, Float]]) -> list[list[float]]:
    return sorted([state, *corners.round(9).ravel().tolist()] for state, corners in pieces)


@given(st.dictionaries(st.integers(0, 11), trees(), max_size=6))
def test_paint_is_read_as_it_was_written(painted: dict[int, Tree]) -> None:
    digits = {facet: digits_of(tree) for facet, tree in painted.items()}
    pieces, state = split_painted_facets(digits, TRIANGLES, "part", LIMITS)
    wanted = [
        piece
        for facet, tree in painted.items()
        for piece in painted_pieces(tree, TRIANGLES[facet])
        if piece[0] in (ENFORCED, BLOCKED)
    ]

    assert _ordered(list(zip(state.tolist(), pieces, strict=True))) == _ordered(wanted)


@given(trees(), st.integers(0, 11))
def test_pieces_fill_their_facet(tree: Tree, facet: int) -> None:
    def paint_all(some: Tree) -> Tree:
        return 1 if isinstance(some, int) else (some[0], tuple(map(paint_all, some[1])))

    pieces, _ = split_painted_facets({facet: digits_of(paint_all(tree))}, TRIANGLES, "part", LIMITS)
    a, b, c = pieces.transpose(1, 0, 2)
    whole = TRIANGLES[facet]

    # All pieces face the way of their facet, so that their areas add up as vectors.
    area = np.cross(b - a, c - a)
    assert area.sum(axis=0) == pytest.approx(np.cross(whole[1] - whole[0], whole[2] - whole[0]))
    assert np.linalg.norm(area, axis=1).sum() == pytest.approx(np.linalg.norm(area.sum(axis=0)))


def _reason_for_refusal(digits: str) -> str:
    """The message about the paint of triangle 3; empty if it is read."""
    try:
        split_painted_facets({2: digits}, TRIANGLES, "part", LIMITS)
    except MeshError as error:
        return str(error)
    return ""


@given(st.one_of(st.text("0123456789ABCDEFabcdef", max_size=30), trees().map(digits_of)))
def test_any_digits_are_read_or_refused(digits: str) -> None:
    """What is read has exactly the digits of one tree, so that one more digit before it is too much."""
    reason = _reason_for_refusal(digits)
    longer = _reason_for_refusal(f"4{digits}")

    assert "part: triangle 3 has " in reason if reason else "has digits after the end" in longer


@given(trees(), st.data())
def test_cut_paint_is_refused(tree: Tree, data: st.DataObject) -> None:
    digits = digits_of((0, (tree, 1)))
    cut = digits[data.draw(st.integers(1, len(digits) - 1)) :]

    with pytest.raises(MeshError, match="part: triangle 8 has paint that ends early"):
        split_painted_facets({0: "4", 7: cut, 9: "8"}, TRIANGLES, "part", LIMITS)


@pytest.mark.parametrize("digits", ["", "4G", "4 ", "é", "D", "\u0394"])
def test_what_is_no_paint_is_refused(digits: str) -> None:
    with pytest.raises(MeshError, match="triangle 1 has invalid paint"):
        split_painted_facets({0: digits, 1: "4"}, TRIANGLES, "part", LIMITS)


def _nested(depth: int) -> Tree:
    tree: Tree = 1
    for _ in range(depth):
        tree = (0, (tree, 0))
    return tree


def test_facets_that_are_split_too_often_are_refused() -> None:
    pieces, _ = split_painted_facets({4: digits_of(_nested(MAX_DEPTH))}, TRIANGLES, "part", LIMITS)
    assert len(pieces) == 1

    with pytest.raises(MeshError, match=f"triangle 5 is split more than {MAX_DEPTH} times"):
        split_painted_facets({4: digits_of(_nested(MAX_DEPTH + 1))}, TRIANGLES, "part", LIMITS)


def test_the_number_of_digits_is_limited() -> None:
    few = replace(LIMITS, facets=10)

    with pytest.raises(MeshError, match="more than 30 digits"):
        split_painted_facets(dict.fromkeys(range(12), "481"), TRIANGLES, "part", few)
