"""The files of a command line: `-` is stdin; patterns that the shell left as they are become the files they mean."""

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

__all__ = ["MODELS", "inputs", "kept", "refuse_other_text"]

MODELS: Final = (".stl", ".3mf", ".obj", ".ply", ".off", ".glb", ".gltf", ".step", ".stp")
_STDIN: Final = Path("-")
_PROFILES: Final = ("printer", "material", "quality")
_READING: Final = ("check", "show", "diff", *_PROFILES)  # of `profiles`
_CHUNK, _MOST = 1 << 20, 1 << 31  # bytes; readers of each format have limits of their own
_GCODE: Final = re.compile(rb"\s*(;|[GMTN]\d|%|$)", re.IGNORECASE)
_LINES: Final = 40  # that must look like G-code
# What other text formats begin with, where it might be taken for a comment or a command.
_MODELS: Final = re.compile(rb"\s*(solid\b|ply\b|n?off\b|mtllib\b|v\s|g\s|o\s|#|<|\{)", re.IGNORECASE)

_HEAD: Final = 1 << 16  # bytes of a file that tell what it is
# A word with a number, maybe behind a line number; a macro alone or with KEY=VALUE; what some controllers know.
_COMMAND: Final = re.compile(
    rb"(N\d+\s*)?[GMTXYZEFS]\s*([-+.\d{\[]|$)|[A-Z_]\w*(\s+\w+\s*=.*)?\s*$|M117\b|[%@$(/*]|\{(?!\s*[\"}])",
    re.IGNORECASE,
)


@contextmanager
def inputs(arguments: argparse.Namespace) -> Iterator[str]:
    """Put the files that are meant into `arguments`: models, G-code, profiles.

    Yields:
        The folder that stdin was kept in, "" if nothing came from there; people need not read of it.

    Raises:
        UsageError: a pattern that no file fits, `-` twice, or nothing in stdin.
    """
    several = "files" if hasattr(arguments, "files") else "models"
    models = [path for one in getattr(arguments, several, ()) for path in _meant(one)]
    gcode = getattr(arguments, "gcode", None)
    if gcode is not None:
        arguments.gcode = gcode = _only(gcode)
    profiles = _profiles(arguments)
    wanted = [*models, *([gcode] if gcode is not None else []), *map(Path, profiles)].count(_STDIN)
    if wanted > 1:
        raise UsageError("-: stdin can be read only once", remedy="write one of the two to a file")
    if hasattr(arguments, several):
        setattr(arguments, several, models)
    if not wanted:
        yield ""
        return
    from tempfile import TemporaryDirectory

    with TemporaryDirectory(prefix="printer-slicer-") as folder:
        suffix = ".gcode" if gcode == _STDIN else ".toml" if "-" in profiles else ""
        stream: IO[bytes] = sys.stdin.buffer if sys.stdin else open("/dev/null", "rb")  # noqa: PTH123, SIM115 - `<&-`
        path = kept(stream, Path(folder), suffix)
        arguments.hidden = f"{folder}{os.sep}"
        if gcode == _STDIN:
            arguments.gcode = path
        elif "-" in profiles:
            _put(arguments, str(path))
        else:
            setattr(arguments, several, [path if one == _STDIN else one for one in models])
            _insist_on_output(arguments, models)
        yield folder


def _profiles(arguments: argparse.Namespace) -> list[str]:
    """The profiles that are named; those of `profiles check` may be patterns."""
    names = [getattr(arguments, flag, None) or "" for flag in _PROFILES]
    if getattr(arguments, "what", "") == "check":
        arguments.names = [str(path) for name in arguments.names for path in _meant(Path(name))]
    return names + (arguments.names if getattr(arguments, "what", "") in _READING else [])


def _put(arguments: argparse.Namespace, path: str) -> None:
    """The profile of stdin where it is named."""
    for flag in _PROFILES:
        if getattr(arguments, flag, None) == "-":
            setattr(arguments, flag, path)
    if hasattr(arguments, "names"):
        arguments.names = [path if name == "-" else name for name in arguments.names]


def _meant(path: Path) -> list[Path]:
    """The files that a word of the command line stands for."""
    text = str(path)
    if not glob.has_magic(text) or path.exists():
        return [path]
    found = sorted(glob.glob(text, recursive=True))  # noqa: PTH207 - they may be absolute
    if not found:
        raise UsageError(f"{path}: no file fits this pattern", remedy="check it, and the folder you are in")
    return list(map(Path, found))


def _only(path: Path) -> Path:
    """The file that a pattern for one file stands for."""
    found = _meant(path)
    if len(found) > 1:
        raise UsageError(
            f"{path}: fits {len(found)} files, {found[0].name} and {found[1].name} among them; one is expected",
            remedy='one after the other: for file in *.gcode; do printer-slicer check "$file"; done',
        )
    return found[0]


def _insist_on_output(arguments: argparse.Namespace, models: Sequence[Path]) -> None:
    """G-code of a model from stdin has no name of its own."""
    if _STDIN in models and "output" in vars(arguments) and _unnamed(arguments, models):
        raise UsageError("-: G-code of a model from stdin has no name", remedy="name it with -o; - is stdout")


def _unnamed(arguments: argparse.Namespace, models: Sequence[Path]) -> bool:
    """Whether no output name follows from the arguments for a model on stdin."""
    into = getattr(arguments, "output_dir", None) is not None
    return into or (models[0] == _STDIN and arguments.output is None)


def kept(stream: IO[bytes], folder: Path, suffix: str = "", most: int = _MOST) -> Path:
    """What comes from stdin as a file, named after what it holds if nothing is said.

    Args:
        stream: stdin.
        folder: where the file is written.
        suffix: of its name; empty: as what is in it looks.
        most: bytes.

    Raises:
        UsageError: there is nothing in it, or too much.
    """
    if stream.isatty():
        print("printer-slicer: reading stdin, as - says; Ctrl-D ends it", file=sys.stderr)
    path, length = folder / "stdin", 0
    with path.open("wb") as file:
        while chunk := stream.read(_CHUNK):
            length += len(chunk)
            if length > most:
                raise UsageError(f"-: over {most} bytes in stdin", remedy="give the file by its name")
            file.write(chunk)
    if not length:
        raise UsageError("-: nothing came from stdin", remedy="pipe a file into it, or name one")
    with path.open("rb") as file:
        kind = suffix or (".gcode" if _looks_like_gcode(file.read(_HEAD)) else "")
    return path.rename(path.with_suffix(kind)) if kind else path


def _looks_like_gcode(head: bytes) -> bool:
    """Whether text begins with comments and commands, and is not one of the models that are text."""
    if _MODELS.match(head) or b"\0" in head:
        return False
    lines = head.splitlines()[:_LINES]
    return bool(lines) and sum(bool(_GCODE.match(line)) for line in lines) >= 0.9 * len(lines)


def refuse_other_text(path: Path) -> None:
    """Refuse a file whose lines are mostly no commands; one that cannot be read is told of by who reads it.

    A pipe is let through: it may have no writer, and what is read of it here nobody could read again.

    Raises:
        UsageError: it is something else than G-code.
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
        shown = "" if b"\0" in head[:512] else f": most lines are no commands, such as {_quoted(other[0])}"
        raise UsageError(
            f"{path}: is no G-code{shown}",
            remedy="name a file of G-code; `printer-slicer slice` makes it of a model",
        )


def _bare(line: bytes) -> bytes:
    """A line without comment."""
    return line.removeprefix(b"\xef\xbb\xbf").partition(b";")[0].strip()


def _quoted(line: bytes) -> str:
    return repr(line.decode("utf-8", "replace")[:40])
