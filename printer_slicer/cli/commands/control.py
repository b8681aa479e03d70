"""`control`: control a print that another process runs.

An emergency stop is sent by this module, so it imports only what it needs.
"""

from __future__ import annotations

import argparse
import json
import sys
from typing import Any, Final

from printer_slicer.cli.arguments import add_output_options
from printer_slicer.cli.output import print_text
from printer_slicer.errors import UsageError

__all__ = ["EXAMPLES", "add_arguments", "run"]

EXAMPLES: Final = """\
  printer-slicer control status
  printer-slicer control pause              after the queued moves; also: pause now, pause cold, pause here
  printer-slicer control resume
  printer-slicer control cancel
  printer-slicer control object gear_2      cancel this object
  printer-slicer control speed 80           also: flow PERCENT, fan PERCENT, nozzle C, bed C, babystep MM
  printer-slicer control say M117 hello
  printer-slicer control answer 0           press a button of the printer's prompt
  printer-slicer control abort              emergency stop: halt the printer (M112)"""
_FORMER_NAME: Final = (
    "printer-slicer: warning: 'control stop' is now 'control abort'; 'control cancel' ends a print without halting "
    "the printer"
)
_STATUS_TIMEOUT = 2.0  # s, timeout of `control status`


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `control`."""
    parser.add_argument("words", nargs="+", metavar="COMMAND", help="command and its value; see the examples")
    parser.add_argument(
        "--job", metavar="NAME", default="", help="name of the print; required if several are running"
    )
    add_output_options(parser)


def run(arguments: argparse.Namespace) -> int:
    """Send a command to the process that runs a print, and print its answer."""
    from printer_slicer.printing.commands import FORMER_ABORT, Status, parse_command
    from printer_slicer.printing.control_socket import raise_if_rejected, send_control_command
    from printer_slicer.printing.job_store import default_job_store, find_print

    line = " ".join(arguments.words)
    command = parse_command(line)
    found = find_print(default_job_store(), arguments.job, running=True)
    answer = send_control_command(
        found.folder, line, **({"timeout": _STATUS_TIMEOUT} if isinstance(command, Status) else {})
    )
    try:
        raise_if_rejected(answer)
    except UsageError as error:
        raise UsageError(f"{answer['job']}: {error.args[0]}", remedy=error.remedy) from None
    if isinstance(command, Status):
        answer = {"ok": True, "job": answer["job"], **json.loads(answer["answer"])}
    if arguments.json:
        print(json.dumps(answer))
    elif isinstance(command, Status):
        print_text(arguments, _format_status(answer))
    else:
        print_text(arguments, f"{answer['job']}: {answer['answer']}")
    if arguments.words[0].lower() == FORMER_ABORT:
        print(_FORMER_NAME, file=sys.stderr)
    return 0


def _format_status(status: dict[str, Any]) -> str:
    """Format the status of a print as lines of text."""
    waits = f"{status['job']}: waiting for {status.get('waits_for')}"
    if "done" not in status:  # it has not started
        return waits
    heat = ", ".join(
        f"{name} {actual:g}" + (f"/{target:g}" if target else "")
        for name, (actual, target) in status["temperatures"].items()
    )
    lines = [waits] if "waits_for" in status else []
    lines += [f"{status['job']}: {status['state']}, {status['done']} of {status['total']} commands"]
    lines += [f"{heat} °C"] if heat else []
    lines.append(f"speed {status['speed_percent']:g} %, flow {status['flow_percent']:g} %")
    if status["objects"]:
        cancelled = set(status["cancelled"])
        lines.append(
            "objects: " + ", ".join(n + (" (cancelled)" if n in cancelled else "") for n in status["objects"])
        )
    if status["prompt"]:
        buttons = ", ".join(f"{number} {text}" for number, text in enumerate(status["prompt"]["buttons"]))
        lines.append(f"the printer asks: {status['prompt']['text']} [{buttons}]")
    return "\n".join(lines)
