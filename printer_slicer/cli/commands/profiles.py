"""`profiles`: list, show, compare, check, create and import profiles."""

from __future__ import annotations

import argparse
import json
import re
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Final, NoReturn

from printer_slicer.cli.argument_flags import replace_arguments_by_options
from printer_slicer.cli.arguments import add_output_options, add_setting_options
from printer_slicer.cli.help import format_actions, mark_advanced
from printer_slicer.cli.output import hide_stdin_folder, print_text, write_file
from printer_slicer.cli.parser import CommandParser, add_command
from printer_slicer.cli.settings import (
    check_profile_folders,
    collect_changes,
    find_folder_for_new_profiles,
    prepare_schema_folder,
    print_translations,
    write_schemas,
)
from printer_slicer.errors import OutputError, ProfileError, UsageError
from printer_slicer.saving import make_folder

if TYPE_CHECKING:
    from printer_slicer.profile.reading import SettingsSource

__all__ = ["EXAMPLES", "add_arguments", "run"]

EXAMPLES: Final = """\
  printer-slicer profiles
  printer-slicer profiles show prusa_mk3s
  printer-slicer profiles show --printer voron_0_2 --material petg --set perimeters=4
  printer-slicer profiles diff standard fine
  printer-slicer profiles new printer my_printer --inherits marlin_220
  printer-slicer profiles import config.ini
  printer-slicer profiles check my_printer.toml --json
  printer-slicer profiles settings infill
  printer-slicer profiles schema -o schemas"""
