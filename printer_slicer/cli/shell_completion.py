"""Shell completion of commands, options, and their values.

A shell with the script of `printer-slicer completion SHELL` runs this program with an environment variable; argcomplete
then asks the parser for candidates. So names of profiles, settings and ports are always current.
"""

from __future__ import annotations

import argparse
import os
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, Final

from printer_slicer.cli.arguments import FIRMWARES, SETTING_OPTIONS
from printer_slicer.cli.inputs import MODELS
from printer_slicer.cli.parser import CommandParser

__all__ = ["SHELLS", "actions_of", "complete", "shell_code"]

SHELLS: Final = ("bash", "zsh", "fish")
GCODE: Final = (".gcode", ".gco", ".g", ".nc")
_KINDS: Final = ("printer", "material", "quality")
_Words = Iterable[str] | Mapping[str, str]
"""Candidates, or candidate -> meaning for shells that show meanings."""
_Completer = Callable[[str], _Words]


def shell_code(shell: str) -> str:
    """Return the completion script for a shell."""
    from argcomplete.shell_integration import shellcode

    return str(shellcode(["printer-slicer"], shell=shell))


def complete(parser: argparse.ArgumentParser) -> None:
    """Answer a completion request of the shell and exit; return if there is none."""
    import argcomplete

    for action in actions_of(parser):
        completer = _completer(action)
        if completer:
            action.completer = _as_argcomplete(completer)  # type: ignore[attr-defined]
        elif action.dest == "names":
            action.completer = _names_of_profiles  # type: ignore[attr-defined]
    _as_one_command(parser)
    argcomplete.autocomplete(parser, always_complete_options=False)


def _as_one_command(parser: argparse.ArgumentParser) -> None:
    """Join commands of two words, such as `profiles import`, into one for argcomplete."""
    line = os.environ.get("COMP_LINE", "")
    for action in parser._actions:  # noqa: SLF001 - argparse has no other list
        if isinstance(action, argparse._SubParsersAction):  # noqa: SLF001 - likewise
            for name, word, below in _second_words(action.choices):
                found = re.match(rf"\S+\s+({name}(\s+){word})\s", line)
                if found:  # of the same length, so that the cursor position stays valid
                    joined = f"{name}{'_' * len(found[2])}{word}"
                    action.choices[joined] = below
                    os.environ["COMP_LINE"] = line.replace(found[1], joined, 1)


def _second_words(commands: Mapping[str, argparse.ArgumentParser]) -> list[tuple[str, str, CommandParser]]:
    """Return (command, second word, parser) of commands with a parser of their own for a second word."""
    return [
        (name, word, below)
        for name, made in commands.items()
        if isinstance(made, CommandParser)
        for word, below in made.below.items()
    ]


def _as_argcomplete(completer: _Completer) -> Callable[..., _Words]:
    """Adapt a completer to the signature that argcomplete calls."""
    return lambda prefix, **_: completer(prefix)


def actions_of(parser: argparse.ArgumentParser) -> Iterator[argparse.Action]:
    """Yield all arguments of a parser and of its commands."""
    for action in parser._actions:  # noqa: SLF001 - argparse has no other list
        yield action
        if isinstance(action, argparse._SubParsersAction):  # noqa: SLF001 - likewise
            for below in action.choices.values():
                yield from actions_of(below)
    for below in parser.below.values() if isinstance(parser, CommandParser) else ():
        yield from actions_of(below)


def _completer(action: argparse.Action) -> _Completer | None:
    """Return the completer of an argument; None if argparse has its choices, or it has no candidates."""
    if action.choices is not None or action.nargs == 0 or action.dest == "names":
        return None
    for flag in action.option_strings:
        if flag in _OF_FLAGS:
            return _OF_FLAGS[flag]
    return _OF_NAMES.get(action.dest, _files())


# Completers


