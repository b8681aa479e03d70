"""Build the parser of the command line; only the module of the command that is typed is imported."""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Collection, Mapping, Sequence
from importlib import import_module
from typing import Any, Final, NoReturn, cast

from printer_slicer.cli.arguments import attach_values
from printer_slicer.cli.help import (
    ENVIRONMENT,
    EXIT_CODES,
    FILES,
    HelpAction,
    HelpFormatter,
    format_help,
    mark_advanced,
)
from printer_slicer.cli.suggestions import suggest, suggest_command, suggest_option
from printer_slicer.errors import UsageError
from printer_slicer.version import VERSION

__all__ = ["COMMANDS", "CommandParser", "add_command", "build_parser"]

COMMANDS: Final[Mapping[str, str]] = {
    "slice": "make G-code from models",
    "batch": "slice many models with many settings, in several processes",
    "arrange": "arrange models on plates, as 3MF files",
    "print": "print over a serial port",
    "dry-run": "print on the simulated printer and report errors",
    "check": "analyse G-code of any slicer, and compare it with its model",
    "draw": "draw a layer of any slicer's G-code",
    "view": "write a web page that shows the layers and moves of any slicer's G-code",
    "plan": "compare layer plans for a part",
    "orient": "compare the ways in which a part may be turned",
    "contours": "export the contours of a part as SVG, CLI or SLC",
    "profiles": "list, show, compare, create and import profiles",
    "send": "upload G-code to a printer on the network",
    "queue": "queue G-code for one or several printers",
    "serve": "serve a web page, the queue, and uploads from slicers",
    "control": "control a running print (pause, cancel, speed, ...)",
    "resume": "resume an interrupted print",
    "ports": "list the serial ports",
    "doctor": "diagnose connection problems",
    "console": "send G-code to a printer interactively",
    "sim": "run the simulated printer as a server",
    "completion": "print the completion script for your shell",
    "man": "print the manual page",
}
"""Name of a command -> description, in the order of the help."""

_EXAMPLES: Final = """\
  printer-slicer slice part.stl --printer prusa_mk4   write part.gcode
  printer-slicer slice part.stl --quality adaptive   thin layers only where the shape needs them
  printer-slicer dry-run part.stl                    print it on the simulated printer
  printer-slicer print part.stl --port /dev/ttyUSB0  print it
  printer-slicer ports                               list the serial ports
  printer-slicer plan part.stl --picture plan.svg    compare layer plans and draw the chosen one
  printer-slicer check part.gcode --model part.stl   compare any slicer's G-code with the part
  printer-slicer draw part.gcode --layer 12 -o layer.svg   draw a layer of any slicer's G-code
  printer-slicer view part.gcode --open              show its layers and moves in the browser
  printer-slicer print part.stl --port sim:          print over the serial protocol to the simulated printer
  printer-slicer control pause                       pause a running print
  printer-slicer resume                              resume an interrupted print
"""
_OPTION: Final = re.compile(r"--?[A-Za-z]\S*")
_ENDING: Final = """\
exit codes: 0 done, 2 usage, 3 the part cannot be sliced, 4 serial port,
5 print failed, 6 cancelled, 7 verification failed
options of a command: printer-slicer COMMAND --help
"""


def build_parser(
    names: Collection[str] = tuple(COMMANDS), *, with_others: bool = True
) -> argparse.ArgumentParser:
    """Build the parser of the command line; the attribute `run` of the parsed arguments is the function to call.

    Args:
        names: the commands whose modules are imported and whose arguments are added.
        with_others: whether the other commands have parsers, too; listing and suggesting them needs none.
    """
    parser = _TopParser(
        prog="printer-slicer",
        usage="printer-slicer COMMAND [options]",
        description="Slice parts with uniform or adaptive layer heights, check G-code, and print it.",
    )
    mark_advanced(
        parser.add_argument("--version", action=_VersionAction, nargs=0, help="show the version and exit")
    )

    def make_parser(prog: str, **named: Any) -> CommandParser | None:
        """Make the parser of a command, if it is wanted."""
        is_wanted = with_others or prog.removeprefix(f"{parser.prog} ") in names
        return CommandParser(prog=prog, **named) if is_wanted else None

    commands = parser.add_subparsers(
        metavar="COMMAND",
        required=True,
        parser_class=cast(type[argparse.ArgumentParser], make_parser),
        title="commands",
        prog=parser.prog,
    )
    for name, meaning in COMMANDS.items():
        command = commands.add_parser(
            name,
            prog=f"{parser.prog} {name}",
            help=meaning,
            description=meaning[0].upper() + meaning[1:] + ".",
        )
        if name in names:
            add_command(command, name)
    return parser


def add_command(parser: argparse.ArgumentParser, name: str) -> None:
    """Import the module of a command, and add its arguments, its examples and its function `run` to a parser."""
    module = import_module(f"printer_slicer.cli.commands.{name.replace('-', '_').replace(' ', '_')}")
    assert isinstance(parser, _Parser)
    parser.examples = module.EXAMPLES
    module.add_arguments(parser)
    parser.set_defaults(run=module.run)


