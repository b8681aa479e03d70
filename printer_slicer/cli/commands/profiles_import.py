"""`profiles import`: convert profiles of other slicers to profiles of this program."""

from __future__ import annotations

import argparse
import json
import shlex
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from printer_slicer.cli.arguments import add_output_options, parse_positive_integer
from printer_slicer.cli.output import print_text, sanitize, write_file
from printer_slicer.cli.settings import find_folder_for_new_profiles, prepare_schema_folder
from printer_slicer.errors import OutputError, ProfileError, UsageError
from printer_slicer.saving import make_folder
from printer_slicer.values import replace

if TYPE_CHECKING:
    from printer_slicer.importing import ImportedProfile, ImportNote, RejectedProfile
    from printer_slicer.macros import Value
    from printer_slicer.profile import Profile

__all__ = ["EXAMPLES", "add_arguments", "run"]

EXAMPLES: Final = """\
  printer-slicer profiles import config.ini                       exported by PrusaSlicer or SuperSlicer
  printer-slicer profiles import printed_before.gcode             the settings at the end of the G-code
  printer-slicer profiles import Creality.ini --list              list the presets of a bundle
  printer-slicer profiles import Creality.ini --for "Creality Ender-3 V2" --name ender3
  printer-slicer profiles import "Generic PLA @System.json" --folder filament
  printer-slicer profiles import creality_ender3.def.json --cura layer_height=0.2
  printer-slicer profiles import fine.curaprofile --folder cura/resources/definitions
"""
_MAX_DIFFERENCES: Final = 5
_MAX_WARNINGS: Final = 3
_MAX_DETAILED: Final = 3  # profiles; with more of them, only counts and warnings are printed
_FORMER_KEYS: Final = {
    "taken_over": "taken",
    "without_equivalent": "no_counterpart",
    "rejected": "refused",
    "source_setting": "theirs",
    "source_value": "text",
    "setting": "ours",
    "conversion": "how",
    "reason": "why",
    "not_applicable": "off",
}
"""Key of JSON -> its former name, which this release has as well."""
_MACROS: Final = ("start_gcode", "before_layer_gcode", "layer_gcode", "pause_gcode", "end_gcode")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `profiles import`."""
    parser.add_argument(
        "files",
        nargs="+",
        metavar="FILE",
        type=Path,
        help="file with settings: config.ini, bundle, G-code or 3MF of PrusaSlicer or SuperSlicer; preset, G-code or "
        "3MF of OrcaSlicer or BambuStudio; definition or profile of Cura; G-code of this program",
    )
    parser.add_argument(
        "--name", default="", help="name of the new profiles; default: derived from the names in the files"
    )
    parser.add_argument(
        "-o",
        "--out",
        metavar="FOLDER",
        type=Path,
        help="folder for the new profiles; default: the folder of your own profiles",
    )
    _add_conversion_options(parser)
    add_output_options(parser)


def _add_conversion_options(parser: argparse.ArgumentParser) -> None:
    """Add the arguments that choose presets and change how they are converted."""
    parser.add_argument("--force", action="store_true", help="overwrite existing profiles")
    parser.add_argument("--list", action="store_true", help="only list the presets in the files")
    parser.add_argument("--dry-run", action="store_true", help="print the result, but write no files")
    parser.add_argument(
        "--only",
        metavar="NAME",
        action="append",
        default=[],
        help="import only presets with this name, in which * matches any text; may be repeated",
    )
    parser.add_argument(
        "--for",
        dest="preset",
        metavar="PRINTER",
        default="",
        help="import only this printer of a bundle, with its default material and quality",
    )
    parser.add_argument(
        "--folder",
        metavar="FOLDER",
        type=Path,
        action="append",
        default=[],
        help="search this folder for presets from which the imported ones inherit; may be repeated",
    )
    parser.add_argument(
        "--cura",
        metavar="KEY=VALUE",
        action="append",
        default=[],
        help="replace the value of a setting in files of Cura; may be repeated",
    )
    for heater, limit in (("nozzle", 300), ("bed", 120)):
        parser.add_argument(
            f"--max-{heater}-temperature",
            metavar="°C",
            type=parse_positive_integer,
            default=limit,
            help=f"reject profiles that heat the {heater} above this; default: {limit}",
        )


def run(arguments: argparse.Namespace) -> int:
    """Import presets, write the profiles and report the conversion."""
    from printer_slicer.importing import ImportedProfile, RejectedProfile

    results = list(_import_files(arguments))
    imported = _add_macro_notes([one for one in results if isinstance(one, ImportedProfile)])
    refused = [one for one in results if isinstance(one, RejectedProfile)]
    if arguments.list:
        _list_presets(arguments, results)
        return 0
    paths = _choose_paths(arguments, imported) if imported else []
    if not arguments.dry_run:
        _write_profiles(arguments, imported, paths)
    if arguments.json:
        print(json.dumps(_report_facts(imported, paths, refused)))
    elif not arguments.quiet:
        for line in _format_report(arguments, imported, paths, refused):
            print(sanitize(line))
    if refused and not imported:
        raise ProfileError(refused[0].problem, remedy=refused[0].remedy)
    return 0


def _import_files(arguments: argparse.Namespace) -> Iterator[Any]:
    """Import the files; yield an imported or a rejected profile for each preset."""
    from printer_slicer.importing import ImportRequest, TemperatureLimits, import_profiles

    overrides: dict[str, str] = {}
    for change in arguments.cura:
        key, sign, value = change.partition("=")
        if not sign:
            raise UsageError(f"--cura {change}: the value is missing", remedy="Write --cura KEY=VALUE")
        overrides[key.strip()] = value.strip()
    for heater in ("nozzle", "bed"):
        _check_temperature_limit(heater, getattr(arguments, f"max_{heater}_temperature"))
    wanted = ImportRequest(
        names=tuple(arguments.only),
        printer=arguments.preset,
        limits=TemperatureLimits(arguments.max_nozzle_temperature, arguments.max_bed_temperature),
        folders=tuple(arguments.folder),
        cura=overrides,
    )
    for path in arguments.files:
        yield from import_profiles(path, wanted)


def _check_temperature_limit(heater: str, limit: float) -> None:
    """Check a temperature limit against the bounds of the printer setting.

    Raises:
        UsageError: the limit is out of bounds.
    """
    from printer_slicer.profile import load_profile

    try:
        load_profile(changes={f"printer.max_{heater}_temperature": limit}, slices=False)
    except ProfileError as error:
        raise UsageError(
            f"--max-{heater}-temperature {limit:g}: {str(error.args[0]).rpartition(': ')[2]}",
            remedy="Choose a temperature within the bounds of this printer setting",
        ) from None


def _list_presets(arguments: argparse.Namespace, results: Sequence[Any]) -> None:
    """Print kind and name of each preset in the files."""
    if arguments.json:
        print(json.dumps([{"kind": one.kind, "name": one.name, "source": one.source} for one in results]))
        return
    for one in results:
        print_text(arguments, sanitize(f"{one.kind:<10}{one.name}"))


def _choose_paths(arguments: argparse.Namespace, imported: Sequence[ImportedProfile]) -> list[Path]:
    """Choose the path of each new profile: the typed name, or a name that is not taken."""
    from printer_slicer.importing import choose_file_names
    from printer_slicer.name_search import split_name
    from printer_slicer.profile.folders import FOLDERS, find_shipped_profiles

    root: Path = arguments.out or find_folder_for_new_profiles(
        (), "profiles import", "Name a folder with -o FOLDER"
    )

    def is_taken(kind: str, file_name: str, name: str) -> bool:
        """Return whether the name would replace another preset's profile, or is similar to a shipped profile's name."""
        folder = Path(FOLDERS[kind])
        shipped = [split_name(path.stem) for path in (find_shipped_profiles() / folder).glob("*.toml")]
        mine = _read_display_name(root / folder / f"{file_name}.toml")
        return split_name(file_name) in shipped or mine not in ("", name)

    names = (
        _check_typed_name(arguments.name, imported)
        if arguments.name
        else choose_file_names(imported, is_taken)
    )
    return [root / FOLDERS[one.kind] / f"{name}.toml" for one, name in zip(imported, names, strict=True)]


def _check_typed_name(name: str, imported: Sequence[ImportedProfile]) -> list[str]:
    """Check the name that was typed with --name; return it once for each profile.

    Raises:
        UsageError: the name is not valid, or there are several profiles of one kind.
    """
    from printer_slicer.importing import make_short_name

    if name != (valid := make_short_name(name)):
        hint = f"Use --name {valid}" if valid else "Use lower-case letters, digits and underscores"
        raise UsageError(f"--name {name}: this is not a valid name of a profile", remedy=hint)
    if len({one.kind for one in imported}) < len(imported):
        raise UsageError(
            f"--name {name}: one name is not enough for {len(imported)} profiles, several of one kind",
            remedy="Choose one profile of each kind with --only or --for",
        )
    return [name] * len(imported)


def _read_display_name(path: Path) -> str:
    """Return the display name in a profile file; empty if there is none."""
    try:
        found = tomllib.loads(path.read_text(encoding="utf-8")).get("name", "")
    except (OSError, ValueError):
        return ""
    return found if isinstance(found, str) else ""


def _write_profiles(
    arguments: argparse.Namespace, imported: Sequence[ImportedProfile], paths: Sequence[Path]
) -> None:
    """Write all profiles, or none if --force is not given and a file exists with other contents.

    Raises:
        OutputError: a file exists with other contents, or cannot be written.
    """
    from printer_slicer.importing import format_profile
    from printer_slicer.profile.schema import format_schema_directive

    if not imported:
        return
    schemas = prepare_schema_folder(None if arguments.out else paths[0].parent.parent)
    texts = [
        f"{format_schema_directive(one.kind, schemas)}\n{format_profile(one)}".encode() for one in imported
    ]
    existing = [path for path, text in zip(paths, texts, strict=True) if _has_other_contents(path, text)]
    if existing and not arguments.force:
        more = f" and {len(existing) - 1} more" if len(existing) > 1 else ""
        raise OutputError(
            f"{existing[0]}{more}: already exists, with other contents",
            remedy="Overwrite it with --force, or keep both with --name NAME or -o FOLDER",
        )
    for path, text in zip(paths, texts, strict=True):
        make_folder(path.parent)
        write_file(path, text)


def _has_other_contents(path: Path, text: bytes) -> bool:
    """Return whether a path exists and is not a file with this content."""
    return path.exists() and not (path.is_file() and path.read_bytes() == text)


def _report_facts(imported: Sequence[Any], paths: Sequence[Path], refused: Sequence[Any]) -> dict[str, Any]:
    """Return the report of the import for JSON, with the former names of renamed keys beside them."""
    rejected = [
        {
            "kind": one.kind,
            "name": one.name,
            "source": one.source,
            "problem": one.problem,
            "remedy": one.remedy,
        }
        for one in refused
    ]
    profiles = [_report_profile(one, path) for one, path in zip(imported, paths, strict=True)]
    return {"imported": profiles, **_add_former_keys({"rejected": rejected})}


def _report_profile(one: ImportedProfile, path: Path) -> dict[str, Any]:
    """Return the report of one imported profile for JSON."""
    taken_over = [
        {
            "source_setting": each.theirs,
            "source_value": each.text,
            "setting": f"{one.kind}.{each.ours}",
            "value": each.value,
            "conversion": each.how,
        }
        for each in one.taken
    ]
    without_equivalent = [
        {
            "source_setting": each.theirs,
            "source_value": each.text,
            "reason": each.why,
            "not_applicable": each.off,
        }
        for each in one.left
    ]
    return {
        "kind": one.kind,
        "name": one.name,
        "source": one.source,
        "path": str(path),
        **_add_former_keys(
            {
                "taken_over": [_add_former_keys(each) for each in taken_over],
                "without_equivalent": [_add_former_keys(each) for each in without_equivalent],
            }
        ),
        "warnings": [{"place": note.place, "text": note.text} for note in one.notes],
    }


def _add_former_keys(facts: dict[str, Any]) -> dict[str, Any]:
    """Return a JSON object with each renamed key also under its former name."""
    return facts | {_FORMER_KEYS[key]: value for key, value in facts.items() if key in _FORMER_KEYS}


def _format_report(
    arguments: argparse.Namespace,
    imported: Sequence[ImportedProfile],
    paths: Sequence[Path],
    refused: Sequence[RejectedProfile],
) -> Iterator[str]:
    """Yield the report of the import: counts, largest differences, warnings, and a command that uses the profiles."""
    for one, path in zip(imported, paths, strict=True):
        taken = sum(1 for each in one.taken if each.theirs)
        lost = sum(1 for each in one.left if not each.off)
        yield (
            f"{one.kind} {path.stem} from {one.name!r}: {taken} settings taken over, "
            f"{len(one.left) - lost} not applicable, {lost} without equivalent"
        )
        if arguments.verbose:
            yield from _format_all_settings(one)
    yield from (
        _format_largest_differences(imported)
        if not arguments.verbose and len(imported) <= _MAX_DETAILED
        else ()
    )
    folders = {f"{path.parent}/" for path in arguments.files}
    for text in _format_warnings(imported, verbose=arguments.verbose):
        yield next((text.replace(one, "", 1) for one in folders if one in text), text)
    for reason in refused:
        yield f"rejected: {reason.kind} {reason.name!r}: {reason.problem}"
        yield f"  {reason.remedy}"
    if not imported:
        return
    folder = paths[0].parent.parent
    rejected = f"; {len(refused)} rejected" if refused else ""
    if arguments.dry_run:
        yield f"{_format_count(len(imported), 'profile')} would be written to {folder}{rejected}"
        return
    yield f"{_format_count(len(imported), 'profile')} written to {folder}{rejected}"
    yield from _format_next_command(arguments, imported, paths)


def _format_count(number: int, noun: str) -> str:
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"


def _format_all_settings(one: ImportedProfile) -> Iterator[str]:
    """Yield a line for each setting of the source file and of the new profile."""
    from printer_slicer.profile.reading import flatten_tables

    for taken in one.taken:
        source = f"{taken.theirs} = {_shorten(taken.text)}" if taken.theirs else "not set"
        reason = f" ({taken.how})" if taken.how else ""
        for key, value in flatten_tables({taken.ours: taken.value}):
            yield f"  {source} -> {key} = {_format_setting(value)}{reason}"
    for left in one.left:
        word = "not applicable" if left.off else "no equivalent"
        yield f"  {word}: {left.theirs} = {_shorten(left.text)} ({left.why})"


def _format_setting(value: object) -> str:
    """Format the value of a setting on one line."""
    if isinstance(value, bool):
        return str(value).lower()
    return "..." if "\n" in str(value) else str(value)


def _shorten(text: str) -> str:
    return text if len(text) <= 40 else f"{text[:37]}..."


def _format_largest_differences(imported: Sequence[ImportedProfile]) -> Iterator[str]:
    """Yield the differences from the source that change the print most."""
    from printer_slicer.importing import find_largest_differences

    found = find_largest_differences(imported)
    shown = found[:_MAX_DIFFERENCES]
    if shown:
        yield "largest differences from the source:"
        yield from (f"  {one.text}" for one in shown)
    hidden = len(found) - len(shown)
    more = f"{_format_count(hidden, 'more difference')} and all settings" if hidden else "all settings"
    yield f"add -v to see {more}"


def _format_warnings(imported: Sequence[ImportedProfile], *, verbose: bool) -> Iterator[str]:
    """Yield the warnings of the import; by default, only the first few that are not among the differences."""
    from printer_slicer.importing import find_other_notes

    notes = [note for one in imported for note in (one.notes if verbose else find_other_notes(one))]
    shown = notes if verbose else notes[:_MAX_WARNINGS]
    yield from (f"warning: {note.place}: {note.text}" for note in shown)
    if len(shown) < len(notes):
        yield f"add -v to see {_format_count(len(notes) - len(shown), 'more warning')}"


def _format_next_command(
    arguments: argparse.Namespace, imported: Sequence[ImportedProfile], paths: Sequence[Path]
) -> Iterator[str]:
    """Yield a command that uses the new profiles, or a warning if they do not fit together."""
    from printer_slicer.profile import load_profile

    names: dict[str, str] = {}
    for one, path in zip(imported, paths, strict=True):
        names.setdefault(one.kind, path.stem)
    folders = [arguments.out] if arguments.out else []
    try:
        load_profile(names.get("printer"), names.get("material"), names.get("quality"), folders=folders)
    except ProfileError as error:
        yield f"warning: the profiles do not fit together: {error.args[0]}"
        yield f"  {error.remedy}"
        return
    flags = [word for kind, name in names.items() for word in (f"--{kind}", name)]
    words = ["printer-slicer", "slice", "MODEL", *flags, *(f"--profiles={folder}" for folder in folders)]
    yield "to slice with them:"
    yield f"  {shlex.join(words)}"


# Commands in the G-code of imported printers that `print` would reject


def _add_macro_notes(imported: Sequence[ImportedProfile]) -> list[ImportedProfile]:
    """Add a note to each printer for every command in its macros that `print` rejects without --allow.

    Args:
        imported: the profiles of a file; a material among them gives the values of temperatures.
    """
    from printer_slicer.profile import load_profile, settings_as_dict

    usual = settings_as_dict(load_profile())
    kinds = [one.kind for one in imported]
    known = {one.kind: _remove_overrides(one.values) for one in imported if kinds.count(one.kind) == 1}
    return [replace(one, notes=(*one.notes, *_find_macro_notes(one, usual | known))) for one in imported]


def _remove_overrides(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return the settings without overrides, which can be checked only when the objects are known."""
    return {key: value for key, value in values.items() if key != "overrides"}


