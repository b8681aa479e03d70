"""Read settings of objects and height ranges in 3MF projects of PrusaSlicer, OrcaSlicer and BambuStudio."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final
from xml.parsers import expat

from printer_slicer.errors import ProfileError
from printer_slicer.importing.archives import read_archive
from printer_slicer.importing.embedded_settings import OBJECTS_IN_3MF
from printer_slicer.importing.ini import SourceSetting
from printer_slicer.importing.orca import translate_orca
from printer_slicer.importing.presets import ObjectSettings
from printer_slicer.importing.results import ImportNote
from printer_slicer.mesh_io.volume_types import is_modifier, name_modifier
from printer_slicer.values import Struct, field, replace

__all__ = ["read_object_settings"]

_RANGES: Final = ("Metadata/Prusa_Slicer_layer_config_ranges.xml", "Metadata/layer_config_ranges.xml")
_HEIGHTS: Final = ("Metadata/Slic3r_PE_layer_heights_profile.txt", "Metadata/layer_heights_profile.txt")
_PAUSES: Final = ("Metadata/Prusa_Slicer_custom_gcode_per_print_z.xml", "Metadata/custom_gcode_per_layer.xml")
_PAUSE_KINDS: Final = {
    "0": "colour change",
    "1": "pause",
    "2": "tool change",
    "3": "G-code of the printer's template",
    "4": "G-code",
}
_MAX_SHOWN: Final = 5
_VOLUME_METADATA: Final = frozenset(
    {"name", "volume_type", "modifier", "matrix", "source_file", "source_object_id", "source_volume_id"}
    | {
        f"source_{what}"
        for what in ("offset_x", "offset_y", "offset_z", "in_inches", "in_meters", "is_builtin_volume")
    }
)
_VOLUMES: Final = ("volume", "part")
_EVERYWHERE: Final = (0.0, 0.0)


class _Volume(Struct):
    """A volume of an object: its name, its type in the file, and its settings."""

    name: str = ""
    kind: str = ""
    settings: dict[str, str] = field(default_factory=dict)


class _Object(Struct):
    """An object of a project: its name, its settings, and those of its height ranges and volumes."""

    name: str = ""
    settings: dict[str, str] = field(default_factory=dict)
    heights: list[tuple[tuple[float, float], dict[str, str]]] = field(default_factory=list)
    volumes: list[_Volume] = field(default_factory=list)


def read_object_settings(path: Path) -> tuple[tuple[ObjectSettings, ...], tuple[ImportNote, ...]]:
    """Read the settings of objects and height ranges in a project; return them with warnings about other settings.

    Args:
        path: path of the 3MF file.

    Raises:
        ProfileError: the project is damaged.
    """
    texts = read_archive(path, {*OBJECTS_IN_3MF, *_RANGES, *_HEIGHTS, *_PAUSES})
    name = next((one for one in OBJECTS_IN_3MF if one in texts), "")
    objects = _ObjectReader(f"{path}: {name}").read(texts[name]) if name else []
    for one in _RANGES:
        if one in texts:
            _RangeReader(f"{path}: {one}", objects).read(texts[one])
    notes = [
        ImportNote(
            f"{path}: {one}",
            "layer heights drawn by hand are not imported; `planner.kind = optimal` chooses heights by itself",
        )
        for one in _HEIGHTS
        if texts.get(one, "").strip()
    ]
    notes += [
        note for one in _PAUSES if one in texts for note in _PauseReader(f"{path}: {one}").read(texts[one])
    ]
    found: list[ObjectSettings] = []
    for object_name, group in _group_by_name(objects).items():
        place = f"{path}: {name}: {object_name or 'an object without a name'}"
        notes += _list_unread_volumes(group, place)
        is_only_object = len(objects) == 1
        first, *others = (
            _convert_settings(one, place, is_orca=name == OBJECTS_IN_3MF[1], is_only_object=is_only_object)
            for one in group
        )
        if object_name and all(other == first for other in others):
            found += first
        elif first or any(others):
            why = (
                "objects with this name have different settings" if object_name else "the object has no name"
            )
            notes.append(ImportNote(place, f"its settings are not imported: {why}; give it a unique name"))
    found += _convert_modifiers(objects, f"{path}: {name}", is_orca=name == OBJECTS_IN_3MF[1])
    return tuple(found), tuple(notes)


def _list_unread_volumes(group: Sequence[_Object], place: str) -> list[ImportNote]:
    """Return a warning about the settings of volumes that are not modifiers."""
    volumes = [
        volume for one in group for volume in one.volumes if volume.settings and not is_modifier(volume.kind)
    ]
    if not volumes:
        return []
    which = ", ".join(repr(one.name or "without a name") for one in volumes[:5]) + (
        ", ..." if len(volumes) > 5 else ""
    )
    return [ImportNote(place, f"settings of single volumes are not imported: {which}")]


def _convert_modifiers(objects: Sequence[_Object], place: str, *, is_orca: bool) -> list[ObjectSettings]:
    """Return the settings of all modifiers, under the names that their meshes have."""
    found, names = [], list[str]()
    for one in objects:
        for volume in one.volumes:
            if not is_modifier(volume.kind):
                continue
            names.append(name_modifier(one.name, volume.name, names))
            source = _Object(names[-1], volume.settings)
            made = _convert_settings(source, f"{place}: {names[-1]}", is_orca=is_orca, is_only_object=False)
            found += [replace(settings, is_modifier=True) for settings in made]
    return found


def _group_by_name(objects: Sequence[_Object]) -> dict[str, list[_Object]]:
    """Map each name to the objects that have it."""
    groups: dict[str, list[_Object]] = {}
    for one in objects:
        groups.setdefault(one.name, []).append(one)
    return groups


def _convert_settings(
    source: _Object, place: str, *, is_orca: bool, is_only_object: bool
) -> list[ObjectSettings]:
    """Return the settings of an object and of its height ranges, under PrusaSlicer's names."""

    def translate(settings: Mapping[str, str]) -> dict[str, SourceSetting]:
        """Return settings under PrusaSlicer's names."""
        if is_orca:
            return translate_orca(settings, place)
        return {key: SourceSetting(key, text, place) for key, text in settings.items()}

    rows = [(_EVERYWHERE, source.settings), *source.heights]
    return [
        ObjectSettings(source.name, *heights, translate(settings), is_only_object)
        for heights, settings in rows
        if settings
    ]


