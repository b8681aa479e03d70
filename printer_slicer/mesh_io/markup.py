"""Read untrusted XML element by element with expat.

A document type is refused, and with it entities of every kind: expanding, external, nested. So nothing is ever fetched
or multiplied. Depth and length of the markup are limited, and the text between the tags is not kept.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TYPE_CHECKING
from xml.parsers import expat

from printer_slicer.errors import MeshError
from printer_slicer.mesh_io.soundness import COPY_AGAIN, EXPORT_AGAIN

if TYPE_CHECKING:
    from printer_slicer.mesh_io.limits import Limits

__all__ = ["Handler", "XmlReader", "number_in", "whole_in"]

Handler = Callable[[list[str]], None]
"""Takes the attributes of an element: name, value, name, value, ..."""


class XmlReader:
    """Calls one function per element by its name; subclasses say which.

    Names are those of the document where it has no namespace, and `namespace name` where it has one.

    Attributes:
        namespaces: prefix -> namespace, as the document declares them.
    """

    def __init__(self, path: Path, limits: Limits, what: str = "") -> None:
        self.path = path
        self.limits = limits
        self.namespaces: dict[str, str] = {}
        self._what = f" {what}" if what else ""
        self._depth = 0
        self._starts: dict[str, Handler] = {}
        self._ends: dict[str, Callable[[], None]] = {}
        self._names: dict[str, str] = {}
        self._parser = expat.ParserCreate(namespace_separator=" ", intern=self._names)
        self._parser.ordered_attributes = True
        self._parser.StartElementHandler = self._start
        self._parser.EndElementHandler = self._end
        self._parser.StartNamespaceDeclHandler = self._declare
        self._parser.StartDoctypeDeclHandler = self._refuse_document_type

    def on(self, names: Iterable[str], start: Handler | None, end: Callable[[], None] | None = None) -> None:
        """What to call for the elements of these names."""
        for name in names:
            if start:
                self._starts[name] = start
            if end:
                self._ends[name] = end

    def read(self, pieces: Iterable[bytes]) -> None:
        """Read a whole document.

        Raises:
            MeshError: it is no sound XML, or beyond a limit; what the handlers raise besides.
        """
        n_fed = 0
        try:
            for piece in pieces:
                self._parser.Parse(piece, False)
                n_fed += len(piece)
                self.check()
                if len(self._names) > self.limits.names:
                    raise self.fault(f"more than {self.limits.names} different names")
                # Else one endless tag would be looked through from its start again and again.
                if n_fed - self._parser.CurrentByteIndex > self.limits.xml_token + len(piece):
                    raise self.fault(f"a tag is longer than {self.limits.xml_token} bytes")
            self._parser.Parse(b"", True)
        except expat.ExpatError as error:
            raise MeshError(f"{self.path}:{self._what} not valid XML: {error}", remedy=COPY_AGAIN) from error
        except (ValueError, OverflowError, LookupError, UnicodeError) as error:
            reason = str(error).partition("\n")[0][:120]
            raise self.fault(reason[:1].lower() + reason[1:]) from error
        finally:
            # The parser and its handlers hold each other; a large document should not wait for the collector.
            self._parser.StartElementHandler = self._parser.EndElementHandler = None
            self._parser.StartNamespaceDeclHandler = self._parser.StartDoctypeDeclHandler = None

    def check(self) -> None:
        """Is called now and then: to look how much there is, and to raise a MeshError if it is too much."""

    def fault(self, what: str, remedy: str = EXPORT_AGAIN) -> MeshError:
        """An error that names the line that is being read."""
        return MeshError(
            f"{self.path}:{self._what} line {self._parser.CurrentLineNumber}: {what}", remedy=remedy
        )

    def _start(self, name: str, attributes: list[str]) -> None:
        self._depth += 1
        if self._depth > self.limits.xml_depth:
            raise self.fault(f"elements are nested more than {self.limits.xml_depth} deep")
        handler = self._starts.get(name)
        if handler:
            handler(attributes)

    def _end(self, name: str) -> None:
        self._depth -= 1
        handler = self._ends.get(name)
        if handler:
            handler()

    def _declare(self, prefix: str | None, namespace: str) -> None:
        if len(self.namespaces) >= self.limits.names:
            raise self.fault(f"more than {self.limits.names} namespaces")
        self.namespaces[prefix or ""] = namespace

    def _refuse_document_type(self, *_: object) -> None:
        raise self.fault(
            "the file declares a document type, which is unsafe and not needed for a mesh",
            "Do not trust the file; if it is your own, remove the line that begins with <!DOCTYPE",
        )


def number_in(attributes: list[str], name: str) -> float:
    """The value of an attribute that is a number.

    Raises:
        LookupError, ValueError: it is missing or none.
    """
    return float(_value(attributes, name))


def whole_in(attributes: list[str], name: str) -> int:
    """The value of an attribute that is a whole number.

    Raises:
        LookupError, ValueError: it is missing or none.
    """
    return int(_value(attributes, name))


def _value(attributes: list[str], name: str) -> str:
    for place in range(0, len(attributes), 2):
        if attributes[place] == name:
            return attributes[place + 1]
    raise LookupError(f"the attribute '{name}' is missing")
