"""`send`."""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from time import monotonic

from printer_slicer.cli.common import PATIENCE, profile_facts, profile_from, say
from printer_slicer.errors import UsageError

__all__ = ["send_command"]

_KEY = "PRINTER_SLICER_KEY"


def send_command(arguments: argparse.Namespace) -> int:
    """Upload G-code to a print server."""
    from printer_slicer.jobs import is_gcode
    from printer_slicer.sending import Upload, send

    path: Path = arguments.gcode
    if not is_gcode(path):
        raise UsageError(f"{path}: is no G-code", remedy="slice it first: printer-slicer slice MODEL")
    if not path.is_file():
        raise UsageError(f"{path}: no such file", remedy="check the path")
    _look(arguments)
    kind, url = arguments.to
    with _progress(arguments) as tell:
        upload = Upload(path, arguments.name or path.name, arguments.folder, arguments.start, tell)
        place = send(
            upload, kind, url, key=_key(arguments), user=arguments.user, timeout=float(arguments.timeout)
        )
    size = path.stat().st_size
    if arguments.json:
        facts = {"file": path.name, "to": kind, "url": url, "place": place, "bytes": size}
        print(json.dumps(facts | {"printing": arguments.start} | profile_facts(arguments)))
    else:
        what = "sent and started" if arguments.start else "sent"
        say(arguments, f"{path.name}: {what}, {size} bytes, as {place} on {url}")
    return 0


def _look(arguments: argparse.Namespace) -> None:
    """Look at what is to be printed before a byte of it is sent, as `print` does.

    An upload without --print is refused only for unsupported extrusion: whoever starts it may never see the file.

    Raises:
        PolicyError: it holds what was not allowed.
        UsageError: it is no job, or the profile or a name makes no sense.
    """
    from printer_slicer.cli.policy import insist_on_policy
    from printer_slicer.inspection.lint.lint_jobs import lint_file

    profile = profile_from(arguments, slices=False, gcode=arguments.gcode)
    job = lint_file(arguments.gcode, profile, streamed=False)
    if not arguments.start:
        job = replace(job, findings=tuple(one for one in job.findings if one.code == "unsupported"))
    insist_on_policy(arguments, job, refusal="not sent")


def _key(arguments: argparse.Namespace) -> str:
    """The key, from where it was told first.

    Raises:
        UsageError: its file cannot be read.
    """
    if arguments.key_file is None:
        return arguments.key or os.environ.get(_KEY, "")
    try:
        text: str = arguments.key_file.expanduser().read_text(encoding="utf-8")
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else error
        raise UsageError(
            f"{arguments.key_file}: cannot be read: {reason}", remedy="a file with the key in its first line"
        ) from None
    return next(iter(text.split()), "")


@contextmanager
def _progress(arguments: argparse.Namespace) -> Iterator[Callable[[int, int], None]]:
    """A bar once it takes longer than a second, on a terminal only."""
    if arguments.json or arguments.quiet or not sys.stderr.isatty():
        yield lambda _done, _all: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, DownloadColumn, Progress, TransferSpeedColumn

    begun = monotonic()
    with Progress(
        BarColumn(), DownloadColumn(), TransferSpeedColumn(), console=Console(stderr=True), transient=True
    ) as bar:
        task = bar.add_task("sending", visible=False)

        def tell(done: int, size: int) -> None:
            """So many bytes are on their way."""
            bar.update(task, total=size, completed=done, visible=monotonic() - begun > PATIENCE)

        yield tell