def _is_first_tool(key: str, value: str) -> bool:
    """Return whether a setting selects the first tool, which is the default."""
    return key == "extruder" and value in ("0", "1")


class _XmlReader:
    """Reads an XML document element by element; rejects document types, because they can define entities."""

    def __init__(self, place: str) -> None:
        self._place = place
        self._parser = expat.ParserCreate()
        self._parser.StartElementHandler = self.start_element
        self._parser.EndElementHandler = self.end_element
        self._parser.CharacterDataHandler = self.handle_text
        self._parser.StartDoctypeDeclHandler = self._reject_doctype

    def parse(self, text: str) -> None:
        """Read a document.

        Raises:
            ProfileError: it is not XML.
        """
        try:
            self._parser.Parse(text.encode(), True)
        except (expat.ExpatError, ValueError) as error:
            raise ProfileError(f"{self._place}: {error}", remedy="Save the project again") from None

    def start_element(self, tag: str, attributes: dict[str, str]) -> None:
        """Handle the start of an element."""

    def end_element(self, tag: str) -> None:
        """Handle the end of an element."""

    def handle_text(self, text: str) -> None:
        """Handle text in an element."""

    def _reject_doctype(self, *_: object) -> None:
        """Raise an error, because projects have no document type."""
        raise ValueError("the document has a document type, which projects do not have")


