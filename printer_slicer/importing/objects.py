"""Settings that objects and heights have of their own in 3MF projects of PrusaSlicer, OrcaSlicer and BambuStudio."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final
from xml.parsers import expat

from printer_slicer.errors import ProfileError
from printer_slicer.importing.embedded import OBJECTS_IN_3MF
from printer_slicer.importing.ini import Entry
from printer_slicer.importing.orca import orca_entries
from printer_slicer.importing.presets import Own
from printer_slicer.importing.report import ImportNote
from printer_slicer.importing.unpacking import unpacked

__all__ = ["own_in_3mf"]

_RANGES: Final = ("Metadata/Prusa_Slicer_layer_config_ranges.xml", "Metadata/layer_config_ranges.xml")
_HEIGHTS: Final = ("Metadata/Slic3r_PE_layer_heights_profile.txt", "Metadata/layer_heights_profile.txt")
_STOPS: Final = ("Metadata/Prusa_Slicer_custom_gcode_per_print_z.xml", "Metadata/custom_gcode_per_layer.xml")
_KINDS_OF_STOPS: Final = {
    "0": "change of colour",
    "1": "pause",
    "2": "change of tool",
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
    """An object as the project has it: name, settings, those of heights, and of volumes in it by their names."""

    name: str = ""
    settings: dict[str, str] = field(default_factory=dict)
    heights: list[tuple[tuple[float, float], dict[str, str]]] = field(default_factory=list)
    volumes: list[tuple[str, dict[str, str]]] = field(default_factory=list)


def own_in_3mf(path: Path) -> tuple[tuple[Own, ...], tuple[ImportNote, ...]]:
    """What objects and heights have of their own in a project, and what a person should look at.

    Args:
        path: of the 3MF file.

    Raises:
        ProfileError: the project is damaged.
    """
    texts = unpacked(path, {*OBJECTS_IN_3MF, *_RANGES, *_HEIGHTS, *_STOPS})
    name = next((one for one in OBJECTS_IN_3MF if one in texts), "")
    objects = _Objects(f"{path}: {name}").read(texts[name]) if name else []
    for one in _RANGES:
        if one in texts:
            _Ranges(f"{path}: {one}", objects).read(texts[one])
    notes = [
        ImportNote(
            f"{path}: {one}", "heights drawn by hand are left out; `planner.kind = optimal` finds them"
        )
        for one in _HEIGHTS
        if texts.get(one, "").strip()
    ]
    notes += [note for one in _STOPS if one in texts for note in _Stops(f"{path}: {one}").read(texts[one])]
    found: list[Own] = []
    for called, group in _by_name(objects).items():
        place = f"{path}: {name}: {called or 'an object without a name'}"
        volumes = [volume for one in group for volume, settings in one.volumes if settings]
        if volumes:
            which = ", ".join(map(repr, volumes[:5])) + (", ..." if len(volumes) > 5 else "")
            notes.append(ImportNote(place, f"settings of volumes and modifiers in it are left out: {which}"))
        alone = len(objects) == 1
        first, *others = (_own(one, place, orca=name == OBJECTS_IN_3MF[1], alone=alone) for one in group)
        if called and all(other == first for other in others):
            found += first
        elif first or any(others):
            why = "objects of one name have different ones" if called else "nobody could tell whose they are"
            notes.append(
                ImportNote(place, f"its own settings are left out: {why}; give it a name of its own")
            )
    return tuple(found), tuple(notes)


def _by_name(objects: Sequence[_Object]) -> dict[str, list[_Object]]:
    """Name -> the objects that have it."""
    groups: dict[str, list[_Object]] = {}
    for one in objects:
        groups.setdefault(one.name, []).append(one)
    return groups


def _own(one: _Object, place: str, *, orca: bool, alone: bool) -> list[Own]:
    """What an object has of its own, everywhere and at heights."""

    def entries(settings: Mapping[str, str]) -> dict[str, Entry]:
        if orca:
            return orca_entries(settings, place)
        return {key: Entry(key, text, place) for key, text in settings.items()}

    rows = [(_EVERYWHERE, one.settings), *one.heights]
    return [Own(one.name, *heights, entries(settings), alone) for heights, settings in rows if settings]


def _usual(key: str, value: str) -> bool:
    """Whether a setting says what holds anyway: that the first tool prints."""
    return key == "extruder" and value in ("0", "1")


class _Xml:
    """Reads a document element by element; a document type is refused, and with it entities of every kind."""

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
            ProfileError: it is no XML.
        """
        try:
            self._parser.Parse(text.encode(), True)
        except (expat.ExpatError, ValueError) as error:
            raise ProfileError(f"{self._place}: {error}", remedy="save the project again") from None

    def begin(self, tag: str, given: dict[str, str]) -> None:
        """An element begins."""

    def end(self, tag: str) -> None:
        """An element ends."""

    def text(self, text: str) -> None:
        """Text in an element."""

    def _refuse(self, *_: object) -> None:
        raise ValueError("a document type, which projects do not have")