def _find_macro_notes(one: ImportedProfile, others: Mapping[str, Mapping[str, Any]]) -> Iterator[ImportNote]:
    """Yield a note for each rejected command in the macros of a profile."""
    from printer_slicer.macros import add_names_of_other_slicers
    from printer_slicer.profile import restore_profile
    from printer_slicer.profile.reading import flatten_tables

    if one.kind != "printer" or not any(one.values.get(name) for name in _MACROS):
        return
    values = {**others, "printer": one.values}
    profile = restore_profile(values)
    names: dict[str, Value] = {}
    for kind, part in values.items():
        for key, value in flatten_tables(part):
            if isinstance(value, (bool, int, float, str)):
                names[f"{kind}.{key}"] = value
                names.setdefault(key, value)
    known = add_names_of_other_slicers(names)
    for name in _MACROS:
        commands = list(_list_macro_commands(str(one.values.get(name, "")), known))
        yield from _find_rejected_commands(commands, profile, f"{one.source}: {name}")


def _find_rejected_commands(commands: Sequence[bytes], profile: Profile, place: str) -> Iterator[ImportNote]:
    """Yield a note for each command that `print` rejects."""
    from printer_slicer.importing import ImportNote
    from printer_slicer.inspection.lint.scan import scan

    for found in scan(commands, profile, moves=()):
        if found.is_error:
            text = f"{found.command}: {found.message}; {found.reason}: `print` rejects it without --allow {found.code}"
            yield ImportNote(place, text)


def _list_macro_commands(macro: str, names: Mapping[str, Value]) -> Iterator[bytes]:
    """Yield the commands in all branches of a macro; unknown values become 0."""
    from printer_slicer.macros import read_template

    try:
        lines = read_template(macro, "").list_possible_lines(names)
    except ProfileError:  # the import has reported it
        return
    for line in lines:
        if command := line.partition(";")[0].strip():
            yield command.encode("ascii", "replace")
