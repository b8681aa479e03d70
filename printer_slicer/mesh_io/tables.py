"""Read tables of numbers and of lists of numbers, as text or in binary of either byte order, for PLY and OFF files.

Rows of equal length are read as one table. Rows of different lengths, for example triangles and quads, are read in
windows of many rows. A text is first converted to one array of numbers, so that both kinds are read by the same code.
Positions are bytes in binary data and numbers in a text.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Collection
from typing import TYPE_CHECKING, Any, Final, Protocol

import numpy as np

from printer_slicer.values import Struct

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from printer_slicer.arrays import Int

__all__ = [
    "NUMBER",
    "BinaryBody",
    "Column",
    "Element",
    "Property",
    "TableBody",
    "TextBody",
    "convert_numbers",
    "read_table",
]

NUMBER: Final = re.compile(rb"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?|[-+]?(nan|inf)", re.IGNORECASE)
"""A number in a text."""
NOT_A_NUMBER: Final = re.compile(
    rb"(?<!\S)(?:[-+]?nan(?!\S)|(?!(?:" + NUMBER.pattern + rb")(?!\S))\S+)", re.IGNORECASE
)
"""A word in a text that is not a number, including `nan`."""
MAX_INVALID_WORDS: Final = 1_000_000
"""Maximum number of words that are not numbers; a text with more of them is not a table."""
WINDOW: Final = 1 << 15
"""Number of positions searched at a time for rows of different lengths; they fit the processor's cache."""
POSITIONS_PER_ROW: Final = 16
"""Number of positions searched for each remaining row, if few rows remain."""


class Property(Struct, frozen=True):
    """A column of a table: numbers of type `kind`, or lists of such numbers if `count`, the type of lengths, is set."""

    name: str
    kind: str
    count: str = ""


class Element(Struct, frozen=True):
    """A table with `n_rows` rows."""

    name: str
    n_rows: int
    properties: tuple[Property, ...]


class Column(Struct, frozen=True, eq=False):
    """The numbers of one property: the count of each row (n,), and the numbers of all rows in one array."""

    counts: Int
    values: NDArray[Any]


class TableBody(Protocol):
    """The data after the header of a file."""

    end: int

    def number_size(self, kind: str) -> int:
        """Return the number of positions that a number takes."""

    def read_integer(self, at: int, kind: str) -> int:
        """Return the integer at a position."""

    def read_counts(self, at: Int, kind: str) -> Int:
        """Return the integers at positions, or -1 where there is no valid count."""

    def read_numbers(self, at: Int, kind: str) -> NDArray[Any]:
        """Return the numbers at positions."""

    def read_rows(self, start: int, stride: int, shape: tuple[int, int], kind: str) -> NDArray[Any]:
        """Return rows of numbers that start `stride` positions apart."""


class BinaryBody:
    """Binary data of one byte order."""

    def __init__(self, data: bytes, order: str) -> None:
        self.end, self._data, self._order = len(data), data, order

    def number_size(self, kind: str) -> int:
        """Return the number of positions that a number takes."""
        return int(kind[1])

    def read_integer(self, at: int, kind: str) -> int:
        """Return the integer at a position."""
        piece = self._data[at : at + int(kind[1])]
        return int.from_bytes(piece, "little" if self._order == "<" else "big", signed=kind[0] == "i")

    def read_counts(self, at: Int, kind: str) -> Int:
        """Return the integers at positions, or -1 where there is no valid count."""
        last = self.end - int(kind[1])
        if last < 0:
            return np.full(len(at), -1)
        found = self.read_numbers(np.minimum(at, last), kind).astype(np.int64)
        return np.where((at <= last) & (found >= 0), found, -1)

    def read_numbers(self, at: Int, kind: str) -> NDArray[Any]:
        """Return the numbers at positions."""
        size = int(kind[1])
        return np.ndarray((self.end - size + 1,), self._order + kind, self._data, strides=(1,))[at]

    def read_rows(self, start: int, stride: int, shape: tuple[int, int], kind: str) -> NDArray[Any]:
        """Return rows of numbers that start `stride` positions apart."""
        return np.ndarray(shape, self._order + kind, self._data, start, (stride, int(kind[1])))


