"""Read multipart uploads as they arrive: small fields, and one file that goes straight to the store.

Nothing is decided before the end of the form, because some programs send fields behind the file. Fields that other
servers use internally, such as `file.path`, are fields like any other and have no meaning.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Final

from python_multipart.exceptions import MultipartParseError
from python_multipart.multipart import MultipartParser, parse_options_header

from printer_slicer.input_files import GCODE_SUFFIXES
from printer_slicer.server.problems import ProblemError

__all__ = ["FormReader", "check_gcode_name"]

_MAX_FIELDS: Final = 16
_MAX_FIELD_BYTES: Final = 4096
_MAX_PART_HEADER_BYTES: Final = 4096


class FormReader:
    """Reads a form with one file.

    Args:
        content_type: the header of the request.
        read_chunk: returns the next piece of the body; empty at its end. It may wait.

    Attributes:
        fields: the fields that were read so far, by name; of several with one name, the last.
        file_name: name of the file; empty before it begins.

    Raises:
        ProblemError: the content is not a form.
    """

    def __init__(self, content_type: str, read_chunk: Callable[[], bytes]) -> None:
        kind, options = parse_options_header(content_type)
        boundary = options.get(b"boundary", b"")
        if kind != b"multipart/form-data" or not 0 < len(boundary) <= 200:
            raise ProblemError(
                415, "the upload is not a multipart form", "Send multipart/form-data with a file"
            )
        self.fields: dict[str, str] = {}
        self.file_name = ""
        self._read_chunk = read_chunk
        self._parser = MultipartParser(
            boundary,
            {
                "on_part_begin": self._begin_part,
                "on_header_field": lambda data, start, end: self._add_to_header(0, data[start:end]),
                "on_header_value": lambda data, start, end: self._add_to_header(1, data[start:end]),
                "on_header_end": self._end_header,
                "on_headers_finished": self._begin_content,
                "on_part_data": lambda data, start, end: self._add_content(data[start:end]),
                "on_part_end": self._end_part,
                "on_end": self._end_form,
            },
        )
        self._header = [b"", b""]
        self._disposition = b""
        self._field, self._value, self._n_parts = "", bytearray(), 0
        self._is_file = self._has_file = self._is_complete = False
        self._pieces: list[bytes] = []

    def find_file(self) -> str:
        """Read up to the beginning of the file, and return its name.

        Raises:
            ProblemError: the form has no file, or breaks a limit.
        """
        while not self._has_file:
            self._read()
        return self.file_name

    def read_file(self) -> Iterator[bytes]:
        """Yield the content of the file, and read the rest of the form.

        Raises:
            ProblemError: the form is not complete, or breaks a limit.
        """
        while True:
            pieces, self._pieces = self._pieces, []
            yield from pieces
            if self._is_complete and not self._pieces:
                return
            self._read()

    def _read(self) -> None:
        """Read and parse the next piece of the body."""
        chunk = self._read_chunk()
        if not chunk:
            what = "the upload ended before the form did" if self._n_parts else "the upload is empty"
            what = "the form has no file" if self._is_complete else what
            raise ProblemError(400, what, "Send the file again")
        try:
            self._parser.write(chunk)
        except MultipartParseError:
            raise ProblemError(
                400, "the upload is not a valid multipart form", "Send the file again"
            ) from None
        if self._is_complete and not self._has_file:
            raise ProblemError(400, "the form has no file", "Send the file in a field with a file name")

    def _begin_part(self) -> None:
        """Begin a field or file."""
        self._n_parts += 1
        if self._n_parts > _MAX_FIELDS:
            raise ProblemError(400, f"the form has more than {_MAX_FIELDS} parts", "Send one file per form")
        self._disposition, self._header = b"", [b"", b""]
        self._value.clear()

    def _add_to_header(self, side: int, data: bytes) -> None:
        """Add to the name (side 0) or value (side 1) of a header of a part."""
        self._header[side] += data
        if len(self._header[side]) > _MAX_PART_HEADER_BYTES:
            raise ProblemError(400, "a header of the form is too long", "Choose a shorter file name")

    def _end_header(self) -> None:
        """Note the header that names the field."""
        if self._header[0].lower() == b"content-disposition":
            self._disposition = self._header[1]
        self._header = [b"", b""]

    def _begin_content(self) -> None:
        """Begin the content of a part."""
        _, options = parse_options_header(self._disposition)
        self._field = options.get(b"name", b"").decode(errors="replace")
        self._is_file = b"filename" in options
        if self._is_file and self._has_file:
            raise ProblemError(400, "the form has several files", "Send one file per form")
        if self._is_file:
            self._has_file, self.file_name = True, options[b"filename"].decode(errors="replace")

    def _add_content(self, data: bytes) -> None:
        """Add to the file or the value of a field."""
        if self._is_file:
            self._pieces.append(bytes(data))
            return
        self._value += data
        if len(self._value) > _MAX_FIELD_BYTES:
            name = self._field[:40]
            raise ProblemError(400, f"field {name!r} is longer than {_MAX_FIELD_BYTES} bytes", "Shorten it")

    def _end_part(self) -> None:
        """Note the value of a field."""
        if not self._is_file:
            self.fields[self._field] = self._value.decode(errors="replace")

    def _end_form(self) -> None:
        """Note that the closing boundary has arrived."""
        self._is_complete = True


def check_gcode_name(name: str) -> None:
    """Check that a file has a name of G-code.

    Raises:
        ProblemError: it has another one.
    """
    if not name.lower().endswith(GCODE_SUFFIXES):
        remedy = "Let the slicer write plain G-code, for example without binary G-code or UFP"
        raise ProblemError(
            415, "only plain G-code can be uploaded here, with a name such as part.gcode", remedy
        )
