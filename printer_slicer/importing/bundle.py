"""Bundles of presets: sections that inherit from each other, vendors, models, what suits what."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from difflib import get_close_matches
from typing import Final

from printer_slicer.errors import ProfileError
from printer_slicer.importing.conditions import holds
from printer_slicer.importing.ini import Entry, Section, split_texts, unescaped
from printer_slicer.importing.presets import Preset
from printer_slicer.importing.report import Refused
from printer_slicer.importing.vocabulary import DEFAULTS

__all__ = ["Bundle", "bundle_of"]

_KINDS: Final = {"printer": "printer", "filament": "material", "print": "quality"}
_DEEPEST: Final = 50
_MOST_SOUGHT: Final = 5
_LONGEST_NAME: Final = 200  # characters
_WHOLE: Final = (
    30  # settings from which on a preset stands for itself, although what it inherits from is not there
)


@dataclass(frozen=True, slots=True)
class Bundle:
    """A file of many presets.

    Attributes:
        sections: kind -> name -> section, abstract ones included.
        models: name -> section that says what printers of this model are sold with.
        dialect: of its settings.
        place: its name.
    """

    sections: Mapping[str, Mapping[str, Section]]
    models: Mapping[str, Section]
    dialect: str
    place: str
    _known: dict[tuple[str, str], dict[str, Entry]] = field(default_factory=dict, repr=False)
    _sought: list[str] = field(default_factory=list, repr=False)

    def presets(self) -> Iterator[Preset | Refused]:
        """All presets but abstract ones, with what they inherit; or why one cannot be had."""
        for kind, sections in self.sections.items():
            for name, section in sections.items():
                if not name.startswith("*"):
                    try:
                        yield self.preset(kind, name)
                    except ProfileError as error:
                        yield Refused(kind, name, section.place, str(error.args[0]), error.remedy)

    def preset(self, kind: str, name: str) -> Preset:
        """One preset with what it inherits.

        Raises:
            ProfileError: it is not there, inherits from itself or from what is not there.
        """
        entries = self._resolved(kind, name, ())
        return Preset(kind, name, self.dialect, self.sections[kind][name].place, entries, DEFAULTS)

    def _resolved(self, kind: str, name: str, below: tuple[str, ...]) -> dict[str, Entry]:
        """The settings of a section over those it inherits; of several parents the later wins."""
        if (kind, name) in self._known:
            return self._known[kind, name]
        section = self.sections[kind][name]
        if name in below or len(below) > _DEEPEST:
            chain = " -> ".join((*below, name))
            raise ProfileError(f"{section.place}: inherits from itself: {chain}", remedy="break the circle")
        entries: dict[str, Entry] = {}
        parents = section.entries.get("inherits")
        for parent in split_texts(parents.text) if parents else ():
            if not parent:
                continue
            if parent in self.sections[kind]:
                entries |= self._resolved(kind, parent, (*below, name))
            elif len(section.entries) < _WHOLE:
                assert parents is not None
                near = self._near(parent, kind)
                hint = f"did you mean {near!r}? " if near else ""
                raise ProfileError(
                    f"{parents.place}: inherits = {parent}: no such preset in this file",
                    remedy=f"{hint}export the preset itself (File, Export, Export Config), which holds all of it",
                )
        self._known[kind, name] = entries | section.entries
        return self._known[kind, name]

    def _near(self, name: str, kind: str) -> str:
        """What may have been meant by a name that no preset has; empty where that is not looked for.

        It is looked for a few times only, as each takes time for every name there is.
        """
        if len(self._sought) >= _MOST_SOUGHT or len(name) > _LONGEST_NAME:
            return ""
        self._sought.append(name)
        names = [one for one in self.sections[kind] if len(one) <= _LONGEST_NAME]
        return next(iter(get_close_matches(name, names, n=1)), "")

    def suits(self, preset: Preset, printer: Preset) -> bool:
        """Whether a material or quality says that it is for this printer."""
        listed = [name for name in split_texts(preset.raw("compatible_printers")) if name]
        if listed:
            return printer.name in listed
        condition = unescaped(preset.raw("compatible_printers_condition"))
        known = {key: entry.text for key, entry in printer.entries.items()}
        return not condition or holds(condition, dict(DEFAULTS) | known) is not False

    def companion(self, printer: Preset, kind: str) -> str:
        """The material or quality that a printer has by default, or the first that suits it; empty: none does."""
        named = printer.text(
            {"material": "default_filament_profile", "quality": "default_print_profile"}[kind]
        )
        for name in [*split_texts(named), *self._materials_of(printer)] if kind == "material" else [named]:
            if name in self.sections[kind]:
                return name
        for name in self.sections[kind]:
            if not name.startswith("*") and self.suits(self.preset(kind, name), printer):
                return name
        return ""

    def printer_called(self, name: str) -> str:
        """Return the printer with this name, model name or older name; empty if there is none.

        For a model it is the printer with the first nozzle.
        """
        printers = self.sections["printer"]
        if name in printers:
            return name
        presets = [
            self.preset("printer", one) for one in printers if not one.startswith("*") and self._stands(one)
        ]
        renamed = [one for one in presets if name in split_texts(one.raw("renamed_from"))]
        for model, section in self.models.items():
            if name in (model, section.texts.get("name", "")):
                variants = split_texts(section.texts.get("variants", ""))
                own = [one for one in presets if one.text("printer_model") == model]
                first = [one for one in own if variants and one.text("printer_variant") == variants[0]]
                return next((one.name for one in (*first, *renamed, *own)), "")
        return renamed[0].name if renamed else ""

    def _stands(self, name: str) -> bool:
        """Whether the bundle has everything that a printer inherits from."""
        try:
            self.preset("printer", name)
        except ProfileError:
            return False
        return True

    def _materials_of(self, printer: Preset) -> list[str]:
        """What the printer's model is sold with."""
        model = self.models.get(printer.text("printer_model"))
        listed = model.entries.get("default_materials") if model else None
        return split_texts(listed.text) if listed else []


def bundle_of(sections: Sequence[Section], dialect: str, place: str) -> Bundle | None:
    """The bundle that the sections of a file are; None where it holds one set of settings."""
    sorted_out: dict[str, dict[str, Section]] = {kind: {} for kind in _KINDS.values()}
    models: dict[str, Section] = {}
    for section in sections:
        kind, sign, name = (part.strip() for part in section.title.partition(":"))
        if sign and kind in _KINDS:
            sorted_out[_KINDS[kind]][name] = section
        elif kind == "printer_model":
            models[name] = section
    return Bundle(sorted_out, models, dialect, place) if any(sorted_out.values()) else None
