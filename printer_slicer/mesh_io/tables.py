"""Tables of numbers and of lists of numbers, as text or as bytes of either order: what PLY and OFF files are made of.

Rows of the same length are read as one table; where they differ, as where triangles and quads are mixed, in windows of
many rows. Texts become one array of numbers, so that both kinds are read alike: a number is so many places
long, bytes there and one here.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Collection
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, Protocol

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from printer_slicer.arrays import Int

__all__ = [
    "NUMBER",
    "Bytes",
    "Column",
    "Element",
    "Property",
    "TableBody",
    "Words",
    "numbers_in",
    "read_table",
]

NUMBER: Final = re.compile(rb"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?|[-+]?(nan|inf)", re.IGNORECASE)
"""A number in a text."""
NO_NUMBER: Final = re.compile(
    rb"(?<!\S)(?:[-+]?nan(?!\S)|(?!(?:" + NUMBER.pattern + rb")(?!\S))\S+)", re.IGNORECASE
)
"""A word in a text that is no number, `nan` included."""
MOST_ODD: Final = 1_000_000
"""Words in a text that are no numbers; one with more of them is no table."""
WINDOW: Final = 1 << 15
"""Places in which rows of different lengths are looked for together: few enough to stay in the processor's cache."""
ROW_PLACES: Final = 16
"""Places for each row that is left, in the last window."""


@dataclass(frozen=True, slots=True)
class Property:
    """One column: numbers of a `kind`, or lists of them after their length, which is of the kind `count`."""

    name: str
    kind: str
    count: str = ""


