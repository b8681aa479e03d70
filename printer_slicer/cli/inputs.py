"""Input files of a command line: `-` reads stdin, and patterns that the shell did not expand are expanded."""

from __future__ import annotations

import argparse
import glob
import os
import re
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Final

from printer_slicer.errors import UsageError

__all__ = ["MODELS", "refuse_other_text", "resolve_inputs", "save_stdin"]

MODELS: Final = (".stl", ".3mf", ".obj", ".ply", ".off", ".glb", ".gltf", ".step", ".stp")
_STDIN: Final = Path("-")
_PROFILES: Final = ("printer", "material", "quality")
_READING: Final = ("check", "show", "diff", *_PROFILES)  # actions of `profiles` that read files
_CHUNK, _MOST = 1 << 20, 1 << 31  # bytes; readers of each format have limits of their own
_GCODE: Final = re.compile(rb"\s*(;|[GMTN]\d|%|$)", re.IGNORECASE)
_LINES: Final = 40  # first lines that are examined
# Beginnings of other text formats that could be mistaken for a comment or a command.
_MODELS: Final = re.compile(rb"\s*(solid\b|ply\b|n?off\b|mtllib\b|v\s|g\s|o\s|#|<|\{)", re.IGNORECASE)

_HEAD: Final = 1 << 16  # bytes of a file that are examined
# A word with a number, optionally after a line number; a macro alone or with KEY=VALUE; commands of some controllers.
_COMMAND: Final = re.compile(
    rb"(N\d+\s*)?[GMTXYZEFS]\s*([-+.\d{\[]|$)|[A-Z_]\w*(\s+\w+\s*=.*)?\s*$|M117\b|[%@$(/*]|\{(?!\s*[\"}])",
    re.IGNORECASE,
)


@contextmanager
def resolve_inputs(arguments: argparse.Namespace) -> Iterator[str]:
    """Replace patterns and `-` in `arguments` by files: models, G-code and profiles.

    Yields:
        The temporary folder with the file from stdin, "" if stdin was not read; messages should not show it.

    Raises:
        UsageError: a pattern matches no file, `-` is given twice, or stdin is empty.
    """
    several = "files" if hasattr(arguments, "files") else "models"
    models = [path for one in getattr(arguments, several, ()) for path in _expand(one)]
    gcode = getattr(arguments, "gcode", None)
    if gcode is not None:
        arguments.gcode = gcode = _expand_one(gcode)
    profiles = _profiles(arguments)
    wanted = [*models, *([gcode] if gcode is not None else []), *map(Path, profiles)].count(_STDIN)
    if wanted > 1:
        raise UsageError("-: stdin can be read only once", remedy="Write one of the two to a file")
    if hasattr(arguments, several):
        setattr(arguments, several, models)
    if not wanted:
        yield ""
        return
    from tempfile import TemporaryDirectory

    with TemporaryDirectory(prefix="printer-slicer-") as folder:
        suffix = ".gcode" if gcode == _STDIN else ".toml" if "-" in profiles else ""
        stream: IO[bytes] = sys.stdin.buffer if sys.stdin else open("/dev/null", "rb")  # noqa: PTH123, SIM115 - `<&-`
        path = save_stdin(stream, Path(folder), suffix)
        arguments.hidden = f"{folder}{os.sep}"
        if gcode == _STDIN:
            arguments.gcode = path
        elif "-" in profiles:
            _set_profile(arguments, str(path))
        else:
            setattr(arguments, several, [path if one == _STDIN else one for one in models])
            _insist_on_output(arguments, models)
        yield folder


def _profiles(arguments: argparse.Namespace) -> list[str]:
    """Return the named profiles; those of `profiles check` may be patterns."""
    names = [getattr(arguments, flag, None) or "" for flag in _PROFILES]
    if getattr(arguments, "what", "") == "check":
        arguments.names = [str(path) for name in arguments.names for path in _expand(Path(name))]
    return names + (arguments.names if getattr(arguments, "what", "") in _READING else [])


def _set_profile(arguments: argparse.Namespace, path: str) -> None:
    """Replace `-` by the path of the profile from stdin."""
    for flag in _PROFILES:
        if getattr(arguments, flag, None) == "-":
            setattr(arguments, flag, path)
    if hasattr(arguments, "names"):
        arguments.names = [path if name == "-" else name for name in arguments.names]


