"""Resolve the input files of a command line: read `-` from stdin, and expand patterns that the shell did not expand."""

from __future__ import annotations

import argparse
import os
import re
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import IO, TYPE_CHECKING, Final

from printer_slicer.cli.arguments import MAX_COPIES
from printer_slicer.errors import PrinterSlicerError, UsageError
from printer_slicer.input_files import MODEL_SUFFIXES

if TYPE_CHECKING:
    from printer_slicer.profile import Profile

__all__ = ["load_file_profile", "reject_non_gcode", "resolve_inputs", "save_stdin"]

_WILDCARDS: Final = frozenset("*?[")
_STDIN_PATH: Final = Path("-")
_PROFILE_OPTIONS: Final = ("printer", "material", "quality")
_FILE_ACTIONS: Final = ("check", "show", "diff", *_PROFILE_OPTIONS)  # actions of `profiles` that read files
_CHUNK_BYTES, _MAX_STDIN_BYTES = 1 << 20, 1 << 31  # bytes; readers of each format have limits of their own
# Patterns as text: `re` compiles them when they are first used, which most commands never do.
_GCODE_LINE: Final = rb"(?i)\s*(;|[GMTN]\d|%|$)"
_EXAMINED_LINES: Final = 40  # at the start of a file
# First words of model formats whose lines could be mistaken for comments or commands.
_MODEL_LINE: Final = rb"(?i)\s*(solid\b|ply\b|n?off\b|mtllib\b|v\s|g\s|o\s|#|<|\{)"

_EXAMINED_BYTES: Final = 1 << 16  # at the start of a file
# A letter with a number, optionally after a line number; the name of a macro, alone or with KEY=VALUE; the special
# commands of some controllers.
_COMMAND: Final = (
    rb"(?i)(N\d+\s*)?[GMTXYZEFS]\s*([-+.\d{\[]|$)|[A-Z_]\w*(\s+\w+\s*=.*)?\s*$|M117\b|[%@$(/*]|\{(?!\s*[\"}])"
)


@contextmanager
def resolve_inputs(arguments: argparse.Namespace) -> Iterator[str]:
    """Replace patterns and `-` in `arguments` by the files that they stand for: models, G-code and profiles.

    Yields:
        The temporary folder with the data from stdin, which messages should not show; "" if stdin was not read.

    Raises:
        UsageError: a pattern matches no file, `-` is given twice, or stdin is empty.
    """
    several = "files" if hasattr(arguments, "files") else "models"
    models = [path for one in getattr(arguments, several, ()) for path in _expand_model(one)]
    gcode = getattr(arguments, "gcode", None)
    if gcode is not None and hasattr(arguments, "more_files"):
        found = [path for one in (gcode, *arguments.more_files) for path in _expand_pattern(one)]
        gcode, *arguments.more_files = found
        arguments.gcode = gcode
    elif gcode is not None:
        arguments.gcode = gcode = _expand_to_one_file(gcode)
    profiles = _collect_profile_names(arguments)
    stdin_count = [*models, *([gcode] if gcode is not None else []), *map(Path, profiles)].count(_STDIN_PATH)
    if stdin_count > 1:
        raise UsageError("-: stdin can be read only once", remedy="Write one of the two inputs to a file")
    if hasattr(arguments, several):
        setattr(arguments, several, models)
    if not stdin_count:
        yield ""
        return
    from tempfile import TemporaryDirectory

    with TemporaryDirectory(prefix="printer-slicer-") as folder:
        suffix = ".gcode" if gcode == _STDIN_PATH else ".toml" if "-" in profiles else ""
        stream: IO[bytes] = sys.stdin.buffer if sys.stdin else open("/dev/null", "rb")  # noqa: PTH123, SIM115 - `<&-`
        path = save_stdin(stream, Path(folder), suffix)
        arguments.hidden = f"{folder}{os.sep}"
        if gcode == _STDIN_PATH:
            arguments.gcode = path
        elif "-" in profiles:
            _replace_stdin_profile(arguments, str(path))
        else:
            setattr(arguments, several, [path if one == _STDIN_PATH else one for one in models])
            _require_output_name(arguments, models)
        yield folder


