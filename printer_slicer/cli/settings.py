"""Load the profile of a command line: named profiles, changed settings, and settings in G-code files."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NoReturn

from printer_slicer.cli.file_settings import name_settings, read_loaded_files
from printer_slicer.cli.output import hide_stdin_folder, sanitize, write_file
from printer_slicer.cli.setting_options import SETTING_OPTIONS
from printer_slicer.errors import ProfileError, UsageError
from printer_slicer.saving import make_folder

if TYPE_CHECKING:
    from printer_slicer.importing.familiar import FamiliarSetting
    from printer_slicer.profile import Profile
    from printer_slicer.profile.files import FileSettings

__all__ = [
    "check_profile_folders",
    "collect_changes",
    "collect_profile_facts",
    "find_folder_for_new_profiles",
    "load_selected_profile",
    "prepare_schema_folder",
    "print_translations",
    "write_schemas",
]

_PLANNER_RANGE_SETTINGS = ("tolerance", "layer_height")  # settings that the layer planner reads from --range
_RANGE_SETTINGS: Final = ("planner.ranges", "planner.ranges+", "ranges")
_MAX_SHOWN: Final = 80  # characters of a setting or note in a message
_MAX_CHANGES: Final = 4  # changes of a profile that the first line names
"""Comment with the name of the machine: in files of Cura, of FlashPrint, and of PrusaSlicer and its forks."""


def load_selected_profile(
    arguments: argparse.Namespace, *, slices: bool = True, gcode: Path | None = None, tell: bool = True
) -> Profile:
    """Load the profile that the command line selects; print the names and origins of printer, material and quality.

    Args:
        arguments: the command line; `collect_profile_facts` returns the sources of the profile afterwards.
        slices: whether a part is sliced with the profile; if not, the quality need not fit the printer.
        gcode: a file whose machine, material and quality are used unless the command line names others.
        tell: whether to print names and sources.

    Raises:
        UsageError: a name or a setting does not exist, or a value is out of bounds.
    """
    from printer_slicer.profile import complete_profile, load_profile

    names: dict[str, Any] = {
        kind: getattr(arguments, kind, None) for kind in ("printer", "material", "quality")
    }
    folders = check_profile_folders(arguments)
    own = read_loaded_files(arguments, names) if gcode is None else _read_gcode_file(gcode, folders)
    changes = collect_changes(arguments)
    try:
        if gcode is None and not own.values:
            profile = load_profile(**names, changes=changes, slices=slices, folders=folders)
        else:
            profile = complete_profile(own.values, names, changes, folders, slices=slices and gcode is None)
    except ProfileError as error:
        raise _name_options(error, arguments) from None
    if gcode is not None or not hasattr(arguments, "quality"):
        _reject_quality_settings(arguments, gcode)
    print_translations(arguments)
    used = {"printer", "material", *own.values, *(("quality",) if slices and gcode is None else ())}
    sources = _find_profile_sources(
        {kind: name for kind, name in names.items() if kind in used}, own, folders
    )
    _add_changes(sources, profile)
    arguments.profile_facts = {"profile": sources}
    if tell:
        _print_profile(arguments, sources, own.refused)
    return profile


def _read_gcode_file(path: Path, folders: Sequence[Path]) -> FileSettings:
    """Read the settings in a G-code file; slicing needs no module for that."""
    from printer_slicer.importing.gcode_files import read_gcode_settings

    return read_gcode_settings(path, folders)


def _name_options(error: ProfileError, arguments: argparse.Namespace) -> ProfileError:
    """Name the typed option in an error that begins with a setting which the option changed; return the error."""
    from printer_slicer.profile.reading import OtherFormatError

    message = str(error.args[0])
    if isinstance(error, OtherFormatError) and hasattr(arguments, "load"):
        other_way = error.remedy[:1].lower() + error.remedy[1:]
        return ProfileError(message, remedy=f"Pass it with --load instead, or {other_way}")
    place, _, problem = message.partition(": ")
    full, _, shown = place.partition("=")
    for option, change in _list_typed_changes(arguments):
        key, _, value = (part.strip() for part in change.partition("="))
        if shown == value and f".{full}".endswith(f".{key}"):
            plain = option == f"--set {change}"
            several = option.startswith(("--set", "--heights"))
            named = option if plain else f"{option} ({place})" if several else option
            return ProfileError(f"{named}: {problem}", remedy=error.remedy)
        if option.startswith("--set") and message.startswith((f"{key}:", f"{key}=")):
            return ProfileError(f"--set {message}", remedy=error.remedy)
    return error


def _list_typed_changes(arguments: argparse.Namespace) -> Iterator[tuple[str, str]]:
    """Yield each option that changes a setting as it was typed, and the change `KEY=VALUE` that it makes."""
    translated = {change: typed for typed, _, changes in _get_translations(arguments) for change in changes}
    for change in arguments.set:
        yield f"--set {translated.get(change, change)}", change
    for flag, option in SETTING_OPTIONS.items():
        value = vars(arguments).get(f"setting {option.setting}")
        if value is not None:
            yield f"{flag} {value}", f"{option.setting}={value}"
    if heights := vars(arguments).get("setting heights"):
        for change in _parse_heights(heights).items():
            yield f"--heights {heights}", "=".join(change)


def _reject_quality_settings(arguments: argparse.Namespace, gcode: Path | None) -> None:
    """Reject settings of the quality in --set if nothing is sliced.

    Raises:
        UsageError: a setting that only slicing uses is changed.
    """
    from printer_slicer.profile.keys import find_section

    for option, change in _list_typed_changes(arguments):
        if option.startswith("--set") and find_section(change.partition("=")[0].strip()) == "quality":
            raise UsageError(
                f"{gcode}: {option} does not apply to G-code, which is already sliced"
                if gcode
                else f"{option} has no effect: nothing is sliced",
                remedy="Leave it out, or change it when you slice the model",
            )


def _add_changes(sources: dict[str, dict[str, Any]], profile: Profile) -> None:
    """Add the changed settings of each kind, key -> value, to the sources of a profile."""
    for change in profile.list_changes():
        kind, _, key = change.key.partition(".")
        if kind in sources:
            sources[kind].setdefault("changes", {})[key] = change.value


def _print_profile(
    arguments: argparse.Namespace, sources: dict[str, dict[str, Any]], refused: Sequence[str]
) -> None:
    """Print printer, material and quality with their sources, as the first line of the output.

    The line goes to stderr if stdout carries data; with --json, it is in `profile` of the result.
    """
    if arguments.quiet:
        return
    for reason in refused:
        text = f"printer-slicer: warning: the settings in the file are not used: {reason}"
        print(sanitize(text), file=sys.stderr)
    if not arguments.json:
        data = any(str(getattr(arguments, name, "")) == "-" for name in ("output", "picture"))
        line = ", ".join(
            f"{kind} {one['name']} ({_format_origin(one)}){_format_changes(one.get('changes', {}))}"
            for kind, one in sources.items()
        )
        print(sanitize(hide_stdin_folder(arguments, line)), file=sys.stderr if data else sys.stdout)


def _format_changes(changes: Mapping[str, str]) -> str:
    """Format the changes of a profile as words that follow its name; empty without changes."""
    words = [
        f"{key}={value}" for key, value in changes.items() if key not in ("planner.kind", "layer_height")
    ]
    planner, height = changes.get("planner.kind"), changes.get("layer_height")
    if planner == "uniform" and height:
        words.insert(0, f"uniform layers of {height}")
    else:
        words[:0] = [f"layer_height={height}"] * bool(height) + [f"planner {planner}"] * bool(planner)
    if len(words) > _MAX_CHANGES + 1:
        words[_MAX_CHANGES:] = [f"{len(words) - _MAX_CHANGES} more changes"]
    *others, last = words or [""]
    return f" with {', '.join(others)}{' and ' if others else ''}{last}" if last else ""


def _format_origin(sources: dict[str, Any]) -> str:
    """Format where a profile comes from, and the machine that the file names if there is no profile for it."""
    named = sources.get("named_in_file")
    return str(sources["from"]) + (f": the file names '{named}', which has no profile" if named else "")


def collect_profile_facts(arguments: argparse.Namespace) -> dict[str, Any]:
    """Return printer, material and quality of a command with their sources, for JSON."""
    facts: dict[str, Any] = getattr(arguments, "profile_facts", {})
    return facts


def check_profile_folders(arguments: argparse.Namespace) -> Sequence[Path]:
    """Return the folders of --profiles, after checking that they exist.

    Raises:
        UsageError: a folder does not exist.
    """
    folders: Sequence[Path] = getattr(arguments, "profiles", ())
    for folder in folders:
        if not folder.is_dir():
            raise UsageError(
                f"--profiles {folder}: no such folder",
                remedy="Name a folder that contains printers/, materials/ or qualities/",
            )
    return folders


def collect_changes(arguments: argparse.Namespace) -> dict[str, object]:
    """Return the settings that --set and other options change.

    Raises:
        UsageError: --set lacks a value, or the name of a profile is empty.
    """
    _translate_other_slicer_settings(arguments)
    _translate_overrides(arguments)
    changes = _collect_option_changes(arguments)
    if getattr(arguments, "baud", None):
        changes["printer.baud"] = arguments.baud
    for change in arguments.set:
        key, equals, value = change.partition("=")
        if not equals or not key.strip():
            raise UsageError(
                f"--set {change}: expected KEY=VALUE", remedy="Write for example --set infill_density=0.2"
            )
        changes[key.strip()] = value.strip()
    if getattr(arguments, "firmware", None) and not {"flavour", "printer.flavour"} & set(changes):
        changes["printer.flavour"] = _find_flavour(arguments.firmware)
    _apply_layer_height(changes)
    for flag in ("printer", "material", "quality"):
        if getattr(arguments, flag, None) == "":
            raise UsageError(
                f"--{flag}: the name is empty",
                remedy="Leave the option out, or list the names with `printer-slicer profiles`",
            )
    return changes


def _translate_other_slicer_settings(arguments: argparse.Namespace) -> None:
    """Replace settings of other slicers in --set by settings of this program, and note each replacement.

    Raises:
        UsageError: a setting of another slicer has no counterpart, or a name is ambiguous.
    """
    pairs = [change.partition("=") for change in arguments.set]
    given = [(key.strip(), value.strip()) for key, equals, value in pairs if equals]
    if len(given) < len(arguments.set):
        return  # reported when the changes are collected
    found = _translate_settings(arguments, given)
    result: list[str] = []
    for change, one in zip(arguments.set, found, strict=True):
        if one is None:
            result.append(change)
            continue
        changes = [f"{ours}={_format_value(value)}" for ours, value in one.changes.items()]
        result += changes
        _get_translations(arguments).append((change, one, changes))
    arguments.set = result


def _describe_translation(setting: FamiliarSetting, changes: Sequence[str]) -> str:
    """Say in one line which settings of this program a setting of another slicer changes."""
    from textwrap import shorten

    typed, made, notes = (
        [shorten(" ".join(one.split()), _MAX_SHOWN, placeholder=" ...") for one in texts]
        for texts in (setting.typed, changes, setting.notes)
    )
    verb = "sets" if len(typed) == 1 else "set"
    text = " and ".join(typed) + (f" {verb} {', '.join(made)}" if made else "")
    return f"printer-slicer: {setting.slicer}'s {text}" + (f" ({'; '.join(notes)})" if notes else "")


def _translate_overrides(arguments: argparse.Namespace) -> None:
    """Replace settings of other slicers in --range and --set-for, and note each replacement.

    Raises:
        UsageError: a setting of another slicer has no counterpart, or a name is ambiguous.
    """
    for option in ("range", "set_for"):
        for rule in getattr(arguments, option, ())[:]:
            head, equals, value = rule.partition("=")
            where, _, key = head.rpartition(":")
            if not equals or not where:
                continue  # reported when the changes are collected
            begin = f"--{option.replace('_', '-')} {where}:"
            (found,) = _translate_settings(arguments, [(key.strip(), value.strip())], begin)
            if found is None:
                continue
            made = [
                f"{where}:{ours.partition('.')[2]}={_format_value(one)}"
                for ours, one in found.changes.items()
            ]
            rules: list[str] = getattr(arguments, option)
            rules[rules.index(rule) : rules.index(rule) + 1] = made
            _get_translations(arguments).append((rule, found, made))


def _translate_settings(
    arguments: argparse.Namespace, given: Sequence[tuple[str, str]], begin: str = "--set "
) -> Sequence[FamiliarSetting | None]:
    """Convert settings of other slicers, using the selected profile; return None for settings of this program.

    Args:
        arguments: the command line.
        given: names and values.
        begin: what was typed before each name, for messages.

    Raises:
        ProfileError: a setting of another slicer has no counterpart, or a name is ambiguous.
    """
    from printer_slicer.profile.keys import is_setting
    from printer_slicer.profile.tables import accepts_form

    if all(is_setting(key) and accepts_form(key, value) for key, value in given):
        return [None] * len(given)  # without the modules that convert profiles
    from printer_slicer.importing.familiar import translate_settings

    try:
        return translate_settings(
            given, partial(_load_context, arguments), lambda name, value: f"{begin}{name}={value}"
        )
    except ProfileError as error:
        message = str(error.args[0])
        typed = any(message.startswith(f"{name}=") for name, _ in given)
        raise ProfileError(f"{begin}{message}" if typed else message, remedy=error.remedy) from None


def _load_context(arguments: argparse.Namespace, own: Mapping[str, object]) -> Profile:
    """Load the profile whose values are used to convert settings of other slicers.

    Args:
        arguments: the command line.
        own: settings of this program that the command line changes.
    """
    from printer_slicer.profile import complete_profile

    names = {kind: getattr(arguments, kind, None) for kind in ("printer", "material", "quality")}
    folders = check_profile_folders(arguments)
    loaded = read_loaded_files(arguments, names).values
    options = _collect_option_changes(arguments)
    around = {key: value for key, value in options.items() if not key.endswith("+")}
    with suppress(ProfileError):  # reported when all settings are applied
        return complete_profile(loaded, names, {**around, **own}, folders)
    return complete_profile(loaded, names, {}, folders)


def _get_translations(arguments: argparse.Namespace) -> list[tuple[str, FamiliarSetting, list[str]]]:
    """Return each setting of another slicer on the command line: typed text, meaning, and the changes that it makes."""
    if not hasattr(arguments, "translations"):
        arguments.translations = []
    found: list[tuple[str, FamiliarSetting, list[str]]] = arguments.translations
    return found


def print_translations(arguments: argparse.Namespace) -> None:
    """Print which settings of this program were set by settings of other slicers, once all values are checked."""
    for _, setting, changes in [] if arguments.quiet else _get_translations(arguments):
        if changes or setting.notes:
            print(sanitize(_describe_translation(setting, changes)), file=sys.stderr)
    arguments.translations = []


def _format_value(value: object) -> str:
    """Format the value of a setting as it is typed."""
    from printer_slicer.profile.lists import format_list

    return format_list(value) if isinstance(value, list | tuple) else str(value)


def _find_flavour(firmware: str) -> str:
    """Return the G-code flavour of a simulated firmware."""
    from printer_slicer.sim.firmwares import SIMULATED_FIRMWARES

    return SIMULATED_FIRMWARES[firmware].dialect


def _collect_option_changes(arguments: argparse.Namespace) -> dict[str, object]:
    """Return the settings that are changed by options such as --infill, and by --heights, --range and --set-for."""
    given = {
        key.removeprefix("setting "): value
        for key, value in vars(arguments).items()
        if key.startswith("setting ")
    }
    changes: dict[str, object] = {key: value for key, value in given.items() if value is not None}
    changes |= _parse_heights(str(changes.pop("heights", "")))
    own = list(getattr(arguments, "set_for", ()))
    planned: list[str] = []
    for rule in getattr(arguments, "range", ()):
        of_planner = all(
            part.partition("=")[0].strip() in _PLANNER_RANGE_SETTINGS
            for part in rule.split(":")[2:]
            if "=" in part
        )
        if not of_planner:
            _check_range(rule)
        (planned if of_planner else own).append(rule)
    # The ranges are added after those of the quality profile, because the last one takes precedence.
    changes |= {"quality.planner.ranges+": ";".join(planned)} if planned else {}
    return changes | ({"quality.overrides+": ";".join(own)} if own else {})


def _parse_heights(heights: str) -> dict[str, str]:
    """Return the settings that --heights changes.

    Raises:
        UsageError: it is neither a list nor a range.
    """
    if ":" not in heights:
        return {"quality.layer_heights": heights} if heights else {}
    low, high, *step = heights.split(":")
    if len(step) > 1:
        raise UsageError(
            f"--heights {heights}: expected LOW:HIGH or LOW:HIGH:STEP",
            remedy="Write for example --heights 0.1:0.3:0.02, in mm",
        )
    changes = {
        "quality.thinnest_layer": low,
        "quality.thickest_layer": high,
        "quality.layer_heights": "",
    }
    return changes | ({"quality.layer_step": step[0]} if step else {})


def _check_range(rule: str) -> None:
    """Check that a value of --range starts with two heights; other text would be taken for an object's name.

    Raises:
        UsageError: the value starts with something else.
    """
    from printer_slicer.profile.overrides import HIGHEST, has_height_range

    if not has_height_range(rule):
        raise UsageError(
            f"--range {rule}: expected LOW:HIGH:KEY=VALUE",
            remedy=f"Give two heights in mm, such as 5:10:perimeters=4, or 5:{HIGHEST:g}:perimeters=4 up to the top; "
            "to change the settings of one object, use --set-for",
        )


# A layer height selects a planner


def _apply_layer_height(changes: dict[str, object]) -> None:
    """Select the planner for a given layer height: uniform, or optimal if ranges have other layer heights.

    Args:
        changes: setting -> value from the command line; the planner and its layer heights are added.

    Raises:
        UsageError: the selected planner, one of its settings or a list of heights contradicts the layer height.
    """
    named = {key.removeprefix("quality."): value for key, value in changes.items()}
    if "layer_height" not in named:
        return
    height = named["layer_height"]
    if listed := named.get("layer_heights"):
        raise UsageError(
            f"layer height {height}: uniform layers have one height, but --heights {listed} allows others",
            remedy="Leave out --heights or the layer height",
        )
    ranged = any(key in named for key in _RANGE_SETTINGS)
    planner = named.get("planner.kind")
    conflicting = list(_find_conflicting_options(changes))
    required_planner = "optimal" if ranged else "uniform"
    if conflicting or planner not in (None, required_planner):
        _reject_layer_height(height, planner, conflicting, required_planner)
    changes["quality.planner.kind"] = required_planner
    if ranged:
        changes["quality.layer_heights"] = height


def _find_conflicting_options(changes: Mapping[str, object]) -> Iterator[str]:
    """Yield the options that only planners with variable layer heights use, which contradict a given layer height."""
    from printer_slicer.profile.planners import PLANNER_SETTINGS
    from printer_slicer.profile.quality import Quality

    flags = {option.setting: flag for flag, option in SETTING_OPTIONS.items()}
    own = {name for kind in PLANNER_SETTINGS.values() for name in kind.__struct_fields__}
    own -= set(Quality.__struct_fields__)
    for key, value in changes.items():
        short = key.removeprefix("quality.")
        if short in _RANGE_SETTINGS:
            if "tolerance" in str(value):
                yield f"--range {value}" if key.endswith("+") else f"--set {key}"
        elif short in own or (short.startswith("planner.") and short != "planner.kind"):
            yield flags.get(key, f"--set {key}")


def _reject_layer_height(
    height: object, planner: object, conflicting: list[str], required_planner: str
) -> NoReturn:
    """Raise an error that names the options that contradict the layer height.

    Raises:
        UsageError: always.
    """
    if not conflicting and required_planner == "optimal":
        raise UsageError(
            f"layer height {height}: the {planner} planner does not support ranges; only --planner optimal does",
            remedy=f"Leave out --planner {planner}",
        )
    if not conflicting:
        raise UsageError(
            f"layer height {height}: the {planner} planner chooses the layer heights; only --planner uniform uses a "
            "given one",
            remedy=f"Leave out the planner or the layer height, or limit the heights with --heights 0.1:{height}",
        )
    others = [*([f"--planner {planner}"] if planner not in (None, "uniform") else []), *conflicting]
    rest = "the layer height or the other options" if len(others) > 1 else f"{others[0]} or the layer height"
    raise UsageError(
        f"layer height {height} and {', '.join(others)} contradict each other: layers are either uniform or chosen by "
        "a planner",
        remedy=f"Leave out {rest}. To limit the heights of a planner, use --heights 0.1:{height}; for another height "
        "in part of the print, use --range LOW:HIGH:layer_height=MM.",
    )


# Profiles and where they come from


def _find_profile_sources(
    names: Mapping[str, str | None], own: FileSettings, folders: Sequence[Path]
) -> dict[str, dict[str, Any]]:
    """Return the `name` and origin (`from`) of each kind of profile, and an unknown machine (`named_in_file`).

    Args:
        names: kind -> name on the command line; None if the command line names no profile.
        own: settings in the file.
        folders: further folders of profiles.
    """
    from printer_slicer.profile import DEFAULT_NAMES

    sources: dict[str, dict[str, Any]] = {}
    for kind, name in names.items():
        if name:
            sources[kind] = {"name": _resolve_profile_name(kind, name, folders), "from": f"--{kind}"}
        elif kind in own.values:
            sources[kind] = {"name": name_settings(kind, own.values[kind], folders), "from": own.source}
        else:
            sources[kind] = {"name": DEFAULT_NAMES[kind], "from": "default"}
            if kind == "printer" and own.unknown:
                sources[kind]["named_in_file"] = own.unknown
    return sources


def _resolve_profile_name(kind: str, name: str, folders: Sequence[Path]) -> str:
    """Return the name of the profile that a typed name selects; a path is returned unchanged."""
    from printer_slicer.profile.reading import find_profile_file

    return name if name.endswith(".toml") or "/" in name else find_profile_file(kind, name, folders).stem


# Where new profiles go


def find_folder_for_new_profiles(named: Sequence[Path], what: str, remedy: str) -> Path:
    """Return the folder for new profiles: the first one on the command line, or the user's own.

    Args:
        named: folders from the command line.
        what: the action, for the message.
        remedy: remedy of the error.

    Raises:
        UsageError: there is no such folder.
    """
    from printer_slicer.profile.folders import find_user_folders

    folders = [*named, *find_user_folders()]
    if not folders:
        raise UsageError(f"{what}: there is no folder for your own profiles", remedy=remedy)
    return folders[0]


def write_schemas(folder: Path) -> list[Path]:
    """Write the JSON schemas of all kinds into a folder, which is created if missing; return their paths.

    Raises:
        OutputError: the folder cannot be created or written to.
    """
    from printer_slicer.profile import KINDS
    from printer_slicer.profile.schema import format_schema, make_schema_name

    make_folder(folder)
    paths = [folder / make_schema_name(kind) for kind in KINDS]
    for kind, path in zip(KINDS, paths, strict=True):
        write_file(path, format_schema(kind).encode())
    return paths


def prepare_schema_folder(root: Path | None) -> Path | None:
    """Return the folder of the shipped schemas; or write the schemas into the user's own folder, and return None.

    Args:
        root: the folder of the user's own profiles; None: profiles refer to the shipped schemas.
    """
    from printer_slicer.profile.folders import SCHEMAS, find_shipped_profiles

    if root is None:
        return find_shipped_profiles() / SCHEMAS
    write_schemas(root / SCHEMAS)
    return None
