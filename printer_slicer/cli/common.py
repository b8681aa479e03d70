"""What several commands share: the profile, the progress, the output file."""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from printer_slicer.errors import OutputError, UsageError

if TYPE_CHECKING:
    from printer_slicer.profile import Profile

__all__ = ["Stages", "profile_from", "say", "stages", "write_file"]

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
        if not equals or not key:
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
        print(text)


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


def write_file(path: Path, data: bytes) -> None:
    """Write a whole file, or leave what was there before untouched.

    Raises:
        OutputError: the folder is missing, the disk full, or writing not allowed.
    """
    if str(path) == "-":
        sys.stdout.buffer.write(data)
        sys.stdout.buffer.flush()
        return
    if path.is_dir():
        raise OutputError(f"{path}: is a folder", remedy="name a file in it")
    if not path.parent.is_dir():
        raise OutputError(
            f"{path}: the folder {path.parent} does not exist", remedy=f"mkdir -p {path.parent}"
        )
    if path.exists() and not path.is_file():  # a device or a pipe: there is nothing to keep
        _write(path, data)
        return
    partial = path.with_name(f".{path.name}.partial")
    try:
        _write(partial, data)
        partial.replace(path)
    except BaseException:
        partial.unlink(missing_ok=True)
        raise


def _write(path: Path, data: bytes) -> None:
    try:
        path.write_bytes(data)
    except OSError as error:
        raise OutputError(
            f"{path}: cannot be written: {error.strerror}",
            remedy="check free space and permissions, or use -o",
        ) from None