def _collect_profile_names(arguments: argparse.Namespace) -> list[str]:
    """Return the profiles that are named on the command line; expand patterns in those of `profiles check`."""
    names = [getattr(arguments, flag, None) or "" for flag in _PROFILE_OPTIONS]
    if getattr(arguments, "what", "") == "check":
        arguments.names = [str(path) for name in arguments.names for path in _expand_pattern(Path(name))]
    return names + (arguments.names if getattr(arguments, "what", "") in _FILE_ACTIONS else [])


def _replace_stdin_profile(arguments: argparse.Namespace, path: str) -> None:
    """Replace `-` by the path of the profile from stdin."""
    for flag in _PROFILE_OPTIONS:
        if getattr(arguments, flag, None) == "-":
            setattr(arguments, flag, path)
    if hasattr(arguments, "names"):
        arguments.names = [path if name == "-" else name for name in arguments.names]


def _expand_model(path: Path) -> list[Path]:
    """Return the files that a model stands for: `part.stl*3` is three copies, other patterns are those of files.

    A file whose name contains `*` is that file.

    Raises:
        UsageError: the number of copies is invalid, or a pattern matches no file.
    """
    text = str(path)
    base, star, count = text.rpartition("*")
    is_model = Path(base).suffix.lower() in MODEL_SUFFIXES
    if not star or path.exists() or not (is_model or Path(base).is_file()):
        return _expand_pattern(path)
    if count.isdecimal() and 1 <= int(count) <= MAX_COPIES:
        return [one for one in _expand_pattern(Path(base)) for _ in range(int(count))]
    import glob

    if glob.glob(text, recursive=True):  # noqa: PTH207 - the pattern may be absolute
        return _expand_pattern(path)
    raise UsageError(
        f"{path}: {count!r} is not a number of copies from 1 to {MAX_COPIES}",
        remedy=f"Write {base}*3 for three copies",
    )


def _expand_pattern(path: Path) -> list[Path]:
    """Return the files that match a pattern; a path without wildcards is returned unchanged."""
    text = str(path)
    if _WILDCARDS.isdisjoint(text) or path.exists():
        return [path]
    import glob

    found = sorted(glob.glob(text, recursive=True))  # noqa: PTH207 - they may be absolute
    if not found:
        raise UsageError(
            f"{path}: no file matches this pattern", remedy="Check the pattern and the current folder"
        )
    return list(map(Path, found))


def _expand_to_one_file(path: Path) -> Path:
    """Return the only file that matches a pattern.

    Raises:
        UsageError: no file matches, or several do.
    """
    found = _expand_pattern(path)
    if len(found) > 1:
        raise UsageError(
            f"{path}: matches {len(found)} files, such as {found[0].name} and {found[1].name}; one is expected",
            remedy="Name one of them",
        )
    return found[0]


def _require_output_name(arguments: argparse.Namespace, models: Sequence[Path]) -> None:
    """Check that the output has a name if a model is read from stdin.

    Raises:
        UsageError: the output has no name.
    """
    if _STDIN_PATH in models and "output" in vars(arguments) and _lacks_output_name(arguments, models):
        raise UsageError(
            "-: the model is read from stdin, so the G-code needs a file name",
            remedy="Name the output with -o FILE.gcode, or write it to stdout with -o -",
        )


def _lacks_output_name(arguments: argparse.Namespace, models: Sequence[Path]) -> bool:
    """Return whether the command line names no output file for the model from stdin."""
    has_output_folder = getattr(arguments, "output_dir", None) is not None
    return has_output_folder or (models[0] == _STDIN_PATH and arguments.output is None)


