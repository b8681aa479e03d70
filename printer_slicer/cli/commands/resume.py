"""`resume`: resume an interrupted print."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from printer_slicer.cli.arguments import add_output_options
from printer_slicer.cli.connection_options import add_connection_options, occupy_queue_bed
from printer_slicer.cli.output import print_text, sanitize

if TYPE_CHECKING:
    from printer_slicer.printing import PrintResult
    from printer_slicer.printing.host_settings import HostSettings
    from printer_slicer.printing.job_store import Print

__all__ = ["EXAMPLES", "add_arguments", "run"]

EXAMPLES: Final = """\
  printer-slicer resume                     continue with the next line
  printer-slicer resume --recover           home x and y, heat, return to the part and continue
  printer-slicer resume --list              list the unfinished prints
  printer-slicer resume part.gcode --discard"""
_ROW_FORMAT = "{job}: started {begun} on {port}, {accepted} commands done, {reason} ({id})"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `resume`."""
    parser.add_argument(
        "name",
        nargs="?",
        default="",
        metavar="JOB",
        help="name of the print; required if several prints can be resumed",
    )
    parser.add_argument(
        "--port", metavar="PORT", help="port of the printer; default: the port on which the print was started"
    )
    mode = parser.add_mutually_exclusive_group()
    mode.add_argument("--list", action="store_true", help="list the unfinished prints")
    mode.add_argument(
        "--discard", action="store_true", help="delete the unfinished print instead of resuming it"
    )
    mode.add_argument(
        "--recover",
        action="store_true",
        help="if the printer has lost its position, home x and y, take z from the journal, heat, and continue without "
        "asking for confirmation",
    )
    add_connection_options(parser)
    add_output_options(parser)


def run(arguments: argparse.Namespace) -> int:
    """Resume, list or delete interrupted prints."""
    from printer_slicer.printing import job_store as store

    job_store = store.default_job_store()
    if arguments.list:
        return _list_unfinished_prints(arguments, job_store)
    for damage in store.find_damaged_prints(job_store):
        if arguments.discard and arguments.name == damage.folder.name:
            damage.delete()
            print_text(arguments, f"{damage.folder.name}: deleted")
            return 0
        print(sanitize(f"printer-slicer: warning: {damage}\n  {damage.remedy}"), file=sys.stderr)
    found = store.find_print(job_store, arguments.name, running=False)
    if arguments.discard:
        found.delete()
        print_text(arguments, f"{found.name}, started {found.begun}: deleted")
        return 0
    return _resume_print(arguments, found)


def _resume_print(arguments: argparse.Namespace, found: Print) -> int:
    """Resume a stored print, and ask for confirmation if the printer has lost its position."""
    from printer_slicer.cli.progress import print_with_progress
    from printer_slicer.jobs import build_job
    from printer_slicer.printing import resume_print

    setup = found.setup
    job = build_job(found.name, found.text, limits=setup.limits, corner=setup.low, flavour=setup.flavour)

    def confirm_recovery(why: str) -> bool:
        """Show why a recovery is needed, and return whether the user confirms it."""
        if arguments.recover:
            print_text(arguments, why)
            return True
        print(sanitize(why), file=sys.stderr)
        if not (sys.stdin.isatty() and sys.stderr.isatty()):
            print(
                "There is no terminal to ask for confirmation; to recover without it, use resume --recover",
                file=sys.stderr,
            )
            return False
        print(
            "Is the part still in place, and can the nozzle move freely? [yes/no] ",
            end="",
            file=sys.stderr,
            flush=True,
        )
        return sys.stdin.readline().strip().lower() in {"y", "yes"}

    def print_rest(**common: Any) -> PrintResult:
        """Print the rest of the job."""
        occupy_queue_bed(arguments.port or found.port)
        return resume_print(
            found,
            job,
            port=arguments.port,
            recover=confirm_recovery,
            **_make_command_check_argument(setup),
            **common,
        )

    return print_with_progress(arguments, job, Path(f"{Path(found.name).stem}.checkpoint.json"), print_rest)


def _make_command_check_argument(setup: HostSettings) -> dict[str, Any]:
    """Make the argument `allow` of `resume_print`: a check of typed commands by the settings of the print."""
    from printer_slicer.inspection.lint.typed_commands import make_command_check
    from printer_slicer.profile import restore_profile

    return (
        {"allow": make_command_check(restore_profile(setup.settings), setup.allowed)}
        if setup.settings
        else {}
    )


def _list_unfinished_prints(arguments: argparse.Namespace, job_store: Path) -> int:
    """List the unfinished prints, including damaged ones."""
    from printer_slicer.printing.job_store import find_damaged_prints, load_stored_prints
    from printer_slicer.printing.journal import read_journal

    damaged = {damage.folder: damage for damage in find_damaged_prints(job_store)}
    left = [one for one in load_stored_prints(job_store) if one.folder not in damaged and not one.is_locked]
    rows = []
    for one in left:
        journal_data = read_journal(one.folder)
        rows.append(
            {
                "job": one.name,
                "id": one.folder.name,
                "port": one.port,
                "begun": one.begun,
                "accepted": journal_data.entries,
                "reason": journal_data.reason or "the host process ended",
                "damaged": False,
            }
        )
    rows += [
        {"id": folder.name, "reason": str(damage), "remedy": damage.remedy, "damaged": True}
        for folder, damage in damaged.items()
    ]
    if arguments.json:
        print(json.dumps(rows))
    elif not rows:
        print_text(arguments, "no unfinished prints")
    for row in [] if arguments.json else rows:
        text = "{reason}\n  {remedy}" if row["damaged"] else _ROW_FORMAT
        print_text(arguments, text.format_map(row))
    return 0
