"""Columns of digits say what one formatted line after the other would say."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from printer_slicer.arrays import Float, Int
from printer_slicer.gcode import move_text
from printer_slicer.gcode.move_text import RowText, format_rows, plan_rows, split_by_layers
from printer_slicer.model import LayerPlan, Program
from printer_slicer.roles import Role
from printer_slicer.values import replace

PLAN = LayerPlan.from_tops(np.array([0.2]))


def program(
    xyz: Float,
    filament: Sequence[float],
    speed: Sequence[float] | float = 50.0,
    role: Sequence[int] | int = Role.INTERNAL_INFILL,
) -> Program:
    """Moves without layers, width and events."""
    count = len(xyz)
    return Program(
        PLAN,
        np.zeros(3),
        np.asarray(xyz, dtype=np.float64),
        np.asarray(filament, dtype=np.float64),
        np.broadcast_to(np.asarray(speed, dtype=np.float64), (count,)).copy(),
        np.zeros(count, np.int64),
        np.broadcast_to(np.asarray(role, dtype=np.int64), (count,)).copy(),
        np.full(count, 0.4),
        np.full(count, 0.2),
    )


def format_slabs(made: Program, *, relative: bool, full: Int | None = None) -> list[RowText]:
    """The rows of a program, some layers at a time."""
    rows, feed, texts = plan_rows(made, relative=relative, full=full), -1, []
    for moves in split_by_layers(made):
        texts.append(format_rows(rows, moves, feed))
        feed = texts[-1].feed
    return texts


def text(made: Program, *, relative: bool = True) -> list[str]:
    return b"".join(one.text for one in format_slabs(made, relative=relative)).decode("ascii").splitlines()


def plainly(made: Program, *, relative: bool) -> list[str]:
    """The same with Python's own number formatting, a line at a time."""

    def number(units: int, decimals: int) -> str:
        sign, digits = "-" * (units < 0), str(abs(units)).rjust(decimals + 1, "0")
        whole, part = digits[: len(digits) - decimals], digits[len(digits) - decimals :].rstrip("0")
        return f"{sign}{whole}.{part}" if part else f"{sign}{whole}"

    place: tuple[int, int, int] | None = None
    fed = total = 0
    feed, lines = -1, []
    for (x, y, z), speed, sum_fed, role in zip(
        made.xyz.tolist(),
        made.speed.tolist(),
        np.cumsum(made.filament).tolist(),
        made.role.tolist(),
        strict=True,
    ):
        there = round(x * 1000), round(y * 1000), round(z * 10000)
        total = round(sum_fed * 100000)
        if there == place and not (role == Role.TRAVEL and total != fed):
            continue
        words = [
            f"{letter}{number(value, decimals)}"
            for letter, value, decimals, axis in zip("XYZ", there, (3, 3, 4), range(3), strict=True)
            if place is None or place[axis] != value
        ]
        extrudes = total != fed
        if extrudes:
            words.append(f"E{number(total - fed if relative else total, 5)}")
        if max(round(speed * 60), 1) != feed:
            feed = max(round(speed * 60), 1)
            words.append(f"F{feed}")
        lines.append(" ".join(["G1" if extrudes else "G0", *words]))
        place, fed = there, total
    return lines


def test_a_move_says_where_how_much_and_how_fast() -> None:
    made = program(np.array([(1.5, 2.25, 0.2), (3, 2.25, 0.2)]), [0, 0.0507], 30)

    assert text(made) == ["G0 X1.5 Y2.25 Z0.2 F1800", "G1 X3 E0.0507"]


def test_words_that_do_not_change_are_left_out() -> None:
    made = program(
        np.array([(1, 1, 1), (2, 1, 1), (2, 5, 1), (2, 5, 1.2)]), [0, 0.1, 0.1, 0], [10, 20, 20, 20]
    )

    assert text(made) == ["G0 X1 Y1 Z1 F600", "G1 X2 E0.1 F1200", "G1 Y5 E0.1", "G0 Z1.2"]


def test_numbers_have_no_needless_zeros_and_no_exponent() -> None:
    made = program(
        np.array([(0, -0.001, 100), (1000, 0.1, 0.0001), (-2000.5, 10, 0.2)]), [0, 0.00001, 12345.6]
    )

    assert text(made) == [
        "G0 X0 Y-0.001 Z100 F3000",
        "G1 X1000 Y0.1 Z0.0001 E0.00001",
        "G1 X-2000.5 Y10 Z0.2 E12345.6",
    ]


def test_what_rounds_to_zero_has_no_sign() -> None:
    made = program(np.array([(-0.0001, 0.0001, -0.00001), (1, 1, 1)]), [0, 0])

    assert text(made)[0] == "G0 X0 Y0 Z0 F3000"


def test_retractions_stay_though_nothing_moves() -> None:
    made = program(np.array([(1, 1, 1)] * 3), [0.0, -0.8, 0.8], [10, 35, 25], Role.TRAVEL)

    assert text(made) == ["G0 X1 Y1 Z1 F600", "G1 E-0.8 F2100", "G1 E0.8 F1500"]


def test_absolute_extrusion_counts_from_zero() -> None:
    made = program(
        np.array([(0, 0, 1), (1, 0, 1), (2, 0, 1), (2, 0, 1)]), [0, 0.25, 0.5, -1], 10, [0, 9, 9, 0]
    )

    assert text(made, relative=False) == ["G0 X0 Y0 Z1 F600", "G1 X1 E0.25", "G1 X2 E0.75", "G1 E-0.25"]


