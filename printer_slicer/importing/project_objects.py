"""Read settings of objects and height ranges in 3MF projects of PrusaSlicer, OrcaSlicer and BambuStudio."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final
from xml.parsers import expat

from printer_slicer.errors import ProfileError
from printer_slicer.importing.archives import read_archive
from printer_slicer.importing.embedded_settings import OBJECTS_IN_3MF
from printer_slicer.importing.ini import SourceSetting
from printer_slicer.importing.orca import orca_entries
from printer_slicer.importing.presets import ObjectSettings
from printer_slicer.importing.results import ImportNote

__all__ = ["read_object_settings"]

_RANGES: Final = ("Metadata/Prusa_Slicer_layer_config_ranges.xml", "Metadata/layer_config_ranges.xml")
_HEIGHTS: Final = ("Metadata/Slic3r_PE_layer_heights_profile.txt", "Metadata/layer_heights_profile.txt")
_PAUSES: Final = ("Metadata/Prusa_Slicer_custom_gcode_per_print_z.xml", "Metadata/custom_gcode_per_layer.xml")
_KINDS_OF_PAUSES: Final = {
    "0": "colour change",
    "1": "pause",
    "2": "tool change",
    "3": "G-code of the printer's template",
    "4": "G-code",
}
_SHOWN: Final = 5
_ABOUT_VOLUMES: Final = frozenset(
    {"name", "volume_type", "modifier", "matrix", "source_file", "source_object_id", "source_volume_id"}
    | {
        f"source_{what}"
        for what in ("offset_x", "offset_y", "offset_z", "in_inches", "in_meters", "is_builtin_volume")
    }
)
_VOLUMES: Final = ("volume", "part")
_EVERYWHERE: Final = (0.0, 0.0)


@dataclass(slots=True)
class _Object:
    """An object of a project: name, settings, settings of height ranges, and settings of named volumes."""

    name: str = ""
    settings: dict[str, str] = field(default_factory=dict)
    heights: list[tuple[tuple[float, float], dict[str, str]]] = field(default_factory=list)
    volumes: list[tuple[str, dict[str, str]]] = field(default_factory=list)


def read_object_settings(path: Path) -> tuple[tuple[ObjectSettings, ...], tuple[ImportNote, ...]]:
    """Read the settings of objects and height ranges in a project, and warnings about what is not imported.

    Args:
        path: path of the 3MF file.

    Raises:
        ProfileError: the project is damaged.
    """
    texts = read_archive(path, {*OBJECTS_IN_3MF, *_RANGES, *_HEIGHTS, *_PAUSES})
    name = next((one for one in OBJECTS_IN_3MF if one in texts), "")
    objects = _Objects(f"{path}: {name}").read(texts[name]) if name else []
    for one in _RANGES:
        if one in texts:
            _Ranges(f"{path}: {one}", objects).read(texts[one])
    notes = [
        ImportNote(
            f"{path}: {one}",
            "layer heights drawn by hand are not imported; `planner.kind = optimal` chooses heights by itself",
        )
        for one in _HEIGHTS
        if texts.get(one, "").strip()
    ]
    notes += [note for one in _PAUSES if one in texts for note in _Pauses(f"{path}: {one}").read(texts[one])]
    found: list[ObjectSettings] = []
    for called, group in _group_by_name(objects).items():
        place = f"{path}: {name}: {called or 'an object without a name'}"
        volumes = [volume for one in group for volume, settings in one.volumes if settings]
        if volumes:
            which = ", ".join(map(repr, volumes[:5])) + (", ..." if len(volumes) > 5 else "")
            notes.append(ImportNote(place, f"settings of volumes and modifiers are not imported: {which}"))
        alone = len(objects) == 1
        first, *others = (
            _settings_of(one, place, orca=name == OBJECTS_IN_3MF[1], alone=alone) for one in group
        )
        if called and all(other == first for other in others):
            found += first
        elif first or any(others):
            why = "objects with this name have different ones" if called else "the object has no name"
            notes.append(ImportNote(place, f"its settings are not imported: {why}; give it a unique name"))
    return tuple(found), tuple(notes)


def _group_by_name(objects: Sequence[_Object]) -> dict[str, list[_Object]]:
    """Return name -> objects with this name."""
    groups: dict[str, list[_Object]] = {}
    for one in objects:
        groups.setdefault(one.name, []).append(one)
    return groups


def _settings_of(one: _Object, place: str, *, orca: bool, alone: bool) -> list[ObjectSettings]:
    """Return the settings of an object and of its height ranges."""

    def entries(settings: Mapping[str, str]) -> dict[str, SourceSetting]:
        if orca:
            return orca_entries(settings, place)
        return {key: SourceSetting(key, text, place) for key, text in settings.items()}

    rows = [(_EVERYWHERE, one.settings), *one.heights]
    return [
        ObjectSettings(one.name, *heights, entries(settings), alone) for heights, settings in rows if settings
    ]


def _is_default(key: str, value: str) -> bool:
    """Return whether a setting is the default: it chooses the first tool."""
    return key == "extruder" and value in ("0", "1")


class _Xml:
    """Reads a document element by element; rejects a document type, and with it all entities."""

    def __init__(self, place: str) -> None:
        self._place = place
        self._parser = expat.ParserCreate()
        self._parser.StartElementHandler = self.begin
        self._parser.EndElementHandler = self.end
        self._parser.CharacterDataHandler = self.text
        self._parser.StartDoctypeDeclHandler = self._refuse

    def parse(self, text: str) -> None:
        """Read a document.

        Raises:
            ProfileError: it is not XML.
        """
        try:
            self._parser.Parse(text.encode(), True)
        except (expat.ExpatError, ValueError) as error:
            raise ProfileError(f"{self._place}: {error}", remedy="Save the project again") from None

    def begin(self, tag: str, given: dict[str, str]) -> None:
        """Handle the start of an element."""

    def end(self, tag: str) -> None:
        """Handle the end of an element."""

    def text(self, text: str) -> None:
        """Handle text in an element."""

    def _refuse(self, *_: object) -> None:
        raise ValueError("it has a document type, which projects do not have")


class _Objects(_Xml):
    """Reads names and settings of objects."""

    def __init__(self, place: str) -> None:
        super().__init__(place)
        self._objects: list[_Object] = []
        self._open: _Object | None = None
        self._inside = False  # of a volume

    def read(self, text: str) -> list[_Object]:
        """Return the objects of a document, in its order."""
        self.parse(text)
        return self._objects

    def begin(self, tag: str, given: dict[str, str]) -> None:
        """Begin an object or a volume, or read a setting of one."""
        if tag == "object":
            self._open = _Object()
            self._objects.append(self._open)
        elif self._open and tag in _VOLUMES:
            self._inside = True
            self._open.volumes.append(("without a name", {}))
        elif self._open and tag == "metadata" and given.get("key"):
            self._add_setting(self._open, given["key"], given.get("value", ""))

    def end(self, tag: str) -> None:
        """End a volume or an object; settings of its only volume become the object's."""
        if tag in _VOLUMES:
            self._inside = False
        elif tag == "object" and self._open:
            if len(self._open.volumes) == 1:
                self._open.settings |= self._open.volumes.pop()[1]
            self._open = None

    def _add_setting(self, one: _Object, key: str, value: str) -> None:
        """Read a setting of the object, or of the current volume."""
        if not self._inside:
            if key == "name":
                one.name = value
            elif not _is_default(key, value):
                one.settings[key] = value
        elif key == "name":
            one.volumes[-1] = value, one.volumes[-1][1]
        elif key not in _ABOUT_VOLUMES and not _is_default(key, value):
            one.volumes[-1][1][key] = value


