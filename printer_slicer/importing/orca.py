"""Read presets of OrcaSlicer and BambuStudio: JSON files that inherit from each other by name."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Final

from printer_slicer.errors import ProfileError
from printer_slicer.importing.archives import read_text
from printer_slicer.importing.ini import SourceSetting
from printer_slicer.importing.orca_names import ORCA_DEFAULTS, ORCA_NAMES
from printer_slicer.importing.presets import Preset

__all__ = ["PresetFolders", "make_orca_presets", "read_json", "translate_orca"]

_KINDS: Final = {
    "machine": "printer",
    "filament": "material",
    "process": "quality",
    "printer": "printer",
    "print": "quality",
}
_DEEPEST: Final = 40  # presets in a chain of inheritance
_MAX_FILES: Final = 5000  # files that are searched for a preset


def read_json(text: str, place: str) -> dict[str, Any]:
    """Parse a JSON text that holds a table of settings.

    Raises:
        ProfileError: it is not JSON, or not a table.
    """
    try:
        values = json.loads(text, parse_constant=lambda word: word)
    except (ValueError, RecursionError) as error:
        line = f":{error.lineno}" if isinstance(error, json.JSONDecodeError) else ""
        raise ProfileError(
            f"{place}{line}: not valid JSON: {error}", remedy="Export the preset again"
        ) from None
    if not isinstance(values, dict):
        raise ProfileError(
            f"{place}: not a table of settings", remedy="Give a preset: machine, filament or process"
        )
    return values


class PresetFolders:
    """Folders that are searched for inherited presets; files are read when they are needed."""

    def __init__(
        self, folders: list[Path], known: Mapping[str, tuple[Path, dict[str, Any]]] | None = None
    ) -> None:
        self._folders = folders
        self._found: dict[str, tuple[Path, dict[str, Any]]] = dict(known or {})
        self._is_read = False

    def find(self, name: str) -> tuple[Path, dict[str, Any]] | None:
        """Return the file and the values of a preset; None if no preset has this name."""
        for folder in self._folders:
            path = folder / f"{name}.json"
            if name not in self._found and "/" not in name and "\x00" not in name and path.is_file():
                self._found[name] = (path, _read_preset(path))
        if name not in self._found and not self._is_read:
            self._read_all()
        return self._found.get(name)

    def _read_all(self) -> None:
        """Read all presets in the folders, because the name of a preset may differ from its file name."""
        self._is_read = True
        paths = [path for folder in self._folders for path in sorted(folder.glob("*.json"))]
        for path in paths[:_MAX_FILES]:
            try:
                values = _read_preset(path)
            except ProfileError:
                continue  # a preset that needs this file reports that it is missing
            self._found.setdefault(str(values.get("name", path.stem)), (path, values))


def _read_preset(path: Path) -> dict[str, Any]:
    """Read the file of a preset."""
    return read_json(read_text(path), str(path))


def make_orca_presets(values: Mapping[str, Any], place: str, folder: PresetFolders) -> list[Preset]:
    """Return the presets in a JSON file: one preset, or one of each kind for the settings of a project.

    Args:
        values: contents of the file.
        place: name of the file.
        folder: folders with the presets it inherits from.

    Raises:
        ProfileError: its kind is unknown, or a preset it inherits from is missing.
    """
    name = str(values.get("name") or Path(place).stem)
    kind = _find_kind(values)
    is_project = kind is None
    resolved = dict(values) if is_project else _resolve_inheritance(values, place, folder, (name,))
    entries = translate_orca(resolved, place)
    if not is_project:
        assert kind is not None
        return [Preset(kind, name, "orca", place, entries, ORCA_DEFAULTS)]
    if "printable_area" not in values and "layer_height" not in values:
        raise ProfileError(
            f"{place}: not a machine, filament or process preset",
            remedy='Add its type, such as "type": "machine"',
        )
    names = {
        "printer": _get_first_text(values.get("printer_settings_id")),
        "material": _get_first_text(values.get("filament_settings_id")),
        "quality": _get_first_text(values.get("print_settings_id")),
    }
    return [
        Preset(one, label or name, "orca", place, entries, ORCA_DEFAULTS, mixed=True)
        for one, label in names.items()
    ]


def _find_kind(values: Mapping[str, Any]) -> str | None:
    """Return the kind of a preset, from its type or from settings that only one kind has."""
    kind_by_type = _KINDS.get(str(values.get("type", "")))
    if kind_by_type or (
        "printer_settings_id" in values and "print_settings_id" in values and "filament_settings_id" in values
    ):
        return kind_by_type
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


def _resolve_inheritance(
    values: Mapping[str, Any], place: str, folder: PresetFolders, seen: tuple[str, ...]
) -> dict[str, Any]:
    """Return the settings of a preset and those it inherits, each with the file that sets it."""
    own = {key: (value, place) for key, value in values.items()}
    parent = _get_first_text(values.get("inherits"))
    if not parent:
        return own
    if parent in seen or len(seen) > _DEEPEST:
        chain = " -> ".join((*seen, parent))
        raise ProfileError(
            f"{place}: inherits from itself: {chain}", remedy="Change one `inherits` in this chain"
        )
    found = folder.find(parent)
    if found is None:
        raise ProfileError(
            f"{place}: inherits {parent!r}, which is not in the same folder",
            remedy="Copy that preset into the same folder, or name its folder with --folder FOLDER",
        )
    return _resolve_inheritance(found[1], str(found[0]), folder, (*seen, parent)) | own


def _get_first_text(value: Any) -> str:
    """Return a text, or the first text of a list; empty for other values."""
    if isinstance(value, list):
        return _get_first_text(value[0]) if value and not isinstance(value[0], list) else ""
    return value if isinstance(value, str) else ""


def translate_orca(values: Mapping[str, Any], place: str) -> dict[str, SourceSetting]:
    """Translate settings to PrusaSlicer's names, and write lists as PrusaSlicer does."""
    entries: dict[str, SourceSetting] = {}
    for key, value in values.items():
        found, where = value if isinstance(value, tuple) else (value, place)
        if isinstance(found, dict):
            continue
        name = ORCA_NAMES.get(key, key)
        if name in entries and name != key and key in ORCA_NAMES and name in values:
            continue
        entries[name] = SourceSetting(key, _format_setting(key, found), where)
    return entries


def _format_setting(key: str, value: Any) -> str:
    """Format a value as PrusaSlicer writes it."""
    words: Callable[[Any], str] = _format_item
    if not isinstance(value, list):
        text = words(value)
        return _escape(text) if _is_text(key) else text
    items = [words(one) for one in value]
    if _is_text(key):
        return ";".join(f'"{_escape(one)}"' for one in items) if len(items) > 1 else _escape("".join(items))
    return ",".join(items)


def _is_text(key: str) -> bool:
    """Return whether the value of a setting is a text, not a number or a word."""
    return key.endswith(("gcode", "_notes", "_id", "notes", "condition")) or key in (
        "compatible_printers",
        "name",
    )


def _escape(text: str) -> str:
    """Escape backslashes, line breaks and quotes as PrusaSlicer does."""
    return text.replace("\\", "\\\\").replace("\n", "\\n").replace("\r", "").replace('"', '\\"')


def _format_item(value: Any) -> str:
    """Format one number, switch or text; empty for other values."""
    if isinstance(value, bool):
        return "1" if value else "0"
    if isinstance(value, (int, float, str)):
        return str(value)
    return ""