def _expand(path: Path) -> list[Path]:
    """Return the files that match a word of the command line."""
    text = str(path)
    if not glob.has_magic(text) or path.exists():
        return [path]
    found = sorted(glob.glob(text, recursive=True))  # noqa: PTH207 - they may be absolute
    if not found:
        raise UsageError(
            f"{path}: no file matches this pattern", remedy="Check the pattern and the current folder"
        )
    return list(map(Path, found))


def _expand_one(path: Path) -> Path:
    """Return the one file that matches a word of the command line."""
    found = _expand(path)
    if len(found) > 1:
        raise UsageError(
            f"{path}: matches {len(found)} files, such as {found[0].name} and {found[1].name}; one is expected",
            remedy='Check them one by one: for file in *.gcode; do printer-slicer check "$file"; done',
        )
    return found[0]


def _insist_on_output(arguments: argparse.Namespace, models: Sequence[Path]) -> None:
    """Refuse G-code of a model from stdin without a name.

    Raises:
        UsageError: no name is given.
    """
    if _STDIN in models and "output" in vars(arguments) and _unnamed(arguments, models):
        raise UsageError(
            "-: the G-code of a model from stdin needs a file name",
            remedy="Name it with -o FILE, or use -o - for stdout",
        )


def _unnamed(arguments: argparse.Namespace, models: Sequence[Path]) -> bool:
    """Return whether the output of a model on stdin has no name."""
    into = getattr(arguments, "output_dir", None) is not None
    return into or (models[0] == _STDIN and arguments.output is None)


def save_stdin(stream: IO[bytes], folder: Path, suffix: str = "", most: int = _MOST) -> Path:
    """Save stdin to a file, whose suffix follows from its contents unless it is given.

    Args:
        stream: stdin.
        folder: where the file is written.
        suffix: of its name; empty: chosen from the contents.
        most: largest size in bytes.

    Raises:
        UsageError: stdin is empty or too large.
    """
    if stream.isatty():
        print("printer-slicer: reading stdin because of -; Ctrl-D ends the input", file=sys.stderr)
    path, length = folder / "stdin", 0
    with path.open("wb") as file:
        while chunk := stream.read(_CHUNK):
            length += len(chunk)
            if length > most:
                raise UsageError(
                    f"-: stdin has more than {most} bytes", remedy="Give the name of the file instead"
                )
            file.write(chunk)
    if not length:
        raise UsageError("-: stdin is empty", remedy="Pipe a file into it, or give the name of a file")
    with path.open("rb") as file:
        kind = suffix or (".gcode" if _looks_like_gcode(file.read(_HEAD)) else "")
    return path.rename(path.with_suffix(kind)) if kind else path


def _looks_like_gcode(head: bytes) -> bool:
    """Return whether text starts like G-code, and not like a model in a text format."""
    if _MODELS.match(head) or b"\0" in head:
        return False
    lines = head.splitlines()[:_LINES]
    return bool(lines) and sum(bool(_GCODE.match(line)) for line in lines) >= 0.9 * len(lines)


def refuse_other_text(path: Path) -> None:
    """Refuse a file if most of its lines are not G-code commands.

    Files that cannot be read are ignored here and reported when they are read. Pipes are ignored too: they can be read
    only once, and may have no writer.

    Raises:
        UsageError: the file is not G-code.
    """
    try:
        if not path.is_file():
            return
        with path.open("rb") as file:
            head = file.read(_HEAD)
    except (OSError, ValueError):
        return
    whole = head if len(head) < _HEAD else head.rpartition(b"\n")[0]
    lines = [line for line in map(_bare, whole.splitlines()) if line]
    other = [line for line in lines if not _COMMAND.match(line)]
    if b"\0" in head[:512] or len(other) > len(lines) / 2:
        shown = "" if b"\0" in head[:512] else f": most lines are not commands, such as {_quoted(other[0])}"
        raise UsageError(
            f"{path}: not a G-code file{shown}",
            remedy="Name a G-code file; `printer-slicer slice` makes one from a model",
        )


def _bare(line: bytes) -> bytes:
    """Return a line without its comment."""
    return line.removeprefix(b"\xef\xbb\xbf").partition(b";")[0].strip()


def _quoted(line: bytes) -> str:
    return repr(line.decode("utf-8", "replace")[:40])