class _Ranges(_Xml):
    """Reads settings of height ranges; objects are numbered in their order."""

    def __init__(self, place: str, objects: list[_Object]) -> None:
        super().__init__(place)
        self._known = objects
        self._object = _Object()
        self._key: str | None = None

    def read(self, text: str) -> None:
        """Add the height ranges of a document to the objects."""
        self.parse(text)

    def begin(self, tag: str, given: dict[str, str]) -> None:
        """Begin an object, a height range or a setting."""
        if tag == "object":
            number = int(given.get("id", "0"))
            inside = 1 <= number <= len(self._known)
            self._object = self._known[number - 1] if inside else _Object()
        elif tag == "range":
            heights = float(given.get("min_z", "0")), float(given.get("max_z", "0"))
            self._object.heights.append((heights, {}))
        elif tag == "option" and self._object.heights:
            self._key = given.get("opt_key", "")
            self._object.heights[-1][1][self._key] = ""

    def text(self, text: str) -> None:
        """Read the value of a setting."""
        if self._key:
            self._object.heights[-1][1][self._key] += text

    def end(self, tag: str) -> None:
        """End a setting."""
        if tag == "option" and self._key:
            settings = self._object.heights[-1][1]
            if _is_default(self._key, settings[self._key].strip()):
                del settings[self._key]
        self._key = None


class _Pauses(_Xml):
    """Reads what was set at heights with the layer slider: pauses, colour changes, G-code."""

    def __init__(self, place: str) -> None:
        super().__init__(place)
        self._found: list[str] = []

    def read(self, text: str) -> list[ImportNote]:
        """Return a warning about the contents of a document."""
        self.parse(text)
        if not self._found:
            return []
        which = ", ".join(self._found[:_SHOWN]) + (", ..." if len(self._found) > _SHOWN else "")
        return [ImportNote(self._place, f"not imported: {which}; use quality.pause_at for pauses")]

    def begin(self, tag: str, given: dict[str, str]) -> None:
        """Read one: `code` with `print_z` in PrusaSlicer, `layer` with `top_z` in OrcaSlicer and BambuStudio."""
        height = given.get("print_z" if tag == "code" else "top_z", "")
        if tag in ("code", "layer") and height:
            kind = _KINDS_OF_PAUSES.get(given.get("type", ""), given.get("gcode", "") or "G-code")
            self._found.append(f"{kind} at z {height} mm")
