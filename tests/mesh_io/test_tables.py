"""Tables whose rows differ in length: read as if row by row, and in time and memory that grow with their bytes."""

from __future__ import annotations

import struct
import tracemalloc

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from printer_slicer.mesh_io.tables import BinaryBody, Element, Property, TableBody, TextBody, read_table

LENGTHS = {
    "none": [0],
    "triangles and quads": [3, 4, 4, 3],
    "few long ones": [3] * 40 + [70_000],
    "all": list(range(200)),
    "mostly none": [0] * 999 + [3],
}
CORNERS = Property("corners", "u4", "u4")
ROW = (Property("colour", "u1"), Property("marks", "i2", "u1"), CORNERS, Property("weight", "f4"))

Row = tuple[int, list[int], list[int], float]


def body_of(rows: list[Row], kind: str) -> TableBody:
    """The rows as a body, `ascii` or an order of bytes."""
    if kind == "ascii":
        lists = (
            (colour, len(marks), *marks, len(corners), *corners, weight)
            for colour, marks, corners, weight in rows
        )
        return TextBody(" ".join(str(number) for row in lists for number in row).encode())
    packed = (
        struct.pack(
            f"{kind}BB{len(marks)}hI{len(corners)}If",
            colour,
            len(marks),
            *marks,
            len(corners),
            *corners,
            weight,
        )
        for colour, marks, corners, weight in rows
    )
    return BinaryBody(b"".join(packed), kind)


def rows_of(lengths: list[int], number: int) -> list[Row]:
    """Rows with lists of these lengths over and over."""
    sizes = [lengths[nth % len(lengths)] for nth in range(number)]
    return [
        (size % 200, [size % 7] * (nth % 3), list(range(size)), nth * 0.5) for nth, size in enumerate(sizes)
    ]


def expect_rows(body: TableBody, rows: list[Row]) -> None:
    columns, end = read_table(body, Element("face", len(rows), ROW), 0, {"corners", "marks", "weight"})

    assert end == body.end
    assert set(columns) == {"corners", "marks", "weight"}
    lists = {"marks": [marks for _, marks, _, _ in rows], "corners": [corners for _, _, corners, _ in rows]}
    for name, wanted in lists.items():
        assert columns[name].counts.tolist() == [len(one) for one in wanted]
        assert columns[name].values.tolist() == [number for one in wanted for number in one]
    assert columns["weight"].values.tolist() == [row[3] for row in rows]


@pytest.mark.parametrize("kind", ["ascii", "<", ">"])
@pytest.mark.parametrize("lengths", LENGTHS.values(), ids=list(LENGTHS))
def test_rows_of_different_lengths_are_read_whole(lengths: list[int], kind: str) -> None:
    rows = rows_of(lengths, 5_000 if max(lengths) < 1000 else 90)

    expect_rows(body_of(rows, kind), rows)


@given(
    rows=st.lists(
        st.tuples(
            st.integers(0, 255),
            st.lists(st.integers(-9, 9), max_size=4),
            st.lists(st.integers(0, 1 << 30), max_size=9),
            st.integers(0, 99).map(float),
        ),
        min_size=1,
        max_size=30,
    ),
    kind=st.sampled_from(["ascii", "<", ">"]),
)
def test_any_rows_are_read_whole_and_not_beyond_the_end(rows: list[Row], kind: str) -> None:
    body = body_of(rows, kind)
    expect_rows(body, rows)

    with pytest.raises(ValueError, match=r"is damaged|bytes or words"):
        read_table(body, Element("face", len(rows) + 1, ROW), 0, {"corners"})


class CountedGraph(BinaryBody):
    """Bytes that count how often they are asked."""

    asked = 0

    def read_integer(self, at: int, kind: str) -> int:
        self.asked += 1
        return super().read_integer(at, kind)


@pytest.mark.parametrize("lengths", LENGTHS.values(), ids=list(LENGTHS))
def test_rows_are_not_asked_for_one_by_one(lengths: list[int]) -> None:
    number = 400_000 if max(lengths) < 100 else 4_000
    sizes = np.resize(np.array(lengths), number)
    sizes[-1] = 3
    data = bytearray()
    for size in sizes.tolist():
        data += b"%c" % min(size, 255) + bytes(4 * min(size, 255))
    body = CountedGraph(bytes(data), "<")
    tracemalloc.start()
    columns, end = read_table(
        body, Element("face", number, (Property("corners", "u4", "u1"),)), 0, {"corners"}
    )
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()

    assert end == body.end
    assert len(columns["corners"].values) == int(np.minimum(sizes, 255).sum())
    assert body.asked < 10
    assert peak < 30 * len(data) + (1 << 22)


def test_a_list_that_makes_no_sense_is_told_wherever_it_stands() -> None:
    for rows in (5, 40_000):
        good = b"\x01\0\0\0\0" + b"\0" * rows
        element = Element("face", rows + 2, (Property("corners", "i4", "i1"),))
        for bad, told in ((b"\xff", "is damaged"), (b"\x7f\0", "ends")):
            with pytest.raises(ValueError, match=told):
                read_table(BinaryBody(good + bad, "<"), element, 0, {"corners"})


def test_a_word_that_is_no_number_counts_only_where_it_is_asked_for() -> None:
    rows = ["2 7 8 red", "0 blue", "1 9 no"] * 30_000
    element = Element("face", len(rows), (Property("corners", "i4", "u1"), Property("colour", "f4")))
    columns, _ = read_table(TextBody(" ".join(rows).encode()), element, 0, {"corners"})

    assert columns["corners"].values.tolist() == [7, 8, 9] * 30_000
    with pytest.raises(ValueError, match="expected a number, found 'red'"):
        read_table(TextBody(" ".join(rows).encode()), element, 0, {"colour"})
    for nth, word in ((1, "two 7 8 red"), (-1, "one 9 no")):
        wrong = list(rows)
        wrong[nth] = word
        with pytest.raises(ValueError, match=f"expected a number, found '{word[:3]}'"):
            read_table(TextBody(" ".join(wrong).encode()), element, 0, {"corners"})