_ACTIONS: Final = {
    "list": "list the profiles, with KIND only those of one kind",
    "show": "show all settings of a profile, and where each value comes from",
    "diff": "show the settings in which two profiles differ",
    "new": "write a new profile: KIND NAME",
    "import": "import profiles of other slicers; see `profiles import --help`",
    "check": "report all errors in profile files, with line numbers",
    "path": "show the folders that are searched, or the file of a profile",
    "settings": "list settings with unit, bounds and default, with WORD only those that contain it",
    "schema": "write JSON Schema files for editors",
}
_KINDS: Final = ("printer", "material", "quality")
_PLURALS: Final = {"printers": "printer", "materials": "material", "qualities": "quality"}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `profiles`, and the parser of `profiles import`."""
    parser.epilog = format_actions(_ACTIONS)
    parser.add_argument(
        "what",
        nargs="?",
        metavar="ACTION",
        choices=(*_ACTIONS, *_KINDS, *_PLURALS),
        default="list",
        help="one of the actions below; default: list",
    )
    parser.add_argument(
        "names",
        nargs="*",
        metavar="NAME",
        help="names of profiles, or their files; KIND (printer, material, quality) may precede them",
    )
    parser.add_argument("--inherits", metavar="NAME", help="for new: profile from which the new one inherits")
    parser.add_argument(
        "-o",
        "--output",
        metavar="OUT",
        type=Path,
        help="for new: file to write; for schema: folder to write to",
    )
    mark_advanced(
        parser.add_argument(
            "--markdown", action="store_true", help="for settings: print all of them as Markdown tables"
        )
    )
    add_setting_options(parser)
    add_output_options(parser)
    assert isinstance(parser, CommandParser)
    below = CommandParser(
        prog=f"{parser.prog} import",
        description="Import profiles of other slicers, and report how each setting was converted.",
    )
    add_command(below, "profiles import")
    parser.below = {"import": below}


def run(arguments: argparse.Namespace) -> int:
    """Run an action on profiles, such as list or show."""
    what = arguments.what
    if what in _KINDS or what in _PLURALS:  # `profiles printer NAME`, or `profiles printers`
        what, arguments.names = "show" if arguments.names else "list", [what, *arguments.names]
        arguments.names[0] = _PLURALS.get(arguments.names[0], arguments.names[0])
    if what in ("list", "show", "diff", "check"):
        check_profile_folders(arguments)
    return _ACTION_FUNCTIONS[what](arguments)


def _raise_usage_error(problem: str, example: str) -> NoReturn:
    """Raise a usage error with an example of a valid command."""
    raise UsageError(problem, remedy=f"Use for example: printer-slicer {example}")


def _print_json(arguments: argparse.Namespace, value: object) -> None:
    """Print a value as a JSON document, unless --quiet is given."""
    if not arguments.quiet:
        print(hide_stdin_folder(arguments, json.dumps(value, ensure_ascii=False)))


def _list_profiles(arguments: argparse.Namespace) -> int:
    """List the profiles of all kinds, or of the kinds named on the command line."""
    from printer_slicer.profile import DEFAULT_NAMES, KINDS, find_profile_paths
    from printer_slicer.profile.folders import find_shipped_profiles
    from printer_slicer.profile.inspection import read_headline

    wanted = [_PLURALS.get(name, name) for name in arguments.names] or list(KINDS)
    for name in wanted:
        if name not in KINDS:
            _raise_usage_error(
                f"profiles list {name}: no such kind of profile", f"profiles list {'|'.join(KINDS)}"
            )
    known = {kind: find_profile_paths(kind, arguments.profiles) for kind in wanted}
    if arguments.json:
        _print_json(
            arguments, {kind: {name: str(path) for name, path in known[kind].items()} for kind in known}
        )
        return 0
    shipped = find_shipped_profiles()
    for kind, paths in known.items():
        print_text(arguments, f"--{kind}")
        for name, path in paths.items():
            shown = name + (" (default)" if name == DEFAULT_NAMES[kind] else "")
            own = "" if path.is_relative_to(shipped) else f" [{path}]"
            print_text(arguments, f"  {shown:<26}{read_headline(path)}{own}")
    return 0


def _parse_profile(arguments: argparse.Namespace, words: Sequence[str]) -> tuple[str, str]:
    """Return kind and name of a profile from `NAME`, `KIND NAME` or a path."""
    from printer_slicer.profile.reading import find_profile_kind

    if len(words) == 2 and words[0] in _KINDS:
        return words[0], words[1]
    if len(words) != 1:
        kind = [words[0]] if words and words[0] in _KINDS else []
        quoted = f'"{" ".join(words[len(kind) :])}"' if len(words) > len(kind) else "NAME"
        _raise_usage_error(
            f"profiles {arguments.what}: one profile must be named",
            " ".join(["profiles", arguments.what, *kind, quoted]),
        )
    return find_profile_kind(words[0], arguments.profiles), words[0]


def _show_settings(arguments: argparse.Namespace) -> int:
    """Show all settings of a profile with the origin of each value."""
    from printer_slicer.profile.inspection import find_setting_origins
    from printer_slicer.profile.reading import read_chain

    if arguments.names:
        kind, name = _parse_profile(arguments, arguments.names)
        parts = {"": find_setting_origins(kind, read_chain(kind, name, arguments.profiles))}
    else:
        sources = _read_named_profiles(arguments)
        parts = {f"{kind}.": find_setting_origins(kind, source) for kind, source in sources.items()}
    settings = {f"{prefix}{key}": one for prefix, part in parts.items() for key, one in part.items()}
    if arguments.json:
        _print_json(
            arguments, {key: {"value": one.value, "from": one.place} for key, one in settings.items()}
        )
        return 0
    lines = {key: f"{key} = {_format_value(one.value)}" for key, one in settings.items()}
    wide = min(max(len(line) for line in lines.values()), 44)
    for key, line in lines.items():
        print_text(arguments, f"{line:<{wide}}  # {settings[key].place}")
    return 0


def _format_value(value: object) -> str:
    """Format the value of a setting on one line."""
    from printer_slicer.profile.template import format_toml_value

    return format_toml_value(value) if not isinstance(value, str) else json.dumps(value, ensure_ascii=False)


def _read_named_profiles(arguments: argparse.Namespace) -> Mapping[str, SettingsSource]:
    """Read the profiles that the command line names, after checking that they fit together."""
    from printer_slicer.profile import load_profile
    from printer_slicer.profile.files import read_sources

    names = {kind: getattr(arguments, kind) for kind in _KINDS}
    changes = collect_changes(arguments)
    load_profile(names["printer"], names["material"], names["quality"], changes, folders=arguments.profiles)
    print_translations(arguments)
    return read_sources(names, changes, arguments.profiles)


def _show_differences(arguments: argparse.Namespace) -> int:
    """Show the settings in which two profiles of one kind differ."""
    from printer_slicer.profile.inspection import compare_settings
    from printer_slicer.profile.reading import read_chain

    words = list(arguments.names)
    given = words.pop(0) if len(words) == 3 and words[0] in _KINDS else ""
    if len(words) != 2:
        _raise_usage_error("profiles diff: two profiles must be named", "profiles diff standard fine")
    kinds = [given or _parse_profile(arguments, [word])[0] for word in words]
    if kinds[0] != kinds[1]:
        raise UsageError(
            f"{words[0]} is a {kinds[0]} profile, but {words[1]} is a {kinds[1]} profile",
            remedy="Compare two profiles of the same kind",
        )
    one, other = (read_chain(kinds[0], word, arguments.profiles) for word in words)
    found = compare_settings(kinds[0], one, other)
    if arguments.json:
        _print_json(arguments, {key: dict(zip(words, pair, strict=True)) for key, pair in found.items()})
        return 0
    for key, (left, right) in found.items():
        print_text(arguments, f"{key:<36}{_format_optional_value(left)} -> {_format_optional_value(right)}")
    if not found:
        print_text(arguments, "no differences")
    return 0


def _format_optional_value(value: object) -> str:
    """Format a value; return a dash for None."""
    return "-" if value is None else _format_value(value)


def _write_new_profile(arguments: argparse.Namespace) -> int:
    """Write a new profile that inherits from another one."""
    from printer_slicer.profile import DEFAULT_NAMES
    from printer_slicer.profile.folders import FOLDERS
    from printer_slicer.profile.reading import find_profile_file, read_chain
    from printer_slicer.profile.schema import format_schema_directive
    from printer_slicer.profile.template import format_new_profile

    if len(arguments.names) != 2 or arguments.names[0] not in _KINDS:
        _raise_usage_error(
            "profiles new: the kind and the name of the profile are missing",
            "profiles new printer my_printer",
        )
    kind, name = arguments.names
    root = None if arguments.output else _choose_new_profile_folder(arguments, kind, name)
    path: Path = root / FOLDERS[kind] / f"{name}.toml" if root else arguments.output
    to_stdout = str(path) == "-"
    if path.exists() and not to_stdout:
        raise OutputError(
            f"{path}: the file already exists", remedy="Choose another name, or another file with -o"
        )
    parent = arguments.inherits or DEFAULT_NAMES[kind]
    source = read_chain(kind, parent, arguments.profiles)
    if "/" in parent or parent.endswith(".toml"):
        parent = str(Path(parent).absolute())  # a relative path would refer to the folder of the new file
    else:
        parent = find_profile_file(kind, parent, arguments.profiles).stem  # the name in a file must be exact
    if root:
        make_folder(path.parent)
    text = format_new_profile(
        kind, name, parent, source, format_schema_directive(kind, prepare_schema_folder(root))
    )
    write_file(path, text.encode())
    if not to_stdout:
        print_text(
            arguments, f"{path}: written; edit this file, and use it with --{kind} {name if root else path}"
        )
    return 0


def _choose_new_profile_folder(arguments: argparse.Namespace, kind: str, name: str) -> Path:
    """Return the folder for a new profile with this name."""
    if not re.fullmatch(r"[\w][\w.+-]*", name) or name.endswith(".toml"):
        _raise_usage_error(
            f"profiles new: {name!r} is not a valid name", f"profiles new {kind} my_{kind}   (or -o FILE)"
        )
    remedy = f"printer-slicer profiles new {kind} {name} -o FILE"
    return find_folder_for_new_profiles(arguments.profiles, "profiles new", remedy)


def _check_profiles(arguments: argparse.Namespace) -> int:
    """Report all errors in profile files, and conflicts between the profiles; return 2 if there are any."""
    from printer_slicer.gcode.macro_faults import find_macro_faults
    from printer_slicer.profile.inspection import find_faults

    if not arguments.names:
        _raise_usage_error("profiles check: no file is named", "profiles check my_printer.toml")
    words = list(arguments.names)
    kind = words.pop(0) if len(words) > 1 and words[0] in _KINDS else ""
    found: list[tuple[str, str]] = []
    checked: dict[str, str] = {}
    for name in words:
        try:
            own = kind or _parse_profile(arguments, [name])[0]
            checked[own] = name
            found += [
                (f"{one.place}: {one.problem}", one.remedy)
                for one in find_faults(own, name, arguments.profiles, find_macro_faults)
            ]
        except ProfileError as error:
            found.append((error.args[0], error.remedy))
    if not found:
        found += _describe_conflicts(arguments, checked)
    return _print_faults(arguments, found, words)


def _describe_conflicts(arguments: argparse.Namespace, checked: Mapping[str, str]) -> list[tuple[str, str]]:
    """Return (problem, remedy) for each conflict among the checked profiles and the profiles of the command line."""
    from printer_slicer.profile.files import find_conflicts, read_sources

    flags = {kind: getattr(arguments, kind) for kind in _KINDS if getattr(arguments, kind)}
    names = {**flags, **checked}
    if len(names) < 2 and not arguments.set:
        return []
    try:
        faults = find_conflicts(read_sources(names, collect_changes(arguments), arguments.profiles))
        print_translations(arguments)
    except ProfileError as error:
        return [(error.args[0], error.remedy)]
    return [(f"{one.place}: {one.problem}", one.remedy) for one in faults]


def _print_faults(
    arguments: argparse.Namespace, found: Sequence[tuple[str, str]], words: Sequence[str]
) -> int:
    """Print the faults of profiles; return 2 if there are any."""
    if arguments.json:
        _print_json(arguments, [{"problem": problem, "remedy": remedy} for problem, remedy in found])
    elif found:
        for problem, remedy in found:
            text = f"{problem}\n  {remedy}" if remedy else problem
            print(hide_stdin_folder(arguments, replace_arguments_by_options(text)), file=sys.stderr)
    else:
        print_text(arguments, f"{', '.join(words)}: no errors")
    return 2 if found else 0


def _show_paths(arguments: argparse.Namespace) -> int:
    """Show the file of a profile, or the folders that are searched."""
    from printer_slicer.profile.folders import find_shipped_profiles, find_user_folders
    from printer_slicer.profile.reading import find_profile_file

    if arguments.names:
        kind, name = _parse_profile(arguments, arguments.names)
        path = find_profile_file(kind, name, arguments.profiles)
        if arguments.json:
            _print_json(arguments, {"kind": kind, "path": str(path)})
        else:
            print_text(arguments, str(path))
        return 0
    folders = {"named": arguments.profiles, "own": find_user_folders(), "shipped": [find_shipped_profiles()]}
    if arguments.json:
        _print_json(arguments, {what: [str(path) for path in paths] for what, paths in folders.items()})
        return 0
    for what, paths in folders.items():
        for path in paths:
            print_text(arguments, f"{what:<9}{path}{'' if path.is_dir() else '   (does not exist yet)'}")
    return 0


def _list_settings(arguments: argparse.Namespace) -> int:
    """List the settings whose key or meaning contains all typed words; settings whose name matches come first."""
    from printer_slicer.profile.document import format_settings_markdown
    from printer_slicer.profile.tables import find_settings

    if arguments.markdown:
        print_text(arguments, format_settings_markdown().rstrip("\n"), is_message=False)
        return 0
    from printer_slicer.importing.familiar import find_equivalent

    wanted = {one for word in arguments.names for one in (word.lower(), find_equivalent(word))}
    named = [row for row in find_settings() if row.key.partition(".")[2] in wanted]
    rows = named + [row for row in find_settings(*arguments.names) if row not in named]
    if arguments.json:
        _print_json(arguments, [row._asdict() for row in rows])
        return 0
    for row in rows:
        unit = f" {row.unit}" if row.unit not in ("", "0-1") else ""  # the bounds say the same as 0-1
        bounds = f" ({row.bounds})" if row.bounds else ""
        default = "" if "\n" in row.default else row.default
        print_text(arguments, f"{row.key:<42}{default}{unit}{bounds}  {row.meaning}")
    if not rows:
        raise UsageError(
            f"profiles settings {' '.join(arguments.names)}: no setting matches", remedy="Try a shorter word"
        )
    return 0


def _write_schema_files(arguments: argparse.Namespace) -> int:
    """Write the JSON schemas to a folder; if none is named, print one schema, or the folder that has them all."""
    from printer_slicer.profile.folders import SCHEMAS, find_shipped_profiles
    from printer_slicer.profile.schema import make_schema

    if arguments.output is None:
        wanted = arguments.names or list(_KINDS)
        if not set(wanted) <= set(_KINDS):
            _raise_usage_error(
                f"profiles schema {' '.join(wanted)}: no such kind of profile", "profiles schema quality"
            )
        if arguments.json or arguments.names:
            schemas = {kind: make_schema(kind) for kind in wanted}
            _print_json(arguments, schemas[wanted[0]] if len(wanted) == 1 else schemas)
        else:
            print_text(arguments, str(find_shipped_profiles() / SCHEMAS))
        return 0
    paths = write_schemas(arguments.output)
    print_text(arguments, "\n".join(f"{path}: written" for path in paths))
    return 0


_ACTION_FUNCTIONS: Final[Mapping[str, Callable[[argparse.Namespace], int]]] = {
    "list": _list_profiles,
    "show": _show_settings,
    "diff": _show_differences,
    "new": _write_new_profile,
    "check": _check_profiles,
    "path": _show_paths,
    "settings": _list_settings,
    "schema": _write_schema_files,
}
