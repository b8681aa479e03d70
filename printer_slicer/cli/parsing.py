"""How a command of the command line is declared."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterable, Mapping
from difflib import get_close_matches
from importlib import import_module
from typing import Any, NoReturn

from printer_slicer.errors import UsageError

__all__ = ["Command", "Parser", "command", "later", "output"]


def later(module: str, function: str) -> Callable[[argparse.Namespace], int]:
    """A function that imports its module when it is called."""

    def run(arguments: argparse.Namespace) -> int:
        """Import it, and call it."""
        return int(getattr(import_module(f"printer_slicer.cli.{module}"), function)(arguments))

    return run


class Parser(argparse.ArgumentParser):
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
    near = get_close_matches(word, list(known), n=1) if word else []
    return f"did you mean {near[0]!r}? " if near else ""


class Command(Parser):
    """A parser whose usage names what must be typed; what may be typed stands in the help.

    Attributes:
        below: first words behind which another parser reads.
    """

    below: Mapping[str, Command] = {}

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


def command(
    commands: argparse._SubParsersAction[argparse.ArgumentParser], name: str, meaning: str, examples: str
) -> Command:
    """A command with its help and examples."""
    made = commands.add_parser(
        name,
        help=meaning,
        description=meaning[0].upper() + meaning[1:] + ".",
        epilog=f"examples:\n{examples}",
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    assert isinstance(made, Command)
    return made


def output(parser: argparse.ArgumentParser) -> None:
    """Flags that decide how results are said."""
    group = parser.add_argument_group("output")
    group.add_argument("--json", action="store_true", help="machine-readable result on stdout")
    group.add_argument("-q", "--quiet", action="store_true", help="only errors")
    group.add_argument("-v", "--verbose", action="store_true", help="more about what happens")