def test_sums_of_relative_extrusion_are_exact() -> None:
    """A thousand times a third of the last decimal: rounding each by itself would lose all of it."""
    count = 3000
    xyz = np.column_stack([np.arange(count) * 0.01, np.zeros(count), np.ones(count)])
    lines = text(program(xyz, [1e-5 / 3] * count))

    fed = sum(float(match.group(1)) for line in lines if (match := re.search(r"E(\S+)", line)))
    assert fed == pytest.approx(0.01, abs=1.01e-5)


def test_the_filament_of_a_bead_too_short_to_show_goes_to_the_next_one() -> None:
    made = program(np.array([(0, 0, 1), (0.0001, 0, 1), (1, 0, 1)]), [0, 0.001, 0.03])

    assert text(made) == ["G0 X0 Y0 Z1 F3000", "G1 X1 E0.031"]


def test_a_travel_is_never_given_the_filament_of_a_bead_before_it() -> None:
    made = program(
        np.array([(0, 0, 1), (1, 0, 1), (1.0001, 0, 1), (5, 0, 1), (6, 0, 1)]),
        [0, 0.03, 0.001, 0, 0.03],
        50,
        [0, 9, 9, 0, 9],
    )

    lines = text(made)
    assert lines[2].startswith("G0 X5")
    assert "E" not in lines[2]


def test_rows_know_where_their_text_begins() -> None:
    made = program(
        np.array([(0, 0, 1), (0, 0, 1), (1, 0, 1), (1.0001, 0, 1), (2, 0, 1)]), [0, 0, 0.1, 0.1, 0.1]
    )
    (rows,) = format_slabs(made, relative=True)

    pieces = [rows.text[a:b] for a, b in zip(rows.start[:-1], rows.start[1:], strict=True)]
    assert pieces == [b"G0 X0 Y0 Z1 F3000\n", b"", b"G1 X1 E0.1\n", b"", b"G1 X2 E0.2\n"]


def test_a_speed_that_rounds_to_nothing_is_still_a_speed() -> None:
    assert text(program(np.array([(1, 1, 1)]), [0], 0.001)) == ["G0 X1 Y1 Z1 F1"]


def test_a_program_without_moves_is_empty_text() -> None:
    assert text(program(np.zeros((0, 3)), [])) == []


coordinates = st.floats(-300, 300).map(lambda v: round(v, 4))


@given(
    points=st.lists(st.tuples(coordinates, coordinates, st.floats(0, 300)), min_size=1, max_size=12),
    fed=st.lists(st.floats(-6, 20), min_size=12, max_size=12),
    speed=st.lists(st.floats(0.01, 500), min_size=12, max_size=12),
    role=st.lists(st.sampled_from([0, 3, 9]), min_size=12, max_size=12),
    relative=st.booleans(),
)
def test_rows_are_what_plain_formatting_gives(
    points: list[tuple[float, float, float]],
    fed: list[float],
    speed: list[float],
    role: list[int],
    relative: bool,
) -> None:
    count = len(points)
    made = program(np.array(points), fed[:count], speed[:count], role[:count])
    shown = np.rint(made.xyz * np.array([1e3, 1e3, 1e4]))
    # Who gets the filament of a bead too short to show is asked above.
    assume(not ((np.diff(shown, axis=0) == 0).all(axis=1) & (made.role[1:] != Role.TRAVEL)).any())

    assert text(made, relative=relative) == plainly(made, relative=relative)


def test_many_rows_are_put_together_in_order() -> None:
    """More than are made at once."""
    rng = np.random.default_rng(0)
    count = 20_000
    made = program(
        rng.uniform(0, 200, (count, 3)),
        rng.uniform(0, 1, count).tolist(),
        rng.uniform(5, 90, count).tolist(),
        rng.integers(0, 10, count).tolist(),
    )

    for relative in (True, False):
        assert text(made, relative=relative) == plainly(made, relative=relative)


@given(
    points=st.lists(st.tuples(*[st.integers(0, 2).map(float)] * 3), min_size=1, max_size=30),
    fed=st.lists(st.sampled_from([0.0, 0.0, 0.000004, 0.1, -0.5]), min_size=30, max_size=30),
    role=st.lists(st.sampled_from([0, 9]), min_size=30, max_size=30),
    climbs=st.lists(st.booleans(), min_size=30, max_size=30),
    arcs=st.lists(st.integers(0, 2), min_size=30, max_size=30),
    full=st.sets(st.integers(0, 30)),
    relative=st.booleans(),
)
def test_rows_do_not_depend_on_how_many_are_formatted_at_once(
    points: list[tuple[float, float, float]],
    fed: list[float],
    role: list[int],
    climbs: list[bool],
    arcs: list[int],
    full: set[int],
    relative: bool,
) -> None:
    count = len(points)
    flat = program(np.array(points), fed[:count], 50.0, role[:count])
    centre = np.array([(np.nan, np.nan), (0.5, 0.5), (1.5, 1.5)])[arcs[:count]]
    layer = np.cumsum(climbs[:count])
    plan = LayerPlan.from_tops(0.2 * np.arange(1, count + 2))
    made = replace(flat, plan=plan, layer=layer, centre=centre)
    labelled = np.array(sorted(full), np.int64)

    whole = format_slabs(made, relative=relative, full=labelled)
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(move_text, "_BATCH", 2)
        some = format_slabs(made, relative=relative, full=labelled)

    assert len(whole) == 1
    assert len(some) >= len(set(layer.tolist())) / 2
    assert b"".join(one.text for one in some) == whole[0].text
