"""What several commands share: the profile, the progress, the output file."""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import NamedTemporaryFile
from typing import TYPE_CHECKING

from printer_slicer.errors import OutputError, UsageError

if TYPE_CHECKING:
    from printer_slicer.profile import Profile

__all__ = ["Stages", "check_writable", "profile_from", "say", "stages", "visible", "write_file"]

_PATIENCE = 1.0  # s before a progress line appears


def profile_from(arguments: argparse.Namespace) -> Profile:
    """The profile that --printer, --material, --quality, --planner and --set describe.

    Raises:
        UsageError: a name or setting that does not exist or is out of bounds.
    """
    from printer_slicer.profile import load_profile

    changes: dict[str, object] = {}
    if getattr(arguments, "planner", None):
        changes["quality.planner.kind"] = arguments.planner
    for change in arguments.set:
        key, equals, value = change.partition("=")
        if not equals or not key.strip():
            raise UsageError(
                f"--set {change}: expected KEY=VALUE", remedy="for example --set infill_density=0.2"
            )
        changes[key.strip()] = value.strip()
    return load_profile(
        arguments.printer, getattr(arguments, "material", None), getattr(arguments, "quality", None), changes
    )


def say(arguments: argparse.Namespace, text: str) -> None:
    """A line for people; not with --quiet or --json."""
    if not (arguments.quiet or arguments.json):
        print(visible(text))


def visible(text: str) -> str:
    """Text that may come from a file or a printer, without what would control the terminal."""
    return "".join(
        letter if letter.isprintable() or letter == "\n" else "\N{REPLACEMENT CHARACTER}" for letter in text
    )


Stages = Callable[[str], None]


@contextmanager
def stages(arguments: argparse.Namespace) -> Iterator[Stages]:
    """Says which stage the work is in, once it takes longer than a second; nothing when stderr is no terminal."""
    begun = time.monotonic()
    shown: list[int] = []

    def report(stage: str) -> None:
        if time.monotonic() - begun > _PATIENCE:
            print(f"\r\x1b[2K{stage} ...", end="", file=sys.stderr, flush=True)
            shown.append(1)

    quiet = arguments.quiet or not sys.stderr.isatty()
    try:
        yield (lambda _stage: None) if quiet else report
    finally:
        if shown:
            print("\r\x1b[2K", end="", file=sys.stderr, flush=True)


def check_writable(path: Path) -> None:
    """Refuse an output for which there is no place, before long work begins.

    Raises:
        OutputError: it is a folder, or its folder is missing.
    """
    if path.is_dir():
        raise OutputError(f"{path}: is a folder", remedy="name a file in it")
    if not path.parent.is_dir():
        raise OutputError(
            f"{path}: the folder {path.parent} does not exist", remedy=f"mkdir -p {path.parent}"
        )


def write_file(path: Path, data: bytes) -> None:
    """Write a whole file, or leave what was there before untouched; `-` is stdout, and links stay links.

    Raises:
        OutputError: the folder is missing, the disk full, or writing not allowed.
    """
    if str(path) == "-":
        sys.stdout.buffer.write(data)
        sys.stdout.buffer.flush()
        return
    try:
        check_writable(path)
        _write(path.resolve(), data)
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else str(error)
        raise OutputError(
            f"{path}: cannot be written: {reason}", remedy="check name, free space and permissions, or use -o"
        ) from None


def _write(path: Path, data: bytes) -> None:
    """Write beside the file first: what stands there is good until the new one is whole."""
    if path.exists() and not path.is_file():  # a device or a pipe: there is nothing to keep
        path.write_bytes(data)
        return
    with NamedTemporaryFile(dir=path.parent, prefix=".", suffix=".partial", delete=False) as partial:
        try:
            partial.write(data)
            partial.flush()
            # Temporary files are private; this one becomes what the person asked for, with the usual permissions.
            Path(partial.name).chmod(path.stat().st_mode & 0o777 if path.exists() else 0o666 & ~_umask())
            Path(partial.name).replace(path)
        except BaseException:
            Path(partial.name).unlink(missing_ok=True)
            raise


def _umask() -> int:
    """The permissions that this process takes away from new files; asking means setting."""
    mask = os.umask(0)
    os.umask(mask)
    return mask
