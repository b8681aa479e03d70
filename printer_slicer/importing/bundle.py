"""Bundles of presets: inheritance, printer models, compatibility."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from difflib import get_close_matches
from typing import Final

from printer_slicer.errors import ProfileError
from printer_slicer.importing.conditions import condition_holds
from printer_slicer.importing.ini import IniSection, SourceSetting, split_texts, unescape
from printer_slicer.importing.presets import Preset
from printer_slicer.importing.printer_search import find_printers
from printer_slicer.importing.prusaslicer_names import DEFAULTS
from printer_slicer.importing.results import KINDS, RejectedProfile

__all__ = ["PresetBundle", "find_bundle"]

_KINDS: Final = {"printer": "printer", "filament": "material", "print": "quality"}
_USUAL_NOZZLE: Final = 0.4  # mm
_DEEPEST: Final = 50
_MOST_SOUGHT: Final = 5
_LONGEST_NAME: Final = 200  # characters
_COMPLETE: Final = 30  # settings; a preset with fewer cannot be used without the one it inherits from


@dataclass(frozen=True, slots=True)
class PresetBundle:
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
    _known: dict[tuple[str, str], dict[str, SourceSetting]] = field(default_factory=dict, repr=False)
    _sought: list[str] = field(default_factory=list, repr=False)

    def presets(self, kinds: Sequence[str] = KINDS) -> Iterator[Preset | RejectedProfile]:
        """Yield each preset with the settings it inherits, or the reason why it cannot be used; skip abstract ones."""
        for kind in kinds:
            for name, section in self.sections[kind].items():
                if not name.startswith("*"):
                    try:
                        yield self.preset(kind, name)
                    except ProfileError as error:
                        yield RejectedProfile(kind, name, section.place, str(error.args[0]), error.remedy)

    def preset(self, kind: str, name: str) -> Preset:
        """Return one preset with the settings it inherits.

        Raises:
            ProfileError: it is missing, inherits from itself, or from a preset that is missing.
        """
        entries = self._resolve(kind, name, ())
        return Preset(kind, name, self.dialect, self.sections[kind][name].place, entries, DEFAULTS)

    def _resolve(self, kind: str, name: str, below: tuple[str, ...]) -> dict[str, SourceSetting]:
        """Return the settings of a section and those it inherits; of several parents the last one wins."""
        if (kind, name) in self._known:
            return self._known[kind, name]
        section = self.sections[kind][name]
        if name in below or len(below) > _DEEPEST:
            chain = " -> ".join((*below, name))
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
                entries |= self._resolve(kind, parent, (*below, name))
            elif len(section.entries) < _COMPLETE:
                assert parents is not None
                near = self._closest_name(parent, kind)
                hint = f"Did you mean {near!r}? " if near else ""
                raise ProfileError(
                    f"{parents.place}: inherits = {parent}: no such preset in this file",
                    remedy=f"{hint}Export the complete preset (File, Export, Export Config)",
                )
        self._known[kind, name] = entries | section.entries
        return self._known[kind, name]

    def _closest_name(self, name: str, kind: str) -> str:
        """Return the preset with the most similar name; empty if there is none.

        Only the first few searches are done, because each compares all names.
        """
        if len(self._sought) >= _MOST_SOUGHT or len(name) > _LONGEST_NAME:
            return ""
        self._sought.append(name)
        names = [one for one in self.sections[kind] if len(one) <= _LONGEST_NAME]
        return next(iter(get_close_matches(name, names, n=1)), "")

    def is_compatible(self, preset: Preset, printer: Preset) -> bool:
        """Return whether a material or quality is meant for this printer."""
        listed = [name for name in split_texts(preset.raw("compatible_printers")) if name]
        if listed:
            return printer.name in listed
        condition = unescape(preset.raw("compatible_printers_condition"))
        known = {key: entry.text for key, entry in printer.entries.items()}
        return not condition or condition_holds(condition, dict(DEFAULTS) | known) is not False

    def default_preset(self, printer: Preset, kind: str) -> str:
        """Return the default material or quality of a printer, or the first compatible one; empty if there is none."""
        named = printer.text(
            {"material": "default_filament_profile", "quality": "default_print_profile"}[kind]
        )
        for name in (
            [*split_texts(named), *self._default_materials(printer)] if kind == "material" else [named]
        ):
            if name in self.sections[kind]:
                return name
        for name in self.sections[kind]:
            if not name.startswith("*") and self.is_compatible(self.preset(kind, name), printer):
                return name
        return ""

    def find_printers(self, name: str) -> list[Preset]:
        """Return the printers that match a name best, for example one printer with different nozzles.

        Args:
            name: of a preset, an older name of one, or of a model; or a part of one, such as `Ender 3 V2`.
        """
        printers = self.sections["printer"]
        if name in printers and not name.startswith("*"):
            return [self.preset("printer", name)]
        presets = [one for one in self.presets(("printer",)) if isinstance(one, Preset)]
        renamed = [one for one in presets if name in split_texts(one.raw("renamed_from"))]
        found = find_printers(name, {one.name: self._model_names(one) for one in presets})
        return renamed[:1] or [one for one in presets if one.name in found]

    def _model_names(self, printer: Preset) -> list[str]:
        """Return the identifier and the display name of a printer's model."""
        model = printer.text("printer_model")
        section = self.models.get(model)
        return [one for one in (model, section.texts.get("name", "") if section else "") if one]

    def choose_nozzle(self, printers: Sequence[Preset]) -> Preset:
        """Return the printer with the 0.4 mm nozzle, or with the first that its model lists.

        Args:
            printers: of one model, with different nozzles.
        """
        model = self.models.get(printers[0].text("printer_model"))
        listed = split_texts(model.texts.get("variants", "")) if model else []
        usual = [one for one in printers if one.number("nozzle_diameter") == _USUAL_NOZZLE]
        first = [one for one in printers if listed and one.text("printer_variant") == listed[0]]
        return (*usual, *first, *printers)[0]

    def _default_materials(self, printer: Preset) -> list[str]:
        """Return the default materials of the printer's model."""
        model = self.models.get(printer.text("printer_model"))
        listed = model.entries.get("default_materials") if model else None
        return split_texts(listed.text) if listed else []


def find_bundle(sections: Sequence[IniSection], dialect: str, place: str) -> PresetBundle | None:
    """Return the sections of a file as a bundle; None if the file is one set of settings without presets."""
    sorted_out: dict[str, dict[str, IniSection]] = {kind: {} for kind in _KINDS.values()}
    models: dict[str, IniSection] = {}
    for section in sections:
        kind, sign, name = (part.strip() for part in section.title.partition(":"))
        if sign and kind in _KINDS:
            sorted_out[_KINDS[kind]][name] = section
        elif kind == "printer_model":
            models[name] = section
    return PresetBundle(sorted_out, models, dialect, place) if any(sorted_out.values()) else None