def save_stdin(stream: IO[bytes], folder: Path, suffix: str = "", max_bytes: int = _MAX_STDIN_BYTES) -> Path:
    """Save stdin to a file, and return its path; the suffix of the name follows from the contents unless it is given.

    Args:
        stream: stdin.
        folder: folder for the file.
        suffix: suffix of the file name; empty: `.gcode` if the contents look like G-code, or none.
        max_bytes: size limit, bytes.

    Raises:
        UsageError: stdin is empty or too large.
    """
    if stream.isatty():
        print("printer-slicer: reading the file named - from stdin; Ctrl-D ends the input", file=sys.stderr)
    path, length = folder / "stdin", 0
    with path.open("wb") as file:
        while chunk := stream.read(_CHUNK_BYTES):
            length += len(chunk)
            if length > max_bytes:
                raise UsageError(
                    f"-: stdin has more than {max_bytes} bytes", remedy="Give the name of the file instead"
                )
            file.write(chunk)
    if not length:
        raise UsageError("-: stdin is empty", remedy="Pipe a file into it, or give the name of a file")
    with path.open("rb") as file:
        kind = suffix or (".gcode" if _looks_like_gcode(file.read(_EXAMINED_BYTES)) else "")
    return path.rename(path.with_suffix(kind)) if kind else path


def _looks_like_gcode(head: bytes) -> bool:
    """Return whether a file starts like G-code, and not like a model in a text format."""
    if re.match(_MODEL_LINE, head) or b"\0" in head:
        return False
    lines = head.splitlines()[:_EXAMINED_LINES]
    return bool(lines) and sum(bool(re.match(_GCODE_LINE, line)) for line in lines) >= 0.9 * len(lines)


def reject_non_gcode(path: Path) -> None:
    """Reject a model, and a file in which most lines are not G-code commands.

    Files that cannot be read are ignored here, and reported later when they are read. Pipes are ignored too: they can
    be read only once, and may have no writer.

    Raises:
        UsageError: the file is not G-code, or binary G-code.
    """
    from printer_slicer.commands import reject_binary_gcode

    head = _read_beginning(path)
    if head is None:
        return
    reject_binary_gcode(head, str(path))
    if path.suffix.lower() in MODEL_SUFFIXES:
        import shlex

        raise UsageError(
            f"{path}: not a G-code file, but a model",
            remedy=f"Slice it first: printer-slicer slice {shlex.quote(str(path))}",
        )
    _reject_other_lines(path, head)


def _reject_other_lines(path: Path, head: bytes) -> None:
    """Reject a file whose beginning is binary, or has more other lines than commands.

    Raises:
        UsageError: the file is not G-code.
    """
    whole = head if len(head) < _EXAMINED_BYTES else head.rpartition(b"\n")[0]
    lines = [line for line in map(_strip_comment, whole.splitlines()) if line]
    other = [line for line in lines if not re.match(_COMMAND, line)]
    if b"\0" in head[:512] or len(other) > len(lines) / 2:
        shown = (
            "" if b"\0" in head[:512] else f": most lines are not commands, such as {_quote_line(other[0])}"
        )
        raise UsageError(
            f"{path}: not a G-code file{shown}",
            remedy="Name a G-code file; to make one from a model, use `printer-slicer slice`",
        )


def _read_beginning(path: Path) -> bytes | None:
    """Return the first bytes of a file; None for pipes, devices and files that cannot be read."""
    try:
        if path.is_file():
            with path.open("rb") as file:
                return file.read(_EXAMINED_BYTES)
    except (OSError, ValueError):
        pass
    return None


def _strip_comment(line: bytes) -> bytes:
    """Return a line of G-code without its comment."""
    return line.removeprefix(b"\xef\xbb\xbf").partition(b";")[0].strip()


def _quote_line(line: bytes) -> str:
    """Return the first 40 characters of a line in quotes, for messages."""
    return repr(line.decode("utf-8", "replace")[:40])


def load_file_profile(arguments: argparse.Namespace) -> Profile:
    """Return the profile for the machine of the G-code file, or the default profile if its settings are invalid."""
    from printer_slicer.cli.settings import load_selected_profile
    from printer_slicer.profile import load_profile

    try:
        return load_selected_profile(arguments, slices=False, gcode=arguments.gcode, tell=False)
    except PrinterSlicerError:
        return load_profile()
