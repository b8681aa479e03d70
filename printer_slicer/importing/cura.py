"""Read Cura's definitions: a machine with the definitions it inherits from, its first extruder, and changes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from printer_slicer.errors import ProfileError
from printer_slicer.importing.archives import read_archive, read_text
from printer_slicer.importing.cura_names import CURA_DEFAULTS, translate_cura
from printer_slicer.importing.cura_values import CuraExpressionError, evaluate_cura
from printer_slicer.importing.ini import IniSection, SourceSetting, read_sections
from printer_slicer.importing.orca import read_json
from printer_slicer.importing.presets import Preset, parse_quantity
from printer_slicer.values import Struct, field

__all__ = ["CuraDefinition", "is_cura_definition", "make_cura_presets", "read_cura_profile"]

_SUFFIX: Final = ".def.json"


def is_cura_definition(values: Mapping[str, Any]) -> bool:
    """Return whether a JSON file is a Cura definition."""
    return "version" in values and ("overrides" in values or isinstance(values.get("settings"), dict))


class CuraDefinition(Struct):
    """A machine with its own settings and those it inherits.

    Attributes:
        name: display name.
        place: its file.
        settings: key -> properties, such as `value` and `default_value`.
        changes: key -> value from a profile or the command line.
        changed_at: key -> where the change was made.
        own: keys that the machine's own files change.
        failed: key -> why its expression could not be evaluated.
        last_requested: the setting that was requested last, apart from the settings that it depends on.
    """

    name: str
    place: str
    settings: dict[str, dict[str, Any]]
    changes: dict[str, str] = field(default_factory=dict)
    changed_at: dict[str, str] = field(default_factory=dict)
    own: list[str] = field(default_factory=list)
    failed: dict[str, str] = field(default_factory=dict)
    last_requested: str = ""
    _values: dict[str, Any] = field(default_factory=dict)
    _in_progress: list[str] = field(default_factory=list)

    @property
    def requested_keys(self) -> set[str]:
        """Keys of all settings whose values were requested, directly or by expressions of other settings."""
        return set(self._values)

    def find_place(self, key: str) -> str:
        """Return where a setting is set: the place of its change, or the file of the machine."""
        return self.changed_at.get(key, self.place)

    def get_value(self, key: str) -> Any:
        """Return the value of a setting; if its expression cannot be evaluated, return the default.

        Raises:
            CuraExpressionError: the setting does not exist, or depends on itself.
        """
        if not self._in_progress:
            self.last_requested = key
        if key in self._values:
            return self._values[key]
        if key in self._in_progress:
            raise CuraExpressionError(f"{key} depends on itself")
        if key not in self.settings and key not in self.changes:
            raise CuraExpressionError(f"{key} is not a setting of this machine")
        self._in_progress.append(key)
        try:
            found = self._compute_value(key)
        finally:
            self._in_progress.pop()
        self._values[key] = found
        return found

    def _compute_value(self, key: str) -> Any:
        """Return a setting's changed value, the value of its expression, or its default."""
        properties = self.settings.get(key, {})
        given = self.changes.get(key)
        if given is not None:
            try:
                return _parse_change(given, str(properties.get("type", "")), self)
            except CuraExpressionError as error:
                raise ProfileError(
                    f"{self.changed_at[key]}: {key}: {error}",
                    remedy="Change it in Cura, or with --cura KEY=VALUE",
                ) from None
        default = properties.get("default_value")
        expression = properties.get("value", default)
        if "value" not in properties or not isinstance(expression, str):
            return expression
        try:
            return evaluate_cura(expression, self.get_value)
        except CuraExpressionError as error:
            self.failed[key] = str(error)
            return default


def _parse_change(text: str, kind: str, machine: CuraDefinition) -> Any:
    """Convert the text of a change: an expression that begins with `=`, or a value of the setting's type."""
    if text.startswith("="):
        return evaluate_cura(text[1:], machine.get_value)
    if kind == "bool" or text.lower() in ("true", "false"):
        return text.strip().lower() in ("true", "1", "yes")
    number = parse_quantity(text) if kind not in ("str", "enum") else None
    if number is None or number.is_percent:
        return text
    return int(text) if kind == "int" and text.strip().isdigit() else number.value


def make_cura_presets(
    values: Mapping[str, Any],
    path: Path,
    folders: Sequence[Path],
    changes: Mapping[str, SourceSetting],
    name: str = "",
) -> list[Preset]:
    """Return the printer, material and quality of a machine, with Cura's defaults and the given changes.

    Args:
        values: the machine's definition.
        path: its file.
        folders: other folders with the definitions it inherits from.
        changes: key -> value and place.
        name: name of the profile with the changes; it names the material and the quality.

    Raises:
        ProfileError: a definition it inherits from is missing, or a change is invalid.
    """
    search_folders = [path.parent, *folders]
    machine = CuraDefinition(str(values.get("name") or path.stem), str(path), {})
    for own, file in reversed(list(_walk_inheritance(dict(values), path, search_folders))):
        _add_definition(machine, own, base=file.name.startswith("fdm"))
    _add_first_extruder(machine, values, search_folders)
    for key, entry in changes.items():
        if key not in machine.settings:
            raise ProfileError(
                f"{entry.place}: {key}: Cura has no such setting", remedy="Look up its name in the definition"
            )
        machine.changes[key], machine.changed_at[key] = entry.text, entry.place
    entries = _translate_settings(machine)
    entries |= {key: entry for key, entry in changes.items() if key not in machine.requested_keys}
    names = {
        "printer": machine.name,
        "material": f"{name or machine.name} material",
        "quality": name or f"{machine.name} quality",
    }
    return [
        Preset(kind, name, "cura", machine.place, entries, CURA_DEFAULTS, mixed=True)
        for kind, name in names.items()
    ]