class _Parser(argparse.ArgumentParser):
    """A parser with help in two tiers, which raises usage errors that suggest the intended option or command.

    Attributes:
        examples: lines for the help, of the form `  COMMAND LINE   explanation`.
        ending: text below the examples.
    """

    examples: str = ""
    ending: str = ""

    def __init__(self, **named: Any) -> None:
        common: dict[str, Any] = {"formatter_class": HelpFormatter, "allow_abbrev": False, "add_help": False}
        super().__init__(**common | named)
        mark_advanced(
            self.add_argument(
                "-h", "--help", action=HelpAction, everything=False, help="show the everyday options and exit"
            )
        )
        mark_advanced(
            self.add_argument(
                "--help-all", action=HelpAction, everything=True, help="show all options and exit"
            )
        )

    def error(self, message: str) -> NoReturn:
        """Raise a usage error instead of exiting."""
        problem = message.removeprefix("argument ").replace("expected one argument", "needs a value")
        self._raise_usage_error(problem)

    def reject_unknown_words(self, words: Sequence[str]) -> NoReturn:
        """Raise a usage error about the first unknown option; without one, about the first unexpected argument."""
        flag = next((word.partition("=")[0] for word in words if word.startswith("-")), "")
        flags = [flag for action in self._actions for flag in action.option_strings]
        arguments = [str(action.metavar) for action in self._actions if not action.option_strings]
        if not flag:
            self._raise_usage_error(f"{words[0]}: unexpected argument")
        self._raise_usage_error(f"{flag}: no such option", suggest_option(flag, flags, arguments))

    def _raise_usage_error(self, problem: str, hint: str = "") -> NoReturn:
        """Raise a usage error with the name of the command, a hint and the usage line."""
        usage = f"{hint}{self.format_usage().strip()}; see {self.prog} --help"
        raise UsageError(": ".join(filter(None, (self.prog.partition(" ")[2], problem))), remedy=usage)

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        """Reject a value that is not one of the choices, and suggest the most similar choice."""
        if action.choices is not None and value not in action.choices:
            known = list(map(str, action.choices))
            listed = f"choose one of: {', '.join(known)}"
            if isinstance(action, argparse._SubParsersAction):  # noqa: SLF001 - the library has no public name
                hint = suggest_command(str(value), known) or f"{listed[0].upper()}{listed[1:]}; "
                remedy = f"{hint}{self.format_usage().strip()}; see {self.prog} --help"
                raise UsageError(f"{value!r}: no such command", remedy=remedy)
            raise argparse.ArgumentError(action, f"unknown: {value!r}; {suggest(str(value), known)}{listed}")

    def _print_message(self, message: str, file: Any = None) -> None:
        """Print a message; the caller handles errors of stdout."""
        (file or sys.stderr).write(message)

    def format_help(self) -> str:
        """Return the complete help."""
        return format_help(self)


class CommandParser(_Parser):
    """A parser of one command; its usage line names only required options.

    Attributes:
        below: first argument -> the parser for the arguments after it, such as that of `profiles import`.
    """

    below: Mapping[str, CommandParser] = {}

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """Parse, and reject unknown words here, where the options to suggest are known."""
        if args and args[0] in self.below:
            return self.below[args[0]].parse_known_args(args[1:], namespace)
        try:
            found, unknown = super().parse_known_args(args, namespace)
        except UsageError:  # such as a missing argument, because its option is misspelt
            if unknown := self._find_unknown_options(args or ()):
                self.reject_unknown_words(unknown)
            raise
        if unknown:
            self.reject_unknown_words(unknown)
        return found, unknown

    def _find_unknown_options(self, args: Sequence[str]) -> list[str]:
        """Return the unknown options among the arguments of a command."""
        words = args[: args.index("--")] if "--" in args else args
        known = self._option_string_actions
        flags = [word for word in words if _OPTION.fullmatch(word)]
        return [one for one in flags if one.partition("=")[0] not in known and one[:2] not in known]

    def format_usage(self) -> str:
        """Return the usage line."""
        self.usage = self.usage or _format_short_usage(self)
        return super().format_usage()


def _format_short_usage(parser: argparse.ArgumentParser) -> str:
    """Format the command with its required options and positional arguments."""
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
    """The parser of the program; it accepts values that begin with a minus sign, such as `--rotate -90,0,0`."""

    examples = _EXAMPLES
    ending = _ENDING

    @property
    def appendix(self) -> str:
        """Text at the end of the complete help: exit codes, environment variables and files."""
        tables = {"exit codes": EXIT_CODES, "environment variables": ENVIRONMENT}
        rows = [
            f"\n{title}:\n" + "".join(f"  {name:<26}{text}\n" for name, text in table.items())
            for title, table in tables.items()
        ]
        return "".join(rows) + f"\nfiles:\n  {FILES}\n"

    def parse_known_args(self, args=None, namespace=None):  # type: ignore[no-untyped-def]
        """Parse with values that begin with a minus sign joined to their options."""
        return super().parse_known_args(attach_values(sys.argv[1:] if args is None else args), namespace)


class _VersionAction(argparse.Action):
    """Action of --version: prints the version, and whether the compiled kernel is used, and exits."""

    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> None:
        from printer_slicer.kernel import describe_kernel

        print(f"printer-slicer {VERSION}")
        print(f"compiled kernel: {describe_kernel()}")
        parser.exit()
