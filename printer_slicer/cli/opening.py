"""Open written files in the default programs of the desktop."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence
from pathlib import Path

from printer_slicer.cli.help import mark_advanced
from printer_slicer.cli.output import warn

__all__ = ["add_open_option", "open_files"]


def add_open_option(group: argparse._ActionsContainer) -> None:
    """Add the option --open to a group."""
    mark_advanced(
        group.add_argument(
            "--open", action="store_true", help="open the written files in their default programs"
        )
    )


def open_files(arguments: argparse.Namespace, paths: Sequence[Path | None]) -> None:
    """Open files if --open is given; a file that cannot be opened causes a warning only, because it is written.

    Args:
        arguments: the command line.
        paths: the files; None and `-` are skipped.
    """
    if not getattr(arguments, "open", False):
        return
    for path in paths:
        if path is not None and str(path) != "-" and (problem := _open_file(path.absolute())):
            warn(arguments, [f"--open: {path}: {problem}"])


def _open_file(path: Path) -> str:
    """Open one file; return the problem if it cannot be opened, otherwise an empty text."""
    if sys.platform == "win32":
        os.startfile(path)  # noqa: S606 - this is how Windows opens a file
        return ""
    import shutil
    import subprocess

    opener = "open" if sys.platform == "darwin" else "xdg-open"
    if not shutil.which(opener):
        return f"{opener} is not installed"
    try:
        subprocess.Popen(  # noqa: S603 - the path is an argument, not a command line
            [opener, str(path)],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
    except OSError as error:
        return str(error.strerror)
    return ""
