"""`profiles import`: convert profiles of other slicers."""

from __future__ import annotations

import argparse
import json
import shlex
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from printer_slicer.cli.arguments import add_output, positive
from printer_slicer.cli.output import sanitize, say, write_file
from printer_slicer.cli.settings import own_folder, schema_folder
from printer_slicer.errors import OutputError, ProfileError, UsageError
from printer_slicer.saving import make_folder

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
_MOST_DIFFERENCES: Final = 5
_MOST_WARNINGS: Final = 3
_FEW: Final = 3  # profiles; of more only counts and warnings are printed
_MACROS: Final = ("start_gcode", "before_layer_gcode", "layer_gcode", "pause_gcode", "end_gcode")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `profiles import`."""
    parser.add_argument(
        "files",
        nargs="+",
        metavar="FILE",
        type=Path,
        help="config.ini, bundle, G-code or 3MF of PrusaSlicer or SuperSlicer; preset, G-code or 3MF of OrcaSlicer or "
        "BambuStudio; definition of Cura; G-code of this program",
    )
    parser.add_argument("--name", default="", help="name of the new profiles; default: from the source")
    parser.add_argument(
        "-o", "--out", metavar="FOLDER", type=Path, help="output folder; default: your own profiles"
    )
    _add_choices(parser)
    add_output(parser)


def _add_choices(parser: argparse.ArgumentParser) -> None:
    """Add the arguments that choose presets and change how they are converted."""
    parser.add_argument("--force", action="store_true", help="overwrite existing profiles")
    parser.add_argument("--list", action="store_true", help="only list the presets in the files")
    parser.add_argument("--dry-run", action="store_true", help="only print the result; write nothing")
    parser.add_argument(
        "--only",
        metavar="NAME",
        action="append",
        default=[],
        help="only presets with this name; * matches anything; may be repeated",
    )
    parser.add_argument(
        "--for",
        dest="preset",
        metavar="PRINTER",
        default="",
        help="one printer of a bundle, with its default material and quality",
    )
    parser.add_argument(
        "--folder",
        metavar="FOLDER",
        type=Path,
        action="append",
        default=[],
        help="folder with the presets that others inherit from",
    )
    parser.add_argument(
        "--cura",
        metavar="KEY=VALUE",
        action="append",
        default=[],
        help="override a setting of Cura; may be repeated",
    )
    for heater, most in (("nozzle", 300), ("bed", 120)):
        parser.add_argument(
            f"--max-{heater}-temperature",
            metavar="°C",
            type=positive,
            default=most,
            help=f"reject profiles that heat the {heater} above this; default: {most}",
        )


def run(arguments: argparse.Namespace) -> int:
    """Import presets, write the profiles and report the conversion."""
    from printer_slicer.importing import ImportedProfile, RejectedProfile

    results = list(_results(arguments))
    made = _with_macro_notes([one for one in results if isinstance(one, ImportedProfile)])
    refused = [one for one in results if isinstance(one, RejectedProfile)]
    if arguments.list:
        _list(arguments, results)
        return 0
    paths = _paths(arguments, made) if made else []
    if not arguments.dry_run:
        _write(arguments, made, paths)
    if arguments.json:
        print(json.dumps(_json_report(made, paths, refused)))
    elif not arguments.quiet:
        for line in _report(arguments, made, paths, refused):
            print(sanitize(line))
    if refused and not made:
        raise ProfileError(refused[0].problem, remedy=refused[0].remedy)
    return 0


def _results(arguments: argparse.Namespace) -> Iterator[Any]:
    """Yield the profile, or the reason for rejecting it, for each preset in the files."""
    from printer_slicer.importing import ImportRequest, TemperatureLimits, import_profiles

    overrides: dict[str, str] = {}
    for change in arguments.cura:
        key, sign, value = change.partition("=")
        if not sign:
            raise UsageError(f"--cura {change}: no value", remedy="Write --cura KEY=VALUE")
        overrides[key.strip()] = value.strip()
    for heater in ("nozzle", "bed"):
        _check_limit(heater, getattr(arguments, f"max_{heater}_temperature"))
    wanted = ImportRequest(
        names=tuple(arguments.only),
        printer=arguments.preset,
        limits=TemperatureLimits(arguments.max_nozzle_temperature, arguments.max_bed_temperature),
        folders=tuple(arguments.folder),
        cura=overrides,
    )
    for path in arguments.files:
        yield from import_profiles(path, wanted)


def _check_limit(heater: str, most: float) -> None:
    """Check a temperature limit against the bounds of the printer setting.

    Raises:
        UsageError: it is out of bounds.
    """
    from printer_slicer.profile import load_profile

    try:
        load_profile(changes={f"printer.max_{heater}_temperature": most}, slices=False)
    except ProfileError as error:
        raise UsageError(
            f"--max-{heater}-temperature {most:g}: {str(error.args[0]).rpartition(': ')[2]}",
            remedy="Choose a temperature that a printer profile can have as its limit",
        ) from None


def _list(arguments: argparse.Namespace, results: Sequence[Any]) -> None:
    if arguments.json:
        print(json.dumps([{"kind": one.kind, "name": one.name, "source": one.source} for one in results]))
        return
    for one in results:
        say(arguments, sanitize(f"{one.kind:<10}{one.name}"))


def _paths(arguments: argparse.Namespace, made: Sequence[ImportedProfile]) -> list[Path]:
    """Return the path of each new profile."""
    from printer_slicer.importing import file_names
    from printer_slicer.profile.folders import FOLDERS, profile_root

    root: Path = arguments.out or own_folder((), "profiles import", "Name a folder with -o FOLDER")

    def is_taken(kind: str, file_name: str, name: str) -> bool:
        """Return whether a shipped profile, or one of another preset, has this name."""
        file = Path(FOLDERS[kind], f"{file_name}.toml")
        return (profile_root() / file).exists() or _display_name(root / file) not in ("", name)

    names = _named(arguments.name, made) if arguments.name else file_names(made, is_taken)
    return [root / FOLDERS[one.kind] / f"{name}.toml" for one, name in zip(made, names, strict=True)]


def _named(name: str, made: Sequence[ImportedProfile]) -> list[str]:
    """Return the file name that was typed, for each profile.

    Raises:
        UsageError: it is no file name, or there are several profiles of one kind.
    """
    from printer_slicer.importing import short_name

    if name != (valid := short_name(name)):
        hint = f"Use --name {valid}" if valid else "Use lower-case letters, digits and underscores"
        raise UsageError(f"--name {name}: not a valid name", remedy=hint)
    if len({one.kind for one in made}) < len(made):
        raise UsageError(
            f"--name {name}: there are {len(made)} profiles to import",
            remedy="Choose one of each kind with --only or --for",
        )
    return [name] * len(made)


def _display_name(path: Path) -> str:
    """Return the name in a profile file; empty if there is none."""
    try:
        found = tomllib.loads(path.read_text(encoding="utf-8")).get("name", "")
    except (OSError, ValueError):
        return ""
    return found if isinstance(found, str) else ""


def _write(arguments: argparse.Namespace, made: Sequence[ImportedProfile], paths: Sequence[Path]) -> None:
    """Write all files, or none if one exists with other contents and --force is not given."""
    from printer_slicer.importing import profile_text
    from printer_slicer.profile.schema import directive

    if not made:
        return
    schemas = schema_folder(None if arguments.out else paths[0].parent.parent)
    texts = [f"{directive(one.kind, schemas)}\n{profile_text(one)}".encode() for one in made]
    existing = [path for path, text in zip(paths, texts, strict=True) if _differs(path, text)]
    if existing and not arguments.force:
        more = f" and {len(existing) - 1} more" if len(existing) > 1 else ""
        raise OutputError(
            f"{existing[0]}{more}: already exists",
            remedy="Use --force to overwrite it, or --name NAME or -o FOLDER to keep both",
        )
    for path, text in zip(paths, texts, strict=True):
        make_folder(path.parent)
        write_file(path, text)


def _differs(path: Path, text: bytes) -> bool:
    """Return whether a path exists with other contents."""
    return path.exists() and not (path.is_file() and path.read_bytes() == text)


def _json_report(made: Sequence[Any], paths: Sequence[Path], refused: Sequence[Any]) -> dict[str, Any]:
    """Return the report for --json."""
    return {
        "imported": [
            {
                "kind": one.kind,
                "name": one.name,
                "source": one.source,
                "path": str(path),
                "taken": [
                    {
                        "theirs": t.theirs,
                        "text": t.text,
                        "ours": f"{one.kind}.{t.ours}",
                        "value": t.value,
                        "how": t.how,
                    }
                    for t in one.taken
                ],
                "no_counterpart": [
                    {"theirs": t.theirs, "text": t.text, "why": t.why, "off": t.off} for t in one.left
                ],
                "warnings": [{"place": note.place, "text": note.text} for note in one.notes],
            }
            for one, path in zip(made, paths, strict=True)
        ],
        "refused": [
            {
                "kind": one.kind,
                "name": one.name,
                "source": one.source,
                "problem": one.problem,
                "remedy": one.remedy,
            }
            for one in refused
        ],
    }


def _report(
    arguments: argparse.Namespace,
    made: Sequence[ImportedProfile],
    paths: Sequence[Path],
    refused: Sequence[RejectedProfile],
) -> Iterator[str]:
    """Yield the report: counts, the largest differences, warnings, and a command that uses the profiles."""
    for one, path in zip(made, paths, strict=True):
        taken = sum(1 for each in one.taken if each.theirs)
        lost = sum(1 for each in one.left if not each.off)
        yield (
            f"{one.kind} {path.stem} from {one.name!r}: {taken} settings taken over, "
            f"{len(one.left) - lost} not applicable, {lost} without equivalent"
        )
        if arguments.verbose:
            yield from _all_settings(one)
    yield from _differences(made) if not arguments.verbose and len(made) <= _FEW else ()
    folders = {f"{path.parent}/" for path in arguments.files}
    for text in _warnings(made, verbose=arguments.verbose):
        yield next((text.replace(one, "", 1) for one in folders if one in text), text)
    for reason in refused:
        yield f"rejected: {reason.kind} {reason.name!r}: {reason.problem}"
        yield f"  {reason.remedy}"
    if not made:
        return
    folder = paths[0].parent.parent
    rejected = f"; {len(refused)} rejected" if refused else ""
    if arguments.dry_run:
        yield f"{_count(len(made), 'profile')} would be written to {folder}{rejected}"
        return
    yield f"{_count(len(made), 'profile')} written to {folder}{rejected}"
    yield from _next_command(arguments, made, paths)


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"


def _all_settings(one: ImportedProfile) -> Iterator[str]:
    """Yield a line for each setting of the source and of the profile."""
    for taken in one.taken:
        value = "..." if isinstance(taken.value, str) and "\n" in taken.value else taken.value
        source = f"{taken.theirs} = {_short(taken.text)}" if taken.theirs else "not set"
        reason = f" ({taken.how})" if taken.how else ""
        yield f"  {source} -> {taken.ours} = {value}{reason}"
    for left in one.left:
        word = "not applicable" if left.off else "no equivalent"
        yield f"  {word}: {left.theirs} = {_short(left.text)} ({left.why})"


def _short(text: str) -> str:
    return text if len(text) <= 40 else f"{text[:37]}..."


def _differences(made: Sequence[ImportedProfile]) -> Iterator[str]:
    """Yield the differences that change the print most."""
    from printer_slicer.importing import largest_differences

    found = largest_differences(made)
    shown = found[:_MOST_DIFFERENCES]
    if shown:
        yield "largest differences from the source:"
        yield from (f"  {one.text}" for one in shown)
    hidden = len(found) - len(shown)
    more = f"{_count(hidden, 'more difference')} and all settings" if hidden else "all settings"
    yield f"add -v to see {more}"


def _warnings(made: Sequence[ImportedProfile], *, verbose: bool) -> Iterator[str]:
    """Yield the warnings; by default the first few that are not among the differences."""
    from printer_slicer.importing import other_notes

    notes = [note for one in made for note in (one.notes if verbose else other_notes(one))]
    shown = notes if verbose else notes[:_MOST_WARNINGS]
    yield from (f"warning: {note.place}: {note.text}" for note in shown)
    if len(shown) < len(notes):
        yield f"add -v to see {_count(len(notes) - len(shown), 'more warning')}"


def _next_command(
    arguments: argparse.Namespace, made: Sequence[ImportedProfile], paths: Sequence[Path]
) -> Iterator[str]:
    """Yield a command that uses the new profiles; before it, why they cannot be used together, if so."""
    from printer_slicer.profile import load_profile

    names: dict[str, str] = {}
    for one, path in zip(made, paths, strict=True):
        names.setdefault(one.kind, path.stem)
    folders = [arguments.out] if arguments.out else []
    flags = [word for kind, name in names.items() for word in (f"--{kind}", name)]
    command = ["profiles", "show"]
    try:
        load_profile(names.get("printer"), names.get("material"), names.get("quality"), folders=folders)
    except ProfileError as error:
        yield f"warning: the profiles do not fit together: {error.args[0]}"
        yield f"  {error.remedy}"
        flags = list(next(iter(names.items())))
    else:
        command = ["slice", "MODEL"]
        yield "to slice with them:"
    words = ["printer-slicer", *command, *flags, *(f"--profiles={folder}" for folder in folders)]
    yield f"  {shlex.join(words)}"


# Commands in the G-code of imported printers that `print` would reject


def _with_macro_notes(made: Sequence[ImportedProfile]) -> list[ImportedProfile]:
    """Add a note to printers for each command in their G-code that `print` rejects without --allow.

    Args:
        made: the profiles of a file; a material among them gives the values of temperatures.
    """
    from printer_slicer.profile import load_profile, settings_of

    usual = settings_of(load_profile())
    kinds = [one.kind for one in made]
    known = {one.kind: _without_overrides(one.values) for one in made if kinds.count(one.kind) == 1}
    return [replace(one, notes=(*one.notes, *_notes(one, usual | known))) for one in made]


def _without_overrides(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return the settings without overrides of single objects, which are checked when the objects are known."""
    return {key: value for key, value in values.items() if key != "overrides"}


