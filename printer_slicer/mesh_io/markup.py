"""Read untrusted XML element by element with expat.

Documents with a document type are rejected, so there are no entities of any kind and nothing is fetched or expanded.
Depth and length of the markup are limited, and the text between the tags is not kept.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TYPE_CHECKING
from xml.parsers import expat

from printer_slicer.errors import MeshError
from printer_slicer.mesh_io.element_runs import ElementRun, RunFinder
from printer_slicer.mesh_io.soundness import COPY_AGAIN, EXPORT_AGAIN

if TYPE_CHECKING:
    from printer_slicer.mesh_io.limits import Limits

__all__ = ["Handler", "XmlReader", "get_integer", "get_number"]

Handler = Callable[[list[str]], None]
"""Receives the attributes of an element: name, value, name, value, ..."""


class XmlReader:
    """Calls a handler for each element by its name; subclasses register the handlers.

    Handlers are registered by name: as in the document if it has no namespace, otherwise as `namespace name`.

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
        self._texts: dict[str, Callable[[list[str], str], None]] = {}
        self._text: list[str] | None = None
        self._text_length = 0
        self._text_attributes: list[str] = []
        self._names: dict[str, str] = {}
        self._run_finder = RunFinder(limits.xml_token)
        self._parser = expat.ParserCreate(namespace_separator=" ", intern=self._names)
        self._parser.ordered_attributes = True
        self._parser.StartElementHandler = self._begin_element
        self._parser.EndElementHandler = self._end_element
        self._parser.StartNamespaceDeclHandler = self._declare_namespace
        self._parser.StartDoctypeDeclHandler = self._reject_document_type

    def register(
        self, names: Iterable[str], start: Handler | None, end: Callable[[], None] | None = None
    ) -> None:
        """Register the handlers for elements of these names."""
        for name in names:
            if start:
                self._starts[name] = start
            if end:
                self._ends[name] = end

    def register_text(self, names: Iterable[str], handler: Callable[[list[str], str], None]) -> None:
        """Register the handler for elements that hold text; it receives their attributes and the text."""
        self._texts |= dict.fromkeys(names, handler)

    def register_run(self, prefixes: Iterable[str], run: ElementRun) -> None:
        """Register runs of elements, which are read at once, in parents of a name with one of these prefixes."""
        self._run_finder.add(run)
        self.register(
            (f"{prefix}{run.parent}" for prefix in prefixes),
            lambda _: self._run_finder.note_element(run.parent),
        )

    def read(self, pieces: Iterable[bytes]) -> None:
        """Read a whole document.

        Raises:
            MeshError: the XML is not valid, or a limit is exceeded. Errors of the handlers pass through.
        """
        n_fed = 0
        try:
            for piece in self._run_finder.remove_runs(pieces):
                self._parser.Parse(piece, False)
                n_fed += len(piece)
                self.check_limits()
                if len(self._names) > self.limits.names:
                    raise self.make_error(f"more than {self.limits.names} different names")
                # Otherwise an endless tag would be scanned from its start again and again.
                if n_fed - self._parser.CurrentByteIndex > self.limits.xml_token + len(piece):
                    raise self.make_error(f"a tag is longer than {self.limits.xml_token} bytes")
            self._parser.Parse(b"", True)
        except expat.ExpatError as error:
            raise MeshError(f"{self.path}:{self._what} not valid XML: {error}", remedy=COPY_AGAIN) from error
        except (ValueError, OverflowError, LookupError, UnicodeError) as error:
            reason = str(error).partition("\n")[0][:120]
            raise self.make_error(reason[:1].lower() + reason[1:]) from error
        finally:
            # Break the reference cycle of parser and handlers, to free the memory of a large document at once.
            self._parser.StartElementHandler = self._parser.EndElementHandler = None
            self._parser.StartNamespaceDeclHandler = self._parser.StartDoctypeDeclHandler = None
            self._parser.CharacterDataHandler = None

    def check_limits(self) -> None:
        """Check the content read so far against the limits; called regularly, may raise a MeshError."""

    def make_error(self, what: str, remedy: str = EXPORT_AGAIN) -> MeshError:
        """Return an error with this description that names the current line."""
        return MeshError(
            f"{self.path}:{self._what} line {self._parser.CurrentLineNumber}: {what}", remedy=remedy
        )

    def _begin_element(self, name: str, attributes: list[str]) -> None:
        self._depth += 1
        if self._depth > self.limits.xml_depth:
            raise self.make_error(f"elements are nested more than {self.limits.xml_depth} deep")
        handler = self._starts.get(name)
        if handler:
            handler(attributes)
        if self._text is not None:
            self._stop_text()
        if name in self._texts:
            self._text, self._text_length, self._text_attributes = [], 0, attributes
            self._parser.CharacterDataHandler = self._add_text

    def _add_text(self, text: str) -> None:
        """Keep text within an element, up to the limit for a tag."""
        if self._text is not None:
            self._text.append(text)
            self._text_length += len(text)
            if self._text_length > self.limits.xml_token:
                raise self.make_error(f"a text is longer than {self.limits.xml_token} characters")

    def _stop_text(self) -> str:
        """Stop to keep text; return the text kept so far."""
        text = "".join(self._text or [])
        self._text = self._parser.CharacterDataHandler = None
        return text

    def _end_element(self, name: str) -> None:
        self._depth -= 1
        handler = self._ends.get(name)
        if handler:
            handler()
        if self._text is not None:
            self._texts[name](self._text_attributes, self._stop_text())

    def _declare_namespace(self, prefix: str | None, namespace: str) -> None:
        if len(self.namespaces) >= self.limits.names:
            raise self.make_error(f"more than {self.limits.names} namespaces")
        self.namespaces[prefix or ""] = namespace

    def _reject_document_type(self, *_: object) -> None:
        raise self.make_error(
            "the file declares a document type, which is unsafe and not needed for a mesh",
            "Do not trust the file; if it is your own, remove the line that begins with <!DOCTYPE",
        )


def get_number(attributes: list[str], name: str) -> float:
    """Return the value of a numeric attribute.

    Raises:
        LookupError, ValueError: the attribute is missing or not a number.
    """
    return float(_get_value(attributes, name))


def get_integer(attributes: list[str], name: str) -> int:
    """Return the value of an integer attribute.

    Raises:
        LookupError, ValueError: the attribute is missing or not an integer.
    """
    return int(_get_value(attributes, name))


def _get_value(attributes: list[str], name: str) -> str:
    """Return the value of an attribute."""
    for place in range(0, len(attributes), 2):
        if attributes[place] == name:
            return attributes[place + 1]
    raise LookupError(f"the attribute '{name}' is missing")
