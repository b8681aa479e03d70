"""Read long runs of equal XML elements many times faster than a parser that calls a function for each element.

A run consists of elements such as `<vertex x="1" y="2" z="3"/>`, all with the same attributes in the same order, and
nothing but white space between them. Text in any other form is left to the parser.
"""

from __future__ import annotations

from array import array
from collections.abc import Callable, Iterable, Iterator
from typing import Any

from printer_slicer.kernel import load_kernel
from printer_slicer.values import Struct

__all__ = ["ElementRun", "RunFinder"]


class ElementRun(Struct, frozen=True, eq=False):
    """A kind of element that fills another element.

    Attributes:
        parent: name of the element around the run, without a namespace prefix.
        name: name of the elements.
        attributes: names of their attributes, in the usual order.
        kind: type code of the array of their values: `d` for numbers, `q` for integers.
        take: receives the attribute values of many elements, one after the other.
    """

    parent: str
    name: str
    attributes: tuple[str, ...]
    kind: str
    take: Callable[[array[Any]], None]

    def read(self, text: bytes) -> bool:
        """Read elements and the white space around them; return whether the text has the form of a run."""
        kernel = load_kernel()
        if kernel:
            words = " ".join([f"<{self.name}", *(f'{attribute}="' for attribute in self.attributes)])
            numbers = kernel.read_elements(text, words.encode(), self.kind == "q")
            if numbers is not None:
                self.take(array(self.kind, numbers))
                return True
        return self._read_in_python(text)

    def _read_in_python(self, text: bytes) -> bool:
        """Read as `read` does, also text in which the kernel does not recognise a run."""
        between = text.split(b'"')
        period = 2 * len(self.attributes)
        if len(between) % period != 1:
            return False
        if len(between) == 1:
            return not text.strip()
        between[0] = b"/>" + between[0]
        if between[-1].strip() != b"/>":
            return False
        tag = f"/><{self.name} "
        for i, attribute in enumerate(self.attributes):
            wanted = f"{'' if i else tag}{attribute}=".encode()
            found = {b" ".join(one.split()) for one in set(between[2 * i : -1 : period])}
            if {one.replace(b"/> <", b"/><") for one in found} != {wanted}:
                return False
        try:
            values = array(self.kind, map(int if self.kind == "q" else float, between[1::2]))
        except ValueError:
            return False
        self.take(values)
        return True


class RunFinder:
    """Takes runs out of a document on its way to the parser.

    Args:
        longest_tag: longest text without a whole element that is kept, bytes.
    """

    def __init__(self, longest_tag: int) -> None:
        self._runs: dict[bytes, ElementRun] = {}
        self._longest_tag = longest_tag
        self._begun = ""

    def add(self, run: ElementRun) -> None:
        """Look for runs of this kind, too."""
        self._runs[f"<{run.parent}>".encode()] = run

    def note_element(self, name: str) -> None:
        """Note that the parser has read the start tag of an element that may hold a run."""
        self._begun = name

    def remove_runs(self, pieces: Iterable[bytes]) -> Iterator[bytes]:
        """Yield a document in parts for the parser, with the line ends of each run instead of the run.

        The caller must parse each part before it takes the next one, and call `note_element` from the parser.
        """
        rest, run = b"", None
        for piece in pieces:
            text, rest = rest + piece, b""
            while text:
                if run is None:
                    part, text, rest = self._divide_after_start_tag(text)
                    self._begun = ""
                    yield part
                    run = self._find_run(part)
                    continue
                part, text, is_complete = _divide_after_elements(run, text)
                if not part and not is_complete and len(text) <= self._longest_tag:
                    rest = text
                    break
                is_run = run.read(part)
                yield b"\n" * part.count(b"\n") if is_run else part
                # A comment, CDATA section or instruction may have begun in text that is no run.
                if is_complete or not part or (not is_run and (b"<!" in part or b"<?" in part)):
                    run = None
        yield rest

    def _divide_after_start_tag(self, text: bytes) -> tuple[bytes, bytes, bytes]:
        """Divide text after the first start tag of an element that may hold a run.

        Returns:
            The text up to the tag, the text after it, and, if there is no such tag, the beginning of one at the end.
        """
        ends = [place + len(tag) for tag in self._runs if (place := text.find(tag)) >= 0]
        if ends:
            return text[: min(ends)], text[min(ends) :], b""
        last = text.rfind(b"<", len(text) - max(map(len, self._runs), default=0))
        cut = last if last >= 0 else len(text)
        return text[:cut], b"", text[cut:]

    def _find_run(self, parsed: bytes) -> ElementRun | None:
        """Return the kind of run that may follow; None unless the parsed text ends with the start tag that it noted.

        The tag may also be in a comment, where the parser does not note it.
        """
        kinds = (run for tag, run in self._runs.items() if parsed.endswith(tag) and self._begun == run.parent)
        return next(kinds, None)


def _divide_after_elements(run: ElementRun, text: bytes) -> tuple[bytes, bytes, bool]:
    """Divide text after the last whole element of a run; also return whether the run ends there."""
    end = text.find(f"</{run.parent}".encode())
    last = text.rfind(b"/>")
    cut = end if end >= 0 else last + 2 if last >= 0 else 0
    return text[:cut], text[cut:], end >= 0
