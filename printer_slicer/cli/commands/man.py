"""`man`: print the manual page; this module also makes the page of the documentation. Both come from the parser."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Mapping, Sequence
from typing import Final

from printer_slicer.cli.help import ENVIRONMENT, EXIT_CODES, FILES
from printer_slicer.cli.parser import CommandParser, build_parser
from printer_slicer.version import VERSION

__all__ = ["EXAMPLES", "add_arguments", "format_man_page", "format_markdown_page", "run"]

EXAMPLES: Final = """\
  printer-slicer man | man -l -
  printer-slicer man > ~/.local/share/man/man1/printer-slicer.1     then: man printer-slicer"""


def add_arguments(_: argparse.ArgumentParser) -> None:
    """Add no arguments, because `man` has none."""


def run(_: argparse.Namespace) -> int:
    """Print the manual page."""
    sys.stdout.write(format_man_page())
    return 0


def format_man_page() -> str:
    """Format the manual page in the language of groff's man macros."""
    from argparse_manpage.manpage import Manpage

    parser = build_parser()
    (commands,) = (one for one in parser._actions if isinstance(one, argparse._SubParsersAction))  # noqa: SLF001
    known = dict(_iterate_commands(parser))
    commands.choices.clear()
    commands.choices.update(known)  # `profiles import` counts as a command
    commands._choices_actions.clear()  # noqa: SLF001 - the descriptions say the same
    for command in known.values():  # the library has no place for the examples of commands
        command.description = f"{command.description}\n.PP\n.nf\n{_format_epilog(command)}\n.fi"
    examples = _get_examples(parser)
    facts = {"project_name": parser.prog, "version": VERSION, "manual_title": "User Commands"}
    page = Manpage(
        parser, facts | {"description": _format_description(parser)}, format="single-commands-section"
    )
    page.date = ""
    page.add_section("examples", "=", f".nf\n{examples}\n.fi")
    page.add_section("exit status", "=", _format_roff_table(EXIT_CODES))
    page.add_section("environment", "=", _format_roff_table(ENVIRONMENT))
    page.add_section("files", "=", FILES)
    return str(page)


def _format_epilog(parser: argparse.ArgumentParser) -> str:
    """Format the text below the options in the help of a command: its epilog and its examples."""
    return "\n\n".join(filter(None, [parser.epilog, f"examples:\n{_get_examples(parser)}"]))


def _get_examples(parser: argparse.ArgumentParser) -> str:
    return str(getattr(parser, "examples", "")).rstrip("\n")


def _format_roff_table(rows: Mapping[str, str]) -> str:
    return "\n".join(f".TP\n.B {_escape_roff(name)}\n{_escape_roff(text)}" for name, text in rows.items())


def _escape_roff(text: str) -> str:
    return text.replace("-", "\\-")


def _iterate_commands(parser: argparse.ArgumentParser) -> Iterator[tuple[str, argparse.ArgumentParser]]:
    """Yield name and parser of every command, in the order of the help."""
    for action in parser._actions:  # noqa: SLF001 - argparse has no other list
        if isinstance(action, argparse._SubParsersAction):  # noqa: SLF001
            for name, made in action.choices.items():
                yield name, made
                for word, below in made.below.items() if isinstance(made, CommandParser) else ():
                    yield f"{name} {word}", below


# For the documentation


def format_markdown_page() -> str:
    """Format the page about the command line for the documentation, in Markdown."""
    parser = build_parser()
    commands = dict(_iterate_commands(parser))
    index = [
        (f"[`{name}`](#{name.replace(' ', '-')})", _format_description(made))
        for name, made in commands.items()
    ]
    lines = ["# Command line", "", str(parser.description), "", FILES, "", *_format_table(index)]
    for name, below in commands.items():
        usage = below.format_usage().removeprefix("usage: ").strip().replace("\n", " ")
        lines += ["", f"## {name}", "", str(below.description), "", "```text", usage, "```"]
        for title, actions in _iterate_groups(below):
            lines += ["", f"**{title}**", ""]
            lines += _format_table(
                [(f"`{_format_argument(action)}`", _format_meaning(action)) for action in actions]
            )
        lines += ["", "```text", _format_epilog(below), "```"]
    for title, rows in (("Exit codes", EXIT_CODES), ("Environment", ENVIRONMENT)):
        lines += ["", f"## {title}", "", *_format_table([(f"`{name}`", text) for name, text in rows.items()])]
    return "\n".join(lines) + "\n"


def _format_description(parser: argparse.ArgumentParser) -> str:
    """Format the description of a parser for a list, without capital letter and full stop."""
    text = str(parser.description)
    return text[0].lower() + text[1:].removesuffix(".")


def _iterate_groups(parser: argparse.ArgumentParser) -> Iterator[tuple[str, list[argparse.Action]]]:
    """Yield (title, arguments) of the argument groups of a parser, without the options for help."""
    for group in parser._action_groups:  # noqa: SLF001
        own = [action for action in group._group_actions if action.dest not in ("help", "help_all")]  # noqa: SLF001
        if own:
            yield str(group.title), own


def _format_argument(action: argparse.Action) -> str:
    """Format an argument as it is typed."""
    what = action.metavar or action.dest.upper()
    shown = " ".join(what) if isinstance(what, tuple) else str(what)
    if action.choices is not None and not action.metavar:
        shown = "|".join(map(str, action.choices))
    flags = ", ".join(action.option_strings)
    if action.nargs == 0:
        return flags
    return f"{flags} {shown}".strip()


def _format_meaning(action: argparse.Action) -> str:
    """Format the help of an argument."""
    return str(action.help or "").replace("%%", "%")


def _format_table(rows: Sequence[tuple[str, str]]) -> list[str]:
    """Format a Markdown table with two columns and an empty header row."""
    cells = [tuple(cell.replace("|", "\\|").replace("<", "&lt;") for cell in row) for row in rows]
    return ["| | |", "|---|---|", *(f"| {name} | {text} |" for name, text in cells)]
