"""Convert the presets in files of other slicers to profiles."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
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
from printer_slicer.importing.safety_checks import DEFAULT_LIMITS, TemperatureLimits, check_safety
from printer_slicer.importing.source_files import PresetsInFile, read_presets
from printer_slicer.name_search import remove_nozzle
from printer_slicer.values import Struct, field, replace

__all__ = ["ImportRequest", "convert_presets", "import_profiles"]

_MAX_SHOWN: Final = 6  # printers in a message
_COMPANION_KINDS: Final = ("material", "quality")


class ImportRequest(Struct, frozen=True):
    """A selection of presets to import, and options of the import.

    Attributes:
        names: patterns for names of presets, one of which must match; empty: all presets.
        kinds: `printer`, `material`, `quality`.
        printer: name of a printer in a bundle; only it and its default material and quality are imported.
        limits: temperature limits.
        folders: folders with presets that the imported ones inherit from.
        cura: values that replace those of Cura's settings.
    """

    names: tuple[str, ...] = ()
    kinds: tuple[str, ...] = ("printer", "material", "quality")
    printer: str = ""
    limits: TemperatureLimits = DEFAULT_LIMITS
    folders: tuple[Path, ...] = ()
    cura: Mapping[str, str] = field(default_factory=dict)

    def includes(self, kind: str, name: str) -> bool:
        """Return whether a preset is selected."""
        return kind in self.kinds and (
            not self.names or any(name == one or fnmatchcase(name, one) for one in self.names)
        )


def import_profiles(
    path: Path, request: ImportRequest = ImportRequest()
) -> list[ImportedProfile | RejectedProfile]:
    """Import the presets in a file of another slicer.

    Args:
        path: `config.ini`, a bundle, G-code, 3MF, a preset of OrcaSlicer or BambuStudio; G-code of this program.
        request: the presets to import, and options.

    Returns:
        For each preset, the profile or the reason for rejecting it.

    Raises:
        ProfileError: the file cannot be read, or no preset in it is selected.
    """
    return convert_presets(read_presets(path, request.folders, request.cura), request, str(path))


def convert_presets(
    found: PresetsInFile, request: ImportRequest, place: str
) -> list[ImportedProfile | RejectedProfile]:
    """Convert presets that were already read; return the same as `import_profiles`."""
    if isinstance(found, PresetBundle):
        made = list(_convert_bundle(found, request))
    else:
        native = [one for one in found if isinstance(one, ImportedProfile)]
        presets = [one for one in found if isinstance(one, Preset)]
        made = [
            *_convert_related(presets, request),
            *(_check_native_profile(one, request) for one in native if _is_requested(one, request)),
        ]
    if not made:
        raise ProfileError(
            f"{place}: no preset matches the name",
            remedy="Use `printer-slicer profiles import FILE --list` to list the presets",
        )
    return made


def _convert_related(
    presets: Sequence[Preset], request: ImportRequest
) -> Iterator[ImportedProfile | RejectedProfile]:
    """Convert the printer, material and quality of one file; each conversion also uses the settings of the others."""
    printer = next((preset for preset in presets if preset.kind == "printer"), None)
    quality = next((preset for preset in presets if preset.kind == "quality"), None)

    def convert(preset: Preset) -> ImportedProfile | RejectedProfile:
        """Convert one preset in the context of the printer or of the quality."""
        known = _add_context(preset, printer if preset.kind in _COMPANION_KINDS else quality)
        if preset.kind == "material" and quality is not None:
            known = replace(known, heights=_read_layer_heights(quality))
        return _convert_preset(known, presets, request)

    done = [convert(preset) for preset in presets]
    others = [one for one in done if isinstance(one, ImportedProfile) and one.kind in _COMPANION_KINDS]
    for one in done:
        if request.includes(one.kind, one.name):
            yield (
                add_printer_defaults(one, others)
                if isinstance(one, ImportedProfile) and one.kind == "printer"
                else one
            )


def _read_layer_heights(quality: Preset) -> tuple[float, float]:
    """Return the heights of the first layer and of the other layers, mm.

    Invalid heights give 0; the import of the quality reports them.
    """
    with suppress(ProfileError):
        height = quality.read_number("layer_height")
        return quality.read_quantity("first_layer_height").resolve(height) or height, height
    return 0.0, 0.0


def _convert_bundle(
    bundle: PresetBundle, request: ImportRequest
) -> Iterator[ImportedProfile | RejectedProfile]:
    """Convert the selected presets of a bundle; printers get defaults from their default material and quality."""
    if request.printer:
        yield from _convert_related(
            _select_printer_and_companions(bundle, request), replace(request, names=())
        )
        return
    read = list(bundle.resolve_presets())
    others = [one for one in read if isinstance(one, Preset) and one.kind in _COMPANION_KINDS]
    for preset in read:
        if not request.includes(preset.kind, preset.name):
            continue
        if isinstance(preset, RejectedProfile):
            yield preset
            continue
        compatible = (
            [one for one in others if bundle.is_compatible(one, preset)] if preset.kind == "printer" else ()
        )
        made = _convert_preset(preset, compatible, request)
        if isinstance(made, ImportedProfile) and made.kind == "printer":
            names = {kind: bundle.find_default_name(preset, kind) for kind in _COMPANION_KINDS}
            default_presets = [_add_context(one, preset) for one in compatible if one.name == names[one.kind]]
            known = [_convert_preset(one, (), request) for one in default_presets]
            made = add_printer_defaults(made, [one for one in known if isinstance(one, ImportedProfile)])
        yield made


def _select_printer_and_companions(bundle: PresetBundle, request: ImportRequest) -> list[Preset]:
    """Return a printer of a bundle with its default material and quality, or with those in the request.

    Raises:
        ProfileError: no printer has this name.
    """
    printer = _find_printer(bundle, request.printer)
    found = [printer]
    for kind in _COMPANION_KINDS:
        named = [name for name in bundle.sections[kind] if request.names and request.includes(kind, name)]
        names = named or [bundle.find_default_name(printer, kind)]
        found += [bundle.resolve_preset(kind, name) for name in names if name and not name.startswith("*")]
    return found


def _find_printer(bundle: PresetBundle, name: str) -> Preset:
    """Return the printer of a bundle that matches a name, with a note if its model has several nozzles.

    Raises:
        ProfileError: no printer matches, or printers of several models match.
    """
    printers = bundle.find_printers(name)
    models = list(dict.fromkeys(remove_nozzle(one.name) for one in printers))
    if len(models) == 1:
        printer = bundle.choose_by_nozzle(printers)
        if len(printers) == 1:
            return printer
        nozzles = ", ".join(
            f"{size:g}" for size in sorted({one.read_number("nozzle_diameter") for one in printers})
        )
        taken = f"{printer.read_number('nozzle_diameter'):g} mm is imported ({printer.name})"
        note = ImportNote(bundle.place, f"{name!r} is available with nozzles of {nozzles} mm: {taken}")
        return replace(printer, notes=(note, *printer.notes))
    if models:
        shown = ", ".join(models[:_MAX_SHOWN]) + (", ..." if len(models) > _MAX_SHOWN else "")
        raise ProfileError(
            f"{bundle.place}: {len(models)} printers match {name!r}: {shown}", remedy="Use a longer name"
        )
    known = [one for one in bundle.sections["printer"] if not one.startswith("*")]
    near = get_close_matches(name, known, n=3)
    hint = f"Did you mean {' or '.join(map(repr, near))}? " if near else ""
    raise ProfileError(
        f"{bundle.place}: none of the {len(known)} printers is called {name!r}",
        remedy=f"{hint}Use --list to list all",
    )


def _add_context(preset: Preset, other: Preset | None) -> Preset:
    """Return a preset whose context is the settings and defaults of another preset."""
    if other is None:
        return preset
    known = dict(other.defaults) | {name: entry.text for name, entry in other.entries.items()}
    return replace(preset, context=known)


def _convert_preset(
    preset: Preset, companions: Sequence[Preset], request: ImportRequest
) -> ImportedProfile | RejectedProfile:
    """Convert a preset and check that it is safe; if either fails, return a rejected profile."""
    converters: Mapping[str, Callable[[Preset], ImportedProfile]] = {
        "printer": lambda one: convert_printer(one, _find_companion_ranges(companions, request.limits)),
        "material": convert_material,
        "quality": convert_quality,
    }
    try:
        made = converters[preset.kind](preset)
        check_safety(made, preset, request.limits)
    except ProfileError as error:
        return RejectedProfile(preset.kind, preset.name, preset.place, str(error.args[0]), error.remedy)
    return made


def _is_requested(profile: ImportedProfile, request: ImportRequest) -> bool:
    """Return whether a profile is selected."""
    return request.includes(profile.kind, profile.name)


def _check_native_profile(
    profile: ImportedProfile, request: ImportRequest
) -> ImportedProfile | RejectedProfile:
    """Check that a profile of this program is safe; if it is not, return a rejected profile."""
    try:
        check_safety(
            profile, Preset(profile.kind, profile.name, "printer_slicer", profile.source, {}), request.limits
        )
    except ProfileError as error:
        return RejectedProfile(profile.kind, profile.name, profile.source, str(error.args[0]), error.remedy)
    return profile


def _find_companion_ranges(presets: Sequence[Preset], limits: TemperatureLimits) -> CompanionRanges:
    """Return the ranges of temperature and layer height in presets; ignore temperatures above the limits."""
    nozzle = _read_positive_numbers(presets, "material", ("temperature", "first_layer_temperature"))
    bed = _read_positive_numbers(presets, "material", ("bed_temperature", "first_layer_bed_temperature"))
    heights = _read_positive_numbers(presets, "quality", ("layer_height",))
    first_heights = _read_positive_numbers(presets, "quality", ("first_layer_height",))
    return CompanionRanges(
        max((one for one in nozzle if one <= limits.nozzle), default=0.0),
        max((one for one in bed if one <= limits.bed), default=0.0),
        min([*heights, *first_heights], default=0.0),
        max(heights, default=0.0),
        max(first_heights, default=0.0),
    )


def _read_positive_numbers(presets: Sequence[Preset], kind: str, keys: Sequence[str]) -> list[float]:
    """Return the positive values of settings; invalid values are reported when their own preset is imported."""
    found = []
    for preset in presets:
        for key in keys if preset.kind == kind else ():
            with suppress(ProfileError):
                one = preset.read_quantity(key)
                value = one.resolve(preset.read_number("layer_height")) if one.is_percent else one.value
                found += [value] if value > 0 else []
    return found
