"""Functions of the kernel for height maps: the same results as without it."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from printer_slicer.inspection.deposition.height_map import HeightMap, LevelMoves, MovePieces, split_moves
from printer_slicer.inspection.deposition.marks import Marks
from printer_slicer.inspection.deposition.unsupported import add_to_height_map, find_unsupported_pieces
from printer_slicer.kernel import VARIABLE, load_kernel
from tests.kernels import needs_kernel

BOX = ((0.0, 0.0), (30.0, 20.0))
SUPPORT = 1

coordinate = st.sampled_from([-3.0, 0.0, 2.05, 4.0, 9.0, 9.1, 14.0, 20.0, 33.0]) | st.floats(-5, 35)
volume_per_mm = st.sampled_from([0.02, 0.08, 0.3])
# Where each move ends, whether it starts where the previous one ended, its extrusion, and its role.
move = st.tuples(coordinate, coordinate, st.booleans(), volume_per_mm, st.integers(0, 1))
levels = st.lists(
    st.tuples(st.sampled_from([0.2, 0.25, 0.6]), st.lists(move, min_size=1, max_size=12)), max_size=4
)


def moves_at(z: float, rows: list[tuple[float, float, bool, float, int]]) -> LevelMoves:
    """Extruding moves at one height."""
    end = np.array([(x, y, z) for x, y, *_ in rows])
    joins = np.array([joins for _, _, joins, _, _ in rows])
    start = np.where(joins[:, None], np.concatenate([[(1.0, 1.0, z)], end[:-1]]), end - (4.0, 1.5, 0.0))
    length = np.hypot(*(end - start)[:, :2].T)
    volume, role = (np.array(column) for column in list(zip(*rows, strict=True))[3:])
    n = len(rows)
    return LevelMoves(np.arange(n) + 1, start, end, volume * length, length, np.ones(n, np.bool_), role)


def run(kernel: str, stack: list[LevelMoves], marks: Marks) -> list[object]:
    """Print all levels; return everything that was found, and the height map at the end."""
    with pytest.MonkeyPatch.context() as patched:
        patched.setenv(VARIABLE, kernel)
        height_map, found = HeightMap(*BOX), []
        for moves in stack:
            pieces = split_moves(moves.start, moves.end)
            cell = height_map.cells(pieces)
            found += [getattr(pieces, name).tolist() for name in MovePieces.__annotations__]
            found.append(find_unsupported_pieces(height_map, moves, pieces, cell, marks).tolist())
            add_to_height_map(height_map, moves, pieces, cell, marks)
        top, removable, _ = height_map._kernel_map()
    return [*found, top.tolist(), removable.tolist(), height_map.highest]


def marks_with(*, roles: bool) -> Marks:
    named = np.arange(2 if roles else 0)
    return Marks(roles=named + 1, names=named, removable=frozenset({SUPPORT}))


@needs_kernel
@given(levels, st.booleans())
def test_unsupported_pieces_and_height_maps_are_the_same(
    given_levels: list[tuple[float, list[tuple[float, float, bool, float, int]]]], roles: bool
) -> None:
    """Also of extrusions beside the plate, of supports, and of levels with gaps between them."""
    heights = np.cumsum([height for height, _ in given_levels]).tolist()
    stack = [moves_at(z, rows) for z, (_, rows) in zip(heights, given_levels, strict=True)]
    marks = marks_with(roles=roles)

    assert run("required", stack, marks) == run("off", stack, marks)


@needs_kernel
@pytest.mark.parametrize(("chord", "found"), [("straight", False), ("detour", True)])
def test_bridges_and_overhangs_are_the_same(chord: str, *, found: bool) -> None:
    """Two posts 20 mm apart: a straight line between them is a bridge, the middle of a detour is unsupported."""
    x = [2.0, 4.0, 24.0, 26.0]
    y = [5.0, 5.0, 5.0, 5.0]
    posts = [(x[0], 5.0, False, 0.08, 0), (x[1], 5.0, True, 0.08, 0), (x[2], 5.0, False, 0.08, 0)]
    posts.append((x[3], 5.0, True, 0.08, 0))
    if chord == "detour":
        x, y = [2.0, 4.0, 14.0, 24.0, 26.0], [5.0, 5.0, 17.0, 5.0, 5.0]
    line = [(a, b, i > 0, 0.08, 0) for i, (a, b) in enumerate(zip(x, y, strict=True))]
    stack = [moves_at(0.2, posts), moves_at(0.4, line)]
    one, other = (run(kernel, stack, marks_with(roles=True)) for kernel in ("required", "off"))

    assert one == other
    assert bool(one[-4]) == found


@needs_kernel
def test_moves_straight_down_are_split_alike() -> None:
    start, end = np.array([[1.0, 2.0, 5.0], [1.0, 2.0, 3.0]]), np.array([[1.0, 2.0, 3.0], [1.0, 9.7, 4.0]])
    pieces = []
    for kernel in ("required", "off"):
        with pytest.MonkeyPatch.context() as patched:
            patched.setenv(VARIABLE, kernel)
            pieces.append(split_moves(start, end))

    assert pieces[0].z[0] == 3.0
    for name in MovePieces.__annotations__:
        assert getattr(pieces[0], name).tolist() == getattr(pieces[1], name).tolist()


def arguments() -> tuple[list, list, list]:
    """A height map with 2 by 2 cells, one move and its only piece, as arguments of the kernel."""
    height_map = [np.zeros(5, np.float32), np.zeros(0, np.bool_), 2]
    moves = [np.zeros(3), np.zeros(3), np.zeros(1), np.zeros(1), np.zeros(1, np.bool_)]
    pieces = [np.zeros(1, np.int64), *(np.zeros(1) for _ in range(4)), np.zeros(1, np.int64)]
    return height_map, moves, pieces


@needs_kernel
@pytest.mark.parametrize(
    ("group", "at", "value", "message"),
    [
        (0, 0, np.zeros(0, np.float32), "no such rows"),
        (0, 0, np.zeros(6, np.float32), "no such rows"),
        (0, 2, 0, "no such rows"),
        (0, 1, np.zeros(4, np.bool_), "do not match"),
        (1, 0, np.zeros(2), "moves do not match"),
        (1, 2, np.zeros(2), "moves do not match"),
        (1, 4, np.zeros(2, np.bool_), "moves do not match"),
        (2, 1, np.zeros(2), "pieces do not match"),
        (2, 0, np.ones(1, np.int64), "of no move"),
        (2, 0, np.full(1, -1), "of no move"),
        (2, 5, np.full(1, 5), "in no cell"),
        (2, 5, np.full(1, -1), "in no cell"),
    ],
)
def test_arrays_that_do_not_match_are_an_error(
    group: int, at: int, value: object, message: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(VARIABLE, "required")
    kernel = load_kernel()
    assert kernel
    given_arguments = arguments()
    given_arguments[group][at] = value
    height_map, moves, pieces = (tuple(group) for group in given_arguments)

    with pytest.raises(ValueError, match=message):
        kernel.find_unsupported_pieces(height_map, moves, pieces, 0.3, 0.0)
    with pytest.raises(ValueError, match=message):
        kernel.raise_height_map(height_map, moves, pieces, 0.0, 0.0)


@needs_kernel
def test_other_wrong_input_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(VARIABLE, "required")
    kernel = load_kernel()
    assert kernel
    height_map, moves, pieces = arguments()
    moves[4] = np.ones(1, np.bool_)

    with pytest.raises(ValueError, match="can be removable"):
        kernel.raise_height_map(tuple(height_map), tuple(moves), tuple(pieces), 0.0, 0.0)
    with pytest.raises(ValueError, match="do not match"):
        kernel.split_moves(np.zeros(3), np.zeros(6))
    with pytest.raises(ValueError, match="too long"):
        kernel.split_moves(np.zeros(3), np.full(3, np.inf))
    height_map[0].flags.writeable = False
    with pytest.raises((ValueError, BufferError), match=r"read-only|writable"):
        kernel.raise_height_map(tuple(height_map), tuple(moves), tuple(pieces), 0.0, 0.0)
