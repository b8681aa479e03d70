"""`profiles import`: make profiles from those of other slicers."""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from printer_slicer.cli.arguments import add_output, positive
from printer_slicer.cli.output import say, visible, write_file
from printer_slicer.cli.settings import kept_schemas, own_folder
from printer_slicer.errors import OutputError, ProfileError, UsageError
from printer_slicer.saving import make_folder

if TYPE_CHECKING:
    from printer_slicer.importing import Imported, ImportNote
    from printer_slicer.macros import Value
    from printer_slicer.profile import Profile

__all__ = ["EXAMPLES", "add_arguments", "run"]

EXAMPLES: Final = """\
  printer-slicer profiles import config.ini                       what PrusaSlicer or SuperSlicer exported
  printer-slicer profiles import printed_before.gcode             the settings at the end of their G-code
  printer-slicer profiles import Creality.ini --list              what a vendor's bundle holds
  printer-slicer profiles import Creality.ini --for "Creality Ender-3 V2" -o profiles
  printer-slicer profiles import "Generic PLA @System.json" --folder filament
  printer-slicer profiles import creality_ender3.def.json --cura layer_height=0.2   where Cura's other definitions are
  printer-slicer profiles import fine.curaprofile --folder cura/resources/definitions
"""
_IN_FULL: Final = 3  # profiles; more are told in a line each
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
    parser.add_argument(
        "-o", "--out", metavar="FOLDER", type=Path, help="where to write; default: your own profiles"
    )
    _add_choices(parser)
    add_output(parser)


def _add_choices(parser: argparse.ArgumentParser) -> None:
    """What of a file is wanted, and how."""
    parser.add_argument("--force", action="store_true", help="write over profiles that are there")
    parser.add_argument("--list", action="store_true", help="only name what the files hold")
    parser.add_argument("--dry-run", action="store_true", help="only say what would become of it")
    parser.add_argument(
        "--only",
        metavar="NAME",
        action="append",
        default=[],
        help="presets of this name, * stands for anything; may be repeated",
    )
    parser.add_argument(
        "--for",
        dest="preset",
        metavar="PRINTER",
        default="",
        help="a printer of a bundle, with what suits it",
    )
    parser.add_argument(
        "--folder",
        metavar="FOLDER",
        type=Path,
        action="append",
        default=[],
        help="where presets are that others inherit from",
    )
    parser.add_argument(
        "--cura",
        metavar="KEY=VALUE",
        action="append",
        default=[],
        help="change a setting of Cura; may be repeated",
    )
    for heater, most in (("nozzle", 300), ("bed", 120)):
        parser.add_argument(
            f"--max-{heater}-temperature",
            metavar="°C",
            type=positive,
            default=most,
            help=f"refuse profiles that heat the {heater} further; default: {most}",
        )


def run(arguments: argparse.Namespace) -> int:
    """Import, write, and tell what became of everything."""
    from printer_slicer.importing import Imported, Refused

    results = list(_results(arguments))
    made = _with_macro_notes([one for one in results if isinstance(one, Imported)])
    refused = [one for one in results if isinstance(one, Refused)]
    if arguments.list:
        _list(arguments, results)
        return 0
    paths = _write(arguments, made)
    if arguments.json:
        print(json.dumps(_facts(made, paths, refused)))
    elif not arguments.quiet:
        for line in _told(arguments, made, paths, refused):
            print(visible(line))
    if refused and not made:
        raise ProfileError(refused[0].problem, remedy=refused[0].remedy)
    return 0


def _results(arguments: argparse.Namespace) -> Iterator[Any]:
    """What becomes of every preset in every file."""
    from printer_slicer.importing import Ceilings, ImportRequest, import_profiles

    overrides: dict[str, str] = {}
    for change in arguments.cura:
        key, sign, value = change.partition("=")
        if not sign:
            raise UsageError(f"--cura {change}: no value", remedy="write --cura KEY=VALUE")
        overrides[key.strip()] = value.strip()
    for heater in ("nozzle", "bed"):
        _check_ceiling(heater, getattr(arguments, f"max_{heater}_temperature"))
    wanted = ImportRequest(
        names=tuple(arguments.only),
        printer=arguments.preset,
        ceilings=Ceilings(arguments.max_nozzle_temperature, arguments.max_bed_temperature),
        folders=tuple(arguments.folder),
        cura=overrides,
    )
    for path in arguments.files:
        yield from import_profiles(path, wanted)


def _check_ceiling(heater: str, most: float) -> None:
    """Refuse a ceiling that no printer of ours may have.

    Raises:
        UsageError: it is one.
    """
    from printer_slicer.profile import load_profile

    try:
        load_profile(changes={f"printer.max_{heater}_temperature": most}, slices=False)
    except ProfileError as error:
        raise UsageError(
            f"--max-{heater}-temperature {most:g}: {str(error.args[0]).rpartition(': ')[2]}",
            remedy="no profile of a printer lets it become so hot, or so cold",
        ) from None


def _list(arguments: argparse.Namespace, results: Sequence[Any]) -> None:
    if arguments.json:
        print(json.dumps([{"kind": one.kind, "name": one.name, "source": one.source} for one in results]))
        return
    for one in results:
        say(arguments, visible(f"{one.kind:<10}{one.name}"))