class TextBody:
    """Text data, converted to numbers.

    Some programs write words that are not numbers, for example in texture coordinates. Such a word is an error only if
    its value is needed.
    """

    def __init__(self, data: bytes) -> None:
        self._invalid_words: dict[int, bytes] = {}
        self._invalid_positions: Int = np.zeros(0, np.int64)
        try:
            self._words = convert_numbers(data, "f8")
        except ValueError:
            self._words = self._read_with_invalid_words(data)
        self.end = len(self._words)

    def _read_with_invalid_words(self, data: bytes) -> NDArray[np.float64]:
        """Convert the words to numbers, with nan for each word that is not a number."""
        found: list[bytes] = []

        def replace_by_nan(match: re.Match[bytes]) -> bytes:
            if len(found) == MAX_INVALID_WORDS:
                raise _not_a_number_error(found[0])
            found.append(match[0])
            return b"nan"

        words = convert_numbers(NOT_A_NUMBER.sub(replace_by_nan, data), "f8")
        places = np.flatnonzero(np.isnan(words))
        self._invalid_words = {
            int(place): word for place, word in zip(places, found, strict=True) if not NUMBER.fullmatch(word)
        }
        self._invalid_positions = np.array(list(self._invalid_words), np.int64)
        return words

    def _find_invalid_words(self, first: int, end: int) -> Int:
        """Return the positions (O,) of words from `first` up to `end` that are not numbers."""
        start, stop = np.searchsorted(self._invalid_positions, [first, end])
        return self._invalid_positions[start:stop]

    def _reject_first(self, positions: Int) -> None:
        """Raise an error that names the first of the words at these positions, if there are any."""
        if len(positions):
            raise _not_a_number_error(self._invalid_words[int(positions[0])])

    def number_size(self, kind: str) -> int:  # noqa: ARG002 - as for bytes
        """Return the number of positions that a number takes."""
        return 1

    def read_integer(self, at: int, kind: str) -> int:  # noqa: ARG002
        """Return the integer at a position."""
        if at in self._invalid_words:
            raise _not_a_number_error(self._invalid_words[at])
        return int(self._words[at])

    def read_counts(self, at: Int, kind: str) -> Int:  # noqa: ARG002
        """Return the integers at positions, or -1 where there is no valid count."""
        if not self.end:
            return np.full(len(at), -1)
        found = self._words[np.minimum(at, self.end - 1)]
        good = (at < self.end) & (found > -1.0) & (found <= self.end)
        return np.where(good, found, -1.0).astype(np.int64)

    def read_numbers(self, at: Int, kind: str) -> NDArray[Any]:  # noqa: ARG002
        """Return the numbers at positions."""
        if self._invalid_words and len(at):
            positions = self._find_invalid_words(int(at.min()), int(at.max()) + 1)
            self._reject_first(positions[np.isin(positions, at)])
        return self._words[at]

    def read_rows(self, start: int, stride: int, shape: tuple[int, int], kind: str) -> NDArray[Any]:  # noqa: ARG002
        """Return rows of numbers that start `stride` positions apart."""
        if self._invalid_words:
            positions = self._find_invalid_words(start, start + stride * shape[0])
            self._reject_first(positions[(positions - start) % stride < shape[1]])
        return np.ndarray(shape, np.float64, self._words, 8 * start, (8 * stride, 8))


def convert_numbers(text: bytes, kind: str) -> NDArray[Any]:
    """Return the numbers (N,) of a text, separated by blanks.

    A word such as `1-2` gives two numbers; a caller that knows the number of words has to compare.

    Raises:
        ValueError: a word is not a number; names it.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", DeprecationWarning)  # older numpy only warns about such words
            return np.fromstring(text, dtype=kind, sep=" ")
    except (ValueError, DeprecationWarning):
        words = (match[0] for match in re.finditer(rb"\S+", text))
        wrong = next((word for word in words if not NUMBER.fullmatch(word)), b"something")
        raise _not_a_number_error(wrong) from None


def _not_a_number_error(word: bytes) -> ValueError:
    return ValueError(f"expected a number, found '{word[:60].decode('ascii', 'replace')}'")


def read_table(
    body: TableBody, element: Element, start: int, names: Collection[str]
) -> tuple[dict[str, Column], int]:
    """Read the columns with these names; also return where the element ends in the body.

    Args:
        body: the data after the header.
        element: the element to read.
        start: where it starts in the body.
        names: the properties to read.

    Raises:
        ValueError: there are too few bytes or words.
    """
    if not 0 <= element.n_rows <= body.end:
        raise ValueError(
            f"element '{element.name[:40]}' has {element.n_rows} rows, but only {body.end} bytes or words follow"
        )
    if not element.n_rows:
        return {}, start
    first, counts, stride = _read_row_layout(body, element, start)
    end = start + element.n_rows * stride
    if end <= body.end and _has_equal_rows(body, element, first, counts, stride):
        return {
            one.name: Column(
                np.broadcast_to(np.int64(count), (element.n_rows,)),
                body.read_rows(at, stride, (element.n_rows, count), one.kind).reshape(-1),
            )
            for one, at, count in zip(element.properties, first, counts, strict=True)
            if one.name in names
        }, end
    return _read_uneven_rows(body, element, start, names)


def _read_row_layout(body: TableBody, element: Element, at: int) -> tuple[list[int], list[int], int]:
    """Return for each property of a row where its numbers start and how many it has; also return the row's length."""
    start, places, counts = at, [], []
    for one in element.properties:
        count = 1
        if one.count:
            after = at + body.number_size(one.count)
            count = body.read_integer(at, one.count) if after <= body.end else -1
            at = after
        places.append(at)
        counts.append(count)
        at += count * body.number_size(one.kind)
        if count < 0 or at > body.end:
            raise ValueError(f"the file ends or is damaged within element '{element.name[:40]}'")
    return places, counts, at - start


