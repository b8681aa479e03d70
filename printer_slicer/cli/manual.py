"""The manual, made from the parser: a page for `man`, and one for the site. `completion` too."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Sequence

from printer_slicer.cli.completing import shell_code
from printer_slicer.cli.parser import build_parser
from printer_slicer.cli.parsing import Command
from printer_slicer.profile.folders import VARIABLE
from printer_slicer.version import VERSION

__all__ = ["as_man", "as_markdown", "completion_command", "man_command"]

_FILES = (
    "A model, G-code or a profile named - is stdin, once in a command; such a profile inherits by name. -o - of slice, "
    "draw and profiles new, --picture - and --report - are stdout; contours and schemas need names. Patterns such as "
    "'*.stl' are expanded where the shell did not: those of models, G-code, profiles check and profiles import."
)
_ENVIRONMENT = {
    "NO_COLOR": "no colours, even on a terminal",
    "PRINTER_SLICER_KEY": "key or password for `send`, where no --key-file is given",
    VARIABLE: "folders of your own profiles, in place of the platform's; separated as in PATH; empty: none",
    "PRINTER_SLICER_STATE": "folder for what must be known to go on with a print; default: the system's place for it",
    "PRINTER_SLICER_GEOMETRY": "`planar` takes the second engine for areas, slower, to compare with",
    "PRINTER_SLICER_TRACEBACK": "shows where an internal error happened",
}
_CODES = {
    0: "done",
    1: "internal error, or not enough memory",
    2: "usage: a flag, a name, a setting, a file",
    3: "the part cannot be sliced",
    4: "the port",
    5: "the print failed",
    6: "cancelled",
    7: "verification failed: what was or would be printed is not what was asked for",
}


def completion_command(arguments: argparse.Namespace) -> int:
    """Write what a shell must read."""
    sys.stdout.write(shell_code(arguments.shell))
    return 0


def man_command(_: argparse.Namespace) -> int:
    """Write the manual page."""
    sys.stdout.write(as_man())
    return 0


def _commands(parser: argparse.ArgumentParser) -> Iterator[tuple[str, str, argparse.ArgumentParser]]:
    """Name, meaning and parser of every command, in the order of the help."""
    for action in parser._actions:  # noqa: SLF001 - argparse has no other list
        if isinstance(action, argparse._SubParsersAction):  # noqa: SLF001 - likewise
            for choice in action._choices_actions:  # noqa: SLF001 - likewise
                made = action.choices[choice.dest]
                yield choice.dest, str(choice.help), made
                for word, below in made.below.items() if isinstance(made, Command) else ():
                    meaning = str(below.description).removesuffix(".")
                    yield f"{choice.dest} {word}", meaning[0].lower() + meaning[1:], below


def _groups(parser: argparse.ArgumentParser) -> Iterator[tuple[str, list[argparse.Action]]]:
    """Title and arguments of the groups of a parser, but for --help."""
    for group in parser._action_groups:  # noqa: SLF001 - likewise
        own = [action for action in group._group_actions if action.dest != "help"]  # noqa: SLF001 - likewise
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


# For `man`


def as_man() -> str:
    """The page in the language of groff's man macros."""
    parser = build_parser()
    lines = [
        f'.TH PRINTER\\-SLICER 1 "" "printer\\-slicer {VERSION}" "User Commands"',
        *(".SH NAME", f"printer\\-slicer \\- {_roff(_first_sentence(parser))}"),
        *(".SH SYNOPSIS", ".B printer\\-slicer", ".I COMMAND", "[options] ..."),
        *(".SH DESCRIPTION", _roff(str(parser.description))),
        _roff(_FILES),
    ]
    for name, meaning, below in _commands(parser):
        lines += [f'.SH "COMMAND {_roff(name.upper())}"', _roff(f"{meaning[0].upper()}{meaning[1:]}.")]
        lines += [".PP", f".B {_roff(_usage(below))}"]
        for title, actions in _groups(below):
            lines += [f'.SS "{_roff(title)}"'] if title not in {"options", "positional arguments"} else []
            for action in actions:
                lines += [".TP", f".B {_roff(_spelt(action))}", _roff(_meant(action))]
        lines += [".PP", ".nf", *map(_roff, str(below.epilog or "").splitlines()), ".fi"]
    lines += [".SH EXAMPLES", ".nf", *map(_roff, _examples(parser)), ".fi"]
    lines += [".SH EXIT STATUS", *_table({str(code): text for code, text in _CODES.items()})]
    lines += [".SH ENVIRONMENT", *_table(_ENVIRONMENT)]
    return "\n".join(lines) + "\n"


def _first_sentence(parser: argparse.ArgumentParser) -> str:
    text = str(parser.description).removesuffix(".")
    return text[0].lower() + text[1:]


def _usage(parser: argparse.ArgumentParser) -> str:
    return parser.format_usage().removeprefix("usage: ").strip().replace("\n", " ")


def _examples(parser: argparse.ArgumentParser) -> list[str]:
    return str(parser.epilog).partition("\n\nexit codes")[0].splitlines()[1:]


def _table(rows: dict[str, str]) -> list[str]:
    return [line for name, text in rows.items() for line in (".TP", f".B {_roff(name)}", _roff(text))]


def _roff(text: str) -> str:
    """Text as groff takes it as it is."""
    text = " ".join(text.split()) if not text.startswith("  ") else text
    safe = text.replace("\\", "\\e").replace("-", "\\-")
    return f"\\&{safe}" if safe.startswith((".", "'")) else safe


# For the site


def as_markdown() -> str:
    """The page for the site."""
    parser = build_parser()
    lines = ["# Command line", "", str(parser.description), ""]
    lines += [_FILES]
    lines += [
        "",
        *_listed(
            [(f"[`{name}`](#{name.replace(' ', '-')})", meaning) for name, meaning, _ in _commands(parser)]
        ),
    ]
    for name, meaning, below in _commands(parser):
        lines += [
            "",
            f"## {name}",
            "",
            f"{meaning[0].upper()}{meaning[1:]}.",
            "",
            "```text",
            _usage(below),
            "```",
        ]
        for title, actions in _groups(below):
            lines += ["", f"**{title}**", ""]
            lines += _listed([(f"`{_spelt(action)}`", _meant(action)) for action in actions])
        if below.epilog:
            lines += ["", "```text", str(below.epilog).rstrip(), "```"]
    lines += ["", "## Exit codes", "", *_listed([(f"`{code}`", text) for code, text in _CODES.items()])]
    lines += ["", "## Environment", ""]
    lines += _listed([(f"`{name}`", text) for name, text in _ENVIRONMENT.items()])
    return "\n".join(lines) + "\n"


def _listed(rows: Sequence[tuple[str, str]]) -> list[str]:
    """A table of two columns without a head."""
    cells = [tuple(cell.replace("|", "\\|").replace("<", "&lt;") for cell in row) for row in rows]
    return ["| | |", "|---|---|", *(f"| {name} | {text} |" for name, text in cells)]
