"""Shell completion of commands, options, and their values.

A shell with the script of `printer-slicer completion SHELL` runs this program with an environment variable; argcomplete
then asks the parser for candidates. This way names of profiles, settings and ports are always current.
"""

from __future__ import annotations

import argparse
import os
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, Final

from printer_slicer.cli.parser import CommandParser
from printer_slicer.cli.setting_options import SETTING_OPTIONS
from printer_slicer.cli.simulator_options import FIRMWARES
from printer_slicer.input_files import GCODE_SUFFIXES, MODEL_SUFFIXES

__all__ = ["SHELLS", "answer_completion_request", "iterate_actions", "make_completion_script"]

SHELLS: Final = ("bash", "zsh", "fish")
_KINDS: Final = ("printer", "material", "quality")
_Words = Iterable[str] | Mapping[str, str]
"""Candidates, or candidate -> meaning for shells that can show meanings."""
_Completer = Callable[[str], _Words]


def make_completion_script(shell: str) -> str:
    """Return the completion script for a shell."""
    from argcomplete.shell_integration import shellcode

    return str(shellcode(["printer-slicer"], shell=shell))


def answer_completion_request(parser: argparse.ArgumentParser) -> None:
    """Answer a completion request of the shell and exit; do nothing if there is no request."""
    import argcomplete

    for action in iterate_actions(parser):
        completer = _find_completer(action)
        if completer:
            action.completer = _adapt_to_argcomplete(completer)  # type: ignore[attr-defined]
        elif action.dest == "names":
            action.completer = _complete_profiles_arguments  # type: ignore[attr-defined]
    _join_two_word_commands(parser)
    argcomplete.autocomplete(parser, always_complete_options=False)


def _join_two_word_commands(parser: argparse.ArgumentParser) -> None:
    """Join a command of two words, such as `profiles import`, into one word for argcomplete."""
    line = os.environ.get("COMP_LINE", "")
    for action in parser._actions:  # noqa: SLF001 - argparse has no other list
        if isinstance(action, argparse._SubParsersAction):  # noqa: SLF001 - likewise
            for name, word, below in _list_two_word_commands(action.choices):
                found = re.match(rf"\S+\s+({name}(\s+){word})\s", line)
                if found:  # the joined word has the same length, so that the cursor position stays valid
                    joined = f"{name}{'_' * len(found[2])}{word}"
                    action.choices[joined] = below
                    os.environ["COMP_LINE"] = line.replace(found[1], joined, 1)


def _list_two_word_commands(
    commands: Mapping[str, argparse.ArgumentParser],
) -> list[tuple[str, str, CommandParser]]:
    """Return (command, second word, parser) of the commands whose second word selects another parser."""
    return [
        (name, word, below)
        for name, made in commands.items()
        if isinstance(made, CommandParser)
        for word, below in made.below.items()
    ]


def _adapt_to_argcomplete(completer: _Completer) -> Callable[..., _Words]:
    """Adapt a completer to the signature that argcomplete calls."""
    return lambda prefix, **_: completer(prefix)


def iterate_actions(parser: argparse.ArgumentParser) -> Iterator[argparse.Action]:
    """Yield all arguments of a parser and of the parsers of its commands."""
    for action in parser._actions:  # noqa: SLF001 - argparse has no other list
        yield action
        if isinstance(action, argparse._SubParsersAction):  # noqa: SLF001 - likewise
            for below in action.choices.values():
                yield from iterate_actions(below)
    for below in parser.below.values() if isinstance(parser, CommandParser) else ():
        yield from iterate_actions(below)


def _find_completer(action: argparse.Action) -> _Completer | None:
    """Return the completer of an argument; None if it has no candidates, or if argparse completes its choices."""
    if action.choices is not None or action.nargs == 0 or action.dest == "names":
        return None
    for flag in action.option_strings:
        if flag in _OPTION_COMPLETERS:
            return _OPTION_COMPLETERS[flag]
    return _DESTINATION_COMPLETERS.get(action.dest, _make_file_completer())


# Completers