def _has_equal_rows(
    body: TableBody, element: Element, first: list[int], counts: list[int], stride: int
) -> bool:
    """Return whether all rows have lists of the same lengths `counts` as the first row."""
    try:
        return all(
            (
                body.read_rows(at - body.number_size(one.count), stride, (element.n_rows, 1), one.count)
                == count
            ).all()
            for one, at, count in zip(element.properties, first, counts, strict=True)
            if one.count
        )
    except ValueError:  # not a number, because lists of other lengths come before it
        return False


def _read_uneven_rows(
    body: TableBody, element: Element, start: int, names: Collection[str]
) -> tuple[dict[str, Column], int]:
    """Read the columns of an element whose rows differ in length, window by window; see `read_table`."""
    wanted = [(number, one) for number, one in enumerate(element.properties) if one.name in names]
    counts: dict[str, list[Int]] = {one.name: [] for _, one in wanted}
    values: dict[str, list[NDArray[Any]]] = {one.name: [] for _, one in wanted}
    left = element.n_rows
    while left:
        starts = _find_row_starts(body, element, start, min(WINDOW, POSITIONS_PER_ROW * left))[:left]
        places, sizes, ends = _find_row_layouts(body, element, starts)
        wrong = (np.minimum.reduce(sizes) < 0) | (ends > body.end)
        if wrong.any():
            _read_row_layout(body, element, int(starts[wrong.argmax()]))  # raises the error
        for number, one in wanted:
            count = sizes[number]
            within = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
            at = np.repeat(places[number], count) + within * body.number_size(one.kind)
            counts[one.name].append(count.astype(np.int32))
            values[one.name].append(body.read_numbers(at, one.kind))
        left, start = left - len(starts), int(ends[-1])
    return {
        name: Column(np.concatenate(counts[name]), np.concatenate(values[name])) for name in counts
    }, start


def _find_row_starts(body: TableBody, element: Element, start: int, window: int) -> Int:
    """Return the starts (R,) of the consecutive rows from `start` on, within `window` positions.

    For each position, compute where a row that starts there would end. Following these links in doubling steps gives
    all starts.
    """
    after = np.full(window + 1, window)
    after[:-1] = np.minimum(
        _find_row_layouts(body, element, np.arange(start, start + window))[2] - start, window
    )
    rows: Int = np.zeros(1, np.int64)
    while rows[-1] < window:
        rows = np.concatenate([rows, after[rows]])
        after = after[after]
    return start + rows[: np.searchsorted(rows, window)]


def _find_row_layouts(body: TableBody, element: Element, starts: Int) -> tuple[list[Int], list[Int], Int]:
    """Return for each property of each row where its numbers start and how many it has; also return where rows end.

    Invalid counts are -1.

    Args:
        body: the data after the header.
        element: the element to read.
        starts: (R,) possible starts of rows.
    """
    at, places, counts = starts, [], []
    for one in element.properties:
        count: Int = np.ones(len(starts), np.int64)
        if one.count:
            count = body.read_counts(at, one.count)
            at = at + body.number_size(one.count)
        places.append(at)
        counts.append(count)
        at = at + np.maximum(count, 0) * body.number_size(one.kind)
    return places, counts, at
