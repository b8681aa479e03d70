"""Convert the presets in files of other slicers to profiles."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from difflib import get_close_matches
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Final

from printer_slicer.errors import ProfileError
from printer_slicer.importing.bundle import PresetBundle
from printer_slicer.importing.materials import convert_material
from printer_slicer.importing.presets import Preset
from printer_slicer.importing.printer_defaults import add_printer_defaults
from printer_slicer.importing.printers import CompanionRanges, convert_printer
from printer_slicer.importing.qualities import convert_quality
from printer_slicer.importing.results import ImportedProfile, ImportNote, RejectedProfile
from printer_slicer.importing.safety_checks import DEFAULT_LIMITS, TemperatureLimits, check_safe
from printer_slicer.importing.source_files import PresetsInFile, read_presets
from printer_slicer.name_search import without_nozzle

__all__ = ["ImportRequest", "convert_presets", "import_profiles"]

_MOST_SHOWN: Final = 6  # printers in a message
_WITH_PRINTER: Final = ("material", "quality")


@dataclass(frozen=True, slots=True)
class ImportRequest:
    """Which presets to import, and how.

    Attributes:
        names: patterns for names of presets, one of which must match; empty: all presets.
        kinds: `printer`, `material`, `quality`.
        printer: name of a printer in a bundle; only it and its default material and quality are imported.
        limits: temperature limits.
        folders: folders with the presets that others inherit from.
        cura: values that replace those of Cura's settings.
    """

    names: tuple[str, ...] = ()
    kinds: tuple[str, ...] = ("printer", "material", "quality")
    printer: str = ""
    limits: TemperatureLimits = DEFAULT_LIMITS
    folders: tuple[Path, ...] = ()
    cura: Mapping[str, str] = field(default_factory=dict)

    def takes(self, kind: str, name: str) -> bool:
        """Return whether a preset is to be imported."""
        return kind in self.kinds and (
            not self.names or any(name == one or fnmatchcase(name, one) for one in self.names)
        )


def import_profiles(
    path: Path, wanted: ImportRequest = ImportRequest()
) -> list[ImportedProfile | RejectedProfile]:
    """Import the presets in a file of another slicer.

    Args:
        path: `config.ini`, a bundle, G-code, 3MF, a preset of OrcaSlicer or BambuStudio; G-code of this program.
        wanted: which presets, and how.

    Returns:
        For each preset, the profile or the reason for rejecting it.

    Raises:
        ProfileError: the file cannot be read, or no preset in it is wanted.
    """
    return convert_presets(read_presets(path, wanted.folders, wanted.cura), wanted, str(path))


def convert_presets(
    found: PresetsInFile, wanted: ImportRequest, place: str
) -> list[ImportedProfile | RejectedProfile]:
    """Convert presets that are already read; as `import_profiles`."""
    if isinstance(found, PresetBundle):
        made = list(_convert_bundle(found, wanted))
    else:
        native = [one for one in found if isinstance(one, ImportedProfile)]
        presets = [one for one in found if isinstance(one, Preset)]
        made = [
            *_convert_together(presets, wanted),
            *(_safe(one, wanted) for one in native if _takes(one, wanted)),
        ]
    if not made:
        raise ProfileError(
            f"{place}: no preset has this name",
            remedy="Use `printer-slicer profiles import FILE --list` to list the presets",
        )
    return made


def _convert_together(
    presets: Sequence[Preset], wanted: ImportRequest
) -> Iterator[ImportedProfile | RejectedProfile]:
    """Convert presets that belong together, each with the settings of the others."""
    printer = next((preset for preset in presets if preset.kind == "printer"), None)
    quality = next((preset for preset in presets if preset.kind == "quality"), None)

    def made(preset: Preset) -> ImportedProfile | RejectedProfile:
        known = _with_settings_of(preset, printer if preset.kind in _WITH_PRINTER else quality)
        if preset.kind == "material" and quality is not None:
            known = replace(known, heights=_heights(quality))
        return _convert_preset(known, presets, wanted)

    done = [made(preset) for preset in presets]
    others = [one for one in done if isinstance(one, ImportedProfile) and one.kind in _WITH_PRINTER]
    for one in done:
        if wanted.takes(one.kind, one.name):
            yield (
                add_printer_defaults(one, others)
                if isinstance(one, ImportedProfile) and one.kind == "printer"
                else one
            )


def _heights(quality: Preset) -> tuple[float, float]:
    """Return the heights of the first layer and the others, mm; 0 if invalid (the quality import reports that)."""
    with suppress(ProfileError):
        height = quality.number("layer_height")
        return quality.quantity("first_layer_height").of(height) or height, height
    return 0.0, 0.0


def _convert_bundle(
    bundle: PresetBundle, wanted: ImportRequest
) -> Iterator[ImportedProfile | RejectedProfile]:
    if wanted.printer:
        yield from _convert_together(_printer_with_defaults(bundle, wanted), replace(wanted, names=()))
        return
    read = list(bundle.presets())
    others = [one for one in read if isinstance(one, Preset) and one.kind in _WITH_PRINTER]
    for preset in read:
        if not wanted.takes(preset.kind, preset.name):
            continue
        if isinstance(preset, RejectedProfile):
            yield preset
            continue
        suiting = (
            [one for one in others if bundle.is_compatible(one, preset)] if preset.kind == "printer" else ()
        )
        made = _convert_preset(preset, suiting, wanted)
        if isinstance(made, ImportedProfile) and made.kind == "printer":
            names = {kind: bundle.default_preset(preset, kind) for kind in _WITH_PRINTER}
            usual = [_with_settings_of(one, preset) for one in suiting if one.name == names[one.kind]]
            known = [_convert_preset(one, (), wanted) for one in usual]
            made = add_printer_defaults(made, [one for one in known if isinstance(one, ImportedProfile)])
        yield made


def _printer_with_defaults(bundle: PresetBundle, wanted: ImportRequest) -> list[Preset]:
    """Return a printer of a bundle with its default material and quality, or with those that are named.

    Raises:
        ProfileError: no printer has this name.
    """
    printer = _printer_called(bundle, wanted.printer)
    found = [printer]
    for kind in _WITH_PRINTER:
        named = [name for name in bundle.sections[kind] if wanted.names and wanted.takes(kind, name)]
        names = named or [bundle.default_preset(printer, kind)]
        found += [bundle.preset(kind, name) for name in names if name and not name.startswith("*")]
    return found


def _printer_called(bundle: PresetBundle, name: str) -> Preset:
    """Return the printer of a bundle with a name; with a note if its model has several nozzles.

    Raises:
        ProfileError: no printer matches, or several models do.
    """
    printers = bundle.find_printers(name)
    models = list(dict.fromkeys(without_nozzle(one.name) for one in printers))
    if len(models) == 1:
        printer = bundle.choose_nozzle(printers)
        if len(printers) == 1:
            return printer
        nozzles = ", ".join(
            f"{size:g}" for size in sorted({one.number("nozzle_diameter") for one in printers})
        )
        taken = f"{printer.number('nozzle_diameter'):g} mm is imported ({printer.name})"
        note = ImportNote(bundle.place, f"{name!r} has nozzles of {nozzles} mm: {taken}")
        return replace(printer, notes=(note, *printer.notes))
    if models:
        shown = ", ".join(models[:_MOST_SHOWN]) + (", ..." if len(models) > _MOST_SHOWN else "")
        raise ProfileError(
            f"{bundle.place}: {len(models)} printers match {name!r}: {shown}", remedy="Use a longer name"
        )
    known = [one for one in bundle.sections["printer"] if not one.startswith("*")]
    near = get_close_matches(name, known, n=3)
    hint = f"Did you mean {' or '.join(map(repr, near))}? " if near else ""
    raise ProfileError(
        f"{bundle.place}: no printer {name!r} among {len(known)}", remedy=f"{hint}Use --list to list all"
    )


def _with_settings_of(preset: Preset, other: Preset | None) -> Preset:
    """Return a preset with the settings and defaults of another one as its context."""
    if other is None:
        return preset
    known = dict(other.defaults) | {name: entry.text for name, entry in other.entries.items()}
    return replace(preset, context=known)


def _convert_preset(
    preset: Preset, companions: Sequence[Preset], wanted: ImportRequest
) -> ImportedProfile | RejectedProfile:
    """Convert a preset and check that it is safe; or return why not."""
    makers: Mapping[str, Callable[[Preset], ImportedProfile]] = {
        "printer": lambda one: convert_printer(one, _companion_ranges(companions, wanted.limits)),
        "material": convert_material,
        "quality": convert_quality,
    }
    try:
        made = makers[preset.kind](preset)
        check_safe(made, preset, wanted.limits)
    except ProfileError as error:
        return RejectedProfile(preset.kind, preset.name, preset.place, str(error.args[0]), error.remedy)
    return made


def _takes(one: ImportedProfile, wanted: ImportRequest) -> bool:
    return wanted.takes(one.kind, one.name)


def _safe(made: ImportedProfile, wanted: ImportRequest) -> ImportedProfile | RejectedProfile:
    """Return a profile of this program if it is safe, or why not."""
    try:
        check_safe(made, Preset(made.kind, made.name, "printer_slicer", made.source, {}), wanted.limits)
    except ProfileError as error:
        return RejectedProfile(made.kind, made.name, made.source, str(error.args[0]), error.remedy)
    return made


def _companion_ranges(presets: Sequence[Preset], limits: TemperatureLimits) -> CompanionRanges:
    """Return the ranges of the materials and qualities for a printer, without temperatures above the limits."""
    nozzle = _numbers(presets, "material", ("temperature", "first_layer_temperature"))
    bed = _numbers(presets, "material", ("bed_temperature", "first_layer_bed_temperature"))
    heights = _numbers(presets, "quality", ("layer_height", "first_layer_height"))
    return CompanionRanges(
        max((one for one in nozzle if one <= limits.nozzle), default=0.0),
        max((one for one in bed if one <= limits.bed), default=0.0),
        min(heights, default=0.0),
        max(heights, default=0.0),
    )


def _numbers(presets: Sequence[Preset], kind: str, keys: Sequence[str]) -> list[float]:
    """Return the positive values of some settings; invalid ones are reported when their own preset is imported."""
    found = []
    for preset in presets:
        for key in keys if preset.kind == kind else ():
            with suppress(ProfileError):
                one = preset.quantity(key)
                value = one.of(preset.number("layer_height")) if one.percent else one.value
                found += [value] if value > 0 else []
    return found