class _Objects(_Xml):
    """Names and settings of objects."""

    def __init__(self, place: str) -> None:
        super().__init__(place)
        self._objects: list[_Object] = []
        self._open: _Object | None = None
        self._inside = False  # of a volume

    def read(self, text: str) -> list[_Object]:
        """The objects of a document, in its order."""
        self.parse(text)
        return self._objects

    def begin(self, tag: str, given: dict[str, str]) -> None:
        """An object, a volume in it, or something about one of them."""
        if tag == "object":
            self._open = _Object()
            self._objects.append(self._open)
        elif self._open and tag in _VOLUMES:
            self._inside = True
            self._open.volumes.append(("without a name", {}))
        elif self._open and tag == "metadata" and given.get("key"):
            self._tell(self._open, given["key"], given.get("value", ""))

    def end(self, tag: str) -> None:
        """A volume, or an object: what its only volume has is the object's."""
        if tag in _VOLUMES:
            self._inside = False
        elif tag == "object" and self._open:
            if len(self._open.volumes) == 1:
                self._open.settings |= self._open.volumes.pop()[1]
            self._open = None

    def _tell(self, one: _Object, key: str, value: str) -> None:
        """Something about the object, or about the volume in it that is open."""
        if not self._inside:
            if key == "name":
                one.name = value
            elif not _usual(key, value):
                one.settings[key] = value
        elif key == "name":
            one.volumes[-1] = value, one.volumes[-1][1]
        elif key not in _ABOUT_VOLUMES and not _usual(key, value):
            one.volumes[-1][1][key] = value


class _Ranges(_Xml):
    """Settings of heights, object by object as they are counted."""

    def __init__(self, place: str, objects: list[_Object]) -> None:
        super().__init__(place)
        self._known = objects
        self._object = _Object()
        self._key: str | None = None

    def read(self, text: str) -> None:
        """Give the objects what a document says of them."""
        self.parse(text)

    def begin(self, tag: str, given: dict[str, str]) -> None:
        """An object, heights of it, or a setting there."""
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
        """The value of a setting."""
        if self._key:
            self._object.heights[-1][1][self._key] += text

    def end(self, tag: str) -> None:
        """A setting is complete."""
        if tag == "option" and self._key:
            settings = self._object.heights[-1][1]
            if _usual(self._key, settings[self._key].strip()):
                del settings[self._key]
        self._key = None


class _Stops(_Xml):
    """What a person put at heights with the slider of layers: pauses, changes of colour, G-code."""

    def __init__(self, place: str) -> None:
        super().__init__(place)
        self._found: list[str] = []

    def read(self, text: str) -> list[ImportNote]:
        """What a person should know of a document."""
        self.parse(text)
        if not self._found:
            return []
        which = ", ".join(self._found[:_SHOWN]) + (", ..." if len(self._found) > _SHOWN else "")
        return [
            ImportNote(
                self._place, f"what is put at heights is left out: {which}; quality.pause_at has pauses"
            )
        ]

    def begin(self, tag: str, given: dict[str, str]) -> None:
        """One of them: `code` with `print_z` in PrusaSlicer, `layer` with `top_z` in OrcaSlicer and BambuStudio."""
        height = given.get("print_z" if tag == "code" else "top_z", "")
        if tag in ("code", "layer") and height:
            kind = _KINDS_OF_STOPS.get(given.get("type", ""), given.get("gcode", "") or "G-code")
            self._found.append(f"{kind} at z {height} mm")
