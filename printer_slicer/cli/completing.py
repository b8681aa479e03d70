"""What the Tab key offers: commands and flags of the parser, and the names that flags take.

A shell that was told how (`printer-slicer completion SHELL`) runs this program with a variable set; argcomplete then
asks the parser what could be typed. So names of profiles, settings and ports are those of this moment.
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
"""What may come next; with meanings, where the shell shows them."""
_Completer = Callable[[str], _Words]


def shell_code(shell: str) -> str:
    """What a shell must read to complete our commands."""
    from argcomplete.shell_integration import shellcode

    return str(shellcode(["printer-slicer"], shell=shell))


def complete(parser: argparse.ArgumentParser) -> None:
    """Answer the shell and end this process, if it asks."""
    import argcomplete

    for action in actions_of(parser):
        completer = _completer(action)
        if completer:
            action.completer = _asked(completer)  # type: ignore[attr-defined]
        elif action.dest == "names":
            action.completer = _names_of_profiles  # type: ignore[attr-defined]
    _as_one_command(parser)
    argcomplete.autocomplete(parser, always_complete_options=False)


def _as_one_command(parser: argparse.ArgumentParser) -> None:
    """Where another parser reads behind a word, as in `profiles import`, let argcomplete take both for one command."""
    line = os.environ.get("COMP_LINE", "")
    for action in parser._actions:  # noqa: SLF001 - argparse has no other list
        if isinstance(action, argparse._SubParsersAction):  # noqa: SLF001 - likewise
            for name, word, below in _below(action.choices):
                found = re.match(rf"\S+\s+({name}(\s+){word})\s", line)
                if found:  # as long as before, so that the cursor stays where it is
                    joined = f"{name}{'_' * len(found[2])}{word}"
                    action.choices[joined] = below
                    os.environ["COMP_LINE"] = line.replace(found[1], joined, 1)


def _below(commands: Mapping[str, argparse.ArgumentParser]) -> list[tuple[str, str, CommandParser]]:
    """Commands, first words behind them that lead to another parser, and these."""
    return [
        (name, word, below)
        for name, made in commands.items()
        if isinstance(made, CommandParser)
        for word, below in made.below.items()
    ]


def _asked(completer: _Completer) -> Callable[..., _Words]:
    """As argcomplete asks: it knows more than our completers need."""
    return lambda prefix, **_: completer(prefix)


def actions_of(parser: argparse.ArgumentParser) -> Iterator[argparse.Action]:
    """All arguments of a parser and of those under it."""
    for action in parser._actions:  # noqa: SLF001 - argparse has no other list
        yield action
        if isinstance(action, argparse._SubParsersAction):  # noqa: SLF001 - likewise
            for below in action.choices.values():
                yield from actions_of(below)
    for below in parser.below.values() if isinstance(parser, CommandParser) else ():
        yield from actions_of(below)


def _completer(action: argparse.Action) -> _Completer | None:
    """Who knows what an argument may be; None: argparse's choices, or nobody."""
    if action.choices is not None or action.nargs == 0 or action.dest == "names":
        return None
    for flag in action.option_strings:
        if flag in _OF_FLAGS:
            return _OF_FLAGS[flag]
    return _OF_NAMES.get(action.dest, _files())


# Who knows


def _names(kind: str) -> _Completer:
    """Names of profiles, with what they are for, and profiles of one's own in files."""

    def known(prefix: str) -> _Words:
        """Those that begin so."""
        from printer_slicer.profile import profile_paths
        from printer_slicer.profile.inspection import read_headline

        names = {name: read_headline(path) for name, path in profile_paths(kind).items()}
        return _beginning(names, prefix) | dict.fromkeys(_paths(prefix, (".toml",)), "")

    return known


def _any_profile(prefix: str) -> _Words:
    """Names of all profiles."""
    return [word for kind in _KINDS for word in _names(kind)(prefix)]


def _names_of_profiles(prefix: str, parsed_args: argparse.Namespace, **_: object) -> _Words:
    """What may come next behind `profiles WHAT`."""
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
    """The kind of a profile; empty where that cannot be told."""
    from printer_slicer.errors import ProfileError
    from printer_slicer.profile.reading import kind_of

    try:
        return kind_of(name)
    except ProfileError:
        return ""


def _settings(prefix: str) -> _Words:
    """`key=` with its meaning; `key=value` where there are few values. Short keys, until a section is typed."""
    key, equals, _value = prefix.partition("=")
    rows = [tuple(map(str, row)) for row in _rows()]
    if equals:
        values = {row[0]: _values(row[1], row[3]) for row in rows}
        values |= {row[0].partition(".")[2]: _values(row[1], row[3]) for row in rows}
        return [f"{key}={value}" for value in values.get(key, ())]
    sections = tuple({f"{row[0].partition('.')[0]}." for row in rows})
    short = {f"{row[0].partition('.')[2]}=": row[5] for row in rows}
    full = {f"{row[0]}=": row[5] for row in rows} if prefix.startswith(sections) else {}
    return _beginning(short | full, prefix)