def _translate_settings(machine: CuraDefinition) -> dict[str, SourceSetting]:
    """Return the settings of a machine under PrusaSlicer's names.

    Raises:
        ProfileError: settings are missing, or a value is invalid.
    """
    try:
        return translate_cura(machine.get_value, machine.find_place)
    except CuraExpressionError as error:
        raise ProfileError(
            f"{machine.place}: {error}",
            remedy="Import the definition of a machine, not one that others inherit from",
        ) from None
    except (TypeError, ValueError, ArithmeticError):
        key = machine.last_requested
        raise ProfileError(
            f"{machine.find_place(key)}: {key}: invalid value",
            remedy=f"Change it with --cura {key}=VALUE",
        ) from None


def _walk_inheritance(
    values: dict[str, Any], path: Path, folders: Sequence[Path]
) -> Iterator[tuple[dict[str, Any], Path]]:
    """Yield a definition and the definitions that it inherits from, each with its file."""
    seen = [path.name]
    yield values, path
    while parent := values.get("inherits"):
        name = f"{parent}{_SUFFIX}"
        if name in seen:
            raise ProfileError(
                f"{path}: inherits from itself: {' -> '.join([*seen, name])}",
                remedy="Change one `inherits` in this chain",
            )
        candidates = [] if "/" in name else [folder / name for folder in folders]
        found = next((one for one in candidates if one.is_file()), None)
        if found is None:
            raise ProfileError(
                f"{path}: inherits {parent!r}, but {name} is not in the same folder",
                remedy="Give the folder of Cura's definitions with --folder FOLDER",
            )
        seen.append(name)
        values, path = _read_definition(found), found
        yield values, path


def _read_definition(path: Path) -> dict[str, Any]:
    """Read the file of a definition."""
    return read_json(read_text(path), str(path))


def _add_definition(machine: CuraDefinition, values: Mapping[str, Any], *, base: bool) -> None:
    """Add to a machine the settings that a definition declares, and the properties that it changes."""
    pending = [values.get("settings")]
    while pending:
        table = pending.pop()
        for key, properties in table.items() if isinstance(table, dict) else ():
            if isinstance(properties, dict):
                machine.settings[key] = {name: one for name, one in properties.items() if name != "children"}
                pending.append(properties.get("children"))
    overrides = values.get("overrides")
    for key, properties in overrides.items() if isinstance(overrides, dict) else ():
        if isinstance(properties, dict):
            machine.settings[key] = machine.settings.get(key, {}) | properties
            machine.own += [] if base else [key]


def _add_first_extruder(machine: CuraDefinition, values: Mapping[str, Any], folders: Sequence[Path]) -> None:
    """Add to a machine the settings of its first extruder."""
    trains: Any = None
    for own, _ in _walk_inheritance(dict(values), Path(machine.place), folders):
        metadata = own.get("metadata")
        trains = trains or (metadata.get("machine_extruder_trains") if isinstance(metadata, dict) else None)
    name = trains.get("0") if isinstance(trains, dict) else None
    if not isinstance(name, str) or "/" in name:
        return
    places = [place for folder in folders for place in (folder, folder.parent / "extruders")]
    found = next(
        (place / f"{name}{_SUFFIX}" for place in places if (place / f"{name}{_SUFFIX}").is_file()), None
    )
    if found is not None:
        _add_definition(machine, {"overrides": _read_definition(found).get("overrides")}, base=False)


def read_cura_profile(path: Path, text: str) -> tuple[str, str, dict[str, SourceSetting]]:
    """Read a profile (`.inst.cfg`, `.curaprofile`); return the definition of its machine, its name, and its settings.

    Args:
        path: the file.
        text: its text; empty for `.curaprofile`, which is an archive of several texts.

    Raises:
        ProfileError: the file is not a Cura profile.
    """
    texts = [text] if text else list(read_archive(path).values())
    machine = name = ""
    changes: dict[str, SourceSetting] = {}
    for one in texts:
        sections: Mapping[str, IniSection] = {
            section.title: section for section in read_sections(one.splitlines(), str(path))
        }
        if "general" in sections and "values" in sections:
            machine = sections["general"].texts.get("definition", machine)
            name = name or sections["general"].texts.get("name", "")
            changes |= sections["values"].entries
    if not machine:
        raise ProfileError(f"{path}: not a Cura profile", remedy="Export it in Cura under Manage Profiles")
    return machine, name or path.name.partition(".")[0], changes