def _names(kind: str) -> _Completer:
    """Return a completer for names of profiles with their descriptions, and for profile files."""

    def known(prefix: str) -> _Words:
        """Return those that start with the prefix."""
        from printer_slicer.profile import profile_paths
        from printer_slicer.profile.inspection import read_headline

        names = {name: read_headline(path) for name, path in profile_paths(kind).items()}
        return _starting_with(names, prefix) | dict.fromkeys(_paths(prefix, (".toml",)), "")

    return known


def _any_profile(prefix: str) -> _Words:
    """Complete names of all profiles."""
    return [word for kind in _KINDS for word in _names(kind)(prefix)]


def _names_of_profiles(prefix: str, parsed_args: argparse.Namespace, **_: object) -> _Words:
    """Complete the words after `profiles ACTION`."""
    what, names = getattr(parsed_args, "what", "") or "", getattr(parsed_args, "names", None) or []
    kinds = {kind: "" for kind in _KINDS if kind.startswith(prefix)}
    said = what if what in _KINDS else next((word for word in names[:1] if word in _KINDS), "")
    if what in ("list", "schema"):
        return kinds
    if what == "settings" or (what == "new" and names):
        return []
    if what == "new":
        return kinds
    if what == "diff" and names and not said:
        said = _kind_of(names[0])
    known = _names(said)(prefix) if said else _any_profile(prefix)
    return [*known, *(kinds if not (said or names) else ())]


def _kind_of(name: str) -> str:
    """Return the kind of a profile; empty if it is unknown."""
    from printer_slicer.errors import ProfileError
    from printer_slicer.profile.reading import kind_of

    try:
        return kind_of(name)
    except ProfileError:
        return ""


def _settings(prefix: str) -> _Words:
    """Complete `key=` with its meaning, or `key=value` if a setting has choices; full keys once a section is typed."""
    key, equals, _value = prefix.partition("=")
    rows = [tuple(map(str, row)) for row in _rows()]
    if equals:
        values = {row[0]: _values(row[1], row[3]) for row in rows}
        values |= {row[0].partition(".")[2]: _values(row[1], row[3]) for row in rows}
        return [f"{key}={value}" for value in values.get(key, ())]
    sections = tuple({f"{row[0].partition('.')[0]}." for row in rows})
    short = {f"{row[0].partition('.')[2]}=": row[5] for row in rows}
    full = {f"{row[0]}=": row[5] for row in rows} if prefix.startswith(sections) else {}
    return _starting_with(short | full, prefix)


def _complete_range(prefix: str) -> _Words:
    """Complete settings after two heights: those that a height range may override, and those of the planner."""
    where, _, begin = prefix.rpartition(":")
    if where.count(":") < 1:
        return []
    planned = {"tolerance=": "tolerance in this range", "layer_height=": "layer height in this range"}
    return _overridable(where, begin, {"height"}) | {
        f"{where}:{key}": meaning for key, meaning in _starting_with(planned, begin).items()
    }


def _complete_set_for(prefix: str) -> _Words:
    """Complete settings after an object, or after an object and two heights."""
    where, colon, begin = prefix.rpartition(":")
    if not colon:
        return []
    return _overridable(where, begin, {"object", "height"} if where.count(":") > 1 else {"object"})


def _overridable(where: str, begin: str, places: set[str]) -> dict[str, str]:
    """Return the settings that may be overridden there."""
    own = {row[0].partition(".")[2] for row in _rows() if places <= set(row[6])}
    words = _settings(begin)
    known = words.items() if isinstance(words, Mapping) else ((word, "") for word in words)
    return {f"{where}:{word}": meaning for word, meaning in known if word.partition("=")[0] in own}


def _rows() -> Iterator[Any]:
    from printer_slicer.profile.tables import settings_table

    # Settings of a planner are typed without its name: quality.planner.max_step.
    for key, *others in settings_table():
        yield (_without_brackets(str(key)), *others)


