"""`control`: wishes for a print that another process runs.

An emergency stop comes this way, so nothing is imported here that it does without.
"""

from __future__ import annotations

import argparse
import json
from typing import Any

from printer_slicer.cli.common import say
from printer_slicer.cli.parsing import Command, Parser, command, output
from printer_slicer.errors import UsageError

__all__ = ["add_control", "control_command", "control_parser"]

_SOON = 2.0  # s within which one learns how a print stands


def control_parser() -> argparse.ArgumentParser:
    """The command line as far as `control` goes, which is built sooner than that of all commands."""
    parser = Parser(prog="printer-slicer", allow_abbrev=False)
    usual: type[argparse.ArgumentParser] = Command
    add_control(parser.add_subparsers(metavar="COMMAND", required=True, parser_class=usual))
    return parser


def add_control(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """`control`."""
    parser = command(
        commands,
        "control",
        "have a wish for a print that another process runs",
        "  printer-slicer control status\n"
        "  printer-slicer control pause              behind the planned moves; pause now, pause cold, pause here\n"
        "  printer-slicer control resume\n"
        "  printer-slicer control cancel\n"
        "  printer-slicer control object gear_2      print no more of this one\n"
        "  printer-slicer control speed 80           also: flow PERCENT, fan PERCENT, nozzle C, bed C, babystep MM\n"
        "  printer-slicer control say M117 hello\n"
        "  printer-slicer control answer 0           press a button of the printer's question\n"
        "  printer-slicer control stop               emergency: the printer halts",
    )
    parser.add_argument("wish", nargs="+", metavar="WORD", help="see the examples")
    parser.add_argument("--job", metavar="NAME", default="", help="which print, if more than one runs")
    output(parser)
    parser.set_defaults(run=control_command)


def control_command(arguments: argparse.Namespace) -> int:
    """Send a wish to the process that prints."""
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
    """The status in words."""
    waits = f"{status['job']}: waits for {status.get('waits_for')}"
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
        given_up = set(status["cancelled"])
        lines.append(
            "objects: " + ", ".join(n + (" (given up)" if n in given_up else "") for n in status["objects"])
        )
    if status["prompt"]:
        buttons = ", ".join(f"{number} {text}" for number, text in enumerate(status["prompt"]["buttons"]))
        lines.append(f"the printer asks: {status['prompt']['text']} [{buttons}]")
    return "\n".join(lines)
