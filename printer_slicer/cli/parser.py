"""The parser of the command line. Only the command that is asked for has arguments; of the others it knows the name."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Collection, Iterable, Mapping
from importlib import import_module
from typing import Any, Final, NoReturn

from printer_slicer.cli.arguments import attached
from printer_slicer.errors import UsageError
from printer_slicer.version import VERSION

__all__ = ["COMMANDS", "CommandParser", "build_parser", "declare"]

COMMANDS: Final[Mapping[str, str]] = {
    "slice": "make G-code from a part",
    "plan": "compare layer plans for a part",
    "contours": "write the contours of a part for other machines: SVG, CLI, SLC",
    "check": "look at G-code of any slicer before it is printed: what it holds, its material, the link",
    "draw": "draw one layer of any slicer's G-code from above, every bead as wide as it is laid",
    "dry-run": "print on a simulated printer, in seconds, and say what would happen",
    "print": "print over a serial port",
    "resume": "go on with a print that was broken off",
    "control": "control a running print (pause, cancel, speed, temperature)",
    "console": "talk to a printer: type G-code, read its answers",
    "sim": "serve the simulated printer on a pseudo-terminal or over TCP until interrupted",
    "send": "upload G-code to a printer on the network",
    "ports": "list the serial ports",
    "doctor": "look for what keeps a printer from being printed to",
    "profiles": "find, look at, check and begin profiles",
    "completion": "teach a shell to complete commands, flags, profiles and settings",
    "man": "write the manual page",
}
"""Name -> meaning, in the order of the help."""

_EXAMPLES = """\
examples:
  printer-slicer slice part.stl                      write part.gcode
  printer-slicer slice part.stl --quality adaptive   thick layers where the shape allows, thin ones elsewhere
  printer-slicer plan part.stl --picture plan.svg    compare layer plans, draw the chosen one
  printer-slicer check part.gcode --model part.stl   hold any slicer's G-code against the part
  printer-slicer draw part.gcode --layer 12 -o layer.svg   draw a layer of any slicer's G-code
  printer-slicer dry-run part.stl                    print it on a simulated printer and say what would happen
  printer-slicer print part.stl --port sim:          the same over the serial protocol, line by line
  printer-slicer ports                               which serial ports there are
  printer-slicer print part.stl --port /dev/ttyUSB0  print it
  printer-slicer control pause                       have a wish for a running print
  printer-slicer resume                              go on with a print that was broken off

exit codes: 0 done, 2 usage, 3 the part cannot be sliced, 4 the port, 5 print failed, 6 cancelled, 7 verification failed
"""


def build_parser(asked: Collection[str] = tuple(COMMANDS)) -> argparse.ArgumentParser:
    """Build the parser of the command line; `run` in its result is the function to call.

    Args:
        asked: the commands whose modules are imported and whose arguments are added.
    """
    parser = _TopParser(
        prog="printer-slicer",
        description="Slice a part with adaptive layer heights, check any G-code, print it over USB, or dry-run it.",
        epilog=_EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    parser.add_argument("--version", action=_Version, nargs=0, help="show the version and stop")
    usual: type[argparse.ArgumentParser] = CommandParser
    commands = parser.add_subparsers(metavar="COMMAND", required=True, parser_class=usual, title="commands")
    for name, meaning in COMMANDS.items():
        command = commands.add_parser(
            name,
            help=meaning,
            description=meaning[0].upper() + meaning[1:] + ".",
            formatter_class=argparse.RawDescriptionHelpFormatter,
            allow_abbrev=False,
        )
        if name in asked:
            declare(command, name)
    return parser


def declare(parser: argparse.ArgumentParser, name: str) -> None:
    """Import the module of a command, and add its arguments, examples and run."""
    module = import_module(f"printer_slicer.cli.commands.{name.replace('-', '_').replace(' ', '_')}")
    parser.epilog = f"examples:\n{module.EXAMPLES}"
    module.add_arguments(parser)
    parser.set_defaults(run=module.run)


class _Parser(argparse.ArgumentParser):
    """A parser whose refusals are errors as all others, with what is near and what to do."""

    def error(self, message: str) -> NoReturn:
        """Refuse what was typed."""
        flags = [flag for action in self._actions for flag in action.option_strings]
        _, unknown, typed = message.partition("unrecognized arguments: ")
        words = typed.split()
        flag = next((word.partition("=")[0] for word in words if word.startswith("-")), "")
        problem = message.removeprefix("argument ").replace(
            "expected one argument", "a value belongs behind it"
        )
        if unknown:
            problem = f"{flag}: no such flag" if flag else f"{words[0]}: nothing is expected there"
        usage = f"{_near(flag, flags)}{self.format_usage().strip()}; {self.prog} --help tells all"
        raise UsageError(": ".join(filter(None, (self.prog.partition(" ")[2], problem))), remedy=usage)

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        """Whether it is one of the choices; the library's own message offers nothing near."""
        if action.choices is not None and value not in action.choices:
            known = list(map(str, action.choices))
            remedy = f"{_near(str(value), known)}choose one of: {', '.join(known)}"
            raise argparse.ArgumentError(action, f"there is no {value!r}; {remedy}")

    def _print_message(self, message: str, file: Any = None) -> None:
        """Say it; a stdout that takes nothing is told of by who calls."""
        (file or sys.stderr).write(message)


def _near(word: str, known: Iterable[str]) -> str:
    from difflib import get_close_matches

    near = get_close_matches(word, list(known), n=1) if word else []
    return f"did you mean {near[0]!r}? " if near else ""


class CommandParser(_Parser):
    """A parser whose usage names what must be typed; what may be typed stands in the help.

    Attributes:
        below: first words behind which another parser reads.
    """

    below: Mapping[str, CommandParser] = {}

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """As the class it comes from; what is not known is refused here, where the flags are that it may have meant."""
        if args and args[0] in self.below:
            return self.below[args[0]].parse_known_args(args[1:], namespace)
        found, unknown = super().parse_known_args(args, namespace)
        if unknown:
            self.error(f"unrecognized arguments: {' '.join(unknown)}")
        return found, unknown

    def format_usage(self) -> str:
        """The first line of the help, and what comes before errors."""
        self.usage = self.usage or _short(self)
        return super().format_usage()

    def format_help(self) -> str:
        """The help."""
        self.usage = self.usage or _short(self)
        return super().format_help()


def _short(parser: argparse.ArgumentParser) -> str:
    """Name, options that are required, and what stands without flags."""
    words = [parser.prog, "[options]"]
    for action in parser._actions:  # noqa: SLF001 - argparse has no other list
        what = action.metavar or action.dest.upper()
        shown = " ".join(what) if isinstance(what, tuple) else what
        if action.option_strings:
            words += [f"{action.option_strings[0]} {shown}"] if action.required else []
        else:
            more = {"+": f"{shown} [{shown} ...]", "?": f"[{shown}]", "*": f"[{shown} ...]"}
            words.append(more.get(str(action.nargs), shown))
    return " ".join(words).replace("%", "%%")


class _TopParser(_Parser):
    """Takes `--rotate -90,0,0` as it is meant."""

    def parse_known_args(self, args=None, namespace=None):  # type: ignore[no-untyped-def]
        """As the class it comes from, which takes every word with a minus sign for a flag."""
        return super().parse_known_args(attached(sys.argv[1:] if args is None else args), namespace)


class _Version(argparse.Action):
    """Says the version."""

    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> None:
        print(f"printer-slicer {VERSION}")
        parser.exit()
