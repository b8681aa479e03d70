"""Read Cura's definitions: a machine with all it inherits, its first extruder, and changed settings."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from printer_slicer.errors import ProfileError
from printer_slicer.importing.archives import read_archive, read_text
from printer_slicer.importing.cura_names import CURA_DEFAULTS, translate_cura
from printer_slicer.importing.cura_values import CuraExpressionError, evaluate_cura
from printer_slicer.importing.ini import IniSection, SourceSetting, read_sections
from printer_slicer.importing.orca import read_json
from printer_slicer.importing.presets import Preset, parse_quantity

__all__ = ["CuraDefinition", "cura_presets", "is_cura_definition", "read_cura_profile"]

_SUFFIX: Final = ".def.json"


def is_cura_definition(values: Mapping[str, Any]) -> bool:
    """Return whether a JSON file is a Cura definition."""
    return "version" in values and ("overrides" in values or isinstance(values.get("settings"), dict))


@dataclass(slots=True)
class CuraDefinition:
    """A machine with all the settings it inherits.

    Attributes:
        name: display name.
        place: its file.
        settings: key -> properties, such as `value` and `default_value`.
        changes: key -> value from a profile or the command line.
        changed_at: key -> where the change was made.
        own: keys that the machine's own files change.
        failed: key -> why its expression could not be evaluated.
        asked: the setting that was requested last, apart from those it depends on.
    """

    name: str
    place: str
    settings: dict[str, dict[str, Any]]
    changes: dict[str, str] = field(default_factory=dict)
    changed_at: dict[str, str] = field(default_factory=dict)
    own: list[str] = field(default_factory=list)
    failed: dict[str, str] = field(default_factory=dict)
    asked: str = ""
    _values: dict[str, Any] = field(default_factory=dict)
    _open: list[str] = field(default_factory=list)

    @property
    def requested(self) -> set[str]:
        """Return the settings that were requested, directly or by others."""
        return set(self._values)

    def where(self, key: str) -> str:
        """Return the place where a setting is set: a change, or the definition."""
        return self.changed_at.get(key, self.place)

    def value(self, key: str) -> Any:
        """Return the value of a setting, or its default if its expression cannot be evaluated.

        Raises:
            CuraExpressionError: the setting does not exist, or depends on itself.
        """
        if not self._open:
            self.asked = key
        if key in self._values:
            return self._values[key]
        if key in self._open:
            raise CuraExpressionError(f"{key} depends on itself")
        if key not in self.settings and key not in self.changes:
            raise CuraExpressionError(f"{key} is not a setting of this machine")
        self._open.append(key)
        try:
            found = self._compute(key)
        finally:
            self._open.pop()
        self._values[key] = found
        return found

    def _compute(self, key: str) -> Any:
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
            return evaluate_cura(expression, self.value)
        except CuraExpressionError as error:
            self.failed[key] = str(error)
            return default


def _parse_change(text: str, kind: str, machine: CuraDefinition) -> Any:
    """Return a changed value: an expression if it begins with `=`, else a value of the setting's type."""
    if text.startswith("="):
        return evaluate_cura(text[1:], machine.value)
    if kind == "bool" or text.lower() in ("true", "false"):
        return text.strip().lower() in ("true", "1", "yes")
    number = parse_quantity(text) if kind not in ("str", "enum") else None
    if number is None or number.percent:
        return text
    return int(text) if kind == "int" and text.strip().isdigit() else number.value


def cura_presets(
    values: Mapping[str, Any],
    path: Path,
    folders: Sequence[Path],
    changes: Mapping[str, SourceSetting],
    name: str = "",
) -> list[Preset]:
    """Return printer, material and quality of a machine with Cura's defaults and some changes.

    Args:
        values: the machine's definition.
        path: its file.
        folders: other folders with the definitions it inherits from.
        changes: key -> value and place.
        name: name of the profile with the changes, for material and quality.

    Raises:
        ProfileError: a definition it inherits from is missing, or a change is invalid.
    """
    around = [path.parent, *folders]
    machine = CuraDefinition(str(values.get("name") or path.stem), str(path), {})
    for own, file in reversed(list(_with_parents(dict(values), path, around))):
        _add(machine, own, base=file.name.startswith("fdm"))
    _extruder(machine, values, around)
    for key, entry in changes.items():
        if key not in machine.settings:
            raise ProfileError(
                f"{entry.place}: {key}: Cura has no such setting", remedy="Look up its name in the definition"
            )
        machine.changes[key], machine.changed_at[key] = entry.text, entry.place
    entries = _translate(machine)
    entries |= {key: entry for key, entry in changes.items() if key not in machine.requested}
    names = {
        "printer": machine.name,
        "material": f"{name or machine.name} material",
        "quality": name or f"{machine.name} quality",
    }
    return [
        Preset(kind, name, "cura", machine.place, entries, CURA_DEFAULTS, mixed=True)
        for kind, name in names.items()
    ]


def _translate(machine: CuraDefinition) -> dict[str, SourceSetting]:
    """Return the settings of a machine under PrusaSlicer's names.

    Raises:
        ProfileError: settings are missing, or a value is invalid.
    """
    try:
        return translate_cura(machine.value, machine.where)
    except CuraExpressionError as error:
        raise ProfileError(
            f"{machine.place}: {error}",
            remedy="Import the definition of a machine, not one that others inherit from",
        ) from None
    except (TypeError, ValueError, ArithmeticError):
        key = machine.asked
        raise ProfileError(
            f"{machine.where(key)}: {key}: invalid value",
            remedy=f"Change it with --cura {key}=VALUE",
        ) from None


def _with_parents(
    values: dict[str, Any], path: Path, folders: Sequence[Path]
) -> Iterator[tuple[dict[str, Any], Path]]:
    """Yield a definition and those it inherits from, with their files."""
    seen = [path.name]
    yield values, path
    while parent := values.get("inherits"):
        name = f"{parent}{_SUFFIX}"
        if name in seen:
            raise ProfileError(
                f"{path}: inherits from itself: {' -> '.join([*seen, name])}",
                remedy="Change one `inherits` in this chain",
            )
        near = [] if "/" in name else [folder / name for folder in folders]
        found = next((one for one in near if one.is_file()), None)
        if found is None:
            raise ProfileError(
                f"{path}: inherits {parent!r}, but {name} is not in the same folder",
                remedy="Name the folder with Cura's definitions with --folder",
            )
        seen.append(name)
        values, path = _read(found), found
        yield values, path


def _read(path: Path) -> dict[str, Any]:
    return read_json(read_text(path), str(path))


def _add(machine: CuraDefinition, values: Mapping[str, Any], *, base: bool) -> None:
    """Add the settings that a definition declares, and the properties that it changes."""
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


def _extruder(machine: CuraDefinition, values: Mapping[str, Any], folders: Sequence[Path]) -> None:
    """Add the settings of the first extruder."""
    trains: Any = None
    for own, _ in _with_parents(dict(values), Path(machine.place), folders):
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
        _add(machine, {"overrides": _read(found).get("overrides")}, base=False)


def read_cura_profile(path: Path, text: str) -> tuple[str, str, dict[str, SourceSetting]]:
    """Read a profile (`.inst.cfg`, `.curaprofile`): its machine's definition, its name, and its settings.

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