def _of_heights(prefix: str) -> _Words:
    """The same behind two heights, for settings that may differ there, and those of the planner."""
    where, _, begin = prefix.rpartition(":")
    if where.count(":") < 1:
        return []
    planned = {"tolerance=": "tolerance there", "layer_height=": "height of the layers there"}
    return _own(where, begin, {"height"}) | {
        f"{where}:{key}": told for key, told in _beginning(planned, begin).items()
    }


def _of_objects(prefix: str) -> _Words:
    """The same behind an object, or an object and two heights."""
    where, colon, begin = prefix.rpartition(":")
    if not colon:
        return []
    return _own(where, begin, {"object", "height"} if where.count(":") > 1 else {"object"})


def _own(where: str, begin: str, places: set[str]) -> dict[str, str]:
    """Settings that may differ there."""
    own = {row[0].partition(".")[2] for row in _rows() if places <= set(row[6])}
    words = _settings(begin)
    known = words.items() if isinstance(words, Mapping) else ((word, "") for word in words)
    return {f"{where}:{word}": told for word, told in known if word.partition("=")[0] in own}


def _rows() -> Iterator[Any]:
    from printer_slicer.profile.tables import settings_table

    # Settings of a planner are typed without its name: quality.planner.max_step.
    for key, *others in settings_table():
        yield (_without_brackets(str(key)), *others)


def _without_brackets(key: str) -> str:
    before, _, after = key.partition("[")
    return before + after.partition("]")[2]


def _values(kind: str, bounds: str) -> list[str]:
    """What a setting may be, where these are few words."""
    if kind == "bool":
        return ["true", "false"]
    return [word.strip() for word in bounds.split("|")] if "|" in bounds else []


def _ports(prefix: str) -> _Words:
    """Serial ports of this computer, and the simulated printer."""
    from printer_slicer.stream.serial_port import list_ports

    return _beginning(
        {port.device: port.description for port in list_ports()} | {"sim:": "simulated"}, prefix
    )


def _unfinished(prefix: str) -> _Words:
    """Prints on the shelf."""
    from printer_slicer.printing.shelf import default_shelf, on_shelf

    return [one.name for one in on_shelf(default_shelf()) if one.name.startswith(prefix)]


def _allowed(prefix: str) -> _Words:
    from printer_slicer.diagnostics import NAMES

    return _beginning(NAMES, prefix)


def _choices(setting: str) -> _Completer:
    """The few words of which a setting is one."""

    def known(prefix: str) -> _Words:
        """Those that begin so."""
        if setting.endswith("planner.kind"):
            from printer_slicer.profile.planners import PLANNER_SETTINGS

            return _beginning({name: kind.__doc__ or "" for name, kind in PLANNER_SETTINGS.items()}, prefix)
        few = {row[0]: _values(row[1], row[3]) for row in _rows()}
        return [word for word in few[setting] if word.startswith(prefix)]

    return known


def _of(*words: str) -> _Completer:
    return lambda prefix: [word for word in words if word.startswith(prefix)]


def _files(*suffixes: str) -> _Completer:
    return lambda prefix: _paths(prefix, suffixes)


def _paths(prefix: str, suffixes: tuple[str, ...]) -> list[str]:
    """Files with one of these suffixes, or with any, and folders, as they are typed."""
    folder, slash, begin = prefix.rpartition("/")
    where = Path(f"{folder}{slash}" or ".").expanduser()
    found = []
    try:
        for path in sorted(where.iterdir()):
            hidden = path.name.startswith(".") and not begin.startswith(".")
            fits = path.is_dir() or not suffixes or path.suffix.lower() in suffixes
            if path.name.startswith(begin) and fits and not hidden:
                found.append(f"{folder}{slash}{path.name}" + ("/" if path.is_dir() else ""))
    except OSError:  # no such folder: nothing begins so
        return []
    return found


def _beginning(words: Mapping[str, str], prefix: str) -> dict[str, str]:
    return {word: meaning for word, meaning in words.items() if word.startswith(prefix)}


_OF_FLAGS: Final[Mapping[str, _Completer]] = {
    "--printer": _names("printer"),
    "--material": _names("material"),
    "--quality": _names("quality"),
    "--inherits": _any_profile,
    "--set": _settings,
    "--set-for": _of_objects,
    "--range": _of_heights,
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
    "name": _unfinished,
    "wish": _of(
        "status", "pause", "resume", "cancel", "object", "speed", "flow", "fan", "nozzle", "bed", "stop"
    ),
}
