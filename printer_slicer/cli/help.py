"""Help in two tiers: `--help` shows the everyday options, `--help-all` shows every option.

An option is an everyday option unless `mark_advanced` is called when it is added. If the complete help of a command is
short, `--help` shows all of it.
"""

from __future__ import annotations

import argparse
import os
import re
import sys
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from typing import Any, Final

__all__ = [
    "ENVIRONMENT",
    "EXIT_CODES",
    "FILES",
    "SHORT_LINES",
    "HelpAction",
    "HelpFormatter",
    "format_actions",
    "format_help",
    "is_advanced",
    "mark_advanced",
]

SHORT_LINES: Final = 40
"""Maximum number of lines of `--help`."""

_MAX_EXAMPLES: Final = 4  # in `--help`, if it does not show all options
_FLAG: Final = re.compile(r"(?<!\S)--[a-z-]+")
_COLUMNS: Final = 80  # if the output is not a terminal
_LINES_BELOW: Final = 2  # a blank line and the line that names --help-all

FILES: Final = (
    "The file name - stands for stdin: a command can read one model, G-code file or profile from it; such a profile "
    "can inherit only from profiles that are found by name. As an output, - stands for stdout: in -o of slice, draw "
    "and profiles new, in --picture and in --report; contours and profiles schema need a file or folder name. If the "
    "shell does not expand a pattern such as '*.stl', this program does: for models, G-code, profiles check and "
    "profiles import."
)
ENVIRONMENT: Final[Mapping[str, str]] = {
    "NO_COLOR": "no colours, even on a terminal",
    "PRINTER_SLICER_KEY": "key or password for `send` if no --key-file is given",
    "PRINTER_SLICER_PROFILES": "folders with your own profiles, separated as in PATH; empty: none; default: the usual"
    " folder of your platform",
    "PRINTER_SLICER_STATE": "folder with the state of prints, from which they are resumed; default: the usual folder"
    " of your platform",
    "PRINTER_SLICER_GEOMETRY": "set it to `planar` to use the second, slower geometry engine, for comparison",
    "PRINTER_SLICER_KERNEL": "set it to `off` to use no compiled kernel, or to `required` to get an error if there is"
    " none; when this program is installed, too",
    "PRINTER_SLICER_TRACEBACK": "set it to 1 to print a traceback for internal errors",
}
EXIT_CODES: Final[Mapping[str, str]] = {
    "0": "done",
    "1": "internal error, or not enough memory",
    "2": "usage: wrong flag, name, setting or file",
    "3": "the part cannot be sliced",
    "4": "serial port error",
    "5": "print failed",
    "6": "cancelled",
    "7": "verification failed: the print differs from the job, or a check found errors",
}


def format_actions(actions: Mapping[str, str]) -> str:
    """Return the list of the actions of a command, for the end of its help; `actions` has their meanings by name."""
    width = max(map(len, actions)) + 2
    lines = (f"  {name:<{width}}{meaning}" for name, meaning in actions.items())
    return "\n".join(("actions:", *lines))


def mark_advanced(action: argparse.Action) -> argparse.Action:
    """Mark an option as advanced, so that only `--help-all` shows it; return the option."""
    setattr(action, _MARK, True)
    return action


_MARK: Final = "is_advanced"


def is_advanced(action: argparse.Action) -> bool:
    """Return whether an option is shown only in `--help-all`."""
    return bool(getattr(action, _MARK, False))


class HelpAction(argparse.Action):
    """Print the help and exit; `everything` selects the complete help."""

    def __init__(self, option_strings: Sequence[str], dest: str, *, everything: bool, **named: Any) -> None:
        self._everything = everything
        super().__init__(option_strings, dest=dest, default=argparse.SUPPRESS, nargs=0, **named)

    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> None:
        """Print and exit."""
        print(format_help(parser, everything=self._everything), end="")
        parser.exit()


class HelpFormatter(argparse.RawDescriptionHelpFormatter):
    """Formats an option with its value once, as `-o, --output FILE`, and aligns the explanations."""

    def __init__(self, prog: str, **named: Any) -> None:
        # argparse makes a formatter for each argument that is added. Without a width, it imports shutil.
        super().__init__(prog, **{"max_help_position": 26, "width": _find_width()} | named)
        self._action_max_length = 14  # argparse would make the column of commands too narrow

    def _format_action_invocation(self, action: argparse.Action) -> str:
        if not action.option_strings or action.nargs == 0:
            return super()._format_action_invocation(action)
        value = self._format_args(action, self._get_default_metavar_for_optional(action))
        return f"{', '.join(action.option_strings)} {value}"


def _find_width() -> int:
    """Return the width of the help as argparse does: the columns of $COLUMNS, of the terminal, or 80; less 2."""
    columns = 0
    with suppress(KeyError, ValueError):
        columns = int(os.environ["COLUMNS"])
    if columns <= 0:
        with suppress(AttributeError, ValueError, OSError):  # stdout is closed, or is not a terminal
            columns = os.get_terminal_size(sys.__stdout__.fileno()).columns  # type: ignore[union-attr]
    return (columns if columns > 0 else _COLUMNS) - 2


def format_help(parser: argparse.ArgumentParser, *, everything: bool = True) -> str:
    """Return the help of a parser.

    Args:
        parser: parser of a command or of the program; its `examples` and `ending` follow the options.
        everything: whether to include advanced options and all examples; if not, at most `SHORT_LINES` lines.
    """
    examples: list[str] = getattr(parser, "examples", "").splitlines()
    ending: str = getattr(parser, "ending", "")

    def format_with_examples(examples: Sequence[str], is_shown: Callable[[argparse.Action], bool]) -> str:
        """Return the help with examples, and with the options to show."""
        formatter = parser._get_formatter()  # noqa: SLF001 - argparse has no other way to format part of a parser
        formatter.add_usage(parser.format_usage().removeprefix("usage: ").strip().replace("%", "%%"), [], [])
        formatter.add_text(parser.description)
        for group in parser._action_groups:  # noqa: SLF001
            formatter.start_section(group.title)
            formatter.add_text(group.description)
            formatter.add_arguments([one for one in group._group_actions if is_shown(one)])  # noqa: SLF001
            formatter.end_section()
        formatter.add_text(parser.epilog)
        formatter.add_text("\n".join(["examples:", *examples]) if examples else None)
        formatter.add_text(ending or None)
        return formatter.format_help()

    complete = format_with_examples(examples, lambda _: True) + getattr(parser, "appendix", "")
    if everything or complete.count("\n") <= SHORT_LINES:
        return complete
    examples = _choose_examples(parser, examples)
    lines = format_with_examples(examples[:1], lambda one: not is_advanced(one)).count("\n")
    room = SHORT_LINES - _LINES_BELOW - lines + 1
    short = format_with_examples(
        examples[: min(max(room, 1), _MAX_EXAMPLES)], lambda one: not is_advanced(one)
    )
    return f"{short}\nAll options: {parser.prog} --help-all\n"


def _choose_examples(parser: argparse.ArgumentParser, examples: list[str]) -> list[str]:
    """Return the examples without advanced options, or all examples if each has some."""
    hidden = {flag for one in parser._actions if is_advanced(one) for flag in one.option_strings}  # noqa: SLF001
    return [line for line in examples if hidden.isdisjoint(_FLAG.findall(line))] or examples
