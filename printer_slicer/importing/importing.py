"""From files of other slicers to profiles of ours, each with an account of what became of it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from difflib import get_close_matches
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Final

from printer_slicer.errors import ProfileError
from printer_slicer.importing.bundle import Bundle
from printer_slicer.importing.materials import material_from
from printer_slicer.importing.presets import Preset
from printer_slicer.importing.printers import Company, printer_from
from printer_slicer.importing.qualities import quality_from
from printer_slicer.importing.report import Imported, Refused
from printer_slicer.importing.safety import CEILINGS, Ceilings, check_safe
from printer_slicer.importing.sources import Found, presets_in
from printer_slicer.importing.usual import with_usual

__all__ = ["ImportRequest", "import_found", "import_profiles"]

_WITH_PRINTER: Final = ("material", "quality")


@dataclass(frozen=True, slots=True)
class ImportRequest:
    """What shall be imported, and how.

    Attributes:
        names: patterns, of which a preset's name must match one; empty: all.
        kinds: `printer`, `material`, `quality`.
        printer: name of a printer in a bundle, or of its model: it and its default material and quality, as they are
            for it.
        ceilings: of temperatures.
        folders: where presets are that others inherit from.
        cura: changes of Cura's settings.
    """

    names: tuple[str, ...] = ()
    kinds: tuple[str, ...] = ("printer", "material", "quality")
    printer: str = ""
    ceilings: Ceilings = CEILINGS
    folders: tuple[Path, ...] = ()
    cura: Mapping[str, str] = field(default_factory=dict)

    def takes(self, kind: str, name: str) -> bool:
        """Whether a preset is wanted."""
        return kind in self.kinds and (
            not self.names or any(name == one or fnmatchcase(name, one) for one in self.names)
        )


def import_profiles(path: Path, wanted: ImportRequest = ImportRequest()) -> list[Imported | Refused]:
    """The profiles in a file of another slicer.

    Args:
        path: `config.ini`, a bundle, G-code, 3MF, a preset of OrcaSlicer or BambuStudio; G-code of this program.
        wanted: which of them, and how.

    Returns:
        One entry for each preset that is wanted: the profile, or why it is refused.

    Raises:
        ProfileError: the file cannot be read, or holds nothing that is wanted.
    """
    return import_found(presets_in(path, wanted.folders, wanted.cura), wanted, str(path))


def import_found(found: Found, wanted: ImportRequest, place: str) -> list[Imported | Refused]:
    """The same for what was read already."""
    if isinstance(found, Bundle):
        made = list(_of_bundle(found, wanted))
    else:
        native = [one for one in found if isinstance(one, Imported)]
        presets = [one for one in found if isinstance(one, Preset)]
        made = [*_of_few(presets, wanted), *(_safe(one, wanted) for one in native if _takes(one, wanted))]
    if not made:
        raise ProfileError(
            f"{place}: no preset of this name in it",
            remedy="`printer-slicer profiles import FILE --list` names them",
        )
    return made


def _of_few(presets: Sequence[Preset], wanted: ImportRequest) -> Iterator[Imported | Refused]:
    """Presets that belong together: they know of each other."""
    printer = next((preset for preset in presets if preset.kind == "printer"), None)
    quality = next((preset for preset in presets if preset.kind == "quality"), None)

    def made(preset: Preset) -> Imported | Refused:
        known = _beside(preset, printer if preset.kind in _WITH_PRINTER else quality)
        if preset.kind == "material" and quality is not None:
            known = replace(known, heights=_heights(quality))
        return _one(known, presets, wanted)

    done = [made(preset) for preset in presets]
    others = [one for one in done if isinstance(one, Imported) and one.kind in _WITH_PRINTER]
    for one in done:
        if wanted.takes(one.kind, one.name):
            yield with_usual(one, others) if isinstance(one, Imported) and one.kind == "printer" else one


def _heights(quality: Preset) -> tuple[float, float]:
    """Return the heights of the first layer and the others, mm; 0 if invalid, which the quality import reports."""
    with suppress(ProfileError):
        height = quality.number("layer_height")
        return quality.quantity("first_layer_height").of(height) or height, height
    return 0.0, 0.0


def _of_bundle(bundle: Bundle, wanted: ImportRequest) -> Iterator[Imported | Refused]:
    if wanted.printer:
        yield from _of_few(_triple(bundle, wanted), replace(wanted, names=()))
        return
    read = list(bundle.presets())
    others = [one for one in read if isinstance(one, Preset) and one.kind in _WITH_PRINTER]
    for preset in read:
        if not wanted.takes(preset.kind, preset.name):
            continue
        if isinstance(preset, Refused):
            yield preset
            continue
        suiting = [one for one in others if bundle.suits(one, preset)] if preset.kind == "printer" else ()
        made = _one(preset, suiting, wanted)
        if isinstance(made, Imported) and made.kind == "printer":
            names = {kind: bundle.companion(preset, kind) for kind in _WITH_PRINTER}
            usual = [_beside(one, preset) for one in suiting if one.name == names[one.kind]]
            known = [_one(one, (), wanted) for one in usual]
            made = with_usual(made, [one for one in known if isinstance(one, Imported)])
        yield made


def _triple(bundle: Bundle, wanted: ImportRequest) -> list[Preset]:
    """A printer of a bundle with the material and the quality that it has by default, or those that are named.

    Raises:
        ProfileError: there is no such printer.
    """
    called = bundle.printer_called(wanted.printer)
    if not called:
        known = [name for name in bundle.sections["printer"] if not name.startswith("*")]
        near = get_close_matches(wanted.printer, known, n=3)
        hint = f"did you mean {' or '.join(map(repr, near))}? " if near else ""
        raise ProfileError(
            f"{bundle.place}: no printer {wanted.printer!r} among {len(known)}",
            remedy=f"{hint}--list names all",
        )
    printer = bundle.preset("printer", called)
    found = [printer]
    for kind in _WITH_PRINTER:
        named = [name for name in bundle.sections[kind] if wanted.names and wanted.takes(kind, name)]
        names = named or [bundle.companion(printer, kind)]
        found += [bundle.preset(kind, name) for name in names if name and not name.startswith("*")]
    return found


def _beside(preset: Preset, other: Preset | None) -> Preset:
    """A preset that knows the settings of another one, with what holds where that says nothing."""
    if other is None:
        return preset
    known = dict(other.defaults) | {name: entry.text for name, entry in other.entries.items()}
    return replace(preset, together=known)


def _one(preset: Preset, company: Sequence[Preset], wanted: ImportRequest) -> Imported | Refused:
    """A preset converted and found safe, or why it is not."""
    makers: Mapping[str, Callable[[Preset], Imported]] = {
        "printer": lambda one: printer_from(one, _company(company, wanted.ceilings)),
        "material": material_from,
        "quality": quality_from,
    }
    try:
        made = makers[preset.kind](preset)
        check_safe(made, preset, wanted.ceilings)
    except ProfileError as error:
        return Refused(preset.kind, preset.name, preset.place, str(error.args[0]), error.remedy)
    return made


def _takes(one: Imported, wanted: ImportRequest) -> bool:
    return wanted.takes(one.kind, one.name)


def _safe(made: Imported, wanted: ImportRequest) -> Imported | Refused:
    """A profile of this program, or why it is refused."""
    try:
        check_safe(made, Preset(made.kind, made.name, "printer_slicer", made.source, {}), wanted.ceilings)
    except ProfileError as error:
        return Refused(made.kind, made.name, made.source, str(error.args[0]), error.remedy)
    return made


def _company(presets: Sequence[Preset], ceilings: Ceilings) -> Company:
    """Temperatures and layer heights of what is meant for a printer, as far as an import lets them through."""
    nozzle = _numbers(presets, "material", ("temperature", "first_layer_temperature"))
    bed = _numbers(presets, "material", ("bed_temperature", "first_layer_bed_temperature"))
    heights = _numbers(presets, "quality", ("layer_height", "first_layer_height"))
    return Company(
        max((one for one in nozzle if one <= ceilings.nozzle), default=0.0),
        max((one for one in bed if one <= ceilings.bed), default=0.0),
        min(heights, default=0.0),
        max(heights, default=0.0),
    )


def _numbers(presets: Sequence[Preset], kind: str, keys: Sequence[str]) -> list[float]:
    """Positive values of some settings; what is no number is told where its own preset is imported."""
    found = []
    for preset in presets:
        for key in keys if preset.kind == kind else ():
            with suppress(ProfileError):
                one = preset.quantity(key)
                value = one.of(preset.number("layer_height")) if one.percent else one.value
                found += [value] if value > 0 else []
    return found