def _make_profile_completer(kind: str) -> _Completer:
    """Return a completer for the names of profiles of a kind, with their descriptions, and for profile files."""

    def complete_prefix(prefix: str) -> _Words:
        """Return the profiles that start with the prefix."""
        from printer_slicer.profile import find_profile_paths
        from printer_slicer.profile.inspection import read_headline

        names = {name: read_headline(path) for name, path in find_profile_paths(kind).items()}
        return _filter_by_prefix(names, prefix) | dict.fromkeys(_complete_path(prefix, (".toml",)), "")

    return complete_prefix


def _complete_any_profile(prefix: str) -> _Words:
    """Complete the names of profiles of all kinds."""
    return [word for kind in _KINDS for word in _make_profile_completer(kind)(prefix)]


def _complete_profiles_arguments(prefix: str, parsed_args: argparse.Namespace, **_: object) -> _Words:
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
        said = _find_profile_kind(names[0])
    complete_prefix = _make_profile_completer(said)(prefix) if said else _complete_any_profile(prefix)
    return [*complete_prefix, *(kinds if not (said or names) else ())]


def _find_profile_kind(name: str) -> str:
    """Return the kind of a named profile; empty if there is no such profile."""
    from printer_slicer.errors import ProfileError
    from printer_slicer.profile.reading import find_profile_kind

    try:
        return find_profile_kind(name)
    except ProfileError:
        return ""


def _complete_setting(prefix: str) -> _Words:
    """Complete `key=` with the meaning of the setting, or `key=value` if the setting has choices.

    Keys with their section, such as `quality.infill=`, are candidates only after a section is typed.
    """
    key, equals, _value = prefix.partition("=")
    rows = [tuple(map(str, row)) for row in _read_setting_rows()]
    if equals:
        values = {row[0]: _list_choices(row[1], row[3]) for row in rows}
        values |= {row[0].partition(".")[2]: _list_choices(row[1], row[3]) for row in rows}
        return [f"{key}={value}" for value in values.get(key, ())]
    sections = tuple({f"{row[0].partition('.')[0]}." for row in rows})
    short = {f"{row[0].partition('.')[2]}=": row[5] for row in rows}
    full = {f"{row[0]}=": row[5] for row in rows} if prefix.startswith(sections) else {}
    return _filter_by_prefix(short | full, prefix)


def _complete_range(prefix: str) -> _Words:
    """Complete the settings that may follow the two heights of --range: overrides, and settings of the planner."""
    where, _, begin = prefix.rpartition(":")
    if where.count(":") < 1:
        return []
    planned = {"tolerance=": "tolerance in this range", "layer_height=": "layer height in this range"}
    return _complete_override(where, begin, {"height"}) | {
        f"{where}:{key}": meaning for key, meaning in _filter_by_prefix(planned, begin).items()
    }


def _complete_set_for(prefix: str) -> _Words:
    """Complete the settings that may follow the object, or the object and two heights, of --set-for."""
    where, colon, begin = prefix.rpartition(":")
    if not colon:
        return []
    return _complete_override(where, begin, {"object", "height"} if where.count(":") > 1 else {"object"})


def _complete_override(where: str, begin: str, places: set[str]) -> dict[str, str]:
    """Complete a setting that may be overridden for an object, in a height range, or both.

    Args:
        where: text before the setting, such as `5:10`.
        begin: typed beginning of the setting.
        places: kinds of override that the setting must allow: `object`, `height`.
    """
    own = {row[0].partition(".")[2] for row in _read_setting_rows() if places <= set(row[6])}
    words = _complete_setting(begin)
    complete_prefix = words.items() if isinstance(words, Mapping) else ((word, "") for word in words)
    return {f"{where}:{word}": meaning for word, meaning in complete_prefix if word.partition("=")[0] in own}


def _read_setting_rows() -> Iterator[Any]:
    """Yield the rows of the table of settings, with keys as they are typed."""
    from printer_slicer.profile.tables import list_setting_definitions

    # A setting of a planner is typed without the planner's name: quality.planner.max_step.
    for key, *others in list_setting_definitions():
        yield (_remove_planner_name(str(key)), *others)


