"""`control`: control a running print of another process.

An emergency stop takes this path, so this module imports only what it needs.
"""

from __future__ import annotations

import argparse
import json
from typing import Any

from printer_slicer.cli.common import say
from printer_slicer.cli.parsing import Command, Parser, command, output
from printer_slicer.errors import UsageError

__all__ = ["add_control", "control_command", "control_parser"]

_SOON = 2.0  # s, timeout of `control status`


def control_parser() -> argparse.ArgumentParser:
    """Build a parser for `control` only, which is faster than building that of all commands."""
    parser = Parser(prog="printer-slicer", allow_abbrev=False)
    usual: type[argparse.ArgumentParser] = Command
    add_control(parser.add_subparsers(metavar="COMMAND", required=True, parser_class=usual))
    return parser


def add_control(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the parser of `control`."""
    parser = command(
        commands,
        "control",
        "control a running print (pause, cancel, speed, temperature)",
        "  printer-slicer control status\n"
        "  printer-slicer control pause              after the queued moves; also: pause now, pause cold, pause here\n"
        "  printer-slicer control resume\n"
        "  printer-slicer control cancel\n"
        "  printer-slicer control object gear_2      cancel this object\n"
        "  printer-slicer control speed 80           also: flow PERCENT, fan PERCENT, nozzle C, bed C, babystep MM\n"
        "  printer-slicer control say M117 hello\n"
        "  printer-slicer control answer 0           press a button of the printer's prompt\n"
        "  printer-slicer control stop               emergency stop: halt the printer (M112)",
    )
    parser.add_argument("wish", nargs="+", metavar="WORD", help="see the examples")
    parser.add_argument("--job", metavar="NAME", default="", help="name of the print, if several are running")
    output(parser)
    parser.set_defaults(run=control_command)


def control_command(arguments: argparse.Namespace) -> int:
    """Send a command to the process of a print."""
    from printer_slicer.printing.door import ask_door
    from printer_slicer.printing.shelf import default_shelf, find
    from printer_slicer.printing.wishes import Status, read_wish

    line = " ".join(arguments.wish)
    wish = read_wish(line)
    found = find(default_shelf(), arguments.job, running=True)
    answer = ask_door(found.folder, line, **({"patience": _SOON} if isinstance(wish, Status) else {}))
    if not answer["ok"]:
        message, _, remedy = str(answer["answer"]).partition("\n  ")
        raise UsageError(f"{answer['job']}: {message}", remedy=remedy)
    if isinstance(wish, Status):
        answer = {"ok": True, "job": answer["job"], **json.loads(answer["answer"])}
    if arguments.json:
        print(json.dumps(answer))
    elif isinstance(wish, Status):
        say(arguments, _status(answer))
    else:
        say(arguments, f"{answer['job']}: {answer['answer']}")
    return 0


def _status(status: dict[str, Any]) -> str:
    """Format the status for people."""
    waits = f"{status['job']}: waiting for {status.get('waits_for')}"
    if "done" not in status:  # it has not begun
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