class _ObjectReader(_XmlReader):
    """Reads names and settings of objects."""

    def __init__(self, place: str) -> None:
        super().__init__(place)
        self._objects: list[_Object] = []
        self._current: _Object | None = None
        self._is_in_volume = False

    def read(self, text: str) -> list[_Object]:
        """Return the objects of a document, in order."""
        self.parse(text)
        return self._objects

    def start_element(self, tag: str, attributes: dict[str, str]) -> None:
        """Handle the start of an object or a volume, or read one of its settings."""
        if tag == "object":
            self._current = _Object()
            self._objects.append(self._current)
        elif self._current and tag in _VOLUMES:
            self._is_in_volume = True
            self._current.volumes.append(_Volume(kind=attributes.get("subtype", "")))
        elif self._current and tag == "metadata" and attributes.get("key"):
            self._add_setting(self._current, attributes["key"], attributes.get("value", ""))

    def end_element(self, tag: str) -> None:
        """Handle the end of a volume or an object; the settings of an only volume become those of its object."""
        if tag in _VOLUMES:
            self._is_in_volume = False
        elif tag == "object" and self._current:
            if len(self._current.volumes) == 1:
                self._current.settings |= self._current.volumes.pop().settings
            self._current = None

    def _add_setting(self, target: _Object, key: str, value: str) -> None:
        """Add a setting to an object, or to its current volume."""
        if not self._is_in_volume:
            if key == "name":
                target.name = value
            elif not _is_first_tool(key, value):
                target.settings[key] = value
        elif key == "name":
            target.volumes[-1].name = value
        elif key == "volume_type":
            target.volumes[-1].kind = value
        elif key == "modifier":
            target.volumes[-1].kind = target.volumes[-1].kind or ("modifier" if value == "1" else "")
        elif key not in _VOLUME_METADATA and not _is_first_tool(key, value):
            target.volumes[-1].settings[key] = value


class _RangeReader(_XmlReader):
    """Reads settings of height ranges; an object is numbered by its position in the project, from 1."""

    def __init__(self, place: str, objects: list[_Object]) -> None:
        super().__init__(place)
        self._objects = objects
        self._object = _Object()
        self._key: str | None = None

    def read(self, text: str) -> None:
        """Add the height ranges of a document to the objects."""
        self.parse(text)

    def start_element(self, tag: str, attributes: dict[str, str]) -> None:
        """Handle the start of an object, a height range or a setting."""
        if tag == "object":
            number = int(attributes.get("id", "0"))
            inside = 1 <= number <= len(self._objects)
            self._object = self._objects[number - 1] if inside else _Object()
        elif tag == "range":
            heights = float(attributes.get("min_z", "0")), float(attributes.get("max_z", "0"))
            self._object.heights.append((heights, {}))
        elif tag == "option" and self._object.heights:
            self._key = attributes.get("opt_key", "")
            self._object.heights[-1][1][self._key] = ""

    def handle_text(self, text: str) -> None:
        """Read the value of a setting."""
        if self._key:
            self._object.heights[-1][1][self._key] += text

    def end_element(self, tag: str) -> None:
        """Handle the end of a setting; drop it if it selects the first tool."""
        if tag == "option" and self._key:
            settings = self._object.heights[-1][1]
            if _is_first_tool(self._key, settings[self._key].strip()):
                del settings[self._key]
        self._key = None


class _PauseReader(_XmlReader):
    """Reads the pauses, colour changes and G-code that were placed at heights with the layer slider."""

    def __init__(self, place: str) -> None:
        super().__init__(place)
        self._found: list[str] = []

    def read(self, text: str) -> list[ImportNote]:
        """Return a warning about the contents of a document."""
        self.parse(text)
        if not self._found:
            return []
        which = ", ".join(self._found[:_MAX_SHOWN]) + (", ..." if len(self._found) > _MAX_SHOWN else "")
        return [ImportNote(self._place, f"not imported: {which}; use quality.pause_at for pauses")]

    def start_element(self, tag: str, attributes: dict[str, str]) -> None:
        """Read a pause: `code` with `print_z` in PrusaSlicer, `layer` with `top_z` in OrcaSlicer and BambuStudio."""
        height = attributes.get("print_z" if tag == "code" else "top_z", "")
        if tag in ("code", "layer") and height:
            kind = _PAUSE_KINDS.get(attributes.get("type", ""), attributes.get("gcode", "") or "G-code")
            self._found.append(f"{kind} at z {height} mm")
