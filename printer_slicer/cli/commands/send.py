"""`send`: upload G-code to a printer on the network."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from time import monotonic
from typing import Final

from printer_slicer.cli.arguments import add_machine_options, add_output_options, parse_positive_integer
from printer_slicer.cli.connection_options import read_server_key
from printer_slicer.cli.help import mark_advanced
from printer_slicer.cli.output import BAR_DELAY, print_text
from printer_slicer.cli.settings import collect_profile_facts, load_selected_profile
from printer_slicer.errors import UsageError
from printer_slicer.values import replace

__all__ = ["EXAMPLES", "add_arguments", "run"]

EXAMPLES: Final = """\
  printer-slicer send part.gcode --to octoprint http://octopi.local --print
  printer-slicer send part.gcode --to moonraker http://voron.local:7125
  printer-slicer send part.gcode --to prusalink http://mk4.local --key-file ~/.mk4.key
  printer-slicer send part.gcode --to duet http://duet.local --folder /gcodes/parts
  PRINTER_SLICER_KEY=... printer-slicer send part.gcode --to octoprint http://octopi.local"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `send`."""
    parser.add_argument("gcode", metavar="FILE.gcode", type=Path, help="file to upload")
    parser.add_argument(
        "--to",
        nargs=2,
        required=True,
        metavar=("KIND", "URL"),
        help="kind of the server (octoprint, moonraker, prusalink or duet), and its URL",
    )
    parser.add_argument("--print", dest="start", action="store_true", help="start the print after the upload")
    parser.add_argument(
        "--name", metavar="NAME", help="file name on the server; default: the name of the file"
    )
    parser.add_argument(
        "--folder", metavar="PATH", default="", help="folder on the server; default: its main folder"
    )
    parser.add_argument("--key-file", metavar="FILE", type=Path, help="file with the API key or password")
    mark_advanced(
        parser.add_argument(
            "--key",
            metavar="KEY",
            help="API key or password; --key-file is safer, since other users of this computer can read this",
        )
    )
    mark_advanced(
        parser.add_argument(
            "--user",
            metavar="NAME",
            default="",
            help="name of the user that the password belongs to; default for prusalink: maker",
        )
    )
    mark_advanced(
        parser.add_argument(
            "--timeout",
            metavar="S",
            type=parse_positive_integer,
            default=30,
            help="seconds to wait for a reply of the server; default: 30",
        )
    )
    group = parser.add_argument_group(
        "checks before the upload",
        "The file is checked for unsupported extrusion, and with --print also for all other errors that `print` finds.",
    )
    add_machine_options(group)
    add_output_options(parser)


def run(arguments: argparse.Namespace) -> int:
    """Upload G-code to a print server."""
    from printer_slicer.input_files import is_gcode
    from printer_slicer.sending import Upload, send

    path: Path = arguments.gcode
    if not is_gcode(path):
        raise UsageError(f"{path}: not a G-code file", remedy="Slice it first: printer-slicer slice MODEL")
    if not path.is_file():
        raise UsageError(f"{path}: no such file", remedy="Check the path")
    _check_file(arguments)
    kind, url = arguments.to
    with _show_upload_progress(arguments) as on_progress:
        upload = Upload(path, arguments.name or path.name, arguments.folder, arguments.start, on_progress)
        place = send(
            upload,
            kind,
            url,
            key=read_server_key(arguments.key_file, arguments.key),
            user=arguments.user,
            timeout=float(arguments.timeout),
        )
    size = path.stat().st_size
    if arguments.json:
        facts = {"file": path.name, "to": kind, "url": url, "place": place, "bytes": size}
        print(json.dumps(facts | {"printing": arguments.start} | collect_profile_facts(arguments)))
    else:
        what = "sent and started" if arguments.start else "sent"
        print_text(arguments, f"{path.name}: {what}, {size} bytes, as {place} on {url}")
    return 0


def _check_file(arguments: argparse.Namespace) -> None:
    """Check the file before the upload, as `print` does.

    Without --print, the only reason to reject a file is unsupported extrusion, because somebody may start the print
    without looking at it first.

    Raises:
        PolicyError: the file has errors that are not allowed.
        UsageError: the file cannot be read as G-code, or a profile or the name of an error does not exist.
    """
    from printer_slicer.cli.jobs import check_policy
    from printer_slicer.inspection.lint.scan import lint_file

    profile = load_selected_profile(arguments, slices=False, gcode=arguments.gcode)
    job = lint_file(arguments.gcode, profile, streamed=False)
    if not arguments.start:
        job = replace(job, findings=tuple(one for one in job.findings if one.code == "unsupported"))
    check_policy(arguments, job, refusal="not sent")


@contextmanager
def _show_upload_progress(arguments: argparse.Namespace) -> Iterator[Callable[[int, int], None]]:
    """Show a progress bar on a terminal when the upload takes longer than a second; yield a function to update it."""
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

        def update(done: int, size: int) -> None:
            """Update the number of sent bytes, and the number of all bytes."""
            bar.update(task, total=size, completed=done, visible=monotonic() - begun > BAR_DELAY)

        yield update
