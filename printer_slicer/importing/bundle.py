"""Bundles of presets: inheritance, printer models and compatibility."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from difflib import get_close_matches
from typing import Final

from printer_slicer.errors import ProfileError
from printer_slicer.importing.conditions import evaluate_condition
from printer_slicer.importing.ini import IniSection, SourceSetting, split_texts, unescape
from printer_slicer.importing.presets import Preset
from printer_slicer.importing.printer_search import find_printers
from printer_slicer.importing.prusaslicer_names import DEFAULTS
from printer_slicer.importing.results import KINDS, RejectedProfile
from printer_slicer.values import Struct, field

__all__ = ["PresetBundle", "group_sections"]

_KINDS: Final = {"printer": "printer", "filament": "material", "print": "quality"}
_USUAL_NOZZLE: Final = 0.4  # mm
_DEEPEST_INHERITANCE: Final = 50  # presets in a chain
_MAX_SUGGESTIONS: Final = 5  # searches for similar names in one file
_LONGEST_NAME: Final = 200  # characters
_FEWEST_COMPLETE: Final = 30  # settings; a preset with fewer cannot be used without the one it inherits from


class PresetBundle(Struct, frozen=True):
    """A file with many presets.

    Attributes:
        sections: kind -> name -> section, abstract ones included.
        models: printer model -> section with its nozzles and default materials.
        dialect: slicer whose settings these are.
        place: name of the file.
    """

    sections: Mapping[str, Mapping[str, IniSection]]
    models: Mapping[str, IniSection]
    dialect: str
    place: str
    _resolved: dict[tuple[str, str], dict[str, SourceSetting]] = field(default_factory=dict)
    _suggested: list[str] = field(default_factory=list)

    def resolve_presets(self, kinds: Sequence[str] = KINDS) -> Iterator[Preset | RejectedProfile]:
        """Yield each preset with the settings it inherits, or the reason why it cannot be used; skip abstract ones."""
        for kind in kinds:
            for name, section in self.sections[kind].items():
                if not name.startswith("*"):
                    try:
                        yield self.resolve_preset(kind, name)
                    except ProfileError as error:
                        yield RejectedProfile(kind, name, section.place, str(error.args[0]), error.remedy)

    def resolve_preset(self, kind: str, name: str) -> Preset:
        """Return one preset with the settings it inherits.

        Raises:
            ProfileError: it is missing, inherits from itself, or from a preset that is missing.
        """
        entries = self._resolve_settings(kind, name, ())
        return Preset(kind, name, self.dialect, self.sections[kind][name].place, entries, DEFAULTS)

    def _resolve_settings(self, kind: str, name: str, heirs: tuple[str, ...]) -> dict[str, SourceSetting]:
        """Return the settings of a section and those it inherits; the last of several parents takes precedence.

        Args:
            kind: kind of the preset.
            name: name of the section.
            heirs: the sections that inherit from it.
        """
        if (kind, name) in self._resolved:
            return self._resolved[kind, name]
        section = self.sections[kind][name]
        if name in heirs or len(heirs) > _DEEPEST_INHERITANCE:
            chain = " -> ".join((*heirs, name))
            raise ProfileError(
                f"{section.place}: inherits from itself: {chain}",
                remedy="Change one `inherits` in this chain",
            )
        entries: dict[str, SourceSetting] = {}
        parents = section.entries.get("inherits")
        for parent in split_texts(parents.text) if parents else ():
            if not parent:
                continue
            if parent in self.sections[kind]:
                entries |= self._resolve_settings(kind, parent, (*heirs, name))
            elif len(section.entries) < _FEWEST_COMPLETE:
                assert parents is not None
                near = self._suggest_name(parent, kind)
                hint = f"Did you mean {near!r}? " if near else ""
                raise ProfileError(
                    f"{parents.place}: inherits = {parent}: this file has no such preset",
                    remedy=f"{hint}Export the complete preset (File, Export, Export Config)",
                )
        self._resolved[kind, name] = entries | section.entries
        return self._resolved[kind, name]

    def _suggest_name(self, name: str, kind: str) -> str:
        """Return the most similar name of a preset; empty if none is similar.

        Only a few searches are done for each file, because each one compares all names.
        """
        if len(self._suggested) >= _MAX_SUGGESTIONS or len(name) > _LONGEST_NAME:
            return ""
        self._suggested.append(name)
        names = [one for one in self.sections[kind] if len(one) <= _LONGEST_NAME]
        return next(iter(get_close_matches(name, names, n=1)), "")

    def is_compatible(self, preset: Preset, printer: Preset) -> bool:
        """Return whether a material or quality is compatible with a printer."""
        listed = [name for name in split_texts(preset.read_raw("compatible_printers")) if name]
        if listed:
            return printer.name in listed
        condition = unescape(preset.read_raw("compatible_printers_condition"))
        known = {key: entry.text for key, entry in printer.entries.items()}
        return not condition or evaluate_condition(condition, dict(DEFAULTS) | known) is not False

    def find_default_name(self, printer: Preset, kind: str) -> str:
        """Return the name of a printer's default material or quality.

        Without a default, this is the first compatible one; empty if there is none.
        """
        name_list = printer.read_text(
            {"material": "default_filament_profile", "quality": "default_print_profile"}[kind]
        )
        for name in (
            [*split_texts(name_list), *self._list_default_materials(printer)]
            if kind == "material"
            else [name_list]
        ):
            if name in self.sections[kind]:
                return name
        for name in self.sections[kind]:
            if not name.startswith("*") and self.is_compatible(self.resolve_preset(kind, name), printer):
                return name
        return ""

    def find_printers(self, name: str) -> list[Preset]:
        """Return the printers that match a name best, for example one printer with different nozzles.

        Args:
            name: name or former name of a preset, or of a printer model, or a part of one, such as `Ender 3 V2`.
        """
        printers = self.sections["printer"]
        if name in printers and not name.startswith("*"):
            return [self.resolve_preset("printer", name)]
        presets = [one for one in self.resolve_presets(("printer",)) if isinstance(one, Preset)]
        renamed = [one for one in presets if name in split_texts(one.read_raw("renamed_from"))]
        found = find_printers(name, {one.name: self._list_model_names(one) for one in presets})
        return renamed[:1] or [one for one in presets if one.name in found]

    def _list_model_names(self, printer: Preset) -> list[str]:
        """Return the identifier and the display name of a printer's model."""
        model = printer.read_text("printer_model")
        section = self.models.get(model)
        return [one for one in (model, section.texts.get("name", "") if section else "") if one]

    def choose_by_nozzle(self, printers: Sequence[Preset]) -> Preset:
        """Return the printer with a 0.4 mm nozzle, or the one with the nozzle that its model lists first.

        Args:
            printers: printers of one model with different nozzles.
        """
        model = self.models.get(printers[0].read_text("printer_model"))
        listed = split_texts(model.texts.get("variants", "")) if model else []
        standard = [one for one in printers if one.read_number("nozzle_diameter") == _USUAL_NOZZLE]
        first = [one for one in printers if listed and one.read_text("printer_variant") == listed[0]]
        return (*standard, *first, *printers)[0]

    def _list_default_materials(self, printer: Preset) -> list[str]:
        """Return the names of the default materials of a printer's model."""
        model = self.models.get(printer.read_text("printer_model"))
        listed = model.entries.get("default_materials") if model else None
        return split_texts(listed.text) if listed else []


def group_sections(sections: Sequence[IniSection], dialect: str, place: str) -> PresetBundle | None:
    """Group the sections of a file as a bundle; return None if the file is one set of settings without presets."""
    by_kind: dict[str, dict[str, IniSection]] = {kind: {} for kind in _KINDS.values()}
    models: dict[str, IniSection] = {}
    for section in sections:
        kind, sign, name = (part.strip() for part in section.title.partition(":"))
        if sign and kind in _KINDS:
            by_kind[_KINDS[kind]][name] = section
        elif kind == "printer_model":
            models[name] = section
    return PresetBundle(by_kind, models, dialect, place) if any(by_kind.values()) else None
