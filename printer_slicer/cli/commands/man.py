"""`man`: the manual page, made from the parser; the page of the site too."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Mapping, Sequence
from typing import Final

from printer_slicer.cli.parser import CommandParser, build_parser
from printer_slicer.version import VERSION

__all__ = ["EXAMPLES", "add_arguments", "as_man", "as_markdown", "run"]

EXAMPLES: Final = """\
  printer-slicer man | man -l -
  printer-slicer man > ~/.local/share/man/man1/printer-slicer.1     then: man printer-slicer"""
_FILES: Final = (
    "A model, G-code or a profile named - is stdin, once in a command; such a profile inherits by name. -o - of slice, "
    "draw and profiles new, --picture - and --report - are stdout; contours and schemas need names. Patterns such as "
    "'*.stl' are expanded where the shell did not: those of models, G-code, profiles check and profiles import."
)
_ENVIRONMENT: Final = {
    "NO_COLOR": "no colours, even on a terminal",
    "PRINTER_SLICER_KEY": "key or password for `send`, where no --key-file is given",
    "PRINTER_SLICER_PROFILES": "folders of your own profiles, in place of the platform's; separated as in PATH; empty:"
    " none",
    "PRINTER_SLICER_STATE": "folder for what must be known to go on with a print; default: the system's place for it",
    "PRINTER_SLICER_GEOMETRY": "`planar` takes the second engine for areas, slower, to compare with",
    "PRINTER_SLICER_TRACEBACK": "shows where an internal error happened",
}
_CODES: Final = {
    "0": "done",
    "1": "internal error, or not enough memory",
    "2": "usage: a flag, a name, a setting, a file",
    "3": "the part cannot be sliced",
    "4": "the port",
    "5": "the print failed",
    "6": "cancelled",
    "7": "verification failed: what was or would be printed is not what was asked for",
}


def add_arguments(_: argparse.ArgumentParser) -> None:
    """`man` has no arguments."""


def run(_: argparse.Namespace) -> int:
    """Write the manual page."""
    sys.stdout.write(as_man())
    return 0


def as_man() -> str:
    """The page in the language of groff's man macros, by argparse-manpage."""
    from argparse_manpage.manpage import Manpage

    parser = build_parser()
    (commands,) = (one for one in parser._actions if isinstance(one, argparse._SubParsersAction))  # noqa: SLF001
    known = dict(_commands(parser))
    commands.choices.clear()
    commands.choices.update(known)  # `profiles import` like a command of its own
    commands._choices_actions.clear()  # noqa: SLF001 - what these say stands in the descriptions
    for command in known.values():  # of these the library has no place for examples
        command.description = f"{command.description}\n.PP\n.nf\n{command.epilog}\n.fi"
    examples, parser.epilog = str(parser.epilog).partition("\n\nexit codes")[0].partition("\n")[2], None
    facts = {"project_name": parser.prog, "version": VERSION, "manual_title": "User Commands"}
    page = Manpage(parser, facts | {"description": _lower(parser)}, format="single-commands-section")
    page.date = ""
    page.add_section("examples", "=", f".nf\n{examples}\n.fi")
    page.add_section("exit status", "=", _roff_table(_CODES))
    page.add_section("environment", "=", _roff_table(_ENVIRONMENT))
    page.add_section("files", "=", _FILES)
    return str(page)


def _roff_table(rows: Mapping[str, str]) -> str:
    return "\n".join(f".TP\n.B {_roff(name)}\n{_roff(text)}" for name, text in rows.items())


def _roff(text: str) -> str:
    return text.replace("-", "\\-")


def _commands(parser: argparse.ArgumentParser) -> Iterator[tuple[str, argparse.ArgumentParser]]:
    """Name and parser of every command, in the order of the help."""
    for action in parser._actions:  # noqa: SLF001 - argparse has no other list
        if isinstance(action, argparse._SubParsersAction):  # noqa: SLF001
            for name, made in action.choices.items():
                yield name, made
                for word, below in made.below.items() if isinstance(made, CommandParser) else ():
                    yield f"{name} {word}", below


# For the site


def as_markdown() -> str:
    """The page for the site."""
    parser = build_parser()
    commands = dict(_commands(parser))
    index = [(f"[`{name}`](#{name.replace(' ', '-')})", _lower(made)) for name, made in commands.items()]
    lines = ["# Command line", "", str(parser.description), "", _FILES, "", *_listed(index)]
    for name, below in commands.items():
        usage = below.format_usage().removeprefix("usage: ").strip().replace("\n", " ")
        lines += ["", f"## {name}", "", str(below.description), "", "```text", usage, "```"]
        for title, actions in _groups(below):
            lines += ["", f"**{title}**", ""]
            lines += _listed([(f"`{_spelt(action)}`", _meant(action)) for action in actions])
        if below.epilog:
            lines += ["", "```text", str(below.epilog).rstrip(), "```"]
    for title, rows in (("Exit codes", _CODES), ("Environment", _ENVIRONMENT)):
        lines += ["", f"## {title}", "", *_listed([(f"`{name}`", text) for name, text in rows.items()])]
    return "\n".join(lines) + "\n"


def _lower(parser: argparse.ArgumentParser) -> str:
    """What a parser is for, without capital and full stop."""
    text = str(parser.description)
    return text[0].lower() + text[1:].removesuffix(".")


def _groups(parser: argparse.ArgumentParser) -> Iterator[tuple[str, list[argparse.Action]]]:
    """Title and arguments of the groups of a parser, but for --help."""
    for group in parser._action_groups:  # noqa: SLF001
        own = [action for action in group._group_actions if action.dest != "help"]  # noqa: SLF001
        if own:
            yield str(group.title), own


def _spelt(action: argparse.Action) -> str:
    """An argument as it is typed."""
    what = action.metavar or action.dest.upper()
    shown = " ".join(what) if isinstance(what, tuple) else str(what)
    if action.choices is not None and not action.metavar:
        shown = "|".join(map(str, action.choices))
    flags = ", ".join(action.option_strings)
    if action.nargs == 0:
        return flags
    return f"{flags} {shown}".strip()


def _meant(action: argparse.Action) -> str:
    return str(action.help or "").replace("%%", "%")


def _listed(rows: Sequence[tuple[str, str]]) -> list[str]:
    """A table of two columns without a head."""
    cells = [tuple(cell.replace("|", "\\|").replace("<", "&lt;") for cell in row) for row in rows]
    return ["| | |", "|---|---|", *(f"| {name} | {text} |" for name, text in cells)]