def _without_brackets(key: str) -> str:
    before, _, after = key.partition("[")
    return before + after.partition("]")[2]


def _values(kind: str, bounds: str) -> list[str]:
    """Return the choices of a setting; empty if it has none."""
    if kind == "bool":
        return ["true", "false"]
    return [word.strip() for word in bounds.split("|")] if "|" in bounds else []


def _ports(prefix: str) -> _Words:
    """Complete serial ports and the simulated printer."""
    from printer_slicer.stream.serial_port import list_ports

    return _starting_with(
        {port.device: port.description for port in list_ports()} | {"sim:": "simulated"}, prefix
    )


def _complete_print_names(prefix: str) -> _Words:
    """Complete names of stored prints."""
    from printer_slicer.printing.job_store import default_job_store, stored_prints

    return [one.name for one in stored_prints(default_job_store()) if one.name.startswith(prefix)]


def _allowed(prefix: str) -> _Words:
    from printer_slicer.diagnostics import NAMES

    return _starting_with(NAMES, prefix)


def _choices(setting: str) -> _Completer:
    """Return a completer for the choices of a setting."""

    def known(prefix: str) -> _Words:
        """Return those that start with the prefix."""
        if setting.endswith("planner.kind"):
            from printer_slicer.profile.planners import PLANNER_SETTINGS

            return _starting_with(
                {name: kind.__doc__ or "" for name, kind in PLANNER_SETTINGS.items()}, prefix
            )
        few = {row[0]: _values(row[1], row[3]) for row in _rows()}
        return [word for word in few[setting] if word.startswith(prefix)]

    return known


def _of(*words: str) -> _Completer:
    return lambda prefix: [word for word in words if word.startswith(prefix)]


def _files(*suffixes: str) -> _Completer:
    return lambda prefix: _paths(prefix, suffixes)


def _paths(prefix: str, suffixes: tuple[str, ...]) -> list[str]:
    """Return files with one of these suffixes (all files if there are none) and folders, as they are typed."""
    folder, slash, begin = prefix.rpartition("/")
    where = Path(f"{folder}{slash}" or ".").expanduser()
    found = []
    try:
        for path in sorted(where.iterdir()):
            hidden = path.name.startswith(".") and not begin.startswith(".")
            fits = path.is_dir() or not suffixes or path.suffix.lower() in suffixes
            if path.name.startswith(begin) and fits and not hidden:
                found.append(f"{folder}{slash}{path.name}" + ("/" if path.is_dir() else ""))
    except OSError:  # no such folder
        return []
    return found


def _starting_with(words: Mapping[str, str], prefix: str) -> dict[str, str]:
    return {word: meaning for word, meaning in words.items() if word.startswith(prefix)}


_OF_FLAGS: Final[Mapping[str, _Completer]] = {
    "--printer": _names("printer"),
    "--material": _names("material"),
    "--quality": _names("quality"),
    "--inherits": _any_profile,
    "--set": _settings,
    "--set-for": _complete_set_for,
    "--range": _complete_range,
    "--firmware": _of(*(name.replace(" ", "-") for name in FIRMWARES)),
    **{flag: _choices(option.setting) for flag, option in SETTING_OPTIONS.items()},
    "--units": _of("mm", "cm", "m", "inch", "foot", "micron"),
    "--allow": _allowed,
    "--port": _ports,
    "--to": _of("octoprint", "moonraker", "prusalink", "duet"),
    "--model": _files(*MODELS),
    "--expect": _files(*MODELS, *GCODE),
}
_OF_NAMES: Final[Mapping[str, _Completer]] = {
    "models": _files(*MODELS, *GCODE),
    "gcode": _files(*GCODE),
    "port": _ports,
    "name": _complete_print_names,
    "words": _of(
        "status", "pause", "resume", "cancel", "object", "speed", "flow", "fan", "nozzle", "bed", "stop"
    ),
}