def _remove_planner_name(key: str) -> str:
    """Remove the name of a planner in brackets from the key of a setting."""
    before, _, after = key.partition("[")
    return before + after.partition("]")[2]


def _list_choices(kind: str, bounds: str) -> list[str]:
    """Return the choices of a setting with this type and these bounds; empty if it has none."""
    if kind == "bool":
        return ["true", "false"]
    return [word.strip() for word in bounds.split("|")] if "|" in bounds else []


def _complete_port(prefix: str) -> _Words:
    """Complete serial ports and the simulated printer."""
    from printer_slicer.stream.serial_port import list_ports

    return _filter_by_prefix(
        {port.device: port.description for port in list_ports()} | {"sim:": "simulated"}, prefix
    )


def _complete_print_names(prefix: str) -> _Words:
    """Complete names of stored prints."""
    from printer_slicer.printing.job_store import default_job_store, load_stored_prints

    return [one.name for one in load_stored_prints(default_job_store()) if one.name.startswith(prefix)]


def _complete_finding_name(prefix: str) -> _Words:
    from printer_slicer.diagnostics import NAMES

    return _filter_by_prefix(NAMES, prefix)


def _make_choice_completer(setting: str) -> _Completer:
    """Return a completer for the choices of a setting."""

    def complete_prefix(prefix: str) -> _Words:
        """Return the choices that start with the prefix."""
        if setting.endswith("planner.kind"):
            from printer_slicer.profile.planners import PLANNER_SETTINGS

            return _filter_by_prefix(
                {name: kind.__doc__ or "" for name, kind in PLANNER_SETTINGS.items()}, prefix
            )
        few = {row[0]: _list_choices(row[1], row[3]) for row in _read_setting_rows()}
        return [word for word in few[setting] if word.startswith(prefix)]

    return complete_prefix


def _make_word_completer(*words: str) -> _Completer:
    return lambda prefix: [word for word in words if word.startswith(prefix)]


def _make_file_completer(*suffixes: str) -> _Completer:
    return lambda prefix: _complete_path(prefix, suffixes)


def _complete_path(prefix: str, suffixes: tuple[str, ...]) -> list[str]:
    """Complete the path of a folder, or of a file with one of the suffixes; without suffixes, of any file."""
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


def _filter_by_prefix(words: Mapping[str, str], prefix: str) -> dict[str, str]:
    return {word: meaning for word, meaning in words.items() if word.startswith(prefix)}


_OPTION_COMPLETERS: Final[Mapping[str, _Completer]] = {
    "--printer": _make_profile_completer("printer"),
    "--material": _make_profile_completer("material"),
    "--quality": _make_profile_completer("quality"),
    "--inherits": _complete_any_profile,
    "--set": _complete_setting,
    "--set-for": _complete_set_for,
    "--range": _complete_range,
    "--firmware": _make_word_completer(*(name.replace(" ", "-") for name in FIRMWARES)),
    **{flag: _make_choice_completer(option.setting) for flag, option in SETTING_OPTIONS.items()},
    "--units": _make_word_completer("mm", "cm", "m", "inch", "foot", "micron"),
    "--allow": _complete_finding_name,
    "--port": _complete_port,
    "--to": _make_word_completer("octoprint", "moonraker", "prusalink", "duet"),
    "--model": _make_file_completer(*MODEL_SUFFIXES),
    "--expect": _make_file_completer(*MODEL_SUFFIXES, *GCODE_SUFFIXES),
}
_DESTINATION_COMPLETERS: Final[Mapping[str, _Completer]] = {
    "models": _make_file_completer(*MODEL_SUFFIXES, *GCODE_SUFFIXES),
    "gcode": _make_file_completer(*GCODE_SUFFIXES),
    "port": _complete_port,
    "name": _complete_print_names,
    "words": _make_word_completer(
        "status", "pause", "resume", "cancel", "object", "speed", "flow", "fan", "nozzle", "bed", "abort"
    ),
}
