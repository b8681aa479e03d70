"""How a command of the command line is declared."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from importlib import import_module

__all__ = ["Command", "command", "later", "output"]


def later(module: str, function: str) -> Callable[[argparse.Namespace], int]:
    """A function that imports its module when it is called."""

    def run(arguments: argparse.Namespace) -> int:
        """Import it, and call it."""
        return int(getattr(import_module(f"printer_slicer.cli.{module}"), function)(arguments))

    return run


class Command(argparse.ArgumentParser):
    """A parser whose usage names what must be typed; what may be typed stands in the help."""

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
) -> argparse.ArgumentParser:
    """A command with its help and examples."""
    return commands.add_parser(
        name,
        help=meaning,
        description=meaning[0].upper() + meaning[1:] + ".",
        epilog=f"examples:\n{examples}",
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )


def output(parser: argparse.ArgumentParser) -> None:
    """Flags that decide how results are said."""
    group = parser.add_argument_group("output")
    group.add_argument("--json", action="store_true", help="machine-readable result on stdout")
    group.add_argument("-q", "--quiet", action="store_true", help="only errors")
    group.add_argument("-v", "--verbose", action="store_true", help="more about what happens")