def _write(arguments: argparse.Namespace, made: Sequence[Any]) -> list[Path]:
    """Write all files, or none where one is there already."""
    from printer_slicer.importing import names_of_files, profile_text
    from printer_slicer.profile.folders import FOLDERS
    from printer_slicer.profile.schema import directive

    if not made:
        return []
    root: Path = arguments.out or own_folder((), "profiles import", "name one with -o FOLDER")
    paths = [
        root / FOLDERS[one.kind] / f"{name}.toml"
        for one, name in zip(made, names_of_files(made), strict=True)
    ]
    if arguments.dry_run:
        return paths
    schemas = kept_schemas(None if arguments.out else root)
    texts = [f"{directive(one.kind, schemas)}\n{profile_text(one)}".encode() for one in made]
    there = [path for path, text in zip(paths, texts, strict=True) if _differs(path, text)]
    if there and not arguments.force:
        more = f" and {len(there) - 1} more" if len(there) > 1 else ""
        raise OutputError(
            f"{there[0]}{more}: there already", remedy="--force writes over it, -o FOLDER elsewhere"
        )
    for path, text in zip(paths, texts, strict=True):
        make_folder(path.parent)
        write_file(path, text)
    return paths


def _differs(path: Path, text: bytes) -> bool:
    """Whether there is something else than what shall be written."""
    return path.exists() and not (path.is_file() and path.read_bytes() == text)


def _facts(made: Sequence[Any], paths: Sequence[Path], refused: Sequence[Any]) -> dict[str, Any]:
    """Everything, for programs."""
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


def _told(
    arguments: argparse.Namespace, made: Sequence[Any], paths: Sequence[Path], refused: Sequence[Any]
) -> Iterator[str]:
    """Everything, for people: few profiles in full, many in a line each."""
    full = len(made) <= _IN_FULL or arguments.verbose
    for one, path in zip(made, paths, strict=True):
        lost = [left for left in one.left if not left.off]
        counts = f"{len(one.taken)} settings, {len(one.approximated)} approximated, {len(lost)} without counterpart"
        yield f"{one.kind} {one.name!r} -> {path}"
        yield f"  {counts}, {len(one.notes)} to look at"
        for note in one.notes:
            yield f"  look at  {note.place}: {note.text}"
        if full:
            yield from _in_full(one, lost, arguments.verbose)
    for one in refused:
        yield f"refused: {one.kind} {one.name!r}: {one.problem}"
        yield f"  {one.remedy}"
    written = "would be written" if arguments.dry_run else "written"
    yield f"{len(made)} profiles {written}, {len(refused)} refused"
    by_kind = {one.kind: path for one, path in zip(made, paths, strict=True)}
    if len(made) == len(by_kind) == 3 and not arguments.dry_run:
        flags = " ".join(f"--{kind} {path}" for kind, path in by_kind.items())
        yield f"try it: printer-slicer dry-run PART.stl {flags}"
    yield from _contradictions(made)


def _in_full(one: Any, lost: Sequence[Any], verbose: bool) -> Iterator[str]:
    for taken in one.taken:
        if taken.how or verbose:
            value = "..." if isinstance(taken.value, str) and "\n" in taken.value else taken.value
            source = f"{taken.theirs} = {_short(taken.text)}" if taken.theirs else "not set"
            yield f"  {'about  ' if taken.how else 'same   '}  {source} -> {taken.ours} = {value}" + (
                f" ({taken.how})" if taken.how else ""
            )
    for left in lost:
        yield f"  left out {left.theirs} = {_short(left.text)} ({left.why})"


def _short(text: str) -> str:
    return text if len(text) <= 40 else f"{text[:37]}..."


def _contradictions(made: Sequence[Any]) -> Iterator[str]:
    """What the three parts of one profile contradict each other in."""
    from printer_slicer.profile.faults import find_value_conflicts

    parts = {one.kind: one.values for one in made}
    if len(made) == len(parts) == 3:
        for key, problem, remedy in find_value_conflicts(**parts):
            yield f"look at  {key}: {problem}: {remedy}"


# What `print` would refuse in the G-code of imported printers, found before anything is printed with it


def _with_macro_notes(made: Sequence[Imported]) -> list[Imported]:
    """The profiles, printers among them with a note for each command that is refused unless somebody allows it.

    Args:
        made: the profiles of a file; a material among them says what temperatures stand for.
    """
    from printer_slicer.profile import load_profile, settings_of

    usual = settings_of(load_profile())
    kinds = [one.kind for one in made]
    known = {one.kind: _without_own(one.values) for one in made if kinds.count(one.kind) == 1}
    return [replace(one, notes=(*one.notes, *_notes(one, usual | known))) for one in made]


def _without_own(values: Mapping[str, Any]) -> dict[str, Any]:
    """Settings without those of single objects, which are judged when there are objects."""
    return {key: value for key, value in values.items() if key != "overrides"}


def _notes(one: Imported, others: Mapping[str, Mapping[str, Any]]) -> Iterator[ImportNote]:
    """What is refused in the macros of one profile."""
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
        yield from _refused(commands, profile, f"{one.source}: {name}")


def _refused(commands: Sequence[bytes], profile: Profile, place: str) -> Iterator[ImportNote]:
    from printer_slicer.importing import ImportNote
    from printer_slicer.inspection.lint.scan import scan

    for found in scan(commands, profile, moves=()):
        if found.is_error:
            text = f"{found.command}: {found.message}; {found.reason}: `print` refuses it without --allow {found.code}"
            yield ImportNote(place, text)


def _commands(macro: str, names: Mapping[str, Value]) -> Iterator[bytes]:
    """The commands of a macro, of every branch that may be taken, with values where they are known, 0 elsewhere."""
    from printer_slicer.macros import read_template

    try:
        lines = read_template(macro, "").possible_lines(names)
    except ProfileError:  # which the import has told
        return
    for line in lines:
        if command := line.partition(";")[0].strip():
            yield command.encode("ascii", "replace")