@dataclass(frozen=True, slots=True)
class Element:
    """A table of `number` rows."""

    name: str
    number: int
    properties: tuple[Property, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Column:
    """The numbers of one property: (n,) how many in each row, and all in one."""

    counts: Int
    values: NDArray[Any]


class TableBody(Protocol):
    """What follows the header."""

    end: int

    def size(self, kind: str) -> int:
        """Places that a number takes."""

    def number(self, at: int, kind: str) -> int:
        """The whole number at a place."""

    def counts(self, at: Int, kind: str) -> Int:
        """The whole numbers at places, -1 where there is none that counts anything."""

    def numbers(self, at: Int, kind: str) -> NDArray[Any]:
        """The numbers at places."""

    def table(self, start: int, stride: int, shape: tuple[int, int], kind: str) -> NDArray[Any]:
        """Rows of numbers, each `stride` places after the one before."""


class Bytes:
    """A body of bytes in one order."""

    def __init__(self, data: bytes, order: str) -> None:
        self.end, self._data, self._order = len(data), data, order

    def size(self, kind: str) -> int:
        """Places that a number takes."""
        return int(kind[1])

    def number(self, at: int, kind: str) -> int:
        """The whole number at a place."""
        piece = self._data[at : at + int(kind[1])]
        return int.from_bytes(piece, "little" if self._order == "<" else "big", signed=kind[0] == "i")

    def counts(self, at: Int, kind: str) -> Int:
        """The whole numbers at places, -1 where there is none that counts anything."""
        last = self.end - int(kind[1])
        if last < 0:
            return np.full(len(at), -1)
        found = self.numbers(np.minimum(at, last), kind).astype(np.int64)
        return np.where((at <= last) & (found >= 0), found, -1)

    def numbers(self, at: Int, kind: str) -> NDArray[Any]:
        """The numbers at places."""
        size = int(kind[1])
        return np.ndarray((self.end - size + 1,), self._order + kind, self._data, strides=(1,))[at]

    def table(self, start: int, stride: int, shape: tuple[int, int], kind: str) -> NDArray[Any]:
        """Rows of numbers, each `stride` places after the one before."""
        return np.ndarray(shape, self._order + kind, self._data, start, (stride, int(kind[1])))


class Words:
    """A body of text, as its numbers.

    Programs write what is no number where nobody looks, as in coordinates of textures: a word like that is only refused
    where it is asked for.
    """

    def __init__(self, data: bytes) -> None:
        self._odd: dict[int, bytes] = {}
        self._odd_places: Int = np.zeros(0, np.int64)
        try:
            self._words = numbers_in(data, "f8")
        except ValueError:
            self._words = self._despite_odd_words(data)
        self.end = len(self._words)

    def _despite_odd_words(self, data: bytes) -> NDArray[np.float64]:
        """The numbers, with nan for each word that is none."""
        found: list[bytes] = []

        def marked(match: re.Match[bytes]) -> bytes:
            if len(found) == MOST_ODD:
                raise _no_number(found[0])
            found.append(match[0])
            return b"nan"

        words = numbers_in(NO_NUMBER.sub(marked, data), "f8")
        places = np.flatnonzero(np.isnan(words))
        self._odd = {
            int(place): word for place, word in zip(places, found, strict=True) if not NUMBER.fullmatch(word)
        }
        self._odd_places = np.array(list(self._odd), np.int64)
        return words

    def _odd_between(self, first: int, end: int) -> Int:
        """(O,) places of words that are no numbers, from the first place up to the end."""
        begin, stop = np.searchsorted(self._odd_places, [first, end])
        return self._odd_places[begin:stop]

    def _refuse(self, odd: Int) -> None:
        """Refuse the first of the words at these places, if there are any."""
        if len(odd):
            raise _no_number(self._odd[int(odd[0])])

    def size(self, kind: str) -> int:  # noqa: ARG002 - as for bytes
        """Places that a number takes."""
        return 1

    def number(self, at: int, kind: str) -> int:  # noqa: ARG002
        """The whole number at a place."""
        if at in self._odd:
            raise _no_number(self._odd[at])
        return int(self._words[at])

    def counts(self, at: Int, kind: str) -> Int:  # noqa: ARG002
        """The whole numbers at places, -1 where there is none that counts anything."""
        if not self.end:
            return np.full(len(at), -1)
        found = self._words[np.minimum(at, self.end - 1)]
        good = (at < self.end) & (found > -1.0) & (found <= self.end)
        return np.where(good, found, -1.0).astype(np.int64)

    def numbers(self, at: Int, kind: str) -> NDArray[Any]:  # noqa: ARG002
        """The numbers at places."""
        if self._odd and len(at):
            odd = self._odd_between(int(at.min()), int(at.max()) + 1)
            self._refuse(odd[np.isin(odd, at)])
        return self._words[at]

    def table(self, start: int, stride: int, shape: tuple[int, int], kind: str) -> NDArray[Any]:  # noqa: ARG002
        """Rows of numbers, each `stride` places after the one before."""
        if self._odd:
            odd = self._odd_between(start, start + stride * shape[0])
            self._refuse(odd[(odd - start) % stride < shape[1]])
        return np.ndarray(shape, np.float64, self._words, 8 * start, (8 * stride, 8))


def numbers_in(text: bytes, kind: str) -> NDArray[Any]:
    """(N,) the numbers of a kind that a text consists of, blanks between them.

    A word such as `1-2` counts as two: who knows the number of words compares.

    Raises:
        ValueError: a word is none; says which.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", DeprecationWarning)  # what older numpy says of words like that
            return np.fromstring(text, dtype=kind, sep=" ")
    except (ValueError, DeprecationWarning):
        words = (match[0] for match in re.finditer(rb"\S+", text))
        wrong = next((word for word in words if not NUMBER.fullmatch(word)), b"something")
        raise _no_number(wrong) from None


def _no_number(word: bytes) -> ValueError:
    return ValueError(f"expected a number, found '{word[:60].decode('ascii', 'replace')}'")


def read_table(
    body: TableBody, element: Element, start: int, names: Collection[str]
) -> tuple[dict[str, Column], int]:
    """The columns of these names, and where the element ends.

    Args:
        body: what follows the header.
        element: what is there.
        start: where it begins in the body.
        names: of the properties that matter.

    Raises:
        ValueError: there are too few bytes or words for it.
    """
    if not 0 <= element.number <= body.end:
        raise ValueError(
            f"element '{element.name[:40]}' states {element.number} rows, but only {body.end} bytes or words follow"
        )
    if not element.number:
        return {}, start
    first, counts, stride = _row(body, element, start)
    if start + element.number * stride <= body.end and _even(body, element, first, counts, stride):
        return {
            one.name: Column(
                np.broadcast_to(np.int64(count), (element.number,)),
                body.table(at, stride, (element.number, count), one.kind).reshape(-1),
            )
            for one, at, count in zip(element.properties, first, counts, strict=True)
            if one.name in names
        }, start + element.number * stride
    return _walked(body, element, start, names)


def _row(body: TableBody, element: Element, at: int) -> tuple[list[int], list[int], int]:
    """Where the numbers of each property of a row begin, how many there are, and the length of the row."""
    begin, places, counts = at, [], []
    for one in element.properties:
        count = 1
        if one.count:
            after = at + body.size(one.count)
            count = body.number(at, one.count) if after <= body.end else -1
            at = after
        places.append(at)
        counts.append(count)
        at += count * body.size(one.kind)
        if count < 0 or at > body.end:
            raise ValueError(f"the file ends or is damaged within element '{element.name[:40]}'")
    return places, counts, at - begin


def _even(body: TableBody, element: Element, first: list[int], counts: list[int], stride: int) -> bool:
    """Whether all rows have lists as long as those of the first row."""
    try:
        return all(
            (body.table(at - body.size(one.count), stride, (element.number, 1), one.count) == count).all()
            for one, at, count in zip(element.properties, first, counts, strict=True)
            if one.count
        )
    except ValueError:  # no number, as lists of other lengths stand before it
        return False


def _walked(
    body: TableBody, element: Element, start: int, names: Collection[str]
) -> tuple[dict[str, Column], int]:
    """The columns of these names where rows differ in length, and where the element ends: window by window."""
    wanted = [(number, one) for number, one in enumerate(element.properties) if one.name in names]
    counts: dict[str, list[Int]] = {one.name: [] for _, one in wanted}
    values: dict[str, list[NDArray[Any]]] = {one.name: [] for _, one in wanted}
    left = element.number
    while left:
        begins = _begins(body, element, start, min(WINDOW, ROW_PLACES * left))[:left]
        places, sizes, ends = _rows(body, element, begins)
        wrong = (np.minimum.reduce(sizes) < 0) | (ends > body.end)
        if wrong.any():
            _row(body, element, int(begins[wrong.argmax()]))  # says what is wrong
        for number, one in wanted:
            count = sizes[number]
            within = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
            at = np.repeat(places[number], count) + within * body.size(one.kind)
            counts[one.name].append(count.astype(np.int32))
            values[one.name].append(body.numbers(at, one.kind))
        left, start = left - len(begins), int(ends[-1])
    return {
        name: Column(np.concatenate(counts[name]), np.concatenate(values[name])) for name in counts
    }, start


def _begins(body: TableBody, element: Element, start: int, window: int) -> Int:
    """(R,) where the rows begin that follow each other from `start` on, within so many places.

    Each place is asked where a row would end that began there; of the rows found, so many more are found at each turn.
    """
    after = np.full(window + 1, window)
    after[:-1] = np.minimum(_rows(body, element, np.arange(start, start + window))[2] - start, window)
    rows: Int = np.zeros(1, np.int64)
    while rows[-1] < window:
        rows = np.concatenate([rows, after[rows]])
        after = after[after]
    return start + rows[: np.searchsorted(rows, window)]


def _rows(body: TableBody, element: Element, begins: Int) -> tuple[list[Int], list[Int], Int]:
    """For rows that begin there, by properties: where numbers begin, and how many; and where the rows end.

    Counts that make no sense are -1.
    """
    at, places, counts = begins, [], []
    for one in element.properties:
        count: Int = np.ones(len(begins), np.int64)
        if one.count:
            count = body.counts(at, one.count)
            at = at + body.size(one.count)
        places.append(at)
        counts.append(count)
        at = at + np.maximum(count, 0) * body.size(one.kind)
    return places, counts, at