def _notes(one: ImportedProfile, others: Mapping[str, Mapping[str, Any]]) -> Iterator[ImportNote]:
    """Yield a note for each rejected command in the macros of a profile."""
    from printer_slicer.macros import add_other_names
    from printer_slicer.profile import profile_from
    from printer_slicer.profile.reading import flatten

    if one.kind != "printer" or not any(one.values.get(name) for name in _MACROS):
        return
    values = {**others, "printer": one.values}
    profile = profile_from(values)
    names: dict[str, Value] = {}
    for kind, part in values.items():
        for key, value in flatten(part):
            if isinstance(value, (bool, int, float, str)):
                names[f"{kind}.{key}"] = value
                names.setdefault(key, value)
    known = add_other_names(names)
    for name in _MACROS:
        commands = list(_commands(str(one.values.get(name, "")), known))
        yield from _rejected(commands, profile, f"{one.source}: {name}")


def _rejected(commands: Sequence[bytes], profile: Profile, place: str) -> Iterator[ImportNote]:
    from printer_slicer.importing import ImportNote
    from printer_slicer.inspection.lint.scan import scan

    for found in scan(commands, profile, moves=()):
        if found.is_error:
            text = f"{found.command}: {found.message}; {found.reason}: `print` rejects it without --allow {found.code}"
            yield ImportNote(place, text)


def _commands(macro: str, names: Mapping[str, Value]) -> Iterator[bytes]:
    """Yield the commands of all branches of a macro, with 0 for unknown values."""
    from printer_slicer.macros import read_template

    try:
        lines = read_template(macro, "").possible_lines(names)
    except ProfileError:  # the import has reported it
        return
    for line in lines:
        if command := line.partition(";")[0].strip():
            yield command.encode("ascii", "replace")
