"""OrcaSlicer and BambuStudio: presets as JSON files that inherit from each other by name."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Final

from printer_slicer.errors import ProfileError
from printer_slicer.importing.ini import Entry
from printer_slicer.importing.orca_names import ORCA, ORCA_DEFAULTS
from printer_slicer.importing.presets import Preset
from printer_slicer.importing.unpacking import text_of

__all__ = ["OrcaFolder", "orca_entries", "orca_presets", "read_json"]

_KINDS: Final = {
    "machine": "printer",
    "filament": "material",
    "process": "quality",
    "printer": "printer",
    "print": "quality",
}
_DEEPEST: Final = 40
_MOST_FILES: Final = 5000


def read_json(text: str, place: str) -> dict[str, Any]:
    """The table that a JSON file is.

    Raises:
        ProfileError: it is none.
    """
    try:
        values = json.loads(text, parse_constant=lambda word: word)
    except (ValueError, RecursionError) as error:
        line = f":{error.lineno}" if isinstance(error, json.JSONDecodeError) else ""
        raise ProfileError(
            f"{place}{line}: not valid JSON: {error}", remedy="export the preset again"
        ) from None
    if not isinstance(values, dict):
        raise ProfileError(
            f"{place}: no table of settings", remedy="give a preset: machine, filament or process"
        )
    return values


class OrcaFolder:
    """Where the presets are that others inherit from: beside a file, and in the folders around it."""

    def __init__(
        self, folders: list[Path], own: Mapping[str, tuple[Path, dict[str, Any]]] | None = None
    ) -> None:
        self._folders = folders
        self._found: dict[str, tuple[Path, dict[str, Any]]] = dict(own or {})
        self._looked = False

    def named(self, name: str) -> tuple[Path, dict[str, Any]] | None:
        """File and values of a preset; None where there is none of this name."""
        for folder in self._folders:
            path = folder / f"{name}.json"
            if name not in self._found and "/" not in name and "\x00" not in name and path.is_file():
                self._found[name] = (path, _read(path))
        if name not in self._found and not self._looked:
            self._look()
        return self._found.get(name)

    def _look(self) -> None:
        """Read all presets in the folders: the name in a file may differ from its file's."""
        self._looked = True
        paths = [path for folder in self._folders for path in sorted(folder.glob("*.json"))]
        for path in paths[:_MOST_FILES]:
            try:
                values = _read(path)
            except ProfileError:
                continue  # another file's fault; who needs it is told that it is missing
            self._found.setdefault(str(values.get("name", path.stem)), (path, values))


def _read(path: Path) -> dict[str, Any]:
    return read_json(text_of(path), str(path))


def orca_presets(values: Mapping[str, Any], place: str, folder: OrcaFolder) -> list[Preset]:
    """The presets in a JSON file: one, or in the settings of a project one of each kind.

    Args:
        values: of the file.
        place: its name.
        folder: where what it inherits from is found.

    Raises:
        ProfileError: its kind cannot be told, or what it inherits from is not there.
    """
    name = str(values.get("name") or Path(place).stem)
    kind = _kind_of(values)
    whole = kind is None
    resolved = dict(values) if whole else _resolved(values, place, folder, (name,))
    entries = orca_entries(resolved, place)
    if not whole:
        assert kind is not None
        return [Preset(kind, name, "orca", place, entries, ORCA_DEFAULTS)]
    if "printable_area" not in values and "layer_height" not in values:
        raise ProfileError(
            f"{place}: neither machine, filament nor process", remedy='a preset says so: "type": "machine"'
        )
    names = {
        "printer": _first(values.get("printer_settings_id")),
        "material": _first(values.get("filament_settings_id")),
        "quality": _first(values.get("print_settings_id")),
    }
    return [
        Preset(one, label or name, "orca", place, entries, ORCA_DEFAULTS, mixed=True)
        for one, label in names.items()
    ]


def _kind_of(values: Mapping[str, Any]) -> str | None:
    """What a preset is for: as it says, or by settings that only one kind has."""
    said = _KINDS.get(str(values.get("type", "")))
    if said or (
        "printer_settings_id" in values and "print_settings_id" in values and "filament_settings_id" in values
    ):
        return said
    for kind, key in (
        ("printer", "printer_settings_id"),
        ("material", "filament_settings_id"),
        ("quality", "print_settings_id"),
    ):
        if key in values:
            return kind
    for kind, keys in (
        ("printer", ("printable_area", "nozzle_diameter", "machine_start_gcode")),
        ("material", ("nozzle_temperature", "filament_type", "filament_flow_ratio")),
        ("quality", ("layer_height", "wall_loops", "sparse_infill_density")),
    ):
        if any(key in values for key in keys) and not (
            "printable_area" in values and "layer_height" in values
        ):
            return kind
    return None


def _resolved(
    values: Mapping[str, Any], place: str, folder: OrcaFolder, seen: tuple[str, ...]
) -> dict[str, Any]:
    """A preset's settings over those it inherits; each remembers its file."""
    own = {key: (value, place) for key, value in values.items()}
    parent = _first(values.get("inherits"))
    if not parent:
        return own
    if parent in seen or len(seen) > _DEEPEST:
        chain = " -> ".join((*seen, parent))
        raise ProfileError(f"{place}: inherits from itself: {chain}", remedy="break the circle")
    found = folder.named(parent)
    if found is None:
        raise ProfileError(
            f"{place}: inherits {parent!r}, which is not beside it",
            remedy="copy that preset into the same folder, or name its folder with --folder",
        )
    return _resolved(found[1], str(found[0]), folder, (*seen, parent)) | own


def _first(value: Any) -> str:
    """A text, or the first of a list of texts."""
    if isinstance(value, list):
        return _first(value[0]) if value and not isinstance(value[0], list) else ""
    return value if isinstance(value, str) else ""


def orca_entries(values: Mapping[str, Any], place: str) -> dict[str, Entry]:
    """The settings under PrusaSlicer's names, lists as they stand in its files."""
    entries: dict[str, Entry] = {}
    for key, value in values.items():
        found, where = value if isinstance(value, tuple) else (value, place)
        if isinstance(found, dict):
            continue
        name = ORCA.get(key, key)
        if name in entries and name != key and key in ORCA and name in values:
            continue
        entries[name] = Entry(key, _text(key, found), where)
    return entries


def _text(key: str, value: Any) -> str:
    """A value as PrusaSlicer would write it."""
    words: Callable[[Any], str] = _word
    if not isinstance(value, list):
        text = words(value)
        return _escaped(text) if _is_text(key) else text
    items = [words(one) for one in value]
    if _is_text(key):
        return ";".join(f'"{_escaped(one)}"' for one in items) if len(items) > 1 else _escaped("".join(items))
    return ",".join(items)


def _is_text(key: str) -> bool:
    return key.endswith(("gcode", "_notes", "_id", "notes", "condition")) or key in (
        "compatible_printers",
        "name",
    )


def _escaped(text: str) -> str:
    return text.replace("\\", "\\\\").replace("\n", "\\n").replace("\r", "").replace('"', '\\"')


def _word(value: Any) -> str:
    if isinstance(value, bool):
        return "1" if value else "0"
    if isinstance(value, (int, float, str)):
        return str(value)
    return ""
